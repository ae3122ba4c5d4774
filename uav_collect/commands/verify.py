"""Proves recorded missions: flies each again and compares the recording byte for byte."""

import argparse
from collections import Counter
from collections.abc import Iterator
import json
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

from uav_collect import files
from uav_collect.commands import options
from uav_collect.config.arguments import error_lines
from uav_collect.errors import UavCollectError
from uav_collect.kernels.compile import interpret_kernels
from uav_collect.limits import FAILED, is_code_name, UNUSABLE

if TYPE_CHECKING:  # loaded when needed, so that --help answers at once
    from uav_collect.analysis.proof import Proof
    from uav_collect.analysis.recording_proof import Given

_DESCRIPTION = """
Flies each recorded mission again, from the recording alone, and proves it byte for
byte; or names the first event that differs, its field, the recorded and the flown value, and what
has changed since: a policy's version, the code, the scenario. PATH is a run folder, a bag or
a mission log. In a bag, messages and the checksums of its file are compared, too. What the
world decided because an agent was silent, and faults that were injected, are taken as recorded and
counted. What cannot be read is named, and the rest is proved. The exit status is 0 if all is
proved, 1 if something differs or is damaged, otherwise 2 if something cannot be read or flown.
"""
_PROVED, _DIFFERS, _UNPROVABLE = 0, FAILED, UNUSABLE


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments."""
    parser.description = _DESCRIPTION
    parser.add_argument(
        'path', type=Path, nargs='+', metavar='PATH', help='run folder, bag or mission log'
    )
    parser.add_argument(
        '--scenario',
        metavar='NAME|FILE',
        help='of logs alone (default: scenario.yaml beside them, or the shipped one so called)',
    )
    parser.add_argument(
        '--policy',
        type=_policy,
        nargs='+',
        default=[],
        metavar='POLICY',
        help='.safetensors files of policies that are neither in the recording nor shipped, and'
        ' functions that may be run',
    )
    parser.add_argument(
        '--json', type=options.output, metavar='FILE', help='write all that was found'
    )


def _policy(text: str) -> Path:
    """A type for argparse: a policy's file, or a function."""
    from uav_collect.uav.policy_file import SUFFIX

    if not text.endswith(SUFFIX) and not is_code_name(text):
        what = f'must be a {SUFFIX} file or module:function'
        raise argparse.ArgumentTypeError(f'{text!r} {what}')
    return Path(text)


def run(arguments: argparse.Namespace) -> int:
    """Prove what is at the paths; returns the exit status."""
    if 'numba' not in sys.modules:  # a mission is flown in less time than kernels take to load
        interpret_kernels()
    from uav_collect.analysis.recording_proof import Given

    if arguments.json is not None:
        files.check_writable(arguments.json)
    _look_at(arguments.policy)
    given = Given(site=_site(arguments.scenario), policy_files=tuple(arguments.policy))
    proofs: list[Proof] = []
    unread: list[Proof] = []
    for path in arguments.path:
        for proof in _proofs_at(path, given, unread):
            _show(f'{path}: {proof}' if len(arguments.path) > 1 else str(proof))
            proofs.append(proof)
    if not proofs:
        return _UNPROVABLE
    proofs += unread
    _show(_summary(proofs))
    if arguments.json is not None:
        text = json.dumps([_values(proof) for proof in proofs], indent=1)
        files.write_result(arguments.json, f'{text}\n'.encode())
    return _status(proofs)


def _proofs_at(path: Path, given: 'Given', unread: 'list[Proof]') -> 'Iterator[Proof]':
    """The proofs of a recording; one that cannot be read is named, and added to `unread`."""
    from uav_collect.analysis.proof import Proof, Verdict
    from uav_collect.analysis.recording_proof import prove_recording

    try:
        yield from prove_recording(path, given)
    except (OSError, UavCollectError) as error:
        text = error_lines(error)
        sys.stderr.write(text)
        lines = tuple(line.removeprefix('error: ') for line in text.splitlines())
        unread.append(Proof(mission=str(path), verdict=Verdict.UNPROVABLE, findings=lines))


def _look_at(policies: list[Path]) -> None:
    """Say which files are of before; raise PolicyMismatchError if one cannot be read."""
    from uav_collect.uav.policy import outdated
    from uav_collect.uav.policy_file import load_policy, SUFFIX

    for path in policies:
        if path.suffix == SUFFIX and (line := outdated(path.stem, load_policy(path))) is not None:
            sys.stderr.write(f'{line}\n')


def _site(scenario: str | None) -> Any:  # noqa: ANN401 - a site, if there is one
    if scenario is None:
        return None
    from uav_collect.scenario.load import load
    from uav_collect.scenario.site import build_site

    return build_site(load(scenario))


def _summary(proofs: 'list[Proof]') -> str:
    """How many missions came to which end, in one line."""
    from uav_collect.analysis.proof import Verdict

    counts = Counter(proof.verdict for proof in proofs)
    n_missions = len(proofs) - counts[Verdict.DAMAGED]
    parts = [f'{counts[verdict]} {verdict.value}' for verdict in Verdict if counts[verdict]]
    return f'{n_missions} mission{"" if n_missions == 1 else "s"}: {", ".join(parts) or "none"}'


def _status(proofs: 'list[Proof]') -> int:
    """A difference counts for more than what could not be looked at."""
    from uav_collect.analysis.proof import Verdict

    found = {proof.verdict for proof in proofs}
    if found & {Verdict.DIFFERS, Verdict.DAMAGED}:
        return _DIFFERS
    return _UNPROVABLE if Verdict.UNPROVABLE in found else _PROVED


def _values(proof: 'Proof') -> dict[str, object]:
    return {
        'mission': proof.mission,
        'verdict': proof.verdict.value,
        'events': proof.n_events,
        'failsafes': proof.n_failsafes,
        'injected_faults': proof.n_injected,
        'cut_off': proof.is_cut_off,
        'findings': list(proof.findings),
    }


def _show(line: str) -> None:
    sys.stdout.write(f'{line}\n')
    sys.stdout.flush()

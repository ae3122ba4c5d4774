"""Mission logs: what is made of those whose lines, values or bytes are others.

The log of one small mission is made once. It is read as `report` reads it, and proved as `verify`
proves it.
"""

from functools import cache
import json
from pathlib import Path
from typing import Any, NamedTuple

from byte_changes import BYTE_CHANGES, ByteChange, changed_bytes
from fuzzing import check_lines, fuzzed, memory_folder
from hypothesis import strategies as st
import numpy as np
from tiny_world import tiny, uav
from uav_collect.analysis.metrics import check_log
from uav_collect.analysis.proof import Verdict
from uav_collect.analysis.recording_proof import Given, prove_recording
from uav_collect.analysis.results import flown_mission
from uav_collect.errors import MissionLogError, UavCollectError
from uav_collect.missions.rollout import fly
from uav_collect.recording.mission_log import read_so_far
from uav_collect.scenario.site import build_site, Site

SHARES = st.floats(0.0, 1.0, exclude_max=True)
RAW = st.sampled_from(
    ['NaN', '-Infinity', '1e999', '-0.0', '1' + 5_000 * '0', '[' * 2_000, '"\\ud800"', 'tru', '']
)  # what JSON has no value for, or Python no room
VALUES = st.one_of(
    st.recursive(
        st.one_of(
            *(st.none(), st.booleans(), st.floats(allow_nan=False, allow_infinity=False)),
            *(st.integers(), st.text(st.characters(exclude_categories=['Cs']), max_size=20)),
            st.sampled_from([0, 1, 2, 3, 64, 65, 2**53, 3_000_000_000, 2**64, 10**400, -1]),
            st.sampled_from(
                ['hover', 'home', 'failsafe', 'gone', '[/b]', '\x1b[31m', 'x' * 2_000]
            ),
        ),
        lambda below: st.one_of(
            st.lists(below, max_size=3), st.dictionaries(st.text(max_size=5), below, max_size=2)
        ),
        max_leaves=4,
    ).map(json.dumps),
    RAW,
)


class Made(NamedTuple):
    """What is changed."""

    site: Site
    content: bytes
    lines: tuple[str, ...]


@cache
def made() -> Made:
    """The log of a mission of two UAVs, one of which a fault befalls, beside its scenario."""
    site = build_site(
        tiny(uav(5.0), uav(10.0), faults=[{'kind': 'silent', 'uav': 1, 'at_s': 5.0}])
    )
    [log] = fly(site, [0], 'sweep')
    (memory_folder('log') / 'scenario.yaml').write_text(site.scenario.to_yaml())
    content = log.to_jsonl()
    assert b'"fault"' in content
    return Made(site, content, tuple(content.decode().splitlines()))


class LineChange(NamedTuple):
    """What befalls a line."""

    what: str
    share: float  # of the lines that lies before
    other_share: float
    key_share: float  # of its keys
    value: str  # JSON, or nearly

    def made(self, lines: list[str]) -> None:
        """Change a list of lines."""
        if not lines:
            return
        at, other = (int(share * len(lines)) for share in (self.share, self.other_share))
        match self.what:
            case 'drop':
                del lines[at]
            case 'double':
                lines.insert(other, lines[at])
            case 'move':
                lines.insert(other, lines.pop(at))
            case 'line':
                lines[at] = self.value
            case 'header':
                lines[0] = self._with_value(lines[0])
            case _:
                lines[at] = self._with_value(lines[at])

    def _with_value(self, line: str) -> str:
        try:
            values = json.loads(line)
        except (RecursionError, ValueError):
            return line
        return self._changed(values) if isinstance(values, dict) and values else line

    def _changed(self, values: dict[str, Any]) -> str:
        """The line with another value, without one, or with a key twice or more."""
        names = list(values)
        name = names[int(self.key_share * len(names))]
        uavs = values.get('uavs')
        if name == 'uavs' and isinstance(uavs, list) and uavs and self.what != 'key':
            uav_text = self._changed(uavs[0]) if isinstance(uavs[0], dict) and uavs[0] else '3'
            pairs = [(it, json.dumps(values[it])) for it in names if it != 'uavs']
            others = ''.join(f', {json.dumps(it)}' for it in uavs[1:])
            pairs.append(('uavs', f'[{uav_text}{others}]'))
            return _object(pairs)
        pairs = [(it, json.dumps(values[it])) for it in names]
        if self.what == 'key':
            return _object([*pairs, (name, self.value)] if self.other_share < 0.5 else pairs[1:])
        return _object([(it, self.value if it == name else text) for it, text in pairs])


def _object(pairs: list[tuple[str, str]]) -> str:
    return '{' + ', '.join(f'{json.dumps(name)}: {text}' for name, text in pairs) + '}'


LINE_CHANGES = st.lists(
    st.builds(
        LineChange,
        what=st.sampled_from(
            ['drop', 'double', 'move', 'line', 'key', 'header', 'value', 'value', 'value']
        ),
        share=SHARES,
        other_share=SHARES,
        key_share=SHARES,
        value=VALUES,
    ),
    min_size=1,
    max_size=3,
)


def changed_log(line_changes: list[LineChange], byte_changes: list[ByteChange]) -> Path:
    """A log with changes of both kinds."""
    lines = [*made().lines]
    for change in line_changes:
        change.made(lines)
    content = ''.join(f'{line}\n' for line in lines).encode(errors='surrogatepass')
    path = memory_folder('log') / 'mission_0.jsonl'
    path.write_bytes(changed_bytes(content, byte_changes))
    return path


def read(path: Path) -> None:
    """Read a log as `report` does, and hold what comes of it to what can be."""
    try:
        log = read_so_far(path)
        if log.is_over:
            check_log(log)
    except MissionLogError as error:
        check_lines([str(error)])
        return
    for name in log.events.dtype.names or ():
        assert np.isfinite(log.events[name].astype(np.float64)).all()
    content = log.to_jsonl()
    if content != made().content and log.header.mission_seed < 2**62:
        assert 'nan' not in str(flown_mission(log, made().site)).split()


@fuzzed(share=0.6, changes=LINE_CHANGES)
def test_lines_of_a_log(changes: list[LineChange]) -> None:
    read(changed_log(changes, []))


@fuzzed(share=0.3, changes=BYTE_CHANGES)
def test_bytes_of_a_log(changes: list[ByteChange]) -> None:
    read(changed_log([], changes))


@fuzzed(share=0.1, line_changes=LINE_CHANGES, byte_changes=st.one_of(st.just([]), BYTE_CHANGES))
def test_a_changed_log_is_never_proved(
    line_changes: list[LineChange], byte_changes: list[ByteChange]
) -> None:
    path = changed_log(line_changes, byte_changes)
    content = path.read_bytes()
    try:
        proofs = [*prove_recording(path, Given())]
    except UavCollectError as error:
        check_lines([str(error)])
        return
    for proof in proofs:
        check_lines([str(proof)])
        if proof.verdict is Verdict.PROVED:
            assert made().content.startswith(content)

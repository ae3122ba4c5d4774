"""Finds the missions of a recording, and proves them one after the other."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from pathlib import Path
import re
import struct
from typing import Any

from uav_collect.analysis.proof import (
    Account,
    bag_account,
    log_account,
    Proof,
    prove,
    Verdict,
)
from uav_collect.errors import BagError, ConfigError, MissionLogError, UavCollectError
from uav_collect.missions.recorded_policies import RecordedPolicies
from uav_collect.recording.bag_checksums import check_file
from uav_collect.recording.bag_reader import recorded_site
from uav_collect.recording.mission_folder import scenario_file, take_log
from uav_collect.recording.mission_messages import MissionMessages, MissionReader
from uav_collect.recording.origin import (
    changed_since,
    ORIGIN_KEY,
    parsed_origin,
    read_origin,
    read_versions,
)
from uav_collect.scenario.load import fingerprint, from_yaml, load, scenario_names
from uav_collect.scenario.site import build_site, Site
from uav_collect.uav.policy_file import SUFFIX as POLICY_SUFFIX
import yaml

LOG_SUFFIX = '.jsonl'
BAG_SUFFIX = '.mcap'
_SCENARIO_FILES = 'scenario*.yaml'
_METADATA = 'metadata.yaml'
_METADATA_TOP = 'rosbag2_bagfile_information'
# What reading a damaged bag may raise: it has no checksums if it comes that far.
_DAMAGE = (AssertionError, EOFError, IndexError, KeyError, MemoryError, OSError, OverflowError,
           RuntimeError, struct.error, TypeError, ValueError)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Given:
    """What a user gives beside a recording."""

    site: Site | None = None  # of logs that lie where no scenario is
    policy_files: Sequence[Path] = field(default_factory=tuple)


def prove_recording(path: Path, given: Given) -> Iterator[Proof]:
    """Prove all missions of a run folder, a bag or a mission log.

    Raises:
        MissionLogError: there is nothing of the kind at the path.
        BagError: it is a bag that cannot be read.
    """
    if not path.exists():
        raise MissionLogError(f'{path}: no such file or folder')
    if _bag_files(path):
        yield from _Bag(path, given.policy_files).proofs({}, ())
    elif path.is_file():
        yield from _proofs_of_logs([path], path.parent, given)
    else:
        yield from _proofs_of_run(path, given)


def _proofs_of_run(folder: Path, given: Given) -> Iterator[Proof]:
    """Those of a run folder: of bags, with the logs of the same missions; then of other logs."""
    bags = [each for each in sorted(folder.iterdir()) if each.is_dir() and _bag_files(each)]
    found = sorted(folder.glob(f'*{LOG_SUFFIX}'))
    logs = {log.name: log for log in found if log.is_file()}
    lost = [each for each in sorted(folder.glob(f'*/{_METADATA}')) if each.parent not in bags]
    for metadata in lost:
        finding = f'has {_METADATA}, but no {BAG_SUFFIX} file'
        yield Proof(mission=metadata.parent.name, verdict=Verdict.DAMAGED, findings=(finding,))
    if not (bags or logs or lost):
        raise MissionLogError(f'{folder}: holds no mission log ({LOG_SUFFIX}) and no bag')
    policies = _policy_files(folder, given)
    for bag in bags:
        yield from _Bag(bag, policies).proofs(logs, sorted(folder.glob(_SCENARIO_FILES)))
    yield from _proofs_of_logs([*logs.values()], folder, given)


def _policy_files(folder: Path, given: Given) -> list[Path]:
    return [*given.policy_files, *sorted(folder.glob(f'*{POLICY_SUFFIX}'))]


def _proofs_of_logs(logs: Sequence[Path], folder: Path, given: Given) -> Iterator[Proof]:
    """Those of logs alone."""
    policies = RecordedPolicies(_policy_files(folder, given))
    code_change, versions = _code_change(read_origin(folder)), read_versions(folder)
    for log in logs:
        account = log_account(log.name, log.read_bytes())
        try:
            site = given.site or _site_of(account, folder)
        except UavCollectError as error:
            yield _unprovable(log.name, str(error))
            continue
        account = replace(account, versions=_by_uav(account, versions))
        if not account.lines:
            yield _unprovable(log.name, 'holds no event')
            continue
        proof = prove(log.name, [account], site, policies, code_change)
        yield _with_name_checked(proof, account)


def _by_uav(account: Account, versions: Mapping[str, str]) -> dict[int, str]:
    """Versions of policies by the ids of the UAVs that they flew."""
    uavs = [] if account.header is None else account.header.uavs
    return {uav.id: versions[uav.policy] for uav in uavs if uav.policy in versions}


def _site_of(account: Account, folder: Path) -> Site:
    """The site of a log: by the scenario beside it, or a shipped one.

    Raises:
        ConfigError: there is none, or it is not valid.
    """
    wanted = account.header.scenario_fingerprint if account.header is not None else ''
    file = scenario_file(folder, wanted)
    if file.is_file():
        try:
            return build_site(from_yaml(file.read_text(encoding='utf-8')))
        except UnicodeDecodeError as error:
            raise ConfigError(f'{file.name}: {error}') from error
    name = account.header.scenario if account.header is not None else None
    if name not in scenario_names():
        raise ConfigError(f'scenario {name} is not here: give it with --scenario')
    return build_site(load(name))


def _with_name_checked(proof: Proof, account: Account) -> Proof:
    """The proof of a log, unless its name says another mission than its header."""
    match = re.fullmatch(r'mission_(\d+)(?:_(\d+))?\.jsonl', account.source)
    seed = account.header.mission_seed if account.header is not None else None
    if match is None or seed is None or int(match[1]) == seed:
        return proof
    finding = f'header: mission_seed is {seed}, the file is called {account.source}'
    return replace(proof, verdict=Verdict.DIFFERS, findings=(finding, *proof.findings))


class _Bag:
    """A bag while its missions are proved."""

    def __init__(self, path: Path, policy_files: Sequence[Path]) -> None:
        self._path = path
        self._files = _bag_files(path)
        self._checks = {file: check_file(file) for file in self._files}
        # Metadata may be damaged or gone; one file tells all by itself.
        self._reader = MissionReader(self._files[0] if len(self._files) == 1 else path)
        self._policies = RecordedPolicies(policy_files, self._reader.policies)
        self._sites: dict[str, Site] = {}  # by text of the scenario

    def proofs(self, logs: dict[str, Path], scenario_files: Sequence[Path]) -> Iterator[Proof]:
        """Those of all missions, after what is damaged.

        Args:
            logs: of the run, by name; those of missions in the bag are taken out.
            scenario_files: of the run.
        """
        damages = [*self._damages()]
        yield from damages
        code_change = _code_change(self._origin())
        n_missions = 0
        try:
            for mission in self._reader.missions():
                if mission.start is not None:
                    n_missions += 1
                    yield self._proof(mission, logs, code_change, is_run=bool(scenario_files))
        except (BagError, *_DAMAGE) as error:
            if not damages:
                yield _unprovable(self._path.name, f'cannot be read further: {error}')
            return
        if not n_missions and not damages:
            yield _unprovable(self._path.name, 'holds no mission')
        for file in scenario_files:
            yield from self._scenario_file_damage(file)

    def _proof(
        self,
        mission: MissionMessages,
        logs: dict[str, Path],
        code_change: str | None,
        *,
        is_run: bool,
    ) -> Proof:
        account = bag_account(self._path.name, mission)
        seed = int(mission.start.seed) if account.header is None else account.header.mission_seed
        accounts, name = [account], f'{self._path.name}: mission {mission.mission_id}, seed {seed}'
        log = take_log(logs, seed, int(mission.start.index))
        if log is not None:
            accounts.append(log_account(log.name, log.read_bytes()))
        try:
            site = self._site(mission)
        except UavCollectError as error:
            return Proof(mission=name, verdict=Verdict.DIFFERS, findings=(str(error),))
        proof = prove(name, accounts, site, self._policies, code_change)
        if is_run and log is None:
            findings = (*proof.findings, f'the folder has no log of seed {seed}')
            proof = replace(proof, verdict=Verdict.DIFFERS, findings=findings)
        is_sealed = all(check.has_checksums for check in self._checks.values())
        return replace(proof, lacks_checksums=not is_sealed)

    def _site(self, mission: MissionMessages) -> Site:
        """The site of a mission's world.

        Raises:
            BagError: it was not recorded, or reads otherwise here.
        """
        sent = self._reader.scenarios.get(mission.start.world_instance)
        if sent is None:
            raise BagError('its scenario was not recorded')
        wanted = mission.start.scenario_fingerprint
        message = next((it for it in sent if it.fingerprint == wanted), sent[0])
        if message.yaml not in self._sites:
            self._sites[message.yaml] = recorded_site(self._path, message)
        site = self._sites[message.yaml]
        if fingerprint(site.scenario) != message.fingerprint:
            raise BagError(
                f'scenario: recorded with fingerprint {message.fingerprint}, reads as'
                f' {fingerprint(site.scenario)}'
            )
        return site

    def _scenario_file_damage(self, file: Path) -> Iterator[Proof]:
        """What of a scenario in the run folder no world has said."""
        sent = [message for each in self._reader.scenarios.values() for message in each]
        texts, mine = [message.yaml.encode() for message in sent], file.read_bytes()
        if not texts or mine in texts:
            return
        pairs = enumerate(zip_longest(mine.split(b'\n'), texts[0].split(b'\n')), start=1)
        number, here, there = next((n, *pair) for n, pair in pairs if pair[0] != pair[1])
        finding = f'line {number} is {_text(here)}, in the bag {_text(there)}'
        yield Proof(mission=file.name, verdict=Verdict.DAMAGED, findings=(finding,))

    def _damages(self) -> Iterator[Proof]:
        """What of the bag's files is not as it was written."""
        for file in self._files:
            check = self._checks[file]
            findings = [*check.damages]
            metadata = file.with_name(_METADATA)
            if check.has_checksums and check.metadata is not None and self._path.is_dir():
                findings += _metadata_difference(metadata, check.metadata)
            if findings:
                name = f'{self._path.name}/{file.name}' if self._path.is_dir() else file.name
                yield Proof(mission=name, verdict=Verdict.DAMAGED, findings=tuple(findings))

    def _origin(self) -> Mapping[str, str] | None:
        for check in self._checks.values():
            values = _yaml_of(check.metadata or '')
            remarks = values.get('custom_data') if isinstance(values, dict) else None
            if isinstance(remarks, dict) and ORIGIN_KEY in remarks:
                return parsed_origin(str(remarks[ORIGIN_KEY]))
        return None


def _text(line: bytes | None) -> str:
    return 'missing' if line is None else repr(line.decode(errors='replace'))


def _metadata_difference(file: Path, copy: str) -> list[str]:
    """How metadata.yaml differs from its copy in the bag's file."""
    try:
        values = _yaml_of(file.read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError) as error:
        return [f'{file.name}: {error}']
    mine, its = values.get(_METADATA_TOP) if isinstance(values, dict) else None, _yaml_of(copy)
    if mine == its:
        return []
    if isinstance(mine, dict) and isinstance(its, dict):
        for name in [*its, *mine]:
            if mine.get(name) != its.get(name):
                return [f'{file.name}: {name} is not that of the copy in the bag']
    return [f'{file.name}: cannot be read, its copy in the bag can']


def _yaml_of(text: str) -> Any:  # noqa: ANN401 - any YAML
    """What a YAML text says; None where it is none."""
    loader = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)  # ten times as fast
    try:
        return yaml.load(text, loader)
    except (yaml.YAMLError, ValueError):
        return None


def _code_change(then: Mapping[str, str] | None) -> str | None:
    if then is None:
        return 'the recording does not say which code wrote it'
    return changed_since(then)


def _unprovable(name: str, why: str) -> Proof:
    return Proof(mission=name, verdict=Verdict.UNPROVABLE, findings=(' '.join(why.split()),))


def _bag_files(path: Path) -> list[Path]:
    if path.is_file():
        return [path] if path.suffix == BAG_SUFFIX else []
    return sorted(path.glob(f'*{BAG_SUFFIX}'))

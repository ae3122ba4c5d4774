"""Finds the missions of a recording, and proves them one after the other."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from pathlib import Path
import re
import struct

from uav_collect import files
from uav_collect.analysis.proof import (
    Account,
    bag_account,
    log_account,
    Proof,
    prove,
    Verdict,
)
from uav_collect.config.yaml_text import MAX_BYTES
from uav_collect.errors import BagError, ConfigError, MissionLogError, reason_of, UavCollectError
from uav_collect.missions.recorded_policies import RecordedPolicies
from uav_collect.recording.bag_reader import recorded_site
from uav_collect.recording.bag_storage import Bag, open_bag
from uav_collect.recording.mission_folder import is_bag, scenario_file, take_log
from uav_collect.recording.mission_log import MOST_LOG_BYTE
from uav_collect.recording.mission_messages import MissionMessages, MissionReader
from uav_collect.recording.origin import (
    changed_since,
    ORIGIN_KEY,
    parsed_origin,
    read_origin,
    read_versions,
)
from uav_collect.scenario.load import fingerprint, from_file, load, scenario_names
from uav_collect.scenario.site import build_site, Site
from uav_collect.uav.policy_file import SUFFIX as POLICY_SUFFIX

LOG_SUFFIX = '.jsonl'
_SCENARIO_FILES = 'scenario*.yaml'
# What reading a damaged bag may raise: it has no checksums if it comes that far.
_DAMAGE = (
    *(AssertionError, AttributeError, EOFError, IndexError, KeyError, MemoryError, OSError),
    *(OverflowError, RuntimeError, struct.error, TypeError, ValueError),
)


@dataclass(frozen=True, kw_only=True)
class Given:
    """What a user gives beside a recording."""

    site: Site | None = None  # of logs that lie where no scenario is
    policy_files: Sequence[Path] = field(default_factory=tuple)


def prove_recording(path: Path, given: Given) -> Iterator[Proof]:
    """Prove all missions of a run folder, a bag or a mission log.

    Raises:
        OSError: there is nothing at the path; naming it.
        MissionLogError: it is nothing of the kind.
        BagError: it is a bag that cannot be read.
    """
    files.check_there(path)
    if is_bag(path):
        yield from _proofs_of_bag(path, given.policy_files, {}, ())
    elif path.is_dir():
        yield from _proofs_of_run(path, given)
    else:
        _check_header(path)
        yield from _proofs_of_logs([path], path.parent, given)


def _check_header(log: Path) -> None:
    """Raise MissionLogError, naming the file, if its first line is none of a mission log."""
    account = log_account(log.name, files.read_bounded(log, MOST_LOG_BYTE))
    if account.header is None:
        raise MissionLogError(f'{log}: {account.header_error}')


def _proofs_of_bag(
    path: Path,
    policy_files: Sequence[Path],
    logs: dict[str, Path],
    scenario_files: Sequence[Path],
) -> Iterator[Proof]:
    with open_bag(path) as bag:
        yield from _BagProof(bag, policy_files).proofs(logs, scenario_files)


def _proofs_of_run(folder: Path, given: Given) -> Iterator[Proof]:
    """Those of a run folder: of bags, with the logs of the same missions; then of other logs."""
    bags = [each for each in sorted(folder.iterdir()) if is_bag(each)]
    found = sorted(folder.glob(f'*{LOG_SUFFIX}'))
    logs = {log.name: log for log in found if log.is_file()}
    if not (bags or logs):
        raise MissionLogError(f'{folder}: holds no mission log ({LOG_SUFFIX}) and no bag')
    policies = _policy_files(folder, given)
    for bag in bags:
        try:
            yield from _proofs_of_bag(bag, policies, logs, _scenario_files(folder))
        except BagError as error:
            yield Proof(mission=bag.name, verdict=Verdict.DAMAGED, findings=(str(error),))
    yield from _proofs_of_logs([*logs.values()], folder, given)


def _scenario_files(folder: Path) -> list[Path]:
    return [each for each in sorted(folder.glob(_SCENARIO_FILES)) if each.is_file()]


def _policy_files(folder: Path, given: Given) -> list[Path]:
    return [*given.policy_files, *sorted(folder.glob(f'*{POLICY_SUFFIX}'))]


def _proofs_of_logs(logs: Sequence[Path], folder: Path, given: Given) -> Iterator[Proof]:
    """Those of logs alone."""
    policies = RecordedPolicies(_policy_files(folder, given))
    code_change, versions = _code_change(read_origin(folder)), read_versions(folder)
    for log in logs:
        try:
            account = _account_of(log)
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


def _account_of(log: Path) -> Account:
    """What a log holds.

    Raises:
        MissionLogError: it cannot be read.
    """
    try:
        content = files.read_bounded(log, MOST_LOG_BYTE)
    except OSError as error:
        raise MissionLogError(f'cannot be read: {error.strerror or error}') from error
    return log_account(log.name, content)


def _by_uav(account: Account, versions: Mapping[str, str]) -> dict[int, str]:
    """Versions of policies by the ids of the UAVs that they flew."""
    uavs = [] if account.header is None else account.header.uavs
    return {uav.id: versions[uav.policy] for uav in uavs if uav.policy in versions}


def _site_of(account: Account, folder: Path) -> Site:
    """The site of a log: by the scenario beside it, or a shipped one.

    Raises:
        ConfigError: there is none, or it is not valid.
    """
    header = account.header
    file = scenario_file(folder, '' if header is None else header.scenario_fingerprint)
    if file.is_file():
        return build_site(from_file(file))
    if header is None:
        raise ConfigError(account.header_error)
    if header.scenario not in scenario_names():
        raise ConfigError(f'scenario {header.scenario} is not here: give it with --scenario')
    return build_site(load(header.scenario))


def _with_name_checked(proof: Proof, account: Account) -> Proof:
    """The proof of a log, unless its name says another mission than its header."""
    match = re.fullmatch(r'mission_(\d+)(?:_(\d+))?\.jsonl', account.source)
    seed = account.header.mission_seed if account.header is not None else None
    if match is None or seed is None or int(match[1]) == seed:
        return proof
    finding = f'header: mission_seed is {seed}, the file is called {account.source}'
    return replace(proof, verdict=Verdict.DIFFERS, findings=(finding, *proof.findings))


class _BagProof:
    """A bag while its missions are proved."""

    def __init__(self, bag: Bag, policy_files: Sequence[Path]) -> None:
        self._bag, self._name = bag, bag.path.name
        self._reader = MissionReader(bag)
        self._policies = RecordedPolicies(policy_files, self._reader.policies)
        self._sites: dict[str, Site] = {}  # by text of the scenario

    def proofs(self, logs: dict[str, Path], scenario_files: Sequence[Path]) -> Iterator[Proof]:
        """Those of all missions, after what is damaged.

        Args:
            logs: of the run, by name; those of missions in the bag are taken out.
            scenario_files: of the run.
        """
        bag = self._bag
        damages = (*bag.damages, *self._reader.problems, *bag.remarks)
        if damages:
            yield Proof(mission=self._name, verdict=Verdict.DAMAGED, findings=damages)
        code_change = _code_change(self._origin())
        n_missions = n_damages = 0
        try:
            n_damages = len(bag.damages)
            for mission in self._reader.missions():
                if mission.start is not None:
                    n_missions += 1
                    yield self._proof(mission, logs, code_change, is_run=bool(scenario_files))
        except (BagError, *_DAMAGE) as error:
            if not damages:
                yield _unprovable(self._name, f'cannot be read further: {reason_of(error)}')
            return
        if late := tuple(bag.damages[n_damages:]):
            yield Proof(mission=self._name, verdict=Verdict.DAMAGED, findings=late)
        if not n_missions and not damages:
            yield _unprovable(self._name, 'holds no mission')
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
        account = bag_account(self._name, mission)
        seed = int(mission.start.seed) if account.header is None else account.header.mission_seed
        accounts, name = [account], f'{self._name}: mission {mission.mission_id}, seed {seed}'
        log = take_log(logs, seed, int(mission.start.index))
        if log is not None:
            try:
                accounts.append(_account_of(log))
            except MissionLogError as error:
                return _unprovable(name, f'{log.name} {error}')
        try:
            site = self._site(mission)
        except UavCollectError as error:
            return Proof(mission=name, verdict=Verdict.DIFFERS, findings=(str(error),))
        proof = prove(name, accounts, site, self._policies, code_change)
        if is_run and log is None:
            findings = (*proof.findings, f'the folder has no log of seed {seed}')
            proof = replace(proof, verdict=Verdict.DIFFERS, findings=findings)
        return replace(proof, lacks_checksums=not self._bag.has_checksums)

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
            self._sites[message.yaml] = recorded_site(message)
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
        texts = [message.yaml.encode() for message in sent]
        try:
            mine = files.read_bounded(file, MAX_BYTES)
        except OSError as error:
            yield _unprovable(file.name, f'cannot be read: {error.strerror or error}')
            return
        if not texts or mine in texts:
            return
        pairs = enumerate(zip_longest(mine.split(b'\n'), texts[0].split(b'\n')), start=1)
        number, here, there = next((n, *pair) for n, pair in pairs if pair[0] != pair[1])
        finding = f'line {number} is {_text(here)}, in the bag {_text(there)}'
        yield Proof(mission=file.name, verdict=Verdict.DAMAGED, findings=(finding,))

    def _origin(self) -> Mapping[str, str] | None:
        text = self._bag.custom_data.get(ORIGIN_KEY)
        return None if text is None else parsed_origin(text)


def _text(line: bytes | None) -> str:
    return 'missing' if line is None else repr(line.decode(errors='replace'))


def _code_change(then: Mapping[str, str] | None) -> str | None:
    if then is None:
        return 'the recording does not say which code wrote it'
    return changed_since(then)


def _unprovable(name: str, why: str) -> Proof:
    return Proof(mission=name, verdict=Verdict.UNPROVABLE, findings=(' '.join(why.split()),))

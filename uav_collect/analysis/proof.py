"""Proves recorded missions: each is flown again, and compared with its account byte for byte."""

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
import json
from typing import Any

import numpy as np
from uav_collect.analysis.message_proof import message_differences, NOT_RECORDED
from uav_collect.errors import (
    AllocationError,
    ConfigError,
    in_one_line,
    MissionLogError,
    PolicyMismatchError,
)
from uav_collect.limits import is_code_name, MAX_UAVS
from uav_collect.lockstep.published_policy import PolicyKey
from uav_collect.missions.recorded_policies import Crew, RecordedPolicies
from uav_collect.missions.reflight import fly_again, Reflight
from uav_collect.missions.simulation import FAILSAFE_VERSION
from uav_collect.recording.completeness import ENDED
from uav_collect.recording.epochs import faults_of, row_of
from uav_collect.recording.log_model import EVENT_DTYPE
from uav_collect.recording.mission_log import (
    fault_from,
    FaultRecord,
    header_from_line,
    header_line,
    MissionHeader,
    record_lines,
)
from uav_collect.recording.mission_messages import MissionMessages
from uav_collect.scenario.load import fingerprint
from uav_collect.scenario.site import Site
from uav_collect.uav.action_codes import ACTION_NAMES, FAILSAFE, HOME, REASON_NAMES
from uav_collect.uav.observation import AnyLayout, Layout
from uav_collect.uav.own_observation import layout_labelled

# What the world decided: no flight brings that forth, so it is taken from the account.
_BY_WORLD = (REASON_NAMES[FAILSAFE],)
_MISSING = 'missing'  # stands for the value of a field that is not there
_MOST_DIFFERENCES = 3  # of a mission that are named
_MOST_FINDINGS = 8  # in a line about it


class Verdict(Enum):
    """What came of proving a mission."""

    PROVED = 'proved'
    DIFFERS = 'differs'
    DAMAGED = 'damaged'  # not a mission, but what holds missions
    UNPROVABLE = 'cannot be proved'


@dataclass(frozen=True, kw_only=True)
class Proof:
    """A mission's verdict, and why."""

    mission: str  # what the recording calls it
    verdict: Verdict
    n_events: int = 0  # recorded
    n_failsafes: int = 0  # of them decided by the world, and taken as recorded
    n_injected: int = 0  # faults that were injected in flight, and are taken as recorded
    is_cut_off: bool = False  # before the mission's end
    lacks_checksums: bool = False  # only what its bag's messages say of the mission is proved
    findings: tuple[str, ...] = ()  # what differs, or what is missing; one line each

    def __str__(self) -> str:
        mission = in_one_line(self.mission)
        if self.verdict is Verdict.PROVED:
            return f'{mission}: {self.verdict.value}, {", ".join(self._facts())}'
        n_more = len(self.findings) - _MOST_FINDINGS
        more = [f'{n_more} more'] if n_more > 0 else []
        findings = [*map(in_one_line, self.findings[:_MOST_FINDINGS]), *more]
        return f'{mission}: {self.verdict.value}: {"; ".join(findings)}'

    def _facts(self) -> Iterator[str]:
        yield f'{self.n_events} events'
        for count, word in ((self.n_failsafes, 'failsafe'), (self.n_injected, 'injected fault')):
            if count:
                yield f'{count} {word}{"s" if count > 1 else ""} taken as recorded'
        if self.is_cut_off:
            yield 'cut off before its end'
        if self.lacks_checksums:
            yield 'but for what else is in the bag: it has no checksums'


@dataclass(frozen=True, kw_only=True)
class Account:
    """What one source, a log or a bag, holds of a mission."""

    source: str  # its name
    header: MissionHeader | None  # None: what stands in its place is none
    header_error: str  # why, if it is none
    header_line: str
    lines: Mapping[int, tuple[str, ...]]  # by event: of the log, that of the event itself last
    tail: str = ''  # what is there of the line after them
    is_over: bool  # its end was recorded
    messages: MissionMessages | None = None  # of a bag
    versions: Mapping[int, str] = field(default_factory=dict)  # of policies, by id of the UAV
    last_event: int = -1  # that it tells anything of
    policy_key: PolicyKey | None = None  # of the published policy that observations name
    flaws: tuple[str, ...] = ()  # what is wrong with it by itself

    @property
    def failsafes(self) -> set[int]:
        """Events that the world decided."""
        lines = self.lines.items()
        return {event for event, (*_, line) in lines if _value(line, 'reason') in _BY_WORLD}

    @property
    def faults(self) -> list[FaultRecord]:
        """The faults that have befallen UAVs."""
        lines = [line for _, (*before, _) in sorted(self.lines.items()) for line in before]
        return [fault for line in lines if (fault := _fault(line)) is not None]


def log_account(source: str, content: bytes) -> Account:
    """What a mission log holds, as far as it goes."""
    first, *rest = content.decode(errors='replace').split('\n')
    *whole, tail = rest or ['']
    lines: dict[int, tuple[str, ...]] = {}
    waiting: list[str] = []  # faults, before the event that is the first with them
    for line in whole:
        waiting.append(line)
        if _value(line, 'fault') is None:
            lines[len(lines)] = tuple(waiting)
            waiting.clear()
    homes = [line for *_, line in lines.values() if _value(line, 'action') == ACTION_NAMES[HOME]]
    header, header_error = _header(first)
    tail = ''.join([*(f'{line}\n' for line in waiting), tail])
    return Account(
        source=source,
        header=header,
        header_error=header_error,
        header_line=first,
        lines=lines,
        tail=tail,
        last_event=len(lines) - (not tail),
        is_over=header is not None and len(homes) == len(header.uavs),
    )


def bag_account(source: str, mission: MissionMessages) -> Account:
    """What a bag holds of a mission whose start or end is in it."""
    epochs = {place.number: sent[0] for place, sent in mission.placed.items() if not place.uav}
    versions: dict[int, dict[str, None]] = {}
    for _, epoch in sorted(epochs.items()):
        if epoch.policy_version not in ('', FAILSAFE_VERSION):
            versions.setdefault(int(epoch.uav), {})[epoch.policy_version] = None
    flaws = [
        f'UAV {uav} was flown by {", then ".join(names)}'
        for uav, names in sorted(versions.items())
        if len(names) > 1
    ]
    header, header_error = _header(mission.start.log_header)
    return Account(
        source=source,
        header=header,
        header_error=header_error,
        header_line=mission.start.log_header,
        lines={event: _lines(epoch) for event, epoch in sorted(epochs.items())},
        is_over=ENDED in mission.phases,
        messages=mission,
        last_event=max([*epochs, *_asked(mission)], default=-1),
        versions={uav: next(iter(names)) for uav, names in versions.items()},
        policy_key=_policy_key(mission),
        flaws=tuple(flaws),
    )


def prove(
    name: str,
    accounts: Sequence[Account],
    site: Site,
    policies: RecordedPolicies,
    code_change: str | None,
) -> Proof:
    """Fly a mission again and hold all that is recorded of it against that.

    Args:
        accounts: of the same mission, at least one; by the first one it is flown.
        code_change: how the present code differs from that of the recording, if it does.
    """
    first = accounts[0]
    failsafes = {event for account in accounts for event in account.failsafes}
    faults = {fault for account in accounts for fault in account.faults}
    proof = Proof(
        mission=name,
        verdict=Verdict.PROVED,
        n_events=max(len(account.lines) for account in accounts),
        n_failsafes=len(failsafes),
        is_cut_off=not any(account.is_over for account in accounts),
    )
    if (wrong := _header_problem(first, site)) is not None or first.header is None:
        return replace(proof, verdict=Verdict.DIFFERS, findings=(f'header: {wrong}',))
    try:
        crew = policies.crew(first.header, site, first.versions, first.policy_key)
        flown = fly_again(
            *(site, first.header, crew.members),
            failsafes=failsafes,
            layouts=_layouts(first),
            n_events=_n_needed(accounts),
            faults=sorted(faults, key=lambda it: (it.event, it.time_s, it.uav, it.fault)),
        )
    except (AllocationError, ConfigError, PolicyMismatchError) as error:
        clashes = tuple(_clashes(accounts))
        verdict = Verdict.DIFFERS if clashes else Verdict.UNPROVABLE
        return replace(proof, verdict=verdict, findings=(*clashes, ' '.join(str(error).split())))
    proof = replace(proof, n_injected=len(flown.injected))
    findings = _findings(accounts, flown, crew, code_change)
    return replace(proof, verdict=Verdict.DIFFERS, findings=findings) if findings else proof


def _findings(
    accounts: Sequence[Account], flown: Reflight, crew: Crew, code_change: str | None
) -> tuple[str, ...]:
    """What differs, and why; nothing if nothing does."""
    ignored = {'policy_version'} if crew.changes else set()
    is_over = any(account.is_over for account in accounts)
    by_account = [tuple(_differences(each, flown, ignored, is_over)) for each in accounts]
    differences = [
        f'{account.source}: {text}' if len(accounts) > 1 else text
        for account, texts in zip(accounts, by_account, strict=True)
        for text in texts
    ]
    if not differences:
        return ('flown to the same bytes', *crew.changes) if crew.changes else ()
    n_more = len(differences) - _MOST_DIFFERENCES
    more = [f'{n_more} more differences'] if n_more > 0 else []
    causes = _causes(crew, code_change, by_account)
    return (*differences[:_MOST_DIFFERENCES], *more, *causes)


def _n_needed(accounts: Sequence[Account]) -> int | None:
    """How many events to fly; None: to the end. The last one that is told of must be closed."""
    if any(account.is_over for account in accounts):
        return None
    return max(account.last_event for account in accounts) + 2


def _causes(
    crew: Crew, code_change: str | None, by_account: Sequence[Sequence[str]]
) -> Sequence[str]:
    """What is no longer as it was when the mission was recorded, if that explains differences."""
    if all(text.endswith(NOT_RECORDED) for texts in by_account for text in texts):
        return []
    causes = [*crew.changes, *([f'other code: {code_change}'] if code_change else [])]
    if causes and all(by_account):
        return causes
    # Another account of the mission is as flown, or all that flies it is as it was.
    return ['the recording itself was changed']


def _header_problem(account: Account, site: Site) -> str | None:
    """Why the header of an account cannot be flown over a site; None if it can."""
    header = account.header
    if header is None:
        return account.header_error
    scenario = site.scenario
    here = scenario.name, fingerprint(scenario)
    then = header.scenario, header.scenario_fingerprint
    if here != then:
        return (
            f'scenario {then[0]} with fingerprint {then[1]}, but the scenario at hand is'
            f' {here[0]} with {here[1]}'
        )
    n_uavs = len(header.uavs)
    return None if n_uavs == scenario.n_uavs else f'{n_uavs} UAVs: must be {scenario.n_uavs}'


def _differences(
    account: Account, flown: Reflight, ignored: Container[str], is_over: bool
) -> Iterator[str]:
    """What an account has otherwise than the flight, events first.

    Args:
        is_over: the mission's end was recorded: then a log has it, for worlds write it; a recorder
            may have ended before.
    """
    must_be_whole = account.is_over or (is_over and account.messages is None)
    yield from _line_differences(account, flown, must_be_whole)
    yield from account.flaws
    if account.messages is not None:
        n_events = max(account.lines, default=-1) + 1
        yield from message_differences(account.messages, flown, n_events, ignored)


def _line_differences(account: Account, flown: Reflight, must_be_whole: bool) -> Iterator[str]:
    """How an account's lines differ from those of the flight, up to the first event that does."""
    line = header_line(flown.log.header)
    if account.header_line != line:
        yield f'header: {line_difference(account.header_line, line)}'
    n_flown = len(flown.log.events)
    for event, recorded in account.lines.items():
        if event >= n_flown:
            yield flown.failure or f'event {event}: the mission was over'
            return
        if recorded != (lines := flown.lines(event)):
            yield f'event {event}: {_lines_difference(recorded, lines)}'
            return
    n_recorded = max(account.lines, default=-1) + 1
    following = '' if n_recorded >= n_flown else '\n'.join(flown.lines(n_recorded))
    if not following.startswith(account.tail):
        yield f'event {n_recorded}: {line_difference(account.tail, following)}'
    elif must_be_whole and following:
        yield f'event {n_recorded}: not recorded, flown {n_flown} events'


def _lines_difference(recorded: Sequence[str], flown: Sequence[str]) -> str:
    """The first difference of the lines about one event."""
    if len(recorded) == len(flown):
        pairs = zip(recorded, flown, strict=True)
        return next(line_difference(mine, again) for mine, again in pairs if mine != again)
    return f'{len(recorded) - 1} faults are recorded, flown {len(flown) - 1}'


def line_difference(recorded: str, flown: str) -> str:
    """In which field two lines of mission logs differ, and both values."""
    try:
        mine, again = json.loads(recorded), json.loads(flown)
        if isinstance(mine, dict):
            found = _first_difference('', mine, again)
            return found or 'same values, different formatting'
    except (ValueError, RecursionError):
        pass
    return f'is no line of a mission log: {recorded[:60]!r}'


def _first_difference(path: str, recorded: Any, flown: Any) -> str | None:  # noqa: ANN401 - JSON
    if isinstance(recorded, dict) and isinstance(flown, dict):
        names = [*flown, *(name for name in recorded if name not in flown)]
        pairs = [
            (f'{path}{name}', recorded.get(name, _MISSING), flown.get(name, _MISSING))
            for name in names
        ]
    elif isinstance(recorded, list) and isinstance(flown, list) and len(recorded) == len(flown):
        pairs = [(f'{path}{i}', *pair) for i, pair in enumerate(zip(recorded, flown, strict=True))]
    elif json.dumps(recorded) == json.dumps(flown):
        return None
    else:
        return f'{path.removesuffix(".")} is {recorded}, flown {flown}'
    found = (_first_difference(f'{name}.', mine, again) for name, mine, again in pairs)
    return next(filter(None, found), None)


def _clashes(accounts: Sequence[Account]) -> Iterator[str]:
    """Where accounts of the same mission contradict each other."""
    first, *others = accounts
    for other in others:
        headers = ('header', (first.header_line,), (other.header_line,))
        pairs: list[tuple[str, tuple[str, ...], tuple[str, ...]]] = [headers]
        pairs += [
            (f'event {event}', lines, other.lines[event])
            for event, lines in first.lines.items()
            if event in other.lines
        ]
        for what, mine, its in pairs:
            if mine != its:
                yield f'{what}: {first.source} and {other.source}: {_lines_difference(mine, its)}'
                break


def _layouts(account: Account) -> list[AnyLayout]:
    """The layouts in which the transitions of an account show what agents saw."""
    if account.messages is None:
        return []
    placed = account.messages.placed.items()
    labels = {sent[0].layout for place, sent in placed if place.kind == 'transition'}
    own = [layout_labelled(label) for label in sorted(labels) if is_code_name(label)]
    return [*(layout for layout in Layout if layout.label in labels), *own]


def _asked(mission: MissionMessages) -> Iterator[int]:
    """The events at which UAVs were asked to decide."""
    for place, sent in mission.placed.items():
        if place.kind == 'observation':
            yield int(sent[0].event)


def _policy_key(mission: MissionMessages) -> PolicyKey | None:
    """The published policy that the first observation names; None without any."""
    for place, sent in mission.placed.items():
        if place.kind == 'observation' and sent[0].policy_trainer:
            return sent[0].policy_trainer, int(sent[0].policy_sequence)
    return None


def _header(line: str) -> tuple[MissionHeader | None, str]:
    """The header that a line tells; or None, and why it tells none."""
    try:
        return header_from_line(line), ''
    except MissionLogError as error:
        return None, str(error)


def _lines(epoch: Any) -> tuple[str, ...]:  # noqa: ANN401 - a message
    """The lines of the mission log that an Epoch message stands for."""
    try:
        event = np.array([row_of(epoch)], dtype=EVENT_DTYPE)
        return tuple(record_lines(event, faults_of([epoch])))
    except (IndexError, OverflowError, ValueError) as error:  # a code that there is not, say
        return (f'{type(error).__name__}: {error}',)


def _fault(line: str) -> FaultRecord | None:
    """The fault that a line of a mission log tells of; None if it tells of none."""
    if _value(line, 'fault') is None:
        return None
    try:
        return fault_from(json.loads(line), MAX_UAVS)
    except ValueError:
        return None


def _value(line: str, name: str) -> object:
    """A field of a line of a mission log; None where it is no such line."""
    try:
        fields = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return fields.get(name) if isinstance(fields, dict) else None

"""Which recorders a mission waits for before it takes off, and for how long."""

from collections import OrderedDict
from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple

SILENT_S = 5.0  # a recorder says each other second how it is: one that is silent so long is gone
_MOST_RECORDERS = 64  # kept in mind
_MOST_TOPICS = 3  # named of one recorder


def world_key(instance: str, scenario_fingerprint: str) -> str:
    """Names a world with the scenario that it has: with another one, its fleet may be larger."""
    return f'{instance} {scenario_fingerprint}'


@dataclass(frozen=True, kw_only=True)
class RecorderReport:
    """What a recorder says of itself."""

    recorder: str  # UUID of its process
    bag: str
    worlds: frozenset[str]  # those whose scenario it has, see `world_key`
    waits_for: frozenset[str]  # topics that it hears nobody on


class TakeOff(NamedTuple):
    """Whether a mission may take off now, and what was not ready for it."""

    is_clear: bool
    unready: tuple[str, ...]  # in words; with `is_clear`, what it starts without


@dataclass
class _Recorder:
    report: RecorderReport
    heard_s: float
    is_given_up: bool = False  # a mission has waited for it in vain


class RecorderWatch:
    """The recorders that a world has heard of."""

    def __init__(self, world: str, *, n_expected: int, timeout_s: float) -> None:
        """Wait for all that are heard of, and for so many in any case.

        Args:
            world: the one that waits, see `world_key`.
            n_expected: recorders that the first mission waits for, heard of or not.
            timeout_s: how long a mission waits at most.
        """
        self.world = world
        self._n_expected = n_expected
        self._timeout_s = timeout_s
        self._recorders: OrderedDict[str, _Recorder] = OrderedDict()  # the latest heard last
        self._since_s: float | None = None  # when the mission could have started

    def add(self, report: RecorderReport, now_s: float) -> None:
        """Note what a recorder says."""
        known = self._recorders.pop(report.recorder, None)
        is_given_up = known is not None and known.is_given_up
        self._recorders[report.recorder] = _Recorder(report, now_s, is_given_up)
        if len(self._recorders) > _MOST_RECORDERS:
            self._recorders.popitem(last=False)

    def take_off(self, now_s: float, awaited: Collection[str]) -> TakeOff:
        """Whether a mission, ready otherwise, may take off: asked again until it may.

        Args:
            now_s: monotonic time.
            awaited: topics of the world and of those UAVs that have an agent.
        """
        if self._since_s is None:
            self._since_s = now_s
        unready = self._unready(now_s, frozenset(awaited))
        if unready and now_s - self._since_s <= self._timeout_s:
            return TakeOff(is_clear=False, unready=unready)
        self._since_s = None
        self._give_up(now_s, frozenset(awaited))
        return TakeOff(is_clear=True, unready=unready)

    def rest(self) -> None:
        """No mission is ready to take off: the next one waits its whole time."""
        self._since_s = None

    def _unready(self, now_s: float, awaited: frozenset[str]) -> tuple[str, ...]:
        waiting = [
            f'the recorder of {each.report.bag}, which does not hear {lacks}'
            for each in self._recorders.values()
            if (lacks := self._lacks(each, awaited))
            and not each.is_given_up
            and now_s - each.heard_s <= SILENT_S
        ]
        n_absent = self._n_expected - self._n_ready(now_s, awaited) - len(waiting)
        if n_absent == 1:
            waiting.append('a recorder that is not there yet')
        elif n_absent > 1:
            waiting.append(f'{n_absent} recorders that are not there yet')
        return tuple(waiting)

    def _lacks(self, recorder: _Recorder, awaited: frozenset[str]) -> str:
        """What a recorder does not hear of this world, in words; empty: it hears all."""
        if self.world not in recorder.report.worlds:
            return 'this world'
        topics = sorted(recorder.report.waits_for & awaited)
        more = f' and {len(topics) - _MOST_TOPICS} more' if len(topics) > _MOST_TOPICS else ''
        return ', '.join(topics[:_MOST_TOPICS]) + more

    def _n_ready(self, now_s: float, awaited: frozenset[str]) -> int:
        return sum(
            now_s - each.heard_s <= SILENT_S and not self._lacks(each, awaited)
            for each in self._recorders.values()
        )

    def _give_up(self, now_s: float, awaited: frozenset[str]) -> None:
        """Let no later mission wait for those that were not ready for this one."""
        for each in self._recorders.values():
            each.is_given_up = bool(self._lacks(each, awaited))
        self._n_expected = min(self._n_expected, self._n_ready(now_s, awaited))

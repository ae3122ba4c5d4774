"""Flies two UAVs by the best joint policy of those that do not know the demand."""

from dataclasses import dataclass, field

from uav_collect.kernels.arrays import Row
from uav_collect.planning.pair_search import N_UAVS, PairSearch, PairTurn
from uav_collect.uav.action_codes import FORWARD, HOME, HOVER
from uav_collect.uav.actions import neighbour
from uav_collect.uav.belief import Belief
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.view import LocalView, VIEW_CELLS


@dataclass
class PairMemory:
    """What two UAVs know in a mission, and what they do."""

    place: list[int]  # where each UAV's action ends
    end_ns: list[int] = field(default_factory=lambda: [0] * N_UAVS)  # when it does
    has_left: list[bool] = field(default_factory=lambda: [False] * N_UAVS)  # for home
    seen: int = 0
    waiting: int = 0
    n_found: int = 0


@dataclass
class BestPairPolicy:
    """One of two UAVs of a mission; both know what any of them sees.

    They begin a mission one after the other, the first of them first.
    """

    search: PairSearch
    memories: list[PairMemory]  # of all missions so far, the same list for both UAVs
    name: str = 'best pair of unknown demand'
    version: str = 'exact'
    _uav: int = field(default=0, init=False)
    _memory: PairMemory = field(init=False)

    def begin(self, briefing: Briefing, uav: int) -> None:
        """Get ready for another mission."""
        if uav == 0:
            self.memories.append(PairMemory(self.search.start_places()))
        self._uav, self._memory = uav, self.memories[-1]

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        """The best of the legal actions."""
        self._look(view)
        action = self._best()
        self._start(action)
        return action

    def _look(self, view: LocalView) -> None:
        memory = self._memory
        for index in range(VIEW_CELLS):
            row_step, column_step = index // 3 - 1, index % 3 - 1
            cell = neighbour(self.search.briefing, view.cell, row_step, column_step)
            if cell >= 0 and not memory.seen >> cell & 1:
                memory.seen |= 1 << cell
                if view.region_bit[index] > 0.0:
                    memory.waiting |= 1 << cell
                    memory.n_found += 1

    def _best(self) -> int:
        memory, uav, other = self._memory, self._uav, 1 - self._uav
        if memory.seen == self.search.every and memory.waiting == 0:
            return HOME
        known = self.search.known(memory.seen, memory.waiting, memory.n_found)
        # Whose action ends first where both end at once is left to rounding in the world.
        other_ns = max(memory.end_ns[other] - memory.end_ns[uav], 0)
        if memory.has_left[other]:
            return self.search.best_action_alone(known, uav, other_ns, memory.place[uav])
        turn = PairTurn(uav, other_ns)
        return self.search.best_action(known, turn, memory.place[uav], memory.place[other])

    def _start(self, action: int) -> None:
        memory, uav, places = self._memory, self._uav, self.search.places
        cell = int(places.cell[memory.place[uav]])
        if action == HOME:
            memory.has_left[uav] = True
            memory.end_ns[uav] += int(self.search.home_ns[uav][cell])
        elif action == HOVER:
            memory.waiting &= ~(1 << cell)
            memory.place[uav] = places.index[cell, 0]
            memory.end_ns[uav] += self.search.hover_ns
        else:
            memory.place[uav] = int(places.after[action - FORWARD, memory.place[uav]])
            memory.end_ns[uav] += self.search.move_ns[uav]

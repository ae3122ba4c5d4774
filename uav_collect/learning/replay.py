"""The replay buffer: whole missions, their decisions as compact records in one ring."""

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from uav_collect.kernels.arrays import Floats
from uav_collect.missions.experience import Episode, new_records, record_bytes, Records
from uav_collect.uav.briefing import Briefing


class Replay:
    """The missions recorded last, as many as there is room for."""

    def __init__(self, capacity: int, briefing: Briefing) -> None:
        """Reserve the memory.

        Args:
            capacity: decisions that there is room for; `replay_bytes` tells what they need.
        """
        self._capacity = capacity
        self.n_bytes = replay_bytes(capacity, briefing)
        self._records = new_records(capacity, briefing)
        self._missions: deque[_Mission] = deque()
        self._next = 0

    @property
    def n_decisions(self) -> int:
        """How many decisions it holds."""
        return sum(mission.n_decisions for mission in self._missions)

    @property
    def n_missions(self) -> int:
        """How many missions it holds."""
        return len(self._missions)

    def add(self, episode: Episode) -> None:
        """Keep a mission; the oldest ones make room.

        Raises:
            ValueError: it has more decisions than there is room for.
        """
        size = episode.n_decisions
        if size > self._capacity:
            raise ValueError(
                f'a mission of {size} decisions; the replay has room for {self._capacity}'
            )
        if self._next + size > self._capacity:
            self._drop(self._next, self._capacity)
            self._next = 0
        self._drop(self._next, self._next + size)
        rows = slice(self._next, self._next + size)
        for kept, new in zip(self._records, episode.records, strict=True):
            kept[rows] = new
        self._missions.append(
            _Mission(self._next, size, episode.mission_seed, episode.demand_bit, episode.is_whole)
        )
        self._next += size

    def sample(self, n_missions: int, rng: np.random.Generator) -> list[Episode]:
        """Missions drawn at random, each with the same chance, one perhaps twice."""
        drawn = rng.integers(len(self._missions), size=n_missions)
        return [self._episode(self._missions[index]) for index in drawn.tolist()]

    def state(self) -> dict[str, NDArray[Any]]:
        """What it holds, as arrays; the inverse is `restore`."""
        missions = self._missions
        held = np.concatenate(
            [np.arange(it.first, it.first + it.n_decisions) for it in missions]
            or [np.zeros(0, dtype=np.int64)]
        )
        tables = {name: getattr(self._records, name)[held] for name in Records._fields}
        return tables | {
            'first': np.array([it.first for it in missions], dtype=np.int64),
            'n_decisions': np.array([it.n_decisions for it in missions], dtype=np.int64),
            'mission_seed': np.array([it.mission_seed for it in missions], dtype=np.int64),
            'is_whole': np.array([it.is_whole for it in missions], dtype=bool),
            'demand_bit': np.array([it.demand_bit for it in missions]),
            'next': np.array(self._next),
        }

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Hold what another one of the same size held."""
        columns = ('first', 'n_decisions', 'mission_seed', 'demand_bit', 'is_whole')
        rows = zip(*(state[name] for name in columns), strict=True)
        self._missions = deque(
            _Mission(int(first), int(size), int(seed), demand_bit, bool(is_whole))
            for first, size, seed, demand_bit, is_whole in rows
        )
        self._next = int(state['next'])
        start = 0
        for mission in self._missions:
            for name in Records._fields:
                held = state[name][start : start + mission.n_decisions]
                getattr(self._records, name)[mission.rows] = held
            start += mission.n_decisions

    def _drop(self, start: int, stop: int) -> None:
        """Forget the missions that have rows in a range; they are the oldest ones."""
        while self._missions and start <= self._missions[0].first < stop:
            self._missions.popleft()

    def _episode(self, mission: '_Mission') -> Episode:
        tables: list[Any] = [table[mission.rows] for table in self._records]
        return Episode(
            mission_seed=mission.mission_seed,
            demand_bit=mission.demand_bit,
            records=Records(*tables),
            is_whole=mission.is_whole,
        )


@dataclass(frozen=True, slots=True)
class _Mission:
    """Where the rows of a mission lie in the ring."""

    first: int
    n_decisions: int
    mission_seed: int
    demand_bit: Floats  # (C,)
    is_whole: bool

    @property
    def rows(self) -> slice:
        return slice(self.first, self.first + self.n_decisions)


def replay_bytes(capacity: int, briefing: Briefing) -> int:
    """Memory that a replay of so many decisions takes."""
    return capacity * record_bytes(briefing)

"""The replay buffer: whole missions, their decisions as compact records in one ring."""

from collections import deque
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from uav_collect.kernels.arrays import Floats, Ints
from uav_collect.learning.excerpts import draw_excerpts, Excerpt
from uav_collect.learning.packing import packed, unpacked
from uav_collect.learning.saved import SavedPart
from uav_collect.missions.experience import (
    Episode,
    new_records,
    record_bytes,
    Records,
    sparse_observations,
    SparseRows,
)
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.observation import AnyLayout


class Replay:
    """The missions recorded last, as many as there is room for."""

    def __init__(
        self,
        capacity: int,
        briefing: Briefing,
        layout: AnyLayout,
        most_observation_bytes: int = 0,
    ) -> None:
        """Reserve the memory.

        Args:
            capacity: decisions that there is room for; `replay_bytes` tells what they need.
            layout: of the observations that are learned from.
            most_observation_bytes: for observations that are kept once they were asked for; the
                others are rebuilt each time.
        """
        self._capacity, self._briefing, self._layout = capacity, briefing, layout
        self._most_observation_bytes = most_observation_bytes
        self._observations: dict[int, SparseRows] = {}  # by the first row of their mission
        self._n_observation_bytes = 0
        self._records = new_records(capacity, briefing)
        self._missions: deque[_Mission] = deque()
        self._sizes: Ints | None = None  # of the missions; None: to be looked up again
        self._next = 0

    @property
    def n_decisions(self) -> int:
        """How many decisions it holds."""
        return sum(mission.n_decisions for mission in self._missions)

    @property
    def n_bytes(self) -> int:
        """Memory that is reserved, and what observations take now."""
        return replay_bytes(self._capacity, self._briefing) + self._n_observation_bytes

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
        self._append(episode)

    def sample(
        self, n_missions: int, rng: np.random.Generator, n_decisions: int = 0
    ) -> list[Episode]:
        """Missions drawn at random, each with the same chance, one perhaps twice.

        Their observations are at hand.

        Args:
            n_missions: how many.
            rng: which ones.
            n_decisions: no further mission is taken once they have so many; 0: all are.
        """
        drawn = rng.integers(len(self._missions), size=n_missions).tolist()
        if n_decisions > 0:
            sizes = np.cumsum([self._missions[index].n_decisions for index in drawn])
            drawn = drawn[: int(np.searchsorted(sizes, n_decisions)) + 1]
        return [self._observed(self._missions[index]) for index in drawn]

    def sample_excerpts(
        self, n_excerpts: int, n_decisions: int, rng: np.random.Generator
    ) -> list[Excerpt]:
        """Excerpts drawn at random, each decision in one with the same chance.

        Args:
            n_excerpts: how many; one may be drawn twice.
            n_decisions: of each; fewer at the beginning and the end of a mission.
            rng: which ones.
        """
        if self._sizes is None:
            self._sizes = np.array([it.n_decisions for it in self._missions], dtype=np.int64)
        return [
            Excerpt(episode=self._episode(self._missions[index]), start=start, stop=stop)
            for index, start, stop in draw_excerpts(n_excerpts, n_decisions, self._sizes, rng)
        ]

    def state(self) -> dict[str, NDArray[Any]] | None:
        """What it holds, as arrays; None where it is empty; the inverse is `restore`."""
        if not self._missions:
            return None
        first = np.array([it.first for it in self._missions], dtype=np.int64)
        return packed([*map(self._episode, self._missions)]) | {'first': first}

    def restore(self, saved: SavedPart | None) -> None:
        """Hold what another one of the same size held.

        Raises:
            CheckpointError: what it says that it held cannot be held.
        """
        self._missions, self._sizes = deque(), None
        self._observations, self._n_observation_bytes = {}, 0
        self._next = 0
        if saved is None:
            return
        episodes = unpacked(saved, self._briefing)
        first = saved.array('first', np.int64, [len(episodes)])
        sizes = np.array([it.n_decisions for it in episodes], dtype=np.int64)
        if not _lie_in_ring(first, sizes, self._capacity):
            raise saved.refusal('first', 'does not place the missions in the order of a ring')
        for start, episode in zip(first.tolist(), episodes, strict=True):
            self._next = start
            self._append(episode)

    def _append(self, episode: Episode) -> None:
        """Write a mission from the next row on."""
        size = episode.n_decisions
        rows = slice(self._next, self._next + size)
        for kept, new in zip(self._records, episode.records, strict=True):
            kept[rows] = new
        self._missions.append(
            _Mission(self._next, size, episode.mission_seed, episode.demand_bit, episode.is_whole)
        )
        self._next += size
        self._sizes = None

    def _drop(self, start: int, stop: int) -> None:
        """Forget the missions that have rows in a range; they are the oldest ones."""
        while self._missions and start <= self._missions[0].first < stop:
            dropped = self._observations.pop(self._missions.popleft().first, None)
            if dropped is not None:
                self._n_observation_bytes -= dropped.n_bytes

    def _observed(self, mission: '_Mission') -> Episode:
        """A mission with its observations, which are kept if there is room."""
        episode = self._episode(mission)
        rows = self._observations.get(mission.first)
        if rows is None:
            rows = sparse_observations(episode, self._layout, self._briefing)
            if self._n_observation_bytes + rows.n_bytes <= self._most_observation_bytes:
                self._observations[mission.first] = rows
                self._n_observation_bytes += rows.n_bytes
        return replace(episode, observation=rows)

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
    """Memory that a replay of so many decisions takes, observations that it keeps left out."""
    return capacity * record_bytes(briefing)


def _lie_in_ring(first: Ints, sizes: Ints, capacity: int) -> bool:
    """Whether missions, the oldest first, lie beside each other and begin again but once."""
    place = np.argsort(first, kind='stable')
    ends = first + sizes
    is_apart = bool((ends[place][:-1] <= first[place][1:]).all())
    is_within = bool((first >= 0).all() and (ends <= capacity).all())
    n_turns = int((np.diff(first) < 0).sum())
    is_in_order = n_turns == 0 or (n_turns == 1 and first[-1] < first[0])
    return is_apart and is_within and is_in_order

"""Short excerpts of missions, which an update may learn from in place of whole missions.

An excerpt is a stretch of one mission's decisions. The network is run for these, for what they are
compared with, and for a few decisions of each UAV before (burn-in), from a hidden state of zero:
states that were stored would be those of a network as it was up to a million updates ago.
Where the burn-in reaches the beginning of the mission, hidden states are exact.

Source: Hausknecht and Stone, Deep recurrent Q-learning for partially observable MDPs, 2015
(random stretches from a hidden state of zero); Kapturowski et al., Recurrent experience replay in
distributed reinforcement learning, 2019 (burn-in).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from uav_collect.kernels.arrays import Bools, Ints
from uav_collect.missions.experience import Episode


@dataclass(frozen=True, kw_only=True)
class Excerpt:
    """Decisions of a mission that are learned from: start, start + 1, ..., stop - 1."""

    episode: Episode
    start: int
    stop: int


def draw_excerpts(
    n_excerpts: int, n_decisions: int, mission_sizes: Ints, rng: np.random.Generator
) -> list[tuple[int, int, int]]:
    """Draw excerpts so that each decision of each mission is in one with the same chance.

    An excerpt may begin before its mission or end after it; there it has no decisions.

    Args:
        n_excerpts: how many.
        n_decisions: of an excerpt that lies within its mission.
        mission_sizes: decisions of each mission, shape (M,).
        rng: which ones.

    Returns:
        Mission, first decision, and the one after the last, of each excerpt.
    """
    n_places = mission_sizes + n_decisions - 1
    ends = np.cumsum(n_places)
    drawn = rng.integers(ends[-1], size=n_excerpts)
    mission = np.searchsorted(ends, drawn, side='right')
    first = drawn - (ends - n_places)[mission] - (n_decisions - 1)
    start, stop = np.maximum(first, 0), np.minimum(first + n_decisions, mission_sizes[mission])
    return list(zip(mission.tolist(), start.tolist(), stop.tolist(), strict=True))


def is_learned_from(excerpts: Sequence[Excerpt]) -> Bools:
    """Whether each decision of their missions, one behind the other, lies in its excerpt."""
    within = []
    for excerpt in excerpts:
        index = np.arange(excerpt.episode.n_decisions)
        within.append((index >= excerpt.start) & (index < excerpt.stop))
    return np.concatenate(within)


def is_run(sequence: Ints, decision: Ints, asked: Ints, n_burn_in: int) -> Bools:
    """Whether the network has to be run for each decision: for what is asked for, and before.

    Args:
        sequence: a number for each UAV of each excerpt, shape (E,).
        decision: running number among those of the sequence, shape (E,).
        asked: decisions whose values are needed, as indices.
        n_burn_in: how many of a sequence it is run for before the first of these.
    """
    n_sequences = int(sequence.max()) + 1
    first = np.full(n_sequences, np.iinfo(np.int64).max)
    last = np.full(n_sequences, -1)
    np.minimum.at(first, sequence[asked], decision[asked])
    np.maximum.at(last, sequence[asked], decision[asked])
    needed: Bools = (decision >= first[sequence] - n_burn_in) & (decision <= last[sequence])
    return needed

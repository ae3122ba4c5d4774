"""Missions made ready for an update: observations packed by UAV, and who follows whom.

Rows of observations lie step by step, as `network.Drqn` reads them: each UAV's decisions of a
mission are one sequence, and nothing is computed for a UAV while another one decides.
An entry is what the loss has one term for; which decisions those are depends on the algorithm.
- AQMIX: every decision. The next entry is the mission's next decision, and only the UAV that
  decides there maximises again.
- QMIX: every instant at which UAVs decide. At the next one all that decide maximise.
- AIQL: every decision. The next entry is the same UAV's next decision.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from uav_collect.kernels.arrays import Bools, Floats, Ints, Row
from uav_collect.kernels.compile import kernel
from uav_collect.learning.excerpts import Excerpt, is_learned_from, is_run
from uav_collect.missions.experience import (
    Episode,
    N_UAV_SCALARS,
    observations,
    Records,
    sparse_observations,
    sparse_rows,
    SparseRows,
)
from uav_collect.uav.action_codes import N_ACTIONS
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.frames import COMPASS_ACTIONS, FRAME_ACTIONS
from uav_collect.uav.observation import advice_columns, AnyLayout, frames, observation_size

NO_DECISION = -1  # no decision


class Algorithm(StrEnum):
    """How the team's reward is shared out among the UAVs' networks."""

    AQMIX = 'aqmix'
    QMIX = 'qmix'
    AIQL = 'aiql'
    BRANCHES = 'branches'  # not at all: each learns what `missions.branches` says of its actions
    IMITATION = 'imitation'  # nor here: each learns what its course's teacher would do

    @property
    def mixes(self) -> bool:
        """Whether there is a mixer."""
        return self in (Algorithm.AQMIX, Algorithm.QMIX)


@dataclass(frozen=True, kw_only=True)
class Minibatch:
    """E decisions of several missions, in order, R = E rows, and L entries."""

    sparse: SparseRows  # (R, ...), packed
    observation_size: int
    step_sizes: list[int]  # rows of each step
    legal: Bools  # (R, N_ACTIONS), packed; actions are those in the frames of the UAVs
    advice: NDArray[np.float32]  # (R, N_ACTIONS), packed, one-hot; zeros where there is none
    worth: NDArray[np.float32]  # (R, N_ACTIONS), packed, by branches or a teacher; nan: by none
    row: Ints  # (E,) packed row of each decision
    action: Ints  # (E,)
    latest: Ints  # (E, U) the latest decision of each UAV, or NO_DECISION
    decides: Bools  # (E, U) whose action is chosen at the instant of the entry
    fleet: NDArray[np.float32]  # (E, U * N_UAV_SCALARS)
    complete: NDArray[np.uint8]  # (E, U + 1, C) the maps of all UAVs and the true one
    area: tuple[int, int]  # rows and columns
    entry: Ints  # (L,) decisions that are entries; chains lie in order
    next_entry: Ints  # (L,) the decision that follows, or NO_DECISION at the end
    is_chained: Bools  # (L,) whether what follows is the next of the entries
    reward: Floats  # (L,) until then, discounted to the entry
    discount: Floats  # (L,) of what follows

    @property
    def observation(self) -> NDArray[np.float32]:
        """All numbers of the observations, packed, made anew, shape (R, observation_size)."""
        return _dense(self.sparse, range(self.observation_size))


def make_minibatch(
    episodes: Sequence[Episode],
    briefing: Briefing,
    layout: AnyLayout,
    algorithm: Algorithm,
    discount_per_s: float,
) -> Minibatch:
    """Make missions ready for an update.

    Args:
        episodes: at least one; synchronous missions for QMIX.
    """
    decisions = _decisions(episodes, briefing, algorithm)
    entries = _entries(episodes, decisions, algorithm, discount_per_s)
    row, step_sizes = _packing(decisions.records, decisions.mission, briefing.n_uavs)
    rows = [it.observation or sparse_observations(it, layout, briefing) for it in episodes]
    sparse = _packed_rows(rows, row)
    return _minibatch(decisions, entries, (row, step_sizes, sparse), briefing, layout)


def make_excerpt_minibatch(
    excerpts: Sequence[Excerpt],
    n_burn_in: int,
    briefing: Briefing,
    layout: AnyLayout,
    algorithm: Algorithm,
    discount_per_s: float,
) -> Minibatch:
    """Make excerpts of missions ready for an update: their entries, and what these need.

    Rewards and what follows an entry are those of the whole mission.

    Args:
        excerpts: at least one; of synchronous missions for QMIX.
        n_burn_in: decisions of each UAV for which the network is run before the first that counts.
    """
    episodes = [excerpt.episode for excerpt in excerpts]
    decisions = _decisions(episodes, briefing, algorithm)
    entries = _entries(episodes, decisions, algorithm, discount_per_s)
    is_within = is_learned_from(excerpts)[entries.entry]
    within: list[Any] = [it[is_within] for it in entries]
    decisions, entries = _needed(decisions, _Entries(*within), algorithm, n_burn_in)
    row, step_sizes = _packing(decisions.records, decisions.mission, briefing.n_uavs)
    size = observation_size(layout, len(briefing.is_open), briefing.n_uavs)
    dense = np.empty((len(row), size), dtype=np.float32)
    demand_bit = np.stack([it.demand_bit for it in episodes])
    observations(layout, briefing, decisions.records, demand_bit, decisions.mission, row, dense)
    return _minibatch(decisions, entries, (row, step_sizes, sparse_rows(dense)), briefing, layout)


class _Decisions(NamedTuple):
    """Decisions of several missions, in order."""

    records: Records
    mission: Ints  # (E,)
    latest: Ints  # (E, U) see `Minibatch`
    decides: Bools  # (E, U)
    instant: Ints  # (E,) see `_instants`


class _Entries(NamedTuple):
    """What the loss has a term for each of, see `Minibatch`."""

    entry: Ints  # (L,)
    next_entry: Ints
    reward: Floats
    discount: Floats


def _decisions(
    episodes: Sequence[Episode], briefing: Briefing, algorithm: Algorithm
) -> _Decisions:
    records = _joined(episodes)
    mission = np.repeat(np.arange(len(episodes)), [it.n_decisions for it in episodes])
    latest = _latest(records, mission, briefing.n_uavs)
    instant = _instants(mission, records.time_s, algorithm)
    decides = (latest >= 0) & (instant[latest] == instant[:, None])
    return _Decisions(records, mission, latest, decides, instant)


def _entries(
    episodes: Sequence[Episode],
    decisions: _Decisions,
    algorithm: Algorithm,
    discount_per_s: float,
) -> _Entries:
    records, mission = decisions.records, decisions.mission
    is_whole = np.array([episode.is_whole for episode in episodes])
    closes = _closing(mission, decisions.instant, decisions.latest, is_whole, algorithm)
    order, entry_next = _successors(records, mission, closes, is_whole, algorithm)
    entry, next_entry = order[entry_next != _UNKNOWN], entry_next[entry_next != _UNKNOWN]
    reward, discount = _returns(records, mission, entry, next_entry, discount_per_s)
    return _Entries(entry, next_entry, reward, discount)


def _needed(
    decisions: _Decisions, entries: _Entries, algorithm: Algorithm, n_burn_in: int
) -> tuple[_Decisions, _Entries]:
    """What is left of the missions: decisions that entries need, and the entries among these."""
    records, mission, latest = decisions.records, decisions.mission, decisions.latest
    asked = np.concatenate([entries.entry, entries.next_entry[entries.next_entry >= 0]])
    if algorithm.mixes:  # the mixer takes what the others are doing
        running = latest[asked].ravel()
        asked = np.concatenate([asked, running[running >= 0]])
    sequence = mission * latest.shape[1] + records.uav
    needed = is_run(sequence, records.decision, asked, n_burn_in)
    place = np.cumsum(needed) - 1

    def placed(index: Ints) -> Ints:
        return np.where((index >= 0) & needed[index], place[index], NO_DECISION)

    tables: list[Any] = [table[needed] for table in records]
    left = _Decisions(
        records=Records(*tables),
        mission=mission[needed],
        latest=placed(latest[needed]),
        decides=decisions.decides[needed],
        instant=decisions.instant[needed],
    )
    entry, next_entry = placed(entries.entry), placed(entries.next_entry)
    return left, entries._replace(entry=entry, next_entry=next_entry)


def _minibatch(
    decisions: _Decisions,
    entries: _Entries,
    packed: tuple[Ints, list[int], SparseRows],
    briefing: Briefing,
    layout: AnyLayout,
) -> Minibatch:
    """Put a minibatch together.

    Args:
        packed: row of each decision, rows of each step, and what was observed, by row.
    """
    (row, step_sizes, sparse), records = packed, decisions.records
    follows = np.append(entries.entry[1:], NO_DECISION)
    size = observation_size(layout, len(briefing.is_open), briefing.n_uavs)
    frame = frames(layout, briefing)[records.uav]
    is_legal = _bits(records.legal)[:, :N_ACTIONS] == 1
    legal = np.empty((len(row), N_ACTIONS), dtype=bool)
    legal[row] = np.take_along_axis(is_legal, COMPASS_ACTIONS[frame], axis=1)
    worth = np.empty((len(row), N_ACTIONS), dtype=np.float32)
    is_known = is_legal & (records.is_judged == 1)[:, None]
    known = np.where(is_known, records.worth, np.nan)
    worth[row] = np.take_along_axis(known, COMPASS_ACTIONS[frame], axis=1)
    return Minibatch(
        sparse=sparse,
        observation_size=size,
        step_sizes=step_sizes,
        legal=legal,
        advice=_advice(sparse, layout, size),
        worth=worth,
        row=row,
        action=FRAME_ACTIONS[frame, np.maximum(records.action, 0)],
        latest=decisions.latest,
        decides=decisions.decides,
        fleet=records.fleet,
        complete=_maps(records, briefing),
        area=(briefing.n_rows, briefing.n_columns),
        entry=entries.entry,
        next_entry=entries.next_entry,
        is_chained=(entries.next_entry >= 0) & (follows == entries.next_entry),
        reward=entries.reward,
        discount=entries.discount,
    )


_UNKNOWN = -2  # what follows is not known: the mission was cut off


def _joined(episodes: Sequence[Episode]) -> Records:
    tables: list[Any] = [
        np.concatenate([getattr(episode.records, name) for episode in episodes])
        for name in Records._fields
    ]
    return Records(*tables)


def _packed_rows(rows: Sequence[SparseRows], order: Ints) -> SparseRows:
    """The rows of all missions, each at its place; the values stay in the order of missions."""
    first = np.cumsum([0, *(len(it.value) for it in rows)])
    start, stop = np.empty_like(order), np.empty_like(order)
    start[order] = np.concatenate([at + it.start for at, it in zip(first, rows, strict=False)])
    stop[order] = np.concatenate([at + it.stop for at, it in zip(first, rows, strict=False)])
    return SparseRows(
        column=np.concatenate([it.column for it in rows]),
        value=np.concatenate([it.value for it in rows]),
        start=start,
        stop=stop,
    )


def _dense(rows: SparseRows, columns: range) -> NDArray[np.float32]:
    """Columns of the rows, shape (R, columns)."""
    dense = np.zeros((len(rows.start), len(columns)), dtype=np.float32)
    # The values of a mission lie in order, but its rows are packed among others.
    order = np.argsort(rows.start, kind='stable')
    row = np.repeat(order, (rows.stop - rows.start)[order])
    is_wanted = (rows.column >= columns.start) & (rows.column < columns.stop)
    dense[row[is_wanted], rows.column[is_wanted] - columns.start] = rows.value[is_wanted]
    return dense


def _advice(rows: SparseRows, layout: AnyLayout, size: int) -> NDArray[np.float32]:
    """The advice that observations show, one-hot by action; zeros where they show none."""
    columns = advice_columns(layout, size)
    if not columns:
        return np.zeros((len(rows.start), N_ACTIONS), dtype=np.float32)
    return _dense(rows, columns)


def _packing(records: Records, mission: Ints, n_uavs: int) -> tuple[Ints, list[int]]:
    """The packed row of each decision, and how many sequences reach each step."""
    sequence = mission * n_uavs + records.uav
    step = records.decision.astype(np.int64)
    first = np.full(int(sequence.max()) + 1, np.iinfo(np.int64).max)
    np.minimum.at(first, sequence, step)
    step -= first[sequence]
    length = np.bincount(sequence)
    place = np.empty(len(length), dtype=np.int64)
    place[np.argsort(-length, kind='stable')] = np.arange(len(length))
    step_sizes = np.bincount(step)
    start = np.cumsum(step_sizes) - step_sizes
    return start[step] + place[sequence], step_sizes.tolist()


def _latest(records: Records, mission: Ints, n_uavs: int) -> Ints:
    """The latest decision of each UAV at each decision; none before its first, none once home."""
    index = np.arange(len(mission))
    first = np.searchsorted(mission, mission)
    uav = records.uav
    decided = np.where(uav[:, None] == np.arange(n_uavs), index[:, None], NO_DECISION)
    latest = np.maximum.accumulate(decided, axis=0)
    active = records.fleet[:, N_UAV_SCALARS - 1 :: N_UAV_SCALARS] > 0.0
    return np.where((latest >= first[:, None]) & active, latest, NO_DECISION)


def _instants(mission: Ints, time_s: Floats, algorithm: Algorithm) -> Ints:
    """A number for each decision; decisions of one joint choice share it."""
    if algorithm is not Algorithm.QMIX:
        return np.arange(len(mission))
    is_new = (mission[1:] != mission[:-1]) | (time_s[1:] != time_s[:-1])
    return np.concatenate([[0], np.cumsum(is_new)])


def _closing(
    mission: Ints, instant: Ints, latest: Ints, is_whole: Bools, algorithm: Algorithm
) -> Bools:
    """Whether a decision completes the joint choice of its instant."""
    is_last = np.append(instant[1:] != instant[:-1], True)
    if algorithm is not Algorithm.QMIX:
        return is_last
    # Where a mission was cut off between two UAVs' turns, what all may do best is not known.
    is_running = (latest >= 0) & (instant[latest] != instant[:, None])
    is_cut = np.append(mission[1:] != mission[:-1], True) & ~is_whole[mission]
    closing: Bools = is_last & ~(is_cut & is_running.any(axis=1))
    return closing


def _successors(
    records: Records, mission: Ints, closes: Bools, is_whole: Bools, algorithm: Algorithm
) -> tuple[Ints, Ints]:
    """Decisions in the order of chains; what follows each: NO_DECISION at the end, or _UNKNOWN."""
    index = np.arange(len(mission))
    if algorithm is Algorithm.AIQL:
        order = np.lexsort((index, records.uav, mission))
        chain = mission * (1 + int(np.max(records.uav))) + records.uav
    else:
        order = index[closes]
        chain = mission
    chain = chain[order]
    is_last = np.append(chain[1:] != chain[:-1], True)
    end = np.where(is_whole[mission[order]], NO_DECISION, _UNKNOWN)
    return order, np.where(is_last, end, np.append(order[1:], NO_DECISION))


def _returns(
    records: Records, mission: Ints, entry: Ints, next_entry: Ints, discount_per_s: float
) -> tuple[Floats, Floats]:
    """Reward between entries and the next ones, and the discount of what follows.

    gamma^tau of the target (paper, section V-A), tau the time between the two.
    """
    time_s = records.time_s
    is_last = np.append(mission[1:] != mission[:-1], True)
    discount = np.where(is_last, 0.0, discount_per_s**records.duration_s)
    to_go = np.empty(len(mission))
    _sum_backwards(records.reward, discount, to_go)
    is_known = next_entry >= 0
    after = np.where(is_known, next_entry, 0)
    between = discount_per_s ** np.where(is_known, time_s[after] - time_s[entry], 0.0)
    reward = to_go[entry] - np.where(is_known, between * to_go[after], 0.0)
    return reward, np.where(is_known, between, 0.0)


@kernel
def _sum_backwards(values: Row[float], factors: Row[float], sums: Row[float]) -> None:
    """Solve sum_i = value_i + factor_i sum_{i+1} from the end, shape (N,)."""
    total = 0.0
    for index in range(len(values) - 1, -1, -1):
        total = values[index] + factors[index] * total
        sums[index] = total


def _bits(packed: Any) -> NDArray[np.uint8]:  # noqa: ANN401 - a column of records
    return np.unpackbits(np.asarray(packed)[..., None], axis=-1, bitorder='little')


def _maps(records: Records, briefing: Briefing) -> NDArray[np.uint8]:
    n_cells = briefing.n_rows * briefing.n_columns
    known = records.complete.reshape(len(records.uav), briefing.n_uavs, -1)
    packed = np.concatenate([known, records.true_complete[:, None]], axis=1)
    return np.unpackbits(packed, axis=-1, count=n_cells, bitorder='little')

"""Missions as arrays that a checkpoint holds, and back: what cannot have been flown is refused."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from uav_collect.kernels.arrays import Bools, Ints
from uav_collect.learning.saved import SavedPart
from uav_collect.missions.experience import Episode, new_records, Records
from uav_collect.uav.action_codes import N_ACTIONS, NONE
from uav_collect.uav.briefing import Briefing


def packed(episodes: Sequence[Episode]) -> dict[str, NDArray[Any]]:
    """At least one mission, one behind the other; the inverse is `unpacked`."""
    tables = {
        name: np.concatenate([getattr(it.records, name) for it in episodes])
        for name in Records._fields
    }
    return tables | {
        'n_decisions': np.array([it.n_decisions for it in episodes], dtype=np.int64),
        'mission_seed': np.array([it.mission_seed for it in episodes], dtype=np.int64),
        'is_whole': np.array([it.is_whole for it in episodes], dtype=np.uint8),
        'demand_bit': np.array([it.demand_bit for it in episodes]),
    }


def unpacked(saved: SavedPart, briefing: Briefing) -> list[Episode]:
    """The missions that `packed` was given; their records are views.

    Raises:
        CheckpointError: what, and the row, that no mission can hold.
    """
    n_cells = briefing.n_rows * briefing.n_columns
    n_decisions = saved.array('n_decisions', np.int64, [None])
    n_missions = len(n_decisions)
    seed = saved.array('mission_seed', np.int64, [n_missions])
    is_whole = saved.array('is_whole', np.uint8, [n_missions])
    demand_bit = saved.array('demand_bit', np.float64, [n_missions, n_cells])
    n_rows = sum(n_decisions.tolist())
    like = new_records(0, briefing)
    tables: list[Any] = [
        saved.array(name, table.dtype, (n_rows, *table.shape[1:]))
        for name, table in zip(Records._fields, like, strict=True)
    ]
    records = Records(*tables)
    _check(saved, [
        ('n_decisions', n_decisions < 1),
        ('mission_seed', seed < 0),
        ('is_whole', is_whole > 1),
        ('demand_bit', demand_bit < 0.0),
    ])  # fmt: skip
    mission = np.repeat(np.arange(n_missions), n_decisions)
    _check(saved, _wrong_rows(records, mission, is_whole == 1, briefing))
    ends = np.cumsum(n_decisions).tolist()
    return [
        Episode(
            mission_seed=int(seed[index]),
            demand_bit=demand_bit[index],
            records=Records(*(table[end - size : end] for table in tables)),
            is_whole=bool(is_whole[index]),
        )
        for index, (size, end) in enumerate(zip(n_decisions.tolist(), ends, strict=True))
    ]


def _wrong_rows(
    records: Records, mission: Ints, is_whole: Bools, briefing: Briefing
) -> Iterable[tuple[str, Bools]]:
    """By column, which of its rows an update could not take."""
    n_cells = briefing.n_rows * briefing.n_columns
    is_first = np.diff(mission, prepend=-1) > 0
    is_last = np.append(is_first[1:], True)[: len(mission)]
    yield 'uav', (records.uav < 0) | (records.uav >= briefing.n_uavs)
    yield 'decision', records.decision != _own_decisions(records.uav, mission, briefing.n_uavs)
    yield 'time_s', (records.time_s < 0.0) | (np.diff(records.time_s, prepend=0.0) < 0) & ~is_first
    yield 'cell', (records.cell < 0) | (records.cell >= n_cells)
    yield (
        'previous_action',
        (records.previous_action < NONE) | (records.previous_action >= N_ACTIONS),
    )
    yield 'legal', (records.legal == 0) | (records.legal >= 1 << N_ACTIONS)
    yield 'duration_s', records.duration_s < 0.0
    # Only of a mission that was cut off it is not known what was chosen last.
    is_known = ~is_last | is_whole[mission]
    yield 'action', (records.action < np.where(is_known, 0, NONE)) | (records.action >= N_ACTIONS)


def _own_decisions(uav: Ints, mission: Ints, n_uavs: int) -> Ints:
    """The running number of each decision among those of its UAV in its mission."""
    flight = mission * n_uavs + uav
    order = np.argsort(flight, kind='stable')
    is_first = np.diff(flight[order], prepend=-1) > 0
    index = np.arange(len(order))
    number = np.empty(len(order), dtype=np.int64)
    number[order] = index - np.maximum.accumulate(np.where(is_first, index, 0))
    return number


def _check(saved: SavedPart, wrong: Iterable[tuple[str, Bools]]) -> None:
    for name, is_wrong in wrong:
        if is_wrong.any():
            row = int(np.argwhere(is_wrong)[0][0])
            raise saved.refusal(name, f'has a value in row {row} that no mission has')

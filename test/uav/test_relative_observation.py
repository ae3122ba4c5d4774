"""The layout egocentric/3: alike in mirrored missions, whatever the index, scaled by the field."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np
from odd_areas import corridor
import pytest
from random_policies import header, random_policy
from uav_collect.kernels.arrays import Bools, Floats, Ints, new_row, row_of
from uav_collect.uav import relative_observation as parts
from uav_collect.uav.action_codes import BACKWARD, FORWARD, N_ACTIONS, NONE, RIGHT
from uav_collect.uav.belief import Belief, belief_of, hear, merge, new_beliefs
from uav_collect.uav.briefing import brief, Briefing
from uav_collect.uav.frames import COMPASS_ACTIONS, FRAME_ACTIONS, frame_of
from uav_collect.uav.observation import encode, Layout, observation_bound
from uav_collect.uav.sharing import Shares, shares_of
from uav_collect.uav.view import LocalView

SYMMETRIES = range(8)  # numbered as frames are
N_ROWS, N_COLUMNS, SIZE_M = 6, 9, 40.0
SPEEDS_MPS = (5.0, 8.0, 8.0, 12.0)
HOME, HERE = (1, 0), (2, 3)
HEARD = ((1, 1.5, 4.25, 20.0), (2, 4.5, 8.0, 35.0), (3, 2.5, 6.0, 30.0))  # who, where, when [s]
ACROSS = math.log1p(math.hypot(N_ROWS, N_COLUMNS)) / 4  # a range from corner to corner
PATCH = slice(parts.FIRST_OF_PATCH, parts.FIRST_OF_NEAR)
NEAR = slice(parts.FIRST_OF_NEAR, parts.FIRST_OF_FAR)
FAR = slice(parts.FIRST_OF_FAR, parts.SIZE - 2 * N_ACTIONS)
PEERS = slice(parts.N_SCALARS, parts.FIRST_OF_PATCH)


@dataclass(frozen=True)
class Seen:
    """What the first UAV knows when it decides, and what it is advised."""

    briefing: Briefing
    shares: Shares
    belief: Belief
    view: LocalView
    advice: int

    @property
    def numbers(self) -> Floats:
        """The observation."""
        out = new_row(parts.SIZE, math.nan)
        of = self.briefing, self.shares, 0, self.belief, self.view, self.advice
        encode(int(Layout.RELATIVE), *of, out)
        return np.array(out)


@dataclass(frozen=True)
class Area:
    """An area of N_ROWS x N_COLUMNS cells, or a square one, after a symmetry."""

    symmetry: int
    n_rows: int
    n_columns: int

    @property
    def shape(self) -> tuple[int, int]:
        return (
            (self.n_columns, self.n_rows) if self.symmetry & 4 else (self.n_rows, self.n_columns)
        )

    def place(self, row: float, column: float) -> tuple[float, float]:
        """Where a place comes to lie, north and east in cells."""
        column = self.n_columns - column if self.symmetry & 1 else column
        row = self.n_rows - row if self.symmetry & 2 else row
        return (column, row) if self.symmetry & 4 else (row, column)

    def cell(self, row: int, column: int) -> list[int]:
        return [int(it) for it in self.place(row + 0.5, column + 0.5)]

    def table(self, values: Ints | Floats | Bools) -> list[float]:
        """Values by cell, by where the cells come to lie."""
        turned = np.zeros(self.shape)
        for row, column in np.ndindex(self.n_rows, self.n_columns):
            turned[*self.cell(row, column)] = values[row * self.n_columns + column]
        out: list[float] = turned.ravel().tolist()
        return out

    def flags(self, values: Ints | Bools) -> list[int]:
        return [int(it) for it in self.table(values)]

    def briefing(self, n_uavs: int, home: tuple[int, int]) -> Briefing:
        at = {'cell': self.cell(*home)}
        fleet = [{'speed_mps': speed_mps} for speed_mps in SPEEDS_MPS[:n_uavs]]
        scenario = corridor(
            *self.shape,
            area__cell_size_m=SIZE_M,
            fleet__default__start=at,
            fleet__default__home=at,
            fleet__uavs=fleet,
        )
        return brief(scenario)


def seen(
    symmetry: int = 0,
    n_rows: int = N_ROWS,
    n_columns: int = N_COLUMNS,
    home: tuple[int, int] = HOME,
    heard: Sequence[tuple[int, float, float, float]] = HEARD,
) -> Seen:
    """A situation with closed cells, after a symmetry."""
    area, plain = Area(symmetry, n_rows, n_columns), Area(0, n_rows, n_columns)
    n_cells, rng = n_rows * n_columns, np.random.default_rng(5)
    is_open = rng.random(n_cells) < 0.9
    briefing = area.briefing(4, home)._replace(is_open=row_of(area.flags(is_open)))
    shares = shares_of(plain.briefing(4, home))
    shares = shares._replace(place=row_of(area.flags(np.array(shares.place))))
    belief = belief_of(new_beliefs(briefing, 1), 0)
    merge(belief, row_of(area.flags((rng.random(n_cells) < 0.4) | ~is_open)))
    seen_bit = rng.uniform(0.0, 3e6, n_cells) * (rng.random(n_cells) < 0.5)
    for cell, bit in enumerate(area.table(seen_bit)):
        belief.seen_bit[cell] = bit
    for other, row, column, time_s in heard:
        north, east = area.place(row, column)
        hear(belief, other, row_of([0] * n_cells), east * SIZE_M, north * SIZE_M, time_s)
    row, column = area.cell(*HERE)
    none, nothing = row_of([0]), row_of([0.0])
    view = LocalView(
        time_s=40.0,
        x_m=(column + 0.5) * SIZE_M,
        y_m=(row + 0.5) * SIZE_M,
        cell=row * area.shape[1] + column,
        energy_left_j=5e5,
        previous_action=int(FRAME_ACTIONS[symmetry, RIGHT]),
        region_bit=row_of([0.0] * 9),
        n_sensors=0,
        sensor=none,
        sensor_bit=nothing,
        sensor_gain=nothing,
        sensor_error_gain=nothing,
    )
    return Seen(briefing, shares, belief, view, int(FRAME_ACTIONS[symmetry, FORWARD]))


@pytest.mark.parametrize('symmetry', SYMMETRIES)
@pytest.mark.parametrize(('n_rows', 'n_columns', 'home'), [(6, 9, (1, 0)), (8, 8, (2, 0))])
def test_a_mirrored_mission_looks_the_same(
    symmetry: int, n_rows: int, n_columns: int, home: tuple[int, int]
) -> None:
    plain, mirrored = seen(0, n_rows, n_columns, home), seen(symmetry, n_rows, n_columns, home)
    # The frame leads back: where it is turned, the two mirrors change places.
    assert frame_of(mirrored.briefing, 0) == {5: 6, 6: 5}.get(symmetry, symmetry)
    assert np.count_nonzero(plain.numbers) > 100
    assert mirrored.numbers == pytest.approx(plain.numbers, abs=1e-12)


@pytest.mark.parametrize('symmetry', SYMMETRIES)
def test_a_mirrored_mission_is_flown_as_in_the_mirror(symmetry: int) -> None:
    # The values of all actions are mirrored, and so are the legal ones among them.
    chosen = []
    for seed in range(30):
        of = replace(header(Layout.RELATIVE, n_uavs=4), advice_bonus=0.02)
        frozen = random_policy(of, seed)
        legal = np.random.default_rng(seed).random((1, N_ACTIONS)) < 0.7
        legal[0, RIGHT] = True
        actions = []
        for it, turned in ((seen(0), 0), (seen(symmetry), symmetry)):
            values, _ = frozen.step(it.numbers[None], frozen.new_hidden(1))
            is_legal = legal[:, COMPASS_ACTIONS[turned]]
            frame = np.array([frame_of(it.briefing, 0)])
            actions.append(frozen.actions(values, is_legal, frame, np.array([it.advice]))[0])
        assert actions[1] == FRAME_ACTIONS[symmetry, actions[0]]
        chosen.append(actions[0])
    assert len({*chosen}) > 2


def test_a_peers_index_says_nothing() -> None:
    swapped = [(2, *HEARD[0][1:]), (1, *HEARD[1][1:]), HEARD[2]]  # two that are equally fast
    assert (seen(heard=swapped).numbers == seen().numbers).all()


def test_the_two_that_were_heard_nearest_are_shown_and_all_are_counted() -> None:
    peers = seen().numbers[PEERS]
    counts, nearest = peers[:4], peers[4:].reshape(2, 5)
    assert counts.tolist() == [3 / 8, 0.0, 12.0 / 8.25, 8.0 / 8.25]
    # One is half a cell west and one south of (2.5, 3.5), the other 2.5 cells east of it.
    assert nearest[:, :3].ravel() == pytest.approx([1, -0.1, 0.075, 1, 0.0, 0.25])
    crossing_s = np.mean(SIZE_M / np.array(SPEEDS_MPS))
    assert nearest[:, 3] == pytest.approx(np.exp(np.array([-20.0, -10.0]) / (12 * crossing_s)))
    assert nearest[:, 4] == pytest.approx([8 / 8.25, 12 / 8.25])


def test_equal_peers_are_all_shown() -> None:
    peers = seen(heard=[(1, 2.5, 4.5, 30.0), (2, 2.5, 4.5, 30.0)]).numbers[PEERS]
    assert peers[:2].tolist() == [2 / 8, 1 / 8]
    assert peers[4:9].tolist() == peers[9:14].tolist() != [0.0] * 5


def test_of_peers_who_were_never_heard_there_is_no_place() -> None:
    numbers = seen(heard=()).numbers
    assert numbers[PEERS][:2].tolist() == [0.0, 3 / 8]
    assert not numbers[PEERS][4:].any()


def test_the_scale_of_the_field_and_of_the_fleet_is_not_seen() -> None:
    # Twice as long, fast and ranging: the same. Powers depend on the speed, so they are given.
    plain = seen()
    briefing, belief, view = plain.briefing, plain.belief, plain.view
    doubled = {
        name: row_of([2.0 * it for it in getattr(briefing, name)])
        for name in ('speed_mps', 'start_x_m', 'start_y_m', 'home_x_m', 'home_y_m')
    }
    larger = briefing._replace(
        cell_size_m=2 * SIZE_M, contact_range_m=2 * briefing.contact_range_m, **doubled
    )
    apart = {
        name: row_of([2.0 * it for it in getattr(belief, name)])
        for name in ('peer_x_m', 'peer_y_m')
    }
    other = Seen(
        larger,
        plain.shares,
        belief._replace(**apart),
        view._replace(x_m=2 * view.x_m, y_m=2 * view.y_m),
        plain.advice,
    )
    assert other.numbers == pytest.approx(plain.numbers)


def test_the_patch_shows_what_is_left_whose_it_is_and_where_there_is_no_way() -> None:
    it = seen()
    left, own, demand, closed = it.numbers[PATCH].reshape(4, 9, 9)
    assert (own <= left).all()
    assert 0.0 < own.sum() < left.sum()
    assert ((demand > 0.0) <= (left == 1.0)).all()
    assert ((left + closed) <= 1.0).all()
    assert (closed[:2] == 1.0).all()  # rows -2 and -1 south of the area
    assert (closed[:, 0] == 1.0).all()  # column -1
    here = HERE[0] * N_COLUMNS + HERE[1]
    for north, east in ((0, 0), (1, 0), (0, 1), (3, 4)):
        cell = here + north * N_COLUMNS + east
        assert left[4 + north, 4 + east] == 1 - it.belief.complete[cell]


def test_blocks_hold_all_that_is_left_within_their_reach() -> None:
    it = seen()
    n_left = len(it.belief.complete) - it.belief.n_complete[0]
    near, far = it.numbers[NEAR].reshape(4, 49), it.numbers[FAR].reshape(3, 81)
    assert near[0].sum() * 9 == pytest.approx(n_left)
    assert far[0].sum() * 81 == pytest.approx(n_left)
    fresh = it.numbers[PEERS][4:].reshape(2, 5)[:, 3].sum()
    assert near[3].sum() == pytest.approx(far[2].sum())
    assert near[3].sum() > fresh  # of the third peer, too


def test_the_previous_action_and_the_advice_come_last() -> None:
    numbers = seen().numbers
    assert numbers[-10:-5].tolist() == [0, 0, 1, 0, 0]
    assert numbers[-5:].tolist() == [0, 1, 0, 0, 0]
    assert not replace(seen(), advice=NONE).numbers[-5:].any()
    assert replace(seen(), advice=BACKWARD).numbers[-5:].tolist() == [0, 0, 0, 1, 0]


@pytest.mark.parametrize(
    ('range_m', 'shown'),
    [
        (0.0, (0.0, 1.0, 0.0)),
        (80.0, (math.log1p(2.0) / 4, 0.0, 0.0)),
        (math.inf, (ACROSS, 0.0, 1.0)),
    ],
)
def test_the_contact_range_counts_in_cells(
    range_m: float, shown: tuple[float, float, float]
) -> None:
    it = seen()
    briefing = it.briefing._replace(contact_range_m=range_m)
    numbers = replace(it, briefing=briefing).numbers
    assert numbers[11:14].tolist() == pytest.approx(shown)


def test_no_number_exceeds_the_bound() -> None:
    it = seen()
    assert np.abs(it.numbers).max() <= observation_bound(Layout.RELATIVE, it.briefing, 3e6)

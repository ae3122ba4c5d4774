import math

import numpy as np
import pytest
from tiny_world import Flight, tiny, uav
from uav_collect.errors import ConfigError
from uav_collect.kernels.arrays import Floats, new_row, row_of
from uav_collect.scenario.model import Scenario
from uav_collect.uav.action_codes import FORWARD, HOVER, N_ACTIONS, RIGHT
from uav_collect.uav.agent import reason_to_go_home
from uav_collect.uav.belief import Belief, belief_of, hear, merge, new_beliefs
from uav_collect.uav.briefing import brief
from uav_collect.uav.observation import Layout, observation_bound, observation_size, Observer
from uav_collect.uav.view import LocalView

# Parts of the egocentric layout.
PATCH = 10
OPEN, SEEN, WALL = (slice(PATCH + 81 * part, PATCH + 81 * (part + 1)) for part in range(3))
BLOCKS = PATCH + 3 * 81
OPEN_BLOCKS, SEEN_BLOCKS = slice(BLOCKS, BLOCKS + 49), slice(BLOCKS + 49, BLOCKS + 98)
FAR_BLOCKS = BLOCKS + 98
OPEN_FAR, SEEN_FAR = slice(FAR_BLOCKS, FAR_BLOCKS + 25), slice(FAR_BLOCKS + 25, FAR_BLOCKS + 50)
PEERS = FAR_BLOCKS + 50
N_PEERS, PER_PEER = 5, 5
EGOCENTRIC_SIZE = PEERS + N_PEERS * PER_PEER + N_ACTIONS + 6


def encoded(
    layout: Layout, scenario: Scenario, unit: int, belief: Belief, view: LocalView
) -> Floats:
    observer = Observer(layout, brief(scenario), unit)
    for place in range(len(observer.observation)):
        observer.observation[place] = math.nan
    legal = row_of([1, 1, 1, 1, 1])
    numbers = np.array(observer.observe(belief, view, legal))
    assert not np.isnan(numbers).any()  # everything is written
    return numbers


def observation(layout: Layout, scenario: Scenario, *actions: int) -> Floats:
    """What the UAV that decides after these actions observes."""
    flight = Flight(scenario)
    for action in actions:
        flight.step(action)
    event = flight.look()
    return encoded(layout, scenario, event.uav, flight.agents[event.uav].belief, event.view)


def test_a_layout_is_named_with_its_version() -> None:
    assert [layout.label for layout in Layout] == ['paper/1', 'egocentric/2', 'egocentric/3']


@pytest.mark.parametrize(
    ('layout', 'n_cells', 'n_uavs', 'size'),
    [
        (Layout.PAPER, 100, 2, 3 + 100 + 9 + 5 + 2),
        (Layout.PAPER, 16, 1, 3 + 16 + 9 + 5 + 1),
        (Layout.EGOCENTRIC, 100, 2, EGOCENTRIC_SIZE),
        (Layout.EGOCENTRIC, 400, 6, EGOCENTRIC_SIZE),
    ],
)
def test_the_size_of_an_observation(layout: Layout, n_cells: int, n_uavs: int, size: int) -> None:
    assert observation_size(layout, n_cells, n_uavs) == size


def test_the_egocentric_layout_has_room_for_six_uavs() -> None:
    with pytest.raises(ConfigError, match=r'7 UAVs; observations egocentric/2 have room for 6'):
        observation_size(Layout.EGOCENTRIC, 100, 7)


@pytest.mark.parametrize('layout', Layout)
@pytest.mark.parametrize('side', [1, 3, 4, 12])
def test_every_number_of_an_observation_is_written(layout: Layout, side: int) -> None:
    scenario = tiny(uav(5.0), uav(5.0), sensors=[(25.0, 25.0, 1.0)], area__cells_per_side=side)
    numbers = observation(layout, scenario)
    assert (np.abs(numbers) <= 1.5).all()


@pytest.mark.parametrize(
    ('layout', 'speed_mps', 'most_bit', 'bound'),
    [
        (Layout.PAPER, 5.0, 0.5e6, 1.0),
        (Layout.PAPER, 5.0, 7.5e6, 8.0),
        (Layout.EGOCENTRIC, 5.0, 7.5e6, 20.0),  # 81 cells of ln(8.5) over 9: 19.3
        (Layout.EGOCENTRIC, 45.0, 0.0, 5.0),
        (Layout.EGOCENTRIC, 5.0, 0.0, 4.0),  # 400 cells in hundreds
    ],
)
def test_no_number_of_an_observation_exceeds_its_bound(
    layout: Layout, speed_mps: float, most_bit: float, bound: float
) -> None:
    fleet = [uav(speed_mps, start=(2, 3))]
    scenario = tiny(*fleet, sensors=[(25.0, 25.0, 1.0)], area__cells_per_side=20)
    belief = belief_of(new_beliefs(brief(scenario), 1), 0)
    for cell in range(400):
        belief.seen_bit[cell] = most_bit
    view = Flight(scenario).look().view._replace(region_bit=row_of([most_bit] * 9))
    numbers = encoded(layout, scenario, 0, belief, view)
    assert observation_bound(layout, brief(scenario), most_bit) == bound
    assert 0.5 * bound <= np.abs(numbers).max() <= bound


def test_the_paper_layout_of_a_case_made_by_hand() -> None:
    # The second UAV at cell 4 = (1, 0) after one move; B is out of its sight.
    numbers = observation(Layout.PAPER, tiny(), RIGHT, FORWARD)
    energy, x, y = numbers[:3]
    assert energy == pytest.approx(1.0 - 630.168 / 1e6, rel=1e-9)
    assert (x, y) == (25.0 / 200.0, 75.0 / 200.0)
    known = [cell for cell in range(16) if numbers[3 + cell] == 1.0]
    assert known == [0, 4, 5, 8, 9]
    assert numbers[3:19].sum() == 5.0
    assert numbers[19:28].tolist() == [0, 0, 1.0, 0, 0, 0, 0, 0, 0]  # A, south-east; walls are 0
    assert numbers[28:33].tolist() == [0, 1, 0, 0, 0]  # came by moving forward
    assert numbers[33:].tolist() == [0, 1]  # the second UAV


def test_the_paper_layout_counts_demand_in_mbit() -> None:
    numbers = observation(Layout.PAPER, tiny(uav(5.0, start=(1, 1))))
    assert numbers[19:28].tolist() == [0, 1.0, 0, 0, 0, 0, 0, 0, 0.75]


# Places for UAVs at the end: as many as fly, or as many as the layout has room for.
PLACES = [(Layout.PAPER, 3), (Layout.EGOCENTRIC, 6)]


@pytest.mark.parametrize(('layout', 'n_places'), PLACES)
def test_before_the_first_action_no_previous_action_is_set(layout: Layout, n_places: int) -> None:
    numbers = observation(layout, tiny(uav(5.0), uav(5.0), uav(5.0)))
    assert numbers[-5 - n_places :].tolist() == [0] * 5 + [1] + [0] * (n_places - 1)


@pytest.mark.parametrize(('layout', 'n_places'), PLACES)
def test_the_previous_action_and_the_uav_are_one_hot_at_the_end(
    layout: Layout, n_places: int
) -> None:
    start = (0, 1)
    scenario = tiny(uav(5.0), uav(5.0, start=start), uav(5.0))
    numbers = observation(layout, scenario, FORWARD, HOVER, RIGHT)
    assert numbers[-5 - n_places :].tolist() == [1, 0, 0, 0, 0, 0, 1] + [0] * (n_places - 2)


# The egocentric layout. A case made by hand, 12 x 12 cells, the UAV at row 2, column 3.

SIDE = 12
HERE = (2, 3)


def wide(*more: dict[str, object]) -> Scenario:
    sensors = [(25.0, 25.0, 1.0)]
    fleet = [uav(5.0, start=HERE, home_m=(325.0, 25.0)), *more]
    return tiny(*fleet, sensors=sensors, area__cells_per_side=SIDE)


def looking(scenario: Scenario, complete: list[int], seen_bit: dict[int, float]) -> Floats:
    """The egocentric observation of a belief that is put together by hand."""
    belief = belief_of(new_beliefs(brief(scenario), 1), 0)
    known = [0] * SIDE * SIDE
    for cell in complete:
        known[cell] = 1
    merge(belief, row_of(known))
    for cell, bit in seen_bit.items():
        belief.seen_bit[cell] = bit
    view = Flight(scenario).look().view
    return encoded(Layout.EGOCENTRIC, scenario, 0, belief, view)


def patch_index(north: int, east: int) -> int:
    return (north + 4) * 9 + east + 4


def cell_of(north: int, east: int) -> int:
    return (HERE[0] + north) * SIDE + HERE[1] + east


def test_the_egocentric_layout_starts_with_energy_place_room_and_the_way_home() -> None:
    # Lengths are in units of ten cells of 50 m.
    numbers = looking(wide(), [], {})
    assert numbers[0] == 1.0
    assert numbers[1:3].tolist() == pytest.approx([175.0 / 500.0, 125.0 / 500.0])
    assert numbers[3:5].tolist() == pytest.approx([425.0 / 500.0, 475.0 / 500.0])
    assert numbers[5:7].tolist() == pytest.approx([150.0 / 500.0, -100.0 / 500.0])


def test_then_come_the_own_speed_the_fleets_size_and_what_is_left_to_do() -> None:
    numbers = looking(wide(uav(5.0)), [0, 1, 2, 3], {})
    assert numbers[7:10].tolist() == pytest.approx([5.0 / 10.0, 2 / 6, (144 - 4) / 100.0])


def test_the_patch_shows_walls_south_row_first() -> None:
    wall = looking(wide(), [], {})[WALL].reshape(9, 9)
    assert (wall[:2] == 1.0).all()  # rows -2 and -1
    assert (wall[:, 0] == 1.0).all()  # column -1
    assert (wall[2:, 1:] == 0.0).all()


def test_the_patch_shows_where_cells_are_incomplete() -> None:
    complete = [cell_of(1, 0), cell_of(0, 2), cell_of(-2, -3)]
    is_open = looking(wide(), complete, {})[OPEN]
    wall = looking(wide(), complete, {})[WALL]
    closed = {index for index in range(81) if is_open[index] == 0.0 and wall[index] == 0.0}
    assert closed == {patch_index(1, 0), patch_index(0, 2), patch_index(-2, -3)}
    assert is_open[patch_index(0, 0)] == 1.0


def test_the_patch_shows_the_demand_seen_last_of_incomplete_cells() -> None:
    seen_bit = {cell_of(1, 0): 2e6, cell_of(0, 3): 0.5e6, cell_of(4, 4): 0.25e6}
    seen = looking(wide(), [cell_of(0, 3)], seen_bit)[SEEN]
    shown = {index: seen[index] for index in range(81) if seen[index]}
    demand = {patch_index(1, 0): math.log1p(2.0), patch_index(4, 4): math.log1p(0.25)}
    assert shown == pytest.approx(demand)


def test_north_is_up_a_row_and_east_is_right_a_column() -> None:
    seen = looking(wide(), [], {cell_of(1, 0): 1e6})[SEEN].reshape(9, 9)
    assert np.argwhere(seen).tolist() == [[5, 4]]
    seen = looking(wide(), [], {cell_of(0, 1): 1e6})[SEEN].reshape(9, 9)
    assert np.argwhere(seen).tolist() == [[4, 5]]


def test_coarse_blocks_sum_to_what_lies_within_ten_cells() -> None:
    seen_bit = {cell_of(1, 0): 2e6, cell_of(9, 8): 0.5e6, cell_of(-1, -3): 1e6}
    complete = [cell_of(-1, -3), cell_of(5, 5)]
    numbers = looking(wide(), complete, seen_bit)
    # Rows 0..11 are within ten of row 2; columns 0..11 of column 3: all 144 but two are open.
    assert numbers[OPEN_BLOCKS].sum() * 9 == pytest.approx(142.0)
    demand = math.log1p(2.0) + math.log1p(0.5)
    assert numbers[SEEN_BLOCKS].sum() * 3 == pytest.approx(demand)


def test_what_lies_further_than_ten_cells_is_in_no_block() -> None:
    scenario = tiny(uav(5.0), sensors=[(25.0, 25.0, 1.0)], area__cells_per_side=14)
    belief = belief_of(new_beliefs(brief(scenario), 1), 0)
    view = Flight(scenario).look().view
    numbers = encoded(Layout.EGOCENTRIC, scenario, 0, belief, view)
    assert numbers[OPEN_BLOCKS].sum() * 9 == pytest.approx(11.0 * 11.0)


def test_far_blocks_of_nine_cells_a_side_see_further() -> None:
    seen_bit = {cell_of(9, 8): 0.5e6}
    numbers = looking(wide(), [cell_of(5, 5)], seen_bit)
    assert numbers[OPEN_FAR].sum() * 81 == pytest.approx(143.0)
    seen = numbers[SEEN_FAR].reshape(5, 5)
    assert np.argwhere(seen).tolist() == [[3, 3]]  # 5 to 13 cells to the north and to the east
    assert seen[3, 3] == pytest.approx(math.log1p(0.5) / 9)


def test_the_middle_block_is_the_three_by_three_region() -> None:
    near = [cell_of(north, east) for north in (-1, 0, 1) for east in (-1, 0, 1)]
    numbers = looking(wide(), near[:3], {near[4]: 1e6, near[8]: 2e6})
    middle = 3 * 7 + 3
    assert numbers[OPEN_BLOCKS][middle] == pytest.approx(6 / 9)
    assert numbers[SEEN_BLOCKS][middle] == pytest.approx((math.log1p(1.0) + math.log1p(2.0)) / 3)


def test_blocks_lie_south_row_first() -> None:
    seen = looking(wide(), [], {cell_of(5, 0): 9e6})[SEEN_BLOCKS].reshape(7, 7)
    assert np.argwhere(seen).tolist() == [[5, 3]]
    assert seen[5, 3] == pytest.approx(math.log1p(9.0) / 3)
    seen = looking(wide(), [], {cell_of(0, 8): 9e6})[SEEN_BLOCKS].reshape(7, 7)
    assert np.argwhere(seen).tolist() == [[3, 6]]


def test_others_are_shown_where_they_were_last_heard_fading_with_time() -> None:
    scenario = wide(uav(5.0, start=(9, 9)), uav(10.0, start=(9, 9)))
    belief = belief_of(new_beliefs(brief(scenario), 1), 0)
    hear(belief, 2, row_of([0] * SIDE * SIDE), 475.0, 75.0, 50.0)
    view = Flight(scenario).look().view._replace(time_s=150.0)
    numbers = encoded(Layout.EGOCENTRIC, scenario, 0, belief, view)
    peers = numbers[PEERS : PEERS + N_PEERS * PER_PEER].reshape(N_PEERS, PER_PEER)
    assert peers[0].tolist() == [0.5, 0, 0, 0, 0]  # never heard: only its speed is known
    offset = [300.0 / 500.0, -50.0 / 500.0, math.exp(-1.0)]
    assert peers[1].tolist() == pytest.approx([1.0, 1.0, *offset])
    assert (peers[2:] == 0.0).all()


def test_a_uav_that_was_just_heard_is_fresh() -> None:
    numbers = observation(Layout.EGOCENTRIC, tiny())
    assert numbers[PEERS : PEERS + PER_PEER].tolist() == [1.0, 1.0, 0.0, 0.0, 1.0]


# The mask


def mask(scenario: Scenario, hover_s: float) -> list[int]:
    view = Flight(scenario).look().view
    legal = new_row(N_ACTIONS, 0)
    reason_to_go_home(brief(scenario), 0, 0, view, hover_s, legal)
    return [int(legal[action]) for action in range(N_ACTIONS)]


def test_the_mask_has_one_entry_per_action_and_none_for_the_way_home() -> None:
    assert mask(tiny(uav(5.0)), 0.0) == [0, 1, 1, 0, 0]
    assert mask(tiny(uav(5.0, start=(0, 1))), 0.5) == [1, 1, 1, 0, 1]

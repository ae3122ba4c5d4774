"""Samples and paths of tiny missions flown by hand (see tiny_world.py)."""

import itertools
import math

import pytest
from tiny_world import Flight, HOVER_W, MOVE_5_J, MOVE_10_J, tiny, uav
from uav_collect.missions.flight_samples import (
    FlightSampler,
    PathSchedule,
    TimeGrid,
    UavSample,
)
from uav_collect.uav.action_codes import BACKWARD, FORWARD, HOME, HOVER, LEFT, RIGHT


class Sampled(Flight):
    """A mission flown by hand, and sampled."""

    def __init__(self, *uavs: dict[str, object]) -> None:
        super().__init__(tiny(*uavs))
        self.sampler = FlightSampler(self.simulation)

    def fly(self, *actions: int) -> 'Sampled':
        for action in actions:
            event = self.look()
            self.act(event, action)
            self.sampler.note_event(event)
        return self

    def sample(self, time_s: float, index: int = 0) -> UavSample:
        return self.sampler.sample(index, time_s)

    def path_m(self, time_s: float) -> list[tuple[float, float]]:
        return [(corner.x_m, corner.y_m) for corner in self.sampler.path(0, time_s)]


def alone() -> Sampled:
    """One UAV of 10 m/s: 50 m, a cell's side, take 5 s."""
    return Sampled(uav(10.0))


@pytest.mark.parametrize(
    ('action', 'place_m', 'heading_rad'),
    [
        (RIGHT, (85.0, 75.0), 0.0),
        (FORWARD, (75.0, 85.0), math.pi / 2),
        (LEFT, (65.0, 75.0), math.pi),
        (BACKWARD, (75.0, 65.0), -math.pi / 2),
    ],
)
def test_a_uav_on_its_way_is_where_its_speed_has_taken_it_and_looks_ahead(
    action: int, place_m: tuple[float, float], heading_rad: float
) -> None:
    sample = Sampled(uav(10.0, start=(1, 1))).fly(action).sample(1.0)
    assert (sample.x_m, sample.y_m) == pytest.approx(place_m)
    assert sample.heading_rad == pytest.approx(heading_rad)
    assert sample.speed_mps == pytest.approx(10.0)


def test_energy_falls_evenly_along_an_action() -> None:
    flight = alone()
    full_j = flight.simulation.briefing.energy_budget_j[0]
    flight.fly(RIGHT)
    left_j = [full_j - flight.sample(time_s).energy_left_j for time_s in (0.0, 2.5, 5.0)]
    assert left_j == pytest.approx([0.0, MOVE_10_J / 2, MOVE_10_J], abs=1e-3)
    flight.fly(HOVER)
    hovered_j = full_j - flight.sample(5.1).energy_left_j - MOVE_10_J
    assert hovered_j == pytest.approx(0.1 * HOVER_W, rel=1e-3)


def test_a_uav_that_hovers_stays_and_looks_where_it_came_along() -> None:
    sample = alone().fly(FORWARD, RIGHT, BACKWARD, HOVER).sample(15.5)
    assert (sample.x_m, sample.y_m, sample.speed_mps) == (75.0, 25.0, 0.0)
    assert sample.heading_rad == pytest.approx(-math.pi / 2)


def test_a_uav_that_has_not_moved_yet_looks_east() -> None:
    assert alone().sample(0.0).heading_rad == 0.0


def test_the_way_home_is_flown_straight_and_ends_there() -> None:
    flight = alone().fly(RIGHT, FORWARD, HOME)
    sample = flight.sample(10.0 + 0.25 * math.hypot(50.0, 50.0) / 10.0)
    assert (sample.x_m, sample.y_m) == pytest.approx((62.5, 62.5))
    assert sample.heading_rad == pytest.approx(math.radians(-135.0))
    assert not sample.has_landed
    end = flight.sample(flight.simulation.end_s)
    assert (end.x_m, end.y_m, end.speed_mps) == (25.0, 25.0, 0.0)
    assert end.has_landed


def test_each_uav_is_sampled_in_its_own_action() -> None:
    flight = Sampled()  # of 5 and of 10 m/s
    full_j = flight.simulation.briefing.energy_budget_j
    flight.fly(RIGHT, FORWARD)
    first, second = flight.sample(4.0, 0), flight.sample(4.0, 1)
    assert (first.x_m, first.y_m) == pytest.approx((45.0, 25.0))
    assert (second.x_m, second.y_m) == pytest.approx((25.0, 65.0))
    assert full_j[0] - first.energy_left_j == pytest.approx(0.4 * MOVE_5_J, abs=1e-2)


def test_the_path_has_the_corners_alone_and_ends_where_the_uav_is() -> None:
    flight = alone().fly(RIGHT, RIGHT, RIGHT, FORWARD)
    assert flight.path_m(17.0) == [(25.0, 25.0), (175.0, 25.0), (175.0, 45.0)]
    assert [corner.time_s for corner in flight.sampler.path(0, 17.0)] == [0.0, 15.0, 17.0]


def test_a_hover_on_a_straight_path_is_no_corner() -> None:
    flight = alone().fly(RIGHT, HOVER, RIGHT, HOME)
    assert flight.path_m(flight.simulation.time_s) == [(25.0, 25.0), (125.0, 25.0)]


def test_a_grid_hands_each_of_its_times_out_once() -> None:
    grid = TimeGrid(4.0)
    assert [*grid.due(0.0)] == [0.0]
    assert [*grid.due(0.2)] == []
    assert [*grid.due(0.8)] == [0.25, 0.5, 0.75]
    assert [*grid.due(0.8)] == []
    assert [*grid.due(1.0)] == [1.0]


def test_a_grid_of_no_rate_has_no_times() -> None:
    assert [*TimeGrid(0.0).due(100.0)] == []


def test_a_long_path_is_published_more_rarely() -> None:
    schedule = PathSchedule()
    published_s = [time_s for time_s in map(float, range(1000)) if schedule.is_due(time_s)]
    assert published_s[:3] == [0.0, 2.0, 4.0]
    later_s = [time_s for time_s in published_s if time_s > 100.0]
    growths = [after / before for before, after in itertools.pairwise(later_s)]
    assert all(1.05 <= growth < 1.06 for growth in growths)


@pytest.mark.parametrize('duration_s', [300, 3_000, 30_000])
def test_all_publications_together_are_some_twenty_paths(duration_s: int) -> None:
    schedule = PathSchedule()
    published_s = [time_s for time_s in map(float, range(duration_s)) if schedule.is_due(time_s)]
    assert sum(published_s) < 25 * duration_s

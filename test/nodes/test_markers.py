"""The pictures for viewers, of tiny missions flown by hand (see tiny_world.py)."""

from collections.abc import Iterable, Sequence

import pytest
from tiny_world import CELL_A, CELL_B, Flight, HOVER_W, MOVE_10_J, tiny, uav
from uav_collect.missions.simulation import Event, Simulation
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import BACKWARD, BY_POLICY, FORWARD, HOME, HOVER, LEFT, RIGHT
from uav_collect.uav.messages import Decision

serialization = pytest.importorskip('rclpy.serialization')
Time = pytest.importorskip('builtin_interfaces.msg').Time
from uav_collect.nodes.world import markers as viewers

Marker = viewers.Marker
STAMP = Time(sec=12, nanosec=500)


class Watched(Flight):
    """A mission flown by hand, with a viewer."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.viewers = viewers.MissionMarkers(build_site(scenario))
        self.viewers.begin(self.simulation)

    def step(self, action: int) -> Event:
        event = self.look()
        self.viewers.note_event(event, self.act(event, action))
        return event

    def fly(self, *actions: int) -> 'Watched':
        for action in actions:
            self.step(action)
        return self

    def markers(self, time_s: float | None = None) -> list[Marker]:
        now_s = self.simulation.time_s if time_s is None else time_s
        return list(self.viewers.markers(now_s, STAMP).markers)

    def marker(self, namespace: str, number: int = 0, time_s: float | None = None) -> Marker:
        named = [marker for marker in self.markers(time_s) if marker.ns == namespace]
        return next(marker for marker in named if marker.id == number)

    def grid(self) -> list[int]:
        return list(self.viewers.completed_cells(STAMP).data)

    def cells(self, value: int) -> set[int]:
        return {cell for cell, known in enumerate(self.grid()) if known == value}


def alone(speed_mps: float = 10.0) -> Watched:
    return Watched(tiny(uav(speed_mps)))


def points(marker: Marker) -> list[tuple[float, float, float]]:
    assert marker.action == (Marker.ADD if marker.points else Marker.DELETE)
    return [(point.x, point.y, point.z) for point in marker.points]


def sensor_field(marker: Marker) -> list[tuple[float, float]]:
    return [(x_m, y_m) for x_m, y_m, _ in points(marker)]


def sensors(watched: Watched, state: str) -> list[tuple[float, float, float]]:
    namespace = f'sensors_{state}'
    return sorted(
        place for marker in watched.markers() if marker.ns == namespace for place in points(marker)
    )


def near(expected: Iterable[Sequence[float]]) -> list[object]:
    return [pytest.approx(place) for place in expected]


# Where and when


def test_every_marker_is_in_the_map_frame_at_the_time_given() -> None:
    for marker in Watched(tiny()).fly(RIGHT).markers():
        assert (marker.header.frame_id, marker.header.stamp) == ('map', STAMP)
        assert (marker.lifetime.sec, marker.lifetime.nanosec) == (0, 0)


def test_every_picture_has_the_same_markers_each_once() -> None:
    watched = Watched(tiny())
    first = [(marker.ns, marker.id, marker.type) for marker in watched.markers()[1:]]
    assert len(set(first)) == len(first)
    watched.fly(RIGHT, RIGHT, RIGHT)
    assert [(marker.ns, marker.id, marker.type) for marker in watched.markers()] == first


def test_the_first_picture_of_a_mission_wipes_out_what_was_shown() -> None:
    watched = Watched(tiny())
    for _ in range(2):
        watched.viewers.begin(watched.simulation)
        assert watched.markers()[0].action == Marker.DELETEALL
        assert Marker.DELETEALL not in {marker.action for marker in watched.markers()}


def test_a_new_mission_starts_without_the_last_ones_paths_and_cells() -> None:
    watched = alone().fly(RIGHT, HOVER, FORWARD)
    watched.viewers.begin(Flight(tiny(uav(10.0))).simulation)
    assert points(watched.marker('paths', 1)) == []
    assert points(watched.marker('hover_points')) == []
    assert watched.cells(viewers.UNKNOWN) == set(range(16))


def test_the_messages_are_valid_to_ros() -> None:
    watched = Watched(tiny()).fly(RIGHT, RIGHT, HOVER)
    markers = watched.markers()
    array = viewers.MarkerArray(markers=markers)
    received = serialization.deserialize_message(
        serialization.serialize_message(array), viewers.MarkerArray
    )
    sizes = [(marker.ns, marker.id, len(marker.points)) for marker in received.markers]
    assert sizes == [(marker.ns, marker.id, len(marker.points)) for marker in markers]
    grid = watched.viewers.completed_cells(STAMP)
    assert serialization.serialize_message(grid)


# The site


def test_the_cells_are_lines_across_the_area() -> None:
    lines = sensor_field(alone().marker('cells'))
    assert len(lines) == 2 * 2 * 5
    assert {(0.0, 50.0), (200.0, 50.0), (150.0, 0.0), (150.0, 200.0)} <= set(lines)
    assert {value for place in lines for value in place} == {0.0, 50.0, 100.0, 150.0, 200.0}


def test_homes_are_where_the_uavs_will_land() -> None:
    watched = Watched(tiny(uav(5.0), uav(5.0, (3, 3), (120.0, 80.0))))
    assert points(watched.marker('homes')) == [(25.0, 25.0, 0.0), (120.0, 80.0, 0.0)]


def test_a_sensor_waits_until_a_hover_claims_its_data() -> None:
    watched = alone()
    at_a, at_b = (75.0, 25.0, 0.0), (125.0, 125.0, 0.0)
    assert sensors(watched, 'waiting') == [at_a, at_b, at_b]
    assert sensors(watched, 'collected') == []
    watched.fly(RIGHT)
    assert sensors(watched, 'waiting') == [at_a, at_b, at_b]
    watched.fly(HOVER)
    assert sensors(watched, 'waiting') == [at_b, at_b]
    assert sensors(watched, 'collected') == [at_a]


def test_a_sensor_that_never_had_data_is_neither() -> None:
    watched = Watched(tiny(uav(), sensors=[(75.0, 25.0, 0.0), (125.0, 125.0, 1.0)]))
    assert sensors(watched, 'without_data') == [(75.0, 25.0, 0.0)]
    assert sensors(watched, 'waiting') == [(125.0, 125.0, 0.0)]


def test_a_sensor_with_more_data_is_larger() -> None:
    places = [(10.0, 10.0, 0.1), (20.0, 10.0, 0.4), (30.0, 10.0, 0.6), (40.0, 10.0, 1.0)]
    watched = Watched(tiny(uav(), sensors=places))
    markers = [marker for marker in watched.markers() if marker.ns == 'sensors_waiting']
    shown = sorted((points(marker)[0], marker.scale.x) for marker in markers)
    assert [place[0] for place, _ in shown] == [10.0, 20.0, 30.0, 40.0]
    assert [size_m for _, size_m in shown] == sorted({size_m for _, size_m in shown})


def test_the_states_of_sensors_differ_in_colour() -> None:
    colours = {
        marker.ns: (marker.color.r, marker.color.g, marker.color.b)
        for marker in alone().markers()
        if marker.ns.startswith('sensors_')
    }
    assert len(colours) == len(set(colours.values())) == 3


# The fleet


def test_a_uav_is_shown_between_two_cells_while_it_flies() -> None:
    watched = alone().fly(RIGHT)
    assert points(watched.marker('uavs', time_s=2.0)) == near([(45.0, 25.0, 100.0)])
    assert points(watched.marker('uavs', time_s=9.0)) == near([(75.0, 25.0, 100.0)])


def test_a_path_runs_through_its_turns_to_where_the_uav_is() -> None:
    watched = alone().fly(FORWARD, FORWARD, RIGHT)
    path = sensor_field(watched.marker('paths', 1, time_s=11.0))
    assert path == near([(25.0, 25.0), (25.0, 125.0), (35.0, 125.0)])


def test_a_path_keeps_the_place_where_it_turned_back() -> None:
    watched = alone().fly(RIGHT, HOVER, LEFT, FORWARD)
    path = sensor_field(watched.marker('paths', 1))
    assert path == near([(25.0, 25.0), (75.0, 25.0), (25.0, 25.0), (25.0, 25.0)])


def test_a_path_ends_with_the_straight_way_home() -> None:
    watched = alone().fly(RIGHT, FORWARD, RIGHT, HOME)
    path = sensor_field(watched.marker('paths', 1, time_s=watched.simulation.end_s))
    assert path == near([(25.0, 25.0), (75.0, 25.0), (75.0, 75.0), (125.0, 75.0), (25.0, 25.0)])


def test_looking_twice_adds_nothing_to_paths_and_hover_points() -> None:
    watched = alone().fly(RIGHT, HOVER, FORWARD, LEFT)
    for namespace, number in (('paths', 1), ('hover_points', 0)):
        once = points(watched.marker(namespace, number))
        assert points(watched.marker(namespace, number)) == once


def test_each_uav_has_its_own_path() -> None:
    watched = Watched(tiny()).fly(RIGHT, FORWARD)
    assert sensor_field(watched.marker('paths', 1, time_s=5.0))[-1] == pytest.approx((50.0, 25.0))
    assert sensor_field(watched.marker('paths', 2, time_s=5.0))[-1] == pytest.approx((25.0, 75.0))


def test_hover_points_are_where_uavs_hovered() -> None:
    watched = alone().fly(RIGHT)
    assert points(watched.marker('hover_points')) == []
    watched.fly(HOVER, FORWARD)
    assert points(watched.marker('hover_points')) == [(75.0, 25.0, 100.0)]


def test_a_list_of_several_colours_has_one_for_each_point() -> None:
    watched = Watched(tiny()).fly(RIGHT, RIGHT, HOVER)
    for marker in watched.markers():
        assert len(marker.colors) in (0, len(marker.points)), marker.ns


def test_a_uav_has_one_colour_of_its_own_everywhere() -> None:
    watched = Watched(load('paper_10x10', {'fleet.uavs': [{'speed_mps': 5.0}] * 64}))
    colours = [(colour.r, colour.g, colour.b) for colour in watched.marker('uavs').colors]
    assert len(set(colours)) == 64
    assert watched.marker('homes').colors == watched.marker('uavs').colors
    assert watched.marker('paths', 64).color == watched.marker('uavs').colors[63]


def test_uavs_in_contact_are_linked() -> None:
    watched = Watched(tiny(uav(5.0), uav(10.0), radio__contact_range_m=60.0)).fly(RIGHT, FORWARD)
    link = points(watched.marker('radio_links', time_s=4.0))
    assert link == near([(45.0, 25.0, 100.0), (25.0, 65.0, 100.0)])
    assert watched.simulation.contacts(0, 4.0) == [1]


def test_uavs_out_of_range_and_landed_ones_are_not_linked() -> None:
    watched = Watched(tiny(uav(5.0), uav(10.0), radio__contact_range_m=10.0)).fly(RIGHT, FORWARD)
    assert points(watched.marker('radio_links', time_s=4.0)) == []
    landed = Watched(tiny()).fly(HOME, HOME)
    assert points(landed.marker('radio_links')) == []


def test_a_label_follows_its_uav_and_tells_its_energy() -> None:
    watched = alone()
    assert watched.marker('labels', 1).text == '1: 1000.0 kJ'
    watched.fly(RIGHT)
    label = watched.marker('labels', 1, time_s=2.5)
    assert label.text == f'1: {1000.0 - MOVE_10_J / 2e3:.1f} kJ'
    assert (label.pose.position.x, label.pose.position.y) == pytest.approx((50.0, 25.0))
    assert label.pose.position.z > 100.0


def test_a_label_never_tells_less_energy_than_the_action_leaves() -> None:
    watched = alone().fly(RIGHT)
    text = watched.marker('labels', 1, time_s=60.0).text
    assert text == f'1: {1000.0 - MOVE_10_J / 1e3:.1f} kJ'


def test_the_energy_shown_is_that_of_the_simulation_at_every_decision() -> None:
    watched = alone(5.0).fly(RIGHT, HOVER)
    for action in (FORWARD, RIGHT, FORWARD):
        event = watched.look()
        shown = watched.marker('labels', 1, time_s=event.view.time_s).text
        assert shown == f'1: {event.view.energy_left_j / 1e3:.1f} kJ'
        watched.viewers.note_event(event, watched.act(event, action))


def test_a_hover_uses_the_power_of_hovering() -> None:
    watched = Watched(tiny(uav(10.0), sensors=[(75.0, 25.0, 100.0)])).fly(RIGHT, HOVER)
    spent_j = MOVE_10_J + HOVER_W * 10.0
    text = watched.marker('labels', 1, time_s=15.0).text  # the hover began at 5 s
    assert text == f'1: {1000.0 - spent_j / 1e3:.1f} kJ'


def test_a_label_says_who_flies_home_and_who_has_landed() -> None:
    watched = alone().fly(RIGHT, HOME)
    assert watched.marker('labels', 1).text.endswith(' kJ, flies home')
    end_s = watched.simulation.end_s
    assert watched.marker('labels', 1, time_s=end_s).text.endswith(' kJ, landed')


# The grid


def test_the_grid_covers_the_area_from_its_south_west_corner() -> None:
    grid = alone().viewers.completed_cells(STAMP)
    assert (grid.header.frame_id, grid.header.stamp) == ('map', STAMP)
    assert (grid.info.resolution, grid.info.width, grid.info.height) == (50.0, 4, 4)
    origin = grid.info.origin
    assert (origin.position.x, origin.position.y, origin.orientation.w) == (0.0, 0.0, 1.0)
    assert len(grid.data) == 16


def test_the_grid_of_an_area_with_closed_cells_shows_them() -> None:
    zone = [[[60.0, 60.0], [90.0, 60.0], [90.0, 90.0]]]
    flight = Watched(tiny(uav(5.0), area__rows=3, area__columns=5, area__no_fly=zone))
    grid = flight.viewers.completed_cells(STAMP)
    assert (grid.info.width, grid.info.height, len(grid.data)) == (5, 3, 15)
    assert flight.cells(viewers.CLOSED) == {6}
    assert flight.cells(viewers.UNKNOWN) == {*range(15)} - {6}


def test_a_path_turns_where_the_way_home_does() -> None:
    start = uav(5.0, start=(2, 2), home_m=(25.0, 25.0))
    zone = [[[60.0, 60.0], [140.0, 60.0], [140.0, 90.0]]]
    flight = Watched(tiny(start, area__rows=3, area__columns=5, area__no_fly=zone))
    event = flight.look()
    home = Decision(action=HOME, reason=BY_POLICY)
    flight.simulation.start(event, home)
    flight.viewers.note_event(event, home)
    path = points(flight.marker('paths', 1, time_s=30.0))
    assert [place[:2] for place in path] == [(125.0, 125.0), (25.0, 125.0), (25.0, 75.0)]


def test_nothing_is_known_before_the_first_look() -> None:
    assert alone().cells(viewers.UNKNOWN) == set(range(16))


def test_a_cell_seen_is_complete_or_has_data() -> None:
    watched = alone().fly(FORWARD)
    assert watched.cells(viewers.COMPLETE) == {0, 4, 5}
    assert watched.cells(viewers.DATA_SEEN) == {CELL_A}


def test_a_cell_has_data_until_its_hover_has_ended() -> None:
    watched = alone().fly(RIGHT, HOVER)
    assert CELL_A in watched.cells(viewers.DATA_SEEN)
    watched.fly(FORWARD)
    assert CELL_A in watched.cells(viewers.COMPLETE)
    assert CELL_B not in watched.cells(viewers.COMPLETE)


def test_the_grid_joins_what_uavs_out_of_range_know() -> None:
    fleet = [uav(5.0), uav(5.0, (3, 3))]
    watched = Watched(tiny(*fleet, radio__contact_range_m=10.0)).fly(FORWARD, BACKWARD)
    assert watched.cells(viewers.COMPLETE) == {0, 4, 5, 11, 14, 15}
    assert watched.cells(viewers.DATA_SEEN) == {CELL_A, CELL_B}


def test_a_fleet_that_knows_everything_leaves_no_cell_open() -> None:
    watched = alone().fly(RIGHT, HOVER, FORWARD, FORWARD, RIGHT, HOVER, BACKWARD)
    assert watched.cells(viewers.UNKNOWN) == {3}
    watched.fly(HOME)
    assert watched.cells(viewers.COMPLETE) == set(range(16))


def test_a_scenario_with_hundreds_of_sensors_needs_few_markers() -> None:
    site = build_site(load('paper_20x20'))
    drawn = viewers.MissionMarkers(site)
    drawn.begin(Simulation(site, 0))
    markers = drawn.markers(0.0, STAMP).markers
    assert len(markers) < 25
    shown = sum(len(marker.points) for marker in markers if marker.ns.startswith('sensors'))
    assert shown == site.n_sensors

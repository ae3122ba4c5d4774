"""What RViz and Foxglove show of a mission: one array of markers and one grid of cells.

Metres east, north and up of the area's south-west corner, in the frame `map`. A viewer and rclpy
handle one marker of 400 points far better than 400 markers, so whatever can be is a list; what
does not change from one picture to the next is built once and handed out again.
"""

from array import array
import colorsys
from dataclasses import dataclass, field
from typing import Any

from geometry_msgs.msg import Point, Pose, Vector3
from nav_msgs.msg import MapMetaData, OccupancyGrid
import numpy as np
from std_msgs.msg import ColorRGBA, Header
from uav_collect.missions.simulation import Event, Simulation
from uav_collect.scenario.area import open_cells
from uav_collect.scenario.site import Site
from uav_collect.uav import action_codes, actions
from uav_collect.uav.messages import Decision
from uav_collect.uav.view import VIEW_CELLS
from visualization_msgs.msg import Marker, MarkerArray

FRAME = 'map'

# Values of the grid, as viewers colour them.
COMPLETE = 0  # on the map of at least one UAV
DATA_SEEN = 100  # not so, but a UAV saw data wait there
UNKNOWN = -1
CLOSED = 50  # no UAV may fly there

_GREY = ColorRGBA(r=0.55, g=0.55, b=0.55, a=0.5)
_WHITE = ColorRGBA(r=1.0, g=1.0, b=1.0, a=1.0)
_ORANGE = ColorRGBA(r=1.0, g=0.6, b=0.1, a=1.0)
_GREEN = ColorRGBA(r=0.2, g=0.75, b=0.35, a=1.0)
_CLEAR_WHITE = ColorRGBA(r=1.0, g=1.0, b=1.0, a=0.7)

# Sizes in parts of a cell's side.
_GRID_LINE = 0.02
_EMPTY_SENSOR = 0.04
_SENSORS = (0.06, 0.09, 0.12, 0.15)  # up to a quarter, a half, ... of the largest amount of data
_HOME = 0.3
_HOVER_POINT = 0.14
_UAV = 0.26
_PATH = 0.05
_RADIO_LINK = 0.03
_LABEL = 0.3

_PHASES = ('', ', flies home', ', landed')


@dataclass
class _UavTrack:
    """The way of one UAV through the mission, as its events have drawn it."""

    energy_j: float  # left when its running action began
    start_s: float = 0.0  # of the running action
    power_w: float = 0.0
    corners: list[Any] = field(default_factory=list)  # where its path turned, the last place last
    hovered: list[Any] = field(default_factory=list)


class MissionMarkers:
    """Draws missions of one scenario.

    The node calls `begin` for each mission and `note_event` for each event, which costs next to
    nothing; `markers` and `completed_cells` do the work, as often as the node wants pictures.
    """

    def __init__(self, site: Site) -> None:
        """Build what all missions have in common."""
        scenario = site.scenario
        self._area = scenario.area
        self._closed: list[int] = np.flatnonzero(open_cells(scenario.area) == 0).tolist()
        self._cell_of_sensor: list[int] = site.cell.tolist()
        self._sensor_points = [_point(x_m, y_m, 0.0) for x_m, y_m in site.position_m.tolist()]
        self._colours = [_colour(uav) for uav in range(scenario.n_uavs)]
        self._grid = self._marker('cells', Marker.LINE_LIST, _GRID_LINE, _GREY)
        _fill(self._grid, self._grid_lines())
        self._homes = self._marker('homes', Marker.CUBE_LIST, _HOME)
        _fill(self._homes, [_point(*uav.home_m, 0.0) for uav in scenario.uavs], self._colours)

    def begin(self, simulation: Simulation) -> None:
        """Draw this mission from now on."""
        self._simulation = simulation
        budgets_j = simulation.briefing.energy_budget_j
        self._tracks = [_UavTrack(energy_j=budgets_j[uav]) for uav in range(len(self._colours))]
        self._noted: list[tuple[Event, Decision]] = []
        self._cells_with_data = {
            cell
            for cell, bit in zip(self._cell_of_sensor, simulation.demand_bit, strict=True)
            if bit > 0.0
        }
        self._cells_visited: set[int] = set()
        self._cells_seen: set[int] = set()  # -1 for all outside the area
        self._waiting_bit: list[float] = []
        self._sensors: list[Any] = []
        self._is_first = True

    def note_event(self, event: Event, decision: Decision) -> None:
        """Take note of an event, right after its decision was carried out."""
        self._noted.append((event, decision))

    def markers(self, time_s: float, stamp: Any) -> MarkerArray:
        """The mission at a time: site, paths so far, UAVs, radio links.

        Args:
            time_s: simulated time, not before the latest event noted.
            stamp: the same as a ROS time.

        Returns:
            Markers of the same namespaces and ids each time; those with nothing to show are
            deletions. Valid until the next call, which changes them.
        """
        self._update_tracks()
        uavs = range(len(self._tracks))
        positions_m = [self._simulation.position_m(uav, time_s) for uav in uavs]
        places = [_point(x_m, y_m, self._area.altitude_m) for x_m, y_m in positions_m]
        flying = [
            self._homes,
            self._hover_points(),
            *self._paths(places, time_s),
            self._radio_links(places, time_s),
            self._uavs(places),
            *self._labels(places, time_s),
        ]
        markers = [self._grid, *self._sensor_markers(), *flying]
        if self._is_first:  # what an earlier run showed may have had more UAVs
            markers.insert(0, Marker(header=Header(frame_id=FRAME), action=Marker.DELETEALL))
            self._is_first = False
        for marker in markers:
            marker.header.stamp = stamp
        return MarkerArray(markers=markers)

    def completed_cells(self, stamp: Any) -> OccupancyGrid:
        """What the fleet knows, all UAVs taken together, row 0 south.

        Args:
            stamp: now, as a ROS time.

        Returns:
            By cell COMPLETE, DATA_SEEN, UNKNOWN or CLOSED. A cell stays DATA_SEEN while it is
            served: it is complete when the UAV knows that nothing is left.
        """
        self._update_tracks()
        maps = [self._simulation.known_complete(uav) for uav in range(len(self._tracks))]
        values = [COMPLETE if any(known) else UNKNOWN for known in zip(*maps, strict=True)]
        for cell in self._cells_seen & self._cells_with_data:
            if values[cell] == UNKNOWN:
                values[cell] = DATA_SEEN
        area = self._area
        for cell in self._closed:
            values[cell] = CLOSED
        info = MapMetaData(
            map_load_time=stamp,
            resolution=area.cell_size_m,
            width=area.n_columns,
            height=area.n_rows,
        )
        header = Header(frame_id=FRAME, stamp=stamp)
        return OccupancyGrid(header=header, info=info, data=array('b', values))

    def _update_tracks(self) -> None:
        """Draw the events noted since the last picture into the tracks."""
        briefing = self._simulation.briefing
        for event, decision in self._noted:
            view, track = event.view, self._tracks[event.uav]
            is_hover = decision.action == action_codes.HOVER
            powers_w = briefing.hover_power_w if is_hover else briefing.flight_power_w
            track.energy_j, track.start_s = view.energy_left_j, view.time_s
            track.power_w = powers_w[event.uav]
            place = _point(view.x_m, view.y_m, self._area.altitude_m)
            _lengthen(track.corners, place)
            if is_hover:
                track.hovered.append(place)
            self._see_around(view.cell)
        self._noted.clear()

    def _see_around(self, cell: int) -> None:
        if cell in self._cells_visited:
            return
        self._cells_visited.add(cell)
        briefing = self._simulation.briefing
        for index in range(VIEW_CELLS):
            seen = actions.neighbour(briefing, cell, index // 3 - 1, index % 3 - 1)
            self._cells_seen.add(seen)

    def _sensor_markers(self) -> list[Any]:
        """Sensors by state and amount of data; a hover claims the data of a whole cell."""
        waiting_bit = self._simulation.waiting_bit()
        if waiting_bit != self._waiting_bit:
            self._waiting_bit = waiting_bit
            self._sensors = self._sorted_sensors()
        return self._sensors

    def _sorted_sensors(self) -> list[Any]:
        demand_bit = self._simulation.demand_bit
        step_bit = max(demand_bit) / len(_SENSORS) or 1.0
        without: list[Any] = []
        waiting: list[list[Any]] = [[] for _ in _SENSORS]
        collected: list[list[Any]] = [[] for _ in _SENSORS]
        for point, cell, bit in zip(
            self._sensor_points, self._cell_of_sensor, demand_bit, strict=True
        ):
            if bit <= 0.0:
                without.append(point)
                continue
            points = waiting if self._waiting_bit[cell] > 0.0 else collected
            points[min(int(bit / step_bit), len(_SENSORS) - 1)].append(point)
        return [
            self._spheres('sensors_without_data', 0, _EMPTY_SENSOR, _GREY, without),
            *(
                self._spheres(name, number, size, colour, points[number])
                for name, colour, points in (
                    ('sensors_waiting', _ORANGE, waiting),
                    ('sensors_collected', _GREEN, collected),
                )
                for number, size in enumerate(_SENSORS)
            ),
        ]

    def _spheres(
        self, namespace: str, number: int, size: float, colour: Any, points: list[Any]
    ) -> Any:
        marker = self._marker(namespace, Marker.SPHERE_LIST, size, colour, number)
        _fill(marker, points)
        return marker

    def _hover_points(self) -> Any:
        marker = self._marker('hover_points', Marker.SPHERE_LIST, _HOVER_POINT)
        points, colours = [], []
        for track, colour in zip(self._tracks, self._colours, strict=True):
            points += track.hovered
            colours += [colour] * len(track.hovered)
        _fill(marker, points, colours)
        return marker

    def _paths(self, places: list[Any], time_s: float) -> list[Any]:
        paths, above_m = [], self._area.altitude_m
        for uav, track in enumerate(self._tracks):
            path = self._marker('paths', Marker.LINE_STRIP, _PATH, self._colours[uav], uav + 1)
            turns = self._simulation.turns(uav, time_s)
            turned = [_point(*place_m, above_m) for _, place_m in turns]
            _fill(path, [*track.corners, *turned, places[uav]] if track.corners else [])
            paths.append(path)
        return paths

    def _radio_links(self, places: list[Any], time_s: float) -> Any:
        marker = self._marker('radio_links', Marker.LINE_LIST, _RADIO_LINK, _CLEAR_WHITE)
        ends = []
        for uav, place in enumerate(places):
            for other in self._simulation.contacts(uav, time_s):
                if other > uav:
                    ends += [place, places[other]]
        _fill(marker, ends)
        return marker

    def _uavs(self, places: list[Any]) -> Any:
        marker = self._marker('uavs', Marker.SPHERE_LIST, _UAV)
        _fill(marker, places, self._colours)
        return marker

    def _labels(self, places: list[Any], time_s: float) -> list[Any]:
        labels = []
        for uav, place in enumerate(places):
            label = self._marker('labels', Marker.TEXT_VIEW_FACING, _LABEL, _WHITE, uav + 1)
            above_m = place.z + _LABEL * self._area.cell_size_m
            label.pose = Pose(position=_point(place.x, place.y, above_m))
            phase = _PHASES[self._simulation.phase(uav, time_s)]
            label.text = f'{uav + 1}: {self._energy_left_j(uav, time_s) / 1e3:.1f} kJ{phase}'
            labels.append(label)
        return labels

    def _energy_left_j(self, uav: int, time_s: float) -> float:
        track = self._tracks[uav]
        used_j = track.power_w * (time_s - track.start_s)
        return max(track.energy_j - used_j, self._simulation.energy_left_j(uav))

    def _grid_lines(self) -> list[Any]:
        area, lines = self._area, []
        for border in range(area.n_columns + 1):
            at_m = border * area.cell_size_m
            lines += [_point(at_m, 0.0, 0.0), _point(at_m, area.height_m, 0.0)]
        for border in range(area.n_rows + 1):
            at_m = border * area.cell_size_m
            lines += [_point(0.0, at_m, 0.0), _point(area.width_m, at_m, 0.0)]
        return lines

    def _marker(
        self, namespace: str, kind: int, size: float, colour: Any = _WHITE, number: int = 0
    ) -> Any:
        size_m = size * self._area.cell_size_m
        return Marker(
            header=Header(frame_id=FRAME),
            ns=namespace,
            id=number,
            type=kind,
            scale=Vector3(x=size_m, y=size_m, z=size_m),
            color=colour,
        )


def _fill(marker: Any, points: list[Any], colours: list[Any] | None = None) -> None:
    """Give a list marker its points, or delete it: viewers complain of a list without any."""
    marker.points = points
    marker.colors = colours or []
    marker.action = Marker.ADD if points else Marker.DELETE


def _lengthen(corners: list[Any], place: Any) -> None:
    """Add the next place of a path, in lieu of the last one where the path went straight on."""
    if corners and (corners[-1].x, corners[-1].y) == (place.x, place.y):
        return
    if len(corners) > 1:
        before, last = corners[-2:]
        east_m, north_m = last.x - before.x, last.y - before.y
        then_east_m, then_north_m = place.x - last.x, place.y - last.y
        turns = east_m * then_north_m != north_m * then_east_m
        if not turns and east_m * then_east_m + north_m * then_north_m > 0.0:
            corners.pop()
    corners.append(place)


def _point(x_m: float, y_m: float, z_m: float) -> Any:
    return Point(x=float(x_m), y=float(y_m), z=float(z_m))


def _colour(uav: int) -> Any:
    """A bright colour; the golden ratio keeps the hues of any number of UAVs apart."""
    red, green, blue = colorsys.hsv_to_rgb((0.55 + 0.618034 * uav) % 1.0, 0.65, 1.0)
    return ColorRGBA(r=red, g=green, b=blue, a=1.0)

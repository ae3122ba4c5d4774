"""One UAV's flight as items of a MAVLink mission, and the two kinds of files that hold them.

Take-off, speed, a waypoint at each corner, a stay where the UAV hovers, a waypoint over home,
landing. Altitudes are relative to the place of take-off. A stay has whole seconds, rounded up:
some autopilots know no others, and what is rounded down would cut off an upload.

Source: MAV_CMD and MAV_FRAME of MAVLink's common message set; the file formats of QGroundControl
(plan files, version 1) and of MAVLink (plain-text missions, QGC WPL 110).
"""

from collections.abc import Iterator
from dataclasses import dataclass
import json
import math

from uav_collect.analysis.legs import HOVER_LEG
from uav_collect.errors import MissionLogError
from uav_collect.handover.flights import MissionFlights, UavFlight
from uav_collect.handover.outlines import NO_FLY, outlines
from uav_collect.scenario.model import Point

# MAV_CMD
NAV_WAYPOINT = 16
NAV_LOITER_TIME = 19
NAV_RETURN_TO_LAUNCH = 20
NAV_LAND = 21
NAV_TAKEOFF = 22
DO_CHANGE_SPEED = 178
# MAV_FRAME
GLOBAL = 0
MISSION = 2
GLOBAL_RELATIVE_ALT = 3

_GROUND_SPEED = 1.0  # SPEED_TYPE
_AS_IT_IS = -1.0  # of the throttle
_RELATIVE = 1  # QGroundControl's altitude mode
_PX4 = 12  # MAV_AUTOPILOT
_QUADROTOR = 2  # MAV_TYPE
_LEAST_S = 1e-6  # of a stay: less is rounding


@dataclass(frozen=True, kw_only=True)
class MissionItem:
    """One command of a mission."""

    command: int
    frame: int = GLOBAL_RELATIVE_ALT
    params: tuple[float | None, ...] = (0.0, 0.0, 0.0, None)  # None: as the autopilot thinks fit
    lat_deg: float = 0.0
    lon_deg: float = 0.0
    altitude_m: float = 0.0  # over the place of take-off


def mission_items(mission: MissionFlights, flight: UavFlight) -> tuple[MissionItem, ...]:
    """What the autopilot of one UAV has to do.

    Raises:
        ConfigError: it is not known where on Earth the area lies.
        MissionLogError: the log lacks decisions between others of the UAV.
    """
    gap = next((stretch for stretch in flight.stretches if stretch.is_after_gap), None)
    if gap is not None:
        raise MissionLogError(
            f'{mission.name}: UAV {flight.uav}: the recording lacks what it decided before its'
            f' action at {gap.start_s:.1f} s: must be there from the start on for plan and mavlink'
        )
    return tuple(_items(mission, flight))


def _items(mission: MissionFlights, flight: UavFlight) -> Iterator[MissionItem]:
    yield _at(mission, flight.take_off_m, NAV_TAKEOFF)
    speed = (_GROUND_SPEED, flight.speed_mps, _AS_IT_IS, 0.0)
    yield MissionItem(command=DO_CHANGE_SPEED, frame=MISSION, params=speed)
    for stretch, after in zip(flight.stretches, [*flight.stretches[1:], None], strict=True):
        if stretch.kind == HOVER_LEG:
            stay_s = float(math.ceil(stretch.end_s - stretch.start_s - _LEAST_S))
            yield _at(mission, stretch.end_m, NAV_LOITER_TIME, (stay_s, 0.0, 0.0, None))
        elif after is None or after.kind != HOVER_LEG:  # else the stay is flown to
            yield _at(mission, stretch.end_m, NAV_WAYPOINT)
    if flight.has_landed:
        landing = _at(mission, flight.stretches[-1].end_m, NAV_LAND)
        yield MissionItem(command=NAV_LAND, lat_deg=landing.lat_deg, lon_deg=landing.lon_deg)
    else:
        params = (0.0, 0.0, 0.0, 0.0)
        yield MissionItem(command=NAV_RETURN_TO_LAUNCH, frame=MISSION, params=params)


def _at(
    mission: MissionFlights,
    place_m: Point,
    command: int,
    params: tuple[float | None, ...] = (0.0, 0.0, 0.0, None),
) -> MissionItem:
    lat_deg, lon_deg = mission.lat_lon_deg(place_m)
    return MissionItem(
        command=command,
        params=params,
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        altitude_m=mission.altitude_m,
    )


def waypoint_file(mission: MissionFlights, flight: UavFlight) -> bytes:
    """The mission of one UAV as a text file of MAVLink; its first line is the home position."""
    home = _at(mission, flight.take_off_m, NAV_WAYPOINT)
    items = [
        MissionItem(
            command=NAV_WAYPOINT, frame=GLOBAL, lat_deg=home.lat_deg, lon_deg=home.lon_deg
        ),
        *mission_items(mission, flight),
    ]
    lines = ['QGC WPL 110', *(_line(number, item) for number, item in enumerate(items))]
    return '\n'.join([*lines, '']).encode()


def _line(number: int, item: MissionItem) -> str:
    # Nan would leave the yaw to the autopilot, as null does in a plan, but Mission Planner refuses
    # a file with it. ArduPilot's copters ignore the yaw of these commands; PX4 turns to the north.
    params = [f'{param or 0.0:.8f}' for param in item.params]
    place = f'{item.lat_deg:.8f}', f'{item.lon_deg:.8f}', f'{item.altitude_m:.6f}'
    is_current = int(number == 0)
    return '\t'.join(map(str, (number, is_current, item.frame, item.command, *params, *place, 1)))


def plan_file(mission: MissionFlights, flight: UavFlight) -> bytes:
    """The mission of one UAV as a plan of QGroundControl."""
    home = mission.lat_lon_deg(flight.take_off_m)
    items = mission_items(mission, flight)
    document = {
        'fileType': 'Plan',
        'groundStation': 'QGroundControl',
        'version': 1,
        'geoFence': {'circles': [], 'polygons': _fences(mission), 'version': 2},
        'rallyPoints': {'points': [], 'version': 2},
        'mission': {
            'version': 2,
            'firmwareType': _PX4,
            'vehicleType': _QUADROTOR,
            'cruiseSpeed': flight.speed_mps,
            'hoverSpeed': flight.speed_mps,
            'globalPlanAltitudeMode': _RELATIVE,
            'plannedHomePosition': [*home, 0.0],
            'items': [_plan_item(number, item) for number, item in enumerate(items, start=1)],
        },
    }
    return (json.dumps(document, indent=2, allow_nan=False) + '\n').encode()


def _fences(mission: MissionFlights) -> list[dict[str, object]]:
    """The no-fly zones, which the autopilot then keeps out of, too; latitudes first."""
    return [
        {
            'inclusion': False,
            'polygon': [[lat_deg, lon_deg] for lon_deg, lat_deg in outline.ring_deg[:-1]],
            'version': 1,
        }
        for outline in outlines(mission)
        if outline.name == NO_FLY
    ]


def _plan_item(number: int, item: MissionItem) -> dict[str, object]:
    place = [item.lat_deg, item.lon_deg, item.altitude_m]
    values: dict[str, object] = {
        'type': 'SimpleItem',
        'autoContinue': True,
        'command': item.command,
        'doJumpId': number,
        'frame': item.frame,
        'params': [*item.params, *place],
    }
    if item.frame == MISSION:
        return values
    return values | {
        'Altitude': item.altitude_m,
        'AltitudeMode': _RELATIVE,
        'AMSLAltAboveTerrain': None,
    }

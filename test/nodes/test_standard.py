"""What the bag of two missions in a row has for standard tools, flown as fast as possible."""

from collections.abc import Iterator
import itertools
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

for needed in ('rclpy', 'uav_collect_msgs'):
    pytest.importorskip(needed)

from fleets import Fleet, scenario_of, stamp_s
from mcap.reader import make_reader
from processes import Processes, ros_environment
from rclpy.serialization import deserialize_message
from ros_domains import own_domain
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import NavSatStatus
from uav_collect.nodes import topics
from uav_collect.nodes.world.markers import FRAME
from uav_collect.recording.bag_reader import read_missions
from uav_collect.recording.mission_log import MissionLog, read

pytestmark = pytest.mark.ros

SEEDS = (6, 7)
RATE_HZ = 4.0
PERIOD_S = 10.0
REFERENCE = {'lat_deg': 55.0, 'lon_deg': 12.8, 'position_m': [0.0, 0.0]}
STAMP_S = 1e-9
REAL_TF_HASH = 'RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087'


class Kept(NamedTuple):
    """One message of the bag."""

    log_s: float
    message: Any


class Recorded:
    """The bag of both missions, and their logs."""

    def __init__(self, fleet: Fleet) -> None:
        self.scenario, self.bag = fleet.scenario, fleet.bag
        self.logs: list[MissionLog] = [read(fleet.log_file(seed)) for seed in SEEDS]
        self.kept: dict[str, list[Kept]] = {}
        types = {topic.name: topic.message for topic in topics.fleet_topics(2)}
        with AnyReader([fleet.bag]) as reader:
            self.hashes = {it.msgtype: it.digest for it in reader.connections}
            for connection, log_ns, content in reader.messages():
                message = deserialize_message(content, types[connection.topic])
                self.kept.setdefault(connection.topic, []).append(Kept(log_ns / 1e9, message))

    def of_first(self, topic: str) -> list[Kept]:
        """The messages on a topic of the first mission."""
        return [kept for kept in self.kept[topic] if kept.log_s <= self.ends_s[0]]

    @property
    def ends_s(self) -> list[float]:
        """What the clock showed as each mission ended."""
        missions = self.kept['/world/mission']
        return [stamp_s(kept.message.stamp) for kept in missions if kept.message.phase == 1]


def stamp_of(message: Any) -> Any:  # noqa: ANN401
    """The stamp of a message of any type that has one, in simulated time."""
    if hasattr(message, 'clock'):
        return message.clock
    for parts in ('transforms', 'markers'):
        message = getattr(message, parts, [message])[0]
    return getattr(message, 'header', message).stamp


def actions(log: MissionLog, uav: int) -> Any:  # noqa: ANN401 - rows of the log
    """The actions of a UAV, by its id, in order."""
    return log.events[log.events['uav'] == uav]


def place_m(log: MissionLog, uav: int, home_m: Any, time_s: float) -> Any:  # noqa: ANN401
    """Where a UAV was by the log: each action ends where the next one begins, the last at home."""
    own = actions(log, uav)
    times_s = np.append(own['time_s'], own['time_s'][-1] + own['duration_s'][-1])
    corners = [(own[axis], home_m[index]) for index, axis in enumerate(('x_m', 'y_m'))]
    return [np.interp(time_s, times_s, np.append(*corner)) for corner in corners]


def turns(stops: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """The stops of a way at which it does not go straight on."""
    return [
        here
        for (before, here), (_, after) in itertools.pairwise(itertools.pairwise(stops))
        if heading_rad(before, here) != heading_rad(here, after)
    ]


def heading_rad(start: tuple[float, float], end: tuple[float, float]) -> float:
    return math.atan2(end[1] - start[1], end[0] - start[0])


def energy_left_j(log: MissionLog, uav: int, time_s: float) -> float:
    """What a UAV had left by the log."""
    own = actions(log, uav)
    action = own[max(0, int(np.searchsorted(own['time_s'], time_s, side='right')) - 1)]
    share = min(1.0, (time_s - action['time_s']) / (action['duration_s'] or math.inf))
    return float(action['energy_left_j'] - share * action['energy_j'])


@pytest.fixture(scope='module')
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Recorded]:
    folder: Path = tmp_path_factory.mktemp('standard')
    with own_domain() as domain, pytest.MonkeyPatch.context() as patch:
        for name, value in ros_environment(domain, folder / 'ros_log').items():
            patch.setenv(name, value)
        processes = Processes(folder, {'ROS_DOMAIN_ID': str(domain)})
        scenario = scenario_of(area__reference=REFERENCE)
        fleet = Fleet(processes=processes, scenario=scenario, folder=folder / 'run')
        try:
            recorder = fleet.start_recorder(stop_after_missions=len(SEEDS))
            fleet.start_agents()
            world = fleet.start_world(
                seed=SEEDS[0],
                missions=len(SEEDS),
                recorders=1,
                sample_rate_hz=RATE_HZ,
                picture_period_s=PERIOD_S,
            )
            assert world.wait_for_exit() == 0
            assert recorder.wait_for_exit() == 0, recorder.output
        finally:
            processes.close()
        yield Recorded(fleet)


def test_each_uav_is_sampled_at_the_rate_in_simulated_time(recorded: Recorded) -> None:
    first_s, second_s = recorded.ends_s
    n_first = math.floor(first_s * RATE_HZ) + 1
    n_second = math.floor((second_s - first_s) * RATE_HZ)  # it begins where the first one ended
    for topic in ('/tf', '/uav_1/odometry', '/uav_2/battery', '/uav_1/fix'):
        assert len(recorded.kept[topic]) == n_first + n_second + 2  # and the ends
    for kept in recorded.kept['/tf']:
        assert [it.child_frame_id for it in kept.message.transforms] == [
            'uav_1/base_link',
            'uav_2/base_link',
        ]
    times_s = [kept.log_s for kept in recorded.of_first('/tf')]
    assert times_s[:-1] == pytest.approx([number / RATE_HZ for number in range(n_first)])
    assert times_s[-1] == pytest.approx(first_s, abs=STAMP_S)


def test_the_uavs_are_where_the_log_says(recorded: Recorded) -> None:
    log = recorded.logs[0]
    for kept in recorded.of_first('/tf'):
        for uav, transform in enumerate(kept.message.transforms, start=1):
            home_m = recorded.scenario.uavs[uav - 1].home_m
            place = transform.transform.translation
            expected = place_m(log, uav, home_m, kept.log_s)
            assert [place.x, place.y] == pytest.approx(expected, abs=1e-6)
            assert place.z == recorded.scenario.area.altitude_m
            assert transform.header.frame_id == FRAME


def test_odometry_tells_the_same_with_heading_and_speed(recorded: Recorded) -> None:
    transforms = [kept.message.transforms[1] for kept in recorded.kept['/tf']]
    odometry = [kept.message for kept in recorded.kept['/uav_2/odometry']]
    for transform, one in zip(transforms, odometry, strict=True):
        assert one.header == transform.header
        place, turn = one.pose.pose.position, one.pose.pose.orientation
        moved = transform.transform.translation
        assert (place.x, place.y, place.z) == (moved.x, moved.y, moved.z)
        assert turn == transform.transform.rotation
        assert turn.z**2 + turn.w**2 == pytest.approx(1.0)
    speed_mps = recorded.scenario.uavs[1].speed_mps
    headings_rad = []
    for before, after in itertools.pairwise(odometry[: len(recorded.of_first('/tf')) - 1]):
        here, then = before.pose.pose.position, after.pose.pose.position
        east_m, north_m = then.x - here.x, then.y - here.y
        if math.hypot(east_m, north_m) == pytest.approx(speed_mps / RATE_HZ):  # no turn between
            turn = after.pose.pose.orientation
            headings_rad.append(2.0 * math.atan2(turn.z, turn.w))
            ahead = (math.cos(headings_rad[-1]), math.sin(headings_rad[-1]))
            along_m = east_m * ahead[0] + north_m * ahead[1]
            assert along_m == pytest.approx(speed_mps / RATE_HZ)
            assert after.twist.twist.linear.x == pytest.approx(speed_mps)
    assert len({round(heading_rad, 6) for heading_rad in headings_rad}) > 1


def test_the_battery_holds_what_the_log_says(recorded: Recorded) -> None:
    for uav in (1, 2):
        budget_j = recorded.scenario.uavs[uav - 1].energy_budget_j
        for kept in recorded.of_first(f'/uav_{uav}/battery'):
            expected_j = energy_left_j(recorded.logs[0], uav, kept.log_s)
            assert kept.message.percentage * budget_j == pytest.approx(expected_j, rel=1e-6)
            unknown = (kept.message.voltage, kept.message.charge, kept.message.capacity)
            assert all(map(math.isnan, unknown))


def test_the_way_ends_at_home_and_turns_where_the_log_says(recorded: Recorded) -> None:
    for uav in (1, 2):
        *_, last = recorded.of_first(f'/uav_{uav}/path')
        way = [(pose.pose.position.x, pose.pose.position.y) for pose in last.message.poses]
        own = actions(recorded.logs[0], uav)
        home_m = recorded.scenario.uavs[uav - 1].home_m
        places = [*zip(own['x_m'].tolist(), own['y_m'].tolist(), strict=True), tuple(home_m)]
        stops = [place for place, _ in itertools.groupby(places)]  # hovering moves no UAV
        corners = [stops[0], *turns(stops), stops[-1]]
        assert len(corners) > 2
        assert way == [pytest.approx(corner) for corner in corners]


def test_a_fix_is_where_the_scenario_lies_on_earth(recorded: Recorded) -> None:
    assert recorded.scenario.area.reference is not None
    for kept, moved in zip(recorded.kept['/uav_1/fix'], recorded.kept['/tf'], strict=True):
        place = moved.message.transforms[0].transform.translation
        expected = recorded.scenario.area.reference.lat_lon_deg(place.x, place.y)
        assert (kept.message.latitude, kept.message.longitude) == expected
        assert kept.message.altitude == recorded.scenario.area.altitude_m
        assert kept.message.status.status == NavSatStatus.STATUS_FIX


def test_stamped_messages_are_logged_at_their_stamps(recorded: Recorded) -> None:
    for topic, kept in recorded.kept.items():
        for log_s, message in kept:
            if topic in ('/world/scenario', '/diagnostics'):  # stamped by the wall clock
                continue
            inner = (
                message.transforms if topic == '/tf' else getattr(message, 'markers', [message])
            )
            about = getattr(inner[0], 'header', inner[0])
            sent_s = stamp_s(message.clock if topic == '/clock' else about.stamp)
            if topic.endswith('/radio_rx'):  # stamped by its sender, but logged as it is heard
                assert log_s >= sent_s - STAMP_S
            else:
                assert log_s == pytest.approx(sent_s, abs=STAMP_S), topic


def test_messages_of_other_uavs_are_logged_in_the_order_in_which_they_are_heard(
    recorded: Recorded,
) -> None:
    missions: dict[str, list[int]] = {}
    for _, message in recorded.kept['/uav_1/radio_rx']:
        missions.setdefault(message.mission_id, []).append(message.delivery)
    assert len(missions) == len(SEEDS)
    for deliveries in missions.values():
        assert deliveries == [*range(1, len(deliveries) + 1)]


def test_the_bag_spans_both_missions_and_nothing_else(recorded: Recorded) -> None:
    first_s, second_s = recorded.ends_s
    times_s = [kept.log_s for every in recorded.kept.values() for kept in every]
    assert min(times_s) == 0.0
    assert max(times_s) == pytest.approx(second_s, abs=STAMP_S)
    assert first_s < second_s


def test_pictures_come_often_enough_to_follow_the_mission(recorded: Recorded) -> None:
    for topic in ('/world/markers', '/world/completed_cells'):
        times_s = [kept.log_s for kept in recorded.kept[topic]]
        gaps_s = [after - before for before, after in itertools.pairwise(times_s)]
        assert max(gaps_s) <= PERIOD_S + 1e-6


def test_there_are_no_more_clock_messages_than_events_need(recorded: Recorded) -> None:
    n_events = sum(len(log.events) for log in recorded.logs)
    assert len(recorded.kept['/clock']) <= n_events + 2 * len(SEEDS) + 1


def test_the_transforms_are_of_the_type_that_tf2_reads(recorded: Recorded) -> None:
    assert recorded.hashes['tf2_msgs/msg/TFMessage'] == REAL_TF_HASH


def test_the_bag_is_read_by_others_in_the_order_of_time(recorded: Recorded) -> None:
    with (recorded.bag / f'{recorded.bag.name}.mcap').open('rb') as file:
        times_ns = [message.log_time for _, _, message in make_reader(file).iter_messages()]
    assert times_ns == sorted(times_ns)
    assert len(times_ns) == sum(map(len, recorded.kept.values()))
    assert [mission.is_complete for mission in read_missions(recorded.bag)] == [True, True]

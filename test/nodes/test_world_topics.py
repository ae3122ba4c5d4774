"""What a world publishes of a mission: every topic agrees with the log that it writes."""

from collections.abc import Iterator
import math
from typing import Any

import numpy as np
import pytest

for needed in ('rclpy', 'uav_collect_msgs'):
    pytest.importorskip(needed)

from fleets import Fleet, logs, scenario_of, stamp_s
from processes import Processes, ros_environment
from ros_domains import own_domain
from scripted_agent_node import scripted_agents, ScriptedAgents
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.nodes import topics
from uav_collect.nodes.convert import uav_ids
from uav_collect.nodes.world import markers
from uav_collect.recording.log_model import EVENT_DTYPE
from uav_collect.recording.mission_log import header_from_line, MissionLog, read
from uav_collect.scenario.load import from_yaml
from uav_collect.uav.messages import unpacked_map
from uav_collect_msgs.msg import Command, Epoch, Mission

pytestmark = pytest.mark.ros

SEED = 6


class Flown:
    """A mission of two UAVs that are in contact now and then, and all that was published of it."""

    def __init__(self, fleet: Fleet, pilot: ScriptedAgents, result: Any) -> None:  # noqa: ANN401
        self.scenario = fleet.scenario
        self.result = result
        self.log: MissionLog = read(fleet.log_file(SEED))
        self.log_bytes = fleet.log(SEED)
        self.heard = pilot.heard
        self.epochs: list[Any] = pilot.heard[topics.EPOCH.name]
        self.missions: list[Any] = pilot.heard[topics.MISSION.name]


@pytest.fixture(scope='module')
def flown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Flown]:
    folder = tmp_path_factory.mktemp('flown')
    with own_domain() as domain, pytest.MonkeyPatch.context() as patch:
        for name, value in ros_environment(domain, folder / 'ros_log').items():
            patch.setenv(name, value)
        processes = Processes(folder, {'ROS_DOMAIN_ID': str(domain)})
        fleet = Fleet(processes=processes, scenario=scenario_of(), folder=folder / 'run')
        try:
            with scripted_agents() as pilot:
                pilot.listen(topics.MARKERS)
                pilot.listen(topics.COMPLETED_CELLS)
                world = fleet.start_world(seed=SEED, viewer_rate_hz=60.0)
                pilot.join(1)
                pilot.join(2)
                result = pilot.fly_on()
                for topic in (topics.MARKERS, topics.COMPLETED_CELLS, topics.EPOCH):
                    pilot.wait_until(lambda topic=topic: _is_last(pilot.heard[topic.name], result))
                assert world.wait_for_exit() == 0
                yield Flown(fleet, pilot, result)
        finally:
            processes.close()


def _is_last(heard: list[Any], result: Any) -> bool:  # noqa: ANN401
    """Whether all of a mission has come on a topic."""
    if not heard:
        return False
    if hasattr(heard[-1], 'terminal'):
        return bool(heard[-1].terminal)
    shown = heard[-1] if hasattr(heard[-1], 'header') else heard[-1].markers[-1]
    return bool(shown.header.stamp == result.stamp)


def test_the_log_is_that_of_the_same_mission_in_one_process(flown: Flown) -> None:
    assert [flown.log_bytes] == logs(flown.scenario, [SEED])


def test_there_is_one_epoch_for_each_event_with_the_fields_of_its_log(flown: Flown) -> None:
    assert len(flown.epochs) == len(flown.log.events)
    for epoch, event in zip(flown.epochs, flown.log.events, strict=True):
        for name in EVENT_DTYPE.names or ():
            value = getattr(epoch, name)
            expected = uav_ids(int(event[name])) if name == 'heard' else event[name]
            assert (list(value) if name == 'heard' else value) == expected, name


def test_only_the_last_epoch_is_terminal(flown: Flown) -> None:
    assert [epoch.terminal for epoch in flown.epochs] == [
        *[False] * (len(flown.epochs) - 1),
        True,
    ]


def test_the_fleet_in_an_epoch_is_where_the_log_says(flown: Flown) -> None:
    for epoch in flown.epochs:
        own = epoch.uav - 1
        assert (epoch.uav_x_m[own], epoch.uav_y_m[own]) == (epoch.x_m, epoch.y_m)
        assert epoch.uav_energy_left_j[own] == epoch.energy_left_j - epoch.energy_j
        is_home = epoch.action == Command.RETURN_HOME
        assert epoch.uav_phase[own] in (
            [Epoch.FLYING_HOME, Epoch.LANDED] if is_home else [Epoch.ACTIVE]
        )
        own_map = np.reshape(epoch.uav_complete, (2, -1))[own]
        assert sum(unpacked_map(own_map, flown.scenario.n_cells)) == epoch.known_complete


def test_what_uavs_hold_for_complete_grows_and_is_complete_in_truth(flown: Flown) -> None:
    before = np.zeros((2, flown.scenario.n_cells), dtype=bool)
    for epoch in flown.epochs:
        packed = np.reshape(epoch.uav_complete, (2, -1))
        known = np.array([unpacked_map(one, flown.scenario.n_cells) for one in packed], dtype=bool)
        truth = np.array(unpacked_map(epoch.true_complete, flown.scenario.n_cells), dtype=bool)
        assert (known >= before).all()
        assert (truth >= known).all()
        before = known


def test_radio_messages_are_delivered_in_contact_only(flown: Flown) -> None:
    for receiver in (1, 2):
        delivered = flown.heard[topics.uav_topics(receiver).radio_rx.name]
        expected = [
            sender
            for epoch in flown.epochs
            for sender in ((3 - receiver,) if len(epoch.heard) else ())
        ]
        assert [message.sender for message in delivered] == expected
        assert [message.delivery for message in delivered] == list(range(1, len(expected) + 1))
    assert 0 < sum(len(epoch.heard) for epoch in flown.epochs) < len(flown.epochs)


def test_the_mission_is_published_at_its_start_and_with_metrics_at_its_end(
    flown: Flown,
) -> None:
    start, end = flown.missions
    expected = mission_metrics(flown.log)
    assert [start.phase, end.phase] == [Mission.STARTED, Mission.ENDED]
    assert header_from_line(start.log_header) == flown.log.header
    assert math.fsum(start.demand_bit) == start.total_bit == flown.log.header.total_bit
    assert (start.n_decisions, len(start.uavs)) == (0, 0)
    assert stamp_s(end.stamp) == pytest.approx(expected.completion_s, abs=1e-9)
    assert (end.seed, end.index, end.note) == (SEED, 0, '')
    assert end.collected_bit == expected.collected_bit
    assert end.efficiency_bit_per_j == expected.efficiency_bit_per_j
    assert end.n_decisions == expected.n_decisions
    assert [uav.energy_j for uav in end.uavs] == list(expected.uav_energy_j)
    radio = [flown.heard[topics.uav_topics(uav).radio_rx.name] for uav in (1, 2)]
    assert end.n_radio_messages == sum(map(len, radio))


def test_the_scenario_on_the_air_stands_alone(flown: Flown) -> None:
    (published,) = flown.heard[topics.SCENARIO.name]
    assert from_yaml(published.yaml) == flown.scenario
    assert (
        len(published.sensor_id) == len(published.sensor_x_m) == len(flown.missions[0].demand_bit)
    )


def test_the_clock_shows_the_time_of_the_decisions(flown: Flown) -> None:
    times_s = [stamp_s(message.clock) for message in flown.heard[topics.CLOCK.name]]
    known_s = np.append(flown.log.events['time_s'], mission_metrics(flown.log).completion_s)
    assert times_s == sorted(times_s)
    assert np.abs(np.subtract.outer(times_s, known_s)).min(axis=1).max() < 1e-8


def test_viewers_are_shown_the_mission_to_its_end(flown: Flown) -> None:
    pictures, grids = (flown.heard[t.name] for t in (topics.MARKERS, topics.COMPLETED_CELLS))
    maps = np.reshape(flown.epochs[-1].uav_complete, (2, -1))
    known = np.any([unpacked_map(one, flown.scenario.n_cells) for one in maps], axis=0)
    assert [value == markers.COMPLETE for value in grids[-1].data] == known.tolist()
    assert {marker.header.frame_id for marker in pictures[-1].markers} == {markers.FRAME}
    paths = [marker for marker in pictures[-1].markers if marker.ns == 'paths']
    assert [len(path.points) > 10 for path in paths] == [True, True]

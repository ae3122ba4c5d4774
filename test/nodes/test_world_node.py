"""The world node as a process: how it starts, for whom it waits, what it says, how it ends."""

from collections.abc import Iterator
import math
from pathlib import Path
import time
from typing import Any

import numpy as np
import pytest

for needed in ('rclpy', 'uav_collect_msgs'):
    pytest.importorskip(needed)

from fleets import Fleet, logs, parameters, scenario_of
from processes import own_domain, Processes, ros_environment
from scripted_agent_node import stand_in, StandIn
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.limits import MAX_SEED
from uav_collect.nodes import topics
from uav_collect.nodes.convert import uav_ids, unpacked_map
from uav_collect.nodes.topics import publisher
from uav_collect.nodes.world import markers
from uav_collect.recording.mission_log import EVENT_DTYPE, header_from_line, MissionLog, read
from uav_collect.scenario.load import from_yaml
from uav_collect_msgs.msg import Command, Epoch, Mission, Scenario, UavFigures
from uav_collect_msgs.srv import ControlMission

pytestmark = pytest.mark.ros

SEED = 6
START, ABORT = ControlMission.Request.START, ControlMission.Request.ABORT


@pytest.fixture
def pilot(ros_domain: int) -> Iterator[StandIn]:
    with stand_in() as there:
        yield there


@pytest.fixture
def fleet(processes: Processes, tmp_path: Path) -> Fleet:
    return Fleet(processes=processes, scenario=scenario_of(1), folder=tmp_path / 'run')


# How it starts


@pytest.mark.parametrize(
    ('values', 'complaint'),
    [
        ({'scenario': 'no_such'}, 'no_such'),
        ({'seed': -1}, 'seed'),
        ({'seed': 'seven'}, 'seed'),
        ({'missions': -2}, 'missions'),
        ({'viewer_rate_hz': 100.0}, 'viewer_rate_hz'),
        ({'real_time_factor': -1.0}, 'real_time_factor'),
        ({'decision_timeout_s': 0.0}, 'decision_timeout_s'),
        ({'output_dir': '/dev/null/run'}, 'output_dir'),
    ],
    ids=lambda value: '_'.join(value) if isinstance(value, dict) else '',
)
def test_a_parameter_that_does_not_fit_is_refused_in_one_line(
    values: dict[str, object], complaint: str, processes: Processes
) -> None:
    world = processes.start('world_sim', *parameters(**values))
    assert world.wait_for_exit() == 2
    (line,) = world.output.splitlines()
    assert line.startswith('error: ')
    assert complaint in line


def test_a_parameter_file_that_is_no_yaml_is_refused(processes: Processes, tmp_path: Path) -> None:
    file = tmp_path / 'nodes.yaml'
    file.write_text('world_sim: [')
    world = processes.start('world_sim', '--ros-args', '--params-file', str(file))
    assert world.wait_for_exit() == 2
    assert 'Traceback' not in world.output


def test_a_fleet_that_cannot_start_is_refused_before_anybody_waits(
    processes: Processes, tmp_path: Path
) -> None:
    scenario = scenario_of(2, fleet__default__energy_budget_kj=1.1)
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    world = fleet.start_world()
    assert world.wait_for_exit() == 2
    (line,) = world.output.splitlines()
    assert 'UAV 1 has 1.1 kJ' in line


@pytest.mark.parametrize('came', ['later', 'earlier'])
def test_of_two_worlds_the_later_one_gives_way(came: str, fleet: Fleet, pilot: StandIn) -> None:
    world = fleet.start_world()
    world.wait_for('waiting for UAV 1')
    scenarios = pilot.heard[topics.SCENARIO.name]
    pilot.wait_until(lambda: bool(scenarios))
    rival = Scenario(stamp=scenarios[0].stamp, world_instance='rival', yaml='name: other\n')
    rival.stamp.sec += 1 if came == 'later' else -1
    publisher(pilot.node, topics.SCENARIO).publish(rival)
    if came == 'later':
        pilot.wait_until(lambda: pilot.has_told('came later and has to give way'))
        assert int(pilot.told('second world')) == 1
        pilot.join(1)
        assert pilot.fly_on().phase == Mission.ENDED
        assert world.wait_for_exit() == 0
    else:
        pilot.wait_until(lambda: pilot.has_told('this one gives way'))
        assert world.wait_for_exit() == 1
    assert 'another world_sim flies scenario other in this ROS domain' in world.output


def test_it_says_for_whom_it_waits_and_starts_once_all_are_there(
    processes: Processes, tmp_path: Path, pilot: StandIn
) -> None:
    fleet = Fleet(processes=processes, scenario=scenario_of(3), folder=tmp_path / 'run')
    world = fleet.start_world(viewer_rate_hz=0.0)
    world.wait_for('waiting for UAV 1, UAV 2, UAV 3')
    pilot.join(2)
    world.wait_for('waiting for UAV 1, UAV 3')
    pilot.join(1)
    pilot.join(3)
    world.wait_for('mission .* starts, seed 0')


# Who does not answer


def test_uavs_without_an_agent_fly_home_at_once_if_the_world_need_not_wait(
    processes: Processes, tmp_path: Path, pilot: StandIn
) -> None:
    fleet = Fleet(processes=processes, scenario=scenario_of(2), folder=tmp_path / 'run')
    world = fleet.start_world(wait_for_agents=False)
    pilot.join(1)
    result = pilot.fly_on()
    assert world.wait_for_exit() == 0
    assert result.failsafe_used
    assert result.note == 'the failsafe flew home: UAV 2'
    outcomes = [(uav.outcome, uav.decisions) for uav in result.uavs]
    assert outcomes[1] == (UavFigures.FAILSAFE, 0)
    assert outcomes[0][0] != UavFigures.FAILSAFE
    absent = read(fleet.log_file(0)).header.uavs[1]
    assert (absent.policy, absent.allocator) == ('none', 'none')


def test_a_uav_whose_agent_does_not_answer_in_time_is_flown_home_and_told(
    fleet: Fleet, pilot: StandIn
) -> None:
    world = fleet.start_world(seed=SEED, decision_timeout_s=2.0)
    pilot.join(1)
    for _ in range(3):
        turn = pilot.next_turn()
        assert turn is not None
        pilot.answer(turn)
    last = pilot.next_turn()
    assert last is not None
    world.wait_for('UAV 1: no answer to decision 3 within 2 s; the failsafe flies it home')
    missions = pilot.heard[topics.MISSION.name]
    pilot.wait_until(lambda: len(missions) == 2)
    observations = pilot.heard[topics.uav_topics(1).observation.name]
    pilot.wait_until(lambda: observations[-1].terminated)
    assert missions[-1].failsafe_used
    assert missions[-1].uavs[0].decisions == 3
    assert world.wait_for_exit() == 0
    assert mission_metrics(read(fleet.log_file(SEED))).failsafe_used


def test_a_full_disk_is_said_once_and_the_mission_goes_on(fleet: Fleet, pilot: StandIn) -> None:
    fleet.folder.mkdir()
    fleet.log_file(SEED).symlink_to('/dev/full')
    world = fleet.start_world(seed=SEED, missions=2)
    pilot.join(1)
    while (turn := pilot.next_turn()) is not None and turn.observation.decision < 3:
        pilot.answer(turn)
    pilot.wait_until(lambda: pilot.has_told('the mission log cannot be written'))
    assert turn is not None
    pilot.answer(turn)
    assert pilot.fly_on().phase == Mission.ENDED
    missions = pilot.heard[topics.MISSION.name]
    pilot.wait_until(lambda: len(missions) == 3)
    assert pilot.fly_on().phase == Mission.ENDED
    assert world.wait_for_exit() == 0
    assert world.output.count('the mission log cannot be written') == 1
    assert [fleet.log(SEED + 1)] == logs(fleet.scenario, [SEED + 1])


# On request


def test_missions_start_and_are_aborted_on_request(fleet: Fleet, pilot: StandIn) -> None:
    world = fleet.start_world(missions=0)
    missions = pilot.heard[topics.MISSION.name]
    assert pilot.control(ABORT).message == 'no mission is in flight or about to start'
    assert pilot.control(START, MAX_SEED + 1).message.startswith('the seed must be at most')
    assert pilot.control(7).message == 'command 7 is neither START nor ABORT'
    assert pilot.control(START, SEED).success
    refused = pilot.control(START, SEED)
    assert not refused.success
    assert refused.message == 'a mission is in flight or about to start: abort it first'
    assert pilot.control(ABORT).message == 'the mission that was about to start is called off'
    pilot.join(1)
    assert missions == []

    assert pilot.control(START, SEED).success
    first = pilot.next_turn()
    assert first is not None
    assert not pilot.control(START, SEED).success
    assert pilot.control(ABORT).message == 'the mission is aborted'
    pilot.wait_until(lambda: len(missions) == 2)
    assert (missions[1].phase, missions[1].note) == (Mission.ABORTED, 'aborted by request')
    assert [uav.outcome for uav in missions[1].uavs] == [UavFigures.ABORTED]
    pilot.answer(first)  # too late
    pilot.wait_until(lambda: pilot.has_told('which is not in flight'))

    assert pilot.control(START, SEED + 1).success
    pilot.wait_until(lambda: len(missions) == 3)
    assert pilot.fly_on().phase == Mission.ENDED
    assert world.is_running
    assert fleet.logs([SEED + 1]) == logs(fleet.scenario, [SEED + 1])


def test_a_paced_mission_takes_its_time_to_the_last_landing(fleet: Fleet, pilot: StandIn) -> None:
    factor = 500.0
    world = fleet.start_world(seed=SEED, real_time_factor=factor)
    pilot.join(1)
    first = pilot.next_turn()
    assert first is not None
    start_s = time.monotonic() - 1.0  # generous: it began before its first observation came here
    pilot.answer(first)
    result = pilot.fly_on()
    assert time.monotonic() - start_s >= result.completion_s / factor
    assert world.wait_for_exit() == 0
    assert [fleet.log(SEED)] == logs(fleet.scenario, [SEED])


def test_a_mission_is_cut_off_where_a_learner_has_enough_of_it(
    fleet: Fleet, pilot: StandIn
) -> None:
    world = fleet.start_world(seed=SEED, missions=2, max_decisions=7)
    pilot.join(1)
    epochs, missions = pilot.heard[topics.EPOCH.name], pilot.heard[topics.MISSION.name]
    for n_told in (1, 3):
        pilot.wait_until(lambda n_told=n_told: len(missions) == n_told)
        pilot.fly_on()
    assert world.wait_for_exit() == 0
    pilot.wait_until(lambda: len(epochs) == 16)
    assert [epoch.event for epoch in epochs] == 2 * [*range(8)]
    assert not any(epoch.terminal for epoch in epochs)
    assert [(it.phase, it.note) for it in missions[1::2]] == 2 * [
        (Mission.ABORTED, 'cut off by max_decisions')
    ]
    whole = logs(fleet.scenario, [SEED, SEED + 1])
    assert [log.splitlines()[:9] for log in whole] == [
        log.splitlines() for log in fleet.logs([SEED, SEED + 1])
    ]


# What it publishes


class Flown:
    """A mission of two UAVs that stay in contact now and then, and all that was said of it."""

    def __init__(self, fleet: Fleet, pilot: StandIn, result: Any) -> None:  # noqa: ANN401
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
            with stand_in() as pilot:
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
    """Whether a topic has told all of a mission."""
    if not heard:
        return False
    if hasattr(heard[-1], 'terminal'):
        return bool(heard[-1].terminal)
    shown = heard[-1] if hasattr(heard[-1], 'header') else heard[-1].markers[-1]
    return bool(shown.header.stamp == result.stamp)


def stamp_s(stamp: Any) -> float:  # noqa: ANN401
    return float(stamp.sec + 1e-9 * stamp.nanosec)


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


def test_the_mission_is_told_at_its_start_and_with_its_figures_at_its_end(flown: Flown) -> None:
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
    (told,) = flown.heard[topics.SCENARIO.name]
    assert from_yaml(told.yaml) == flown.scenario
    assert len(told.sensor_id) == len(told.sensor_x_m) == len(flown.missions[0].demand_bit)


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

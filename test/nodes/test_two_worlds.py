"""Worlds with names share a ROS domain: each with its own fleet, none a rival of the others."""

from pathlib import Path

from fleets import Fleet, logs, parameters, scenario_of
from node_starts import refusal
from processes import Processes
import pytest
from uav_collect.recording.bag_reader import read_missions

pytest.importorskip('rclpy')

pytestmark = [pytest.mark.ros, pytest.mark.long]

SEEDS = {'a': 3, 'north/b': 5, '': 7}  # by the name of the world


def test_three_worlds_in_one_domain_fly_their_own_missions(
    processes: Processes, tmp_path: Path
) -> None:
    scenario = scenario_of(2, fleet__default__energy_budget_kj=40.0)
    fleets = {
        world: Fleet(
            processes=processes, scenario=scenario, folder=tmp_path / f'run_{seed}', world=world
        )
        for world, seed in SEEDS.items()
    }
    recorder = fleets['a'].start_recorder(stop_after_missions=1)
    for fleet in fleets.values():
        fleet.start_agents('random')
    running = {world: fleets[world].start_world(seed=seed) for world, seed in SEEDS.items()}
    for world, seed in SEEDS.items():
        assert running[world].wait_for_exit() == 0
        assert [fleets[world].log(seed)] == logs(scenario, [seed], 'random'), world
        assert 'another world_sim' not in running[world].output
    assert recorder.wait_for_exit() == 0
    [recorded] = read_missions(fleets['a'].bag)
    assert recorded.is_complete
    assert recorded.log.to_jsonl() == fleets['a'].log(SEEDS['a'])


def test_a_namespace_given_to_ros_names_the_world_of_world_and_agent(
    processes: Processes, tmp_path: Path
) -> None:
    scenario = scenario_of(2, fleet__default__energy_budget_kj=40.0)
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run', world='a')
    placed = ['--ros-args', '-r', '__ns:=/a']
    processes.start('uav_agent', '--id', '1', *placed)
    processes.start('uav_agent', *parameters(uav=2), '-r', '__ns:=/a/uav_2')
    file = tmp_path / 'scenario.yaml'
    file.write_text(scenario.to_yaml())
    values = parameters(scenario=file, output_dir=fleet.folder, seed=3)
    world = processes.start('world_sim', *values, '-r', '__ns:=/a')
    assert world.wait_for_exit() == 0
    assert [fleet.log(3)] == logs(scenario, [3])


@pytest.mark.parametrize('name', ['1', 'a b', 'a/', '/a'])
@pytest.mark.parametrize('room', ['world', 'agent', 'recorder'])
def test_a_name_that_is_none_for_ros_is_refused(
    room: str, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    *_, line = refusal(room, ['--world', name], capsys)
    assert f"'{name}' must be a ROS name" in line

"""Learned policies flown by processes: the same bytes, dead agents or not; misfits fly nowhere."""

from pathlib import Path

from fleets import Fleet, logs, scenario_of
from node_starts import refusal
from processes import Processes
import pytest
from random_policies import header, saved
from steered_world import steered_world
from uav_collect.limits import FAILED
from uav_collect.recording.bag_messages import messages
from uav_collect.recording.bag_reader import read_missions
from uav_collect.uav.observation import Layout

pytestmark = [pytest.mark.ros, pytest.mark.long]

SEEDS = [3, 4]


@pytest.mark.parametrize(
    ('layout', 'n_uavs', 'allocator'),
    [
        (Layout.EGOCENTRIC, 2, 'exact'),
        (Layout.EGOCENTRIC, 3, 'equal'),
        (Layout.PAPER, 2, 'equal'),
        (Layout.RELATIVE, 3, 'exact'),
    ],
)
def test_missions_over_ros_equal_those_flown_at_once_in_one_process(
    layout: Layout, n_uavs: int, allocator: str, processes: Processes, tmp_path: Path
) -> None:
    scenario = scenario_of(n_uavs, fleet__default__energy_budget_kj=60.0)
    policy = str(saved(tmp_path, 'mine', header(layout, n_uavs=n_uavs), seed=1))
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    fleet.start_agents(policy, allocator)
    world = fleet.start_world(seed=SEEDS[0], missions=len(SEEDS))
    expected = logs(scenario, SEEDS, policy, allocator)
    assert world.wait_for_exit() == 0
    assert fleet.logs(SEEDS) == expected
    assert b'"policy": "mine"' in expected[0]


def test_a_uav_flies_home_where_its_policys_adviser_would(
    processes: Processes, tmp_path: Path
) -> None:
    home = {'cell': [9, 4]}
    places = {'fleet__default__start': home, 'fleet__default__home': home}
    scenario = scenario_of(2, radio__contact_range_m=0.0, **places)
    policy = str(saved(tmp_path, 'mine', header(Layout.RELATIVE, advice_bonus=1e6), seed=1))
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    fleet.start_agents(policy)
    recorder = fleet.start_recorder(stop_after_missions=1)
    world = fleet.start_world(seed=SEEDS[0])
    (expected,), (sweep,) = (logs(scenario, SEEDS[:1], it) for it in (policy, 'sweep'))
    assert world.wait_for_exit() == 0
    assert recorder.wait_for_exit() == 0
    assert fleet.log(SEEDS[0]) == expected
    assert expected.splitlines()[1:] == sweep.splitlines()[1:]  # but for the header
    assert sweep.count(b'"action": "home", "reason": "policy"') == 2
    [mission] = read_missions(fleet.bag)
    assert mission.log.to_jsonl() == expected


@pytest.mark.parametrize('guard_after', [0, pytest.param(30, marks=pytest.mark.nightly)])
def test_a_restarted_agent_remembers_what_its_policy_did_before_it_died(
    guard_after: int, processes: Processes, tmp_path: Path
) -> None:
    scenario = scenario_of(2, fleet__default__energy_budget_kj=150.0)  # some 340 events
    policy = str(saved(tmp_path, 'mine', header(), seed=1))
    (expected,) = logs(scenario, SEEDS[:1], policy, guard_after=guard_after)
    n_guarded = expected.count(b'"reason": "guard"')
    assert (n_guarded > 10) is (guard_after > 0)
    n_events = expected.count(b'\n') - 1
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    recorder = fleet.start_recorder(stop_after_missions=1)
    world = fleet.start_world(seed=SEEDS[0])
    with steered_world() as steered:
        steered.pause()
        agents = fleet.start_agents(policy, guard_after=guard_after)
        for more, uav in ((30, 1), (n_events // 6 - 30, 2), (n_events // 6, 1)):
            steered.step(more)
            agents[uav - 1].kill()
            agents[uav - 1] = fleet.start_agent(uav, policy, guard_after=guard_after)
            agents[uav - 1].wait_for(f'UAV {uav} flies, policy mine')
        steered.resume()
    assert world.wait_for_exit() == 0
    assert recorder.wait_for_exit() in (0, FAILED)  # it may lack the last words of the killed
    [mission] = read_missions(fleet.bag)
    assert mission.log.to_jsonl() == fleet.log(SEEDS[0]) == expected
    *_, (_, ended) = messages(fleet.bag, lambda name: name.endswith('/mission'))
    assert sum(unit.guarded for unit in ended.uavs) == n_guarded


def test_an_agent_says_when_its_policy_flies_outside_what_it_learned_on(
    processes: Processes, tmp_path: Path
) -> None:
    scenario = scenario_of(2, radio__contact_range_m=100.0)
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    agent, _ = fleet.start_agents('paper_10x10_n2_aqmix')
    world = fleet.start_world()
    agent.wait_for(r'outside what it learned on: contact range 100 m \(learned: 200 m\)')
    assert world.wait_for_exit() == 0
    assert agent.output.count('outside') == 1


def test_an_agent_whose_file_is_broken_ends_at_once_with_one_line(
    ros_domain: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = saved(tmp_path, 'mine', header())
    path.write_bytes(path.read_bytes()[:-10])
    (line,) = refusal('agent', ['--id', '1', '--policy', str(path)], capsys)
    assert f'{path}: is not a whole safetensors file' in line


def test_an_agent_whose_policy_does_not_fit_the_scenario_ends_before_anything_flies(
    processes: Processes, tmp_path: Path
) -> None:
    path = saved(tmp_path, 'mine', header(n_uavs=3))
    scenario = scenario_of(2, name='elsewhere')
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    world = fleet.start_world(seed=SEEDS[0])
    for policy, words in (
        (str(path), 'policy mine: n_uavs is 2: must be 3'),
        ('paper_10x10_n6_aqmix', 'n_uavs is 2: must be 6'),
    ):
        agent = fleet.start_agent(1, policy)
        assert agent.wait_for_exit() == 2
        assert words in agent.output
        assert 'Traceback' not in agent.output
    assert world.is_running
    assert fleet.n_events(SEEDS[0]) == 0

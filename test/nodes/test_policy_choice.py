"""Agents that choose their policy by themselves: all the same one, and the fleet flies it."""

from pathlib import Path

from fleets import Fleet, logs
from processes import Processes
import pytest
from tiny_world import tiny, uav
from uav_collect.analysis.choosing import candidates_for, choose
from uav_collect.recording.mission_log import from_jsonl
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site

pytest.importorskip('rclpy')
pytest.importorskip('uav_collect_msgs')

from uav_collect.errors import NodeError, PolicyMismatchError
from uav_collect.nodes.agent.policy_choice import check_choices, PolicyChoice

pytestmark = pytest.mark.ros

SEED = 3


@pytest.fixture
def scenario() -> Scenario:
    return tiny(uav(), uav(10.0), demand__data_mbit=[0.1, 1.0], demand__cell_share=0.5)


def chosen_by(choice: PolicyChoice, scenario: Scenario) -> str:
    policy = choice.policy_for(scenario)
    while policy is None:
        if choice.go_on():
            policy = choice.policy_for(scenario)
    return policy.name


def choice_of(lines: list[str], policy: str = 'best', candidates: str = '') -> PolicyChoice:
    return PolicyChoice(
        policy, candidates=candidates, allocator='exact', guard_after=12, log=lines.append
    )


def test_agents_that_choose_by_themselves_fly_the_same_policy(
    scenario: Scenario, processes: Processes, tmp_path: Path
) -> None:
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    agents = fleet.start_agents('best', candidates='random')
    world = fleet.start_world(seed=SEED)
    assert world.wait_for_exit() == 0
    log = fleet.log(SEED)
    [name] = {each.policy for each in from_jsonl(log).header.uavs}
    assert log == logs(scenario, [SEED], name)[0]
    for agent in agents:
        assert 'choosing among sweep, hert, random by ' in agent.output
        assert f'{name} is the best of 3' in agent.output


def test_an_agent_chooses_as_anybody_does_with_as_many_missions(scenario: Scenario) -> None:
    lines: list[str] = []
    name = chosen_by(choice_of(lines), scenario)
    expected = choose(build_site(scenario), candidates_for(scenario)[0])
    assert name == expected.policy
    assert lines[0] == f'choosing among sweep, hert by {expected.n_missions} missions of each'
    assert lines[1:] == [str(expected)]


def test_a_choice_is_made_once_for_each_scenario(scenario: Scenario) -> None:
    lines: list[str] = []
    choice = choice_of(lines)
    name = chosen_by(choice, scenario)
    assert chosen_by(choice, tiny()) in ('sweep', 'hert')
    n_lines = len(lines)
    again = choice.policy_for(scenario)
    assert again is not None
    assert (again.name, len(lines)) == (name, n_lines)
    assert not choice.is_open


def test_another_scenario_ends_a_choice_for_the_one_before(scenario: Scenario) -> None:
    choice = choice_of([])
    assert choice.policy_for(scenario) is None
    assert choice.is_open
    assert chosen_by(choice, tiny()) in ('sweep', 'hert')


def test_a_policy_that_is_named_needs_no_choice(scenario: Scenario) -> None:
    choice = choice_of([], policy='hert')
    policy = choice.policy_for(scenario)
    assert policy is not None
    assert policy.name == 'hert'
    assert not choice.is_open
    assert not choice.go_on()


def test_a_candidate_that_does_not_fit_is_refused(scenario: Scenario) -> None:
    with pytest.raises(PolicyMismatchError, match='lillgrund_n2_aqmix'):
        choice_of([], candidates='lillgrund_n2_aqmix').policy_for(scenario)


@pytest.mark.parametrize(
    ('policy', 'candidates', 'allocator', 'words'),
    [
        ('nope', '', 'exact', "policy 'nope' is unknown"),
        ('best', 'nope', 'exact', "policy 'nope' is unknown"),
        ('sweep', 'random', 'exact', "candidates is 'random': must be empty unless policy is"),
        ('best', '', 'fair', 'fair'),
    ],
)
def test_what_there_is_not_is_refused_before_a_world_is_waited_for(
    policy: str, candidates: str, allocator: str, words: str
) -> None:
    with pytest.raises(NodeError, match=words):
        check_choices(policy, candidates, allocator)


@pytest.mark.parametrize('policy', ['best', 'strong', 'topic', 'sweep'])
def test_names_that_only_a_world_gives_a_meaning_wait_for_one(policy: str) -> None:
    check_choices(policy, '', 'exact')

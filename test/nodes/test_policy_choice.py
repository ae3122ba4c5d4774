"""Agents that choose their policy by themselves: all the same one, and the fleet flies it."""

from array import array
from dataclasses import replace
import hashlib
from pathlib import Path

from fleets import Fleet, logs
from processes import Processes
import pytest
from random_policies import header, random_policy
from tiny_world import tiny, uav
from uav_collect.analysis.choosing import candidates_for, choose
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.briefing import brief
from uav_collect.uav.observation import Layout
from uav_collect.uav.policy_file import policy_bytes, save_policy
from uav_collect.uav.policy_network import FrozenPolicy

pytest.importorskip('rclpy')
pytest.importorskip('uav_collect_msgs')

from uav_collect.errors import NodeError, PolicyMismatchError
from uav_collect.nodes.agent.policy_choice import check_choices, PolicyChoice
from uav_collect.nodes.world.own_policy import own_policy_msg
from uav_collect_msgs.msg import Policy

pytestmark = pytest.mark.ros

SEED = 3


@pytest.fixture
def scenario() -> Scenario:
    return tiny(uav(), uav(10.0), demand__data_mbit=[0.1, 1.0], demand__cell_share=0.5)


def as_the_sweep(scenario: Scenario) -> FrozenPolicy:
    """A policy that follows the sweep's advice wherever it goes, so that it flies as the sweep."""
    made = header(Layout.RELATIVE, side=scenario.area.n_rows, n_uavs=scenario.n_uavs)
    return random_policy(replace(made, advice_bonus=1e3), scale=0.1)


def message_of(policy: FrozenPolicy) -> Policy:
    content = policy_bytes(policy)
    digest = hashlib.sha256(content).hexdigest()
    return Policy(version=policy.header.version, content=array('B', content), sha256=digest)


def chosen_by(choice: PolicyChoice, scenario: Scenario, own: Policy | None = None) -> str:
    policy = choice.policy_for(scenario, own or Policy())
    while policy is None:
        if choice.go_on():
            policy = choice.policy_for(scenario, own or Policy())
    return policy.name


def choice_of(lines: list[str], policy: str = 'best', candidates: str = '') -> PolicyChoice:
    return PolicyChoice(
        policy, candidates=candidates, allocator='exact', guard_after=12, log=lines.append
    )


def test_agents_that_choose_by_themselves_fly_what_lies_beside_the_scenario_of_the_world(
    scenario: Scenario, processes: Processes, tmp_path: Path
) -> None:
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / scenario.name)
    own = tmp_path / f'{scenario.name}.safetensors'
    save_policy(own, as_the_sweep(scenario))
    agents = fleet.start_agents('best', candidates='random')
    world = fleet.start_world(seed=SEED)
    assert world.wait_for_exit() == 0
    assert fleet.log(SEED) == logs(scenario, [SEED], str(own))[0]
    for agent in agents:
        assert f'choosing among {scenario.name}, sweep, hert, random by ' in agent.output
        assert f'{scenario.name} is the best of 4' in agent.output


def test_an_agent_chooses_as_anybody_does_with_as_many_missions(scenario: Scenario) -> None:
    lines: list[str] = []
    name = chosen_by(choice_of(lines), scenario)
    expected = choose(build_site(scenario), candidates_for(scenario)[0])
    assert name == expected.policy
    assert lines[0] == f'choosing among sweep, hert by {expected.n_missions} missions of each'
    assert [line.splitlines()[0] for line in lines[1:]] == [expected.why]


def test_a_choice_is_made_once_for_each_scenario(scenario: Scenario) -> None:
    lines: list[str] = []
    choice = choice_of(lines)
    name = chosen_by(choice, scenario)
    assert chosen_by(choice, tiny()) in ('sweep', 'hert')
    n_lines = len(lines)
    again = choice.policy_for(scenario, Policy())
    assert again is not None
    assert (again.name, len(lines)) == (name, n_lines)
    assert not choice.is_open


def test_another_scenario_ends_a_choice_for_the_one_before(scenario: Scenario) -> None:
    choice = choice_of([])
    assert choice.policy_for(scenario, Policy()) is None
    assert choice.is_open
    assert chosen_by(choice, tiny()) in ('sweep', 'hert')


def test_a_choice_waits_for_the_word_of_what_was_refined(scenario: Scenario) -> None:
    choice = choice_of([])
    assert choice.policy_for(scenario, None) is None
    assert not choice.is_open


def test_what_was_refined_is_chosen_anew_where_it_is_another(scenario: Scenario) -> None:
    lines: list[str] = []
    choice, own = choice_of(lines), message_of(as_the_sweep(scenario))
    assert chosen_by(choice, scenario) == 'sweep'
    assert chosen_by(choice, scenario, own) == scenario.name  # of two equal ones the earlier
    assert lines[2] == f'choosing among {scenario.name}, sweep, hert by 200 missions of each'


def test_what_was_refined_and_is_damaged_or_unfit_is_left_out_with_a_line(
    scenario: Scenario,
) -> None:
    lines: list[str] = []
    damaged = message_of(as_the_sweep(scenario))
    damaged.content[-1] ^= 1
    unfit = message_of(random_policy(header(side=scenario.area.n_rows, n_uavs=3)))
    for own, words in ((damaged, 'its SHA-256 is '), (unfit, 'n_uavs is 2: must be 3')):
        assert chosen_by(choice_of(lines), scenario, own) == 'sweep'
        assert lines[-3].startswith(f'what was refined for {scenario.name} cannot be chosen: ')
        assert words in lines[-3]


def test_a_world_offers_what_lies_beside_its_scenario_and_can_fly_it(
    scenario: Scenario, tmp_path: Path
) -> None:
    lines: list[str] = []
    file, briefing = tmp_path / 'field.yaml', brief(scenario)
    assert own_policy_msg(str(file), briefing, lines.append) == Policy()
    assert own_policy_msg('paper_10x10', briefing, lines.append) == Policy()
    save_policy(tmp_path / 'field.safetensors', as_the_sweep(scenario))
    offered = own_policy_msg(str(file), briefing, lines.append)
    assert offered == message_of(as_the_sweep(scenario))
    assert lines == []
    (tmp_path / 'field_n2.safetensors').write_text('no policy')  # it would come first
    assert own_policy_msg(str(file), briefing, lines.append) == offered
    save_policy(tmp_path / 'field.safetensors', random_policy(header(n_uavs=3)))
    assert own_policy_msg(str(file), briefing, lines.append) == Policy()
    assert len(lines) == 3
    assert f'it cannot be chosen: {tmp_path / "field.safetensors"}: ' in lines[-1]


def test_a_policy_that_is_named_needs_no_choice(scenario: Scenario) -> None:
    choice = choice_of([], policy='hert')
    policy = choice.policy_for(scenario, Policy())
    assert policy is not None
    assert policy.name == 'hert'
    assert not choice.is_open
    assert not choice.go_on()


def test_a_candidate_that_does_not_fit_is_refused(scenario: Scenario) -> None:
    with pytest.raises(PolicyMismatchError, match='paper_10x10_n4_aqmix'):
        choice_of([], candidates='paper_10x10_n4_aqmix').policy_for(scenario, Policy())


@pytest.mark.parametrize(
    ('policy', 'candidates', 'allocator', 'words'),
    [
        ('nope', '', 'exact', "policy 'nope' is unknown"),
        ('best', 'nope', 'exact', "policy 'nope' is unknown"),
        ('sweep', 'random', 'exact', "candidates is 'random': must be empty unless policy is"),
        ('best', 'random,,hert', 'exact', "candidates are 'random,,hert': must be policies, sep"),
        ('best', ',', 'exact', "candidates are ',': must be policies, separated by commas"),
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
    check_choices('best', 'strong, random', 'exact')

"""Learned policies in flight: alone, in batches, and as users name them."""

from collections.abc import Callable
from functools import partial
import hashlib
from itertools import pairwise, product
from pathlib import Path

from interpreted import interpreted
import pytest
from random_policies import Behind, header, random_policy, saved
from tiny_world import tiny
from uav_collect.analysis.metrics import check_log, mission_metrics
from uav_collect.errors import in_one_line, PolicyMismatchError
from uav_collect.kernels.arrays import row_of
from uav_collect.missions.rollout import fly
from uav_collect.missions.simulation import Simulation
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav import policy as policy_module
from uav_collect.uav.agent import Agent, allocator_named
from uav_collect.uav.belief import belief_of, new_beliefs
from uav_collect.uav.briefing import brief
from uav_collect.uav.learned_on import learned_on
from uav_collect.uav.observation import Layout
from uav_collect.uav.policy import frozen_policy, Policy, policy_for, policy_named, STRONG
from uav_collect.uav.policy_file import load_policy
from uav_collect.uav.policy_network import FrozenPolicy, LearnedPolicy

SPEEDS_MPS = (5.0, 10.0, 7.5)
SEEDS = [3, 1, 4, 3]


def scenario_of(n_uavs: int, **overrides: object) -> Scenario:
    uavs = [{'speed_mps': speed_mps} for speed_mps in SPEEDS_MPS[:n_uavs]]
    budget = {'fleet.default.energy_budget_kj': 60.0}  # random weights fly until it is used up
    return load('paper_10x10', {'fleet.uavs': uavs, **budget, **overrides})


def at_once(frozen: FrozenPolicy) -> Callable[[], Policy]:
    return partial(LearnedPolicy, 'mine', frozen)


def by_agents(frozen: FrozenPolicy) -> Callable[[], Policy]:
    return lambda: Behind(LearnedPolicy('mine', frozen))


def texts(
    scenario: Scenario, seeds: list[int], policy: str | Callable[[], Policy], allocator: str
) -> list[bytes]:
    logs = fly(build_site(scenario), seeds, policy, allocator)
    return [log.to_jsonl() for log in logs]


def frozen_of(layout: Layout, n_uavs: int) -> FrozenPolicy:
    return random_policy(header(layout, n_uavs=n_uavs), seed=n_uavs)


# Many at once


@pytest.mark.parametrize('allocator', ['exact', 'equal'])
@pytest.mark.parametrize('n_uavs', [1, 2, 3])
@pytest.mark.parametrize('layout', Layout)
def test_missions_flown_at_once_equal_those_flown_agent_by_agent(
    layout: Layout, n_uavs: int, allocator: str
) -> None:
    scenario, frozen = scenario_of(n_uavs), frozen_of(layout, n_uavs)
    together = texts(scenario, SEEDS, at_once(frozen), allocator)
    assert together == texts(scenario, SEEDS, by_agents(frozen), allocator)
    assert together[0] == together[3] != together[1]


@pytest.mark.parametrize(
    'overrides',
    [
        {'radio.contact_range_m': 0.0},
        {'radio.contact_range_m': float('inf')},
        {'radio.csi_error_variance': 0.05, 'radio.n_antennas': 4},
        {'fleet.default.energy_budget_kj': 400.0},  # more events than a log has room for at first
    ],
    ids=str,
)
def test_missions_of_another_kind_are_equal_too(overrides: dict[str, object]) -> None:
    scenario, frozen = scenario_of(2, **overrides), frozen_of(Layout.EGOCENTRIC, 2)
    seeds = SEEDS[:2]
    together = texts(scenario, seeds, at_once(frozen), 'exact')
    assert together == texts(scenario, seeds, by_agents(frozen), 'exact')


def digests() -> str:
    lines = []
    for layout, n_uavs, maker in product(Layout, (2, 3), (at_once, by_agents)):
        flown = texts(scenario_of(n_uavs), SEEDS, maker(frozen_of(layout, n_uavs)), 'exact')
        lines.append(hashlib.sha256(b''.join(flown)).hexdigest())
    return '\n'.join(lines)


def test_interpreted_kernels_fly_as_compiled_ones_do() -> None:
    assert interpreted(digests) == digests()


def test_a_mission_flies_alike_whatever_flies_beside_it() -> None:
    scenario, frozen = scenario_of(2), frozen_of(Layout.EGOCENTRIC, 2)
    together = texts(scenario, [*range(30)], at_once(frozen), 'equal')
    alone = [texts(scenario, [seed], at_once(frozen), 'equal')[0] for seed in (0, 17, 29)]
    assert alone == [together[0], together[17], together[29]]


def test_what_a_learned_policy_flies_adds_up() -> None:
    scenario, frozen = scenario_of(3), frozen_of(Layout.PAPER, 3)
    for log in fly(build_site(scenario), SEEDS, at_once(frozen)):
        check_log(log)
        assert mission_metrics(log).is_safe
        assert {unit.policy for unit in log.header.uavs} == {'mine'}


def test_a_batch_may_be_empty() -> None:
    assert texts(scenario_of(2), [], at_once(frozen_of(Layout.PAPER, 2)), 'exact') == []


def test_a_learned_policy_flies_with_cvxpy_too() -> None:
    scenario = scenario_of(2, **{'demand.cell_share': 0.1})
    frozen = frozen_of(Layout.EGOCENTRIC, 2)
    (solved,) = fly(build_site(scenario), [2], at_once(frozen), 'cvxpy')
    (exact,) = fly(build_site(scenario), [2], at_once(frozen), 'exact')
    assert solved.events['action'].tolist() == exact.events['action'].tolist()
    assert [unit.allocator for unit in solved.header.uavs] == ['cvxpy', 'cvxpy']


# Behind the protocol


def test_a_policy_remembers_within_a_mission_and_forgets_between_missions() -> None:
    scenario, frozen = scenario_of(2), frozen_of(Layout.EGOCENTRIC, 2)
    simulation = Simulation(build_site(scenario), 0)
    event = simulation.next_event()
    assert event is not None
    belief = belief_of(new_beliefs(simulation.briefing, 1), 0)
    policy = LearnedPolicy('mine', frozen)
    legal = row_of([1, 1, 1, 1, 1])
    chosen = []
    for _ in range(2):
        policy.begin(simulation.briefing, 0)
        hidden = [policy._hidden.copy()]
        for _ in range(5):
            chosen.append(policy.choose(belief, event.view, legal))
            hidden.append(policy._hidden.copy())
        assert not hidden[0].any()
        assert all((one != other).any() for one, other in pairwise(hidden))
    assert chosen[:5] == chosen[5:]


def test_the_uavs_of_a_fleet_share_weights_and_no_memory() -> None:
    scenario, frozen = scenario_of(2), frozen_of(Layout.EGOCENTRIC, 2)
    briefing = brief(scenario)
    agents = [
        Agent(briefing, uav, LearnedPolicy('mine', frozen), allocator_named('exact'))
        for uav in range(2)
    ]
    simulation = Simulation(build_site(scenario), 0)
    event = simulation.next_event()
    assert event is not None
    agents[event.uav].observe(event.view)
    agents[event.uav].decide(event.view)
    policies = [agent.policy for agent in agents]
    states = [policy._hidden for policy in policies if isinstance(policy, LearnedPolicy)]
    assert states[event.uav].any()
    assert not states[1 - event.uav].any()


def test_a_policy_takes_the_best_of_the_legal_actions_alone() -> None:
    scenario, frozen = scenario_of(2), frozen_of(Layout.EGOCENTRIC, 2)
    simulation = Simulation(build_site(scenario), 0)
    event = simulation.next_event()
    assert event is not None
    belief = belief_of(new_beliefs(simulation.briefing, 1), 0)
    policy = LearnedPolicy('mine', frozen)
    for action in range(5):
        policy.begin(simulation.briefing, 0)
        only = row_of([int(other == action) for other in range(5)])
        assert policy.choose(belief, event.view, only) == action


def test_a_policy_must_begin_before_it_chooses() -> None:
    policy = LearnedPolicy('mine', frozen_of(Layout.PAPER, 2))
    simulation = Simulation(build_site(scenario_of(2)), 0)
    event = simulation.next_event()
    assert event is not None
    belief = belief_of(new_beliefs(simulation.briefing, 1), 0)
    with pytest.raises(RuntimeError, match='must begin a mission'):
        policy.choose(belief, event.view, row_of([1] * 5))


@pytest.mark.parametrize('make', [at_once, by_agents])
def test_a_policy_does_not_take_off_with_a_fleet_or_over_an_area_it_does_not_know(
    make: Callable[[FrozenPolicy], Callable[[], Policy]],
) -> None:
    make_policy = make(frozen_of(Layout.EGOCENTRIC, 2))
    with pytest.raises(PolicyMismatchError, match='policy mine: n_uavs is 3: must be 2'):
        texts(scenario_of(3), [0], make_policy, 'exact')
    with pytest.raises(
        PolicyMismatchError, match='policy mine: area is 4 x 4 cells: must have 10'
    ):
        texts(tiny(), [0], make_policy, 'exact')


def test_a_policy_flies_scenarios_that_it_did_not_learn_in() -> None:
    dense = scenario_of(2, **{'demand.cell_share': 'all'})
    assert texts(dense, [0], at_once(frozen_of(Layout.EGOCENTRIC, 2)), 'exact')


# By name


@pytest.fixture
def shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of shipped policies."""
    folder = tmp_path / 'policies'
    folder.mkdir()
    monkeypatch.setattr(policy_module, 'shared_folders', lambda kind: (folder,))
    return folder


def test_a_policy_is_named_by_its_path(tmp_path: Path) -> None:
    path = saved(tmp_path, 'mine', header())
    policy = policy_named(str(path))
    assert (policy.name, policy.version) == ('mine', 'test @ 100, 89abcdef')
    scenario = scenario_of(2)
    frozen = random_policy(header())
    expected = texts(scenario, [1], at_once(frozen), 'exact')
    assert texts(scenario, [1], str(path), 'exact') == expected


def test_a_shipped_policy_is_known_by_its_bare_name(shipped: Path) -> None:
    saved(shipped, 'careful', header())
    assert policy_named('careful').name == 'careful'


def test_strong_is_what_is_shipped_for_the_scenario_and_its_fleet(shipped: Path) -> None:
    saved(shipped, 'paper_10x10_n2_aqmix', header())
    saved(shipped, 'paper_10x10_n3_aqmix', header(n_uavs=3))
    assert policy_for(STRONG, scenario_of(2)).name == 'paper_10x10_n2_aqmix'
    assert policy_for(STRONG, scenario_of(3)).name == 'paper_10x10_n3_aqmix'
    log = fly(build_site(scenario_of(2)), [0], STRONG)[0]
    assert log.header.uavs[0].policy == 'paper_10x10_n2_aqmix'


def test_strong_says_what_there_is_when_there_is_none_for_the_scenario(shipped: Path) -> None:
    saved(shipped, 'lillgrund_n2_aqmix', header())  # of no use here
    with pytest.raises(
        PolicyMismatchError, match=r'for paper_10x10 with 2 UAVs; --policy best flies'
    ):
        policy_for(STRONG, scenario_of(2))
    saved(shipped, 'paper_10x10_n2_aqmix', header())
    words = 'no learned policy is shipped for paper_10x10 with 1 UAV .*there are paper_10x10_n2'
    with pytest.raises(PolicyMismatchError, match=words):
        policy_for(STRONG, scenario_of(1))


def test_strong_is_refused_where_the_area_was_changed(shipped: Path) -> None:
    saved(shipped, 'paper_10x10_n2_aqmix', header())
    with pytest.raises(PolicyMismatchError, match='area is 12 x 12 cells: must have 10 rows'):
        policy_for(STRONG, scenario_of(2, **{'area.cells_per_side': 12}))


def test_strong_is_refused_where_it_learned_on_other_scenarios(shipped: Path) -> None:
    saved(shipped, 'paper_10x10_n2_aqmix', header(learned_on=(learned_on(scenario_of(2)),)))
    assert policy_for(STRONG, scenario_of(2)).name == 'paper_10x10_n2_aqmix'
    words = (
        r'outside what it learned on: cells with data 0\.5 \(learned: 0\.3\);'
        ' --policy paper_10x10_n2_aqmix flies it all the same; --policy best flies'
    )
    with pytest.raises(PolicyMismatchError, match=words):
        policy_for(STRONG, scenario_of(2, **{'demand.cell_share': 0.5}))


@pytest.mark.parametrize(
    ('n_uavs', 'overrides', 'name'),
    [
        (2, {}, 'paper_10x10_n2_aqmix'),
        (2, {'demand.cell_share': 0.5}, 'anywhere'),  # the specialist learned on .3
        (2, {'name': 'elsewhere'}, 'anywhere'),  # there is no specialist
    ],
)
def test_where_no_specialist_is_at_home_strong_is_what_learned_on_many_fields(
    n_uavs: int, overrides: dict[str, object], name: str, shipped: Path
) -> None:
    saved(shipped, 'paper_10x10_n2_aqmix', header(learned_on=(learned_on(scenario_of(2)),)))
    saved(shipped, 'anywhere', header())
    assert policy_for(STRONG, scenario_of(n_uavs, **overrides)).name == name


def test_a_specialist_that_is_broken_is_not_passed_over(shipped: Path) -> None:
    file = saved(shipped, 'paper_10x10_n2_aqmix', header())
    file.write_bytes(file.read_bytes()[:-1])
    saved(shipped, 'anywhere', header())
    with pytest.raises(PolicyMismatchError, match='paper_10x10_n2_aqmix'):
        policy_for(STRONG, scenario_of(2))


def test_the_best_policy_is_chosen_by_those_who_can(shipped: Path) -> None:
    with pytest.raises(PolicyMismatchError, match='policy best is chosen before take-off'):
        policy_for('best', scenario_of(2))


def test_an_unknown_name_is_answered_with_those_that_there_are(shipped: Path) -> None:
    saved(shipped, 'careful', header())
    words = "'finest' is unknown; there are hert, hert-equal, sweep, random, careful, the path of"
    with pytest.raises(PolicyMismatchError, match=words):
        policy_named('finest')


def test_weights_to_start_from_are_those_of_a_file_or_of_a_shipped_policy(shipped: Path) -> None:
    file = saved(shipped, 'careful', header())
    assert frozen_policy('careful').digest == frozen_policy(str(file)).digest
    assert frozen_policy('careful').digest == load_policy(file).digest


def test_a_heuristic_has_no_weights_to_start_from(shipped: Path) -> None:
    saved(shipped, 'careful', header())
    with pytest.raises(PolicyMismatchError, match="called 'sweep'; there are careful, or the"):
        frozen_policy('sweep')


def test_a_path_that_leads_nowhere_is_named(tmp_path: Path) -> None:
    with pytest.raises(PolicyMismatchError, match=r'nowhere\.safetensors: cannot be read'):
        policy_named(str(tmp_path / 'nowhere.safetensors'))


@pytest.mark.parametrize('name', ['sweep', 'hert', 'strong', 'best'])
def test_a_file_must_not_pass_for_another_policy(name: str, tmp_path: Path) -> None:
    with pytest.raises(PolicyMismatchError, match='rename it'):
        policy_named(str(saved(tmp_path, name, header())))


def test_a_file_of_another_alphabet_has_a_name_that_can_be_written(tmp_path: Path) -> None:
    assert policy_named(str(saved(tmp_path, 'größer', header()))).name == 'größer'
    assert policy_named(str(saved(tmp_path, 'gr\udcf6sser', header()))).name == r'gr\xf6sser'


@pytest.mark.parametrize(
    'name', ['a' * 5000, '/a' * 5000, 'a\0/b', '\ud800/a', 'a\ud800', '\x1b/']
)
def test_what_can_be_no_file_is_refused_in_a_short_line(name: str) -> None:
    with pytest.raises(
        PolicyMismatchError, match=r'is unknown|cannot be read|printable'
    ) as raised:
        policy_named(name)
    assert len(in_one_line(str(raised.value))) <= 1000


@pytest.mark.parametrize('name', ['hert', 'hert-equal', 'sweep', 'random'])
def test_rules_fit_every_scenario(name: str) -> None:
    assert policy_for(name, tiny()).name == name

"""The choice of a policy by simulation: who may fly, in which missions, and who is best."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from random_policies import header, saved
from tiny_world import tiny, uav
from uav_collect.analysis import choosing as choosing_module
from uav_collect.analysis.choice import Choice, MOST_MISSIONS, Tried
from uav_collect.analysis.choosing import (
    Candidate,
    candidates_for,
    CHOICE_SEED,
    choose,
    Choosing,
    planned_missions,
)
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.analysis.statistics import Estimate, estimates, MEASURES, mission_seeds
from uav_collect.errors import PolicyMismatchError
from uav_collect.limits import MAX_SEED
from uav_collect.missions.batch_metrics import BatchMetrics
from uav_collect.missions.rollout import fly
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.training.seeds import first_training_seed, VALIDATION_SEED
from uav_collect.uav import policy as policy_module
from uav_collect.uav.observation import Layout
from uav_collect.uav.policy import policy_for


@pytest.fixture
def shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of shipped policies, empty."""
    monkeypatch.setattr(policy_module, 'shared_folders', lambda kind: (tmp_path,))
    return tmp_path


@pytest.fixture(scope='module')
def scarce() -> Scenario:
    """A field whose fleet has too little energy for all of it in some missions."""
    return load('paper_8x8', {'fleet.default.energy_budget_kj': 45.0})


def named(scenario: Scenario, *names: str) -> list[Candidate]:
    return [Candidate(name=name, policy=policy_for(name, scenario)) for name in names]


def names_of(scenario: Scenario, *given: str) -> list[str]:
    return [it.name for it in candidates_for(scenario, given)[0]]


# Who may fly


def test_candidates_are_those_that_are_shipped_the_rules_and_those_that_a_user_names() -> None:
    scenario = load('paper_10x10')
    assert names_of(scenario) == ['paper_10x10_n2_aqmix', 'anywhere', 'sweep', 'hert']
    given = ['hert', 'user_policies:nearest', 'paper_10x10_n2_aiql', 'paper_10x10_n2_aqmix']
    assert names_of(scenario, *given) == [*names_of(scenario), *given[1:3]]


def test_what_learned_on_many_fields_is_a_candidate_where_it_is_shipped(shipped: Path) -> None:
    scenario = load('paper_10x10')
    assert names_of(scenario) == ['sweep', 'hert']
    saved(shipped, 'anywhere', header())
    assert names_of(scenario) == ['anywhere', 'sweep', 'hert']
    saved(shipped, 'paper_10x10_n2_aqmix', header())
    saved(shipped, 'taught', header())
    assert names_of(scenario) == ['paper_10x10_n2_aqmix', 'anywhere', 'sweep', 'hert']


def test_a_specialist_that_does_not_fit_is_left_out_with_a_line(shipped: Path) -> None:
    saved(shipped, 'paper_10x10_n2_aqmix', header(n_uavs=3))
    candidates, left_out = candidates_for(load('paper_10x10'))
    assert [it.name for it in candidates] == ['sweep', 'hert']
    name = 'paper_10x10_n2_aqmix'
    assert left_out == [f'{name} cannot be chosen: policy {name}: n_uavs is 2: must be 3']


def test_what_was_refined_for_a_scenario_is_the_first_candidate_unless_it_does_not_fit(
    shipped: Path,
) -> None:
    own = str(saved(shipped, 'my_field', header()))
    other = str(saved(shipped, 'other', header(n_uavs=3)))
    candidates, left_out = candidates_for(load('paper_10x10'), own=[own, other])

    assert [it.name for it in candidates] == [own, 'sweep', 'hert']
    assert left_out == [f'{other} cannot be chosen: policy other: n_uavs is 2: must be 3']


@pytest.mark.parametrize('name', ['nope', 'best', 'paper_15x15_n2_aqmix'])
def test_a_candidate_that_a_user_names_must_fit(name: str) -> None:
    with pytest.raises(PolicyMismatchError):
        candidates_for(load('paper_8x8'), [name])


# What they achieve


def test_the_figures_are_those_of_the_same_missions_with_logs(scarce: Scenario) -> None:
    site = build_site(scarce)
    choice = choose(site, named(scarce, 'hert', 'sweep', 'random'), n_missions=12)
    assert [it.policy for it in choice.tried] == ['hert', 'sweep', 'random']
    for it in choice.tried:
        logs = fly(site, mission_seeds(CHOICE_SEED, 12), it.policy)
        expected = estimates([mission_metrics(log) for log in logs], CHOICE_SEED)
        for measure, estimate in zip(MEASURES, expected, strict=True):
            found = it.estimates[measure.key]
            assert (found.mean, found.low, found.high) == pytest.approx(
                (estimate.mean, estimate.low, estimate.high), rel=1e-9
            ), measure.key


def test_a_uav_that_lands_without_its_margin_is_not_safe() -> None:
    flown = BatchMetrics(
        collected_bit=np.array([1e6, 1e6, 1e6]),
        total_bit=np.array([1e6, 1e6, 1e6]),
        energy_j=np.array([[20e3, 20e3], [20e3, 20.1e3], [0.0, 30e3]]),
        landed_s=np.array([[1.0, 2.0], [1.0, 2.0], [1.0, 2.0]]),
    )
    own = {'energy_budget_kj': 30.0, 'energy_margin_kj': 10.0}
    values = choosing_module._values(flown, tiny(uav(**own), uav(10.0, **own)))
    assert values[:, [it.key for it in MEASURES].index('safe_share')].tolist() == [1.0, 0.0, 0.0]


def test_who_leaves_data_behind_does_not_fly_however_little_energy_it_takes(
    scarce: Scenario,
) -> None:
    choice = choose(build_site(scarce), named(scarce, 'random', 'sweep'), n_missions=12)
    random, sweep = choice.tried
    assert random.estimates['complete_share'].mean < sweep.estimates['complete_share'].mean
    assert choice.policy == 'sweep'
    assert choice.why.endswith('in 12 sampled missions: it leaves less behind than random')


def test_the_lead_is_that_over_the_next_best_mission_by_mission() -> None:
    scenario = load('paper_8x8')
    site = build_site(scenario)
    choice = choose(site, named(scenario, 'hert', 'random', 'sweep'), n_missions=12)
    assert (choice.policy, choice.next_best) == ('sweep', choice.tried[0])
    seeds = mission_seeds(CHOICE_SEED, 12)
    by = {
        name: np.array(
            [mission_metrics(it).efficiency_kbit_per_j for it in fly(site, seeds, name)]
        )
        for name in ('hert', 'sweep')
    }
    assert choice.lead is not None
    assert choice.lead.mean == pytest.approx((by['sweep'] - by['hert']).mean(), rel=1e-9)
    assert choice.lead.low <= choice.lead.mean <= choice.lead.high
    assert f'{choice.lead.mean:+.3f}' in choice.why


def test_of_two_that_are_equal_the_earlier_flies() -> None:
    scenario = load('paper_8x8')
    sweep = policy_for('sweep', scenario)
    twins = [Candidate(name='one', policy=sweep), Candidate(name='other', policy=sweep)]
    site = build_site(scenario)
    assert choose(site, twins, n_missions=4).policy == 'one'
    assert choose(site, twins[::-1], n_missions=4).policy == 'other'


def test_a_candidate_alone_flies() -> None:
    scenario = tiny()
    choice = choose(build_site(scenario), named(scenario, 'hert'), n_missions=2)
    assert (choice.policy, choice.next_best, choice.lead) == ('hert', None, None)
    assert choice.why == 'hert is the only candidate'


def test_networks_and_functions_are_candidates_like_rules(tmp_path: Path) -> None:
    scenario = load('paper_8x8')
    file = str(saved(tmp_path, 'mine', header(side=8)))
    candidates = named(scenario, file, 'sweep', 'user_policies:homebird')
    choice = choose(build_site(scenario), candidates, n_missions=2)
    assert [(it.policy, it.version) for it in choice.tried[:2]] == [
        (file, 'test @ 100, 89abcdef'),
        ('sweep', 'rule'),
    ]
    assert choice.tried[2].estimates['collected_share'].mean == 0.0
    assert choice.policy == 'sweep'


def test_a_function_that_breaks_the_rules_ends_the_choice() -> None:
    scenario = load('paper_8x8')
    with pytest.raises(PolicyMismatchError, match='hostile_policies:huge'):
        choose(build_site(scenario), named(scenario, 'hostile_policies:huge'), n_missions=1)


def test_bandwidth_is_shared_as_the_mission_does(scarce: Scenario) -> None:
    site = build_site(scarce)
    by = {
        allocator: choose(site, named(scarce, 'hert'), allocator=allocator, n_missions=4)
        for allocator in ('exact', 'equal', 'cvxpy')
    }
    means = {name: it.tried[0].estimates['completion_s'].mean for name, it in by.items()}
    assert means['cvxpy'] == means['exact'] < means['equal']
    assert by['cvxpy'].bandwidth == 'cvxpy'


# Which missions, and how many


def test_its_missions_are_none_that_anybody_tests_or_trains_on() -> None:
    last = CHOICE_SEED + MOST_MISSIONS
    assert 10**17 < CHOICE_SEED < last < VALIDATION_SEED < first_training_seed(0) < MAX_SEED


@pytest.mark.parametrize(
    ('side', 'names', 'is_compiled', 'n_missions'),
    [
        (10, ('sweep', 'hert', 'paper_10x10_n2_aqmix'), True, 200),
        (10, ('sweep', 'hert', 'paper_10x10_n2_aqmix'), False, 70),
        (10, ('sweep',), False, 200),
        (20, ('sweep', 'hert', 'paper_10x10_n2_aqmix'), True, 200),
        (20, ('sweep', 'hert', 'paper_10x10_n2_aqmix'), False, 10),
        (64, ('sweep', 'hert', 'paper_10x10_n2_aqmix'), True, 40),
    ],
)
def test_how_many_missions_follows_from_area_candidates_and_kernels_alone(
    side: int, names: tuple[str, ...], is_compiled: bool, n_missions: int
) -> None:
    candidates = named(load('paper_10x10'), *names)
    found = planned_missions(candidates, side * side, is_compiled=is_compiled)
    assert found == n_missions


def test_a_network_that_sees_more_or_is_larger_flies_fewer_missions(tmp_path: Path) -> None:
    def planned(layout: Layout, hidden_size: int = 16) -> int:
        file = str(saved(tmp_path, 'mine', header(layout, hidden_size=hidden_size)))
        candidates = named(load('paper_10x10'), file, 'sweep', 'hert')
        return planned_missions(candidates, 100, is_compiled=False)

    assert [planned(it) for it in Layout] == [70, 70, 60]
    assert [planned(it, 256) for it in Layout] == [60, 60, 40]


def test_the_choice_is_the_same_however_many_missions_are_flown_at_once(
    scarce: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    site, candidates = build_site(scarce), named(scarce, 'sweep', 'random')
    whole = choose(site, candidates, n_missions=7)
    monkeypatch.setattr(choosing_module, '_CHUNK_S', 1e-9)
    flown = Choosing(site, candidates, n_missions=7)
    steps = []
    while not flown.is_over:
        steps.append(flown.fly_some())
    assert steps == [1] * 14
    assert flown.choice() == whole


def test_a_choice_that_runs_out_of_time_says_how_many_missions_it_stands_on(
    scarce: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(choosing_module, '_CHUNK_S', 1e-9)
    site, candidates = build_site(scarce), named(scarce, 'sweep', 'hert')
    choice = choose(site, candidates, n_missions=50, most_s=0.0)
    assert (choice.n_missions, choice.n_planned) == (1, 50)
    assert 'stopped for lack of time after 1 of 50 missions' in str(choice)
    assert replace_planned(choice) == choose(site, candidates, n_missions=1)


def replace_planned(choice: Choice) -> Choice:
    """The choice as if no more missions had been planned than were flown."""
    return Choice(**{**vars(choice), 'n_planned': choice.n_missions})


def test_before_all_have_flown_the_same_missions_there_is_no_choice(scarce: Scenario) -> None:
    flown = Choosing(build_site(scarce), named(scarce, 'sweep', 'hert'), n_missions=2)
    with pytest.raises(RuntimeError, match='same missions'):
        flown.choice()
    flown.fly_some()
    with pytest.raises(RuntimeError, match='same missions'):
        flown.choice()


# What people read


def tried(name: str, efficiency: float, complete: float = 1.0) -> Tried:
    shares = {'complete_share': complete, 'safe_share': 1.0, 'efficiency_kbit_per_j': efficiency}
    return Tried(
        policy=name,
        version='1',
        estimates={
            it.key: Estimate(mean=shares.get(it.key, 10.0), low=0.5, high=20.0, median=1.0)
            for it in MEASURES
        },
        computing_s=1.5,
    )


def choice_of(*those: Tried, is_compiled: bool = True) -> Choice:
    return Choice(
        scenario='tiny',
        fingerprint='0',
        bandwidth='exact',
        first_seed=CHOICE_SEED,
        n_missions=200,
        n_planned=200,
        is_compiled=is_compiled,
        tried=those,
        lead=Estimate(mean=0.25, low=0.125, high=0.5, median=0.25),
    )


def test_the_table_has_an_arrow_before_who_flies() -> None:
    shown = str(choice_of(tried('hert', 0.75), tried('sweep', 1.0), tried('random', 2.0, 0.5)))
    assert shown.splitlines() == [
        'sweep is the best of 3 in 200 sampled missions: +0.250 (+0.125 to +0.500) kbit/J against'
        ' hert',
        '',
        '  candidate  kbit/J    95 % interval  time   energy  complete     safe  CPU time',
        '  hert        0.750  0.500 to 20.000  10 s  10.0 kJ   100.0 %  100.0 %     1.5 s',
        '> sweep       1.000  0.500 to 20.000  10 s  10.0 kJ   100.0 %  100.0 %     1.5 s',
        '  random      2.000  0.500 to 20.000  10 s  10.0 kJ    50.0 %  100.0 %     1.5 s',
    ]
    assert 'interpreted' in str(choice_of(tried('hert', 0.75), is_compiled=False))


def test_neither_what_is_compiled_at_first_nor_other_processes_cut_a_choice_short(
    scarce: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(choosing_module, '_CHUNK_S', 1e-9)
    # A second more each time that both have flown: it is asked for before and after either.
    looks = itertools.count()
    monkeypatch.setattr(choosing_module, 'process_time', lambda: 100.0 + next(looks) // 5)
    choice = choose(build_site(scarce), named(scarce, 'sweep', 'hert'), n_missions=9, most_s=2.0)
    assert choice.n_missions == 3

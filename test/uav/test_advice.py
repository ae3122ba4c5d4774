"""Policies that see the sweep's advice: flown alike in batches and by agents, home by its word."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from odd_areas import arms, corridor, maze, pipeline, with_a_hole
import pytest
from random_policies import Behind, header, random_policy
from tiny_world import tiny, uav
from uav_collect.errors import PolicyMismatchError
from uav_collect.kernels.arrays import Bools
from uav_collect.missions.rollout import fly
from uav_collect.missions.vector_env import VectorEnv, VectorEnvConfig
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import BY_POLICY, HOME, HOVER, NONE
from uav_collect.uav.heuristics import Heuristic
from uav_collect.uav.observation import Layout
from uav_collect.uav.policy_file import policy_bytes, policy_from_bytes
from uav_collect.uav.policy_header import PolicyHeader
from uav_collect.uav.policy_network import FrozenPolicy, LearnedPolicy

SEEDS = [5, 8]
ALWAYS = 1e6  # a bonus that no value comes up to


def header_for_any(**values: object) -> PolicyHeader:
    """The header of a policy that flies any fleet over any area."""
    spans: dict[str, object] = {'cells_per_side_max': 64, 'n_uavs_max': 16}
    return header(Layout.RELATIVE, side=1, n_uavs=1, **{**spans, **values})


def frozen_with(advice_bonus: float) -> FrozenPolicy:
    return random_policy(header_for_any(advice_bonus=advice_bonus), seed=2)


def fleet_at(*cells: tuple[int, int]) -> dict[str, object]:
    """UAVs of different speeds that start and land each in a cell of its own."""
    places = [{'cell': [*cell]} for cell in cells]
    fleet = [
        {'speed_mps': 5.0 + 4.0 * place, 'start': at, 'home': at}
        for place, at in enumerate(places)
    ]
    return {'fleet__uavs': fleet}


def lost_and_late() -> Scenario:
    radio = {'radio.loss_share': 0.3, 'radio.delay_s': [3.0, 2.0]}
    uavs = {'fleet.uavs': [{'speed_mps': 5.0}, {'speed_mps': 10.0}]}
    return load('paper_10x10', {**radio, **uavs, 'fleet.default.energy_budget_kj': 200.0})


SCENARIOS: dict[str, Callable[[], Scenario]] = {
    'paper': partial(load, 'paper_10x10'),
    'hole': with_a_hole,
    'pipeline': partial(pipeline, 8),
    'arms': partial(arms, 3),
    'maze': maze,
    'high': partial(corridor, 11, 5, **fleet_at((10, 4), (10, 0), (4, 2))),
    'deaf': partial(corridor, 7, 9, radio__contact_range_m=0.0, **fleet_at((6, 8), (3, 4))),
    'deaf pipeline': partial(pipeline, 9, radio__contact_range_m=0.0),
    'short of energy': partial(corridor, 9, 9, fleet__default__energy_budget_kj=40.0),
    'alone': partial(corridor, 6, 6, **fleet_at((5, 2))),
    'lost and late': lost_and_late,
}


def flown(
    scenario: Scenario, policy: Callable[[], LearnedPolicy] | str, guard_after: int = 0
) -> list[MissionLog]:
    return fly(build_site(scenario), SEEDS, policy, 'exact', guard_after)


@pytest.mark.parametrize('name', SCENARIOS)
@pytest.mark.parametrize(('advice_bonus', 'guard_after'), [(0.0, 12), (0.05, 0)])
def test_missions_flown_at_once_equal_those_flown_agent_by_agent(
    name: str, advice_bonus: float, guard_after: int
) -> None:
    scenario, frozen = SCENARIOS[name](), frozen_with(advice_bonus)
    if advice_bonus == 0.0:
        budget = {'energy_budget_kj': 60.0}  # random weights fly until it is used up
        uavs = tuple(replace(it, **budget) for it in scenario.uavs)
        scenario = replace(scenario, fleet=replace(scenario.fleet, uavs=uavs))
    together = flown(scenario, partial(LearnedPolicy, 'mine', frozen), guard_after)
    apart = fly(
        build_site(scenario),
        SEEDS,
        lambda: Behind(LearnedPolicy('mine', frozen)),
        'exact',
        guard_after,
    )
    assert [it.to_jsonl() for it in together] == [it.to_jsonl() for it in apart]


@pytest.mark.parametrize('name', SCENARIOS)
def test_a_policy_that_always_takes_the_advice_flies_the_sweep(name: str) -> None:
    scenario = SCENARIOS[name]()
    advised = flown(scenario, partial(LearnedPolicy, 'mine', frozen_with(ALWAYS)))
    for mine, sweeps in zip(advised, flown(scenario, 'sweep'), strict=True):
        assert len(mine.events) > 10
        assert (mine.events == sweeps.events).all()


def test_without_a_bonus_the_network_alone_chooses() -> None:
    scenario = SCENARIOS['paper']()
    mine = flown(scenario, partial(LearnedPolicy, 'mine', frozen_with(0.0)), 12)
    assert (
        mine[0].events['action'].tolist() != flown(scenario, 'sweep')[0].events['action'].tolist()
    )


def is_early(log: MissionLog) -> Bools:
    """Which events turn home by the policy's word."""
    events = log.events
    early: Bools = (events['action'] == HOME) & (events['reason'] == BY_POLICY)
    return early


def test_a_uav_flies_home_where_the_sweep_would_and_nobody_is_asked() -> None:
    scenario = SCENARIOS['deaf']()
    site = build_site(scenario)
    (log,) = fly(site, SEEDS[:1], 'sweep', 'equal')
    assert is_early(log).sum() == 2
    config = VectorEnvConfig(layout=Layout.RELATIVE, max_decisions=len(log.events))
    env = VectorEnv(site, SEEDS[:1], config)
    actions = []
    while env.decisions.uav[0] != NONE:
        assert env.decisions.advice[0] in range(HOME)
        actions.append(int(env.decisions.advice[0]))
        env.step(env.decisions.advice.copy())
    assert actions == log.events['action'][log.events['action'] != HOME].tolist()
    assert env.episode(0).records.action.tolist() == actions


def test_advice_is_legal_and_other_layouts_have_none() -> None:
    site = build_site(tiny(uav(5.0), uav(10.0)))
    relative = VectorEnv(site, [*range(6)], VectorEnvConfig(layout=Layout.RELATIVE)).decisions
    assert relative.legal[np.arange(6), relative.advice].all()
    for layout in (Layout.PAPER, Layout.EGOCENTRIC):
        other = VectorEnv(site, [*range(6)], VectorEnvConfig(layout=layout)).decisions
        assert (other.advice == NONE).all()
        assert (other.frame == 0).all()


def test_a_share_of_those_that_explore_takes_the_advice() -> None:
    site = build_site(load('paper_10x10'))
    env = VectorEnv(site, [*range(400)], VectorEnvConfig(layout=Layout.RELATIVE))
    advice = env.decisions.advice
    assert (env.explore(1.0, -1.0, 1.0) == advice).all()
    plain, some = env.explore(0.5, -1.0, 0.0), env.explore(0.5, -1.0, 0.4)
    assert (env.explore(0.5, -1.0) == plain).all()
    assert ((some == plain) | (some == advice)).all()
    assert ((plain == NONE) == (some == NONE)).all()
    assert 0.0 < np.mean(some != plain) < 0.3


# In the header


def test_a_files_header_keeps_the_bonus() -> None:
    policy = frozen_with(0.125)
    assert policy_from_bytes(policy_bytes(policy)).header == policy.header


def test_files_of_layouts_without_advice_say_nothing_of_it() -> None:
    policy = random_policy(header())
    assert b'advice' not in policy_bytes(policy)
    assert policy_from_bytes(policy_bytes(policy)).header.advice_bonus == 0.0


@pytest.mark.parametrize('bonus', [-0.5, float('inf'), float('nan')])
def test_a_bonus_must_be_a_number_from_0_on(bonus: float) -> None:
    with pytest.raises(PolicyMismatchError, match=r'advice_bonus is .*: must be from 0 to 1e'):
        frozen_with(bonus)


def test_a_layout_without_advice_has_no_bonus() -> None:
    with pytest.raises(PolicyMismatchError, match='must be from 0 to 0 for egocentric/2'):
        random_policy(header(advice_bonus=0.1))


def test_the_policy_fits_fleets_of_1_to_16_uavs() -> None:
    assert header_for_any().n_uavs_max == 16
    with pytest.raises(PolicyMismatchError, match='n_uavs_max is 17: must be 1 to 16'):
        random_policy(header_for_any(n_uavs_max=17))


def test_the_adviser_is_the_sweep() -> None:
    assert [layout.adviser for layout in Layout] == [NONE, NONE, int(Heuristic.SWEEP)]
    assert HOVER != NONE

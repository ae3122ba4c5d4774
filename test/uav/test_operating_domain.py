"""Outside of its domains a policy flies as its adviser does, in batches and agent by agent."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
import math

import numpy as np
import pytest
from random_policies import header, random_policy
from uav_collect.errors import PolicyMismatchError
from uav_collect.missions.rollout import fly
from uav_collect.missions.simulation import fly_by_agents
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import load
from uav_collect.scenario.site import build_site
from uav_collect.uav.briefing import brief
from uav_collect.uav.observation import Layout
from uav_collect.uav.operating_domain import MAX_DOMAINS, OperatingDomain
from uav_collect.uav.policy import remarks
from uav_collect.uav.policy_file import policy_bytes, policy_from_bytes
from uav_collect.uav.policy_network import FrozenPolicy, LearnedPolicy

PAPER = OperatingDomain(
    n_uavs=(1, 4),
    cells_per_side=(6, 12),
    side_ratio=(1.0, 1.5),
    contact_range_cells=(2.0, math.inf),
    loss_share=(0.0, 0.2),
    late_s=(0.0, 3.0),
    speed_ratio=(1.0, 2.0),
    closed_share=(0.0, 0.1),
    known_share=(0.0, 0.2),
    data_share=(0.1, 0.5),
    budget_crossings=(0.5, math.inf),
    corner_cells=(0.0, 2.0),
    apart_cells=(0.0, 3.0),
    may_fail=False,
)
ELSEWHERE = replace(PAPER, n_uavs=(9, 12))
FIRST, SECOND = replace(PAPER, network=1), replace(PAPER, network=2)
GUARD_AFTER = 3  # it decides before long

Ways = Callable[..., Sequence[MissionLog]]
FIELD = load('paper_10x10', {'fleet.default.energy_budget_kj': 60.0})


def frozen_with(*domains: OperatingDomain, seed: int = 2) -> FrozenPolicy:
    spans = {'cells_per_side_max': 64, 'n_uavs_max': 16, 'advice_bonus': 0.02}
    of = header(Layout.RELATIVE, side=1, n_uavs=1, **spans, domains=domains)
    return random_policy(of, seed=seed)


def joint(*domains: OperatingDomain) -> FrozenPolicy:
    """Two networks, of the seeds 2 and 3, with domains of both."""
    parts = frozen_with(), frozen_with(seed=3)
    weights = {
        f'{number}/{name}': tensor
        for number, part in enumerate(parts, start=1)
        for name, tensor in part.weights.items()
    }
    return FrozenPolicy(replace(parts[0].header, domains=domains), weights)


def flown(*domains: OperatingDomain) -> Sequence[MissionLog]:
    policy = partial(LearnedPolicy, 'mine', frozen_with(*domains))
    return fly(build_site(FIELD), [5, 8], policy, 'exact', GUARD_AFTER)


def flown_alone(*domains: OperatingDomain) -> Sequence[MissionLog]:
    policy = partial(LearnedPolicy, 'mine', frozen_with(*domains))
    site = build_site(FIELD)
    return [fly_by_agents(site, seed, policy, 'exact', GUARD_AFTER) for seed in (5, 8)]


@pytest.mark.parametrize('ways', [flown, flown_alone])
def test_outside_its_adviser_flies_without_a_guard(ways: Ways) -> None:
    swept = fly(build_site(FIELD), [5, 8], 'sweep', 'exact')
    for mine, sweeps in zip(ways(ELSEWHERE), swept, strict=True):
        assert (mine.events == sweeps.events).all()


@pytest.mark.parametrize('ways', [flown, flown_alone])
def test_within_any_of_them_it_decides_by_itself(ways: Ways) -> None:
    own = [it.to_jsonl() for it in flown()]
    assert [it.to_jsonl() for it in ways(ELSEWHERE, PAPER)] == own
    assert [it.to_jsonl() for it in ways(ELSEWHERE)] != own


@pytest.mark.parametrize(
    ('domains', 'seed'),
    [
        ((replace(ELSEWHERE, network=1), SECOND), 3),
        ((FIRST, replace(ELSEWHERE, network=2)), 2),
        ((SECOND, FIRST), 3),
    ],
    ids=['within the second', 'within the first', 'within both'],
)
def test_of_several_networks_the_one_decides_whose_domain_comes_first(
    domains: Sequence[OperatingDomain], seed: int
) -> None:
    site = build_site(FIELD)
    own = partial(LearnedPolicy, 'mine', frozen_with(PAPER, seed=seed))
    both = partial(LearnedPolicy, 'mine', joint(*domains))
    alone = [it.to_jsonl() for it in fly(site, [5, 8], own, 'exact', GUARD_AFTER)]
    assert [it.to_jsonl() for it in fly(site, [5, 8], both, 'exact', GUARD_AFTER)] == alone
    by_agents = [fly_by_agents(site, each, both, 'exact', GUARD_AFTER) for each in (5, 8)]
    assert [it.to_jsonl() for it in by_agents] == alone


def test_outside_of_all_networks_domains_the_adviser_flies() -> None:
    both = joint(replace(ELSEWHERE, network=1), replace(ELSEWHERE, network=2))
    site = build_site(FIELD)
    swept = fly(site, [5], 'sweep', 'exact')
    mine = fly(site, [5], partial(LearnedPolicy, 'mine', both), 'exact', GUARD_AFTER)
    assert (mine[0].events == swept[0].events).all()
    with pytest.raises(ValueError, match='a rule flies there'):
        both.over(brief(FIELD))


def test_none_of_several_networks_is_asked_by_chance() -> None:
    both = joint(FIRST, SECOND)
    seen = np.zeros((1, both.header.observation_size))
    with pytest.raises(ValueError, match='one of several networks'):
        both.step(seen, both.new_hidden(1))


def test_a_file_keeps_several_networks() -> None:
    both = joint(FIRST, replace(ELSEWHERE, network=2))
    again = policy_from_bytes(policy_bytes(both))
    assert again.header == both.header
    assert again.digest == both.digest


def test_each_network_must_have_its_tensors_and_a_domain() -> None:
    both = joint(FIRST, SECOND)
    with pytest.raises(PolicyMismatchError, match='domains of network 1 are none: must be'):
        FrozenPolicy(replace(both.header, domains=(SECOND,)), both.weights)
    with pytest.raises(PolicyMismatchError, match=r"'1/encoder\.bias' is unknown"):
        FrozenPolicy(replace(both.header, domains=(FIRST,)), both.weights)
    third = (FIRST, SECOND, replace(PAPER, network=3))
    with pytest.raises(PolicyMismatchError, match=r"network 3: tensor 'encoder\.bias' is m"):
        FrozenPolicy(replace(both.header, domains=third), both.weights)
    of_none = {**both.weights, 'head.bias': both.weights['1/head.bias']}
    with pytest.raises(PolicyMismatchError, match=r"'head\.bias' is unknown: must be 1/NAME to"):
        FrozenPolicy(both.header, of_none)


OUTSIDE = {
    '0.5 of messages lost (within: 0 to 0.2)': {'radio.loss_share': 0.5},
    '4 s that messages are late (within: 0 to 3)': {'radio.delay_s': [3.0, 1.0]},
    'faults are listed': {'faults': [{'uav': 1, 'kind': 'gone', 'at_s': 5.0}]},
    '5 UAVs (within: 1 to 4)': {'fleet.uavs': [{'speed_mps': 5.0}] * 5},
    '11 to 14 rows and columns (within: 6 to 12)': {'area.rows': 14, 'area.columns': 11},
    '2 of the longer side to the shorter (within: 1 to 1.5)': {
        'area.rows': 6,
        'area.columns': 12,
    },
    '1 cells of contact range (within: 2 to inf)': {'radio.contact_range_m': 50.0},
    '3 of the fastest to the slowest (within: 1 to 2)': {'fleet.uavs.0.speed_mps': 30.0},
    '3.32 s that messages are late (within: 0 to 3)': {'radio.rate_bps': 100.0},  # 332 bits
    "0.23 crossings of its cells in a UAV's budget (within: 0.5 to inf)": {
        'fleet.default.energy_budget_kj': 12.0
    },
    "0.167 crossings of its cells in a UAV's budget (within: 0.5 to inf)": {
        'fleet.uavs.1.energy_budget_kj': 8.0  # the other one has plenty
    },
    '0.15 of cells closed (within: 0 to 0.1)': {
        'area.no_fly': [{'cells': [[row, column] for row in (3, 4, 5) for column in range(5)]}]
    },
    '4.5 cells from start and home to a corner (within: 0 to 2)': {
        'fleet.default.start': {'cell': [5, 4]},
        'fleet.default.home': {'cell': [4, 5]},
    },
    "9 cells between two UAVs' starts or homes (within: 0 to 3)": {
        'fleet.uavs.1.home': {'cell': [0, 9]},
    },
    '0.05 of cells with data (within: 0.1 to 0.5)': {'demand.cell_share': 0.05},
}


@pytest.mark.parametrize('why', OUTSIDE)
def test_outside_a_line_says_why(why: str) -> None:
    policy, scenario = LearnedPolicy('mine', frozen_with(PAPER)), load('paper_10x10', OUTSIDE[why])
    assert remarks(policy, scenario) == [f'policy mine flies as sweep here: {why}']
    assert not PAPER.covers(brief(scenario))
    assert remarks(policy, FIELD) == []


def test_each_uavs_speed_over_the_slowest_ones_may_be_bounded() -> None:
    paired = replace(PAPER, relative_speeds=((1.0, 1.0), (1.0, 1.25), (1.7, 2.0), (1.7, 2.0)))
    for speeds_mps, why in (
        ((10.0, 5.0, 9.0, 6.0), []),
        ((5.0, 5.0, 8.0, 10.0), ['1.6 of speed 3 from below to the slowest (within: 1.7 to 2)']),
        ((5.0, 5.0, 10.0), ['3 UAVs (within: 4)']),
    ):
        fleet = {'fleet.uavs': [{'speed_mps': speed_mps} for speed_mps in speeds_mps]}
        assert [*paired.misfits(brief(load('paper_10x10', fleet)))] == why
    policy = frozen_with(paired)
    assert policy_from_bytes(policy_bytes(policy)).header == policy.header


def test_closed_cells_are_not_among_those_known_to_be_empty() -> None:
    cells = {'area.no_fly': [{'cells': [[3, column] for column in range(9)]}]}
    few = replace(PAPER, known_share=(0.0, 0.0))
    assert few.covers(brief(load('paper_10x10', cells)))


@pytest.mark.parametrize(
    ('domain', 'why'),
    [
        (replace(PAPER, relative_speeds=((1.0, 2.0),) * 5), 'relative_speeds is of 5 UAVs'),
        (replace(PAPER, n_uavs=(17, 20)), r'n_uavs is \[17, 20\]: must begin at 16 or less'),
    ],
)
def test_a_header_has_no_domain_that_nobody_lies_within(domain: OperatingDomain, why: str) -> None:
    with pytest.raises(PolicyMismatchError, match=f'domain 2: {why}'):
        frozen_with(PAPER, domain)


def test_known_cells_and_one_uav_without_a_peer() -> None:
    known = {'demand.known_empty': 'sensors', 'demand.cell_share': 0.1}
    sparse = {**known, 'sensors.dense_cell_share': 0.0, 'sensors.sparse_mean': 0.3}
    assert any(
        'known to be empty' in it for it in PAPER.misfits(brief(load('paper_10x10', sparse)))
    )
    alone = {'fleet.uavs': [{'speed_mps': 5.0}], 'radio.contact_range_m': 0.0}
    assert PAPER.covers(brief(load('paper_10x10', alone)))


def test_a_files_header_keeps_the_domains() -> None:
    policy = frozen_with(PAPER, ELSEWHERE)
    assert policy_from_bytes(policy_bytes(policy)).header == policy.header
    assert b'domains' not in policy_bytes(frozen_with())


def test_a_header_has_no_more_domains_than_can_be_looked_through_at_once() -> None:
    policy = frozen_with(*[PAPER] * MAX_DOMAINS)
    assert policy_from_bytes(policy_bytes(policy)).header == policy.header
    with pytest.raises(PolicyMismatchError, match='domains are 17: must be at most 16'):
        frozen_with(*[PAPER] * 17)


def test_a_layout_without_an_adviser_has_no_domain() -> None:
    with pytest.raises(PolicyMismatchError, match='domains are given: must be none for egocen'):
        random_policy(header(domains=(PAPER,)))

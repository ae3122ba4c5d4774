"""What a policy learned on, and how far from it a scenario is said to be."""

import dataclasses

import pytest
from random_policies import header, random_policy
from uav_collect.scenario.load import load, with_uavs
from uav_collect.scenario.model import Scenario
from uav_collect.training.courses import load_distribution
from uav_collect.uav.briefing import brief
from uav_collect.uav.learned_on import learned_on, LearnedOn, strangeness
from uav_collect.uav.policy import (
    ANYWHERE,
    policy_for,
    policy_named,
    shipped_policies,
    unfamiliar,
)
from uav_collect.uav.policy_file import policy_bytes, policy_from_bytes
from uav_collect.uav.policy_network import LearnedPolicy

HOME = 'fleet.default.home'
# Of each network of `anywhere`, in their order.
ANYWHERES_COURSES = ('taught', 'taught_pairs', 'taught_fleets', 'taught_12x12')
ANYWHERES_FLEETS = (
    (12.0,), (5.0, 10.0, 8.0), (5.0, 10.0, 5.0, 10.0), (12.0, 6.0, 10.0, 6.0, 8.0),
)  # fmt: skip


def paper(**overrides: object) -> Scenario:
    return load('paper_10x10', {key.replace('__', '.'): each for key, each in overrides.items()})


KNOWN = (learned_on(paper()),)


def test_what_a_scenario_teaches_is_kept_in_plain_numbers() -> None:
    assert learned_on(paper()) == LearnedOn(
        cells_per_side=10,
        cell_size_m=50.0,
        speeds_mps=(5.0, 10.0),
        contact_range_m=200.0,
        homes=((0.5, 0.5), (0.5, 0.5)),
        sensors_per_cell=pytest.approx(0.3 * 10.0 + 0.7 * 1.0),
        cell_share=0.3,
        data_mbit=(0.1, 1.0),
    )
    farm = learned_on(load('lillgrund'))
    assert (farm.sensors_per_cell, farm.cell_share, farm.data_mbit) == (0.48, 1.0, (10.0, 40.0))
    assert farm.known_share == pytest.approx(0.54)  # two turbines share a cell, twice


@pytest.mark.parametrize(
    ('overrides', 'difference'),
    [
        (
            {'area__cells_per_side': 20},
            'area 20 x 20 cells of 50 m (learned: 10 x 10 cells of 50 m)',
        ),
        (
            {'area__cell_size_m': 60.0},
            'area 10 x 10 cells of 60 m (learned: 10 x 10 cells of 50 m)',
        ),
        ({'fleet__uavs': [{'speed_mps': 5.0}]}, 'fleet 1 UAV (learned: 2 UAVs)'),
        (
            {'demand__known_empty': 'sensors', 'sensors__seed': 4},
            'cells known to hold nothing 0.29 (learned: 0)',
        ),
        (
            {'fleet__default__energy_budget_kj': 40.0},
            'energy that may run out (learned: ample)',
        ),
        ({'faults': [{'uav': 2, 'kind': 'gone', 'at_s': 60.0}]}, 'faults (learned: none)'),
        (
            {'fleet__uavs': [{'speed_mps': 10.0}, {'speed_mps': 5.0}]},
            'speeds 10 and 5 m/s (learned: 5 and 10 m/s)',
        ),
        ({'radio__contact_range_m': 0.0}, 'contact range 0 m (learned: 200 m)'),
        ({'radio__contact_range_m': float('inf')}, 'contact range inf m (learned: 200 m)'),
        (
            {'fleet__default__home': {'cell': [0, 9]}},
            'homes (9.5, 0.5) cells east and north (learned: (0.5, 0.5) cells east and north)',
        ),
        ({'radio__loss_share': 0.3}, 'messages lost 0.3 (learned: 0)'),
        ({'radio__delay_s': [2.0, 1.0]}, 'messages late by 1 to 3 s (learned: 0 s)'),
        ({'radio__rate_bps': 1200.0}, 'messages sent at 1200 bit/s (learned: inf bit/s)'),
        ({'sensors__dense_mean': 20.0}, 'sensors per cell 6.7 (learned: 3.7)'),
        ({'demand__cell_share': 0.5}, 'cells with data 0.5 (learned: 0.3)'),
        (
            {'demand__data_mbit': [0.5, 2.0]},
            'data of a sensor 0.5 to 2 Mbit (learned: 0.1 to 1 Mbit)',
        ),
    ],
)
def test_each_difference_is_named_with_what_is_flown_and_what_was_learned(
    overrides: dict[str, object], difference: str
) -> None:
    assert strangeness(KNOWN, paper(**overrides)) == [difference]


@pytest.mark.parametrize(
    'overrides',
    [
        {},
        {'sensors__seed': 7},  # another topology, as dense
        {'demand__data_mbit': [0.2, 0.9]},  # within what it learned on
        {'fleet__default__energy_budget_kj': 50.0},
        {'radio__csi_error_variance': 0.1},
        {'radio__loss_share': 0.0, 'radio__delay_s': [0.0, 0.0], 'radio__beacon_period_s': 5.0},
    ],
)
def test_what_it_generalises_over_is_not_mentioned(overrides: dict[str, object]) -> None:
    assert strangeness(KNOWN, paper(**overrides)) == []


def test_between_what_was_learned_in_several_scenarios_nothing_is_strange() -> None:
    known = tuple(
        learned_on(paper(radio__contact_range_m=range_m, demand__cell_share=share))
        for range_m, share in ((50.0, 0.1), (400.0, 0.5))
    )
    assert strangeness(known, paper()) == []
    assert strangeness(known, paper(radio__contact_range_m=0.0)) == [
        'contact range 0 m (learned: 50 to 400 m)'
    ]


def test_speeds_are_held_against_fleets_of_as_many() -> None:
    known = tuple(learned_on(with_uavs(paper(), n_uavs)) for n_uavs in (1, 2, 4))
    assert strangeness(known, with_uavs(paper(), 4)) == []
    assert strangeness(known, with_uavs(paper(), 3)) == [
        'fleet 3 UAVs (learned: 1 UAV, 2 UAVs, 4 UAVs)'
    ]


def test_one_uav_has_nobody_to_be_in_contact_with() -> None:
    alone = with_uavs(paper(radio__contact_range_m=0.0), 1)
    assert strangeness((learned_on(with_uavs(paper(), 1)),), alone) == []


def test_several_differences_make_one_line() -> None:
    policy = policy_named('paper_10x10_n2_aqmix')
    strange = paper(radio__contact_range_m=0.0, demand__cell_share=0.5)
    assert unfamiliar(policy, strange) == (
        'policy paper_10x10_n2_aqmix flies outside what it learned on: contact range 0 m '
        '(learned: 200 m); cells with data 0.5 (learned: 0.3)'
    )


def test_what_a_file_does_not_say_is_not_judged() -> None:
    old = LearnedPolicy('old', random_policy(header()))
    assert old.frozen.header.learned_on == ()
    assert unfamiliar(old, paper(radio__contact_range_m=0.0)) is None
    assert unfamiliar(policy_named('sweep'), paper(radio__contact_range_m=0.0)) is None


@pytest.mark.parametrize('name', [it for it in shipped_policies() if it != ANYWHERE])
def test_each_shipped_specialist_is_at_home_where_it_learned(name: str) -> None:
    policy = policy_named(name)
    assert isinstance(policy, LearnedPolicy)
    home = policy.frozen.header
    # Where nobody knew which cells hold nothing, as files of before have it.
    scenario = with_uavs(load(home.scenario, {'demand.known_empty': 'none'}), home.n_uavs_min)
    assert home.learned_on == (learned_on(scenario),)
    assert unfamiliar(policy_for(name, scenario), scenario) is None
    wider = dataclasses.replace(scenario.demand, data_mbit=(0.01, 90.0))
    elsewhere = dataclasses.replace(scenario, demand=wider)
    assert 'data of a sensor 0.01 to 90 Mbit' in (unfamiliar(policy, elsewhere) or '')
    assert dataclasses.asdict(home.learned_on[0])['cells_per_side'] == home.cells_per_side_min


def test_the_policy_for_any_field_flies_anything_and_says_where_it_flies_as_the_sweep() -> None:
    policy = policy_named(ANYWHERE)
    assert isinstance(policy, LearnedPolicy)
    parts = [load_distribution(name).domains or () for name in ANYWHERES_COURSES]
    assert policy.frozen.header.domains == tuple(
        dataclasses.replace(each, network=number)
        for number, part in enumerate(parts, start=1)
        for each in part
    )
    fleets = [[{'speed_mps': speed} for speed in speeds] for speeds in ANYWHERES_FLEETS]
    for scenario, number in (
        (load('paper_8x8'), 2),
        (load('paper_10x10'), 2),
        (paper(area__cells_per_side=12), 4),
        *zip([paper(fleet__uavs=fleet) for fleet in fleets], (1, 3, 1, 3), strict=True),
    ):
        assert unfamiliar(policy, scenario) is None
        assert policy.frozen.header.network_for(brief(scenario)) == number
    for name in ('paper_15x15', 'paper_20x20', 'lillgrund'):
        assert 'flies as sweep here' in (unfamiliar(policy, load(name)) or '')
    assert unfamiliar(policy, paper(area__cells_per_side=40)) is not None


def test_of_closed_cells_nothing_is_said_twice() -> None:
    """Seven of a hundred cells: shares of them, rounded one by one, do not cancel out."""
    row = [[0.0, 0.0], [350.0, 0.0], [350.0, 50.0], [0.0, 50.0]]
    homes = {HOME: {'cell': [5, 5]}, 'fleet.default.start': {'cell': [5, 5]}}
    kept = learned_on(load('paper_10x10', {'area.no_fly': [row], **homes}))
    assert kept.closed_share == pytest.approx(0.07)
    assert kept.known_share == 0.0


def test_a_header_of_what_was_learned_can_be_written() -> None:
    for scenario in (paper(), paper(fleet__default__energy_budget_kj=25.0), load('lillgrund')):
        kept = learned_on(scenario)
        policy = random_policy(header(learned_on=(kept,)))
        assert policy_from_bytes(policy_bytes(policy)).header.learned_on == (kept,)

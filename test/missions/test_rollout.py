from collections.abc import Callable
from dataclasses import replace
import hashlib

from interpreted import interpreted
import numpy as np
import pytest
from random_policies import Behind
from tiny_world import Script, tiny, TOTAL_BIT, uav
from uav_collect.analysis.metrics import check_log, mission_metrics
from uav_collect.errors import AllocationError, PolicyMismatchError
from uav_collect.limits import GUARD_AFTER
from uav_collect.missions.rollout import fly
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import fingerprint, load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import FORWARD, HOVER, LEFT, RIGHT
from uav_collect.uav.policy import Policy, policy_named

SPEEDS_MPS = (5.0, 10.0, 7.5, 12.0)
N_SEEDS = 20


def fleet_of(n_uavs: int, **overrides: object) -> Scenario:
    uavs = [{'speed_mps': speed_mps} for speed_mps in SPEEDS_MPS[:n_uavs]]
    return load('paper_10x10', {'fleet.uavs': uavs, **overrides})


def by_agents(rule: str) -> Callable[[], Policy]:
    return lambda: Behind(policy_named(rule))


def logs(
    scenario: Scenario,
    seeds: list[int],
    policy: str | Callable[[], Policy],
    allocator: str = 'exact',
) -> list[MissionLog]:
    return fly(build_site(scenario), seeds, policy, allocator, guard_after=0)


def text(log: MissionLog) -> bytes:
    # A rule has no guard to tell of; behind the protocol it has one that is switched off.
    uavs = tuple(replace(unit, guard_after=GUARD_AFTER) for unit in log.header.uavs)
    return replace(log, header=replace(log.header, uavs=uavs)).to_jsonl()


def digest(flown: list[MissionLog]) -> str:
    return hashlib.sha256(b''.join(text(log) for log in flown)).hexdigest()[:16]


# The same mission, flown in different ways, leaves the same bytes


def test_a_world_in_a_batch_flies_like_the_same_world_alone() -> None:
    scenario = load('paper_10x10')
    for policy in ('hert', 'sweep'):
        together = logs(scenario, [3, 4, 5], policy)
        alone = logs(scenario, [4], policy)
        assert text(together[1]) == text(alone[0])


def test_a_mission_that_outgrows_its_log_flies_on_as_if_it_had_not() -> None:
    # Random flight takes more events than a log has room for at first.
    scenario = load('paper_8x8')
    seeds = [*range(6)]
    together = logs(scenario, seeds, 'random')
    assert max(len(log.events) for log in together) > 2 * 256
    for seed, log in zip(seeds, together, strict=True):
        check_log(log)
        assert text(log) == text(logs(scenario, [seed], 'random')[0])


def test_a_batch_may_hold_one_seed_twice_and_in_any_order() -> None:
    scenario = load('paper_8x8')
    first, second, again = logs(scenario, [9, 2, 9], 'sweep')
    assert text(first) == text(again)
    assert text(second) == text(logs(scenario, [2, 9], 'sweep')[0])


def test_a_batch_may_be_empty() -> None:
    assert logs(load('paper_8x8'), [], 'sweep') == []


def digests_step_by_step() -> str:
    return digests_by(by_agents)


def digests_by(policy_of: Callable[[str], str | Callable[[], Policy]]) -> str:
    lines = []
    for n_uavs in (1, 2, 4):
        scenario = fleet_of(n_uavs)
        for rule in ('hert', 'sweep'):
            flown = logs(scenario, [*range(N_SEEDS)], policy_of(rule))
            lines += [
                f'{n_uavs} {rule} {log.header.mission_seed} {digest([log])}' for log in flown
            ]
    return '\n'.join(lines)


def test_interpreted_agents_step_by_step_fly_as_compiled_batches_do() -> None:
    assert interpreted(digests_step_by_step) == digests_by(lambda rule: rule)


ROUGH = {
    'radio.loss_share': 0.3,
    'radio.delay_s': [6.0, 5.0],
    'radio.rate_bps': 400.0,
    'radio.beacon_period_s': 3.0,
    'faults': [
        {'uav': 'any', 'kind': 'gone', 'at_s': [0, 200], 'share': 0.3},
        {'uav': 'any', 'kind': 'silent', 'at_decision': [0, 60], 'share': 0.3},
        {'uav': 'any', 'kind': 'slow', 'at_s': [0, 100], 'share': 0.3},
    ],
}


def rough_digests_step_by_step() -> str:
    return rough_digests_by(by_agents)


def rough_digests_by(policy_of: Callable[[str], str | Callable[[], Policy]]) -> str:
    flown = [
        (n_uavs, log)
        for n_uavs in (1, 2, 4)
        for log in logs(fleet_of(n_uavs, **ROUGH), [*range(N_SEEDS)], policy_of('sweep'))
    ]
    return '\n'.join(
        f'{n_uavs} {log.header.mission_seed} {len(log.faults)} {digest([log])}'
        for n_uavs, log in flown
    )


def test_where_messages_are_lost_and_uavs_fail_interpreted_agents_fly_as_compiled_batches() -> (
    None
):
    assert interpreted(rough_digests_step_by_step) == rough_digests_by(lambda rule: rule)


@pytest.mark.parametrize('rule', ['hert', 'hert-equal', 'sweep', 'random'])
def test_compiled_agents_step_by_step_fly_as_compiled_batches_do(rule: str) -> None:
    scenario = load('paper_8x8', {'fleet.default.energy_budget_kj': 50.0})
    assert digest(logs(scenario, [0, 1], by_agents(rule))) == digest(logs(scenario, [0, 1], rule))


def varied() -> list[tuple[str, Scenario]]:
    imperfect = {'radio.csi_error_variance': 0.05}
    reach = 'radio.contact_range_m'
    budget = 'fleet.default.energy_budget_kj'
    return [
        ('one', fleet_of(1)),
        ('two with imperfect CSI', fleet_of(2, **imperfect)),
        ('four with four antennas', fleet_of(4, **imperfect, **{'radio.n_antennas': 4})),
        ('two without radio, little energy', fleet_of(2, **{reach: 0.0, budget: 40.0})),
        ('four always in contact', fleet_of(4, **{reach: float('inf'), budget: 60.0})),
        ('dense', fleet_of(2, **{'demand.cell_share': 'all', 'radio.rician_a2': 0.0})),
        ('undiscounted', load('paper_8x8', {'reward.discount_per_s': 1.0})),
        ('a real site', load('lillgrund', {budget: 100.0})),
    ]


def digests_of_varied() -> str:
    return '\n'.join(
        f'{name}, {policy}, {allocator}: {digest(logs(scenario, [1, 2], policy, allocator))}'
        for name, scenario in varied()
        for policy in ('hert', 'hert-equal', 'sweep', 'random')
        for allocator in ('exact', 'equal')
    )


def test_compiled_and_interpreted_kernels_leave_the_same_bytes() -> None:
    assert interpreted(digests_of_varied) == digests_of_varied()


def digests_of_sixty_four() -> str:
    scenario = tiny(*[uav(5.0, energy_budget_kj=12.0)] * 64, sensors=[(175.0, 175.0, 1.0)])
    return ' '.join(digest(logs(scenario, [0], policy)) for policy in ('hert', by_agents('hert')))


def test_the_largest_fleet_flies_alike_in_every_way() -> None:
    batch, step_by_step = digests_of_sixty_four().split()
    assert batch == step_by_step
    assert interpreted(digests_of_sixty_four).split() == [batch] * 2


# What a log tells


@pytest.mark.parametrize('n_uavs', [1, 2, 4])
@pytest.mark.parametrize('policy', ['hert', 'sweep', 'random'])
def test_energy_accounts_close(n_uavs: int, policy: str) -> None:
    scenario = fleet_of(n_uavs, **{'fleet.default.energy_budget_kj': 150.0})
    for log in logs(scenario, [*range(5)], policy):
        mission = mission_metrics(log)
        for unit, own in ((u, log.events[log.events['uav'] == u.id]) for u in mission.uavs):
            left_j = own['energy_left_j'][-1] - own['energy_j'][-1]
            used_j = unit.energy_budget_j - left_j
            assert own['energy_j'].sum() == pytest.approx(used_j, rel=1e-9)
            assert unit.energy_j == pytest.approx(used_j, rel=1e-9)
            assert unit.energy_left_j == pytest.approx(left_j, rel=1e-9)
        assert mission.energy_j == pytest.approx(sum(u.energy_j for u in mission.uavs), rel=1e-12)


@pytest.mark.parametrize('policy', ['hert', 'hert-equal', 'sweep', 'random'])
def test_the_log_of_every_mission_adds_up(policy: str) -> None:
    for log in logs(fleet_of(4), [*range(3)], policy):
        check_log(log)
        mission = mission_metrics(log)
        assert mission.is_finished
        assert mission.is_safe
        assert np.isfinite(log.events['reward']).all()


@pytest.mark.parametrize('policy', ['hert', 'sweep'])
def test_with_energy_to_spare_rules_collect_everything(policy: str) -> None:
    for n_uavs in (1, 2, 4):
        for log in logs(fleet_of(n_uavs), [*range(10)], policy):
            assert mission_metrics(log).is_complete


def test_the_header_says_what_was_flown() -> None:
    scenario = tiny()
    header = logs(scenario, [7], 'sweep', 'equal')[0].header
    assert (header.scenario, header.mission_seed) == ('tiny', 7)
    assert header.scenario_fingerprint == fingerprint(scenario)
    assert header.total_bit == TOTAL_BIT
    assert [unit.id for unit in header.uavs] == [1, 2]
    assert [unit.policy for unit in header.uavs] == ['sweep', 'sweep']
    assert [unit.allocator for unit in header.uavs] == ['equal', 'equal']


def test_missions_of_other_seeds_are_other_missions() -> None:
    flown = logs(load('paper_8x8'), [*range(20)], 'sweep')
    assert len({log.header.total_bit for log in flown}) == 20


def test_optimal_bandwidth_never_hovers_longer_than_equal_shares() -> None:
    # HERT's way does not depend on the bandwidth while energy lasts.
    scenario = load('paper_8x8', {'fleet.uavs': [{'speed_mps': 10.0}]})
    for exact, equal in zip(
        logs(scenario, [*range(5)], 'hert'),
        logs(scenario, [*range(5)], 'hert', 'equal'),
        strict=True,
    ):
        assert exact.events['action'].tolist() == equal.events['action'].tolist()
        longer_s = exact.events['duration_s'] - equal.events['duration_s']
        assert (longer_s <= 1e-12).all()
        assert mission_metrics(exact).completion_s < mission_metrics(equal).completion_s


def test_cvxpy_flies_the_mission_of_the_exact_allocator() -> None:
    scenario = load('paper_8x8', {'demand.cell_share': 0.15})
    exact, solved = (logs(scenario, [3], 'sweep', name)[0] for name in ('exact', 'cvxpy'))
    assert solved.events['action'].tolist() == exact.events['action'].tolist()
    assert (solved.events['action'] == HOVER).sum() >= 5
    for field in ('time_s', 'duration_s', 'energy_left_j', 'collected_bit', 'reward'):
        assert solved.events[field] == pytest.approx(exact.events[field], rel=1e-6, abs=1e-9)


def digests_of_cvxpy() -> str:
    scenario = load('paper_8x8', {'demand.cell_share': 0.15})
    return ' '.join(digest([logs(scenario, [3], 'sweep', 'cvxpy')[0]]) for _ in range(2))


def test_cvxpy_flies_alike_whatever_was_flown_before() -> None:
    first, again = interpreted(digests_of_cvxpy).split()  # in a process that has solved nothing
    assert first == again


# What cannot be flown


def test_an_unknown_policy_is_refused() -> None:
    with pytest.raises(PolicyMismatchError, match="policy 'wisest' is unknown"):
        logs(tiny(), [0], 'wisest')


@pytest.mark.parametrize('policy', ['sweep', by_agents('sweep')], ids=['batch', 'step by step'])
def test_an_unknown_allocator_is_refused(policy: str | Callable[[], Policy]) -> None:
    with pytest.raises(
        AllocationError, match="allocator 'best' is unknown; there are exact, equal"
    ):
        logs(tiny(), [0], policy, 'best')


def test_a_policy_that_breaks_the_rules_is_stopped_at_its_first_illegal_action() -> None:
    scripts = [[FORWARD, FORWARD, RIGHT, RIGHT, LEFT], [RIGHT] * 2]
    with pytest.raises(PolicyMismatchError, match='UAV 1, event 7: action 4 is illegal'):
        logs(tiny(), [0], lambda: Script(scripts))

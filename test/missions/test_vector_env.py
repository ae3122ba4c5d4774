"""Stepping from outside flies the missions that a rollout flies, decision by decision."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
import hashlib
from itertools import pairwise

from interpreted import interpreted
import numpy as np
import pytest
from tiny_world import tiny, TOTAL_BIT, uav
from uav_collect.errors import AllocationError, ConfigError
from uav_collect.kernels.arrays import Floats, Ints, Row
from uav_collect.kernels.handle import Handle
from uav_collect.missions.batch_kernels import Batch, fly_batch
from uav_collect.missions.rollout import fly
from uav_collect.missions.vector_env import AwaitedDecisions, VectorEnv, VectorEnvConfig
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import BACKWARD, FORWARD, HOME, HOVER, N_ACTIONS, NONE, RIGHT
from uav_collect.uav.belief import Belief
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.observation import Layout, observation_size, Observer
from uav_collect.uav.policy import Policy, policy_named
from uav_collect.uav.view import LocalView

SEEDS = (3, 4, 5)


def paper() -> Scenario:
    # The second and third UAV have too little energy: they turn home while the first goes on.
    short = {'speed_mps': 10.0, 'energy_budget_kj': 30.0}, {'energy_budget_kj': 20.0}
    fleet = [{'speed_mps': 5.0}, short[0], {'speed_mps': 7.5, **short[1]}]
    return load('paper_10x10', {'fleet.uavs': fleet})


def flights_of(scenario: Scenario, seeds: Sequence[int] = SEEDS, **how: object) -> VectorEnv:
    return VectorEnv(build_site(scenario), seeds, VectorEnvConfig(**how))


def kept(decisions: AwaitedDecisions) -> AwaitedDecisions:
    """A copy that outlives the next step."""
    return AwaitedDecisions(
        **{it.name: getattr(decisions, it.name).copy() for it in fields(decisions)}
    )


def stepped(env: VectorEnv, scripts: Sequence[Sequence[int]]) -> list[AwaitedDecisions]:
    """What the missions wait for, the end included, when each is flown by a list of actions."""
    chosen = [iter(script) for script in scripts]
    waits = [kept(env.decisions)]
    while (waits[-1].uav != NONE).any():
        actions = [next(script, HOVER) for script in chosen]
        waits.append(kept(env.step(np.array(actions))))
    return waits


@dataclass
class Noted:
    """A rule that notes what its UAV sees and may do."""

    rule: Policy
    notes: list[tuple[Floats, list[bool]]]
    name: str = 'noted'
    version: str = '1'

    def begin(self, briefing: Briefing, uav: int) -> None:
        self.rule.begin(briefing, uav)
        self.briefing, self.uav = briefing, uav

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        observer = Observer(Layout.EGOCENTRIC, self.briefing, self.uav)
        observed = np.array(observer.observe(belief, view, legal))
        self.notes.append((observed, [mark == 1 for mark in legal]))
        return self.rule.choose(belief, view, legal)


def noted(scenario: Scenario, seed: int) -> tuple[MissionLog, list[tuple[Floats, list[bool]]]]:
    """A mission of the sweep, and the notes of all UAVs in order."""
    notes: list[tuple[Floats, list[bool]]] = []
    site = build_site(scenario)
    logs = fly(site, [seed], lambda: Noted(policy_named('sweep'), notes), 'equal')
    return logs[0], notes


def decided(log: MissionLog) -> Ints:
    chosen: Ints = log.events['action'][log.events['action'] != HOME]
    return chosen


def test_each_decision_is_the_one_that_a_uav_of_a_rollout_has_to_make() -> None:
    flown = [noted(paper(), seed) for seed in SEEDS]
    waits = stepped(flights_of(paper()), [decided(log) for log, _ in flown])
    for world, (log, notes) in enumerate(flown):
        own = log.events[log.events['action'] != HOME]
        assert len(own) == len(notes) < len(log.events)
        for wait, event, (observation, legal) in zip(waits, own, notes, strict=False):
            assert wait.uav[world] == event['uav'] - 1
            assert wait.time_s[world] == event['time_s']
            assert wait.observation[world].tolist() == observation.tolist()
            assert wait.legal[world].tolist() == legal
        assert all(wait.uav[world] == NONE for wait in waits[len(own) :])


def test_rewards_and_durations_are_those_of_the_log() -> None:
    scenario = paper()
    for seed in SEEDS:
        log, _ = noted(scenario, seed)
        waits = stepped(flights_of(scenario, [seed]), [decided(log)])
        discounts = scenario.reward.discount_per_s ** log.events['time_s']
        steps = [
            scenario.reward.discount_per_s ** before.time_s[0] * after.reward[0]
            for before, after in pairwise(waits)
        ]
        assert sum(steps) == pytest.approx((discounts * log.events['reward']).sum(), rel=1e-9)
        end_s = (log.events['time_s'] + log.events['duration_s']).max()
        assert sum(wait.duration_s[0] for wait in waits) == pytest.approx(end_s)
        assert waits[-1].time_s[0] == end_s


def test_a_mission_that_is_over_waits_for_nothing_and_earns_nothing() -> None:
    scripts = [decided(noted(paper(), seed)[0]) for seed in SEEDS]
    waits = stepped(flights_of(paper()), scripts)
    first = min(range(len(SEEDS)), key=lambda world: len(scripts[world]))
    later = waits[len(scripts[first]) + 1 :]
    assert later
    for wait in later:
        assert wait.uav[first] == NONE
        assert not wait.legal[first].any()
        assert wait.reward[first] == wait.duration_s[first] == 0.0


def test_what_is_legal_is_known_after_a_step_that_was_interrupted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupted(held: Handle[Batch], answers: Row[int]) -> int:
        fly_batch(held, answers)
        raise KeyboardInterrupt

    env, whole = (flights_of(tiny(uav(5.0)), SEEDS[:1]) for _ in range(2))
    to_a, hover = np.array([RIGHT]), np.array([HOVER])
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr('uav_collect.missions.vector_env.fly_batch', interrupted)
        env.step(to_a)
    whole.step(to_a)
    assert env.decisions.legal.tolist() == whole.decisions.legal.tolist()
    assert env.step(hover).time_s.tolist() == whole.step(hover).time_s.tolist()


def test_a_mission_steps_the_same_alone_and_beside_others() -> None:
    scripts = [decided(noted(paper(), seed)[0]) for seed in SEEDS]
    together = stepped(flights_of(paper()), scripts)
    alone = stepped(flights_of(paper(), SEEDS[1:2]), scripts[1:2])
    for one, other in zip(alone, together, strict=False):
        for field in fields(AwaitedDecisions):
            assert getattr(one, field.name)[0].tolist() == getattr(other, field.name)[1].tolist()


def test_a_mission_restarts_in_the_place_of_another() -> None:
    scripts = [decided(noted(paper(), seed)[0]) for seed in SEEDS]
    env = flights_of(paper(), SEEDS[:1])
    stepped(env, scripts[:1])
    env.restart(0, SEEDS[2])
    again = stepped(env, scripts[2:])
    fresh = stepped(flights_of(paper(), SEEDS[2:]), scripts[2:])
    assert [wait.observation.tolist() for wait in again] == [
        wait.observation.tolist() for wait in fresh
    ]
    assert [wait.reward.tolist() for wait in again] == [wait.reward.tolist() for wait in fresh]


def test_the_global_state_is_what_records_keep_for_the_mixer() -> None:
    log, _ = noted(paper(), SEEDS[0])
    env = flights_of(paper(), SEEDS[:1], max_decisions=len(log.events))
    states = [env.global_state(0)]
    for action in decided(log):
        env.step(np.array([action]))
        states.append(env.global_state(0))
    records = env.episode(0).records
    maps = np.concatenate([records.complete, records.true_complete], axis=1)
    bits = np.unpackbits(maps.reshape(len(maps), 4, -1), axis=-1, count=100, bitorder='little')
    before = np.array(states[:-1])
    assert before[:, :12].astype(np.float32).tolist() == records.fleet.tolist()
    assert before[:, 12:].tolist() == bits.reshape(len(maps), -1).tolist()
    # The paper's corner, all budgets partly spent, everybody home.
    assert states[-1][:12:4].tolist() == states[-1][1:12:4].tolist() == [0.05] * 3
    assert states[-1][3:12:4].tolist() == [0.0] * 3


def test_both_layouts_can_be_had() -> None:
    for layout in Layout:
        decisions = flights_of(tiny(), [0, 1], layout=layout).decisions
        assert decisions.observation.shape == (2, observation_size(layout, 16, 2))


@pytest.mark.parametrize('allocator', ['cvxpy', 'best'])
def test_an_allocator_that_no_kernel_knows_is_refused(allocator: str) -> None:
    with pytest.raises(AllocationError, match=f"'{allocator}'.*exact, equal"):
        flights_of(tiny(), [0], allocator=allocator)


def test_the_exact_allocator_hovers_shorter_over_two_sensors_than_the_equal_one() -> None:
    hovers_s = {}
    for allocator in ('equal', 'exact'):
        env = flights_of(tiny(uav(5.0)), [0], allocator=allocator)
        for action in (RIGHT, RIGHT, FORWARD, FORWARD, HOVER):  # to cell 10
            decisions = env.step(np.array([action]))
        hovers_s[allocator] = decisions.duration_s[0]
    assert 0.0 < hovers_s['exact'] < 0.95 * hovers_s['equal']


@pytest.mark.parametrize('action', [HOVER, BACKWARD, HOME, NONE, N_ACTIONS, 77])
def test_an_illegal_action_is_refused_and_nothing_moves(action: int) -> None:
    env = flights_of(tiny(), [0, 31])
    before = kept(env.decisions)
    with pytest.raises(ValueError, match=rf'action {action} of UAV 1 in mission 31 .* \[1, 2\]'):
        env.step(np.array([FORWARD, action]))
    assert env.decisions.observation.tolist() == before.observation.tolist()
    assert env.decisions.time_s.tolist() == [0.0, 0.0]


def test_one_action_per_mission_is_needed() -> None:
    with pytest.raises(ValueError, match=r'actions must have shape \(2,\), got \(1,\)'):
        flights_of(tiny(), [0, 1]).step(np.array([FORWARD]))


def test_a_fleet_that_cannot_start_is_refused() -> None:
    with pytest.raises(ConfigError, match='energy'):
        flights_of(tiny(fleet__default__energy_budget_kj=1.5))


def test_collecting_all_by_hand_earns_the_data_and_the_bonus() -> None:
    # One UAV collects A and B; without discount and penalty the rewards are data plus bonus.
    scenario = tiny(reward__discount_per_s=1.0, reward__move_penalty_per_s=0.0)
    waits = stepped_by_the_sweep(scenario)
    budget_j = scenario.uavs[0].energy_budget_j
    log = fly(build_site(scenario), [0], 'sweep', 'equal')[0]
    bonus = budget_j * TOTAL_BIT / 1e6 / log.events['energy_j'].sum()
    assert sum(wait.reward[0] for wait in waits) == pytest.approx(TOTAL_BIT / 1e6 + bonus)


def stepped_by_the_sweep(scenario: Scenario) -> list[AwaitedDecisions]:
    log = fly(build_site(scenario), [0], 'sweep', 'equal')[0]
    return stepped(flights_of(scenario, [0]), [decided(log)])


def digest_of_steps() -> str:
    """A digest of all that missions hand out."""
    digest = hashlib.sha256()
    for seed in SEEDS[:2]:
        log, _ = noted(paper(), seed)
        for wait in stepped(flights_of(paper(), [seed]), [decided(log)]):
            for field in fields(wait):
                digest.update(np.ascontiguousarray(getattr(wait, field.name)).tobytes())
    return digest.hexdigest()


def test_missions_step_the_same_compiled_and_interpreted() -> None:
    assert digest_of_steps() == interpreted(digest_of_steps)

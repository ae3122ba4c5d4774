"""What action values are learned towards, worked out by hand: missions of a few events.

In these networks every Q value is its action's alone, 1 to 5 in the target network and 5 to 1 in
the online one, and the mixer adds: a team's value is a sum of small numbers. Rewards halve each
second.
"""

from collections.abc import Sequence

from episodes import batch_of, hand_episode, HandDecision, single_threaded_torch, small
import numpy as np
import pytest
from tiny_world import tiny, uav
from uav_collect.learning.minibatch import Algorithm, Minibatch
from uav_collect.missions.experience import Episode
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.training.config import TrainingConfig
from uav_collect.uav.briefing import brief

torch = single_threaded_torch()
from uav_collect.learning.collector import Collector
from uav_collect.learning.learner import Learner
from uav_collect.learning.network import Networks

AQMIX, QMIX, AIQL = Algorithm.AQMIX, Algorithm.QMIX, Algorithm.AIQL
ONLINE, TARGET = (5.0, 4.0, 3.0, 2.0, 1.0), (1.0, 2.0, 3.0, 4.0, 5.0)

# The first UAV decides at 0 s and at 2 s, the second one at 0 s; the mission ends at 5 s.
THREE_EVENTS = (
    HandDecision(uav=0, time_s=0.0, action=0, reward=1.0),
    HandDecision(uav=1, time_s=0.0, action=1, reward=2.0),
    HandDecision(uav=0, time_s=2.0, action=2, reward=4.0),
)
END_S = 5.0
# Both decide at 0 s and at 2 s, as in synchronous missions.
TWO_INSTANTS = (
    HandDecision(uav=0, time_s=0.0, action=0, reward=16.0),
    HandDecision(uav=1, time_s=0.0, action=1, reward=2.0),
    HandDecision(uav=0, time_s=2.0, action=2, reward=8.0),
    HandDecision(uav=1, time_s=2.0, action=3, reward=4.0),
)


def settings(**overrides: object) -> TrainingConfig:
    return small(**{'reward__discount_per_s': 0.5} | overrides)


def make_constant(networks: Networks, values: Sequence[float]) -> None:
    """Let Q values be those of the actions, and the mixer add them; they must be positive."""
    for parameter in networks.parameters():
        parameter.data.zero_()
    networks.agent.head.bias.data.copy_(torch.tensor(values))
    for mixer in networks.mixers:
        mixer.inner_weight[-1].bias.data.view(-1, 4)[:, 0] = 1.0  # the first of four embeddings
        mixer.outer_weight[-1].bias.data[0] = 1.0


def constant_learner(algorithm: Algorithm, **overrides: object) -> Learner:
    learner = Learner(settings(**overrides), [brief(tiny())], algorithm, seed=0)
    make_constant(learner.networks, ONLINE)
    make_constant(learner.target, TARGET)
    return learner


def by_hand(
    decisions: Sequence[HandDecision], algorithm: Algorithm, end_s: float | None = END_S
) -> Minibatch:
    episode = hand_episode(brief(tiny()), decisions, end_s)
    return batch_of([episode], tiny(), settings(), algorithm)


def targets(algorithm: Algorithm, batch: Minibatch, **overrides: object) -> list[float]:
    goals: list[float] = constant_learner(algorithm, **overrides).targets(batch).tolist()
    return goals


def test_aqmix_maximises_for_the_uav_that_decides_next_and_keeps_the_running_action() -> None:
    # 1 + (1 + 5): the first UAV runs action 0, the second one decides; no time has passed.
    # 2 + 0.5^2 (5 + 2): the first UAV decides, the second one runs action 1. Then 4 to the end.
    batch = by_hand(THREE_EVENTS, AQMIX)
    assert batch.entry.tolist() == [0, 1, 2]
    assert targets(AQMIX, batch) == [7.0, 3.75, 4.0]


def test_the_best_action_is_a_legal_one() -> None:
    first, second, third = THREE_EVENTS
    batch = by_hand([first, second, third._replace(legal=0b00110)], AQMIX)
    assert targets(AQMIX, batch) == [7.0, 2.0 + 0.25 * (3.0 + 2.0), 4.0]


@pytest.mark.parametrize(
    ('algorithm', 'expected'),
    [(AQMIX, [3.0, 2.75, 4.0]), (AIQL, [3.25, 4.0, 3.0])],
)
def test_double_q_lets_the_online_network_choose_and_the_target_network_judge(
    algorithm: Algorithm, expected: list[float]
) -> None:
    # The online network likes action 0 best, which is worth 1.
    batch = by_hand(THREE_EVENTS, algorithm)
    assert targets(algorithm, batch, target__double_q=True) == expected


def test_lambda_returns_mix_in_what_the_next_entry_is_learned_towards() -> None:
    # From the end: 4, then 2 + 0.25 (7 + 4) / 2, then 1 + (6 + 3.375) / 2.
    batch = by_hand(THREE_EVENTS, AQMIX)
    assert targets(AQMIX, batch, target__trace=0.5) == [5.6875, 3.375, 4.0]
    assert targets(AQMIX, batch, target__trace=1.0) == [4.0, 3.0, 4.0]  # the rewards alone


def test_aiql_goes_on_to_the_uavs_own_next_decision_with_the_teams_reward_until_then() -> None:
    # First UAV: 1 + 2 + 0.25 * 5, then 4; second one: 2 + 0.25 * 4 until the mission ends.
    batch = by_hand(THREE_EVENTS, AIQL)
    assert batch.entry.tolist() == [0, 2, 1]
    assert targets(AIQL, batch) == [4.25, 4.0, 3.0]
    assert targets(AIQL, batch, target__trace=0.5) == [3.0 + 0.25 * (2.5 + 2.0), 4.0, 3.0]


def test_qmix_goes_on_from_instant_to_instant_where_all_maximise() -> None:
    # 2 + 0.25 * 8, earned before the second UAV's turn at 2 s, + 0.25 (5 + 5); then 4.
    batch = by_hand(TWO_INSTANTS, QMIX)
    assert batch.entry.tolist() == [1, 3]
    assert batch.decides.tolist()[3] == [True, True]
    assert targets(QMIX, batch) == [6.5, 4.0]
    assert targets(QMIX, batch, target__double_q=True) == [4.5, 4.0]
    assert targets(QMIX, batch, target__trace=0.5) == [4.0 + 0.25 * (5.0 + 2.0), 4.0]


def test_a_uav_that_is_home_adds_nothing() -> None:
    first, second, third = THREE_EVENTS
    decisions = [first, second, third._replace(home=(1,))]
    assert targets(AQMIX, by_hand(decisions, AQMIX)) == [7.0, 2.0 + 0.25 * 5.0, 4.0]
    assert targets(QMIX, by_hand(decisions, QMIX)) == [2.0 + 0.25 * 5.0, 4.0]


def test_a_mission_that_is_cut_off_goes_on_from_its_last_decision() -> None:
    batch = by_hand(THREE_EVENTS, AQMIX, end_s=None)
    assert targets(AQMIX, batch) == [7.0, 3.75]
    # The return of the last entry is its one-step target: nothing is known of what follows.
    assert targets(AQMIX, batch, target__trace=0.5) == [1.0 + (6.0 + 3.75) / 2.0, 3.75]


def test_of_a_mission_cut_off_aiql_learns_what_each_uav_saw_the_end_of() -> None:
    batch = by_hand(THREE_EVENTS, AIQL, end_s=None)
    assert batch.entry.tolist() == [0]
    assert targets(AIQL, batch) == [4.25]


def test_a_synchronous_mission_is_cut_off_at_the_last_instant_that_is_known_whole() -> None:
    # At 2 s the second UAV had not had its turn: what the team may do best is not known.
    later = [HandDecision(uav=0, time_s=4.0, action=0)]
    batch = by_hand([*TWO_INSTANTS, *later], QMIX, end_s=None)
    assert batch.entry.tolist() == [1]
    assert targets(QMIX, batch) == [6.5]


def test_the_loss_is_the_mean_square_of_what_the_teams_values_miss() -> None:
    # Values 5, 5 + 4, 3 + 4 of the running actions against targets 7, 3.75, 4.
    loss = constant_learner(AQMIX).loss(by_hand(THREE_EVENTS, AQMIX))
    assert float(loss.detach()) == pytest.approx((2.0**2 + 5.25**2 + 3.0**2) / 3.0)


def test_an_independent_uavs_loss_is_of_its_own_values() -> None:
    loss = constant_learner(AIQL).loss(by_hand(THREE_EVENTS, AIQL))
    assert float(loss.detach()) == pytest.approx((0.75**2 + 1.0**2 + 1.0**2) / 3.0)


def synchronous_missions(scenario: Scenario, learner: Learner) -> list[Episode]:
    """Missions in which all UAVs decide at the same instants, always greedily."""
    config = small(rollout__max_decisions_per_cell=1.5)
    collector = Collector(build_site(scenario), config, QMIX, seed=0)
    episodes: list[Episode] = []
    while len(episodes) < 4:
        episodes += collector.collect(learner.networks.agent, 50, epsilon=0.0)
    return episodes


def test_with_equal_durations_aqmix_starts_from_the_joint_maximum_that_qmix_does() -> None:
    # At each instant the UAVs decide one after another, no time between them. The last of them
    # completes a joint action of greedy ones: where AQMIX goes on from, and QMIX too.
    scenario = tiny(uav(5.0), uav(5.0), uav(5.0))
    learners = {
        algorithm: Learner(small(), [brief(scenario)], algorithm, seed=0)
        for algorithm in (AQMIX, QMIX)
    }
    episodes = synchronous_missions(scenario, learners[QMIX])
    future: dict[Algorithm, dict[int, float]] = {}
    for algorithm, learner in learners.items():
        batch = batch_of(episodes, scenario, small(), algorithm)
        goals = learner.targets(batch).double().numpy()
        goes_on = batch.next_entry >= 0
        worth = (goals - batch.reward)[goes_on] / batch.discount[goes_on]
        future[algorithm] = dict(zip(batch.next_entry[goes_on].tolist(), worth, strict=True))
    shared = sorted(future[QMIX])
    assert len(shared) > 20
    np.testing.assert_allclose(
        [future[AQMIX][decision] for decision in shared],
        [future[QMIX][decision] for decision in shared],
        rtol=1e-4,
        atol=1e-6,
    )


@pytest.mark.parametrize('trace', [0.0, 0.7])
def test_for_one_uav_aqmix_and_qmix_are_the_same_to_the_bit(trace: float) -> None:
    scenario = tiny(uav(5.0))
    losses = []
    for algorithm in (AQMIX, QMIX):
        config = small(target__trace=trace)
        learner = Learner(config, [brief(scenario)], algorithm, seed=0)
        episodes = synchronous_missions(scenario, learner)
        batch = batch_of(episodes, scenario, config, algorithm)
        losses.append([learner.update([(batch, 0)], 1e-3) for _ in range(3)])
    assert losses[0] == losses[1]


def test_what_follows_comes_to_count_as_the_target_warms_up() -> None:
    # After 0, 1 and 4 updates of 4: none, a quarter, all of 0.5^2 (5 + 2) and of (1 + 5).
    batch, learner = (
        by_hand(THREE_EVENTS, AQMIX),
        constant_learner(AQMIX, target__warm_up_updates=4),
    )
    found = []
    for learner.n_updates in (0, 1, 4):
        found.append(learner.targets(batch).tolist())
    assert found == [[1.0, 2.0, 4.0], [2.5, 2.4375, 4.0], [7.0, 3.75, 4.0]]

"""The training's rollout: its missions are the world's, to the bit."""

from collections.abc import Sequence
from itertools import pairwise

from checkpoints import read_back
from episodes import single_threaded_torch, small
import numpy as np
import pytest
from tiny_world import HOVER_W, MOVE_5_J, MOVE_10_J, rate_bps, Script, tiny, TOTAL_BIT, uav
from uav_collect.kernels.arrays import Floats
from uav_collect.learning.minibatch import Algorithm
from uav_collect.missions.experience import Episode
from uav_collect.missions.rollout import fly
from uav_collect.missions.vector_env import AwaitedDecisions, VectorEnv, VectorEnvConfig
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import FORWARD, HOME, HOVER, NONE, RIGHT
from uav_collect.uav.observation import Layout
from uav_collect.world.reward import Reward

torch = single_threaded_torch()
from uav_collect.learning.collector import Collector
from uav_collect.learning.network import Drqn

# Little energy, so that UAVs that fly about at random come home soon.
FLEET = uav(5.0, energy_budget_kj=25.0), uav(10.0, energy_budget_kj=12.0)
N_OBSERVED = 3 + 16 + 9 + 5 + 2


def agent(seed: int = 0) -> Drqn:
    torch.manual_seed(seed)
    return Drqn(N_OBSERVED, 8)


def collector_of(
    algorithm: Algorithm = Algorithm.AQMIX,
    seed: int = 0,
    faults: Sequence[dict[str, object]] | None = None,
    **overrides: object,
) -> Collector:
    scenario = tiny(*FLEET, **({} if faults is None else {'faults': faults}))
    return Collector(build_site(scenario), small(**overrides), algorithm, seed)


def collected(collector: Collector, n_missions: int, epsilon: float = 0.5) -> list[Episode]:
    """The missions that end first."""
    ended: list[Episode] = []
    while len(ended) < n_missions:
        ended += collector.collect(agent(), 20, epsilon)
    return ended


def flown_again(episode: Episode, scenario: Scenario) -> MissionLog:
    """The mission flown agent by agent, by the actions of the records."""
    records = episode.records
    scripts = [records.action[records.uav == each].tolist() for each in range(scenario.n_uavs)]
    site = build_site(scenario)
    return fly(site, [episode.mission_seed], lambda: Script(scripts), 'equal', guard_after=0)[0]


def whole_missions() -> list[Episode]:
    ended = collected(collector_of(rollout__max_decisions_per_cell=25.0), 6)
    assert all(it.is_whole for it in ended)
    return ended


def test_a_mission_whose_uavs_are_gone_before_they_decide_teaches_nothing() -> None:
    faults = [{'uav': uav, 'kind': 'gone', 'at_s': 0.0, 'share': 0.5} for uav in (1, 2)]
    collector = collector_of(faults=faults)
    episodes = collected(collector, 12)
    assert all(episode.n_decisions for episode in episodes)
    assert collector.n_missions > len(episodes)


def test_its_missions_are_those_of_the_worlds_log() -> None:
    scenario = tiny(*FLEET)
    for episode in whole_missions():
        records, log = episode.records, flown_again(episode, scenario)
        own = log.events[log.events['action'] != HOME]
        assert records.uav.tolist() == (own['uav'] - 1).tolist()
        assert records.action.tolist() == own['action'].tolist()
        assert records.time_s.tolist() == own['time_s'].tolist()
        assert records.decision.tolist() == own['decision'].tolist()
        assert records.energy_left_j.tolist() == own['energy_left_j'].tolist()
        assert episode.demand_bit.sum() == pytest.approx(log.header.total_bit)
        end_s = (log.events['time_s'] + log.events['duration_s']).max()
        ends_s = [*own['time_s'][1:], end_s]
        np.testing.assert_allclose(records.duration_s, ends_s - own['time_s'], atol=1e-9)


def test_a_decisions_reward_is_the_logs_until_the_next_decision() -> None:
    # The events of UAVs that turn home in between belong to it too.
    scenario = tiny(*FLEET)
    for episode in whole_missions():
        log = flown_again(episode, scenario)
        expected: list[float] = []
        for event in log.events:
            if event['action'] != HOME:
                since_s = event['time_s']
                expected.append(0.0)
            expected[-1] += 0.99 ** (event['time_s'] - since_s) * event['reward']
        np.testing.assert_allclose(episode.records.reward, expected, rtol=1e-9, atol=1e-12)


def test_the_collector_flies_on_with_other_missions_of_its_own_seeds() -> None:
    ended = [collected(collector_of(seed=seed), 12) for seed in (0, 0, 1)]
    seeds = [{it.mission_seed for it in each} for each in ended]
    assert seeds[0] == seeds[1]
    assert not seeds[0] & seeds[2]
    assert len(seeds[0]) == len(ended[0])
    assert min(seeds[0]) >= 2**61


def test_the_same_seed_collects_the_same_missions() -> None:
    one, other = (collected(collector_of(), 8) for _ in range(2))
    for mine, theirs in zip(one, other, strict=True):
        for column, again in zip(mine.records, theirs.records, strict=True):
            assert column.tolist() == again.tolist()


def test_missions_are_cut_off_after_so_many_decisions_with_what_they_wait_for() -> None:
    ended = collected(collector_of(rollout__max_decisions_per_cell=0.625), 8)
    for episode in ended:
        assert episode.n_decisions == 11
        assert not episode.is_whole
        assert episode.records.action[-1] == NONE
        assert (episode.records.action[:-1] != NONE).all()
        assert episode.records.reward[-1] == episode.records.duration_s[-1] == 0.0


def test_it_collects_as_many_decisions_as_asked_for_or_a_few_more() -> None:
    collector = collector_of()
    for goal in (40, 80, 120):
        collector.collect(agent(), 40, 0.5)
        assert goal <= collector.n_decisions < goal + 4


def test_without_exploration_it_flies_what_the_network_holds_best_from_a_fresh_hidden_state() -> (
    None
):
    # Step by step: each UAV's hidden state starts at zero in each mission and moves by its own
    # decisions alone.
    network = agent(seed=3)
    ended = [*collector_of(rollout__max_decisions_per_cell=1.875).collect(network, 300, 0.0)]
    assert len(ended) >= 8  # in four places: most of them after another mission
    site = build_site(tiny(*FLEET))
    for episode in ended:
        env = VectorEnv(site, [episode.mission_seed], VectorEnvConfig(layout=Layout.PAPER))
        hidden, decisions = torch.zeros(2, 8), env.decisions
        for uav_index, action in zip(episode.records.uav, episode.records.action, strict=True):
            if action == NONE:
                break
            seen = torch.from_numpy(decisions.observation).float()
            with torch.no_grad():
                values, moved = network.step(seen, hidden[uav_index][None])
            hidden[uav_index] = moved[0]
            values[0, ~torch.from_numpy(decisions.legal[0])] = -torch.inf
            assert decisions.uav[0] == uav_index
            assert int(values.argmax()) == action
            decisions = env.step(np.array([action]))


def test_exploration_is_the_same_whatever_the_network_and_the_place() -> None:
    # Epsilon 1: the networks choose nothing.
    missions = []
    for seed, n_places in ((0, 4), (7, 2)):
        collector = collector_of(rollout__missions_at_once=n_places)
        ended: list[Episode] = []
        while len(ended) < 4:
            ended += collector.collect(agent(seed), 20, 1.0)
        missions.append({it.mission_seed: it.records.action.tolist() for it in ended})
    shared = missions[0].keys() & missions[1].keys()
    assert shared
    assert all(missions[0][seed] == missions[1][seed] for seed in shared)


def test_recent_figures_are_those_of_the_missions_that_ended() -> None:
    collector = collector_of(rollout__max_decisions_per_cell=25.0)
    assert np.isnan(collector.recent.reward)
    ended = collected(collector, 5)
    assert collector.n_missions == len(ended)
    rewards = [it.records.reward.sum() for it in ended]
    assert collector.recent.reward == pytest.approx(np.mean(rewards))
    scenario, efficiencies = tiny(*FLEET), []
    for episode in ended:
        events = flown_again(episode, scenario).events
        efficiencies.append(events['collected_bit'].sum() / events['energy_j'].sum() / 1e3)
    assert collector.recent.efficiency_kbit_per_j == pytest.approx(np.mean(efficiencies))


def test_a_restored_collector_flies_on_as_the_one_that_was_saved() -> None:
    collector, other = collector_of(), collector_of(seed=5)
    collector.collect(agent(), 130, 0.5)
    other.restore(read_back(collector.state()))
    assert other.n_decisions == collector.n_decisions
    first, second = (each.collect(agent(), 200, 0.5) for each in (collector, other))
    assert len(first) == len(second) > 3
    for mine, theirs in zip(first, second, strict=True):
        assert mine.mission_seed == theirs.mission_seed
        for column, again in zip(mine.records, theirs.records, strict=True):
            assert column.tolist() == again.tolist()


def flown(scenario: Scenario, actions: Sequence[int], **how: object) -> list[AwaitedDecisions]:
    """What a mission waits for after each action."""
    env = VectorEnv(build_site(scenario), [0], VectorEnvConfig(**how))  # type: ignore[arg-type]
    waits = []
    for action in actions:
        decisions = env.step(np.array([action]))
        waits.append(
            AwaitedDecisions(**{name: value.copy() for name, value in vars(decisions).items()})
        )
    return waits


def rewards(waits: Sequence[AwaitedDecisions]) -> Floats:
    found: Floats = np.array([float(it.reward[0]) for it in waits])
    return found


def test_a_hovers_reward_sums_to_its_data_and_the_bonus_appears_once() -> None:
    # Undiscounted and without penalty: all rewards of a mission are its data and one bonus.
    undiscounted = {'reward__discount_per_s': 1.0, 'reward__move_penalty_per_s': 0.0}
    scenario = tiny(uav(10.0), **undiscounted)
    path = [RIGHT, HOVER, RIGHT, FORWARD, FORWARD, HOVER]
    assert rewards(flown(scenario, path)) == pytest.approx([0, 1.0, 0, 0, 0, 0.75], abs=1e-9)
    fleet = tiny(*FLEET, **undiscounted)
    config = small(rollout__max_decisions_per_cell=25.0)
    ended = collected(Collector(build_site(fleet), config, Algorithm.AQMIX, seed=0), 6)
    bonuses = []
    for episode in ended:
        events = flown_again(episode, fleet).events
        bit, energy_j = events['collected_bit'].sum(), events['energy_j'].sum()
        bonus = 25e3 * bit / 1e6 / energy_j
        assert episode.records.reward.sum() == pytest.approx(bit / 1e6 + bonus)
        bonuses.append(bonus)
    assert min(bonuses) == 0.0 < max(bonuses)


def test_the_energy_reward_counts_new_cells_and_kilojoules() -> None:
    # East: cells 2 and 6 turn out to be empty, 5 s flown. Hover: A is complete.
    scenario = tiny(uav(10.0), reward__discount_per_s=1.0)
    hover_s = 1e6 / rate_bps(1e6)
    found = rewards(flown(scenario, [RIGHT, HOVER], reward=Reward.ENERGY))
    assert found[0] == pytest.approx(2.0 - MOVE_10_J / 1e3, rel=1e-6)
    assert found[1] == pytest.approx(1.0 - HOVER_W * hover_s / 1e3, rel=1e-5)


def test_the_energy_reward_is_discounted_where_it_is_earned() -> None:
    scenario = tiny(uav(10.0), reward__discount_per_s=0.9)
    found = rewards(flown(scenario, [RIGHT], reward=Reward.ENERGY))[0]
    flown_s = (1.0 - 0.9**5.0) / -np.log(0.9)
    assert found == pytest.approx(2.0 * 0.9**5.0 - MOVE_10_J / 5e3 * flown_s, rel=1e-6)


def test_synchronous_missions_wait_hovering_for_the_slowest() -> None:
    # Both fly 50 m; the second one is there after 5 s and waits for 5 s.
    scenario = tiny(reward__discount_per_s=1.0)
    waits = flown(scenario, [RIGHT, FORWARD], is_synchronous=True, reward=Reward.ENERGY)
    first, second = waits
    assert (first.uav[0], first.time_s[0]) == (1, 0.0)
    assert (second.uav[0], second.time_s[0], second.duration_s[0]) == (0, 10.0, 10.0)
    spent_kj = (MOVE_5_J + MOVE_10_J + 5.0 * HOVER_W) / 1e3
    # The first one finds cells 2 and 6 empty, before the second one tells of 8 and 9.
    assert second.reward[0] == pytest.approx(2.0 - spent_kj, rel=1e-5)


def test_in_synchronous_missions_all_who_fly_decide_at_the_same_instants() -> None:
    for episode in collected(
        collector_of(Algorithm.QMIX, rollout__max_decisions_per_cell=25.0), 6
    ):
        records = episode.records
        for before, after in pairwise(range(episode.n_decisions)):
            is_same_instant = records.time_s[after] == records.time_s[before]
            assert is_same_instant == (records.uav[before] == 0 and records.uav[after] == 1)
        assert len(np.unique(records.time_s)) < 0.9 * episode.n_decisions


def test_waiting_costs_hovering_power() -> None:
    # What a UAV has left falls by what its action costs and by the wait for the other one.
    episode = collected(
        collector_of(Algorithm.QMIX, rollout__max_decisions_per_cell=25.0), 1, 1.0
    )[0]
    records = episode.records
    waited = 0
    for each, move_j, move_s in ((0, MOVE_5_J, 10.0), (1, MOVE_10_J, 5.0)):
        rows = np.flatnonzero(records.uav == each)
        for row, later in pairwise(rows):
            if records.action[row] == HOVER:
                continue
            spent_j = records.energy_left_j[row] - records.energy_left_j[later]
            wait_s = records.time_s[later] - records.time_s[row] - move_s
            assert spent_j == pytest.approx(move_j + HOVER_W * wait_s, rel=1e-4)
            waited += wait_s > 1.0
    assert waited > 0


def test_total_demand_is_that_of_the_mission() -> None:
    assert all(it.demand_bit.sum() == TOTAL_BIT for it in collected(collector_of(), 4))

"""Learning by branches: what is learned is how much better an action is than the advised one."""

from dataclasses import replace

from episodes import batch_of, flown, single_threaded_torch, small
import numpy as np
import pytest
from tiny_world import tiny, uav
from uav_collect.learning.minibatch import Algorithm
from uav_collect.learning.units import branch_share, reward_units, swept
from uav_collect.missions.rollout import fly
from uav_collect.scenario.site import build_site
from uav_collect.training.config import TrainingConfig
from uav_collect.uav.action_codes import N_ACTIONS
from uav_collect.uav.briefing import brief
from uav_collect.uav.frames import FRAME_ACTIONS
from uav_collect.uav.observation import frames, Layout

torch = single_threaded_torch()
from uav_collect.learning.collector import Collector
from uav_collect.learning.learner import Learner
from uav_collect.learning.trainer import Trainer
from uav_collect.training.progress import Budget

FLEET = uav(5.0, energy_budget_kj=25.0), uav(10.0, energy_budget_kj=12.0)


def settings(**overrides: object) -> TrainingConfig:
    return small('anywhere', **{'replay__rows_per_batch': 0, **overrides})


def test_the_loss_is_of_differences_from_the_advice_in_shares_of_their_variance() -> None:
    config, scenario = settings(reward__scale=0.5), tiny()
    missions = flown(scenario, [5], 12, layout=Layout.RELATIVE, branch_share=0.5)
    batch = batch_of(missions.episodes, scenario, config)
    learner = Learner(config, [brief(scenario)], Algorithm.BRANCHES, seed=0)
    assert len(learner.networks.mixers) == 0
    for parameter in learner.networks.parameters():
        parameter.data.zero_()
    given = torch.tensor([0.3, -0.1, 0.2, 0.0, 0.5])
    learner.networks.agent.head.bias.data.copy_(given)
    found, wanted = [], []
    for row, advice in enumerate(batch.advice.argmax(axis=1)):
        for action in range(N_ACTIONS):
            difference = batch.worth[row, action] - batch.worth[row, advice]
            if action != advice and not np.isnan(difference):
                found.append(float(given[action] - given[advice]) / 0.5)
                wanted.append(min(max(difference, -20.0), 4.0))
    assert 4 < len(wanted) < 4 * len(batch.worth)
    error = np.mean((np.array(found) - np.array(wanted)) ** 2) / (np.var(wanted) + 0.1)
    assert learner.loss(batch).item() == pytest.approx(error, rel=1e-5)


def test_the_worth_of_an_action_lies_in_the_frame_of_its_uav() -> None:
    scenario = tiny(*FLEET)
    missions = flown(scenario, [5, 6], 8, layout=Layout.RELATIVE, branch_share=1.0)
    batch = batch_of(missions.episodes, scenario, settings())
    worth = np.concatenate([it.records.worth for it in missions.episodes])
    assert all(it.records.is_judged[:-1].all() for it in missions.episodes)
    uavs = np.concatenate([it.records.uav for it in missions.episodes])
    frame_of = frames(Layout.RELATIVE, brief(scenario))[uavs]
    for row, (of, frame) in enumerate(zip(worth, frame_of, strict=True)):
        for action in range(N_ACTIONS):
            turned = batch.worth[batch.row[row], FRAME_ACTIONS[frame, action]]
            assert turned == of[action] or np.isnan(turned)


def test_missions_that_were_not_branched_teach_nothing() -> None:
    config, scenario = settings(), tiny()
    batch = batch_of(flown(scenario, [5], 6, layout=Layout.RELATIVE).episodes, scenario, config)
    learner = Learner(config, [brief(scenario)], Algorithm.BRANCHES, seed=0)
    before = learner.weights()
    assert learner.update([(batch, 0)], 1e-3).loss == 0.0
    assert all((before[name] == it).all() for name, it in learner.weights().items())


def test_a_mission_of_the_sweep_is_worth_nothing_in_its_own_unit() -> None:
    site, config = build_site(tiny(*FLEET)), settings()
    energy_j = [log.events['energy_j'].sum() for log in fly(site, range(16), 'sweep', 'equal')]
    assert swept(site).n_decisions > 4.0
    unit_j = reward_units(config, site).energy_j
    n_cells = len(brief(tiny()).is_open)
    assert unit_j * n_cells == pytest.approx(swept(site).j_per_cell * n_cells)
    assert unit_j * n_cells == pytest.approx(np.mean(energy_j), rel=0.2)
    absolute = replace(config, reward=replace(config.reward, unit=None))
    assert reward_units(absolute, site).energy_j == 1000.0


def test_long_missions_are_branched_at_as_many_decisions_as_short_ones() -> None:
    small_site, config = build_site(tiny(*FLEET)), settings(branches__decisions_per_mission=3.0)
    share = branch_share(config, small_site)
    assert share * swept(small_site).n_decisions == pytest.approx(3.0)
    assert branch_share(settings(branches__decisions_per_mission=1e6), small_site) == 1.0
    collector = Collector(small_site, config, Algorithm.AQMIX, seed=0)
    assert collector._env._branches is None


def test_a_few_updates_teach_not_to_turn_back() -> None:
    config = settings(
        network__hidden_size=16, optimiser__learning_rate=5e-3, network__advice_bonus=1.0,
        network__advice_bonus_last=0.0, network__advice_decay_share=0.5,
    )  # fmt: skip
    trainer = Trainer([tiny(*FLEET)], config, 'branches', 0)
    losses = [it.loss for it in trainer.run(Budget(decisions=3000)) if it.updates_per_s > 0.0]
    assert losses[-1] < 0.9

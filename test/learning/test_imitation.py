"""Imitation: what is learned is what a teacher would do, and the best at hand teaches."""

from episodes import batch_of, flown, single_threaded_torch, small
import numpy as np
import pytest
from random_policies import header, random_policy
from tiny_world import tiny, uav
from uav_collect.errors import PolicyMismatchError
from uav_collect.learning.minibatch import Algorithm
from uav_collect.learning.teaching import teaching
from uav_collect.learning.units import swept
from uav_collect.scenario.load import load
from uav_collect.scenario.site import build_site
from uav_collect.training.config import TrainingConfig
from uav_collect.uav.briefing import brief
from uav_collect.uav.observation import Layout
from uav_collect.uav.policy_network import LearnedPolicy

torch = single_threaded_torch()
from uav_collect.learning.learner import Learner
from uav_collect.learning.trainer import Trainer

SCENARIO = tiny(uav(5.0, energy_budget_kj=25.0), uav(10.0, energy_budget_kj=12.0))


def settings(**overrides: object) -> TrainingConfig:
    return small('imitation', **{'replay__rows_per_batch': 0, **overrides})


def learner_of(config: TrainingConfig) -> Learner:
    return Learner(config, [brief(SCENARIO)], Algorithm.IMITATION, seed=0)


@pytest.mark.parametrize('is_taught', [True, False])
def test_the_loss_is_how_unlikely_what_the_teacher_or_the_adviser_would_do_is(
    is_taught: bool,
) -> None:
    frozen = random_policy(header(Layout.EGOCENTRIC, 4, 2, hidden_size=8), seed=3)
    teacher = LearnedPolicy('teacher', frozen)
    missions = flown(
        SCENARIO, [5, 6], 12, layout=Layout.RELATIVE, teacher=teacher if is_taught else None
    )
    config = settings()
    batch, learner = batch_of(missions.episodes, SCENARIO, config), learner_of(config)
    assert len(learner.networks.mixers) == 0
    for parameter in learner.networks.parameters():
        parameter.data.zero_()
    given = np.array([0.3, -0.1, 0.2, 0.0, 0.5])
    learner.networks.agent.head.bias.data.copy_(torch.from_numpy(given))
    learner.networks.agent.advice_bonus = 0.1
    unlikely = []
    for legal, advice, worth in zip(batch.legal, batch.advice, batch.worth, strict=True):
        odds = np.where(legal, np.exp(given + 0.1 * advice), 0.0)
        known = np.nan_to_num(worth) if np.isfinite(worth).any() else advice
        unlikely.append(-np.log(odds[known.argmax()] / odds.sum()))
    assert learner.loss(batch).item() == pytest.approx(np.mean(unlikely), rel=1e-5)
    assert np.isfinite(batch.worth).any() == is_taught


def test_what_policies_hold_are_values_whoever_learned_them() -> None:
    config = settings(reward__scale=0.25, network__advice_bonus=0.5, target__update_rate=1.0)
    learner, again = learner_of(config), learner_of(config)
    by_values = Learner(config, [brief(SCENARIO)], Algorithm.AIQL, seed=1)
    batch = batch_of(flown(SCENARIO, [5], 12, layout=Layout.RELATIVE).episodes, SCENARIO, config)
    learner.update([(batch, 0)], 1e-3)
    for other in (again, by_values):
        other.load_weights(learner.weights())
    odds, same, values = (
        it.networks.agent(torch.from_numpy(batch.observation), batch.step_sizes)
        for it in (learner, again, by_values)
    )
    torch.testing.assert_close(same, odds)
    torch.testing.assert_close(values, 0.25 * odds)
    assert learner.networks.agent.advice_bonus == 2.0
    trainer = Trainer([SCENARIO], config, 'imitation', 0)
    assert trainer.snapshot().header.advice_bonus == 0.5


def test_policies_hold_the_mean_of_many_updates() -> None:
    config = settings(target__update_rate=0.25)
    batch = batch_of(flown(SCENARIO, [5], 12, layout=Layout.RELATIVE).episodes, SCENARIO, config)
    learner, mean = learner_of(config), None
    for _ in range(4):
        mean = learner.weights()['encoder.weight']
        learner.update([(batch, 0)], 1e-2)
        latest = learner.networks.agent.encoder.weight.detach().numpy()
        mean = mean + 0.25 * (latest - mean)
        np.testing.assert_allclose(learner.weights()['encoder.weight'], mean, atol=1e-6)
    assert not np.allclose(latest, mean, atol=1e-3)


def test_who_learns_comes_to_do_what_the_adviser_would() -> None:
    batch = batch_of(flown(SCENARIO, [5, 6], 12, layout=Layout.RELATIVE).episodes, SCENARIO,
                     settings())  # fmt: skip
    learner = learner_of(settings())
    losses = [learner.update([(batch, 0)], 1e-2).loss for _ in range(60)]
    assert losses[-1] < 0.2 * losses[0]


def test_the_sweep_teaches_unless_a_policy_that_fits_is_better() -> None:
    shipped = settings(imitation__teachers=['paper_15x15_n2_aqmix', 'paper_10x10_n2_aqmix'])
    site = build_site(load('paper_10x10'))
    mark = swept(site).kbit_per_j
    assert teaching(site, shipped, Algorithm.AQMIX) == (None, mark)
    taught = teaching(site, shipped, Algorithm.IMITATION)
    assert isinstance(taught.policy, LearnedPolicy)
    assert taught.policy.frozen.header.scenario == 'paper_10x10'
    assert taught.kbit_per_j > mark
    many = build_site(tiny(*[uav(5.0, energy_budget_kj=25.0)] * 7))
    assert teaching(many, shipped, Algorithm.IMITATION).policy is None  # nobody sees so many
    fleet = [{'speed_mps': speed_mps} for speed_mps in (5.0, 10.0, 8.0)]
    three = build_site(load('paper_10x10', {'fleet.uavs': fleet}))
    assert teaching(three, shipped, Algorithm.IMITATION).policy is not None  # of two UAVs
    small = build_site(load('paper_10x10', {'area.cells_per_side': 6}))  # where nobody learned
    assert teaching(small, shipped, Algorithm.IMITATION).policy is not None
    lost = build_site(load('paper_10x10', {'radio.contact_range_m': 0.0}))
    assert teaching(lost, shipped, Algorithm.IMITATION).policy is None  # it circles there


def test_who_teaches_is_judged_with_all_uavs_in_the_air() -> None:
    shipped = settings(imitation__teachers=['paper_10x10_n2_aqmix'])
    site, lost = (
        build_site(load('paper_10x10', {'faults': faults}))
        for faults in ([], [{'uav': 2, 'kind': 'gone', 'at_decision': 0}])
    )
    of_all, of_one = (teaching(it, shipped, Algorithm.IMITATION) for it in (site, lost))
    assert of_one.policy is not None
    assert of_one.kbit_per_j == of_all.kbit_per_j


def test_only_who_is_better_than_the_sweep_and_quick_enough_teaches() -> None:
    known = build_site(
        load('paper_8x8', {'demand.cell_share': 'all', 'demand.known_empty': 'sensors'})
    )
    taught = teaching(known, settings(imitation__teachers=['hert']), Algorithm.IMITATION)
    assert taught.policy is None
    assert taught.kbit_per_j == pytest.approx(swept(known).kbit_per_j)
    ahead = 'lookahead:sweep:8'
    for decision_ms, name in ((1e3, ahead), (1e-3, None)):
        config = settings(imitation__teachers=[ahead], imitation__decision_ms=decision_ms)
        policy = teaching(build_site(SCENARIO), config, Algorithm.IMITATION).policy
        assert (policy and policy.name) == name


def test_who_cannot_teach_is_refused() -> None:
    with pytest.raises(PolicyMismatchError, match=r"imitation\.teachers: .*'nobody' is unknown"):
        Trainer([SCENARIO], settings(imitation__teachers=['nobody']), 'imitation', 0)

"""Learning under the sweep's advice: it is collected by it, seen by it and learned towards it."""

from collections.abc import Callable
from dataclasses import replace

from episodes import batch_of, flown, hand_episode, HandDecision, single_threaded_torch, small
import numpy as np
from odd_areas import corridor, maze, pipeline
import pytest
from tiny_world import tiny
from uav_collect.errors import ConfigError
from uav_collect.learning.minibatch import Algorithm
from uav_collect.missions.experience import Episode
from uav_collect.missions.rollout import fly
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.training.config import load_preset, TrainingConfig
from uav_collect.uav.action_codes import HOME, N_ACTIONS
from uav_collect.uav.briefing import brief
from uav_collect.uav.frames import FRAME_ACTIONS
from uav_collect.uav.observation import frames, Layout, observation_size

torch = single_threaded_torch()
from uav_collect.learning.collector import Collector
from uav_collect.learning.learner import Learner
from uav_collect.learning.network import Drqn
from uav_collect.learning.saved import SavedPart
from uav_collect.learning.trainer import Trainer
from uav_collect.training.progress import Budget

BUDGET = Budget(decisions=4000)
FLEET = [{'speed_mps': 5.0}, {'speed_mps': 10.0}]


def deaf(**overrides: object) -> Scenario:
    """A rectangle with homes in two corners, where the sweep turns home early."""
    fleet = [
        {**each, 'start': {'cell': [*cell]}, 'home': {'cell': [*cell]}}
        for each, cell in zip(FLEET, ((7, 5), (7, 0)), strict=True)
    ]
    return corridor(8, 6, fleet__uavs=fleet, radio__contact_range_m=0.0, **overrides)


def relative(**overrides: object) -> TrainingConfig:
    return small('strong', observation='relative', **overrides)


def collected(scenario: Scenario, n_missions: int, epsilon: float, **how: object) -> list[Episode]:
    config = relative(rollout__missions_at_once=2, **how)
    collector = Collector(build_site(scenario), config, Algorithm.AQMIX, seed=0)
    torch.manual_seed(0)
    agent = Drqn(observation_size(Layout.RELATIVE, 1, 1), config.network.hidden_size)
    agent.advice_bonus = config.advice_bonus(0.0)
    ended: list[Episode] = []
    while len(ended) < n_missions:
        ended += collector.collect(agent, 20, epsilon)
    return ended[:n_missions]


@pytest.mark.parametrize(
    ('epsilon', 'how'),
    [(1.0, {'exploration__advice_share': 1.0}), (0.0, {'network__advice_bonus': 1e6})],
)
def test_the_advice_alone_collects_the_missions_of_the_sweep(
    epsilon: float, how: dict[str, float]
) -> None:
    scenario = deaf()
    how = {'rollout__max_decisions_per_cell': 10.0, **how}
    for episode in collected(scenario, 2, epsilon, **how):
        (log,) = fly(build_site(scenario), [episode.mission_seed], 'sweep', 'equal')
        decided = log.events[log.events['action'] != HOME]
        assert len(decided) < len(log.events) - 1 < 200
        assert episode.records.action.tolist() == decided['action'].tolist()
        assert episode.is_whole


SCENARIOS = [deaf, maze, lambda: pipeline(8), lambda: corridor(9, 4, fleet__uavs=FLEET)]


def test_rebuilt_maps_count_more_complete_cells_than_a_byte_holds() -> None:
    scenario = pipeline(20)
    for layout, config in ((Layout.EGOCENTRIC, small('strong')), (Layout.RELATIVE, relative())):
        missions = flown(scenario, [5], 10, layout=layout)
        batch = batch_of(missions.episodes, scenario, config)
        seen = np.array(missions.observations[0])
        assert (batch.observation[batch.row] == seen.astype(np.float32)).all()


@pytest.mark.parametrize('scenario_of', SCENARIOS)
def test_observations_are_those_that_were_encoded_in_flight(
    scenario_of: Callable[[], Scenario],
) -> None:
    scenario, config = scenario_of(), relative()
    missions = flown(scenario, [5, 6], 60, layout=Layout.RELATIVE)
    batch = batch_of(missions.episodes, scenario, config)
    seen = np.concatenate([np.array(it) for it in missions.observations])
    assert len(seen) > 40
    assert (batch.observation[batch.row] == seen.astype(np.float32)).all()
    # What is legal, and what was done, are in the frames that observations are in.
    records = [it.records for it in missions.episodes]
    uav, action = (np.concatenate([getattr(it, of) for it in records]) for of in ('uav', 'action'))
    frame = frames(Layout.RELATIVE, brief(scenario))[uav]
    assert (batch.action == FRAME_ACTIONS[frame, np.maximum(action, 0)]).all()
    assert batch.legal[batch.row, batch.action][action >= 0].all()
    assert (batch.advice.sum(axis=1) == 1.0).all()
    assert batch.legal[batch.advice == 1.0].all()


def test_other_layouts_have_no_advice() -> None:
    missions = flown(tiny(), [5], 20, layout=Layout.EGOCENTRIC)
    assert not batch_of(missions.episodes, tiny(), small('strong')).advice.any()


@pytest.mark.parametrize('double_q', [False, True])
def test_targets_are_of_the_action_that_is_chosen_under_the_bonus(double_q: bool) -> None:
    # Values are those of the actions in either network; advice is the least of them.
    config = relative(
        network__advice_bonus=2.5, target__double_q=double_q, target__trace=0.0, reward__scale=1.0
    )
    config = replace(config, reward=replace(config.reward, discount_per_s=0.5))
    learner = Learner(config, [brief(tiny())], Algorithm.AIQL, seed=0)
    for networks in (learner.networks, learner.target):
        for parameter in networks.parameters():
            parameter.data.zero_()
        networks.agent.head.bias.data.copy_(torch.arange(1.0, 6.0))
    decisions = [HandDecision(uav=0, time_s=time_s, action=1) for time_s in (0.0, 1.0, 2.0)]
    batch = batch_of([hand_episode(brief(tiny()), decisions, 3.0)], tiny(), config, Algorithm.AIQL)
    for advice, value in ((1, 5.0), (3, 4.0), (4, 5.0)):
        given = np.zeros_like(batch.advice)
        given[:, advice] = 1.0
        goals = learner.targets(replace(batch, advice=given)).tolist()
        assert goals[:2] == [0.5 * value, 0.5 * value]
    assert batch.advice.shape == (3, N_ACTIONS)


@pytest.mark.parametrize(
    ('key', 'value'),
    [
        ('network.advice_bonus', 0.5),
        ('network.advice_bonus_last', 0.5),
        ('exploration.advice_share', 0.1),
    ],
)
def test_settings_of_advice_are_refused_where_observations_show_none(
    key: str, value: float
) -> None:
    with pytest.raises(ConfigError, match=rf'{key} is {value:g}: must be 0 where observation is'):
        load_preset('strong', {key: value})
    assert load_preset('strong', {key: 0.0}).advice_bonus(0.0) == 0.0
    assert load_preset('strong', {'observation': 'relative', key: value}).layout == Layout.RELATIVE


def test_the_bonus_of_the_advice_fades_and_a_policy_keeps_what_it_was_validated_with() -> None:
    settings = {'advice_bonus': 0.4, 'advice_bonus_last': 0.0, 'advice_decay_share': 0.5}
    config = relative(**{f'network__{key}': value for key, value in settings.items()})
    assert [config.advice_bonus(share) for share in (0.0, 0.25, 0.5, 1.0)] == [0.4, 0.2, 0.0, 0.0]
    stays = relative(network__advice_bonus=0.4)
    assert stays.advice_bonus(1.0) == 0.4
    trainer = Trainer([tiny()], config, 'aqmix', 0)
    bonuses = [
        (trainer.snapshot().header.advice_bonus, trainer.share_done(BUDGET))
        for _ in trainer.run(BUDGET)
    ]
    assert bonuses[-1][0] == 0.0
    again = Trainer([tiny()], config, 'aqmix', 0)
    again.restore(SavedPart(trainer.state()))
    for of in (Trainer.snapshot, Trainer.best_policy):
        policy, saved = of(trainer), of(again)
        assert policy is not None and saved is not None
        assert saved.header.advice_bonus == policy.header.advice_bonus
    best = trainer.best_policy()
    assert best is not None
    share = best.header.decisions / BUDGET.decisions
    assert best.header.advice_bonus == pytest.approx(config.advice_bonus(share), abs=0.05)

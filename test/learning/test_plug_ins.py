"""What users write, as examples/ shows it: each learns, and what it learned flies on numpy."""

from dataclasses import replace
from pathlib import Path

from episodes import batch_of, flown, single_threaded_torch, small
import numpy as np
import pytest
from reports import joined, MissionSetup, ReportingFlight, reports_of, same
from tiny_world import tiny, uav
from uav_collect.errors import ConfigError, PolicyMismatchError
from uav_collect.kernels.arrays import Floats
from uav_collect.limits import GUARD_AFTER
from uav_collect.missions.experience import sparse_observations
from uav_collect.missions.own_reward import Outcomes, own_reward
from uav_collect.missions.rollout import fly
from uav_collect.missions.simulation import fly_by_agents
from uav_collect.scenario.site import build_site
from uav_collect.uav.briefing import brief
from uav_collect.uav.observation import AnyLayout, Layout
from uav_collect.uav.own_observation import own_layout
from uav_collect.uav.policy_file import policy_bytes, policy_from_bytes
from uav_collect.uav.policy_network import FrozenPolicy, LearnedPolicy

torch = single_threaded_torch()
from uav_collect.learning.learner import Learner
from uav_collect.learning.minibatch import Algorithm
from uav_collect.learning.own_modules import PluggedNetwork
from uav_collect.learning.trainer import Trainer
from uav_collect.training.progress import Budget

EXAMPLES = Path(__file__).parents[2] / 'examples'
SCENARIO = tiny(uav(5.0, energy_budget_kj=25.0), uav(10.0, energy_budget_kj=12.0))
# Settings and an algorithm, and whether what they learn needs the user's module on board.
PLUG_INS = {
    'vdn:Vdn': ({'mixer__kind': 'vdn:Vdn'}, 'aqmix', False),
    'qfix:QFix': ({'mixer__kind': 'qfix:QFix'}, 'qmix', False),
    'mlp:Mlp': ({'network__kind': 'mlp:Mlp'}, 'aqmix', False),
    'dueling:Dueling': ({'network__kind': 'dueling:Dueling'}, 'aiql', True),
    'time_left:TimeLeft': ({'observation': 'time_left:TimeLeft'}, 'aqmix', True),
    'quick_data:reward': ({'reward__goal': 'quick_data:reward'}, 'aqmix', False),
    'soft:Soft': ({}, 'soft:Soft', False),
}


@pytest.fixture(autouse=True)
def examples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(EXAMPLES)


def trained(name: str) -> tuple[Trainer, FrozenPolicy]:
    """A trainer by what a user wrote after a few updates, and its policy, by way of a file."""
    settings, algorithm, _ = PLUG_INS[name]
    trainer = Trainer([SCENARIO], small('strong', **settings), algorithm, 0)
    losses = [progress.loss for progress in trainer.run(Budget(decisions=300))]
    assert trainer.n_updates > 3
    assert np.isfinite(losses[-1])
    return trainer, policy_from_bytes(policy_bytes(trainer.policy()))


@pytest.mark.parametrize('name', PLUG_INS)
def test_what_a_user_wrote_learns_and_flies_on_numpy(name: str) -> None:
    trainer, policy = trained(name)
    observed = np.random.default_rng(0).random((3, policy.header.observation_size))
    memory = np.random.default_rng(1).random((3, policy.header.hidden_size))
    on_board = policy.step(observed, memory)
    with torch.no_grad():
        of_torch = trainer._learner.networks.agent.step(
            *(torch.tensor(it, dtype=torch.float32) for it in (observed, memory))
        )
    for flies, learned in zip(on_board, of_torch, strict=True):
        np.testing.assert_allclose(flies, learned.numpy(), rtol=1e-5, atol=1e-6)
    site = build_site(SCENARIO)
    [log] = fly(site, [7], lambda: LearnedPolicy('it', policy))
    alone = fly_by_agents(site, 7, lambda: LearnedPolicy('it', policy), 'exact', GUARD_AFTER)
    assert log.to_jsonl() == alone.to_jsonl()
    assert policy.header.code.startswith(f'{name}@')


@pytest.mark.parametrize('name', [name for name, (*_, is_needed) in PLUG_INS.items() if is_needed])
def test_a_policy_says_that_it_needs_a_module_which_is_missing(name: str) -> None:
    _, policy = trained(name)
    module, _, target = name.partition(':')
    moved = f'{"x" * len(module)}:{target}'.encode()
    content = policy_bytes(policy).replace(name.encode(), moved)
    with pytest.raises(PolicyMismatchError, match=rf'there is no module {"x" * len(module)} in'):
        policy_from_bytes(content)


def test_modules_called_layers_are_none_that_a_policy_lists() -> None:
    assert PluggedNetwork('odd_plug_ins:Nested', 7, 4).text == 'odd_plug_ins:Nested'


def test_what_a_network_counts_while_it_learns_flies_with_who_imitates(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / 'counting.py').write_text(
        'import torch\n'
        'from dueling import Dueling\n'
        'class Counting(Dueling):\n'
        '    def __init__(self, observation_size, hidden_size):\n'
        '        super().__init__(observation_size, hidden_size)\n'
        "        self.register_buffer('n_seen', torch.zeros(()))\n"
        '    def forward(self, observation, step_sizes):\n'
        '        if torch.is_grad_enabled():\n'
        '            self.n_seen += len(observation)\n'
        '        return super().forward(observation, step_sizes)\n'
    )
    config = small('imitation', network__kind='counting:Counting', replay__rows_per_batch=0)
    learner = Learner(config, [brief(SCENARIO)], Algorithm.IMITATION, seed=0)
    batch = batch_of(flown(SCENARIO, [5], 6, layout=Layout.RELATIVE).episodes, SCENARIO, config)
    learner.update([(batch, 0)], 1e-3)
    assert learner.weights()['n_seen'] == len(batch.legal)


def test_a_run_with_users_code_goes_on_from_its_checkpoint(tmp_path: Path) -> None:
    trainer, policy = trained('mlp:Mlp')
    trainer.save(tmp_path)
    other = Trainer([SCENARIO], trainer.config, 'aqmix', 0)
    other.load(tmp_path)
    assert other.policy().digest == policy.digest


# Observations.


def layout_of_example() -> AnyLayout:
    return own_layout('time_left:TimeLeft')


def test_a_learner_rebuilds_a_users_observation_to_the_bit() -> None:
    missions = flown(SCENARIO, [1, 2], 12, layout=layout_of_example())
    for episode, seen in zip(missions.episodes, missions.observations, strict=True):
        rows = sparse_observations(episode, layout_of_example(), brief(SCENARIO))
        rebuilt = np.zeros((episode.n_decisions, len(seen[0])), dtype=np.float32)
        for row, (start, stop) in enumerate(zip(rows.start, rows.stop, strict=True)):
            rebuilt[row, rows.column[start:stop]] = rows.value[start:stop]
        np.testing.assert_array_equal(rebuilt, np.array(seen, dtype=np.float32))
        assert (rebuilt[1:, -1] > 0.0).any()  # the clock


def test_a_users_numbers_stand_behind_those_of_the_layout_that_it_extends() -> None:
    own = flown(SCENARIO, [1], 6, layout=layout_of_example()).observations[0]
    base = flown(SCENARIO, [1], 6, layout=Layout.EGOCENTRIC).observations[0]
    np.testing.assert_array_equal([row[:-2] for row in own], base)


# Rewards.


def test_outcomes_sum_up_to_what_a_mission_achieved() -> None:
    seen: list[Outcomes] = []

    def reward(outcomes: Outcomes) -> Floats:
        seen.append(outcomes)
        return outcomes.energy_reward

    setup = MissionSetup(scenario=SCENARIO, own_reward=reward)
    for seed in (3, 4):
        setup.episodes([seed])
        flight = ReportingFlight(setup, seed)
        assert len([*flight.reports()]) > 3
        events, outcomes = flight.events(), seen[-1]
        assert outcomes.is_whole
        assert outcomes.n_new_cells.min() >= 0
        assert outcomes.n_new_cells.sum() > 3
        assert outcomes.collected_bit.sum() == pytest.approx(events['collected_bit'].sum())
        assert outcomes.energy_j.sum() == pytest.approx(events['energy_j'].sum(), rel=1e-5)
        assert outcomes.collected_bit.sum() > 0.0


def test_a_fleet_reports_what_makes_the_same_rewards_and_observations_of_a_users() -> None:
    setup = MissionSetup(
        scenario=SCENARIO, layout=layout_of_example(), own_reward=own_reward('quick_data:reward')
    )
    for cut in (10**6, 5):
        shortened = replace(setup, max_decisions=cut)
        reported = joined(shortened.joiner(), reports_of(shortened, [5, 6]))
        for one, other in zip(reported, shortened.episodes([5, 6]), strict=True):
            assert same(one.episode, other) == []
            assert np.abs(other.records.reward).sum() > 0.0


# Refusals: at once, in one line.


@pytest.mark.parametrize(
    ('settings', 'line'),
    [
        ({'mixer__kind': 'nowhere:Vdn'}, r'mixer.kind is nowhere:Vdn: there is no module nowhere'),
        ({'mixer__kind': 'vdn:Qdn'}, r'mixer.kind is vdn:Qdn: module vdn has no Qdn'),
        ({'mixer__kind': 'odd_plug_ins:Nothing'}, 'Nothing lacks state and forward: must have'),
        ({'mixer__kind': 'odd_plug_ins:NUMBER'}, 'NUMBER is a int: must be a class'),
        ({'network__kind': 'vdn:Vdn'}, 'Vdn lacks memory_size and step: must have'),
        ({'observation': 'odd_plug_ins:Blind'}, "base is 'radar': must be paper or egocentric"),
        ({'observation': 'odd_plug_ins:Listed'}, r"base is \('egocentric',\): must be paper or"),
        ({'observation': 'odd_plug_ins:Shy'}, r'none of your business \(odd_plug_ins.py, line'),
        ({'reward__goal': 'fastest'}, "is 'fastest': must be 'paper' or 'energy' or module:Name"),
    ],
)
def test_settings_that_name_what_is_missing_are_refused(
    settings: dict[str, object], line: str
) -> None:
    with pytest.raises(ConfigError, match=line) as refused:
        small('strong', **settings)
    assert '\n' not in str(refused.value)


@pytest.mark.parametrize(
    ('settings', 'algorithm', 'line'),
    [
        ({'mixer__kind': 'odd_plug_ins:Lazy'}, 'aqmix', r'forward gives \(2, 2\): must be'),
        ({'mixer__kind': 'odd_plug_ins:Broken'}, 'aqmix', r'no mix today \(odd_plug_ins.py, line'),
        ({'network__kind': 'odd_plug_ins:Forgetful'}, 'aqmix', 'on board it differs by'),
        (
            {'network__kind': 'odd_plug_ins:Misnamed'},
            'aqmix',
            "on board: tensor 'three.bias' is missing",
        ),
        ({'observation': 'odd_plug_ins:Short'}, 'aqmix', 'must be 1 finite numbers'),
        (
            {'network__kind': 'odd_plug_ins:Spelled'},
            'aqmix',
            "layers is 'one two': must be a list of names",
        ),
        ({'observation': 'odd_plug_ins:Learning'}, 'aqmix', 'must be 1 finite numbers'),
        ({'reward__goal': 'odd_plug_ins:learning'}, 'aqmix', 'finite numbers, one for each'),
        ({}, 'odd_plug_ins:Several', r"like is \('aqmix',\): must be aqmix or"),
        ({}, 'odd_plug_ins:Wild', "like is 'ddpg': must be aqmix or qmix or aiql"),
        (
            {},
            'ddpg',
            "algorithm is 'ddpg': must be aqmix, qmix, aiql, branches, imitation or module:Name",
        ),
        ({'reward__goal': 'odd_plug_ins:shouting'}, 'aqmix', "reward .* gives 'much': must be"),
    ],
)
def test_what_cannot_learn_is_refused_as_the_training_begins(
    settings: dict[str, object], algorithm: str, line: str
) -> None:
    with pytest.raises(ConfigError, match=line) as refused:
        trainer = Trainer([SCENARIO], small('strong', **settings), algorithm, 0)
        list(trainer.run(Budget(decisions=300)))
    assert '\n' not in str(refused.value)

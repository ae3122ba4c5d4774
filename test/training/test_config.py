"""Presets of a training: values in YAML, each known, each in its range, each switched alone."""

from dataclasses import FrozenInstanceError, replace
from pathlib import Path
from typing import Any

import pytest
from uav_collect.config.installed import shared_folders
from uav_collect.config.layers import names_in
from uav_collect.errors import ConfigError
from uav_collect.training.config import load_preset, TrainingConfig
from uav_collect.uav.observation import Layout
from uav_collect.world.reward import Reward


def leaves(section: dict[str, Any], path: str = '') -> dict[str, object]:
    """The settings by their dotted paths."""
    found: dict[str, object] = {}
    for name, value in section.items():
        here = f'{path}.{name}' if path else name
        found |= leaves(value, here) if isinstance(value, dict) else {here: value}
    return found


def settings(name: str) -> dict[str, object]:
    values = leaves(load_preset(name).as_mapping())
    del values['name']
    return values


def written(folder: Path, text: str) -> Path:
    (folder / 'mine.yaml').write_text(text)
    return folder / 'mine.yaml'


def test_every_shipped_preset_is_valid_and_has_its_files_name() -> None:
    names = names_in(shared_folders('training'))
    assert names == (
        'anywhere', 'field', 'field_anywhere', 'imitation', 'paper', 'refine', 'strong',
    )  # fmt: skip
    assert tuple(load_preset(name).name for name in names) == names


def test_refining_learns_and_sees_what_strong_does() -> None:
    same: Any = {'name': 'same', 'exploration': None, 'optimiser': None, 'rollout': None}
    strong, refine = load_preset('strong'), load_preset('refine')
    assert replace(strong, **same) == replace(refine, **same)
    assert refine.epsilon(0.0) < strong.epsilon(0.0)
    assert refine.learning_rate(1.0) < strong.learning_rate(1.0)


def test_the_paper_preset_holds_the_values_of_the_paper() -> None:
    # Section VII-A: 256 neurons in all hidden layers, 5e-5, 32, 1e6 samples, 0.99.
    paper = load_preset('paper')
    assert (paper.layout, paper.reward_kind) == (Layout.PAPER, Reward.PAPER)
    assert paper.network.hidden_size == 256
    assert (paper.mixer.embedding_size, paper.mixer.hypernetwork_size) == (256, 256)
    assert paper.optimiser.learning_rate == paper.optimiser.learning_rate_last == 5e-5
    assert (paper.replay.decisions, paper.replay.missions_per_batch) == (10**6, 32)
    assert paper.reward.discount_per_s == 0.99
    # Algorithm 1: an update at every event; the best of thirty missions after every 100.
    assert (paper.rollout.missions_at_once, paper.rollout.decisions_per_update) == (1, 1)
    assert (paper.validation.missions, paper.validation.every_missions) == (30, 100)
    assert paper.validation.best_by == 'efficiency'
    assert (paper.target.trace, paper.target.double_q) == (0.0, False)


def test_each_difference_of_strong_to_paper_can_be_switched_alone() -> None:
    paper, strong = settings('paper'), settings('strong')
    assert paper.keys() == strong.keys()
    different = {path: value for path, value in strong.items() if value != paper[path]}
    assert len(different) > 10
    for path, value in different.items():
        switched = leaves(load_preset('paper', {path: value}).as_mapping())
        assert {it for it in paper if switched[it] != paper[it]} == {path}
    assert leaves(load_preset('paper', different).as_mapping()) == strong | {'name': 'paper'}


def test_settings_written_out_read_back_the_same(tmp_path: Path) -> None:
    strong = load_preset('strong', {'target.trace': 0.35})
    assert load_preset(written(tmp_path, strong.to_yaml())) == strong


def test_a_file_extends_a_preset_and_is_called_by_its_name(tmp_path: Path) -> None:
    mine = load_preset(written(tmp_path, 'extends: strong\nnetwork: {hidden_size: 32}\n'))
    assert mine.name == 'mine'
    assert mine.network.hidden_size == 32
    assert replace(mine, name='strong') == load_preset('strong', {'network.hidden_size': 32})


WRONG = {
    'network: {hidden_sise: 8}': 'network.hidden_sise is an unknown key: must be',
    'nets: {hidden_size: 8}': 'nets is an unknown key: must be one of name, observation, reward',
    'network: {hidden_size: 0}': 'network.hidden_size is 0: must be a whole number from 1 to 4096',
    'network: {hidden_size: 64.5}': 'network.hidden_size is 64.5: must be a whole number',
    'network: {hidden_size: large}': "network.hidden_size is 'large': must be a whole number",
    'reward: {goal: money}': "reward.goal is 'money': must be 'paper' or 'energy'",
    'reward: {discount_per_s: 0}': 'reward.discount_per_s is 0: must be a number from 1e-06 to 1',
    'reward: {discount_per_s: 1.01}': 'reward.discount_per_s is 1.01: must be a number from 1e-06',
    'observation: wide': "observation is 'wide': must be 'paper' or 'egocentric'",
    'target: {trace: 1.5}': 'target.trace is 1.5: must be a number from 0 to 1',
    'target: {double_q: 2}': 'target.double_q is 2: must be true or false',
    'target: {double_q: 1}': 'target.double_q is 1: must be true or false',
    "target: {double_q: 'yes'}": "target.double_q is 'yes': must be true or false",
    'target: {update_rate: 0}': 'target.update_rate is 0: must be a number from 1e-06 to 1',
    'optimiser: {learning_rate: .nan}': 'optimiser.learning_rate is .nan: must be a number from',
    'optimiser: {learning_rate: }': 'optimiser.learning_rate is empty: must be a number from',
    'exploration: {hover_share: -1.5}': 'exploration.hover_share is -1.5: must be a number',
    'replay: {decisions: 10}': 'replay.decisions is 10: must be a whole number from 1000',
    'rollout: {bandwidth: cvxpy}': "rollout.bandwidth is 'cvxpy': must be 'equal' or 'exact'",
    'network: {hidden_size: 8, advice_decay_share: 0.5}': (
        'network.advice_decay_share is 0.5: must come with network.advice_bonus_last'
    ),
    'rollout: 5': 'rollout is 5: must be a mapping of keys',
    'replay: {sequence_decisions: -1}': 'replay.sequence_decisions is -1: must be a whole number',
    'validation: {best_by: reward}': "validation.best_by is 'reward': must be completeness or",
    'replay: {rows_per_batch: 9, sequence_decisions: 8}': (
        'replay.rows_per_batch is 9: must be 0 where replay.sequence_decisions is not'
    ),
}


@pytest.mark.parametrize(('text', 'problem'), WRONG.items(), ids=list(WRONG))
def test_what_is_wrong_is_named_with_file_line_key_and_what_is_allowed(
    text: str, problem: str, tmp_path: Path
) -> None:
    path = written(tmp_path, f'extends: strong\n{text}\n')
    with pytest.raises(ConfigError) as raised:
        load_preset(path)
    assert str(raised.value).startswith(f'{path}:2: {problem}')


@pytest.mark.parametrize(
    ('key', 'problem'),
    [
        ('hover_share', 'exploration.hover_share is missing: must be a number from -1 to 1'),
        ('goal', "reward.goal is missing: must be 'paper' or 'energy'"),
        ('double_q', 'target.double_q is missing: must be true or false'),
    ],
)
def test_a_missing_setting_is_named(key: str, problem: str, tmp_path: Path) -> None:
    complete = load_preset('strong').to_yaml()
    lines = [line for line in complete.splitlines() if f'{key}:' not in line]
    with pytest.raises(ConfigError) as raised:
        load_preset(written(tmp_path, '\n'.join(lines)))
    assert problem in str(raised.value)


def test_a_setting_of_a_section_is_replaced_and_the_others_stay(tmp_path: Path) -> None:
    mine = load_preset(written(tmp_path, 'extends: paper\nreward: {goal: energy}\n'))
    assert mine.reward.as_mapping() == {'goal': 'energy', 'discount_per_s': 0.99, 'scale': 1.0}


def test_several_mistakes_are_all_named(tmp_path: Path) -> None:
    path = written(tmp_path, 'extends: strong\ntarget: {trace: 2}\nreward: {scale: -1}\n')
    with pytest.raises(ConfigError) as raised:
        load_preset(path)
    assert len(str(raised.value).splitlines()) == 2


def test_a_preset_that_is_not_there_is_named_with_those_that_are() -> None:
    with pytest.raises(ConfigError, match=r"preset is 'weak'.*paper, refine, strong"):
        load_preset('weak')


def test_an_override_that_is_wrong_is_named() -> None:
    with pytest.raises(ConfigError, match=r'target\.traces is an unknown key'):
        load_preset('strong', {'target.traces': 0.5})


def test_settings_never_change() -> None:
    with pytest.raises(FrozenInstanceError):
        load_preset('strong').network.hidden_size = 8  # type: ignore[misc]


def of_schedule(**overrides: float) -> TrainingConfig:
    return load_preset('strong', {key.replace('__', '.'): it for key, it in overrides.items()})


def test_epsilon_falls_over_a_share_of_the_training_and_stays() -> None:
    config = of_schedule(
        exploration__epsilon_first=1.0, exploration__epsilon_last=0.2, exploration__decay_share=0.5
    )
    found = [config.epsilon(share) for share in (0.0, 0.25, 0.5, 0.75, 1.0)]
    assert found == pytest.approx([1.0, 0.6, 0.2, 0.2, 0.2])
    assert of_schedule(exploration__decay_share=0.0).epsilon(0.0) == pytest.approx(0.03)


@pytest.mark.parametrize(
    ('decay_share', 'bonuses'),
    [(0.5, [0.2, 0.1, 0.0, 0.0]), (0, [0.0] * 4), (1, [0.2, 0.15, 0.1, 0.0])],
)
def test_the_bonus_of_the_advice_falls_over_a_share_of_the_training(
    decay_share: float, bonuses: list[float]
) -> None:
    ends = {'network.advice_bonus': 0.2, 'network.advice_bonus_last': 0.0}
    config = load_preset('anywhere', {**ends, 'network.advice_decay_share': decay_share})
    assert [config.advice_bonus(share) for share in (0.0, 0.25, 0.5, 1.0)] == pytest.approx(
        bonuses
    )


def test_the_learning_rate_stays_then_falls_to_the_end() -> None:
    config = of_schedule(
        optimiser__learning_rate=5e-4,
        optimiser__learning_rate_last=1e-4,
        optimiser__decay_from_share=0.5,
    )
    found = [config.learning_rate(share) for share in (0.0, 0.5, 0.75, 1.0, 1.2)]
    assert found == pytest.approx([5e-4, 5e-4, 3e-4, 1e-4, 1e-4])
    constant = of_schedule(optimiser__decay_from_share=1.0)
    assert constant.learning_rate(1.0) == constant.learning_rate(0.0)


def test_missions_are_cut_off_by_the_size_of_their_area() -> None:
    config = of_schedule(rollout__max_decisions_per_cell=1.6)
    assert [config.max_decisions(n_cells) for n_cells in (1, 64, 100)] == [2, 102, 160]


def test_small_batches_come_first_where_settings_say_so() -> None:
    sizes = {'replay.missions_per_batch': 16, 'replay.missions_per_batch_first': 4}
    config = load_preset('strong', {**sizes, 'exploration.decay_share': 0.2})
    assert [config.missions_per_batch(share) for share in (0.0, 0.19, 0.2, 1.0)] == [4, 4, 16, 16]
    same = load_preset('strong', {**sizes, 'replay.missions_per_batch_first': 0})
    assert [same.missions_per_batch(share) for share in (0.0, 1.0)] == [16, 16]

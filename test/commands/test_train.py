"""The command train: what a run leaves in its folder, and what it says."""

from pathlib import Path

import pytest
from tiny_world import tiny
from train_command import columns, DECISIONS, events, Finished, learned
from uav_collect.__main__ import main
from uav_collect.scenario.load import fingerprint, from_yaml
from uav_collect.training.config import load_preset
from uav_collect.training.run_record import PROGRESS_COLUMNS, read_run, VALIDATION_COLUMNS
from uav_collect.uav.policy_file import load_policy

pytest.importorskip('torch', reason='training needs torch')

SCENARIOS = ('scenario.yaml', 'scenario_2.yaml')


def test_a_run_folder_says_what_was_trained(finished: Finished, settings: list[str]) -> None:
    run, _ = finished
    record = read_run(run)
    scenario = from_yaml((run / 'scenario.yaml').read_text())
    assert scenario == tiny(name='field')
    assert load_preset(run / 'training.yaml') == load_preset(settings[3])
    assert (record.scenario, record.n_uavs) == ('field', (2,))
    assert record.scenario_fingerprint == fingerprint(scenario)
    assert (record.algorithm, record.preset, record.seed) == ('aqmix', 'quick', 0)
    assert (record.decisions, record.minutes) == (DECISIONS, None)
    assert record.is_done
    assert set(record.versions) == {'uav_collect', 'python', 'numpy', 'numba', 'torch'}
    assert '-m uav_collect train --scenario' in record.command


def test_the_tables_have_units_and_end_with_the_budget(
    finished: Finished,
) -> None:
    run, _ = finished
    validations, progress = (columns(run / f'{name}.csv') for name in ('validation', 'progress'))
    assert tuple(validations) == VALIDATION_COLUMNS
    assert tuple(progress) == PROGRESS_COLUMNS
    assert int(validations['n_updates'][0]) == 10
    assert int(validations['n_decisions'][-1]) == int(progress['n_decisions'][-1]) == DECISIONS


def test_the_policy_is_the_best_of_the_validations(
    finished: Finished,
) -> None:
    run, done = finished
    header = load_policy(run / 'policy.safetensors').header
    validations = columns(run / 'validation.csv')
    row = validations['n_updates'].index(str(header.updates))
    validation = header.validation
    assert validation.efficiency_kbit_per_j == float(validations['efficiency_kbit_per_j'][row])
    assert validation.completion_s == float(validations['completion_s'][row])
    assert f'{validation.efficiency_kbit_per_j:.3f} kbit/J' in done.stdout


def test_the_last_policy_is_there_too(
    finished: Finished,
) -> None:
    run, _ = finished
    header = load_policy(run / 'last.safetensors').header
    assert header.decisions == DECISIONS


def test_a_run_draws_its_curve_and_says_where_all_is(
    finished: Finished,
) -> None:
    run, done = finished
    assert (run / 'curve.png').read_bytes().startswith(b'\x89PNG')
    assert f'policy: {run}/policy.safetensors' in done.stdout
    assert f'curve:  {run}/curve.png' in done.stdout


def test_the_progress_tells_speeds_loss_and_efficiency_and_no_time_left_of_seconds(
    finished: Finished,
) -> None:
    _, done = finished
    lines = done.stderr.splitlines()
    assert any('AQMIX, field, 2 UAVs, quick, seed 0, 1,200 decisions' in line for line in lines)
    words = ('decisions/s', 'updates/s', 'loss ', 'kbit/J exploring', 'validated', 'best')
    assert all(word in lines[-1] for word in words)
    assert not any(' left' in line for line in lines)


def test_tensorboard_shows_what_the_tables_have(
    finished: Finished,
) -> None:
    run, _ = finished
    validations = columns(run / 'validation.csv')
    shown = events(run, 'validation/completion_s')
    assert [step for step, _ in shown] == [int(text) for text in validations['n_decisions']]
    assert [value for _, value in shown] == pytest.approx(
        [float(text) for text in validations['completion_s']], rel=1e-6
    )


def test_another_seed_learns_something_else(
    finished: Finished, settings: list[str], tmp_path: Path
) -> None:
    assert main(['train', *settings, '--seed', '1', '--output', str(tmp_path / 'run')]) == 0
    assert learned(tmp_path / 'run') != learned(finished[0])


def test_a_run_starts_from_the_weights_of_a_policy(
    finished: Finished, settings: list[str], tmp_path: Path
) -> None:
    initial, folder = finished[0] / 'policy.safetensors', tmp_path / 'run'
    few = ['--decisions', '1', '--start-from', str(initial), '--output', str(folder)]
    assert main(['train', *settings[:4], *few]) == 0
    learned_from, kept = load_policy(initial), load_policy(folder / 'initial.safetensors')
    assert kept.digest == load_policy(folder / 'last.safetensors').digest == learned_from.digest
    assert read_run(folder).initial == learned_from.header.version


def test_one_policy_learns_to_fly_several_fleets(settings: list[str], tmp_path: Path) -> None:
    folder = tmp_path / 'run'
    assert main(['train', *settings, '--uavs', '1', '2', '--output', str(folder)]) == 0
    header = load_policy(folder / 'policy.safetensors').header
    assert (header.n_uavs_min, header.n_uavs_max) == (1, 2)
    assert read_run(folder).scenario_text == 'field, 1 to 2 UAVs'
    scenarios = [from_yaml((folder / name).read_text()) for name in SCENARIOS]
    assert [scenario.n_uavs for scenario in scenarios] == [1, 2]

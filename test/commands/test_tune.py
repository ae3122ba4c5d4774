"""The command tune: every combination in a folder of its own, and which did best."""

import argparse
from dataclasses import replace
from pathlib import Path

import pytest
from random_policies import header, random_policy, VALIDATION
from train_command import columns, said
from uav_collect.__main__ import main
from uav_collect.commands.tune import _compare, variants, varied
from uav_collect.errors import TrainingRunError
from uav_collect.training.run_record import read_run, VALIDATION_COLUMNS, VALIDATION_FILE
from uav_collect.uav.policy_file import load_policy, save_policy

pytest.importorskip('torch', reason='training needs torch')


def test_every_combination_is_trained_once_and_compared(
    settings: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = [*settings[:-1], '300']
    asked = ['tune', *few, '--output', str(tmp_path), '--vary', 'target.trace=0.5,0.7']
    assert main(asked) == 0
    printed = capsys.readouterr().out
    runs = {name: tmp_path / f'{name}_s0' for name in ('trace0.5', 'trace0.7')}
    assert {name: read_run(run).overrides for name, run in runs.items()} == {
        'trace0.5': ('target.trace=0.5',),
        'trace0.7': ('target.trace=0.7',),
    }
    assert all(read_run(run).is_done for run in runs.values())
    table = columns(tmp_path / 'tune.csv')
    assert {*table['label']} == {*runs}
    kept = [load_policy(runs[it] / 'policy.safetensors').header for it in table['label']]
    assert [float(it) for it in table['efficiency_kbit_per_j']] == [
        header.validation.efficiency_kbit_per_j for header in kept
    ]
    ranks = [header.validation.rank for header in kept]
    assert ranks == sorted(ranks, reverse=True)
    assert (tmp_path / 'tune.png').stat().st_size > 5_000
    before = [(run / 'run.json').stat().st_mtime_ns for run in runs.values()]
    assert main(asked) == 0  # there is nothing left to train
    assert [(run / 'run.json').stat().st_mtime_ns for run in runs.values()] == before
    assert table['label'][0] in capsys.readouterr().out
    assert 'best validation of' in printed
    for others in (
        ['--override', 'target.double_q=false'],
        ['--set', 'radio.loss_share=0.1'],
        ['--algorithm', 'aiql'],
        ['--decisions', '400'],
    ):
        assert main([*asked, *others]) == 2
        assert said(capsys).endswith(
            'trace0.5_s0: holds a run with other settings: choose another --output'
        )


def test_who_leaves_data_behind_is_not_the_best_and_who_kept_no_policy_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    drawn: list[list[Path]] = []
    monkeypatch.setattr(
        'uav_collect.commands.training_session.draw_curve',
        lambda folders, *_, **__: drawn.append(folders),
    )
    folders = {(label, 0): tmp_path / label for label in ('hasty', 'whole', 'diverged')}
    for folder in folders.values():
        folder.mkdir()
    validation_columns = ','.join(VALIDATION_COLUMNS)
    (tmp_path / 'diverged' / VALIDATION_FILE).write_text(f'{validation_columns}\n')
    _compare(tmp_path, {('diverged', 0): tmp_path / 'diverged'})
    assert 'no run has kept a policy' in capsys.readouterr().err
    hasty = replace(VALIDATION, efficiency_kbit_per_j=9.0, complete_share=0.1)
    for label, validation in (('hasty', hasty), ('whole', VALIDATION)):
        policy = random_policy(header(hidden_size=1, validation=validation))
        save_policy(tmp_path / label / 'policy.safetensors', policy)
    _compare(tmp_path, folders)
    assert columns(tmp_path / 'tune.csv')['label'] == ['whole', 'hasty']
    assert drawn == [[tmp_path / 'hasty', tmp_path / 'whole']]


def test_a_wrong_value_is_refused_before_anything_is_trained(
    settings: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ['tune', *settings, '--output', str(tmp_path / 'x'), '--vary', 'target.trace=0.5,7']
    assert main(asked) == 2
    assert 'target.trace' in said(capsys)
    assert not (tmp_path / 'x' / 'trace0.5_s0').exists()


def test_combinations_are_labelled_by_what_is_varied() -> None:
    tried = varied('target.trace=0.5,0.7'), varied('optimiser.learning_rate=1e-4,1e-3')
    assert [variant.label for variant in variants(tried)] == [
        'trace0.5-learning_rate1e-4',
        'trace0.5-learning_rate1e-3',
        'trace0.7-learning_rate1e-4',
        'trace0.7-learning_rate1e-3',
    ]
    assert variants(tried)[1].overrides == ('target.trace=0.5', 'optimiser.learning_rate=1e-3')


@pytest.mark.parametrize('text', ['target.trace', '=1', 'target.trace=', 'target.trace=1,,2'])
def test_what_varies_nothing_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match=r'must be KEY=VALUE,VALUE,\.\.\.'):
        varied(text)


@pytest.mark.parametrize(
    ('texts', 'words'),
    [
        (['a.b=1', 'a.b=2'], '--vary a.b: is given twice'),
        (['a.b=x y'], "--vary: 'bx y' names a folder"),
        (['a.n=' + ','.join(map(str, range(1001)))], 'makes 1001 combinations: at most 1000'),
    ],
)
def test_combinations_that_are_ambiguous_or_too_many_are_refused(
    texts: list[str], words: str
) -> None:
    with pytest.raises(TrainingRunError, match=words):
        variants([varied(text) for text in texts])

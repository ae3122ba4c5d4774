"""The command tune: every combination in a folder of its own, and which did best."""

import argparse
from pathlib import Path

import pytest
from train_command import columns, said
from uav_collect.__main__ import main
from uav_collect.commands.tune import variants, varied
from uav_collect.errors import TrainingRunError
from uav_collect.training.run_record import read_run

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
    best = [
        max(map(float, columns(runs[it] / 'validation.csv')['efficiency_kbit_per_j']))
        for it in table['label']
    ]
    assert [float(it) for it in table['efficiency_kbit_per_j']] == best
    assert best == sorted(best, reverse=True)
    assert (tmp_path / 'tune.png').stat().st_size > 5_000
    before = [(run / 'run.json').stat().st_mtime_ns for run in runs.values()]
    assert main(asked) == 0  # there is nothing left to train
    assert [(run / 'run.json').stat().st_mtime_ns for run in runs.values()] == before
    assert table['label'][0] in capsys.readouterr().out
    assert 'best validation of' in printed
    assert main([*asked, '--override', 'target.double_q=false']) == 2
    assert said(capsys).endswith(
        'trace0.5_s0: holds a run with other settings: choose another --output'
    )


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

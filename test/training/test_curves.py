"""Learning curves, against means worked out by hand."""

from collections.abc import Callable
import csv
from dataclasses import replace
import io
import json
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np
from pictures import legend_of
import pytest
from run_folders import RECORD, write_run
from uav_collect.__main__ import main
from uav_collect.errors import TrainingRunError
from uav_collect.training import curves as curves
from uav_collect.training.run_record import (
    CURVE_AXES,
    CURVE_MEASURES,
    PANEL_COLUMNS,
    PANEL_FILE,
    PROGRESS_COLUMNS,
    PROGRESS_FILE,
    read_columns,
    read_run,
    RUN_FILE,
    VALIDATION_FILE,
)

EFFICIENCY = CURVE_MEASURES[0]
[EXPLORING] = [one for one in CURVE_MEASURES if one.key == 'training_efficiency_kbit_per_j']
DECISIONS, MINUTES, UPDATES = CURVE_AXES


def of(*folders: Path) -> tuple[curves.LearningCurve, ...]:
    return curves.learning_curves(folders, EFFICIENCY, DECISIONS)


@pytest.fixture
def two_seeds(tmp_path: Path) -> tuple[Path, Path]:
    """They validate at moments of their own; both reach from 100 to 300 decisions."""
    return (
        write_run(tmp_path / 's0', {0: 0.0, 100: 0.4, 300: 0.8}, seed=0),
        write_run(tmp_path / 's1', {100: 0.6, 200: 0.6, 300: 1.0, 400: 9.0}, seed=1),
    )


def test_the_mean_is_taken_where_every_seed_reaches_and_one_was_validated(
    two_seeds: tuple[Path, Path],
) -> None:
    [curve] = of(*two_seeds)
    assert curve.seeds == (0, 1)
    assert curve.over.tolist() == [100, 200, 300]
    # Seed 0 is half way from 0.4 to 0.8 after 200 decisions.
    assert curve.mean == pytest.approx([(0.4 + 0.6) / 2, (0.6 + 0.6) / 2, (0.8 + 1.0) / 2])


def test_the_deviation_is_that_of_a_sample(two_seeds: tuple[Path, Path]) -> None:
    [curve] = of(*two_seeds)
    # Of two values it is their difference over the root of two.
    assert curve.deviation == pytest.approx(np.array([0.2, 0.0, 0.2]) / np.sqrt(2), abs=1e-12)


def test_one_seed_has_no_deviation(two_seeds: tuple[Path, Path]) -> None:
    [curve] = of(two_seeds[0])
    assert np.isnan(curve.deviation).all()
    assert curve.mean.tolist() == [0.0, 0.4, 0.8]


def test_a_curve_runs_over_minutes_or_updates_too(two_seeds: tuple[Path, Path]) -> None:
    [minutes] = curves.learning_curves(two_seeds, EFFICIENCY, MINUTES)
    [updates] = curves.learning_curves(two_seeds, EFFICIENCY, UPDATES)
    assert minutes.over.tolist() == pytest.approx([1.0, 2.0, 3.0])  # 10 decisions take 6 s
    assert updates.over.tolist() == [10, 20, 30]


def test_the_efficiency_while_exploring_comes_from_the_progress(tmp_path: Path) -> None:
    run = write_run(tmp_path / 'run', {0: 1.0}, exploring={0: 0.1, 50: 0.3})
    [curve] = curves.learning_curves([run], EXPLORING, DECISIONS)
    assert curve.mean.tolist() == [0.1, 0.3]


def test_what_was_not_known_yet_is_left_out(tmp_path: Path) -> None:
    run = write_run(tmp_path / 'run', {0: 1.0}, exploring={0: float('nan'), 50: 0.3})
    [curve] = curves.learning_curves([run], EXPLORING, DECISIONS)
    assert curve.over.tolist() == [50]


def test_a_table_of_before_lacks_what_was_not_measured_then(tmp_path: Path) -> None:
    run = write_run(tmp_path / 'run', {}, exploring={100: 0.3})
    path = run / PROGRESS_FILE
    assert read_columns(path, ('n_decisions', 'mean_value'))['mean_value'].tolist() == [1.0]
    cut = [','.join(line.split(',')[:-2]) for line in path.read_text().splitlines()]
    path.write_text('\n'.join(cut) + '\n')
    found = read_columns(path, ('training_efficiency_kbit_per_j', 'mean_value', 'gradient_norm'))
    assert found['training_efficiency_kbit_per_j'].tolist() == [0.3]
    assert np.isnan([found['mean_value'], found['gradient_norm']]).all()


def test_of_two_validations_at_one_moment_the_later_counts(tmp_path: Path) -> None:
    run = write_run(tmp_path / 'run', {0: 0.0, 100: 0.5})
    with (run / VALIDATION_FILE).open('a') as file:
        file.write('100,10,60,0.7,1,1,1,1,1,1\n')
    assert of(run)[0].mean.tolist() == [0.0, 0.7]


def test_a_line_that_a_killed_run_left_half_is_ignored(tmp_path: Path) -> None:
    run = write_run(tmp_path / 'run', {0: 0.2})
    with (run / VALIDATION_FILE).open('a') as file:
        file.write('100,10,60,0.')
    assert of(run)[0].mean.tolist() == [0.2]


# Which runs make one curve, and what it is called.


@pytest.mark.parametrize(
    ('change', 'labels'),
    [
        ({'algorithm': 'qmix'}, ['AQMIX', 'QMIX']),
        ({'scenario': 'sea', 'scenario_fingerprint': '1'},
         ['AQMIX, field, 2 UAVs', 'AQMIX, sea, 2 UAVs']),
        ({'scenario_fingerprint': '1'},
         ['AQMIX, field, 2 UAVs (0123456789abcdef)', 'AQMIX, field, 2 UAVs (1)']),
        ({'preset': 'paper', 'training_fingerprint': '2'}, ['AQMIX, strong', 'AQMIX, paper']),
        ({'overrides': ('gru=32',), 'training_fingerprint': '2'},
         ['AQMIX, strong', 'AQMIX, strong gru=32']),
        ({'training_fingerprint': '2'},
         ['AQMIX, strong (fedcba9876543210)', 'AQMIX, strong (2)']),
        ({'initial': 'old@3'}, ['AQMIX, from scratch', 'AQMIX, from old@3']),
        ({'decisions': None, 'minutes': 4.0}, ['AQMIX, 300 decisions', 'AQMIX, 4 min']),
    ],
)  # fmt: skip
def test_runs_that_differ_in_more_than_their_seed_make_curves_of_their_own(
    tmp_path: Path, change: dict[str, object], labels: list[str]
) -> None:
    one = write_run(tmp_path / 'one', {0: 0.1, 10: 0.2})
    other = write_run(tmp_path / 'other', {0: 0.1, 10: 0.2}, **change)
    assert [curve.label for curve in of(one, other)] == labels


def test_curves_keep_the_order_in_which_runs_are_given(tmp_path: Path) -> None:
    a0 = write_run(tmp_path / 'a0', {0: 0.1})
    q0 = write_run(tmp_path / 'q0', {0: 0.2}, algorithm='qmix')
    a1 = write_run(tmp_path / 'a1', {0: 0.3}, seed=1)
    assert [curve.seeds for curve in of(q0, a0, a1)] == [(0,), (0, 1)]


def test_a_record_reads_back_as_it_was_written(tmp_path: Path) -> None:
    assert read_run(write_run(tmp_path / 'run', {0: 0.1})) == RECORD


# Pictures and tables.


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Axes]:
    """Draws curves and gives what was drawn instead of a file."""

    def draw(lines: tuple[curves.LearningCurve, ...], references: dict[str, float]) -> Axes:
        figures: list[Figure] = []
        monkeypatch.setattr(Figure, 'savefig', lambda self, *_, **__: figures.append(self))
        curves.draw_curves(lines, EFFICIENCY, DECISIONS, io.BytesIO(), references, 'a title')
        return figures[0].axes[0]

    return draw


def test_labels_cover_no_curve_however_many_and_long(
    two_seeds: tuple[Path, Path], drawn: Callable[..., Axes]
) -> None:
    [curve] = of(*two_seeds)
    labels = [f'AQMIX, paper {"mixer.pooling=mean " * index}' for index in range(9)]
    axes = drawn(tuple(replace(curve, label=label) for label in labels), {'hert': 0.791})
    figure, legend = axes.figure, axes.get_legend()
    assert isinstance(figure, Figure)
    assert legend is not None
    figure.draw_without_rendering()
    box, page, plot = legend.get_window_extent(), figure.bbox, axes.get_window_extent()
    assert box.y1 < plot.y0
    assert box.x0 >= page.x0 - 1
    assert box.x1 <= page.x1 + 1
    assert box.y0 >= page.y0 - 1
    assert plot.height > 3.0 * figure.dpi


def test_a_picture_shows_means_seeds_references_and_units(
    two_seeds: tuple[Path, Path], drawn: Callable[..., Axes]
) -> None:
    axes = drawn(of(*two_seeds), {'sweep': 1.19})
    assert legend_of(axes) == ['AQMIX (2 seeds)', 'sweep: 1.19']
    assert axes.get_ylabel() == 'energy efficiency [kbit/J]'
    assert axes.get_xlabel() == 'decisions'
    line, reference = axes.lines
    assert np.asarray(line.get_ydata()) == pytest.approx([0.5, 0.6, 0.9])
    assert list(reference.get_ydata()) == [1.19, 1.19]


def test_the_shade_is_a_deviation_to_either_side(
    two_seeds: tuple[Path, Path], drawn: Callable[..., Axes]
) -> None:
    [shade] = drawn(of(*two_seeds), {}).collections
    heights = shade.get_paths()[0].vertices[:, 1]
    assert heights.max() == pytest.approx(0.9 + 0.2 / np.sqrt(2))
    assert heights.min() == pytest.approx(0.5 - 0.2 / np.sqrt(2))


def test_one_seed_is_drawn_without_shade(
    two_seeds: tuple[Path, Path], drawn: Callable[..., Axes]
) -> None:
    axes = drawn(of(two_seeds[0]), {})
    assert not axes.collections
    assert legend_of(axes) == ['AQMIX (1 seed)']


def test_the_same_curves_give_the_same_bytes(two_seeds: tuple[Path, Path]) -> None:
    contents = []
    for _ in range(2):
        file = io.BytesIO()
        curves.draw_curves(of(*two_seeds), EFFICIENCY, DECISIONS, file)
        contents.append(file.getvalue())
    assert contents[0] == contents[1]
    assert contents[0].startswith(b'\x89PNG')


# The command.


def test_the_command_writes_picture_and_table(
    two_seeds: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture, table = tmp_path / 'curve.png', tmp_path / 'curve.csv'
    runs = [str(run) for run in two_seeds]
    references = ['--reference', 'hert=0.79', 'sweep=1.19']
    files = ['--output', str(picture), '--csv', str(table)]
    assert main(['curves', *references, *runs, *files]) == 0
    assert picture.read_bytes().startswith(b'\x89PNG')
    with table.open(newline='') as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == [
        'curve', 'n_seeds', 'decisions', 'mean_efficiency_kbit_per_j',
        'deviation_efficiency_kbit_per_j',
    ]  # fmt: skip
    assert [row['decisions'] for row in rows] == ['100', '200', '300']
    assert [float(row['mean_efficiency_kbit_per_j']) for row in rows] == pytest.approx(
        [0.5, 0.6, 0.9]
    )
    shown = capsys.readouterr().out
    assert all(words in shown for words in ('AQMIX', '0.9000', '0.1414', str(picture)))


def test_the_deviation_of_one_seed_is_an_empty_cell(two_seeds: tuple[Path, Path]) -> None:
    [_, first, *_] = curves.to_csv(of(two_seeds[0]), EFFICIENCY, DECISIONS).decode().splitlines()
    assert first == 'AQMIX,1,0,0.0,'


def test_a_picture_and_a_table_are_not_written_over_each_other(
    two_seeds: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both = ['--output', str(tmp_path / 'it'), '--csv', str(tmp_path / 'it')]
    assert main(['curves', *map(str, two_seeds), *both]) == 2
    assert 'is given for two files' in capsys.readouterr().err
    assert not (tmp_path / 'it').exists()


def without(folder: Path, name: str) -> Path:
    (folder / name).unlink()
    return folder


def test_all_runs_of_the_folder_for_runs_are_drawn_where_none_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(['curves']) == 2
    assert capsys.readouterr().err.startswith(
        'error: runs/train: has no runs of train: name run folders, as those in runs/train_fleet'
    )
    for seed in range(2):
        write_run(tmp_path / 'runs' / 'train' / f's{seed}', {0: 0.1}, seed=seed)
    assert main(['curves', '--csv', 'curves.csv']) == 0
    assert (tmp_path / 'curves.csv').read_text().splitlines()[1].split(',')[1] == '2'


def test_what_is_no_run_is_said_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = write_run(tmp_path / 'run', {0: 0.1})
    again = write_run(tmp_path / 'again', {0: 0.1})
    young = write_run(tmp_path / 'young', {}, exploring={100: 0.1}, seed=5)
    late = write_run(tmp_path / 'late', {100: 0.1}, seed=6)
    bare = without(write_run(tmp_path / 'bare', {0: 0.1}, seed=7), VALIDATION_FILE)
    old = write_run(tmp_path / 'old', {0: 0.1}, seed=8)
    (old / RUN_FILE).write_text('{"format": "other/1"}')
    (tmp_path / 'empty').mkdir()
    loop, strange = tmp_path / 'loop', tmp_path / 'strange'
    loop.symlink_to(loop)
    (strange / RUN_FILE).mkdir(parents=True)
    for runs, words in (
        ([tmp_path / 'empty'], 'holds no run.json'),
        ([tmp_path / 'nowhere'], 'is no folder'),
        ([run, run], 'names a run twice'),
        ([run, again], 'two runs have the seed 0'),
        ([young], 'has no energy efficiency yet; progress.csv has what --measure training_'),
        ([run, late], 'no decisions in common'),
        ([bare], 'validation.csv: cannot be read: No such file'),
        ([old], "format is 'other/1'"),
        ([loop], 'loop: cannot be read: Too many levels of symbolic links'),
        ([strange], 'run.json: cannot be read: is a folder: must be a file'),
    ):
        picture = str(tmp_path / 'x.png')
        assert main(['curves', *map(str, runs), '--output', picture]) == 2
        shown = capsys.readouterr().err
        assert shown.startswith('error: ')
        assert shown.count('\n') == 1
        assert words in shown


@pytest.mark.parametrize('text', ['sweep', 'sweep=much', '=1', 'sweep=nan'])
def test_a_reference_is_a_name_and_a_number(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as raised:
        main(['curves', 'run', '--reference', text])
    assert raised.value.code == 2
    assert 'must be NAME=NUMBER' in capsys.readouterr().err


def test_a_table_of_something_else_is_refused(tmp_path: Path) -> None:
    path = tmp_path / PROGRESS_FILE
    header = ','.join(PROGRESS_COLUMNS)
    row = ','.join('1' for _ in PROGRESS_COLUMNS)
    path.write_text(f'{header}\n{row}\n')
    assert read_columns(path, ('loss',))['loss'].tolist() == [1.0]
    for content, words in (
        (b'a,b\n1,2\n', ':1: is no table with n_decisions'),
        (b'\xff\n', ': is no text'),
        *(
            (f'{header}\n{row}\n{wrong}\n'.encode(), ':3: is no row of 15 numbers')
            for wrong in ('', '1,2', f'{row},1', row.replace('1', 'x', 1), f'-{row}', f'{row}x')
        ),
    ):
        path.write_bytes(content)
        with pytest.raises(TrainingRunError) as raised:
            read_columns(path, ('loss',))
        assert str(raised.value).startswith(f'{path}{words}')


@pytest.mark.parametrize('number', ['nan', 'inf', '1e400'])
def test_a_moment_that_is_no_finite_number_is_named_with_its_line(
    number: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = write_run(tmp_path / 'run', {0: 0.1, 100: 0.2})
    path = run / VALIDATION_FILE
    path.write_text(path.read_text().replace('60.0', number))
    picture, table = tmp_path / 'x.png', tmp_path / 'x.csv'
    outputs = ['--output', str(picture), '--csv', str(table)]
    assert main(['curves', str(run), '--over', 'minutes', *outputs]) == 2
    words = f'error: {path}:3: wall_s is {number}: must be a finite number'
    assert capsys.readouterr().err.startswith(words)
    assert not picture.exists() and not table.exists()


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'seed': -1}, 'seed is -1'),
        ({'seed': True}, 'seed is True'),
        ({'seed': 1}, 'seeds are (0,): lack 1'),
        ({'seeds': 3}, 'seeds is 3'),
        ({'seeds': ['0']}, "seeds is '0'"),
        ({'algorithm': 'dqn'}, "algorithm is 'dqn'"),
        ({'device': 'tpu'}, "device is 'tpu'"),
        ({'minutes': 1.0}, 'must have either minutes or decisions'),
        ({'decisions': None}, 'must have either minutes or decisions'),
        ({'decisions': 1.5}, 'decisions is 1.5'),
        ({'minutes': float('nan'), 'decisions': None}, 'minutes is nan'),
        ({'n_uavs': []}, 'n_uavs has 0 entries: needs 1'),
        ({'scenario_fingerprint': 'a b'}, 'n_uavs has 1 entries: needs 2'),
        ({'versions': {'numpy': 1}}, "versions is {'numpy': 1}"),
        ({'training': 'x' * 100, 'is_done': 'x' * 100}, "is_done is 'xxx"),
    ],
)
def test_a_field_of_a_record_that_no_run_writes_is_named(
    change: dict[str, object], words: str, tmp_path: Path
) -> None:
    path = write_run(tmp_path / 'run', {}) / RUN_FILE
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(TrainingRunError) as raised:
        read_run(path.parent)
    assert str(raised.value).startswith(f'{path}: {words}')
    assert len(str(raised.value)) < len(str(path)) + 100


def test_a_record_that_is_no_json_lacks_a_field_or_is_no_file_is_refused(tmp_path: Path) -> None:
    path = write_run(tmp_path / 'run', {}) / RUN_FILE
    values = json.loads(path.read_text())
    del values['device']
    for content, words in (
        (b'', 'is not JSON'),
        (b'{', 'is not JSON'),
        (b'\xff', 'is not JSON'),
        (b'[' * 100_000, 'is not JSON'),
        (b'[]', 'format is []'),
        (b'{"format": "uav_collect.training/2"}', "format is 'uav_collect.training/2'"),
        (json.dumps(values).encode(), 'device is missing'),
        (b' ' * 2**21, 'cannot be read: has 2,097,152 bytes'),
    ):
        path.write_bytes(content)
        with pytest.raises(TrainingRunError) as raised:
            read_run(path.parent)
        assert str(raised.value).startswith(f'{path}: {words}')


def test_the_curve_of_a_panel_is_the_mean_of_its_conditions(tmp_path: Path) -> None:
    run = write_run(tmp_path / 's0', {100: 1.0}, scenario='anywhere', courses='0123 4567',
                    n_uavs=(), scenario_fingerprint='')  # fmt: skip
    ratios = {(100, 1): 0.8, (100, 2): 1.2, (300, 1): 1.0, (300, 2): 1.1}
    rows = [[str(n_decisions), '10', '6.0', str(place), str(ratio), *['1.0'] * 5]
            for (n_decisions, place), ratio in ratios.items()]  # fmt: skip
    lines = [','.join(row) for row in (PANEL_COLUMNS, *rows)]
    (run / PANEL_FILE).write_text('\n'.join(lines) + '\n')
    [ratio] = [one for one in CURVE_MEASURES if one.key == 'sweep_ratio']
    [curve] = curves.learning_curves([run], ratio, DECISIONS)
    assert curve.over.tolist() == [100, 300]
    assert curve.mean == pytest.approx([1.0, 1.05])

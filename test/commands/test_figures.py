"""The command figures at the smallest scale, whole: from the first job to the claims."""

from argparse import Namespace
from collections.abc import Collection, Iterator, Sequence
import csv
from dataclasses import dataclass
import io
import json
from pathlib import Path
import re
import subprocess
import sys
from types import ModuleType

from episodes import single_threaded_torch
from matplotlib.axes import Axes
from matplotlib.image import imread
from processes import complaints, completed, DEADLINE_S
import pytest
from terminal import Ear
from uav_collect.__main__ import main
from uav_collect.commands.figures import _engine
from uav_collect.limits import INTERRUPTED
from uav_collect.studies import catalogue
from uav_collect.studies.claims.claims import CLAIMS
from uav_collect.studies.claims.judging import ClaimStatus
from uav_collect.studies.findings import Findings
from uav_collect.studies.jobs import learning
from uav_collect.studies.jobs.store import Store
from uav_collect.studies.jobs.worker_messages import Finished, JobReport, WorkItem
from uav_collect.studies.pictures.draw import draw
from uav_collect.studies.pictures.drawing import Drawing
from uav_collect.studies.requests import Requests
from uav_collect.studies.scale import load_scale
from uav_collect.studies.study import CurvesStudy, LinesStudy, Study

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[2]
NAMES = catalogue.study_names()
UNIT = re.compile(r'.* \[[^\]]+\]$')
PURE = re.compile('^(number|decisions|reward|share|variance|probability|policy|than)|, share of')
LEARNED = {'AQMIX', 'QMIX', 'AIQL'}
PLANS = {'shortest plan', 'thriftiest plan'}


@dataclass(frozen=True)
class Smoke:
    """What one call of the command left."""

    output: Path
    done: subprocess.CompletedProcess[str]

    @property
    def folder(self) -> Path:
        """The figures."""
        return self.output / 'smoke'

    def study(self, name: str) -> Study:
        return catalogue.make_study(name, Requests(load_scale('smoke')))

    def rows(self, name: str) -> list[dict[str, str]]:
        text = (self.folder / f'{name}.csv').read_text()
        return [*csv.DictReader(io.StringIO(text))]


@pytest.fixture(scope='module')
def smoke(tmp_path_factory: pytest.TempPathFactory) -> Smoke:
    """All studies at the smallest scale, done by two processes."""
    single_threaded_torch()
    output = tmp_path_factory.mktemp('studies')
    options = ('--scale', 'smoke', '--output', str(output), '--workers', '2')
    return Smoke(output, figures(*options))


@pytest.fixture(scope='module', params=NAMES)
def drawn(smoke: Smoke, request: pytest.FixtureRequest) -> tuple[str, Drawing]:
    """Each study's name and figure: all that is asked of one is asked before the next is drawn."""
    return request.param, draw(smoke.study(request.param), Findings(Store(smoke.output)))


@pytest.fixture
def copy(smoke: Smoke, tmp_path: Path) -> Smoke:
    """What was found, without any figure."""
    (tmp_path / 'jobs').symlink_to(smoke.output / 'jobs')
    return Smoke(tmp_path, smoke.done)


def figures(*arguments: str, status: int = 0) -> subprocess.CompletedProcess[str]:
    command = (sys.executable, '-m', 'uav_collect', 'figures', *arguments)
    return completed(*command, status=status, cwd=ROOT)


def labels_of(axes: Axes) -> set[str]:
    """The names in a panel's legend."""
    legend = axes.get_legend()
    assert legend is not None, axes.get_ylabel()
    return {text.get_text() for text in legend.get_texts()}


def panels(drawn: Drawing) -> Iterator[Axes]:
    """The axes that are no colour bar."""
    return (axes for axes in drawn.figure.axes if axes.get_label() != '<colorbar>')


def test_everything_is_done_and_said(smoke: Smoke) -> None:
    assert all(f'{name}.png' in smoke.done.stdout for name in NAMES)
    assert re.search(r'^\d+ of \d+ jobs done, \d running, \d+%', smoke.done.stderr, re.MULTILINE)
    assert '\x1b' not in smoke.done.stderr


@pytest.mark.parametrize('name', NAMES)
def test_a_figure_is_a_picture_of_something_twice_and_a_table(smoke: Smoke, name: str) -> None:
    picture = imread(smoke.folder / f'{name}.png')
    assert min(picture.shape[:2]) > 300
    assert (picture[..., :3] < 0.5).mean() > 1e-3  # ink
    printed = (smoke.folder / f'{name}.pdf').read_bytes()
    assert printed.startswith(b'%PDF')
    assert len(printed) > 5000
    assert len(smoke.rows(name)) > 5


@pytest.mark.parametrize('name', NAMES)
def test_a_table_says_how_many_and_in_which_unit(smoke: Smoke, name: str) -> None:
    rows = smoke.rows(name)
    columns = set(rows[0])
    if isinstance(smoke.study(name), LinesStudy | CurvesStudy):
        assert {'n_missions', 'mean', 'low', 'high', 'unit', 'line'} <= columns
        assert all(row['unit'] for row in rows)
        known = [row for row in rows if row['low']]
        assert known
        spans = [[float(row[key]) for key in ('low', 'mean', 'high')] for row in known]
        assert all(low <= mean <= high for low, mean, high in spans)
        assert all(int(row['n_missions']) >= 1 for row in known)
    else:
        shown = {'n_trainings', 'mean', 'low', 'high'} if name == 'runs' else {'x_m', 'y_m'}
        assert shown <= columns


def test_every_axis_has_a_unit_if_it_is_no_count_or_share_and_every_panel_a_legend(
    drawn: tuple[str, Drawing],
) -> None:
    _, drawing = drawn
    for axes in panels(drawing):
        for label in (axes.get_xlabel(), axes.get_ylabel()):
            assert UNIT.match(label) or PURE.search(label), label
        assert labels_of(axes)


def test_every_legend_is_in_the_picture_whole(drawn: tuple[str, Drawing]) -> None:
    name, drawing = drawn
    drawing.picture('png')
    page = drawing.figure.bbox
    for axes in panels(drawing):
        legend = axes.get_legend()
        assert legend is not None
        box = legend.get_window_extent()
        assert box.x0 >= page.x0 - 1, name
        assert box.x1 <= page.x1 + 1, name
        assert box.y0 >= page.y0 - 1, name
        assert box.y1 <= page.y1 + 1, name


def series_of(study: Study) -> set[str]:
    """What must be seen in each panel: the plans where they have what it shows."""
    match study:
        case LinesStudy(lines=lines):
            return {line.label for line in lines if line.policy != 'plan'}
        case CurvesStudy(panels=curves):
            return {curve.label for panel in curves for curve in panel.curves}
        case _:
            return set()


def test_every_panel_has_all_its_series(smoke: Smoke, drawn: tuple[str, Drawing]) -> None:
    name, drawing = drawn
    study = smoke.study(name)
    shown = [labels_of(axes) for axes in panels(drawing)]
    assert all(series_of(study) <= labels for labels in shown)
    match study:
        case LinesStudy():
            assert {'HERT', 'sweep'} <= set.intersection(*shown)
            assert PLANS & set.union(*shown)
        case CurvesStudy():
            assert any({'HERT', 'sweep', 'thriftiest plan'} <= it for it in shown)
        case _:
            assert all(shown)


@pytest.mark.parametrize('name', ['learning-areas', 'learning-uavs', 'energy', 'density', 'range'])
def test_the_three_algorithms_are_compared(smoke: Smoke, name: str) -> None:
    assert set(series_of(smoke.study(name))) >= LEARNED


def test_the_rows_of_a_line_are_the_values_that_were_tested(smoke: Smoke) -> None:
    scale = load_scale('smoke')
    rows = [row for row in smoke.rows('density') if row['line'] == 'AQMIX']
    for policies, n_trainings in (('all', scale.seeds.usual), ('best', 1)):
        some = [row for row in rows if row['policies'] == policies]
        assert [float(row['density_share']) for row in some] == [*scale.densities] * 2
        assert {int(row['n_missions']) for row in some} == {scale.tests.missions}
        assert {int(row['n_trainings']) for row in some} == {n_trainings}


def test_trainings_are_written_down_as_marl_eval_reads_them(smoke: Smoke) -> None:
    environments = json.loads((smoke.folder / 'marl_eval.json').read_text())
    assert [*environments] == ['uav_collect_areas', 'uav_collect_fleets']
    runs = environments['uav_collect_areas']['paper_8x8_n2']['AQMIX']
    assert [*runs] == ['seed_0']
    steps = [it for name, it in runs['seed_0'].items() if name.startswith('step_')]
    assert all(len(it['efficiency_kbit_per_j']) == 1 and it['step_count'] > 0 for it in steps)
    assert len(runs['seed_0']['absolute_metrics']['completion_s']) == 12


@pytest.mark.parametrize('name', ['loss', 'delay'])
def test_messages_that_are_lost_or_late_keep_nobody_from_coming_home(
    smoke: Smoke, name: str
) -> None:
    rows = [row for row in smoke.rows(name) if row['measure'] == 'complete_safe_share']
    lines = {row['line'] for row in rows}
    assert lines == {
        f'{it}{fleet}' for it in ('strong', 'HERT', 'sweep') for fleet in ('', ', 4 UAVs')
    }
    assert {row['unit'] for row in rows} == {'%'}
    rules = [row for row in rows if not row['line'].startswith('strong')]
    assert {float(row['mean']) for row in rules} == {100.0}


def test_figures_come_back_as_they_were_without_any_work(smoke: Smoke, copy: Smoke) -> None:
    names = ('topology', 'learning-uavs', 'density', 'trajectories')
    files = [f'{name}.{kind}' for name in names for kind in ('png', 'pdf', 'csv')]
    jobs = {path: path.stat().st_mtime_ns for path in (smoke.output / 'jobs').rglob('*')}
    again = ['figures', '--scale', 'smoke', '--output', str(copy.output), '--only', *names]
    assert main(again) == 0
    drawn = {name: (copy.folder / name).read_bytes() for name in files}
    assert drawn == {name: (smoke.folder / name).read_bytes() for name in files}
    assert {path: path.stat().st_mtime_ns for path in (smoke.output / 'jobs').rglob('*')} == jobs


class Replaying:
    """An engine that gives what was found before, until a job comes that it is not to do."""

    n_slots = 1

    def __init__(self, found: Store, known: Collection[str]) -> None:
        self._found, self._known = found, known
        self._reports: list[tuple[str, JobReport]] = []
        self._is_over = False

    def start(self, task: WorkItem) -> None:
        if task.digest not in self._known:
            self._is_over = True
            return
        folder = self._found.folder / 'jobs' / task.digest
        results = {path.name: path.read_bytes() for path in folder.iterdir()}
        del results['job.json'], results['cost.json']
        finished = Finished(results=results, cost=self._found.cost(task.digest))
        self._reports.append((task.digest, finished))

    def wait(self, timeout_s: float) -> Sequence[tuple[str, JobReport]]:
        del timeout_s
        if self._is_over:
            raise KeyboardInterrupt  # as a second Ctrl-C does, at once
        reports, self._reports = self._reports, []
        return reports

    def stop(self) -> None:
        raise AssertionError

    def close(self) -> None:
        pass


def test_a_study_is_written_as_soon_as_it_is_done_and_cheap_ones_come_first(
    smoke: Smoke, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    requests = Requests(load_scale('smoke'))
    catalogue.make_study('trajectories', requests)
    engine = Replaying(Store(smoke.output), requests.take_new())
    monkeypatch.setattr('uav_collect.commands.figures._engine', lambda _: engine)
    asked = ('--only', 'csi', 'trajectories', '--output', str(tmp_path))
    assert main(['figures', '--scale', 'smoke', *asked]) == INTERRUPTED
    written = {path.name for path in (tmp_path / 'smoke').iterdir()}
    files = {f'trajectories.{kind}' for kind in ('csv', 'png', 'pdf')}
    assert written == {*files, 'results.md'}
    text = (tmp_path / 'smoke/results.md').read_text()
    assert re.search(r'^- Not run: learning-areas, .*\bcsi\b.*\.$', text, re.MULTILINE)
    assert f', {len(CLAIMS) - 1} were not run.' in text


def test_every_claim_is_judged_by_numbers_with_their_count(smoke: Smoke) -> None:
    text = (smoke.folder / 'results.md').read_text()
    rows = re.findall(r'^\| (\d+) \| (\d+) \| (.*?) \| (.*) \| (.*?) \|$', text, re.MULTILINE)
    assert [statement for _, _, statement, _, _ in rows] == [it.statement for it in CLAIMS]
    verdicts = {str(it) for it in ClaimStatus if it is not ClaimStatus.NOT_RUN}
    assert {verdict.partition(';')[0] for *_, verdict in rows} <= verdicts
    details = re.findall(r'^\| .* \| (\d+) (?:missions?|trainings?).* \|$', text, re.MULTILINE)
    assert len(details) > 100


def test_what_was_found_before_is_judged_with_what_is_asked_for(
    smoke: Smoke, copy: Smoke, capsys: pytest.CaptureFixture[str]
) -> None:
    results = copy.output / 'some.md'
    asked = ('--only', 'csi', '--output', str(copy.output), '--results', str(results))
    assert main(['figures', '--scale', 'smoke', *asked]) == 0
    assert results.read_text() == (smoke.folder / 'results.md').read_text()
    assert {path.stem for path in copy.folder.iterdir()} == {'csi'}
    assert str(results) in capsys.readouterr().out


def test_what_it_takes_is_said_beforehand(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ['--scale', 'smoke', '--dry-run', '--output', str(tmp_path / 'o')]
    assert main(['figures', *options]) == 0
    shown = capsys.readouterr().out
    assert re.search(r'scale smoke: (\d+) jobs.* \1 missing: 31 of training', shown)
    assert re.search(r'disk: \d+ MB of results, up to \d+ MB of checkpoints', shown)
    assert not (tmp_path / 'o').exists()


def test_it_is_said_that_ray_takes_long_to_load(monkeypatch: pytest.MonkeyPatch) -> None:
    ear = Ear('waiting for Ray to load')

    class SlowModule(ModuleType):
        def __getattr__(self, name: str) -> object:
            assert ear.heard.wait(DEADLINE_S)
            return lambda *_: name

    name = 'uav_collect.studies.jobs.cluster'
    monkeypatch.setitem(sys.modules, name, SlowModule(name))
    monkeypatch.setattr(sys, 'stderr', ear)
    arguments = Namespace(engine='ray', address=None, workers=None)
    assert _engine(arguments) == 'RayEngine'  # type: ignore[comparison-overlap]


def test_a_dry_run_measures_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(learning, 'measure_rates', None)
    options = ['--scale', 'paper', '--dry-run', '--output', str(tmp_path / 'o')]
    assert main(['figures', *options]) == 0
    shown = capsys.readouterr()
    assert 'missing: ' in shown.out
    assert 'measuring' not in shown.err


def test_the_list_names_every_study_and_does_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['figures', '--list', '--scale', 'laptop', '--output', str(tmp_path / 'o')]) == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in NAMES)
    assert not (tmp_path / 'o').exists()


def test_results_that_could_not_be_written_are_refused_before_any_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, results = tmp_path / 'o', tmp_path / 'nowhere' / 'results.md'
    options = ['--scale', 'smoke', '--output', str(folder), '--results', str(results)]
    assert main(['figures', *options]) == 2
    assert capsys.readouterr().err == f'error: {results}: No such file or directory\n'
    assert not folder.exists()


def test_an_unknown_study_is_refused_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['figures', '--only', 'densities', '--list']) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: --only is 'densities': must be of topology, ")
    assert error.count('\n') == 1


def test_a_value_of_a_scale_that_cannot_be_is_named(tmp_path: Path) -> None:
    scale = tmp_path / 'mine.yaml'
    scale.write_text('extends: smoke\ndensities: [0.3, 0.1]\n')
    done = figures('--scale', str(scale), '--list', status=2)
    assert complaints(done.stderr) == [f'error: {scale}: densities is [0.3, 0.1]: must rise']

"""Commands end with their own status, and a line at most, wherever and to whomever they speak."""

from collections.abc import Iterator, Mapping
import os
from pathlib import Path
import shlex
import subprocess
import sys

from processes import complaints, completed
import pytest
from tiny_world import tiny

ROOT = Path(__file__).parents[2]
HOSTILE_BACKENDS = ('module://matplotlib_inline.backend_inline', 'nonsense')
ASCII = {'LC_ALL': 'C', 'PYTHONUTF8': '0', 'PYTHONCOERCECLOCALE': '0'}

# Shell redirections and changes of the environment, None for what is not set at all.
SURROUNDINGS: Mapping[str, tuple[str, Mapping[str, str | None]]] = {
    'a closed stdout': ('>&-', {}),
    'a closed stderr': ('2>&-', {}),
    'nothing open': ('<&- >&- 2>&-', {}),
    'a full disk under stderr': ('2>/dev/full', {}),
    'a narrow terminal': ('', {'COLUMNS': '20', 'LINES': '1'}),
    'no width at all': ('', {'COLUMNS': 'nonsense'}),
    'the C locale': ('', ASCII),
    'ASCII alone': ('', {'PYTHONIOENCODING': 'ascii:strict', 'LC_ALL': 'C'}),
    'no home': ('', {'HOME': None, 'XDG_CACHE_HOME': None}),
    'a home that cannot be': ('', {'HOME': '/proc/none', 'XDG_CACHE_HOME': None}),
    'a dumb terminal': ('', {'TERM': 'dumb', 'NO_COLOR': '1'}),
    'the backend of a notebook': ('', {'MPLBACKEND': HOSTILE_BACKENDS[0]}),
}


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder whose name is not ASCII, with a scenario in it."""
    folder = tmp_path_factory.mktemp('Größe')
    (folder / 'field.yaml').write_text(tiny(name='field').to_yaml())
    return folder


def run(
    arguments: list[object],
    redirection: str = '',
    environment: Mapping[str, str | None] | None = None,
    stdout: int = subprocess.PIPE,
) -> subprocess.CompletedProcess[str]:
    """What a shell makes of a command."""
    changed = {
        **os.environ, 'PYTHONUNBUFFERED': None, 'UAV_COLLECT_KERNELS': 'interpreted',
        **(environment or {}),
    }  # fmt: skip
    words = [sys.executable, '-m', 'uav_collect', *map(str, arguments)]
    return completed(
        *('bash', '-c', f'{shlex.join(words)} {redirection}'),
        status=None,
        cwd=ROOT,
        env={name: value for name, value in changed.items() if value is not None},
        stdout=stdout,
        encoding='utf-8',
    )


@pytest.fixture
def unread() -> Iterator[int]:
    """A pipe whose reader has left."""
    reading, writing = os.pipe()
    os.close(reading)
    yield writing
    os.close(writing)


@pytest.mark.parametrize('surroundings', SURROUNDINGS)
def test_missions_are_evaluated_whoever_listens(surroundings: str, folder: Path) -> None:
    table, options = folder / 'Tabelle ö.json', ['--missions', '1', '--policy', 'sweep', 'hert']
    table.unlink(missing_ok=True)
    scenario = folder / 'field.yaml'
    done = run(
        ['evaluate', '--scenario', scenario, *options, '--json', table],
        *SURROUNDINGS[surroundings],
    )
    assert (done.returncode, complaints(done.stderr)) == (0, [])
    is_heard = '>&-' not in SURROUNDINGS[surroundings][0].split()
    assert ('missions flown' in done.stdout) is is_heard
    assert table.stat().st_size > 0


def test_a_narrow_terminal_costs_no_figure(folder: Path) -> None:
    golden = ROOT / 'test' / 'golden' / 'run_folder'
    shown = {
        run(['report', golden, '--pictures', folder], '', {'COLUMNS': columns}).stdout
        for columns in ('20', '80')
    }
    assert len(shown) == 1
    assert '197.5 s' in shown.pop()


@pytest.mark.parametrize(
    'surroundings',
    [
        name
        for name, (redirection, environment) in SURROUNDINGS.items()
        if redirection or 'LC_ALL' in environment  # no line depends on anything else
    ],
)
def test_misuse_is_said_in_one_line_or_not_at_all(surroundings: str) -> None:
    redirection, environment = SURROUNDINGS[surroundings]
    done = run(['evaluate', '--policy', 'größer'], redirection, environment)
    assert (done.returncode, done.stdout) == (2, '')
    beginnings = [line[:17] for line in complaints(done.stderr)]
    assert beginnings == ([] if '2>' in redirection else ["error: policy 'gr"])


@pytest.mark.parametrize(
    'arguments', [['--help'], ['report', '--help'], ['verify', 'test/golden/run_folder']], ids=str
)
def test_a_reader_that_has_left_costs_no_word(arguments: list[object], unread: int) -> None:
    done = run(arguments, stdout=unread)
    assert (done.returncode, complaints(done.stderr)) == (1, [])


def test_a_reader_that_has_left_costs_no_file(folder: Path, unread: int) -> None:
    table, options = folder / 'left.csv', ['--missions', '1', '--csv']
    done = run(['evaluate', '--scenario', folder / 'field.yaml', *options, table], stdout=unread)
    assert (done.returncode, complaints(done.stderr)) == (1, [])
    assert table.stat().st_size > 0


@pytest.mark.parametrize('arguments', [['--help'], ['report', '--help']], ids=str)
def test_help_that_a_full_disk_does_not_take_is_said_in_one_line(arguments: list[object]) -> None:
    done = run(arguments, '>/dev/full')
    assert (done.returncode, done.stderr) == (2, 'error: No space left on device\n')


@pytest.mark.parametrize(
    'environment',
    [
        *({'MPLBACKEND': backend} for backend in HOSTILE_BACKENDS),
        {'HOME': '/proc/none', 'XDG_CACHE_HOME': None, 'XDG_CONFIG_HOME': None},
        ASCII,
    ],
    ids=str,
)
def test_a_picture_is_drawn_whatever_the_environment_names(
    environment: Mapping[str, str | None], folder: Path
) -> None:
    picture = folder / 'run_folder_trajectories_seed_5.png'
    picture.unlink(missing_ok=True)
    golden = ROOT / 'test' / 'golden' / 'run_folder'
    done = run(['report', golden, '--pictures', folder], '', environment)
    assert (done.returncode, complaints(done.stderr)) == (0, [])
    assert 'completion time' in done.stdout
    assert picture.read_bytes().startswith(b'\x89PNG')


def test_a_picture_that_cannot_be_drawn_costs_no_table(folder: Path) -> None:
    golden = ROOT / 'test' / 'golden' / 'run_folder'
    done = run(['report', golden, '--pictures', folder / 'field.yaml'])
    assert done.returncode == 2
    [line] = complaints(done.stderr)
    picture = folder / 'field.yaml' / 'run_folder_trajectories_seed_5.png'
    assert line == f'error: {picture}: cannot be drawn: Not a directory'
    assert 'completion time' in done.stdout
    assert 'picture' not in done.stdout


def test_a_backend_that_is_one_stays_the_one_that_others_draw_with() -> None:
    program = (
        'from uav_collect.analysis import plotting; import matplotlib, os\n'
        "assert matplotlib.rcParams['backend'] == os.environ['MPLBACKEND'] == 'svg'\n"
    )
    environment = {**os.environ, 'MPLBACKEND': 'svg'}
    completed(sys.executable, '-c', program, cwd=ROOT, env=environment)


def test_what_is_cached_without_a_home_is_this_users_alone(tmp_path: Path) -> None:
    program = 'from uav_collect.kernels.compile import cache_folder; print(cache_folder())'
    owned = tmp_path / f'uav_collect_{os.getuid()}'

    def folder() -> tuple[Path, str]:
        environment = {**os.environ, 'XDG_CACHE_HOME': '/proc/none', 'TMPDIR': str(tmp_path)}
        done = completed(sys.executable, '-c', program, cwd=ROOT, env=environment)
        return Path(done.stdout.strip()), done.stderr

    cache, said = folder()
    assert (cache.parent, said) == (owned, '')
    assert owned.stat().st_mode & 0o777 == 0o700
    owned.chmod(0o777)
    cache, said = folder()
    assert cache.parent != owned
    assert said == (
        f'{owned}: is not of this user alone: kernels are not kept, the next process compiles them'
        ' again\n'
    )
    assert [*tmp_path.iterdir()] == [owned]  # what was not kept is gone

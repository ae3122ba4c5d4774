"""A disk that takes no more: what was whole stays whole, and one line says what is lost."""

from collections.abc import Callable
from pathlib import Path
import shutil

from full_disk import no_file_beyond
import pytest
from train_command import copied, Finished, learned
from uav_collect.__main__ import main
from uav_collect.training.run_record import read_run

pytest.importorskip('torch', reason='training needs torch')
from uav_collect.learning.trainer import Trainer


def limits(folder: Path, *names: str) -> list[int]:
    """For each file of a run one that keeps it, and no smaller one, from being whole."""
    return sorted((folder / name).stat().st_size * 9 // 10 for name in names)


def trained(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, list[str]]:
    """How a command ended, and its lines of errors and of what it lost."""
    status = main(['train', *map(str, arguments)])
    shown = capsys.readouterr().err
    assert 'Traceback' not in shown
    lines = [line for line in shown.splitlines() if line.startswith('error: ') or 'lost' in line]
    return status, lines


def full(run: Path, lines: list[str]) -> str:
    """The file that the disk did not take, as the last line names it."""
    assert lines[-1].startswith(f'error: {run}/')
    assert lines[-1].endswith(': File too large')
    assert not list(run.rglob('*.part'))
    return lines[-1].split(':')[1].removeprefix(f' {run}/')


def test_a_disk_that_is_full_when_a_run_begins_has_nothing_of_it(
    finished: Finished, settings: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, named = tmp_path / 'run', []
    for limit in limits(finished[0], 'training.yaml', 'scenario.yaml', 'policy.safetensors'):
        with no_file_beyond(limit):
            status, lines = trained(capsys, *settings, '--output', run)
        assert status == 2
        named.append(full(run, lines))
        assert not run.exists()
    assert {'scenario.yaml', 'checkpoint/state.pt'} <= {*named}


def test_a_disk_that_is_full_in_any_later_phase_costs_no_more_than_what_is_said(
    finished: Finished,
    settings: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def killed(*arguments: object) -> None:
        raise KeyboardInterrupt

    begun = tmp_path / 'begun'
    with monkeypatch.context() as patched:
        patched.setattr(Trainer, 'run', killed)
        assert trained(capsys, *settings, '--output', begun) == (130, [])
    named = []
    for limit in (
        100,
        *limits(finished[0], 'run.json', 'policy.safetensors', 'checkpoint/state.pt'),
    ):
        run = tmp_path / f'run_{limit}'
        shutil.copytree(begun, run)
        with no_file_beyond(limit):
            status, lines = trained(capsys, '--resume', run, '--checkpoint-minutes', '1e6')
        assert status == 2
        named.append(full(run, lines))
        if named[-1] == 'checkpoint/state.pt':
            assert ' decisions are lost, those after the last checkpoint' in lines[0]
        if not read_run(run).is_done:
            assert trained(capsys, '--resume', run) == (0, [])
        assert learned(run) == learned(finished[0])
    assert {'run.json', 'policy.safetensors', 'checkpoint/state.pt'} <= {*named}


def as_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def as_file(path: Path) -> None:
    shutil.rmtree(path)
    path.touch()


@pytest.mark.parametrize(
    ('name', 'spoil'),
    [
        ('checkpoint', as_file),
        ('tensorboard', as_file),
        ('policy.safetensors', as_folder),
        ('last.safetensors', as_folder),
        ('curve.png', as_folder),
    ],
)
def test_what_cannot_be_written_is_named_and_no_other_file_suffers(
    name: str,
    spoil: Callable[[Path], None],
    finished: Finished,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    run = copied(finished[0], tmp_path / 'run')
    spoil(run / name)
    status, lines = trained(capsys, '--resume', run, '--decisions', '1400')
    assert status == 2
    assert lines[-1].startswith(f'error: {run / name}')
    assert read_run(run).seed == 0
    if name != 'policy.safetensors':
        policy = (run / 'policy.safetensors').read_bytes()
        assert len(policy) == (finished[0] / 'policy.safetensors').stat().st_size


def test_a_folder_that_cannot_be_made_is_named(
    settings: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    for folder in ('/proc/nowhere/run', '/dev/null/run'):  # nobody may, not even root
        status, lines = trained(capsys, *settings, '--output', folder)
        assert status == 2
        [line] = lines
        assert line.startswith('error: /')

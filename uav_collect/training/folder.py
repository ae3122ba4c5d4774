"""The folder of a training run, written while it runs: tables, TensorBoard, policies, record."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, ExitStack, suppress
from dataclasses import asdict, replace
import fcntl
from io import FileIO
import os
from pathlib import Path
import shutil
from typing import Any, TYPE_CHECKING

from uav_collect import files
from uav_collect.errors import TrainingRunError
from uav_collect.training.planned_run import (
    CONDITIONS_FILE,
    CONFIG_FILE,
    COURSES_FILE,
    INITIAL_POLICY,
    PlannedRun,
)
from uav_collect.training.run_record import (
    PANEL_FILE,
    PROGRESS_COLUMNS,
    PROGRESS_FILE,
    read_rows,
    RUN_FILE,
    TABLES,
    VALIDATION_COLUMNS,
    VALIDATION_FILE,
)

if TYPE_CHECKING:  # loaded when training, so that --help answers at once
    from uav_collect.training.progress import Progress, ValidationResult
    from uav_collect.uav.policy_network import FrozenPolicy

CHECKPOINT = 'checkpoint'
BEST_POLICY = 'policy.safetensors'
LAST_POLICY = 'last.safetensors'
CURVE = 'curve.png'
TENSORBOARD = 'tensorboard'
BEGINNING = '.beginning'  # in a folder whose run has no first checkpoint yet


class TrainingFolder:
    """Writes the folder of one run; open it by `open_training_folder`."""

    def __init__(
        self,
        run: PlannedRun,
        n_decisions: int,
        tables: Mapping[str, FileIO],
        scalars: Callable[[int, Mapping[str, float]], None],
    ) -> None:
        """Append to open tables, by their files' names, and an open TensorBoard file."""
        self.path = run.folder
        self._run = run
        self._tables = tables
        self._add_scalars = scalars
        self.n_decisions_saved = n_decisions  # in the last checkpoint

    @property
    def checkpoint(self) -> Path:
        """Folder of the checkpoint that the run is resumed from."""
        return self.path / CHECKPOINT

    def log(self, progress: 'Progress') -> None:
        """Add a report of the training to the tables and to TensorBoard.

        Raises:
            OSError: naming the file.
        """
        row = asdict(progress)
        self._append(PROGRESS_FILE, row)
        self._log_scalars('training', PROGRESS_COLUMNS[1:], row, progress.n_decisions)
        if progress.validation is not None:
            row = asdict(progress.validation)
            self._append(VALIDATION_FILE, row)
            self._log_panel(progress.validation)
            self._log_scalars(
                'validation', VALIDATION_COLUMNS[1:], row, progress.validation.n_decisions
            )

    def _log_panel(self, validation: 'ValidationResult') -> None:
        """Add each condition of a validation in a panel, if it was in one."""
        row = asdict(validation)
        for number, condition in enumerate(validation.conditions, 1):
            self._append(PANEL_FILE, {**row, **asdict(condition), 'condition': number})
        ratios = {each.name: each.sweep_ratio for each in validation.conditions}
        if ratios:
            scalars = {'mean': validation.sweep_ratio, **ratios}
            self._log_scalars('sweep_ratio', tuple(scalars), scalars, validation.n_decisions)

    def _append(self, name: str, row: Mapping[str, Any]) -> None:
        file = self._tables[name]
        left = files.csv_of([[row[column] for column in TABLES[name]]])
        with files.naming(Path(str(file.name))):
            while left:  # a disk may take a part only
                left = left[file.write(left) :]

    def _log_scalars(
        self, group: str, columns: tuple[str, ...], row: Mapping[str, Any], n_decisions: int
    ) -> None:
        scalars = {f'{group}/{column}': row[column] for column in columns}
        with files.naming(self.path / TENSORBOARD):
            self._add_scalars(n_decisions, scalars)

    def save(self, policy: 'FrozenPolicy | None', name: str) -> None:
        """Write a policy in place of the one of that name, if there is one to write.

        Raises:
            OSError: naming the file.
        """
        _save_policy(policy, self.path / name)

    def mark_done(self) -> None:
        """Write into the record that the run has had its time."""
        record = replace(self._run.record, is_done=True)
        files.write_atomically(self.path / RUN_FILE, record.to_json())


@contextmanager
def open_training_folder(
    run: PlannedRun, n_decisions: int, begin: Callable[[], None]
) -> Iterator[TrainingFolder]:
    """The folder of a run that starts, or goes on after so many decisions.

    Rows of tables and TensorBoard that lie after these decisions are dropped: they will be
    written again. A table that is missing begins anew.

    Args:
        begin: writes the first checkpoint of a run that starts; where that fails nothing of the
            run stays.

    Raises:
        TrainingRunError: another process trains in the folder, or a table of it is damaged.
        OSError: naming what cannot be written.
    """
    from uav_collect.training.tensorboard import scalar_writer

    run.folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        stack.enter_context(_locked(run.folder))
        for folder in (run.folder, run.folder / CHECKPOINT):
            files.drop_partial(folder)
        if not run.is_begun:
            _begin(run, begin)
        files.write_atomically(run.folder / RUN_FILE, run.record.to_json())
        (run.folder / BEGINNING).unlink(missing_ok=True)
        tables = {
            name: stack.enter_context(_table(run.folder / name, columns, n_decisions))
            for name, columns in TABLES.items()
            if name != PANEL_FILE or run.courses is not None
        }
        with files.naming(run.folder / TENSORBOARD):
            scalars = stack.enter_context(scalar_writer(run.folder / TENSORBOARD, n_decisions + 1))
        yield TrainingFolder(run, n_decisions, tables, scalars)


def is_free(folder: Path) -> bool:
    """Whether there is nothing in a folder but what a run left that did not come to begin."""
    if not folder.exists():
        return True
    names = {path.name for path in folder.iterdir()} if folder.is_dir() else {folder.name}
    return not names or (BEGINNING in names and RUN_FILE not in names)


def _begin(run: PlannedRun, write_checkpoint: Callable[[], None]) -> None:
    """Write what a run is gone on with; its record, which says that there is one, comes last.

    Another file says meanwhile that the folder is free all the same, should this be killed.
    """
    beginning = run.folder / BEGINNING
    if beginning.exists():
        shutil.rmtree(run.folder / CHECKPOINT, ignore_errors=True)
        for path in (*run.folder.glob('scenario*.yaml'), run.folder / INITIAL_POLICY):
            path.unlink(missing_ok=True)
    try:
        beginning.touch()
        for path, scenario in zip(run.scenario_files, run.scenarios, strict=True):
            files.write_atomically(path, scenario.to_yaml().encode())
        if run.courses is not None:
            distribution, panel = run.courses.distribution, run.courses.panel
            files.write_atomically(run.folder / COURSES_FILE, distribution.to_yaml().encode())
            files.write_atomically(run.folder / CONDITIONS_FILE, panel.to_yaml().encode())
        files.write_atomically(run.folder / CONFIG_FILE, run.config.to_yaml().encode())
        _save_policy(run.initial, run.folder / INITIAL_POLICY)
        write_checkpoint()
    except OSError:
        names = (CONFIG_FILE, COURSES_FILE, CONDITIONS_FILE, INITIAL_POLICY, BEGINNING)
        for path in (*run.scenario_files, *(run.folder / name for name in names)):
            path.unlink(missing_ok=True)
        for folder in (run.folder / CHECKPOINT, run.folder):
            with suppress(OSError):  # not there, or others have more in it
                folder.rmdir()
        raise


def _save_policy(policy: 'FrozenPolicy | None', path: Path) -> None:
    from uav_collect.uav.policy_file import save_policy

    if policy is not None:
        save_policy(path, policy)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Lock the folder, so that no two trainings write into it."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            what = f'{folder}: another process trains in it'
            raise TrainingRunError(what) from None
        except OSError:
            pass  # a file system without locks
        yield
    finally:
        os.close(descriptor)


@contextmanager
def _table(path: Path, columns: tuple[str, ...], n_decisions: int) -> Iterator[FileIO]:
    """A table to append to, with its header and the rows up to so many decisions."""
    rows: list[list[str]] = []
    with suppress(FileNotFoundError), files.naming(path):
        rows = read_rows(path, columns)
    kept = [row for row in rows if int(row[0]) <= n_decisions]
    files.write_atomically(path, files.csv_of([columns, *kept]))
    # Unbuffered: what a full disk did not take is not tried again when the file is closed.
    with path.open('ab', buffering=0) as file:
        yield file

"""Tiny trainings that several modules look at."""

import fcntl
import json
import os
from subprocess import CompletedProcess

from processes import completed, Processes, RunningProcess
import pytest
from tiny_world import tiny
from train_command import DECISIONS, ENVIRONMENT, Finished, PRESET, ROOT, Start, TRAIN


@pytest.fixture(scope='session')
def settings(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The options that make a training tiny."""
    folder = tmp_path_factory.mktemp('settings')
    (folder / 'field.yaml').write_text(tiny(name='field').to_yaml())
    (folder / 'quick.yaml').write_text(PRESET)
    files = ['--scenario', str(folder / 'field.yaml'), '--preset', str(folder / 'quick.yaml')]
    return [*files, '--decisions', str(DECISIONS)]


@pytest.fixture(scope='session')
def finished(settings: list[str], tmp_path_factory: pytest.TempPathFactory) -> Finished:
    """A run that nothing interrupted, and what it said; all workers of a session look at one."""
    own = tmp_path_factory.getbasetemp()
    folder = (own.parent if 'PYTEST_XDIST_WORKER' in os.environ else own) / 'finished'
    folder.mkdir(exist_ok=True)
    run, said = folder / 'run', folder / 'said.json'
    with (folder / 'lock').open('w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not said.exists():
            command = (*TRAIN, *settings, '--output', run)
            done = completed(*command, env=os.environ | ENVIRONMENT, cwd=ROOT)
            said.write_text(json.dumps([done.args, done.returncode, done.stdout, done.stderr]))
    return run, CompletedProcess(*json.loads(said.read_text()))


@pytest.fixture
def start(processes: Processes) -> Start:
    """Starts a train command in the test's folder."""

    def begin(*arguments: str) -> RunningProcess:
        return processes.run('train', *TRAIN, *arguments, **ENVIRONMENT)

    return begin

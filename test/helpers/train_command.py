"""The command train, in processes of its own: tiny trainings of a tiny world, in seconds."""

from collections.abc import Callable
import csv
from dataclasses import replace
from pathlib import Path
import shlex
import shutil
import subprocess
import sys

from processes import DEADLINE_S, RunningProcess
import pytest
from uav_collect.training.run_record import read_run
from uav_collect.uav.policy_file import load_policy

ROOT = Path(__file__).parents[2]
ENVIRONMENT = {'PYTHONPATH': str(ROOT)}
COMPILING_S = DEADLINE_S  # of a first process, on a busy machine
TRAIN = (sys.executable, '-m', 'uav_collect', 'train')
DECISIONS = 1200

Start = Callable[..., RunningProcess]
Finished = tuple[Path, subprocess.CompletedProcess[str]]

# Every 40 decisions an update, every 10 updates a validation.
PRESET = """extends: strong
network: {hidden_size: 8}
mixer: {embedding_size: 4, hypernetwork_size: 4}
rollout: {missions_at_once: 4, max_decisions_per_cell: 2.5, decisions_per_update: 40}
replay: {decisions: 2000, missions_per_batch: 4}
validation: {missions: 2, every_updates: 10}
"""


def columns(path: Path) -> dict[str, list[str]]:
    with path.open(newline='') as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


def learned(run: Path) -> dict[str, object]:
    """What a run learned, without what depends on the clock."""
    validations = columns(run / 'validation.csv')
    del validations['wall_s']
    policies = [load_policy(run / f'{name}.safetensors').digest for name in ('policy', 'last')]
    return {'validations': validations, 'policies': policies}


def said(capsys: pytest.CaptureFixture[str]) -> str:
    """The one line that it wrote, but for those that say what takes long on a busy machine."""
    shown, patient = capsys.readouterr(), ('compiling kernels (once)', 'waiting for ')
    [line] = [line for line in shown.err.splitlines() if not line.startswith(patient)]
    assert shown.out == ''
    return line


def events(run: Path, tag: str) -> list[tuple[int, float]]:
    """What TensorBoard would show."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    seen = EventAccumulator(str(run / 'tensorboard'))
    seen.Reload()
    return [(event.step, event.value) for event in seen.Scalars(tag)]


def copied(run: Path, folder: Path) -> Path:
    """The run as if it had not noted that it is done."""
    shutil.copytree(run, folder)
    record = replace(read_run(folder), is_done=False)
    (folder / 'run.json').write_bytes(record.to_json())
    return folder


def resume_command(process: RunningProcess) -> list[str]:
    """The words that it said to go on with."""
    return shlex.split(process.wait_for(r'^  (.* train --resume .*)$')[1])

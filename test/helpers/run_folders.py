"""Run folders as train leaves them, written by hand: every mean can be worked out on paper."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from uav_collect.training.run_record import (
    PROGRESS_COLUMNS,
    PROGRESS_FILE,
    RUN_FILE,
    RunRecord,
    VALIDATION_COLUMNS,
    VALIDATION_FILE,
)

RECORD = RunRecord(
    training='field_n2_aqmix_strong',
    algorithm='aqmix',
    scenario='field',
    n_uavs=(2,),
    scenario_fingerprint='0123456789abcdef',
    preset='strong',
    overrides=(),
    training_fingerprint='fedcba9876543210',
    initial='',
    seed=0,
    minutes=None,
    decisions=300,
    device='cpu',
    seeds=(0,),
    started='2026-01-31T12:00:00+00:00',
    git_revision='0123456789ab',
    versions={'python': '3.11.7'},
    command='train',
    is_done=True,
)


def write_run(
    folder: Path,
    validations: Mapping[int, float],
    *,
    exploring: Mapping[int, float] | None = None,
    **changes: object,
) -> Path:
    """Write a run folder.

    Args:
        folder: to be made.
        validations: energy efficiency [kbit/J] by number of decisions; 10 decisions are an update
            and take 6 s.
        exploring: the same of the missions that explore.
        changes: of the record.
    """
    folder.mkdir(parents=True)
    seeds = (changes.get('seed', RECORD.seed),)
    record = replace(RECORD, **{'seeds': seeds, **changes})  # type: ignore[arg-type]
    (folder / RUN_FILE).write_bytes(record.to_json())
    for name, columns, efficiencies in (
        (VALIDATION_FILE, VALIDATION_COLUMNS, validations),
        (PROGRESS_FILE, PROGRESS_COLUMNS, exploring or {}),
    ):
        rows = [_row(columns, *each) for each in efficiencies.items()]
        lines = [','.join(columns), *(','.join(row) for row in rows)]
        (folder / name).write_text('\n'.join(lines) + '\n')
    return folder


def _row(columns: Sequence[str], n_decisions: int, efficiency: float) -> list[str]:
    known = {
        'n_decisions': n_decisions,
        'n_updates': n_decisions / 10,
        'wall_s': n_decisions / 10 * 6,
        'efficiency_kbit_per_j': efficiency,
        'training_efficiency_kbit_per_j': efficiency,
    }
    return [str(known.get(column, 1.0)) for column in columns]

"""A run goes on by the teachers that it began with, or not at all."""

from pathlib import Path

from episodes import small
import pytest
from random_policies import header, saved
from tiny_world import tiny, uav
from uav_collect.errors import TrainingRunError
from uav_collect.training.planned_run import CONFIG_FILE, new_record, stored_run
from uav_collect.training.run_record import read_run, RUN_FILE, RunRecord
from uav_collect.training.teachers import teacher_labels

SCENARIO = tiny(uav(5.0, energy_budget_kj=9.0), uav(10.0, energy_budget_kj=5.0))


def begun(folder: Path, algorithm: str, *teachers: str) -> RunRecord:
    """The record of a run that begins, as its folder holds it."""
    config = small('imitation', imitation__teachers=[*teachers])
    record = new_record(
        [SCENARIO],
        config,
        None,
        training='run',
        algorithm=algorithm,
        overrides=(),
        seed=0,
        minutes=1.0,
        decisions=None,
        device='cpu',
        seeds=(0,),
    )
    (folder / 'scenario.yaml').write_text(SCENARIO.to_yaml())
    (folder / CONFIG_FILE).write_text(config.to_yaml())
    (folder / RUN_FILE).write_bytes(record.to_json())
    return record


def test_a_run_does_not_go_on_by_other_teachers(tmp_path: Path) -> None:
    learned = saved(tmp_path, 'learned', header(side=4, n_uavs=2))
    teachers = begun(tmp_path, 'imitation', str(learned), 'hert').teachers
    assert teachers[0].startswith(f'{learned}@')
    assert teachers[1] == 'hert@rule'
    assert stored_run(tmp_path, read_run(tmp_path)).record.teachers == teachers
    saved(tmp_path, 'learned', header(side=4, n_uavs=2), seed=1)
    with pytest.raises(TrainingRunError, match=f'its teachers is .*: must be {teachers[0]} hert@'):
        stored_run(tmp_path, read_run(tmp_path))


def test_a_record_of_before_teachers_stood_in_it_goes_on(tmp_path: Path) -> None:
    record = begun(tmp_path, 'imitation', 'hert')
    text = record.to_json().replace(b'"teachers": [\n    "hert@rule"\n  ]', b'"teachers": []')
    (tmp_path / RUN_FILE).write_bytes(text)
    assert stored_run(tmp_path, read_run(tmp_path)).record.teachers == ()


def test_code_that_teaches_is_known_by_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    for name, action in (('teacher_a', 0), ('teacher_b', 5)):
        (tmp_path / f'{name}.py').write_text(f'def own(situation):\n    return {action}\n')
    first, second = (
        teacher_labels(small('imitation', imitation__teachers=[f'{name}:own']), 'imitation')[0]
        for name in ('teacher_a', 'teacher_b')
    )
    assert first.partition('@')[2] != second.partition('@')[2]


def test_who_does_not_imitate_has_no_teachers(tmp_path: Path) -> None:
    assert begun(tmp_path, 'branches', 'hert').teachers == ()

"""The mission seeds of trainings: nobody flies a mission twice, and each start is written down."""

from pathlib import Path

import pytest
from uav_collect.errors import TrainingRunError
from uav_collect.training.seeds import first_training_seed, next_training_seed, STARTS_FILE


def test_no_two_worlds_runs_or_starts_fly_the_same_missions() -> None:
    firsts = [
        first_training_seed(run, world, start)
        for run in (0, 1, 2**28 - 1)
        for world in (0, 15)
        for start in (1, 2, 255)
    ]
    assert len({*firsts}) == len(firsts)
    gaps = [
        later - first for first, later in zip(sorted(firsts), sorted(firsts)[1:], strict=False)
    ]
    assert min(gaps) >= 2**20
    assert max(firsts) < 2**62


def test_each_start_of_a_world_has_missions_of_its_own_written_down_in_the_run(
    tmp_path: Path,
) -> None:
    run = tmp_path / 'run'
    seeds = [next_training_seed(run, 3, world) for world in (0, 1, 0, 0, 11, 1)]
    starts = [(0, 0), (1, 0), (0, 1), (0, 2), (11, 0), (1, 1)]
    assert seeds == [first_training_seed(3, world, start) for world, start in starts]
    rows = (run / STARTS_FILE).read_text().splitlines()
    assert rows[0] == 'world,first_seed'
    assert [int(row.split(',')[1]) for row in rows[1:]] == seeds


def test_starts_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    (tmp_path / STARTS_FILE).write_bytes(b'world,first_seed\n\xff,1\n')
    with pytest.raises(TrainingRunError, match=f'{tmp_path}/{STARTS_FILE}: is no text'):
        next_training_seed(tmp_path, 3, 0)

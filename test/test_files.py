import errno
import math
import os
from pathlib import Path

import pytest
from uav_collect import files


def test_a_disk_that_gets_full_leaves_what_the_file_held_and_names_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / 'policy'
    files.write_atomically(path, b'old')

    def is_full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, 'fsync', is_full)
    with pytest.raises(OSError, match='No space left') as raised:
        files.write_atomically(path, b'new')
    assert raised.value.filename == str(path)
    assert path.read_bytes() == b'old'
    assert [*tmp_path.iterdir()] == [path]


def test_a_link_stays_one_when_what_it_points_to_is_written(tmp_path: Path) -> None:
    target, link = tmp_path / 'target', tmp_path / 'link'
    link.symlink_to(target)
    files.write_atomically(link, memoryview(b'new'))
    assert link.is_symlink()
    assert target.read_bytes() == b'new'


def test_what_a_killed_writer_left_is_dropped_and_nothing_else(tmp_path: Path) -> None:
    for name in ('.policy.71.part', 'policy', '.hidden', 'third.part'):
        (tmp_path / name).touch()
    files.drop_partial(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {'policy', '.hidden', 'third.part'}
    files.drop_partial(tmp_path / 'nowhere')


def test_cells_are_quoted_where_they_must_be_and_blank_where_a_number_is_not_known() -> None:
    cells = map(files.blank_if_nan, (0.1, math.nan, 3))
    assert files.csv_of([('a', 'b, c', 'd'), cells]) == b'a,"b, c",d\n0.1,,3\n'

"""Files are written whole or not at all; tables as CSV."""

import errno
import math
import os
from pathlib import Path

from processes import Processes, wait_until
import pytest
from uav_collect import files


def test_a_file_is_written_whole(tmp_path: Path) -> None:
    path = tmp_path / 'file'
    path.write_bytes(b'old and longer')
    files.write_atomically(path, b'new')
    assert path.read_bytes() == b'new'
    assert list(tmp_path.iterdir()) == [path]


def test_a_failed_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / 'file'
    path.write_bytes(b'old')

    def fail(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, 'fsync', fail)
    with pytest.raises(OSError, match=f'No space left on device: .{path}.') as raised:
        files.write_atomically(path, b'new')
    assert raised.value.filename == str(path)
    assert path.read_bytes() == b'old'
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_is_read_up_to_a_size_and_none_of_a_larger_one(tmp_path: Path) -> None:
    path, large = tmp_path / 'file', tmp_path / 'large'
    path.write_bytes(b'12345')
    with large.open('wb') as file:
        file.truncate(2**40)  # all holes: no memory has room for it
    assert files.read_bounded(path, 5) == b'12345'
    with pytest.raises(OSError, match='has 5 bytes: must have at most 4') as raised:
        files.read_bounded(path, 4)
    assert raised.value.filename == str(path)
    with pytest.raises(OSError, match='must have at most 10,000,000'):
        files.read_bounded(large, 10**7)


def test_an_error_of_another_file_is_not_that_of_the_one_being_read(tmp_path: Path) -> None:
    path, other = tmp_path / 'file', '/elsewhere'
    path.touch()
    with pytest.raises(OSError, match='No space') as raised, files.open_file(path):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), other)
    assert raised.value.filename == other


def test_a_pipe_a_device_and_a_folder_are_no_files_to_read(tmp_path: Path) -> None:
    pipe = tmp_path / 'pipe'
    os.mkfifo(pipe)  # that nobody ever writes into
    for path in (pipe, Path('/dev/zero'), tmp_path):
        with pytest.raises(OSError, match='must be a file') as raised:
            files.read_bounded(path, 100)
        assert raised.value.filename == str(path)
    with pytest.raises(OSError, match='is no path') as raised:
        files.read_bounded(Path('a\0b'), 100)
    with pytest.raises(FileNotFoundError):
        files.read_bounded(tmp_path / 'nowhere', 100)


def test_new_files_have_the_permissions_of_the_user(tmp_path: Path) -> None:
    mine, theirs = tmp_path / 'mine', tmp_path / 'theirs'
    mine.touch()
    files.write_atomically(theirs, b'')
    assert mine.stat().st_mode == theirs.stat().st_mode


def test_a_link_stays_one_when_what_it_points_to_is_written(tmp_path: Path) -> None:
    target, link = tmp_path / 'target', tmp_path / 'link'
    link.symlink_to(target)
    files.write_parts_atomically(link, [b'n', memoryview(b'ew')])
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


def test_links_that_lead_in_a_circle_are_no_file_to_write(tmp_path: Path) -> None:
    loop = tmp_path / 'loop'
    loop.symlink_to(loop)
    for write in (
        files.check_writable,
        files.check_there,
        lambda path: files.write_atomically(path, b'new'),
        lambda path: files.write_result(path, b'new'),
    ):
        with pytest.raises(OSError, match='Too many levels of symbolic links') as raised:
            write(loop)
        assert raised.value.filename == str(loop)


def test_a_pipe_that_nobody_reads_is_refused_and_none_is_a_file_of_ours(tmp_path: Path) -> None:
    pipe = tmp_path / 'pipe'
    os.mkfifo(pipe)
    for write in (files.check_writable, lambda path: files.write_result(path, b'new')):
        with pytest.raises(OSError, match='is a pipe that nobody reads') as raised:
            write(pipe)
        assert raised.value.filename == str(pipe)
    with pytest.raises(OSError, match='is a pipe or a device: must be a file'):
        files.write_atomically(pipe, b'new')


def test_a_pipe_that_was_checked_is_written_not_replaced(
    processes: Processes, tmp_path: Path
) -> None:
    pipe = tmp_path / 'pipe'
    os.mkfifo(pipe)
    reader = processes.run('reader', 'cat', str(pipe))

    def has_come() -> bool:
        try:
            files.check_writable(pipe)
        except OSError as error:
            assert error.errno == errno.ENXIO
            return False
        return True

    wait_until(has_come)
    files.write_result(pipe, b'new')
    assert reader.wait_for_exit() == 0
    assert reader.output == 'new'
    assert pipe.is_fifo()


def test_a_folder_is_no_file_to_write(tmp_path: Path) -> None:
    for write in (files.check_writable, lambda path: files.write_result(path, b'new')):
        with pytest.raises(OSError, match=f"is a folder: must be a file: '{tmp_path}'$"):
            write(tmp_path)

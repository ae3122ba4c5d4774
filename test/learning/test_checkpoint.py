"""A checkpoint is to the byte what was written, or it is refused; reading it runs no code."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import deepcopy
import io
import math
import os
from pathlib import Path
import pickle
import random
from typing import Any, BinaryIO

from checkpoints import forged, new_trainer, saved_training, Trap
from episodes import single_threaded_torch
import numpy as np
import pytest
from uav_collect import files
from uav_collect.errors import CheckpointError
from uav_collect.kernels.stops import watchdog
from uav_collect.learning.checkpoint import (
    checkpoint_bytes,
    checkpoint_from_bytes,
    read_checkpoint,
    STATE_FILE,
    write_checkpoint,
)
from uav_collect.learning.saved import SavedPart

STATE = {
    'counts': [1, -2, 2**63],
    'share': 0.1 + 0.2,
    'name': 'Größe',
    'none': None,
    'tensors': {'weight': np.arange(6, dtype=np.float32).reshape(2, 3), 'empty': np.zeros((0, 3))},
    'rows': [np.array(7, dtype=np.int64), {'of': np.array([2**64 - 1], dtype=np.uint64)}],
}


@pytest.fixture(scope='module')
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a checkpoint of a tiny training."""
    single_threaded_torch()
    folder = tmp_path_factory.mktemp('saved')
    saved_training(folder)
    return folder


@pytest.fixture
def file(saved: Path, tmp_path: Path) -> Path:
    """A copy of that checkpoint's file."""
    copy = tmp_path / STATE_FILE
    copy.write_bytes((saved / STATE_FILE).read_bytes())
    return copy


def refusal(file: Path) -> str:
    """The one line by which a checkpoint is refused, without the file that it must begin with."""
    with pytest.raises(CheckpointError) as raised:
        read_checkpoint(file.parent)
    line = str(raised.value)
    assert '\n' not in line
    assert line.startswith(f'{file}: ')
    return line.removeprefix(f'{file}: ')


def test_values_and_arrays_come_back_as_they_were() -> None:
    back = checkpoint_from_bytes(checkpoint_bytes(STATE))
    assert back['counts'] == STATE['counts']
    assert (back['share'], back['name'], back['none']) == (0.1 + 0.2, 'Größe', None)
    for mine, theirs in (
        (back['tensors']['weight'], STATE['tensors']['weight']),  # type: ignore[call-overload, index]
        (back['tensors']['empty'], STATE['tensors']['empty']),  # type: ignore[call-overload, index]
        (back['rows'][0], STATE['rows'][0]),  # type: ignore[index]
        (back['rows'][1]['of'], STATE['rows'][1]['of']),  # type: ignore[index]
    ):
        assert (mine.dtype, mine.shape, mine.tobytes()) == (
            theirs.dtype, theirs.shape, theirs.tobytes(),
        )  # fmt: skip
        assert mine.flags.writeable


def test_equal_states_give_equal_bytes() -> None:
    assert checkpoint_bytes(STATE) == checkpoint_bytes(deepcopy(STATE))


def test_a_byte_that_was_changed_anywhere_is_found_before_anything_is_read(file: Path) -> None:
    whole, rng = file.read_bytes(), random.Random(0)
    for place in [*range(72), *rng.sample(range(len(whole)), 500), len(whole) - 1]:
        changed = bytearray(whole)
        changed[place] ^= 1 << rng.randrange(8)
        file.write_bytes(changed)
        said = refusal(file)
        assert said.startswith('is damaged: '), (place, said)
        assert 'head' not in said, (place, said)


def test_a_checkpoint_that_is_shorter_or_longer_is_refused_unread(file: Path) -> None:
    whole = file.read_bytes()
    for n_bytes in (0, 1, 23, 24, 71, 72, 100, len(whole) // 2, len(whole) - 1):
        file.write_bytes(whole[:n_bytes])
        assert refusal(file).startswith('is damaged: ')
    for more in (b'\0', b'more', whole):
        file.write_bytes(whole + more)
        assert 'bytes: must have' in refusal(file)


def test_a_file_of_holes_costs_no_memory(file: Path) -> None:
    first = file.read_bytes()[:72]
    for start in (b'', first):
        with file.open('wb') as written:
            written.write(start)
            written.truncate(2**40)  # all holes: no memory has room for it
        assert refusal(file).startswith('is damaged: ')


def test_what_is_no_file_is_named_at_once(tmp_path: Path) -> None:
    file = tmp_path / STATE_FILE
    assert refusal(file) == 'is missing: cannot resume without it; start a new training'
    file.mkdir()
    assert 'is a folder' in refusal(file)
    file.rmdir()
    os.mkfifo(file)  # that nobody ever writes into
    assert 'is a pipe' in refusal(file)
    file.unlink()
    file.symlink_to('/dev/zero')
    assert 'must be a file' in refusal(file)


def test_a_checkpoint_that_is_written_when_a_signal_comes_is_not_cut_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[str | None] = []

    def note(*_: object) -> None:
        written.append(watchdog.why_ended(-math.inf))

    tiny_trainer = new_trainer()
    monkeypatch.setattr('uav_collect.learning.trainer.write_checkpoint', note)
    watchdog.forget()
    tiny_trainer.save(tmp_path)
    assert written == [None]


class _Pieces(io.BytesIO):
    """A file of a system that gives less than it is asked for, and in the end nothing."""

    def __init__(self, content: bytes, n_kept: int) -> None:
        super().__init__(content)
        self._n_left = n_kept

    def readinto(self, buffer: Any) -> int:  # noqa: ANN401
        n_read = super().readinto(memoryview(buffer)[: min(7, self._n_left)])
        self._n_left -= n_read
        return n_read


@pytest.mark.parametrize('n_lacking', [0, 1])
def test_arrays_are_read_whole_or_refused(
    n_lacking: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_checkpoint(tmp_path, STATE)
    content = (tmp_path / STATE_FILE).read_bytes()
    n_bytes = len(content) - 72 - int.from_bytes(content[64:72], 'little')

    @contextmanager
    def opened(path: Path) -> Iterator[tuple[BinaryIO, int]]:
        yield _Pieces(content, n_bytes - n_lacking), len(content)

    monkeypatch.setattr(files, 'open_file', opened)
    if n_lacking:
        assert refusal(tmp_path / STATE_FILE) == 'is damaged: it ends within its arrays'
    else:
        assert checkpoint_bytes(read_checkpoint(tmp_path)) == content


def test_a_pickle_is_refused_and_does_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    torch = single_threaded_torch()
    monkeypatch.chdir(tmp_path)
    file = tmp_path / STATE_FILE
    torch.save({'scenarios': Trap()}, file)  # the format of before
    assert refusal(file).startswith('is a checkpoint of an older version')
    file.write_bytes(pickle.dumps(Trap()))
    assert refusal(file).startswith('is damaged: ')
    whole = checkpoint_bytes(STATE)
    file.write_bytes(forged(whole[:72] + pickle.dumps(Trap())))
    assert refusal(file).startswith('is damaged: ')
    assert not (tmp_path / 'trapped').exists()


@pytest.mark.parametrize(
    'head',
    [
        b'', b'{', b'[]', b'3', b'{"values":{}}', b'{"values":[],"arrays":[]}', b'[' * 100_000,
        b'{"values":{"a":1},"arrays":[[["a"],"<f4",[1]]]}',
        b'{"values":{"a":null},"arrays":[[["b"],"<f4",[1]]]}',
        b'{"values":{"a":null},"arrays":[[[[]],"<f4",[1]]]}',
        b'{"values":{"a":null},"arrays":[[["a"],"<f4",[-1]]]}',
        b'{"values":{"a":null},"arrays":[[["a"],"<f4",[1.5]]]}',
        b'{"values":{"a":null},"arrays":[[["a"],"<f4",[281474976710655,281474976710655]]]}',
        b'{"values":{"a":null},"arrays":[[["a"],"<f4",[2]]]}',
        b'{"values":{"a":null},"arrays":[[["a"],"|O",[1]]]}',
        b'{"values":{"a":null},"arrays":[[["a"],"|S9",[1]]]}',
        b'{"values":{"a":null},"arrays":[["a"]]}',
        b'{"values":{"a":' + b'9' * 5000 + b'},"arrays":[]}',
        b'\xff\xfe',
    ],
)  # fmt: skip
def test_a_head_that_was_forged_is_refused_in_one_line(head: bytes, tmp_path: Path) -> None:
    data = b'\0' * 4
    n_bytes = 72 + len(head) + len(data)
    sizes = n_bytes.to_bytes(8, 'little') + len(head).to_bytes(8, 'little')
    content = checkpoint_bytes({})[:56] + sizes + head + data
    (tmp_path / STATE_FILE).write_bytes(forged(content))
    assert refusal(tmp_path / STATE_FILE).startswith('is damaged: ')


def test_a_checkpoint_takes_the_place_of_the_one_before_whole_or_not_at_all(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = file.read_bytes()

    def full(descriptor: int) -> None:
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(files.os, 'fsync', full)  # type: ignore[attr-defined]
    with pytest.raises(OSError, match='No space left'):
        write_checkpoint(file.parent, STATE)
    assert file.read_bytes() == before
    assert [path.name for path in file.parent.iterdir()] == [STATE_FILE]


def values_of(saved: Path) -> dict[str, Any]:
    return read_checkpoint(saved)


def changed(state: dict[str, Any], path: str, value: Any) -> dict[str, Any]:  # noqa: ANN401
    """The state with another value at a path; a function makes it of the one there."""
    holder: Any = state
    *way, last = (int(key) if key.isdecimal() else key for key in path.split('/'))
    for key in way:
        holder = holder[key]
    holder[last] = value(holder[last]) if callable(value) else value
    return state


def with_first(value: float) -> Callable[[Any], Any]:
    """An array with another number in its first place."""

    def change(array: Any) -> Any:  # noqa: ANN401 - an array
        array = array.copy()
        array.reshape(-1)[0] = value
        return array

    return change


@pytest.mark.parametrize(
    ('path', 'value', 'words'),
    [
        ('seed', 1, 'seed is 1: must be 0'),
        ('seed', True, 'seed is True: must be 0'),
        ('seed', False, 'seed is False: must be 0'),
        ('scenarios', 'fedcba9876543210', "scenarios is 'fedcba9876543210': must be '"),
        ('settings', 'x' * 100, "settings is 'xxxxxxx"),
        ('algorithm', 'aiql', "algorithm is 'aiql': must be 'aqmix'"),
        ('device', 'cuda', "device is 'cuda': must be 'cpu'"),
        ('turn', -1, 'turn is -1: must be a whole number from 0'),
        ('turn', 1.0, 'turn is 1.0: must be a whole number'),
        ('trained_s', float('nan'), 'trained_s is nan: must be a finite number >= 0'),
        ('trained_s', -1.0, 'trained_s is -1.0: must be a finite number >= 0'),
        ('learner', None, 'learner is no part'),
        ('learner/n_updates', 2**63, 'learner/n_updates is 9223372036854775808'),
        ('learner/networks/agent.head.bias', with_first(np.nan),
         'learner/networks/agent.head.bias holds what is no finite number'),
        ('learner/networks/agent.head.bias', lambda it: it[:-1],
         'learner/networks/agent.head.bias is float32 (4): must be float32 (5)'),
        ('learner/networks/agent.head.bias', lambda it: it.astype(np.float64),
         'is float64 (5): must be float32 (5)'),
        ('learner/moments/agent.head.bias/exp_avg_sq', with_first(-1.0), 'is negative'),
        ('sources', [], 'sources has 0 parts: must have 1'),
        ('sources/0/actions', with_first(7), 'sources/0/actions cannot be flown: action 7'),
        ('sources/0/mission_seeds', with_first(-1), 'cannot be flown: a mission seed is negative'),
        ('sources/0/recent', with_first(np.inf), 'sources/0/recent holds what is no finite'),
        ('replays/0/held/first', with_first(3), 'first does not place the missions'),
        ('replays/0/held/first', with_first(10**6), 'first does not place the missions'),
        ('replays/0/held/uav', with_first(2), 'replays/0/held/uav has a value in row 0'),
        ('replays/0/held/uav', with_first(-1), 'replays/0/held/uav has a value in row 0'),
        ('replays/0/held/cell', with_first(16), 'replays/0/held/cell has a value in row 0'),
        ('replays/0/held/action', with_first(5), 'replays/0/held/action has a value in row 0'),
        ('replays/0/held/action', with_first(-1), 'replays/0/held/action has a value in row 0'),
        ('replays/0/held/decision', with_first(5), 'replays/0/held/decision has a value in row 0'),
        ('replays/0/held/legal', with_first(0), 'replays/0/held/legal has a value in row 0'),
        ('replays/0/held/n_decisions', with_first(-1), 'replays/0/held'),
        ('replays/0/held/is_whole', with_first(2), 'replays/0/held/is_whole has a value in row 0'),
        ('replays/0/held/demand_bit', with_first(-1.0), 'demand_bit has a value in row 0'),
        ('replays/0/held/duration_s', with_first(-1.0), 'duration_s has a value in row 0'),
        ('rng/buffer_pos', 5, 'rng/buffer_pos is 5: must be a whole number from 0 to 4'),
        ('rng/counter', 3, 'rng/counter is no array'),
        ('validation/energy_kj', float('inf'), 'validation/energy_kj is inf: must be a finite'),
        ('best', None, 'best_weights and best must both be there, or neither'),
        ('best_weights/encoder.bias', with_first(np.nan), 'best_weights/encoder.bias holds'),
    ],
)  # fmt: skip
def test_a_value_that_no_trainer_saves_is_named(
    path: str, value: object, words: str, saved: Path, tmp_path: Path
) -> None:
    write_checkpoint(tmp_path, changed(values_of(saved), path, value))
    with pytest.raises(CheckpointError) as raised:
        new_trainer().load(tmp_path)
    assert words in str(raised.value)
    assert str(raised.value).startswith(f'{tmp_path / STATE_FILE}: ')


@pytest.mark.parametrize('name', ['learner', 'sources', 'replays', 'rng', 'turn', 'seed', 'best'])
def test_a_value_that_is_missing_is_named(name: str, saved: Path) -> None:
    state = values_of(saved)
    del state[name]
    with pytest.raises(CheckpointError, match=f'^{name} is missing$'):
        new_trainer().restore(SavedPart(state))

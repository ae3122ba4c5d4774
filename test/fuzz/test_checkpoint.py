"""Checkpoints and run folders that were damaged or forged: refused in a line, or gone on with."""

from collections.abc import Callable
from copy import deepcopy
import functools
import json
from typing import Any

from checkpoints import forged, new_trainer, saved_training
from episodes import single_threaded_torch
from fuzzing import check_lines, fuzzed, memory_folder
from hypothesis import strategies as st
import numpy as np
import pytest
from tiny_world import tiny
from uav_collect.errors import CheckpointError, UavCollectError
from uav_collect.learning.checkpoint import (
    checkpoint_bytes,
    checkpoint_from_bytes,
    STATE_FILE,
)
from uav_collect.training.config import load_preset
from uav_collect.training.folder import CHECKPOINT
from uav_collect.training.planned_run import CONFIG_FILE, new_record, stored_run
from uav_collect.training.run_record import (
    PROGRESS_COLUMNS,
    PROGRESS_FILE,
    read_rows,
    read_run,
    RUN_FILE,
    VALIDATION_COLUMNS,
    VALIDATION_FILE,
)

single_threaded_torch()
_HEAD = 72  # bytes before the head
_TYPES = ('i1', 'u1', 'i4', 'i8', 'u8', 'f4', 'f8')
_TABLES = {VALIDATION_FILE: VALIDATION_COLUMNS, PROGRESS_FILE: PROGRESS_COLUMNS}

_numbers = (
    st.integers(-3, 300)
    | st.sampled_from([2**31, 2**63 - 1, 2**63, 2**64, -(2**63), 10**30])
    | st.floats()
)
_names = st.text(max_size=3)
_values = st.recursive(
    st.none() | st.booleans() | _numbers | st.text(max_size=5),
    lambda each: st.lists(each, max_size=3) | st.dictionaries(_names, each, max_size=3),
    max_leaves=5,
)


@functools.cache
def whole() -> bytes:
    """The bytes of a tiny training's checkpoint."""
    folder = memory_folder('checkpoint') / 'saved'
    saved_training(folder)
    return (folder / STATE_FILE).read_bytes()


@pytest.fixture(autouse=True, scope='module')
def warm() -> None:
    """Compile and train before the first try, which would count as hung."""
    assert not refused(whole())
    go_on()


@functools.cache
def trainer() -> Any:  # noqa: ANN401 - a Trainer
    """One that takes in every checkpoint that is not refused: to make another takes longer."""
    return new_trainer()


def refused(content: bytes) -> bool:
    """Whether a checkpoint is refused; if so, as people can read it, and left as it is."""
    folder = memory_folder('checkpoint') / 'tried'
    folder.mkdir(exist_ok=True)
    file = folder / STATE_FILE
    file.write_bytes(content)
    try:
        trainer().load(folder)
    except CheckpointError as error:
        check_lines(str(error).splitlines(), names=str(file))
        assert str(error).count('\n') == 0
        return True
    finally:
        assert file.read_bytes() == content
        assert [path.name for path in folder.iterdir()] == [STATE_FILE]
    return False


@fuzzed(
    share=0.45,
    flips=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(1, 255)), max_size=4),
    end=st.floats(0, 1) | st.just(1.0),
    more=st.binary(max_size=40),
    place=st.sampled_from([0, 24, 56, 64, 72]) | st.integers(0, 10**6),
    there=st.binary(max_size=12),
)
def test_bytes_that_were_changed_are_refused_and_the_others_go_on_alike(
    flips: list[tuple[float, int]], end: float, more: bytes, place: int, there: bytes
) -> None:
    content = bytearray(whole()[: round(end * len(whole()))])
    for share, mask in flips:
        if content:
            content[int(share * len(content))] ^= mask
    place = min(place, len(content))
    content[place : place + len(there)] = there
    changed = bytes(content) + more
    if refused(changed):
        assert changed != whole()
    else:
        assert changed == whole()
        assert checkpoint_bytes(trainer().state()) == whole()


@fuzzed(
    share=0.2,
    edits=st.lists(
        st.tuples(st.floats(0, 1, exclude_max=True), st.binary(max_size=6)), min_size=1, max_size=3
    ),
    sizes=st.none() | st.binary(min_size=16, max_size=16),
)
def test_a_head_that_was_edited_under_a_digest_of_its_own_is_refused_or_holds_numbers(
    edits: list[tuple[float, bytes]], sizes: bytes | None
) -> None:
    n_head = int.from_bytes(whole()[64:72], 'little')
    head = bytearray(whole()[_HEAD : _HEAD + n_head])
    for share, new in edits:
        place = int(share * len(head))
        head[place : place + len(new)] = new
    data = whole()[_HEAD + n_head :]
    true_sizes = b''.join(
        each.to_bytes(8, 'little') for each in (_HEAD + len(head) + len(data), len(head))
    )
    if not refused(forged(whole()[:56] + (sizes or true_sizes) + bytes(head) + data)):
        go_on()


def go_on() -> None:
    """Learn and fly from a state that was taken in; numbers may be beyond what floats hold."""
    one = trainer()
    task = one._tasks[0]
    with np.errstate(all='ignore'):
        n_missions = one.config.replay.missions_per_batch
        batch = task.minibatch(n_missions, one.config, one.algorithm, np.random.default_rng(0))
        one._learner.loss(batch)
        task.source.collect(one._learner.networks.agent, 4, 0.5)
        checkpoint_bytes(one.state())


def leaves(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:  # noqa: ANN401
    """The paths of all values, those that hold others among them."""
    pairs: Any = ()
    if isinstance(value, dict):
        pairs = value.items()
    elif isinstance(value, list):
        pairs = enumerate(value)
    below = [way for key, each in pairs for way in leaves(each, (*path, key))]
    return [path, *below] if path else below


@functools.cache
def state_and_paths() -> tuple[dict[str, Any], list[tuple[Any, ...]]]:
    state = checkpoint_from_bytes(whole())
    return state, leaves(state)


def with_number(array: Any, index: int, number: Any) -> Any:  # noqa: ANN401
    """The array with another number at a place, as far as its type holds it."""
    changed = array.copy().reshape(-1)
    if changed.size:
        with np.errstate(all='ignore'):
            if changed.dtype.kind == 'f':
                changed[index % changed.size] = number
            else:
                limits = np.iinfo(changed.dtype)
                finite = 0 if number != number else min(max(number, limits.min), limits.max)
                changed[index % changed.size] = int(finite)
    return changed.reshape(array.shape)


def changed_array(draw: Callable[[Any], Any], array: Any) -> Any:  # noqa: ANN401
    match draw(st.sampled_from(['number', 'type', 'shorter', 'longer', 'shape', 'value'])):
        case 'number':
            return with_number(array, draw(st.integers(0, 10**6)), draw(_numbers))
        case 'type':
            with np.errstate(all='ignore'):
                return array.astype(draw(st.sampled_from(_TYPES)))
        case 'shorter':
            return array[: max(0, len(array) - 1)] if array.ndim else array.reshape(1)
        case 'longer':
            return np.concatenate([array, array]) if array.ndim else array.reshape(1, 1)
        case 'shape':
            return array.reshape(-1)
        case _:
            return draw(_values)


@st.composite
def changes(draw: Callable[[Any], Any]) -> dict[str, Any]:
    """The state with one or two values of it changed, removed, added or put elsewhere."""
    original, paths = state_and_paths()
    state = deepcopy(original)
    for _ in range(draw(st.integers(1, 2))):
        path = draw(st.sampled_from(paths))
        holder: Any = state
        try:
            for key in path[:-1]:
                holder = holder[key]
            value = holder[path[-1]]
        except (LookupError, TypeError):
            continue  # the first change took it
        match draw(st.sampled_from(['change', 'change', 'remove', 'add', 'other'])):
            case 'remove':
                del holder[path[-1]]
            case 'add' if isinstance(holder, dict):
                holder[draw(st.text(max_size=5))] = draw(_values)
            case 'other':
                source: Any = original
                for key in draw(st.sampled_from(paths)):
                    source = source[key]
                holder[path[-1]] = source
            case _:
                is_array = isinstance(value, np.ndarray)
                holder[path[-1]] = changed_array(draw, value) if is_array else draw(_values)
    return state


@fuzzed(share=0.15, state=st.deferred(changes))
def test_values_that_were_forged_are_refused_or_are_such_as_trainings_have(
    state: dict[str, Any],
) -> None:
    try:
        content = checkpoint_bytes(state)
    except (UnicodeEncodeError, ValueError):  # surrogates, digits: no JSON
        return
    if not refused(content):
        go_on()


@functools.cache
def run_files() -> dict[str, bytes]:
    """The files of a run folder, without those of the trainer."""
    scenario, config = tiny(), load_preset('strong')
    record = new_record(
        [scenario], config, None, training='run', algorithm='aqmix', overrides=(), seed=0,
        minutes=None, decisions=1000, device='cpu', seeds=(0,),
    )  # fmt: skip
    tables = {
        name: '\n'.join([','.join(columns), *[','.join(['1'] * len(columns))] * 3, '']).encode()
        for name, columns in _TABLES.items()
    }
    return {
        RUN_FILE: record.to_json(),
        'scenario.yaml': scenario.to_yaml().encode(),
        CONFIG_FILE: config.to_yaml().encode(),
        **tables,
    }


@st.composite
def tampered(draw: Callable[[Any], Any]) -> tuple[str, bytes | None]:
    """A file of a run, and what it holds then; None: it is gone."""
    name = draw(st.sampled_from([*run_files()]))
    content = run_files()[name]
    match draw(st.sampled_from(['bytes', 'field', 'lines', 'gone', 'other'])):
        case 'gone':
            return name, None
        case 'other':
            return name, run_files()[draw(st.sampled_from([*run_files()]))]
        case 'field' if name == RUN_FILE:
            values = json.loads(content)
            values[draw(st.sampled_from([*values]))] = draw(_values)
            return name, json.dumps(values).encode()
        case 'lines':
            lines = content.split(b'\n')
            chosen = draw(st.lists(st.sampled_from(lines), max_size=len(lines)))
            return name, b'\n'.join(chosen)
        case _:
            place = draw(st.integers(0, len(content)))
            new = draw(st.binary(max_size=8) | _values.map(lambda it: repr(it).encode()))
            return name, content[:place] + new + content[place + draw(st.integers(0, 8)) :]


@fuzzed(share=0.2, change=st.deferred(tampered))
def test_a_run_folder_that_was_tampered_with_is_refused_or_is_the_same_run(
    change: tuple[str, bytes | None],
) -> None:
    name, content = change
    folder = memory_folder('checkpoint') / 'run'
    folder.mkdir(exist_ok=True)
    files = {**run_files(), name: content}
    for each, held in files.items():
        (folder / each).unlink(missing_ok=True)
        if held is not None:
            (folder / each).write_bytes(held)
    try:
        run = stored_run(folder, read_run(folder))
        for table, columns in _TABLES.items():
            read_rows(folder / table, columns)
    except (UavCollectError, FileNotFoundError) as error:
        check_lines(str(error).splitlines(), names=str(folder))
        return
    assert run.scenarios[0].as_mapping() == tiny().as_mapping()
    assert run.config.fingerprint == load_preset('strong').fingerprint
    assert run.record.seed in run.record.seeds
    assert (run.folder / CHECKPOINT).parent == folder

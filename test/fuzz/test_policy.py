"""Policies: files whose head, texts, tensors or bytes were changed, and functions of users.

A file is read as what it says, to the last weight, or refused in a line that says what is wrong of
it; of today's format no byte changes unnoticed. A function's answer is a legal action, or the
mission ends with a line about it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
import functools
import hashlib
import json
from pathlib import Path
import re
import tempfile
from typing import Any, NoReturn

from fuzzing import check_lines, check_outcome, fuzzed, memory_folder, run_command
from hypothesis import strategies as st
import numpy as np
from random_policies import header, random_policy
from tiny_world import tiny
from uav_collect.errors import PolicyMismatchError
from uav_collect.uav.action_codes import HOME, NONE
from uav_collect.uav.belief import belief_of, new_beliefs
from uav_collect.uav.briefing import brief
from uav_collect.uav.learned_on import learned_on, strangeness
from uav_collect.uav.observation import Layout, observation_size
from uav_collect.uav.policy_file import (
    FORMAT,
    policy_bytes,
    policy_from_bytes,
    WEIGHTS_FORMAT,
)
from uav_collect.uav.policy_network import FrozenPolicy
from uav_collect.uav.user_policy import policy_of
from uav_collect.uav.view import LocalView

SCENARIO = tiny()
FIELD = tiny(fleet__default__energy_budget_kj=5.0, name='field').to_yaml()
SMALL = random_policy(
    header(Layout.PAPER, side=4, hidden_size=1, learned_on=(learned_on(SCENARIO),))
)
WHOLE = policy_bytes(SMALL)
HEAD_BYTE = int.from_bytes(WHOLE[:8], 'little')
HEAD: Mapping[str, Any] = json.loads(WHOLE[8 : 8 + HEAD_BYTE])
DATA = WHOLE[8 + HEAD_BYTE :]
TEXTS: Mapping[str, str] = HEAD['__metadata__']
TENSORS = sorted(HEAD.keys() - {'__metadata__'})
ZEROS = '0' * 64
REASONS = (': must be ', ' is missing', ' is unknown', 'is not a whole safetensors file (')

# What stands where something else should: numbers at and beyond their ranges, other types.
WHOLE_NUMBERS = st.one_of(
    st.integers(-2, 70),
    st.sampled_from([437, 4096, 4097, 2**31, 2**32, 2**63 - 1, 2**63, 2**64]),
    st.sampled_from([30, 400]).map(lambda digits: 10**digits),
)
NUMBERS = st.one_of(
    WHOLE_NUMBERS, st.floats(), st.sampled_from([0.0, -0.0, 5e-324, 1.0 + 1e-15, 1e12, 1.7e308])
)
WORDS = st.one_of(
    st.sampled_from(['', ' ', '007', '٣', '1_0', '+1', '1e3', '0x1']),
    st.sampled_from(['9', 'x']).map(lambda character: character * 100_000),
    st.sampled_from(
        ['[/b]', '../..', 'a\nb', '\x1b[31m', '\ud800', '"digest":"0"', 'egocentric/2']
    ),
    st.text(max_size=20),
    WHOLE_NUMBERS.map(str),
)
VALUES = st.recursive(
    st.one_of(st.none(), st.booleans(), NUMBERS, WORDS),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4), st.dictionaries(WORDS, inner, max_size=3)
    ),
    max_leaves=6,
)


@dataclass
class Forgery:
    """A file on its way to be written, and what is to be done to its bytes."""

    head: dict[str, Any]
    texts: dict[str, str]
    data: bytes
    is_sealed: bool = True  # with the digest that its content asks for
    write: Callable[[dict[str, Any]], bytes] = lambda head: json.dumps(head).encode(
        errors='surrogatepass'
    )
    length: Callable[[int], int] = lambda length: length

    def content(self) -> bytes:
        """The bytes of the file."""
        head = {**self.head, '__metadata__': self.texts} if self.texts else self.head
        text = self.write(head).replace(b'"digest": "', b'"digest":"')
        content = max(0, self.length(len(text))).to_bytes(9, 'little')[:8] + text + self.data
        if not self.is_sealed:
            return content
        if self.texts.get('format') == FORMAT:
            digest = hashlib.sha256(content).hexdigest()
        else:  # of the weights, which lie in the order of their names
            digest = hashlib.sha256(self.data).hexdigest()
        return content.replace(ZEROS.encode(), digest.encode(), 1)


Change = Callable[[Forgery], None]

# What files of before do not say.
SAID_SINCE = {'learned_on', 'learned_within', 'advice_bonus', 'network', 'code', 'domains'}


def set_text(name: str, text: str, it: Forgery) -> None:
    it.texts[name] = text


def drop_text(name: str, it: Forgery) -> None:
    it.texts.pop(name, None)


def set_json(name: str, value: object, it: Forgery) -> None:
    """All that a text holds as JSON."""
    it.texts[name] = json.dumps(value)


def change_json(keys: tuple[Any, ...], value: object, it: Forgery) -> None:
    """A value within the JSON of a text: its name comes first."""
    name, *path, last = keys
    whole = json.loads(TEXTS[name])
    place = whole
    for key in path:
        place = place[key]
    place[last] = value
    it.texts[name] = json.dumps(whole)


def set_entry(name: str, key: str, value: object, it: Forgery) -> None:
    """What the head says of a tensor."""
    it.head[name] = {**HEAD[name], key: value}


def set_tensor(name: str, entry: object, it: Forgery) -> None:
    it.head[name] = entry


def add_tensor(name: str, length: int, it: Forgery) -> None:
    """A tensor behind the others, whether there are bytes for it or not."""
    end = len(DATA)
    it.head[name] = {'dtype': 'F32', 'shape': [length], 'data_offsets': [end, end + 4 * length]}


def drop_tensor(name: str, it: Forgery) -> None:
    it.head.pop(name, None)


def set_weight(place: int, value: float, it: Forgery) -> None:
    at = place % (len(DATA) // 4) * 4
    it.data = it.data[:at] + np.float32(value).tobytes() + it.data[at + 4 :]


def cut_data(length: int, it: Forgery) -> None:
    it.data = it.data[length:]


def append_data(more: bytes, it: Forgery) -> None:
    it.data += more


def shift_length(more: int, it: Forgery) -> None:
    """What the file says of its head's length."""
    it.length = lambda length: length + more


def say_twice(name: str, it: Forgery) -> None:
    """A key of the head, or of its texts, once more."""

    def write(head: dict[str, Any]) -> bytes:
        values = head if name in head else head.get('__metadata__', {})
        double = json.dumps({name: values.get(name, '')})[1:-1]
        return json.dumps(head).replace(f'"{name}"', f'{double}, "{name}"', 1).encode()

    it.write = write


def encode_otherwise(encoding: str, it: Forgery) -> None:
    it.write = lambda head: json.dumps(head).encode(encoding)


def write_instead(part: bytes, times: int, it: Forgery) -> None:
    it.write = lambda head: part * times


def say_no_texts(value: object, it: Forgery) -> None:
    it.write = lambda head: json.dumps({**head, '__metadata__': value}).encode()


def keep_digest(it: Forgery) -> None:
    it.is_sealed = False


def made(change: Callable[..., None], *arguments: st.SearchStrategy[Any]) -> Any:  # noqa: ANN401
    """Changes with drawn arguments; a failure shows them."""
    return st.tuples(*arguments).map(lambda drawn: functools.partial(change, *drawn))


LEARNED_KEYS = [*sorted(json.loads(TEXTS['learned_on'])[0]), 'more']
VALIDATION_KEYS = [*sorted(json.loads(TEXTS['validation'])), 'more']
NAMES = st.sampled_from(sorted(TEXTS))
TENSOR_NAMES = st.sampled_from(TENSORS)
SPANS = st.one_of(VALUES, st.lists(NUMBERS, max_size=3), st.lists(st.lists(NUMBERS), max_size=3))
WEIGHTS = st.one_of(st.floats(width=32), st.sampled_from([np.nan, np.inf, -np.inf, 3.4e38]))
TEXT_CHANGES: st.SearchStrategy[Change] = st.one_of(
    made(set_text, NAMES, WORDS),
    made(drop_text, NAMES),
    made(set_json, st.sampled_from(['validation', 'learned_on']), VALUES),
    made(
        change_json,
        st.sampled_from(VALIDATION_KEYS).map(lambda key: ('validation', key)),
        VALUES,
    ),
    made(
        change_json,
        st.sampled_from(LEARNED_KEYS).map(lambda key: ('learned_on', 0, key)),
        SPANS,
    ),
    made(set_weight, st.integers(0, 10**6), WEIGHTS),
)
LAYOUT_CHANGES: st.SearchStrategy[Change] = st.one_of(
    made(
        set_entry,
        TENSOR_NAMES,
        st.sampled_from(['dtype', 'shape', 'data_offsets', 'more']),
        st.one_of(VALUES, st.lists(WHOLE_NUMBERS, max_size=9), st.sampled_from(['F64', 'BOOL'])),
    ),
    made(set_tensor, st.one_of(TENSOR_NAMES, WORDS), VALUES),
    made(add_tensor, WORDS, WHOLE_NUMBERS),
    made(drop_tensor, TENSOR_NAMES),
    made(append_data, st.binary(max_size=9)),
    made(cut_data, st.integers(0, 99)),
    made(
        shift_length,
        st.one_of(st.integers(-9, 9), st.sampled_from([-(10**6), 10**6, 2**32, 2**63])),
    ),
    made(say_twice, st.one_of(TENSOR_NAMES, NAMES)),
    made(encode_otherwise, st.sampled_from(['utf-16', 'utf-32', 'utf-8-sig', 'utf-7'])),
    made(
        write_instead,
        st.sampled_from([b'', b'{', b'[', b'{"a":', b'null', b'9']),
        st.sampled_from([1, 9999, 99_999]),
    ),
    made(say_no_texts, VALUES),
    made(keep_digest),
    made(set_text, st.just('format'), st.just(WEIGHTS_FORMAT)),
)
# Most changes leave a whole safetensors file.
CHANGES = st.lists(
    st.sampled_from([TEXT_CHANGES, TEXT_CHANGES, LAYOUT_CHANGES]).flatmap(lambda changes: changes),
    min_size=1,
    max_size=2,
)


def forged(changes: list[Change]) -> bytes:
    """The small policy's file after changes."""
    head = {name: entry for name, entry in HEAD.items() if name != '__metadata__'}
    forgery = Forgery(head=head, texts={**TEXTS, 'digest': ZEROS}, data=DATA)
    for change in changes:
        change(forgery)
    return forgery.content()


@fuzzed(share=0.52, changes=CHANGES)
def test_a_forged_file_is_read_as_what_it_says_or_refused(changes: list[Change]) -> None:
    content = forged(changes)
    try:
        policy = policy_from_bytes(content)
    except PolicyMismatchError as error:
        check_refusal(error)
        return
    check_meaning(policy, content)


@fuzzed(
    share=0.25,
    place=st.floats(0, 1, exclude_max=True),
    new=st.one_of(st.binary(min_size=1, max_size=4), st.integers(0, 7).map(lambda n: 1 << n)),
)
def test_bytes_that_change_anywhere_in_a_file_are_noticed(place: float, new: bytes | int) -> None:
    at = int(place * len(WHOLE))
    changed = bytes([WHOLE[at] ^ new]) if isinstance(new, int) else new
    content = WHOLE[:at] + changed + WHOLE[at + len(changed) :]
    if content != WHOLE:
        check_refused(content)


@fuzzed(
    share=0.1,
    start=st.integers(0, len(WHOLE)),
    end=st.integers(0, len(WHOLE)),
    more=st.binary(max_size=20),
)
def test_a_file_that_lacks_a_part_or_has_more_is_refused(
    start: int, end: int, more: bytes
) -> None:
    content = WHOLE[:start] + more + WHOLE[end:]
    if content != WHOLE:
        check_refused(content)


@fuzzed(share=0.03, changes=CHANGES)
def test_a_command_flies_a_forged_file_or_refuses_it_by_its_name(changes: list[Change]) -> None:
    with tempfile.TemporaryDirectory(dir=memory_folder('policy')) as name:
        folder = Path(name)
        (folder / 'forged.safetensors').write_bytes(forged(changes))
        (folder / 'field.yaml').write_text(FIELD)
        outcome = run_command(
            'evaluate', '--scenario', folder / 'field.yaml', '--missions', 1,
            '--policy', folder / 'forged.safetensors',
        )  # fmt: skip
        check_outcome(outcome, names='forged')


def check_refused(content: bytes) -> None:
    """Hold a file to be refused."""
    try:
        policy_from_bytes(content)
    except PolicyMismatchError as error:
        check_refusal(error)
    else:
        raise AssertionError(content)


def check_refusal(error: PolicyMismatchError) -> None:
    """Hold a refusal to a line that says what is wrong."""
    check_lines([str(error)])
    assert any(reason in str(error) for reason in REASONS), error


def check_meaning(policy: FrozenPolicy, content: bytes) -> None:
    """Hold a policy to what its file says, and to be of use."""
    head_byte = int.from_bytes(content[:8], 'little')
    head = json.loads(content[8 : 8 + head_byte])
    texts = head.pop('__metadata__')
    for field in fields(policy.header):
        value = getattr(policy.header, field.name)
        if field.name not in texts:
            assert field.name in SAID_SINCE, texts
            assert value == field.default
        elif isinstance(value, str):
            assert value == texts[field.name]
        elif isinstance(value, Layout):
            assert value.label == texts[field.name]
        elif isinstance(value, int):
            assert value == int(texts[field.name])
        else:
            check_record(value, json.loads(texts[field.name]))
    of = policy.header
    for side, n_uavs in (
        (of.cells_per_side_min, of.n_uavs_min),
        (of.cells_per_side_max, of.n_uavs_max),
    ):
        assert 1 <= side <= 64
        assert 1 <= n_uavs <= 64
        assert observation_size(of.layout, side * side, n_uavs) == of.observation_size
    by_place = sorted(head, key=lambda name: head[name]['data_offsets'])
    weights = b''.join(policy.weights[name].tobytes() for name in by_place)
    assert weights == content[8 + head_byte :]
    again = policy_from_bytes(policy_bytes(policy))
    assert again.header == policy.header
    assert again.digest == policy.digest
    check_use(policy)


def check_record(value: Any, said: Any) -> None:  # noqa: ANN401 - a record, or a part of one
    """Hold a record to the JSON that it was read from."""
    if isinstance(value, tuple):
        assert len(value) == len(said)
        for each, of in zip(value, said, strict=True):
            check_record(each, of)
    elif isinstance(said, dict):
        for name, of in said.items():
            check_record(getattr(value, name), of)
    else:
        assert value == said
        assert not isinstance(said, bool)


def check_use(policy: FrozenPolicy) -> None:
    """Hold a policy to values that are numbers, and to differences that can be told."""
    observed = np.ones((1, policy.header.observation_size))
    values, hidden = policy.step(observed, policy.new_hidden(1))
    assert np.isfinite(values).all()
    assert np.isfinite(hidden).all()
    policy.header.misfit(brief(SCENARIO))
    for line in strangeness(policy.header.learned_on, SCENARIO):
        assert line.isprintable()
        assert 'nan' not in line


# Functions of users.


class _Raises:
    """Raises whatever is done with it."""

    def __init__(self, error: BaseException) -> None:
        self._error = error

    def _fail(self, *_: object) -> NoReturn:
        raise self._error

    __call__ = __index__ = __repr__ = __str__ = __eq__ = __lt__ = __len__ = __iter__ = _fail
    __hash__ = None  # type: ignore[assignment]


ERRORS = st.builds(
    lambda kind, arguments: kind(*arguments),
    st.sampled_from(
        [
            SystemExit, KeyboardInterrupt, GeneratorExit, Exception, ValueError, KeyError, OSError,
            StopIteration, RecursionError, MemoryError, AssertionError, Warning, ArithmeticError,
        ]
    ),
    st.lists(st.one_of(WORDS, WHOLE_NUMBERS), max_size=2),
)  # fmt: skip
ANSWERS: st.SearchStrategy[Any] = st.one_of(
    WHOLE_NUMBERS,
    NUMBERS,
    WORDS,
    st.none(),
    st.booleans(),
    st.binary(max_size=5),
    st.complex_numbers(),
    st.integers(0, 6).map(np.int8),
    st.integers(0, 6).map(np.uint64),
    st.integers(0, 6).map(np.array),
    st.integers(0, 6).map(lambda number: np.array([number])),
    st.floats(0, 6).map(np.float32),
    st.builds(lambda: np.True_),
    st.builds(object),
    st.builds(lambda: (each for each in (1,))),
)
WAYS: Mapping[str, Callable[[Any, BaseException], Any]] = {
    'returns': lambda answer, _: answer,
    'raises': lambda _, error: _Raises(error)(),
    'returns what raises': lambda _, error: _Raises(error),
    'returns a list of it': lambda _, error: [_Raises(error)],
    'raises what raises': lambda _, error: _Raises(ValueError(_Raises(error)))(),
}
BRIEFING = brief(SCENARIO)
VIEW = LocalView(
    time_s=0.0, x_m=25.0, y_m=25.0, cell=0, energy_left_j=1e6, previous_action=NONE,
    region_bit=[0.0] * 9, n_sensors=0, sensor=[], sensor_bit=[], sensor_gain=[],
    sensor_error_gain=[],
)  # fmt: skip
LEGAL = [1, 1, 1, 0, 0]


@fuzzed(share=0.1, way=st.sampled_from(sorted(WAYS)), answer=ANSWERS, error=ERRORS)
def test_a_function_of_a_user_takes_a_legal_action_or_costs_a_line(
    way: str,
    answer: Any,  # noqa: ANN401
    error: BaseException,
) -> None:
    def decide(situation: object) -> object:
        return WAYS[way](answer, error)

    policy = policy_of(decide)
    policy.begin(BRIEFING, 0)
    try:
        action = policy.choose(belief_of(new_beliefs(BRIEFING, 1), 0), VIEW, LEGAL)
    except PolicyMismatchError as refusal:
        check_lines([str(refusal)], names='policy decide: UAV 1 at 0.0 s in cell 0: ')
        assert re.search(r'[(]test_policy.py, line [0-9]+[)]$', str(refusal))
        return
    assert way == 'returns'
    assert type(action) is int
    assert action == HOME or LEGAL[action] == 1
    assert action == int(answer)

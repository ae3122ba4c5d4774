"""Policy files with a changed head, texts or tensors, mostly under a digest that is right."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
import functools
import hashlib
import json
from typing import Any

from hypothesis import strategies as st
import numpy as np
from random_policies import header, random_policy, random_weights
from tiny_world import tiny
from uav_collect.uav.learned_on import learned_on
from uav_collect.uav.observation import Layout
from uav_collect.uav.operating_domain import OperatingDomain
from uav_collect.uav.policy_file import FORMAT, policy_bytes, WEIGHTS_FORMAT
from uav_collect.uav.policy_network import FrozenPolicy

SCENARIO = tiny()
SMALL = random_policy(
    header(Layout.PAPER, side=4, hidden_size=1, learned_on=(learned_on(SCENARIO),))
)
WHOLE = policy_bytes(SMALL)
# Flies any field, by itself within its domains alone.
ADVISER = header(
    Layout.RELATIVE, side=1, n_uavs=1, hidden_size=1, cells_per_side_max=64,
    n_uavs_max=16, advice_bonus=0.02, domains=(OperatingDomain(n_uavs=(1, 4)),),
)  # fmt: skip
ADVISED = policy_bytes(random_policy(ADVISER))
# The same with two networks.
JOINT = policy_bytes(
    FrozenPolicy(
        replace(ADVISER, domains=tuple(OperatingDomain(network=number) for number in (1, 2))),
        {
            f'{number}/{name}': tensor
            for number in (1, 2)
            for name, tensor in random_weights(ADVISER, seed=number).items()
        },
    )
)


def head_and_data(content: bytes) -> tuple[dict[str, Any], bytes]:
    """The two parts of a policy's file."""
    head_byte = int.from_bytes(content[:8], 'little')
    return json.loads(content[8 : 8 + head_byte]), content[8 + head_byte :]


HEAD, DATA = head_and_data(WHOLE)
TEXTS: Mapping[str, str] = HEAD['__metadata__']
TENSORS = sorted(HEAD.keys() - {'__metadata__'})
ZEROS = '0' * 64

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
TRUE_SPANS = st.one_of(
    *(st.lists(each, min_size=2, max_size=2).map(sorted) for each in
      (st.integers(1, 64), st.floats(1, 64), st.floats(0, 1)))
)  # fmt: skip
DOMAIN_KEYS = st.sampled_from([field.name for field in fields(OperatingDomain)])
DOMAINS = st.one_of(
    st.lists(st.fixed_dictionaries({'network': st.integers(-1, 9)}), min_size=1, max_size=3),
    st.lists(st.dictionaries(DOMAIN_KEYS, TRUE_SPANS, max_size=2), max_size=18),
    st.lists(
        st.dictionaries(st.one_of(DOMAIN_KEYS, WORDS), st.one_of(SPANS, TRUE_SPANS)), max_size=3
    ),
    VALUES,
)
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


def forged(changes: list[Change], content: bytes = WHOLE) -> bytes:
    """A policy's file after changes."""
    head, data = head_and_data(content)
    texts = {**head.pop('__metadata__'), 'digest': ZEROS}
    forgery = Forgery(head=head, texts=texts, data=data)
    for change in changes:
        change(forgery)
    return forgery.content()

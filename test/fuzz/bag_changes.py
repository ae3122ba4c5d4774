"""What befalls the records and messages of MCAP files."""

from contextlib import suppress
from functools import cache
import json
import struct
from typing import Any, NamedTuple
from zlib import crc32

from backports import zstd
from bags import definition_text
from byte_changes import BYTE_CHANGES, ByteChange, changed_bytes
from hypothesis import strategies as st
import numpy as np
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
from rosbags.typesys.store import Typestore
from uav_collect.recording.mcap_records import channel_of, chunk_of, schema_of

MAGIC = b'\x89MCAP0\r\n'
HEAD = struct.Struct('<BQ')
MESSAGE_HEAD = struct.Struct('<HIQQ')
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 1, 2, 3, 4, 5, 6
DATA_END = 0x0F
NUMBERS = st.one_of(
    st.integers(-(2**63), 2**64 - 1),
    st.sampled_from([0, 1, 2, 3, 63, 64, 65, 255, 2**31, 2**32 - 1, 2**53]),
)
FLOATS = st.one_of(st.floats(), st.sampled_from([0.0, -1.0, 1e18, 1e308, 5e-324]))
TEXTS = st.one_of(
    st.text(st.characters(exclude_categories=['Cs']), max_size=30),
    st.sampled_from(['', 'x' * 5_000, '\x1b[31m', '[/b]', '{}', '[' * 5_000, 'a: &a [*a]', '~']),
)
WORDS = (
    *(
        'int64',
        'uint8',
        'float64',
        'string',
        'event',
        'time_s',
        'mission',
        'epoch',
        'world',
        'cdr',
    ),
    *('uav_collect_msgs', 'Mission', 'Epoch', 'ros2msg', 'heard', 'terminal', 'uav', 'scenario'),
)  # of types and channels
SHARES = st.floats(0.0, 1.0, exclude_max=True)


class Record(NamedTuple):
    """A record of an MCAP file."""

    kind: int
    body: bytes


def inner_records(content: bytes) -> list[Record]:
    """The types, channels and messages of a file."""
    inner = []
    for kind, body in records_of(content[len(MAGIC) :]):
        if kind == CHUNK:
            inner += records_of(zstd.decompress(chunk_of(body).packed))
    return inner


def records_of(content: bytes) -> list[Record]:
    """The records of bytes, up to a footer or their end."""
    records, at = [], 0
    while at < len(content):
        kind, length = HEAD.unpack_from(content, at)
        at += HEAD.size
        records.append(Record(kind, content[at : at + length]))
        at += length
        if kind == FOOTER:
            break
    return records


@cache
def types() -> Typestore:
    """The types of the bag's messages."""
    store = get_typestore(Stores.EMPTY)
    names = (
        *('Seal', 'UavFigures', 'Scenario', 'Mission', 'Epoch', 'RadioMessage'),
        *('Observation', 'Command', 'Transition'),
    )
    parts = ['builtin_interfaces/msg/Time', *(f'uav_collect_msgs/msg/{name}' for name in names)]
    for name in parts:
        store.register(get_types_from_msg(definition_text(name), name))
    return store


def packed(records: list[Record]) -> bytes:
    """An MCAP file of one chunk, with checksums that fit, and without a summary."""
    inner = b''.join(HEAD.pack(it.kind, len(it.body)) + it.body for it in records)
    times = [it.body[6:14] for it in records if it.kind == MESSAGE and len(it.body) >= 14]
    span = [int.from_bytes(it, 'little') for it in times] or [0]
    head = struct.pack('<QQQII', min(span), max(span), len(inner), crc32(inner), 0)
    chunk = head + struct.pack('<Q', len(inner)) + inner
    header = b'\4\0\0\0ros2\4\0\0\0fuzz'
    data = MAGIC + HEAD.pack(HEADER, len(header)) + header + HEAD.pack(CHUNK, len(chunk)) + chunk
    data += HEAD.pack(DATA_END, 4) + struct.pack('<I', crc32(data))
    footer = HEAD.pack(FOOTER, 20) + bytes(16)
    return data + footer + struct.pack('<I', crc32(footer)) + MAGIC


class RecordChange(NamedTuple):
    """What befalls records."""

    what: str
    share: float  # of them that lies before
    other_share: float
    kind: int
    bytes: list[ByteChange]
    words: tuple[str, str]  # one and what takes its place
    head: tuple[int, int, int, int]  # of a message

    def made(self, records: list[Record]) -> None:
        """Change a list of records."""
        if not records:
            return
        at, other = (int(share * len(records)) for share in (self.share, self.other_share))
        record = records[at]
        match self.what:
            case 'drop':
                del records[at]
            case 'double':
                records.insert(other, record)
            case 'move':
                records.insert(other, records.pop(at))
            case 'kind':
                records[at] = record._replace(kind=self.kind)
            case 'body':
                records[at] = record._replace(body=changed_bytes(record.body, self.bytes))
            case 'words':
                old, new = (word.encode() for word in self.words)
                new = new.ljust(len(old), b'_')[: len(old)]  # all stays readable
                records[at] = record._replace(
                    body=record.body.replace(old, new, self.kind % 3 + 1)
                )
            case 'head' if record.kind == MESSAGE:
                bits = (16, 32, 64, 64)
                head = [it % 2**n_bits for it, n_bits in zip(self.head, bits, strict=True)]
                body = MESSAGE_HEAD.pack(*head) + record.body[MESSAGE_HEAD.size :]
                records[at] = record._replace(body=body)


def record_changes(*kinds: str) -> st.SearchStrategy[list[RecordChange]]:
    """Some changes of these kinds."""
    change = st.builds(
        RecordChange,
        what=st.sampled_from(kinds),
        share=SHARES,
        other_share=SHARES,
        kind=st.integers(0, 255),
        bytes=BYTE_CHANGES,
        words=st.tuples(st.sampled_from(WORDS), st.sampled_from(WORDS)),
        head=st.tuples(st.integers(0, 9), NUMBERS, NUMBERS, NUMBERS),
    )
    return st.lists(change, min_size=1, max_size=3)


class FieldChange(NamedTuple):
    """Another value of a field of a message, whatever its type."""

    share: float  # of the messages that lies before
    field_share: float  # of its fields
    number: int
    fraction: float
    text: str
    numbers: list[int]
    fractions: list[float]
    key_share: float  # of the keys of a header
    json: object

    def made(self, records: list[Record]) -> None:
        """Change a message."""
        places = [at for at, it in enumerate(records) if it.kind == MESSAGE]
        at = places[int(self.share * len(places))]
        head, content = records[at].body[:22], records[at].body[22:]
        schemas = dict(schema_of(it.body) for it in records if it.kind == SCHEMA)
        channels = dict(channel_of(it.body) for it in records if it.kind == CHANNEL)
        type_name = schemas[channels[int.from_bytes(head[:2], 'little')].schema].name
        message = types().deserialize_cdr(content, type_name)
        _, fields = types().fielddefs[type_name]
        name, (kind, what) = fields[int(self.field_share * len(fields))]
        setattr(message, name, self._value(kind.name, what, getattr(message, name)))
        content = bytes(types().serialize_cdr(message, type_name))
        records[at] = Record(MESSAGE, head + content)

    def _value(self, kind: str, what: Any, before: Any) -> Any:  # noqa: ANN401
        if kind == 'SEQUENCE' and isinstance(before, np.ndarray):
            if before.dtype.kind == 'f':
                with np.errstate(over='ignore'):
                    return np.array(self.fractions, np.float64).astype(before.dtype)
            return np.array([it % 2**64 for it in self.numbers], np.uint64).astype(before.dtype)
        if kind != 'BASE':
            return before
        if what[0] == 'string':
            return self._text(before)
        if what[0] == 'bool':
            return self.number % 2 == 1
        if what[0].startswith('float'):
            return self.fraction
        return int(np.array(self.number % 2**64, np.uint64).astype(what[0]))

    def _text(self, before: str) -> str:
        """A header of a log or a scenario a little changed, or another text."""
        with suppress(json.JSONDecodeError, RecursionError):
            values = json.loads(before if before.startswith('{"format"') else '')
            values[sorted(values)[int(self.key_share * len(values))]] = self.json
            return json.dumps(values)
        if len(before) > 100:
            at = int(self.key_share * len(before))
            return before[:at] + self.text[:3] + before[at + 1 :]
        return self.text


FIELD_CHANGES = st.lists(
    st.builds(
        FieldChange,
        share=SHARES,
        field_share=SHARES,
        number=NUMBERS,
        fraction=FLOATS,
        text=TEXTS,
        numbers=st.lists(NUMBERS, max_size=6),
        fractions=st.lists(FLOATS, max_size=6),
        key_share=SHARES,
        json=st.one_of(NUMBERS, FLOATS, TEXTS, st.none(), st.just([]), st.just([{}])),
    ),
    min_size=1,
    max_size=3,
)

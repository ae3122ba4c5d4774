"""Bags: what `report` makes of those that a disk, a program or a liar has changed.

A bag of one small mission is made once. Its file is changed by bytes and by records, with and
without checksums that fit; its messages by field, its types by definition, its metadata by text.
"""

from functools import cache
import json
from pathlib import Path
import shutil
import struct
import tempfile
from typing import Any, NamedTuple
from zlib import crc32

from bag_damage import copied
from bags import definition_text, HandMadeBag
from byte_changes import BYTE_CHANGES, ByteChange, changed_bytes
from fuzzing import check_lines, fuzzed
from hypothesis import strategies as st
import numpy as np
from rosbags.rosbag2.storage_mcap import zstd  # type: ignore[attr-defined]
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
from rosbags.typesys.store import Typestore
from tiny_world import tiny, uav
from uav_collect.api import FlownMission
from uav_collect.errors import BagError
from uav_collect.missions.rollout import fly
from uav_collect.recording.bag_reader import read_recording, Recording
from uav_collect.recording.mission_log import from_jsonl
from uav_collect.scenario.site import build_site

MAGIC = b'\x89MCAP0\r\n'
HEAD = struct.Struct('<BQ')
MESSAGE_HEAD = struct.Struct('<HIQQ')
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 1, 2, 3, 4, 5, 6
DATA_END = 0x0F
FOLDER = Path(tempfile.mkdtemp(prefix='fuzz-bag-', dir='/dev/shm'))
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


class Made(NamedTuple):
    """What is changed: a bag, and what is right of it."""

    content: bytes  # of its file
    metadata: str
    records: tuple[Record, ...]  # types, channels and messages
    log: bytes
    n_radio_messages: int


@cache
def made() -> Made:
    """A bag of a mission of two UAVs."""
    site = build_site(tiny(uav(5.0), uav(10.0)))
    [log] = fly(site, [0], 'sweep')
    folder = FOLDER / 'made'
    bag = HandMadeBag(folder, chunk_byte=2_500, step_ns=1_000_000)
    bag.add_scenario(site)
    bag.add_mission(log, 'world-0', n_radio_messages=3)
    bag.writer.close()
    content = (folder / 'made.mcap').read_bytes()
    inner = []
    for kind, body in records_of(content[len(MAGIC) :]):
        if kind == CHUNK:
            *_, size, n_name = struct.unpack_from('<QII', body, 16)
            packed = body[32 + n_name + 8 :]
            del size
            inner += records_of(zstd.decompress(packed))
    shutil.copy(folder / 'made.mcap', FOLDER / 'bag.mcap')
    return Made(content, (folder / 'metadata.yaml').read_text(), tuple(inner), log.to_jsonl(), 3)


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
    names = ('Seal', 'UavFigures', 'Scenario', 'Mission', 'Epoch', 'RadioMessage')
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


def read(path: Path) -> Recording | None:
    """What `report` would show of a bag; None if it is refused."""
    try:
        recording = read_recording(path)
    except BagError as error:
        check_lines([str(error)], names=str(FOLDER))
        return None
    if recording.damages:
        check_lines(recording.damages[:20], names=str(FOLDER))
    for mission in recording.missions:
        if mission.is_complete and mission.log.to_jsonl() != made().log:
            flown = FlownMission(
                log=mission.log,
                site=mission.site,
                demand_bit=mission.demand_bit,
                n_radio_messages=mission.n_radio_messages,
            )
            assert 'nan' not in str(flown).split()
        if mission.is_complete:
            assert from_jsonl(mission.log.to_jsonl()).to_jsonl() == mission.log.to_jsonl()
    return recording


def check_unseen_is_equal(recording: Recording | None) -> None:
    """Hold a reading to what was recorded, unless it says that something is damaged."""
    if recording is None:
        return
    [mission] = recording.missions
    if mission.is_complete:
        assert mission.log.to_jsonl() == made().log
        assert mission.n_radio_messages == made().n_radio_messages
    else:
        assert recording.damages


def written(content: bytes) -> Path:
    """A file of a bag."""
    path = FOLDER / 'bag.mcap'
    path.write_bytes(content)
    return path


@fuzzed(share=0.3, changes=BYTE_CHANGES)
def test_bytes_of_a_file_with_checksums(changes: list[ByteChange]) -> None:
    check_unseen_is_equal(read(written(changed_bytes(made().content, changes))))


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


@fuzzed(
    share=0.15,
    changes=record_changes('drop', 'double', 'move', 'kind', 'body'),
    has_end=st.booleans(),
)
def test_records_of_a_file_with_checksums(changes: list[RecordChange], has_end: bool) -> None:
    records = records_of(made().content[len(MAGIC) :])
    for change in changes:
        change.made(records)
    inner = b''.join(HEAD.pack(it.kind, len(it.body)) + it.body for it in records)
    check_unseen_is_equal(read(written(MAGIC + inner + (MAGIC if has_end else b''))))


@fuzzed(share=0.2, changes=record_changes('drop', 'double', 'move', 'body', 'words', 'head'))
def test_forged_records_whose_checksums_fit(changes: list[RecordChange]) -> None:
    records = [*made().records]
    for change in changes:
        change.made(records)
    read(written(packed(records)))


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
        names = {1: 'Scenario', 2: 'Mission', 3: 'Epoch', 4: 'RadioMessage'}  # by channel
        type_name = f'uav_collect_msgs/msg/{names[int.from_bytes(head[:2], "little")]}'
        message = types().deserialize_cdr(content, type_name)
        _, fields = types().fielddefs[type_name]
        name, (kind, what) = fields[int(self.field_share * len(fields))]
        setattr(message, name, self._value(kind.name, what, getattr(message, name)))
        content = bytes(types().serialize_cdr(message, type_name))
        records[at] = Record(MESSAGE, head + content)

    def _value(self, kind: str, what: Any, before: Any) -> Any:  # noqa: ANN401
        if kind == 'SEQUENCE' and isinstance(before, np.ndarray):
            if before.dtype.kind == 'f':
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
        if before.startswith('{'):
            values = json.loads(before)
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


@fuzzed(share=0.2, changes=FIELD_CHANGES)
def test_forged_messages_whose_checksums_fit(changes: list[FieldChange]) -> None:
    records = [*made().records]
    for change in changes:
        change.made(records)
    read(written(packed(records)))


@fuzzed(
    share=0.1,
    line_share=SHARES,
    what=st.sampled_from(['value', 'drop', 'bytes']),
    value=st.one_of(NUMBERS.map(str), TEXTS, st.sampled_from(['sqlite3', 'message', '{}'])),
    changes=BYTE_CHANGES,
)
def test_metadata_of_a_bag_that_is_whole(
    line_share: float, what: str, value: str, changes: list[ByteChange]
) -> None:
    lines = made().metadata.splitlines(keepends=True)
    at = int(line_share * len(lines))
    metadata = made().metadata.encode()
    if what == 'value':
        lines[at] = f'{lines[at].partition(":")[0]}: {value}\n'
        metadata = ''.join(lines).encode()
    elif what == 'drop':
        metadata = ''.join(lines[:at] + lines[at + 3 :]).encode()
    else:
        metadata = changed_bytes(metadata, changes)
    folder = FOLDER / 'run'
    folder.mkdir(exist_ok=True)
    (folder / 'run.mcap').write_bytes(made().content)
    (folder / 'metadata.yaml').write_bytes(metadata)
    check_unseen_is_equal(read(folder))


@cache
def database() -> bytes:
    """The same bag as a database."""
    made()
    folder = copied(FOLDER / 'made', FOLDER / 'database')
    return (folder / 'database.db3').read_bytes()


@fuzzed(share=0.05, changes=BYTE_CHANGES)
def test_bytes_of_a_database(changes: list[ByteChange]) -> None:
    path = FOLDER / 'bag.db3'
    path.write_bytes(changed_bytes(database(), changes))
    read(path)

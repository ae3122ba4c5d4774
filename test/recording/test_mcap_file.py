"""MCAP files whose records contradict each other, or themselves, however many do."""

from binascii import crc32
from pathlib import Path
import struct
import tracemalloc

from bags import HandMadeBag
import lz4.frame
import pytest
from uav_collect.errors import BagError
from uav_collect.recording import mcap_file
from uav_collect.recording.mcap_file import read_mcap
from uav_collect.recording.mcap_records import (
    BrokenError,
    CHANNEL,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    HEADER,
    MAGIC,
    SCHEMA,
    STATISTICS,
    unpacked,
)

OTHER = 0x80  # a kind of records that no reader knows
N_FORGED = 20_000


def record(kind: int, body: bytes) -> bytes:
    return struct.pack('<BQ', kind, len(body)) + body


def text(words: str) -> bytes:
    return struct.pack('<I', len(words)) + words.encode()


def schema(number: int, name: str) -> bytes:
    return record(
        SCHEMA, struct.pack('<H', number) + text(name) + text('ros2msg') + text('int8 x')
    )


def channel(number: int, topic: str) -> bytes:
    body = struct.pack('<HH', number, 1) + text(topic) + text('cdr') + struct.pack('<I', 0)
    return record(CHANNEL, body)


def written(file: Path, data: bytes, summary: bytes = b'') -> Path:
    """A file of some records, with checksums that fit."""
    data = MAGIC + record(HEADER, text('ros2') + text('forger')) + data
    data += record(DATA_END, struct.pack('<I', crc32(data)))
    footer = struct.pack('<BQQQ', FOOTER, 20, len(data) if summary else 0, 0)
    stored = struct.pack('<I', crc32(summary + footer))
    file.write_bytes(data + summary + footer + stored + MAGIC)
    return file


def index_of(places: range) -> bytes:
    rest = struct.pack('<IQIQQ', 0, 0, 0, 0, 0)
    spans = ((struct.pack('<QQQQ', at, at, at, 9) + rest) for at in places)
    return b''.join(record(CHUNK_INDEX, body) for body in spans)


@pytest.mark.parametrize(
    ('data', 'first'),
    [
        (bytes(N_FORGED), 'a record of 0 bytes cannot be there'),
        (record(OTHER, bytes(N_FORGED)), 'is not there'),
    ],
    ids=['no records', 'one of another kind'],
)
def test_of_very_many_damages_first_are_named(tmp_path: Path, data: bytes, first: str) -> None:
    begin = len(MAGIC) + len(record(HEADER, text('ros2') + text('forger')))
    places = range(begin + len(data) - N_FORGED, begin + len(data))
    mcap = read_mcap(written(tmp_path / 'a.mcap', data, index_of(places)))
    *named, last = map(str, mcap.damages)
    assert len(named) == 20
    assert named[0].startswith('chunk 1, bytes ')
    assert named[0].endswith(first)
    assert last == f'{N_FORGED - 20} more damages'


@pytest.mark.parametrize(
    ('data', 'words'),
    [
        (schema(1, 'a/msg/A') + schema(1, 'a/msg/B'), 'type 1 is defined twice, differently'),
        (channel(7, '/a') + channel(7, '/b'), 'channel 7 is defined twice, differently'),
        (
            record(SCHEMA, struct.pack('<HI', 1, 4_000) + b'short'),
            'string length 4000 exceeds the record',
        ),
    ],
    ids=['type', 'channel', 'text'],
)
def test_what_contradicts_itself_is_named(tmp_path: Path, data: bytes, words: str) -> None:
    [damage] = read_mcap(written(tmp_path / 'a.mcap', data)).damages
    assert str(damage).endswith(f': {words}')
    assert not damage.is_loss


@pytest.mark.parametrize('n_listed', [3, 0], ids=['more', 'less'])
def test_a_summary_that_lists_another_number_of_messages_is_named(
    tmp_path: Path, n_listed: int
) -> None:
    message = record(5, struct.pack('<HIQQ', 1, 0, 0, 0))
    summary = record(STATISTICS, struct.pack('<QHIIIIQQI', n_listed, 1, 1, 0, 0, 0, 0, 0, 0))
    data = schema(1, 'a/msg/A') + channel(1, '/a') + message * 2
    [damage] = read_mcap(written(tmp_path / 'a.mcap', data, summary)).damages
    assert str(damage) == f'holds 2 messages, its summary lists {n_listed}'
    assert damage.is_loss == (n_listed > 2)


@pytest.mark.parametrize('change', ['byte', 'cut'])
def test_a_file_that_changes_while_it_is_read_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: str
) -> None:
    monkeypatch.setattr(mcap_file, '_MOST_KEPT_BYTE', 0)
    bag = HandMadeBag(tmp_path / 'bag')
    bag.add('/uav_1/radio_rx', 'RadioMessage', sequence=1)
    bag.writer.close()
    file = tmp_path / 'bag' / 'bag.mcap'
    mcap = read_mcap(file)
    assert len([*mcap.messages(mcap.channels)]) == 1
    [part] = mcap.parts
    content = bytearray(file.read_bytes())
    content[part.begin + 20] ^= 1
    file.write_bytes(content if change == 'byte' else content[: part.begin + 5])
    with pytest.raises(BagError, match=rf'bag\.mcap: bytes {part.begin} to \d+ have changed'):
        [*mcap.messages(mcap.channels)]


@pytest.mark.parametrize('size', [0, 1_000])
def test_a_chunk_takes_no_more_memory_than_it_says(size: int) -> None:
    packed = lz4.frame.compress(bytes(50_000_000))
    tracemalloc.start()
    try:
        with pytest.raises(BrokenError, match='its lengths contradict each other'):
            unpacked(packed, 'lz4', size)
        _, most_byte = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most_byte < 1_000_000


@pytest.mark.parametrize('packed', [b'', b'no frame at all', lz4.frame.compress(b'abc')[:-8]])
def test_what_is_no_frame_cannot_be_unpacked(packed: bytes) -> None:
    with pytest.raises(BrokenError, match=r'cannot be unpacked|its lengths contradict each other'):
        unpacked(packed, 'lz4', 3)


def test_a_packing_that_nobody_knows_is_named() -> None:
    with pytest.raises(BrokenError, match="is packed by 'rar': must be lz4, zstd or ''"):
        unpacked(b'abc', 'rar', 3)

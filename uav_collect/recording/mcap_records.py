"""The records of MCAP files: what their bytes stand for."""

from collections.abc import Iterator
import struct
from typing import Any, NamedTuple

from backports import zstd
from lz4.frame import LZ4FrameDecompressor
from uav_collect.errors import in_one_line

MAGIC = b'\x89MCAP0\r\n'
ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'
# Kinds of records.
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06
CHUNK_INDEX, STATISTICS, METADATA, DATA_END = 0x08, 0x0B, 0x0C, 0x0F
HEAD = struct.Struct('<BQ')  # of a record: its kind and length
CHUNK_HEAD = struct.Struct('<QQQII')  # from when, until when, size, checksum, length of a name
FOOTER_BODY = struct.Struct('<QQI')  # where the summary begins, where its offsets do, checksum
MESSAGE_HEAD = struct.Struct('<HIQQ')  # channel, sequence, when logged, when published
INDEX_HEAD = struct.Struct('<QQQQ')  # from when, until when, where its chunk is, how long that is
LENGTH, LONG = struct.Struct('<I'), struct.Struct('<Q')
SUM_BYTE = 4
FOOTER_BYTE = HEAD.size + FOOTER_BODY.size
MOST_RECORD_BYTE = 1 << 28  # nobody writes larger ones, and each is held in memory
_SHORT = struct.Struct('<H')
_UNPACK_ERRORS = (EOFError, MemoryError, OverflowError, RuntimeError, ValueError, zstd.ZstdError)


class BrokenError(Exception):
    """Bytes that are not what they should be, in words."""


class Schema(NamedTuple):
    """A message type."""

    name: str
    encoding: str  # of its definition: ros2msg or ros2idl
    definition: str


class Channel(NamedTuple):
    """A topic with messages of one type."""

    topic: str
    schema: int
    encoding: str  # of its messages
    metadata: dict[str, str]


class ChunkBody(NamedTuple):
    """A chunk as it lies in the file."""

    begin: int  # of the packed content, in the record's body
    packed: bytes
    compression: str
    size: int  # unpacked
    stored_sum: int  # 0: none


def chunk_of(body: bytes) -> ChunkBody:
    """A chunk's parts.

    Raises:
        BrokenError: their lengths contradict each other.
    """
    try:
        _, _, size, stored, n_name = CHUNK_HEAD.unpack_from(body)
        at = CHUNK_HEAD.size + n_name
        (n_byte,) = LONG.unpack_from(body, at)
        compression = body[CHUNK_HEAD.size : at].decode()
    except (struct.error, UnicodeDecodeError) as error:
        raise BrokenError('its head cannot be read') from error
    packed = body[at + LONG.size :]
    if n_byte != len(packed):
        raise BrokenError('its lengths contradict each other')
    return ChunkBody(at + LONG.size, packed, compression, size, stored)


def unpacked(packed: bytes, compression: str, size: int) -> bytes:
    """The content of a chunk.

    Raises:
        BrokenError: it cannot be unpacked to that size.
    """
    if size > MOST_RECORD_BYTE:
        raise BrokenError(f'its content of {size:,} bytes is larger than {MOST_RECORD_BYTE:,}')
    content = packed
    if compression:
        if (unpacker := _unpacker(compression)) is None:
            named = in_one_line(repr(compression))
            raise BrokenError(f"is packed by {named}: must be lz4, zstd or ''")
        try:
            content = unpacker.decompress(
                packed, max_length=size
            )  # never more than the chunk says
        except _UNPACK_ERRORS as error:
            raise BrokenError(f'cannot be unpacked, {in_one_line(str(error))}') from error
        if not unpacker.eof:
            raise BrokenError('its lengths contradict each other')
    if len(content) != size:
        raise BrokenError(f'has {len(content)} bytes, must have {size}')
    return bytes(content)


def _unpacker(compression: str) -> Any:  # noqa: ANN401 - of either library
    match compression:
        case 'lz4':
            return LZ4FrameDecompressor()
        case 'zstd':
            return zstd.ZstdDecompressor()
    return None


def unpacked_message(packed: bytes) -> bytes:
    """The content of a message that was packed by itself.

    Raises:
        BrokenError: it cannot be unpacked.
    """
    try:
        size = zstd.get_frame_info(packed).decompressed_size
    except zstd.ZstdError as error:
        raise BrokenError(f'cannot be unpacked, {error}') from error
    if size is None:
        raise BrokenError('cannot be unpacked, it does not tell its size')
    return unpacked(packed, 'zstd', size)


def heads_of(content: bytes) -> Iterator[tuple[int, int, int]]:
    """Place, kind and length of the bodies of records.

    Raises:
        BrokenError: they cannot be followed to the end.
    """
    at, end = 0, len(content)
    while at < end:
        if at + HEAD.size > end:
            raise BrokenError('its records cannot be followed')
        kind, length = HEAD.unpack_from(content, at)
        at += HEAD.size
        if length > end - at:
            raise BrokenError('its records cannot be followed')
        yield at, kind, length
        at += length


def schema_of(body: bytes) -> tuple[int, Schema]:
    """A type and its number; raises BrokenError."""
    name, at = text_at(body, 2)
    encoding, at = text_at(body, at)
    definition, _ = text_at(body, at)
    return _number_at(_SHORT, body, 0), Schema(name, encoding, definition)


def channel_of(body: bytes) -> tuple[int, Channel]:
    """A channel and its number; raises BrokenError."""
    number, schema = _number_at(_SHORT, body, 0), _number_at(_SHORT, body, 2)
    topic, at = text_at(body, 4)
    encoding, at = text_at(body, at)
    n_byte = _number_at(LENGTH, body, at)
    at, end = at + LENGTH.size, at + LENGTH.size + n_byte
    metadata = {}
    while at < end:
        key, at = text_at(body, at)
        metadata[key], at = text_at(body, at)
    return number, Channel(topic, schema, encoding, metadata)


def text_at(body: bytes, at: int) -> tuple[str, int]:
    """A text, and where it ends; raises BrokenError."""
    n_byte = _number_at(LENGTH, body, at)
    at += LENGTH.size
    if n_byte > len(body) - at:
        raise BrokenError(f'string length {n_byte} exceeds the record')
    try:
        return body[at : at + n_byte].decode(), at + n_byte
    except UnicodeDecodeError as error:
        raise BrokenError('a text is not UTF-8') from error


def serialized_metadata(body: bytes) -> str | None:
    """The text of a record in which rosbag2 keeps what is in metadata.yaml; None in others."""
    _, marker, text = body.partition(b'serialized_metadata')
    n_byte = int.from_bytes(text[:4], 'little')
    if not marker or n_byte != len(text) - 4:
        return None
    return text[4:].decode(errors='replace')


def _number_at(form: struct.Struct, body: bytes, at: int) -> int:
    try:
        return int(form.unpack_from(body, at)[0])
    except struct.error as error:
        raise BrokenError('it is too short') from error

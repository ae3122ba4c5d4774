"""Checksums of a bag's file: written while it grows, and checked when somebody doubts it.

An MCAP file has room for a CRC-32 of each chunk's content, of all bytes before the end of its data
and of its summary, so that no byte of it can change unseen. rosbags leaves all of them 0, which
stands for none; files of other recorders may have some.
"""

from binascii import crc32
from collections.abc import Iterator
from dataclasses import dataclass, field
from os import SEEK_END
from pathlib import Path
import struct
from typing import Any, BinaryIO

from rosbags.highlevel import AnyReaderError
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.storage_mcap import decompress, zstd  # type: ignore[attr-defined]

_MAGIC = b'\x89MCAP0\r\n'
_FOOTER, _CHUNK, _METADATA, _DATA_END = 0x02, 0x06, 0x0C, 0x0F  # kinds of records
_HEAD = struct.Struct('<BQ')  # of a record: its kind and length
_CHUNK_HEAD = struct.Struct('<QQQII')  # from when, until when, size, checksum, length of a name
_CHUNK_SUM_AT = _HEAD.size + 24
_DATA_END_BYTE = _HEAD.size + 4
_FOOTER_BYTE = _HEAD.size + 20
_SUM_BYTE = 4
_BLOCK_BYTE = 1 << 20
# What unpacking a damaged chunk may raise, beside ReaderError.
_DAMAGE = (
    *(EOFError, MemoryError, OSError, OverflowError, RuntimeError, struct.error, ValueError),
    zstd.ZstdError,
)
# What rosbags raises where it cannot read a file, or a chunk in it.
READER_ERRORS = (AnyReaderError, ReaderError, zstd.ZstdError, OSError)


class BagChecksums:
    """Adds the checksums to a file that rosbags writes."""

    def __init__(self, storage: Any) -> None:  # noqa: ANN401 - of rosbags
        """Add one to each chunk from now on; nothing is in a chunk yet."""
        self._storage = storage
        self._close_chunk = storage.close_chunk
        storage.close_chunk = self.close_chunk
        self._path: Path = storage.path
        self._data_sum = self._n_summed_byte = 0  # of what was read back

    def close_chunk(self) -> None:
        """Write the chunk, then its checksum into it."""
        storage = self._storage
        checksum, start = crc32(storage.chunk.bio.getbuffer()), storage.bio.tell()
        self._close_chunk()
        end = storage.bio.tell()
        storage.bio.seek(start + _CHUNK_SUM_AT)
        storage.bio.write(_sum_bytes(checksum))
        storage.bio.seek(end)

    def note_flushed(self) -> None:
        """Read back what was written to the end of the file and will stay as it is."""
        self._sum_up_to(self._path.stat().st_size)

    def finish(self) -> None:
        """Write the checksums of data and summary into the closed file.

        Raises:
            OSError: the file cannot be written.
        """
        with self._path.open('r+b') as file:
            footer_at = file.seek(-_FOOTER_BYTE - len(_MAGIC), SEEK_END)
            footer = file.read(_FOOTER_BYTE)
            summary_at = int.from_bytes(footer[_HEAD.size : _HEAD.size + 8], 'little')
            file.seek(summary_at)
            summary_sum = crc32(footer[:-_SUM_BYTE], crc32(file.read(footer_at - summary_at)))
            self._sum_up_to(summary_at - _DATA_END_BYTE)
            file.seek(summary_at - _SUM_BYTE)
            file.write(_sum_bytes(self._data_sum))
            file.seek(footer_at + _FOOTER_BYTE - _SUM_BYTE)
            file.write(_sum_bytes(summary_sum))

    def _sum_up_to(self, end: int) -> None:
        with self._path.open('rb') as file:
            file.seek(self._n_summed_byte)
            while block := file.read(min(_BLOCK_BYTE, end - self._n_summed_byte)):
                self._data_sum = crc32(block, self._data_sum)
                self._n_summed_byte += len(block)


@dataclass(kw_only=True)
class FileCheck:
    """What checksums say about a file."""

    damages: list[str] = field(default_factory=list)  # one line each, in the file's order
    has_checksums: bool = False  # of everything in it
    metadata: str | None = None  # the text that is also in metadata.yaml, but for its indentation


def check_file(path: Path) -> FileCheck:
    """Find what is not as it was written, as far as the file has checksums.

    Args:
        path: an MCAP file.

    Raises:
        OSError: it cannot be read.
    """
    check = FileCheck()
    with path.open('rb') as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            check.damages.append('does not begin as an MCAP file')
            return check
        try:
            _check_records(file, path.stat().st_size, check)
        except _BrokenError as error:
            check.damages.append(str(error))
    return check


class _BrokenError(Exception):
    """The records cannot be followed any further."""


def _check_records(file: BinaryIO, size: int, check: FileCheck) -> None:
    """Walk through the records up to the end of the file."""
    running_sum, n_chunks = crc32(_MAGIC), 0
    has_data_ended = False
    for at, kind, head, body in _records(file, size):
        if kind == _CHUNK:
            n_chunks += 1
            if (damage := _chunk_damage(body)) is not None:
                check.damages.append(f'chunk {n_chunks}, at byte {at}: {damage}')
        elif kind == _METADATA:
            check.metadata = _serialized_metadata(body) or check.metadata
        elif kind == _DATA_END:
            has_data_ended = True
            stored = int.from_bytes(body[:_SUM_BYTE], 'little')
            check.has_checksums = stored != 0
            if stored not in (0, running_sum) and not check.damages:
                check.damages.append(f'data before byte {at}, between chunks: checksum differs')
            running_sum = 0
            continue
        elif kind == _FOOTER:
            running_sum = crc32(head + body[:-_SUM_BYTE], running_sum)
            stored = int.from_bytes(body[-_SUM_BYTE:], 'little')
            if stored not in (0, running_sum):
                check.damages.append(f'summary before byte {at}: checksum differs')
        running_sum = crc32(body, crc32(head, running_sum))
    if not has_data_ended:
        raise _BrokenError('has no end of its data')


def _records(file: BinaryIO, size: int) -> Iterator[tuple[int, int, bytes, bytes]]:
    """Place, kind, head and body of each record, footer last."""
    kind = None
    while kind != _FOOTER:
        at = file.tell()
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            raise _BrokenError(f'ends at byte {size} without a footer')
        kind, length = _HEAD.unpack(head)
        if length > size - file.tell():
            raise _BrokenError(f'record at byte {at}: {length} bytes, more than the file has')
        yield at, kind, head, file.read(length)
    if file.read() != _MAGIC:
        raise _BrokenError('does not end as an MCAP file')


def _chunk_damage(body: bytes) -> str | None:
    """What is wrong with a chunk; None if nothing is, or it has no checksum."""
    try:
        *_, n_byte, checksum, n_name = _CHUNK_HEAD.unpack_from(body)
        name_at = _CHUNK_HEAD.size
        compression = body[name_at : name_at + n_name].decode()
        content = body[name_at + n_name + 8 :]
        decompress(content, compression, n_byte, checksum)
    except ReaderError as error:
        return str(error).rstrip('.').lower()
    except _DAMAGE as error:
        return f'cannot be unpacked: {" ".join(str(error).split())}'
    return None


def _serialized_metadata(body: bytes) -> str | None:
    """The text of a record in which rosbag2 keeps what is in metadata.yaml; None in others."""
    _, marker, text = body.partition(b'serialized_metadata')
    n_byte = int.from_bytes(text[:4], 'little')
    if not marker or n_byte != len(text) - 4:
        return None
    return text[4:].decode(errors='replace')


def _sum_bytes(checksum: int) -> bytes:
    return checksum.to_bytes(_SUM_BYTE, 'little')

"""Reads an MCAP file as far as it is whole, whatever has befallen it.

Each record is followed from the start, and each chunk unpacked and checked, before the first
message is given away: what is damaged is known then, by place and time. Where records cannot be
followed, the index at the file's end says where the next chunk begins. Channels and their types
come from the chunks, or from the summary if the chunk that announced them is lost.
"""

from binascii import crc32
from bisect import bisect_right
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
import heapq
from pathlib import Path
import struct
from typing import BinaryIO

from uav_collect import files
from uav_collect.errors import BagError
from uav_collect.recording.mcap_damages import Damage, DamageNotes
from uav_collect.recording.mcap_records import (
    BrokenError,
    CHANNEL,
    Channel,
    channel_of,
    CHUNK,
    CHUNK_HEAD,
    CHUNK_INDEX,
    chunk_of,
    DATA_END,
    FOOTER,
    FOOTER_BODY,
    FOOTER_BYTE,
    HEAD,
    HEADER,
    heads_of,
    INDEX_HEAD,
    LONG,
    MAGIC,
    MESSAGE,
    MESSAGE_HEAD,
    METADATA,
    MOST_RECORD_BYTE,
    SCHEMA,
    Schema,
    schema_of,
    serialized_metadata,
    STATISTICS,
    SUM_BYTE,
    text_at,
    unpacked,
)

_MOST_KEPT_BYTE = 1 << 26  # of unpacked chunks that are not unpacked again
_LOOSE_BYTE = 1 << 20  # of messages outside chunks that are read together


@dataclass(kw_only=True)
class _Part:
    """Messages that lie together, in a chunk or outside of any."""

    begin: int  # of the packed bytes in the file
    n_byte: int
    size: int  # unpacked
    compression: str
    first_ns: int  # log time
    channels: Counter[int]
    content: bytes | None  # if it is kept
    checksum: int  # of the unpacked content, if that is not kept


@dataclass(kw_only=True)
class McapFile:
    """What an MCAP file holds, and what is damaged of it."""

    path: Path
    damages: list[Damage] = field(default_factory=list)
    has_checksums: bool = False  # of everything in it
    metadata: str | None = None  # the text that is also in metadata.yaml, but for its indentation
    library: str = ''  # that wrote it
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    n_messages: int = 0
    parts: list[_Part] = field(default_factory=list)

    def messages(self, channels: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        """Channel, log time and content of messages, by time; those of one time as they lie.

        Args:
            channels: of which to give messages.

        Raises:
            BagError: the file is not any more what it was when it was read first.
            OSError: the file cannot be read any more.
        """
        wanted = {*channels}
        with files.open_file(self.path) as (file, _):
            parts = [
                self._sorted_messages(file, part, wanted)
                for part in self.parts
                if wanted & part.channels.keys()
            ]
            for log_ns, channel, content in heapq.merge(*parts, key=_log_time):
                if content is not None:
                    yield channel, log_ns, content

    def _sorted_messages(
        self, file: BinaryIO, part: _Part, wanted: Collection[int]
    ) -> Iterator[tuple[int, int, bytes | None]]:
        """Log time, channel and content of a part's messages, after a mark of when it begins."""
        yield part.first_ns, 0, None  # unpacked only when it is its turn
        content = self._content_of(part, file) if part.content is None else part.content
        found: list[tuple[int, int, bytes]] = []
        for at, kind, length in heads_of(content):
            if kind == MESSAGE:
                channel, _, log_ns, _ = MESSAGE_HEAD.unpack_from(content, at)
                if channel in wanted:
                    found.append((log_ns, channel, content[at + MESSAGE_HEAD.size : at + length]))
        found.sort(key=_log_time)
        yield from found

    def _content_of(self, part: _Part, file: BinaryIO) -> bytes:
        """What lies in a part, as it was when the file was read first; else a BagError."""
        file.seek(part.begin)
        try:
            content = unpacked(file.read(part.n_byte), part.compression, part.size)
        except BrokenError:
            content = None
        if content is None or crc32(content) != part.checksum:
            end = part.begin + part.n_byte
            what = f'bytes {part.begin} to {end} have changed while it was read'
            raise BagError(f'{self.path}: {what}')
        return content


def read_mcap(path: Path) -> McapFile:
    """Find what a file holds, and what of it is damaged.

    Raises:
        BagError: it is no MCAP file.
        OSError: it cannot be read.
    """
    mcap = McapFile(path=path)
    with files.open_file(path) as (file, size):
        begin = file.read(len(MAGIC) + 1)
        if begin[: len(MAGIC)] != MAGIC:
            if begin[len(MAGIC) :] != bytes([HEADER]):
                raise BagError(f'{path}: is not an MCAP file')
            mcap.damages.append(Damage(what='does not begin as an MCAP file'))
        _Reading(mcap, file, size).read()
    return mcap


class _Reading:
    """One file while it is read for the first time."""

    def __init__(self, mcap: McapFile, file: BinaryIO, size: int) -> None:
        self._mcap, self._file, self._size = mcap, file, size
        self._kept_byte = 0
        self._sum = crc32(MAGIC)  # of all bytes so far
        self._has_footer = False
        self._chunks: list[int] = []  # where they were found
        self._spans: dict[int, tuple[int, int]] = {}  # log times by place, as the index tells
        self._notes = DamageNotes()
        self._note = self._notes.add
        self._n_by_summary: int | None = None  # messages, by the summary
        self._loose = bytearray()  # messages outside chunks that follow each other
        self._loose_at = 0

    def read(self) -> None:
        """Find all that the file holds, and what is damaged."""
        mcap = self._mcap
        summary = self._read_summary()
        has_ended = self._read_data()
        self._end_loose()
        if has_ended and not self._has_footer:
            self._note('ends without a footer: its recorder was cut off, or the file')
        try:  # what no whole chunk has announced
            for kind, body in summary:
                self._take_announcement(kind, body)
        except BrokenError as error:
            self._note(f'its summary cannot be right: {error}')
        self._note_lost_chunks()
        counts = sum((part.channels for part in mcap.parts), Counter[int]())
        mcap.n_messages = counts.total()
        n_unknown = sum(count for channel, count in counts.items() if channel not in mcap.channels)
        if n_unknown:
            what = f'{n_unknown} messages are of channels that are not announced'
            self._note(what, may_cost=True)
        if self._n_by_summary not in (None, mcap.n_messages) and not self._has_damages():
            what = f'holds {mcap.n_messages} messages, its summary lists {self._n_by_summary}'
            self._note(what, may_cost=mcap.n_messages < (self._n_by_summary or 0))
        has_all = self._n_by_summary == mcap.n_messages - n_unknown
        chunks = {*self._spans, *self._chunks}
        mcap.damages += self._notes.damages(chunks, self._spans, has_all=has_all)

    def _has_damages(self) -> bool:
        return bool(self._mcap.damages or self._notes.n_damages)

    # The summary.

    def _read_summary(self) -> list[tuple[int, bytes]]:
        """Kind and body of the records of the summary; none without a whole one."""
        file, size = self._file, self._size
        footer_at = max(size - FOOTER_BYTE - len(MAGIC), 0)
        file.seek(footer_at)
        footer = file.read()
        if footer[: HEAD.size] != HEAD.pack(FOOTER, FOOTER_BODY.size) or footer[-8:] != MAGIC:
            return []
        self._has_footer = True
        begin, _, stored = FOOTER_BODY.unpack_from(footer, HEAD.size)
        begin = begin or footer_at
        if not len(MAGIC) <= begin <= footer_at or footer_at - begin > MOST_RECORD_BYTE:
            self._note(f'its footer places the summary at byte {begin}', footer_at, size)
            return []
        file.seek(begin)
        content = file.read(footer_at - begin)
        if stored not in (0, crc32(footer[: FOOTER_BYTE - SUM_BYTE], crc32(content))):
            self._note('the summary is damaged: its checksum differs', begin, size)
            return []
        try:
            records = [(kind, content[at : at + n]) for at, kind, n in heads_of(content)]
            self._read_index(records)
        except (BrokenError, struct.error) as error:
            self._note(f'the summary cannot be read: {error}', begin, size)
            return []
        return records

    def _read_index(self, records: list[tuple[int, bytes]]) -> None:
        for kind, body in records:
            if kind == CHUNK_INDEX:
                first_ns, last_ns, begin, _ = INDEX_HEAD.unpack_from(body)
                self._spans[begin] = first_ns, last_ns
            elif kind == STATISTICS:
                (self._n_by_summary,) = LONG.unpack_from(body)

    # The data before it.

    def _read_data(self) -> bool:
        """Follow the records from the start; whether their end was found."""
        at = len(MAGIC)
        index = sorted(self._spans)
        while True:
            self._file.seek(at)
            head = self._file.read(HEAD.size)
            kind, length = HEAD.unpack(head) if len(head) == HEAD.size else (0, 0)
            end = at + HEAD.size + length
            if kind == 0 or end > self._size or length > MOST_RECORD_BYTE:
                place = bisect_right(index, at)
                following = index[place] if place < len(index) else None
                self._note_break(at, following, length)
                if following is None:
                    return False
                at = following
                continue
            body = self._file.read(length)
            if kind == DATA_END:
                self._check_sum(body)
                return True
            if kind == FOOTER:
                self._note('its data have no end', at, end)
                return True
            self._take(at, kind, body)
            self._sum = crc32(body, crc32(head, self._sum))
            at = end

    def _note_break(self, at: int, following: int | None, length: int) -> None:
        end = self._size if following is None else following
        what = f'a record of {length:,} bytes cannot be there'
        if not self._has_footer and following is None:
            what = 'ends without a footer: its recorder was cut off, or the file'
        self._note(what, at, end, may_cost=at < end)

    def _check_sum(self, body: bytes) -> None:
        stored = int.from_bytes(body[:SUM_BYTE], 'little')
        self._mcap.has_checksums = stored != 0
        if stored not in (0, self._sum) and not self._has_damages():
            self._note('a record between chunks is damaged: the checksum differs')

    def _note_lost_chunks(self) -> None:
        """Note chunks of the index in whose place are others, or none."""
        for at in self._notes.outside({*self._spans} - {*self._chunks}):
            self._note('is not there', at, at + HEAD.size, may_cost=True)

    def _take(self, at: int, kind: int, body: bytes) -> None:
        """Take what a record says."""
        if kind == MESSAGE:
            if not self._loose:
                self._loose_at = at
            self._loose += HEAD.pack(kind, len(body)) + body
            if len(self._loose) < _LOOSE_BYTE:
                return
        self._end_loose()
        try:
            if kind == CHUNK:
                self._chunks.append(at)
                self._take_chunk(at, body)
            elif kind == HEADER:
                profile, rest = text_at(body, 0)
                self._mcap.library, _ = text_at(body, rest)
                if profile == 'ros1':
                    raise BagError(f'{self._mcap.path}: is a bag of ROS 1')
            elif kind == METADATA:
                self._mcap.metadata = serialized_metadata(body) or self._mcap.metadata
            else:
                self._take_announcement(kind, body)
        except (BrokenError, struct.error) as error:
            self._note(str(error), at, at + HEAD.size + len(body), may_cost=kind == CHUNK)

    def _end_loose(self) -> None:
        """Make one part of the messages outside chunks that follow each other."""
        content, self._loose = bytes(self._loose), bytearray()
        if content:
            try:
                self._add_part(self._loose_at, content, len(content), '')
            except BrokenError as error:
                end = self._loose_at + len(content)
                self._note(str(error), self._loose_at, end, may_cost=True)

    def _take_chunk(self, at: int, body: bytes) -> None:
        if at not in self._spans and len(body) >= CHUNK_HEAD.size:
            first_ns, last_ns, *_ = CHUNK_HEAD.unpack_from(body)
            if first_ns <= last_ns:
                self._spans[at] = first_ns, last_ns
        chunk = chunk_of(body)
        content = unpacked(chunk.packed, chunk.compression, chunk.size)
        if chunk.stored_sum not in (0, crc32(content)):
            raise BrokenError('its checksum differs')
        begin = at + HEAD.size + chunk.begin
        self._add_part(begin, content, len(chunk.packed), chunk.compression)

    def _add_part(self, begin: int, content: bytes, n_byte: int, compression: str) -> None:
        """Take what messages lying together announce, and note which there are.

        Raises:
            BrokenError: they are not whole; nothing of them is taken.
        """
        channels: Counter[int] = Counter()
        times_ns, announced = [], []
        for at, kind, length in heads_of(content):
            if kind == MESSAGE:
                if length < MESSAGE_HEAD.size:
                    raise BrokenError('a message is too short')
                channel, _, log_ns, _ = MESSAGE_HEAD.unpack_from(content, at)
                channels[channel] += 1
                times_ns.append(log_ns)
            else:
                announced.append((kind, content[at : at + length]))
        for kind, body in announced:
            self._take_announcement(kind, body)
        self._kept_byte += len(content)
        is_kept = self._kept_byte <= _MOST_KEPT_BYTE
        self._mcap.parts.append(
            _Part(
                begin=begin,
                n_byte=n_byte,
                size=len(content),
                compression=compression,
                first_ns=min(times_ns, default=0),
                channels=channels,
                content=content if is_kept else None,
                checksum=0 if is_kept else crc32(content),
            )
        )

    def _take_announcement(self, kind: int, body: bytes) -> None:
        """Note a type or a channel; what was known before must be the same."""
        mcap = self._mcap
        if kind == SCHEMA:
            number, schema = schema_of(body)
            if mcap.schemas.setdefault(number, schema) != schema:
                raise BrokenError(f'type {number} is defined twice, differently')
        elif kind == CHANNEL:
            number, channel = channel_of(body)
            if mcap.channels.setdefault(number, channel) != channel:
                raise BrokenError(f'channel {number} is defined twice, differently')


def _log_time(message: tuple[int, int, bytes | None]) -> int:
    return message[0]

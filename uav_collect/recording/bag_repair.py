"""Makes a recording readable again whose recorder was killed or ran out of disk space.

The file of such a recording ends in the middle of a chunk and has no index. All whole chunks are
streamed into a new file that takes its place; the broken one is kept beside it. Every step can
itself be interrupted and repeated.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import fcntl
import os
from pathlib import Path
import shutil
import struct
from typing import BinaryIO

from mcap.exceptions import McapError
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.metadata import parse_qos
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
from rosbags.typesys.store import Typestore
from uav_collect.errors import BagError
from uav_collect.recording.bag_checksums import BagChecksums, READER_ERRORS
from uav_collect.recording.bag_writer import compress_chunks, RESERVE
from uav_collect.recording.log_times import StampReader
from uav_collect.recording.message_heads import FieldKind
from zstandard import ZstdError

# What reading raises where a file ends or is damaged. Lengths that make no sense are memory errors
# and overflows, wrong checksums and broken text are ValueErrors; RuntimeError is from lz4.
_DAMAGE = (
    *(KeyError, McapError, MemoryError, OverflowError, RuntimeError, struct.error, ValueError),
    ZstdError,
)
_CLOCK = 'rosgraph_msgs/msg/Clock'
_OWN_TYPES = 'uav_collect_msgs/'
_BROKEN = '.broken'
_WORK = 'repairing'


@dataclass(frozen=True, kw_only=True)
class Repair:
    """What a bag holds, and what was done to it."""

    n_messages: int
    last_sim_time_s: float | None  # latest simulated time in it, None without any
    broken_file: Path | None  # where the broken file is kept; None if the bag was whole
    n_cut_byte: int  # at the end of the broken file, in no whole chunk


class _MessageCount:
    """Counts messages and finds the latest simulated time among them."""

    def __init__(self, types: Typestore) -> None:
        self.n_messages = 0
        self.last_sim_time_s: float | None = None
        self._types = types
        self._stamps: dict[str, StampReader] = {}  # by type

    def take(self, type_name: str, content: bytes) -> None:
        self.n_messages += 1
        if not _tells_time(type_name):
            return
        if type_name not in self._stamps:
            self._stamps[type_name] = StampReader(type_name, self._fields)
        stamp_ns = self._stamps[type_name].read_ns(content)
        if stamp_ns is not None:
            self.last_sim_time_s = max(stamp_ns / 1e9, self.last_sim_time_s or 0.0)

    def _fields(self, type_name: str) -> Sequence[tuple[str, FieldKind]]:
        _, fields = self._types.fielddefs[type_name]
        return fields


def repair(bag: Path) -> Repair:
    """Make a bag readable; a bag that is readable already is left alone.

    Args:
        bag: folder of the bag, or the .mcap file in it.

    Raises:
        BagError: there is no bag, it is still being written, or it is not of this kind.
        OSError: the new file cannot be written.
    """
    folder = bag.parent if bag.is_file() else bag
    if (whole := _look_at(folder)) is not None:
        return whole
    source = _broken_file(folder)
    shutil.rmtree(folder / _WORK, ignore_errors=True)
    work = folder / _WORK / source.name.removesuffix(_BROKEN).removesuffix('.mcap')
    with source.open('rb') as file:
        torn = _TornFile(file, folder)
        work.parent.mkdir()
        count = _copy(torn, work)
        n_cut_byte = source.stat().st_size - torn.good_end
    return Repair(
        n_messages=count.n_messages,
        last_sim_time_s=count.last_sim_time_s,
        broken_file=_swap(source, work),
        n_cut_byte=n_cut_byte,
    )


class _TornFile:
    """The messages of an MCAP file that may end anywhere."""

    def __init__(self, file: BinaryIO, folder: Path) -> None:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            raise BagError(f'{folder}: is still being recorded, stop the recorder first') from None
        except OSError:
            pass  # a file system without locks cannot tell
        if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            raise BagError(f'{folder}: {Path(file.name).name} is not an MCAP file')
        self.good_end = file.tell()  # behind the last whole record
        self._file = file

    def messages(self) -> Iterator[tuple[Schema, Channel, Message]]:
        """All messages of whole chunks, up to the first damage."""
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        size = os.fstat(self._file.fileno()).st_size
        reader = StreamReader(
            self._file, skip_magic=True, validate_crcs=True, record_size_limit=size
        )
        try:
            for record in reader.records:
                match record:
                    case Schema():
                        schemas[record.id] = record
                    case Channel():
                        channels[record.id] = record
                    case Message():
                        channel = channels[record.channel_id]
                        yield schemas[channel.schema_id], channel, record
                self.good_end = self._file.tell()
            self.good_end = size
        except _DAMAGE:
            return


def _look_at(folder: Path) -> Repair | None:
    """What a readable bag holds; None if it cannot be read."""
    try:
        with AnyReader([folder]) as reader:
            count = _MessageCount(reader.typestore)
            n_messages = reader.message_count
            timed = [c for c in reader.connections if _tells_time(c.msgtype)]
            for connection, _, content in reader.messages(timed) if timed else ():
                count.take(connection.msgtype, content)
    except READER_ERRORS:
        return None
    return Repair(
        n_messages=n_messages,
        last_sim_time_s=count.last_sim_time_s,
        broken_file=None,
        n_cut_byte=0,
    )


def _broken_file(folder: Path) -> Path:
    """The file to read: what an interrupted repair has put aside, or the bag's only one."""
    files = sorted(folder.glob('*.mcap')) or sorted(folder.glob(f'*.mcap{_BROKEN}'))
    if len(files) == 1:
        return files[0]
    if not folder.is_dir():
        raise BagError(f'{folder}: no such bag')
    raise BagError(f'{folder}: must hold one .mcap file to repair, holds {len(files)}')


def _copy(torn: _TornFile, bag: Path) -> _MessageCount:
    """Write all messages to a new bag."""
    types = get_typestore(Stores.EMPTY)
    count = _MessageCount(types)
    topics: dict[int, Connection] = {}  # by channel
    new = Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP)
    compress_chunks(new)
    with new as writer:
        checksums = BagChecksums(writer.storage)
        for schema, channel, message in torn.messages():
            if channel.id not in topics:
                definition = schema.data.decode()
                types.register(get_types_from_msg(definition, schema.name))
                topics[channel.id] = writer.add_connection(
                    channel.topic,
                    schema.name,
                    msgdef=definition,
                    rihs01=types.hash_rihs01(schema.name),
                    offered_qos_profiles=parse_qos(
                        channel.metadata.get('offered_qos_profiles', '')
                    ),
                )
            writer.write(topics[channel.id], message.log_time, message.data)
            count.take(schema.name, message.data)
    checksums.finish()
    return count


def _tells_time(type_name: str) -> bool:
    return type_name == _CLOCK or type_name.startswith(_OWN_TYPES)


def _swap(source: Path, work: Path) -> Path:
    """Put the new bag in place of the broken one, metadata last; returns where that is kept."""
    folder = source.parent
    target = folder / f'{work.name}.mcap'
    kept = folder / f'{target.name}{_BROKEN}'
    if not kept.exists():
        source.replace(kept)
    (work / target.name).replace(target)
    (work / 'metadata.yaml').replace(folder / 'metadata.yaml')
    (folder / RESERVE).unlink(missing_ok=True)
    shutil.rmtree(folder / _WORK)
    return kept

"""Makes a recording readable again whose recorder was killed or ran out of disk space.

The file of such a recording ends in the middle of a chunk and has no index. All whole chunks are
streamed into a new file that takes its place; the broken one is kept beside it. Every step can
itself be interrupted and repeated.
"""

from collections.abc import Iterator
from dataclasses import dataclass
import fcntl
import os
from pathlib import Path
import shutil
import struct
from typing import BinaryIO, NamedTuple

from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.interfaces import Connection
from rosbags.rosbag2 import ReaderError, StoragePlugin, Writer
from rosbags.rosbag2.metadata import parse_qos
from rosbags.rosbag2.storage_mcap import decompress
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
from uav_collect.errors import BagError
from uav_collect.recording.bag_writer import RESERVE

_MAGIC = b'\x89MCAP0\r\n'
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 0x02, 0x03, 0x04, 0x05, 0x06
_HEAD = struct.Struct('<BQ')  # operation and length of a record
_CLOCK = 'rosgraph_msgs/msg/Clock'
_OWN_TYPES = 'uav_collect_msgs/'
_SCENARIO = 'uav_collect_msgs/msg/Scenario'
_BROKEN = '.broken'
_WORK = 'repairing'


@dataclass(frozen=True, kw_only=True)
class Repair:
    """What a bag holds, and what was done to it."""

    n_messages: int
    last_sim_time_s: float | None  # latest simulated time in it, None without any
    broken_file: Path | None  # where the broken file is kept; None if the bag was whole
    n_cut_byte: int  # at the end of the broken file, in no whole chunk


class _Channel(NamedTuple):
    topic: str
    type_name: str
    definition: str
    qos: str


class _Message(NamedTuple):
    channel: _Channel
    received_ns: int
    content: bytes


class _Tally:
    """Counts messages and finds the latest simulated time among them."""

    def __init__(self) -> None:
        self.n_messages = 0
        self.last_sim_time_s: float | None = None

    def take(self, type_name: str, content: bytes) -> None:
        self.n_messages += 1
        if _tells_time(type_name):
            # All these types begin with a stamp, behind the four bytes of the CDR header.
            second, nanosecond = struct.unpack_from('<iI', content, 4)
            self.last_sim_time_s = max(second + nanosecond * 1e-9, self.last_sim_time_s or 0.0)


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
        tally = _copy(torn, work)
        n_cut_byte = source.stat().st_size - torn.good_end
    return Repair(
        n_messages=tally.n_messages,
        last_sim_time_s=tally.last_sim_time_s,
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
        if file.read(len(_MAGIC)) != _MAGIC:
            raise BagError(f'{folder}: {Path(file.name).name} is not an MCAP file')
        self.good_end = file.tell()  # behind the last whole record
        self._file = file
        self._size = os.fstat(file.fileno()).st_size
        self._schemas: dict[int, tuple[str, str]] = {}  # name and text by id
        self._channels: dict[int, _Channel] = {}

    def messages(self) -> Iterator[_Message]:
        """All messages of whole chunks, up to the first damage."""
        while record := self._next_record():
            operation, body = record
            try:
                if operation == _CHUNK:
                    yield from self._messages_of_chunk(body)
                else:
                    yield from self._take(operation, body)
            except (KeyError, struct.error, ReaderError, UnicodeDecodeError):
                return
            self.good_end = self._file.tell()

    def _next_record(self) -> tuple[int, bytes] | None:
        head = self._file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return None
        operation, length = _HEAD.unpack(head)
        if operation == _FOOTER:
            self.good_end = self._size
            return None
        # Zeros are what a file system leaves when the power fails.
        if operation == 0 or length > self._size - self._file.tell():
            return None
        return operation, self._file.read(length)

    def _messages_of_chunk(self, body: bytes) -> Iterator[_Message]:
        _, _, size, crc, name_length = struct.unpack_from('<QQQII', body)
        start = 32 + name_length
        records = decompress(body[start + 8 :], body[32:start].decode(), size, crc)
        position = 0
        while position < len(records):
            operation, length = _HEAD.unpack_from(records, position)
            position += _HEAD.size
            yield from self._take(operation, records[position : position + length])
            position += length

    def _take(self, operation: int, body: bytes) -> Iterator[_Message]:
        if operation == _MESSAGE:
            channel, _, received_ns, _ = struct.unpack_from('<HIQQ', body)
            yield _Message(self._channels[channel], received_ns, body[22:])
        elif operation == _SCHEMA:
            (schema,) = struct.unpack_from('<H', body)
            name, _, text = _strings(body[2:])
            self._schemas[schema] = (name.decode(), text.decode())
        elif operation == _CHANNEL:
            channel, schema = struct.unpack_from('<HH', body)
            topic, _, metadata = _strings(body[4:])
            self._channels[channel] = _Channel(
                topic.decode(), *self._schemas[schema], _qos(metadata)
            )


def _look_at(folder: Path) -> Repair | None:
    """What a readable bag holds; None if it cannot be read."""
    tally = _Tally()
    try:
        with AnyReader([folder]) as reader:
            n_messages = reader.message_count
            timed = [c for c in reader.connections if _tells_time(c.msgtype)]
            for connection, _, content in reader.messages(timed) if timed else ():
                tally.take(connection.msgtype, content)
    except (AnyReaderError, OSError):
        return None
    return Repair(
        n_messages=n_messages,
        last_sim_time_s=tally.last_sim_time_s,
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


def _copy(torn: _TornFile, bag: Path) -> _Tally:
    """Write all messages to a new bag."""
    tally = _Tally()
    types = get_typestore(Stores.EMPTY)
    topics: dict[_Channel, Connection] = {}
    with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for channel, received_ns, content in torn.messages():
            if channel not in topics:
                types.register(get_types_from_msg(channel.definition, channel.type_name))
                topics[channel] = writer.add_connection(
                    channel.topic,
                    channel.type_name,
                    msgdef=channel.definition,
                    rihs01=types.hash_rihs01(channel.type_name),
                    offered_qos_profiles=parse_qos(channel.qos),
                )
            writer.write(topics[channel], received_ns, content)
            tally.take(channel.type_name, content)
    return tally


def _tells_time(type_name: str) -> bool:
    if type_name == _SCENARIO:  # says when its world started, in wall-clock time
        return False
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


def _strings(body: bytes) -> list[bytes]:
    """Length-prefixed strings; the maps of MCAP are such strings with one length in front."""
    strings = []
    position = 0
    while position < len(body):
        (length,) = struct.unpack_from('<I', body, position)
        position += 4
        strings.append(body[position : position + length])
        position += length
    return strings


def _qos(metadata: bytes) -> str:
    pairs = _strings(metadata)
    return (
        dict(zip(pairs[::2], pairs[1::2], strict=True)).get(b'offered_qos_profiles', b'').decode()
    )

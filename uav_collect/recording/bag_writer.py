"""Writes a recording: the folder layout of rosbag2 with one MCAP file, safe at any moment.

Messages are kept until `flush` writes them as one whole chunk, sorted by time and compressed.
Killed in between, the file holds all chunks flushed before, which `bag_repair` turns into a
readable bag. Out of disk space, the file is cut back to its last whole chunk and closed as usual.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
import fcntl
from io import BytesIO
from pathlib import Path
from shutil import rmtree
from typing import Any

from rosbags.interfaces import Connection, Qos
from rosbags.rosbag2 import (
    CompressionFormat,
    CompressionMode,
    StoragePlugin,
    Writer,
    WriterError,
)
from rosbags.rosbag2.storage_mcap import PendingChunk
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
from uav_collect.errors import RecordingError
from uav_collect.recording.bag_checksums import BagChecksums
from uav_collect.recording.chunk_index import ChunkIndex
from uav_collect.recording.message_heads import FieldKind

_SEPARATOR = '=' * 80
RESERVE = '.reserve'  # a file that keeps room for index and metadata, should the disk get full
_RESERVE_BYTE = 1 << 20


class MessageTypes:
    """Full texts and hashes of message types, comments and units included."""

    def __init__(self, text_of: Callable[[str], str]) -> None:
        """Start without any; a type is asked for when it is first needed.

        Args:
            text_of: gives the text of the .msg file of a type such as `std_msgs/msg/Header`.
        """
        self._text_of = text_of
        self._texts: dict[str, str] = {}
        self._store = get_typestore(Stores.EMPTY)

    def definition(self, type_name: str) -> str:
        """The type's text followed by those of all types it contains, as MCAP wants it."""
        first, *others = dict.fromkeys(self._with_parts(type_name))
        parts = [f'{_SEPARATOR}\nMSG: {_short(name)}\n{self._texts[name]}' for name in others]
        return '\n'.join([self._texts[first], *parts])

    def digest(self, type_name: str) -> str:
        """The hash by which ROS 2 tells versions of a type apart."""
        self.definition(type_name)
        return self._store.hash_rihs01(type_name)

    def fields(self, type_name: str) -> Sequence[tuple[str, FieldKind]]:
        """The names and kinds of a type's fields."""
        self.definition(type_name)
        _, fields = self._store.fielddefs[type_name]
        return fields

    def _with_parts(self, type_name: str) -> Iterator[str]:
        if type_name not in self._texts:
            self._texts[type_name] = self._text_of(type_name)
            self._store.register(get_types_from_msg(self._texts[type_name], type_name))
        yield type_name
        _, fields = self._store.fielddefs[type_name]
        for _, field in fields:
            part = _contained_type(field)
            if part is not None:
                yield from self._with_parts(part)


class BagWriter:
    """One recording while it is written: messages wait until a flush or a whole chunk."""

    def __init__(self, folder: Path, types: MessageTypes, *, chunk_byte: int) -> None:
        """Create the folder and its file.

        Args:
            folder: to create; must not exist.
            types: describes the types of the topics.
            chunk_byte: messages of this size together are written without waiting for `flush`.

        Raises:
            RecordingError: the folder exists or cannot be made.
        """
        self.folder = folder
        self.n_messages = 0  # written to the file
        self._types = types
        self._chunk_byte = chunk_byte
        self._waiting: list[tuple[Connection, int, bytes]] = []
        self._waiting_byte = 0
        self._writer, self._storage = _opened(folder)
        self._checksums = BagChecksums(self._storage)
        self._index: ChunkIndex = self._storage.chunks

    def add_topic(self, name: str, type_name: str, qos: Qos) -> Connection:
        """Announce a topic; the result stands for it in `write`."""
        return self._writer.add_connection(
            name,
            type_name,
            msgdef=self._types.definition(type_name),
            rihs01=self._types.digest(type_name),
            offered_qos_profiles=[qos],
        )

    def write(self, topic: Connection, log_ns: int, message: bytes) -> None:
        """Keep a serialized message for the next chunk.

        Args:
            log_ns: time by which the bag is replayed.

        Raises:
            RecordingError: as `flush`.
        """
        self._waiting.append((topic, log_ns, message))
        self._waiting_byte += len(message)
        if self._waiting_byte >= self._chunk_byte:
            self.flush()

    def flush(self) -> None:
        """Hand all messages to the operating system: they survive the death of this process.

        Raises:
            RecordingError: they cannot be written. The recording is closed, without them.
        """
        if not self._waiting:
            return
        before = self._marks()
        self._waiting.sort(key=_log_time)  # topics are not ordered against each other
        try:
            for topic, log_ns, message in self._waiting:
                self._writer.write(topic, log_ns, message)
            self._storage.close_chunk()
            self._storage.bio.flush()
            self._checksums.note_flushed()
        except OSError as error:
            raise self._given_up(before, error) from error
        self.n_messages += len(self._waiting)
        self._waiting.clear()
        self._waiting_byte = 0

    def remark(self, key: str, value: str) -> None:
        """Note something about the recording in its metadata."""
        self._writer.set_custom_data(key, value)

    def close(self) -> None:
        """Write what waits, then index and metadata.

        Raises:
            RecordingError: there is no space for them; what was flushed can be repaired.
        """
        if self._writer.storage is None:
            return
        self.flush()
        try:
            (self.folder / RESERVE).unlink(missing_ok=True)
            self._writer.close()
        except OSError as error:
            with suppress(OSError):
                self._writer.abort()
            raise self._left_open(error) from error
        finally:
            self._index.close()
        with suppress(OSError):  # the bag is whole without them
            self._checksums.finish()

    def _marks(self) -> dict[str, Any]:
        """What tells the state of the file before a chunk."""
        return {
            'end': self._storage.bio.tell(),
            'n_chunks': len(self._index),
            'counts': dict(self._writer.counts),
            'times': (self._writer.min_timestamp, self._writer.max_timestamp),
        }

    def _given_up(self, before: dict[str, Any], error: OSError) -> RecordingError:
        """Close without the messages that could not be written, and say so."""
        n_lost = len(self._waiting)
        self._waiting.clear()
        try:
            self._restore(before)
        except OSError as another:
            self._writer.storage = None
            self._index.close()
            return self._left_open(another)
        self.close()
        return RecordingError(
            f'recording ended early, {n_lost} messages could not be written: {error.strerror}; '
            f'{self.folder} holds the {self.n_messages} before'
        )

    def _left_open(self, error: OSError) -> RecordingError:
        return RecordingError(
            f'cannot close {self.folder} ({error.strerror}); '
            f'make room, then run: recorder --repair {self.folder}'
        )

    def _restore(self, before: dict[str, Any]) -> None:
        """Cut the file, and what rosbags knows of it, back to the last whole chunk."""
        storage, writer = self._storage, self._writer
        with suppress(OSError):
            storage.bio.close()  # tries to write the rest once more
        storage.bio = storage.path.open('r+b')
        storage.bio.truncate(before['end'])
        storage.bio.seek(before['end'])
        self._index.cut(before['n_chunks'])
        storage.chunk = PendingChunk(2**63 - 1, 0, BytesIO(), defaultdict(list))
        writer.counts.update(before['counts'])
        storage.channel_stats.update(before['counts'])
        writer.min_timestamp, writer.max_timestamp = before['times']
        storage.message_start_time, storage.message_end_time = before['times']


def compress_chunks(writer: Writer) -> None:
    """Let a writer, before it opens, compress chunks by zstd, as all readers of MCAP know it."""
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)


def _log_time(waiting: tuple[Connection, int, bytes]) -> int:
    return waiting[1]


def _opened(folder: Path) -> tuple[Writer, Any]:
    """A new bag and its storage, where rosbags lets a chunk be ended at will."""
    if folder.suffix == '.bag':
        raise RecordingError(
            f'output folder {folder}: readers take a name that ends in .bag for a bag of ROS 1'
        )
    try:
        writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
        compress_chunks(writer)
        writer.open()
        storage: Any = writer.storage
        _prepare(folder, storage)
    except WriterError:
        raise RecordingError(f'output folder {folder} exists already') from None
    except OSError as error:
        rmtree(folder, ignore_errors=True)  # or the next try would find that it exists
        raise RecordingError(f'cannot record to {folder}: {error.strerror}') from error
    return writer, storage


def _prepare(folder: Path, storage: Any) -> None:  # noqa: ANN401 - rosbags exports no type
    """Keep room for the end of a new bag, and let nobody repair it meanwhile."""
    try:
        (folder / RESERVE).write_bytes(bytes(_RESERVE_BYTE))
        storage.chunks = ChunkIndex(folder)
        with suppress(OSError):  # not every network file system has locks
            fcntl.flock(storage.bio, fcntl.LOCK_EX | fcntl.LOCK_NB)  # no repair, please
        storage.bio.flush()
    except OSError:
        with suppress(OSError):
            storage.bio.close()
        raise


def _short(type_name: str) -> str:
    package, _, name = type_name.split('/')
    return f'{package}/{name}'


def _contained_type(field: Any) -> str | None:  # noqa: ANN401 - nested tuples of rosbags
    """The message type of a field or of its elements; None if it is a plain value."""
    kind, what = field
    if kind.name == 'NAME':
        return str(what)
    if kind.name in ('ARRAY', 'SEQUENCE'):
        return _contained_type(what[0])
    return None

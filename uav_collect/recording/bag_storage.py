"""Opens bags, however they are stored: MCAP or sqlite3, packed or not, with metadata or without.

All that says what is in a bag is in its files; metadata.yaml tells only which these are. So a bag
is read without it, too.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, ExitStack
from dataclasses import dataclass, field
from functools import cached_property
import heapq
from operator import itemgetter
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from textwrap import indent
from typing import Any, NamedTuple, Protocol
from urllib.parse import quote

from backports import zstd
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.storage_sqlite3 import apsw, Sqlite3Reader  # type: ignore[attr-defined]
from uav_collect import files
from uav_collect.config.yaml_text import MAX_BYTES, read_value
from uav_collect.errors import BagError, ConfigError, in_one_line
from uav_collect.recording.mcap_file import McapFile, read_mcap
from uav_collect.recording.mcap_records import (
    BrokenError,
    MOST_RECORD_BYTE,
    unpacked_message,
    ZSTD_MAGIC,
)
from uav_collect.recording.mission_folder import (
    bag_files,
    BAG_SUFFIXES,
    METADATA_FILE,
    PACKED,
)

_TOP = 'rosbag2_bagfile_information'
_LIBRARY = 'rosbags'  # writes into the file what it writes into metadata.yaml
_ROS1_MAGIC, _SQLITE_MAGIC = b'#ROSBAG V', b'SQLite format 3\0'
_MOST_TIMES = 100  # that a packed file becomes larger; bags become some ten times
_BLOCK_BYTE = 1 << 20
_SQLITE_ERRORS = (
    *(ReaderError, apsw.Error, AttributeError, KeyError, RecursionError, TypeError),
    ValueError,
)
_CONVERT = 'rosbags-convert makes one of ROS 2 of it'
_KINDS = 'a folder with metadata.yaml, an .mcap or a .db3 file'


class RecordedTopic(NamedTuple):
    """What a bag tells of a topic."""

    name: str
    type_name: str
    encoding: str  # of its type's definition: ros2msg or ros2idl; '' without one
    definition: str
    serialization: str  # of its messages
    qos: str  # that its publishers offered, as YAML


class _Storage(Protocol):
    """One file of a bag."""

    topics: dict[int, RecordedTopic]
    damages: list[str]
    n_messages: int

    def messages(self, topics: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        """Topic, log time and content of messages, by time."""


@dataclass(kw_only=True)
class Bag:
    """A bag that is open."""

    path: Path
    storages: list[_Storage]
    damages: list[str] = field(default_factory=list)  # of what it holds; grows while it is read
    harmless: set[str] = field(default_factory=set)  # those of them that cost no message
    remarks: list[str] = field(default_factory=list)  # on its metadata, which nothing depends on
    has_checksums: bool = False  # of everything in it
    metadata: dict[str, Any] = field(default_factory=dict)  # what metadata.yaml says
    copies: list[str] = field(default_factory=list)  # texts of the same in its files

    @cached_property
    def custom_data(self) -> dict[str, str]:
        """Remarks of its recorder by their keys."""
        says = (*map(_values_of, self.copies), self.metadata)
        found = next((it['custom_data'] for it in says if it.get('custom_data')), None)
        return {str(key): str(it) for key, it in found.items()} if isinstance(found, dict) else {}

    def messages(
        self, is_wanted: Callable[[RecordedTopic], bool]
    ) -> Iterator[tuple[RecordedTopic, int, bytes]]:
        """Topic, log time and content of the messages of some topics, by time.

        Raises:
            BagError: a file is not any more what it was when the bag was opened.
            OSError: one cannot be read any more.
        """
        n_broken: Counter[RecordedTopic] = Counter()
        streams = [self._messages_of(storage, is_wanted) for storage in self.storages]
        for topic, log_ns, content in heapq.merge(*streams, key=itemgetter(1)):
            if not content.startswith(ZSTD_MAGIC):
                yield topic, log_ns, content
                continue
            try:  # a message that was packed by itself: none begins so
                yield topic, log_ns, unpacked_message(content)
            except BrokenError:
                n_broken[topic] += 1
        self.damages += [
            f'topic {in_one_line(topic.name)}: {count} messages cannot be unpacked'
            for topic, count in n_broken.items()
        ]

    def _messages_of(
        self, storage: _Storage, is_wanted: Callable[[RecordedTopic], bool]
    ) -> Iterator[tuple[RecordedTopic, int, bytes]]:
        wanted = {key for key, topic in storage.topics.items() if is_wanted(topic)}
        n_damages = len(storage.damages)
        for key, log_ns, content in storage.messages(wanted) if wanted else ():
            yield storage.topics[key], log_ns, content
        self.damages += storage.damages[n_damages:]

    @property
    def n_messages(self) -> int:
        """How many messages its files hold."""
        return sum(storage.n_messages for storage in self.storages)

    @property
    def topics(self) -> list[RecordedTopic]:
        """The topics of all its files."""
        return [topic for storage in self.storages for topic in storage.topics.values()]


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open a bag, and find what of it is damaged.

    Raises:
        BagError: there is none that could be read: what it is instead, in one line.
    """
    with ExitStack() as closing:
        try:
            bag = _opened(path, closing)
        except OSError as error:
            raise BagError(f'{error.filename or path}: {error.strerror or error}') from error
        yield bag


class _Mcap:
    """An MCAP file of a bag."""

    def __init__(self, mcap: McapFile) -> None:
        self.damages = [str(damage) for damage in mcap.damages]
        self.n_messages = mcap.n_messages
        self._mcap = mcap
        self.topics = {}
        for key, channel in mcap.channels.items():
            schema = mcap.schemas.get(channel.schema)
            name, encoding, definition = ('', '', '') if schema is None else schema
            qos = channel.metadata.get('offered_qos_profiles', '')
            self.topics[key] = RecordedTopic(
                channel.topic, name, encoding, definition, channel.encoding, qos
            )

    def messages(self, topics: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        """Topic, log time and content of messages, by time."""
        return self._mcap.messages(topics)


class _Sqlite:
    """A database of a bag."""

    def __init__(self, path: Path, closing: ExitStack) -> None:
        with files.open_file(path) as (file, _):
            if file.read(len(_SQLITE_MAGIC)) != _SQLITE_MAGIC:
                raise BagError(f'{path}: is not an sqlite3 database')
        self._reader = Sqlite3Reader(Path(quote(str(path))))  # goes into a URI
        self.damages: list[str] = []
        try:
            self._reader.open()
            closing.callback(self._reader.close)
            found = [*self._reader.dbconn.execute('PRAGMA quick_check(1)')]  # type: ignore[union-attr]
        except _SQLITE_ERRORS as error:
            raise BagError(f'{path}: cannot be read, {in_one_line(str(error))}') from error
        if found != [('ok',)]:
            self.damages.append(f'the database is damaged: {in_one_line(str(found[0][0]))}')
        log = path.with_name(f'{path.name}-wal')
        if log.is_file() and log.stat().st_size:
            self.damages.append(f'its recorder was cut off, {log.name} is not read')
        self.n_messages = self._reader.metadata.message_count
        self.topics: dict[int, RecordedTopic] = {}
        for it in self._reader.connections:
            encoding = {'MSG': 'ros2msg', 'IDL': 'ros2idl'}.get(it.msgdef.format.name, '')
            serialization = getattr(it.ext, 'serialization_format', '')
            topic = RecordedTopic(
                it.topic, it.msgtype, encoding, it.msgdef.data, serialization, ''
            )
            if all(isinstance(value, str) for value in topic):
                self.topics[it.id] = topic
            else:
                self.damages.append('a topic of the database is damaged')

    def messages(self, topics: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        """Topic, log time and content of messages, by time."""
        connections = [it for it in self._reader.connections if it.id in topics]
        n_broken = 0
        try:
            for connection, log_ns, content in self._reader.messages(connections):
                if isinstance(log_ns, int) and isinstance(content, bytes):
                    yield connection.id, log_ns, content
                else:
                    n_broken += 1
        except _SQLITE_ERRORS as error:
            self.damages.append(f'the database cannot be read further: {in_one_line(str(error))}')
        if n_broken:
            self.damages.append(f'{n_broken} messages of the database are damaged')


def _opened(path: Path, closing: ExitStack) -> Bag:
    text = ''
    metadata: dict[str, Any] = {}
    remarks: list[str] = []
    if not path.exists():
        raise BagError(f'{path}: no such bag')
    if path.is_dir():
        text, metadata = _metadata_of(path, remarks)
        found, missing = _listed_files(path, metadata)
    else:
        found, missing = [path], []
    bag = Bag(path=path, storages=[], remarks=remarks)
    bag.damages += [f'{name} is missing' for name in missing]
    mcaps = [_open_file(bag, file, closing) for file in found]
    bag.has_checksums = bool(mcaps) and all(it is not None and it.has_checksums for it in mcaps)
    copies = [it.metadata for it in mcaps if it is not None and it.metadata is not None]
    is_own = [it.library.startswith(_LIBRARY) for it in mcaps if it is not None] == [True]
    if metadata and is_own and len(copies) == 1 and bag.has_checksums:
        remarks += _difference(text, metadata, copies[0])
    bag.copies, bag.metadata = copies, metadata
    return bag


def _open_file(bag: Bag, file: Path, closing: ExitStack) -> McapFile | None:
    """Open a file of a bag; what an MCAP file says of itself."""
    name = file.name
    if name.endswith(PACKED):
        file = _unpacked_file(file, closing)
    with files.open_file(file) as (content, _):
        begin = content.read(len(_SQLITE_MAGIC))
    if begin.startswith(_ROS1_MAGIC):
        raise BagError(f'{file}: is a bag of ROS 1: {_CONVERT}')
    mcap: McapFile | None = None
    storage: _Storage
    if begin == _SQLITE_MAGIC:
        storage = _Sqlite(file, closing)
    elif begin.startswith(b'\x89MCAP') or file.suffix == '.mcap':
        mcap = read_mcap(file)
        storage = _Mcap(mcap)
        bag.harmless |= {f'{name}: {damage}' for damage in mcap.damages if not damage.is_loss}
    else:
        raise BagError(f'{file}: is no bag, must be {_KINDS}')
    bag.storages.append(storage)
    bag.damages += [f'{name}: {damage}' for damage in storage.damages]
    return mcap


def _listed_files(folder: Path, metadata: dict[str, Any]) -> tuple[list[Path], list[str]]:
    """The files of a bag, and the names of those that are missing.

    Raises:
        BagError: there is none.
    """
    there = bag_files(folder)
    listed = metadata.get('relative_file_paths')
    listed_names = [PurePath(str(it)).name for it in listed] if isinstance(listed, list) else []
    names = [_name_there(folder, name) for name in listed_names]
    missing = [name for name in names if not (folder / name).exists()]
    found = [folder / name for name in names if name and name not in missing] or there
    if found:
        return found, missing
    if any(folder.glob('*.bag')):
        raise BagError(f'{folder}: holds a bag of ROS 1: {_CONVERT}')
    has_metadata = (folder / METADATA_FILE).exists()
    has = f'it has {METADATA_FILE}, but none' if has_metadata else 'it has none'
    raise BagError(f'{folder}: not a bag, {has} of the files {", ".join(BAG_SUFFIXES)}')


def _name_there(folder: Path, name: str) -> str:
    """What a file of a bag is called now: it may have been packed since its bag was recorded."""
    packed = f'{name}{PACKED}'
    return packed if not (folder / name).exists() and (folder / packed).exists() else name


def _metadata_of(folder: Path, remarks: list[str]) -> tuple[str, dict[str, Any]]:
    """The text of metadata.yaml and what it says; nothing if it is missing, or none, remarked."""
    file = folder / METADATA_FILE
    if not file.exists():
        return '', {}  # all that matters is in the bag's file
    try:
        text = files.read_bounded(file, MAX_BYTES).decode()
    except OSError as error:
        remarks.append(f'{METADATA_FILE}: {error.strerror}')
        return '', {}
    except UnicodeDecodeError as error:
        remarks.append(f'{METADATA_FILE}: is not UTF-8 text at byte {error.start}')
        return '', {}
    values = _values_of(text).get(_TOP)
    if not isinstance(values, dict):
        remarks.append(f'{METADATA_FILE}: is not the metadata of a bag')
        return '', {}
    return text, values


def _values_of(text: str) -> dict[str, Any]:
    """The mapping that a YAML text stands for; an empty one if it stands for none."""
    try:
        values, _ = read_value(text, METADATA_FILE)
    except ConfigError:
        return {}
    return values if isinstance(values, dict) else {}


def _difference(text: str, mine: dict[str, Any], copy: str) -> list[str]:
    """How metadata.yaml differs from its copy in the bag's file."""
    if text == f'{_TOP}:\n{indent(copy, "  ")}':
        return []
    its = _values_of(copy)
    for name in [*its, *mine]:
        if mine.get(name) != its.get(name):
            return [f'{METADATA_FILE}: {name} is not that of the copy in the bag']
    return []


def _unpacked_file(file: Path, closing: ExitStack) -> Path:
    """A packed file, unpacked for as long as the bag is open.

    Raises:
        BagError: it is none, or becomes larger than any bag.
        OSError: the temporary folder does not hold it; naming the file there.
    """
    folder = closing.enter_context(TemporaryDirectory())
    target = Path(folder) / file.name.removesuffix(PACKED)
    with files.open_file(file) as (packed, n_byte), target.open('wb') as unpacked:
        most_byte = _MOST_TIMES * n_byte + MOST_RECORD_BYTE
        try:
            with zstd.open(packed, 'rb') as content:
                while block := content.read(_BLOCK_BYTE):
                    with files.naming(target):  # it is that disk that is full
                        unpacked.write(block)
                        unpacked.flush()
                    if unpacked.tell() > most_byte:
                        raise BagError(f'{file}: unpacks to more than {most_byte:,} bytes')
        except (EOFError, zstd.ZstdError) as error:
            raise BagError(f'{file}: cannot be unpacked, {in_one_line(str(error))}') from error
    return target

"""Makes a recording readable again whose recorder was killed, or whose file is damaged.

The file of such a recording ends in the middle of a chunk and has no index, or some of its chunks
are not as they were written. All that is whole goes into a new file that takes its place; the
broken one is kept beside it. A repair that fails leaves all as it was, one that was killed can be
repeated.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
import fcntl
import filecmp
from pathlib import Path
import re
import shutil
from tempfile import TemporaryDirectory

from rosbags.interfaces import Connection, Qos
from rosbags.rosbag2 import ReaderError, StoragePlugin, Writer, WriterError
from rosbags.rosbag2.metadata import parse_qos
from rosbags.typesys.store import Typestore
from uav_collect import files
from uav_collect.errors import BagError, in_one_line
from uav_collect.recording.bag_checksums import BagChecksums
from uav_collect.recording.bag_messages import DEFINITION_ERRORS, types_of
from uav_collect.recording.bag_storage import Bag, open_bag, RecordedTopic
from uav_collect.recording.bag_writer import compress_chunks, RESERVE
from uav_collect.recording.log_times import StampReader
from uav_collect.recording.message_heads import FieldKind
from uav_collect.recording.mission_folder import METADATA_FILE

_CLOCK = 'rosgraph_msgs/msg/Clock'
_OWN_TYPES = 'uav_collect_msgs/'
_BROKEN = '.broken'  # behind the name of what is kept; then .broken.2, .broken.3 and so on
_KEPT = re.compile(rf'.*\.mcap{re.escape(_BROKEN)}(\.[1-9][0-9]*)?', re.DOTALL)
_WORK = '.repairing-'  # what the folder of a repair begins with
_LEFT_OUT = 'left out by repair'  # key of a remark


@dataclass(frozen=True, kw_only=True)
class Repair:
    """What a bag holds, and what was done to it."""

    n_messages: int
    last_sim_time_s: float | None  # latest simulated time in it, None without any
    broken_file: Path | None  # where the broken file is kept; None if the bag was whole
    left_out: tuple[str, ...] = ()  # what of the broken file is lost, one line each
    remarks: tuple[str, ...] = ()  # what else of it was damaged, without a loss


class _Clock:
    """Finds the latest simulated time among messages."""

    def __init__(self) -> None:
        self.last_s: float | None = None
        self._stamps: dict[RecordedTopic, StampReader | None] = {}

    def take(self, topic: RecordedTopic, content: bytes) -> None:
        if topic not in self._stamps:
            self._stamps[topic] = _stamp_reader(topic)
        reader = self._stamps[topic]
        stamp_ns = None if reader is None else reader.read_ns(content)
        if stamp_ns is not None:
            self.last_s = max(stamp_ns / 1e9, self.last_s or 0.0)


def repair(bag: Path) -> Repair:
    """Make a bag readable; a bag that is whole already is left alone.

    Args:
        bag: folder of the bag, or the .mcap file in it.

    Raises:
        BagError: there is no bag, it is still being written, or it is not of this kind.
        OSError: the new file cannot be written; all is as it was before.
    """
    folder = bag if bag.is_dir() else bag.parent
    source = _source(bag, folder)
    with _locked(source):
        clock = _Clock()
        with open_bag(source) as opened:
            if _is_whole(opened, folder):
                for topic, _, content in opened.messages(_tells_time):
                    clock.take(topic, content)
                return Repair(
                    n_messages=opened.n_messages,
                    last_sim_time_s=clock.last_s,
                    broken_file=None,
                )
            for leftover in folder.glob(f'{_WORK}*'):  # of a repair that was killed
                shutil.rmtree(leftover, ignore_errors=True)
            with TemporaryDirectory(prefix=_WORK, dir=folder) as work:
                name = source.name.partition('.mcap')[0]
                remarks = [it for it in opened.damages if it in opened.harmless]
                left_out = [it for it in opened.damages if it not in opened.harmless]
                n_messages = _copy(opened, Path(work) / name, clock, left_out)
                kept = _swap(source, Path(work) / name)
    return Repair(
        n_messages=n_messages,
        last_sim_time_s=clock.last_s,
        broken_file=kept,
        left_out=tuple(left_out),
        remarks=tuple(remarks),
    )


def _source(bag: Path, folder: Path) -> Path:
    """The file to read: what a repair that was killed has put aside, or the bag's only one."""
    if bag != folder and bag.suffix != '.mcap':
        with open_bag(bag):  # says what it is if it is no bag
            raise BagError(f'{bag}: is no .mcap file: only these are repaired')
    if not bag.exists():
        raise BagError(f'{bag}: no such bag')
    found = sorted(folder.glob('*.mcap'))
    if not found:
        targets = {file.with_name(file.name.partition(_BROKEN)[0]) for file in _kept_in(folder)}
        found = [_kept_of(target)[-1] for target in sorted(targets)]
    if len(found) == 1:
        return found[0]
    raise BagError(f'{folder}: must hold one .mcap file to repair, holds {len(found)}')


def _kept_in(folder: Path) -> Iterator[Path]:
    return (it for it in folder.glob(f'*.mcap{_BROKEN}*') if _KEPT.fullmatch(it.name))


def _kept_of(target: Path) -> list[Path]:
    """The broken files that repairs of one have kept, the latest last."""
    own = [it for it in _kept_in(target.parent) if it.name.startswith(f'{target.name}{_BROKEN}')]
    return sorted(own, key=lambda it: (len(it.name), it.name))


@contextmanager
def _locked(source: Path) -> Iterator[None]:
    """Keep recorders from a file, unless one has it."""
    with files.open_file(source) as (file, _):
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            folder = source.parent
            raise BagError(f'{folder}: is still being recorded, stop the recorder first') from None
        except OSError:
            pass  # a file system without locks cannot tell
        yield


def _is_whole(file: Bag, folder: Path) -> bool:
    """Whether a bag's file and its metadata are as they were written."""
    if file.damages or not (folder / METADATA_FILE).is_file():
        return False
    with open_bag(folder) as bag:
        return not (bag.damages or bag.remarks)


def _copy(bag: Bag, folder: Path, clock: _Clock, left_out: list[str]) -> int:
    """Write all that is whole of a bag to a new one; the number of messages.

    Args:
        left_out: takes what has no place in the new one.
    """
    n_messages = 0
    new = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    compress_chunks(new)
    with new as writer:
        checksums = BagChecksums(writer.storage)
        topics: dict[RecordedTopic, Connection] = {}
        for topic in dict.fromkeys(bag.topics):
            try:
                topics[topic] = _added(writer, topic)
            except (*DEFINITION_ERRORS, WriterError) as error:
                left_out.append(f'topic {in_one_line(topic.name)}: {in_one_line(str(error))}')
        n_damages = len(bag.damages)
        for topic, log_ns, content in bag.messages(topics.__contains__):
            writer.write(topics[topic], log_ns, content)
            clock.take(topic, content)
            n_messages += 1
        left_out += bag.damages[n_damages:]  # those that only reading has shown
        for key, value in bag.custom_data.items():
            writer.set_custom_data(key, value)
        if left_out:
            writer.set_custom_data(_LEFT_OUT, '; '.join(left_out))
    checksums.finish()
    return n_messages


def _added(writer: Writer, topic: RecordedTopic) -> Connection:
    types = types_of(topic)
    return writer.add_connection(
        topic.name,
        topic.type_name,
        typestore=types,
        msgdef=topic.definition,
        rihs01=types.hash_rihs01(topic.type_name),
        serialization_format=topic.serialization,
        offered_qos_profiles=_qos_of(topic),
    )


def _qos_of(topic: RecordedTopic) -> list[Qos]:
    """The QoS that its publishers offered; none where the bag's words for it make no sense."""
    with suppress(ReaderError, AttributeError, KeyError, RecursionError, TypeError, ValueError):
        return parse_qos(topic.qos)
    return []


def _tells_time(topic: RecordedTopic) -> bool:
    return topic.type_name == _CLOCK or topic.type_name.startswith(_OWN_TYPES)


def _stamp_reader(topic: RecordedTopic) -> StampReader | None:
    """What reads the stamps of a topic's messages; None if they have none in simulated time."""
    if not _tells_time(topic):
        return None
    try:
        types: Typestore = types_of(topic)
    except DEFINITION_ERRORS:
        return None

    def fields_of(type_name: str) -> Sequence[tuple[str, FieldKind]]:
        _, fields = types.fielddefs[type_name]
        return fields

    return StampReader(topic.type_name, fields_of)


def _swap(source: Path, work: Path) -> Path:
    """Put the new bag in place of the broken one, metadata last; returns where that is kept."""
    folder = source.parent
    target = folder / f'{work.name}.mcap'
    before = _kept_of(target)
    is_moved = source not in before
    if is_moved and before and filecmp.cmp(source, work / target.name, shallow=False):
        is_moved = False  # a repair was killed that had only to move the metadata
    kept = _next_kept(target, before) if is_moved else before[-1]
    if is_moved:
        source.replace(kept)
    try:
        (work / target.name).replace(target)
        (work / METADATA_FILE).replace(folder / METADATA_FILE)
    except BaseException:
        if is_moved:
            kept.replace(target)
        raise
    (folder / RESERVE).unlink(missing_ok=True)
    return kept


def _next_kept(target: Path, before: Sequence[Path]) -> Path:
    first = f'{target.name}{_BROKEN}'
    if not before:
        return target.with_name(first)
    number = int(before[-1].name.removeprefix(first).removeprefix('.') or 1)
    return target.with_name(f'{first}.{number + 1}')

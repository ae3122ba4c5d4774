"""Bags are read however they are stored, and what is none is said in one line, at once."""

from collections.abc import Callable
import os
from pathlib import Path
import shutil
import sqlite3

from backports import zstd
from bag_damage import changed_byte, copied
from bags import HandMadeBag
from full_disk import no_file_beyond
import pytest
from rosbags.rosbag2 import CompressionMode, StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores
from uav_collect.config.yaml_text import MAX_BYTES
from uav_collect.errors import BagError
from uav_collect.missions.rollout import fly
from uav_collect.recording import bag_storage
from uav_collect.recording.bag_reader import read_missions, read_recording
from uav_collect.recording.bag_repair import repair
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import load
from uav_collect.scenario.site import build_site, Site


@pytest.fixture(scope='module')
def site() -> Site:
    return build_site(load('paper_8x8'))


@pytest.fixture(scope='module')
def log(site: Site) -> MissionLog:
    return fly(site, [3], 'sweep')[0]


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory, site: Site, log: MissionLog) -> Path:
    folder = tmp_path_factory.mktemp('recorded') / 'bag'
    recorded = HandMadeBag(folder, chunk_byte=2_000, step_ns=1_000_000_000)
    recorded.add_scenario(site)
    recorded.add_mission(log, 'world-1', n_radio_messages=2)
    recorded.writer.close()
    return folder


def only_file(folder: Path) -> Path:
    [file] = [each for each in folder.iterdir() if each.name != 'metadata.yaml']
    return file


@pytest.mark.parametrize('storage', [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
@pytest.mark.parametrize(
    'packed', [CompressionMode.NONE, CompressionMode.MESSAGE, CompressionMode.FILE]
)
def test_a_bag_is_read_whatever_its_storage(
    tmp_path: Path, bag: Path, log: MissionLog, storage: StoragePlugin, packed: CompressionMode
) -> None:
    other = copied(bag, tmp_path / 'other', storage, packed).rename(tmp_path / '#1?%20')
    [mission] = read_missions(other)
    assert mission.log.to_jsonl() == log.to_jsonl()
    assert mission.n_radio_messages == 2
    assert mission.is_complete


@pytest.mark.parametrize('storage', [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
@pytest.mark.parametrize(
    'packed', [CompressionMode.NONE, CompressionMode.MESSAGE, CompressionMode.FILE]
)
@pytest.mark.parametrize('by_file', [False, True])
def test_a_file_alone_is_a_bag(
    tmp_path: Path, bag: Path, log: MissionLog, storage: StoragePlugin, packed: CompressionMode,
    by_file: bool,
) -> None:  # fmt: skip
    other = copied(bag, tmp_path / 'other', storage, packed)
    (other / 'metadata.yaml').unlink()
    [mission] = read_missions(only_file(other) if by_file else other)
    assert mission.log.to_jsonl() == log.to_jsonl()


def test_a_bag_of_several_files_is_one(tmp_path: Path, bag: Path, site: Site) -> None:
    [second] = fly(site, [4], 'sweep')
    other = HandMadeBag(tmp_path / 'second')
    other.add_scenario(site)
    other.add_mission(second, 'world-2')
    other.writer.close()
    folder = tmp_path / 'split'
    folder.mkdir()
    shutil.copy(only_file(bag), folder / 'bag_0.mcap')
    shutil.copy(only_file(tmp_path / 'second'), folder / 'bag_1.mcap')
    seeds = [mission.log.header.mission_seed for mission in read_missions(folder)]
    assert sorted(seeds) == [3, 4]


def test_a_file_that_metadata_names_and_that_is_gone_is_missing(tmp_path: Path, bag: Path) -> None:
    folder = tmp_path / 'bag'
    shutil.copytree(bag, folder)
    metadata = folder / 'metadata.yaml'
    text = metadata.read_text()
    metadata.write_text(text.replace('- bag.mcap\n', '- bag.mcap\n  - bag_1.mcap\n', 1))
    assert metadata.read_text() != text
    recording = read_recording(folder)
    assert f'{folder}: bag_1.mcap is missing' in recording.damages
    assert not recording.missions[0].is_complete


@pytest.mark.parametrize('stays', [True, False])
def test_a_file_that_somebody_packed_afterwards_is_there(
    tmp_path: Path, bag: Path, log: MissionLog, stays: bool
) -> None:
    folder = tmp_path / 'bag'
    shutil.copytree(bag, folder)
    file = only_file(folder)
    file.with_name(f'{file.name}.zstd').write_bytes(zstd.compress(file.read_bytes()))
    if not stays:
        file.unlink()
    [mission] = read_missions(folder)
    assert mission.log.to_jsonl() == log.to_jsonl()
    assert mission.is_complete


@pytest.mark.parametrize('content', [b'\xff\xfe', b'a: [', b'[1]', b'a: &a [*a]'])
def test_metadata_that_is_none_costs_nothing_but_a_line(
    tmp_path: Path, bag: Path, log: MissionLog, content: bytes
) -> None:
    folder = tmp_path / 'bag'
    shutil.copytree(bag, folder)
    (folder / 'metadata.yaml').write_bytes(content)
    recording = read_recording(folder)
    [line] = recording.damages
    assert line.startswith(f'{folder}: metadata.yaml: is not ')
    assert recording.missions[0].log.to_jsonl() == log.to_jsonl()
    assert recording.missions[0].is_complete
    with pytest.raises(BagError, match=r'metadata\.yaml: is not '):
        read_missions(folder)


def test_metadata_that_is_too_large_is_not_read(
    tmp_path: Path, bag: Path, log: MissionLog
) -> None:
    folder = tmp_path / 'bag'
    shutil.copytree(bag, folder)
    with (folder / 'metadata.yaml').open('ab') as metadata:
        metadata.write(b'#' * MAX_BYTES)
    n_byte = (folder / 'metadata.yaml').stat().st_size
    recording = read_recording(folder)
    assert recording.damages == [
        f'{folder}: metadata.yaml: has {n_byte:,} bytes: must have at most {MAX_BYTES:,}'
    ]
    assert recording.missions[0].log.to_jsonl() == log.to_jsonl()


def test_a_damaged_chunk_is_named_and_what_is_whole_is_read(
    tmp_path: Path, bag: Path, log: MissionLog
) -> None:
    file = tmp_path / 'bag.mcap'
    shutil.copy(only_file(bag), file)
    content = bytearray(file.read_bytes())
    content[len(content) // 3] ^= 1
    file.write_bytes(content)
    recording = read_recording(file)
    [damage] = recording.damages
    assert damage.startswith(f'{file}: bag.mcap: chunk ')
    assert ' bytes ' in damage
    assert ' simulated time ' in damage
    [mission] = recording.missions
    assert not mission.is_complete
    assert 0 < len(mission.log.events) < len(log.events)
    whole = {event.tobytes() for event in log.events}
    assert all(event.tobytes() in whole for event in mission.log.events)
    with pytest.raises(BagError, match=r'chunk .* keeps what is whole'):
        read_missions(file)


def test_a_damaged_database_is_named(tmp_path: Path, bag: Path) -> None:
    file = only_file(copied(bag, tmp_path / 'other'))
    content = bytearray(file.read_bytes())
    content[-4096:] = bytes(4096)
    file.write_bytes(content)
    try:
        recording = read_recording(file)
    except BagError as error:
        assert 'database' in str(error)
    else:
        assert 'the database' in recording.damages[0]
        assert not recording.missions[0].is_complete


def test_a_database_whose_recorder_was_cut_off_lacks_something(tmp_path: Path, bag: Path) -> None:
    file = only_file(copied(bag, tmp_path / 'other'))
    file.with_name(f'{file.name}-wal').write_bytes(bytes(100))
    recording = read_recording(file)
    assert 'its recorder was cut off' in recording.damages[0]
    assert not recording.missions[0].is_complete


def of_ros_1(path: Path) -> None:
    path.write_bytes(b'#ROSBAG V2.0\n' + bytes(4096))


def sparse(path: Path) -> None:
    with path.open('wb') as file:
        file.truncate(2**40)


def database_of_others(path: Path) -> None:
    connection = sqlite3.connect(path)
    connection.execute('CREATE TABLE birds (name TEXT)')
    connection.commit()
    connection.close()


@pytest.mark.parametrize(
    ('name', 'make', 'words'),
    [
        ('nowhere', lambda _: None, 'nowhere: no such bag'),
        ('empty', Path.mkdir, 'empty: not a bag, it has none of the files .mcap, .db3'),
        ('a.bag', of_ros_1, 'a.bag: is a bag of ROS 1: rosbags-convert'),
        ('a.mcap', of_ros_1, 'a.mcap: is a bag of ROS 1: rosbags-convert'),
        ('a.mcap', os.mkfifo, 'a.mcap: is a pipe or a device: must be a file'),
        ('a.db3', os.mkfifo, 'a.db3: is a pipe or a device: must be a file'),
        ('a.mcap', sparse, 'a.mcap: is not an MCAP file'),
        ('a.db3', sparse, 'a.db3: is no bag, must be'),
        ('a.db3', database_of_others, 'a.db3: cannot be read, '),
        ('a.mcap.zstd', sparse, 'a.mcap.zstd: cannot be unpacked, '),
        ('a.mcap', Path.touch, 'a.mcap: is not an MCAP file'),
        ('a.mcap', Path.mkdir, 'a.mcap: not a bag, it has none of the files'),
        ('a.txt', lambda path: path.write_text('hello'), 'a.txt: is no bag, must be'),
    ],
)
def test_what_is_no_bag_is_said_in_one_line(
    tmp_path: Path, name: str, make: Callable[[Path], object], words: str
) -> None:
    make(tmp_path / name)
    with pytest.raises(BagError) as raised:
        read_recording(tmp_path / name)
    assert f'{tmp_path}/{words}' in str(raised.value)
    assert '\n' not in str(raised.value)


def test_a_folder_with_a_bag_of_ros_1_says_so(tmp_path: Path) -> None:
    of_ros_1(tmp_path / 'a.bag')
    with pytest.raises(BagError, match='holds a bag of ROS 1'):
        read_missions(tmp_path)


def test_messages_of_another_package_on_a_topic_of_ours_are_named(tmp_path: Path) -> None:
    types = get_typestore(Stores.ROS2_JAZZY)
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection('/world/epoch', 'std_msgs/msg/String', typestore=types)
        writer.write(topic, 1, bytes(8))
    with pytest.raises(BagError) as raised:
        read_recording(tmp_path / 'bag')
    assert str(raised.value) == (
        f'{tmp_path}/bag: topic /world/epoch: its type is std_msgs/msg/String:'
        ' must be uav_collect_msgs/msg/Epoch'
    )


def test_a_changed_byte_of_metadata_is_seen(tmp_path: Path, bag: Path) -> None:
    folder = tmp_path / 'bag'
    shutil.copytree(bag, folder)
    changed_byte(folder / 'metadata.yaml', b'cdr')
    [line] = read_recording(folder).damages
    assert line.endswith(
        'metadata.yaml: topics_with_message_count is not that of the copy in the bag'
    )


@pytest.mark.parametrize('definition', ['Nowhere x\n', 'int64 event\n', 'x', 'Epoch x\n'])
def test_a_type_that_is_not_that_of_this_version_is_named(tmp_path: Path, definition: str) -> None:
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection(
            '/world/epoch', 'uav_collect_msgs/msg/Epoch', msgdef=definition, rihs01='RIHS01_0'
        )
        writer.write(topic, 1, bytes(8))
    with pytest.raises(BagError) as raised:
        read_recording(tmp_path / 'bag')
    assert str(raised.value).startswith(f'{tmp_path}/bag: topic /world/epoch: ')
    assert str(raised.value).isprintable()


def test_a_bag_whose_messages_no_reader_knows_is_repaired_without_them(tmp_path: Path) -> None:
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for name, definition in (('/a\x1b[31m', 'Nowhere x\n'), ('/b', 'int32 x\n')):
            topic = writer.add_connection(
                name, f'others/msg/Thing{name[1].upper()}',
                msgdef=definition, rihs01='RIHS01_0',
            )  # fmt: skip
            writer.write(topic, 1, bytes(8))
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    done = repair(tmp_path / 'bag')
    assert done.n_messages == 1
    [left_out] = done.left_out
    assert left_out.startswith('topic /a\\x1b[31m: ')


def test_a_packed_file_that_becomes_too_large_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bag_storage, 'MOST_RECORD_BYTE', 0)
    file = tmp_path / 'a.mcap.zstd'
    file.write_bytes(zstd.compress(bytes(50_000_000)))
    with pytest.raises(BagError, match=r'a\.mcap\.zstd: unpacks to more than .* bytes'):
        read_missions(file)


def test_a_temporary_folder_that_is_full_is_named_not_the_packed_bag(tmp_path: Path) -> None:
    file = tmp_path / 'a.mcap.zstd'
    file.write_bytes(zstd.compress(bytes(50_000)))
    with no_file_beyond(10_000), pytest.raises(BagError, match='File too large') as refused:
        read_missions(file)
    named = str(refused.value).removesuffix(': File too large')
    assert named.endswith('/a.mcap')
    assert not named.startswith(str(tmp_path))


def test_messages_that_cannot_be_unpacked_are_counted_by_topic(
    tmp_path: Path, bag: Path, log: MissionLog
) -> None:
    recorded = HandMadeBag(tmp_path / 'other')
    recorded.add_scenario(build_site(load('paper_8x8')))
    recorded.add_mission(log, 'world-1')
    for _ in range(3):
        recorded.add_bytes('/world/epoch', b'\x28\xb5\x2f\xfd' + bytes(40))
    recorded.writer.close()
    recording = read_recording(tmp_path / 'other')
    assert recording.damages == [
        f'{tmp_path}/other: topic /world/epoch: 3 messages cannot be unpacked'
    ]
    assert recording.missions[0].log.to_jsonl() == log.to_jsonl()


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ("UPDATE topics SET name = x'00' WHERE name LIKE '%rx'", 'a topic of the database'),
        ("UPDATE topics SET type = x'00' WHERE name LIKE '%rx'", 'a topic of the database'),
        ("UPDATE messages SET data = 'text' WHERE id = 3", '1 messages of the database'),
        ('UPDATE messages SET timestamp = 0.5 WHERE id = 3', '1 messages of'),
    ],
)
def test_a_value_of_another_kind_in_a_database_is_a_damage(
    tmp_path: Path, bag: Path, change: str, words: str
) -> None:
    file = only_file(copied(bag, tmp_path / 'other'))
    connection = sqlite3.connect(file)
    connection.execute(change)
    connection.commit()
    connection.close()
    recording = read_recording(file)
    assert words in recording.damages[0]
    assert not recording.missions[0].is_complete

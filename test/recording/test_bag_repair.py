"""A recording survives whatever ends its recorder: up to the last chunk it flushed."""

from collections.abc import Iterator
from contextlib import contextmanager
import errno
import os
from pathlib import Path
import random
import re
import shutil
import struct

from bags import HandMadeBag, QOS
from full_disk import no_file_beyond
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from uav_collect.errors import BagError, RecordingError
from uav_collect.recording.bag_repair import Repair, repair
from uav_collect.recording.bag_storage import open_bag

PER_CHUNK = 10
N_CHUNKS = 6
TOPIC = '/uav_1/radio_rx'


def write_radio(bag: HandMadeBag, numbers: range) -> None:
    for number in numbers:
        stamp = {'sec': number, 'nanosec': 500_000_000}
        noise = np.frombuffer(random.Random(number).randbytes(40), dtype=np.uint8)
        bag.add(TOPIC, 'RadioMessage', sequence=number, stamp=stamp, complete=noise)


def killed(folder: Path) -> list[int]:
    """Leave a bag as a killed recorder does; where each of its chunks ends in the file."""
    bag = HandMadeBag(folder.with_name('alive') / folder.name)
    file = bag.writer.folder / f'{folder.name}.mcap'
    ends = [file.stat().st_size]
    for chunk in range(N_CHUNKS):
        write_radio(bag, range(chunk * PER_CHUNK, (chunk + 1) * PER_CHUNK))
        bag.writer.flush()
        ends.append(file.stat().st_size)
    write_radio(bag, range(1000, 1005))  # waits in memory, and is lost
    shutil.copytree(bag.writer.folder, folder)
    bag.writer.close()
    return ends


def sequences(folder: Path) -> list[int]:
    with AnyReader([folder]) as reader:
        return [
            reader.deserialize(content, connection.msgtype).sequence
            for connection, _, content in reader.messages()
        ]


@pytest.fixture(scope='module')
def torn(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[int]]:
    folder = tmp_path_factory.mktemp('torn') / 'bag'
    return folder, killed(folder)


def copy_of(torn: tuple[Path, list[int]], folder: Path, cut_at: int | None = None) -> Path:
    shutil.copytree(torn[0], folder / 'bag')
    if cut_at is not None:
        with (folder / 'bag' / 'bag.mcap').open('r+b') as file:
            file.truncate(cut_at)
    return folder / 'bag'


def test_all_flushed_messages_of_a_killed_recorder_are_recovered(
    tmp_path: Path, torn: tuple[Path, list[int]]
) -> None:
    bag = copy_of(torn, tmp_path)
    done = repair(bag)
    assert sequences(bag) == list(range(N_CHUNKS * PER_CHUNK))
    assert done == Repair(
        n_messages=60,
        last_sim_time_s=59.5,
        broken_file=bag / 'bag.mcap.broken',
        left_out=(),
        remarks=('bag.mcap: ends without a footer: its recorder was cut off, or the file',),
    )


@settings(max_examples=60, deadline=None)
@given(share=st.floats(0.0, 1.0))
def test_a_file_cut_anywhere_keeps_its_whole_chunks(
    tmp_path_factory: pytest.TempPathFactory, torn: tuple[Path, list[int]], share: float
) -> None:
    start, *ends = torn[1]
    cut_at = int(start + share * (ends[-1] - start))
    bag = copy_of(torn, tmp_path_factory.mktemp('cut'), cut_at)
    done = repair(bag)
    # A chunk's own end lies a little before that of its index, which is not needed.
    n_whole = done.n_messages // PER_CHUNK
    assert sum(end <= cut_at for end in ends) <= n_whole <= sum(end < cut_at for end in ends) + 1
    assert sequences(bag) == list(range(done.n_messages))
    assert done.n_messages % PER_CHUNK == 0


def test_the_broken_file_is_kept_as_it_was(tmp_path: Path, torn: tuple[Path, list[int]]) -> None:
    bag = copy_of(torn, tmp_path)
    before = (bag / 'bag.mcap').read_bytes()
    done = repair(bag)
    assert done.broken_file is not None
    assert done.broken_file.read_bytes() == before


def test_repairing_again_changes_nothing(tmp_path: Path, torn: tuple[Path, list[int]]) -> None:
    bag = copy_of(torn, tmp_path)
    first = repair(bag)
    before = {file: file.read_bytes() for file in bag.iterdir()}
    again = repair(bag)
    assert again.broken_file is None
    assert again.n_messages == first.n_messages
    assert again.last_sim_time_s == first.last_sim_time_s
    assert {file: file.read_bytes() for file in bag.iterdir()} == before


def flip(file: Path, at: int) -> bytes:
    content = bytearray(file.read_bytes())
    content[at] ^= 1
    file.write_bytes(content)
    return bytes(content)


def test_each_repair_keeps_its_own_broken_file(
    tmp_path: Path, torn: tuple[Path, list[int]]
) -> None:
    bag = copy_of(torn, tmp_path)
    kept = {}
    for name in ('bag.mcap.broken', 'bag.mcap.broken.2', 'bag.mcap.broken.3'):
        kept[bag / name] = flip(bag / 'bag.mcap', (bag / 'bag.mcap').stat().st_size // 2)
        assert repair(bag).broken_file == bag / name
    assert {file: file.read_bytes() for file in bag.glob('*.broken*')} == kept
    assert sorted(file.name for file in bag.iterdir()) == [
        *('bag.mcap', 'bag.mcap.broken', 'bag.mcap.broken.2', 'bag.mcap.broken.3'),
        'metadata.yaml',
    ]


def test_a_second_repair_that_was_interrupted_goes_on_from_the_later_file(
    tmp_path: Path, torn: tuple[Path, list[int]]
) -> None:
    bag = copy_of(torn, tmp_path)
    repair(bag)
    (bag / 'bag.mcap').rename(bag / 'bag.mcap.broken.2')
    shutil.copy(bag / 'bag.mcap.broken.2', bag / 'bag.mcap.broken.10')
    flip(bag / 'bag.mcap.broken.10', 3_000)
    done = repair(bag)
    assert done.broken_file == bag / 'bag.mcap.broken.10'
    assert done.n_messages == 0  # its one chunk is damaged


def chunked(folder: Path) -> tuple[Path, list[int]]:
    """A whole bag of three chunks; its file, and where each chunk with its index ends."""
    bag = HandMadeBag(folder, step_ns=1_000_000_000)
    file, ends = folder / 'bag.mcap', []
    for chunk in range(3):
        write_radio(bag, range(chunk * PER_CHUNK, (chunk + 1) * PER_CHUNK))
        bag.writer.flush()
        ends.append(file.stat().st_size)
    bag.writer.close()
    return file, ends


@pytest.mark.parametrize('place', ['index', 'length of an index', 'summary'])
def test_what_costs_no_message_is_not_left_out(tmp_path: Path, place: str) -> None:
    file, ends = chunked(tmp_path / 'bag')
    at = {'index': ends[0] - 4, 'summary': file.stat().st_size - 60}.get(place)
    if at is None:  # the index of the one channel: 6 bytes, and 16 for each message
        at = ends[0] - (6 + 16 * PER_CHUNK) - 2
    flip(file, at)
    done = repair(tmp_path / 'bag')
    assert (done.n_messages, done.left_out) == (3 * PER_CHUNK, ())
    [remark] = done.remarks
    assert remark.startswith('bag.mcap: ')
    if place == 'index':
        assert remark == 'bag.mcap: a record between chunks is damaged: the checksum differs'
    with open_bag(tmp_path / 'bag') as repaired:
        assert 'left out by repair' not in repaired.custom_data


def test_messages_that_cannot_be_unpacked_are_left_out(tmp_path: Path) -> None:
    bag = HandMadeBag(tmp_path / 'bag')
    write_radio(bag, range(4))
    bag.add_bytes(TOPIC, b'\x28\xb5\x2f\xfd' + bytes(40))
    bag.writer.close()
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    done = repair(tmp_path / 'bag')
    assert done.left_out == (f'topic {TOPIC}: 1 messages cannot be unpacked',)
    with open_bag(tmp_path / 'bag') as repaired:
        assert repaired.custom_data['left out by repair'] == done.left_out[0]


def test_a_healthy_bag_is_left_alone(tmp_path: Path) -> None:
    bag = HandMadeBag(tmp_path / 'bag')
    write_radio(bag, range(4))
    bag.writer.close()
    before = {file: file.read_bytes() for file in (tmp_path / 'bag').iterdir()}
    done = repair(tmp_path / 'bag')
    assert (done.n_messages, done.last_sim_time_s, done.broken_file) == (4, 3.5, None)
    assert {file: file.read_bytes() for file in (tmp_path / 'bag').iterdir()} == before


def test_the_wall_clock_time_of_a_scenario_is_no_simulated_time(tmp_path: Path) -> None:
    bag = HandMadeBag(tmp_path / 'bag')
    write_radio(bag, range(4))
    bag.add('/world/scenario', 'Scenario', stamp={'sec': 1_795_378_184})
    bag.writer.close()
    assert repair(tmp_path / 'bag').last_sim_time_s == 3.5


def test_types_hashes_and_qos_survive_a_repair(
    tmp_path: Path, torn: tuple[Path, list[int]]
) -> None:
    healthy = HandMadeBag(tmp_path / 'healthy')
    write_radio(healthy, range(1))
    healthy.writer.close()
    bag = copy_of(torn, tmp_path)
    repair(bag)
    with AnyReader([bag]) as repaired, AnyReader([tmp_path / 'healthy']) as expected:
        one, other = repaired.connections[0], expected.connections[0]
        assert (one.topic, one.msgtype, one.msgdef) == (other.topic, other.msgtype, other.msgdef)
        assert one.digest == other.digest
        assert one.ext == other.ext


def test_a_bag_killed_before_its_first_chunk_is_empty_but_readable(
    tmp_path: Path, torn: tuple[Path, list[int]]
) -> None:
    bag = copy_of(torn, tmp_path, cut_at=torn[1][0])
    assert repair(bag).n_messages == 0
    assert sequences(bag) == []
    assert repair(bag).last_sim_time_s is None


def test_a_bag_killed_just_before_its_metadata_loses_nothing(tmp_path: Path) -> None:
    bag = HandMadeBag(tmp_path / 'bag')
    write_radio(bag, range(4))
    bag.writer.close()
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    done = repair(tmp_path / 'bag')
    assert (done.n_messages, done.left_out) == (4, ())
    assert sequences(tmp_path / 'bag') == [0, 1, 2, 3]


def test_zeros_left_by_a_power_failure_are_cut_off(
    tmp_path: Path, torn: tuple[Path, list[int]]
) -> None:
    bag = copy_of(torn, tmp_path, cut_at=torn[1][3])
    with (bag / 'bag.mcap').open('ab') as file:
        file.write(bytes(5000))
    done = repair(bag)
    end = torn[1][3]
    [left_out] = done.left_out
    assert done.n_messages == 3 * PER_CHUNK
    assert left_out.startswith(f'bag.mcap: bytes {end} to {end + 5000}: ends without a footer')


def test_everything_but_a_damaged_chunk_is_recovered(
    tmp_path: Path, torn: tuple[Path, list[int]]
) -> None:
    bag = copy_of(torn, tmp_path)
    begin = torn[1][2]
    with (bag / 'bag.mcap').open('r+b') as file:
        file.seek(begin + 9 + 40 + 8)  # the first record of the third chunk
        file.write(struct.pack('<BQ', 5, 2**40))
    done = repair(bag)
    assert re.match(
        rf'bag.mcap: chunk 3, bytes {begin} to \d+, simulated time 0.000 s to 0.000 s: ',
        done.left_out[0],
    )
    lost = range(2 * PER_CHUNK, 3 * PER_CHUNK)
    assert sequences(bag) == [it for it in range(N_CHUNKS * PER_CHUNK) if it not in lost]


def test_where_records_cannot_be_followed_the_index_leads_to_the_next_chunk(
    tmp_path: Path,
) -> None:
    bag = HandMadeBag(tmp_path / 'bag', step_ns=1_000_000_000)
    ends = []
    for chunk in range(3):
        write_radio(bag, range(chunk * PER_CHUNK, (chunk + 1) * PER_CHUNK))
        bag.writer.flush()
        ends.append((tmp_path / 'bag' / 'bag.mcap').stat().st_size)
    bag.writer.close()
    with (tmp_path / 'bag' / 'bag.mcap').open('r+b') as file:
        file.seek(ends[0] + 1)
        file.write(struct.pack('<Q', 2**40))  # the length of the second chunk
    done = repair(tmp_path / 'bag')
    assert done.left_out == (
        f'bag.mcap: chunk 2, bytes {ends[0]} to {ends[1]}, simulated time 11.000 s to 20.000 s:'
        ' a record of 1,099,511,627,776 bytes cannot be there',
    )
    assert sequences(tmp_path / 'bag') == [*range(PER_CHUNK), *range(2 * PER_CHUNK, 3 * PER_CHUNK)]


@pytest.mark.parametrize('compression', list(CompressionType))
def test_a_damaged_chunk_is_left_out_however_it_is_compressed(
    tmp_path: Path, compression: CompressionType
) -> None:
    (tmp_path / 'bag').mkdir()
    with (tmp_path / 'bag' / 'bag.mcap').open('wb+') as file:
        writer = Writer(file, chunk_size=1, compression=compression)  # a chunk for each message
        writer.start()
        schema = writer.register_schema('std_msgs/msg/Int32', 'ros2msg', b'int32 data\n')
        channel = writer.register_channel('/number', 'cdr', schema)
        for number in range(3):
            chunk_start = file.tell()
            writer.add_message(channel, number, struct.pack('<Ii', 0x100, number), number)
        file.seek(chunk_start + 9 + 40 + 4)  # within its content, however compressed
        file.write(b'\xff' * 6)
    assert repair(tmp_path / 'bag').n_messages == 2


@pytest.mark.parametrize('n_steps', [0, 1, 2])
def test_an_interrupted_repair_can_be_repeated(
    tmp_path: Path,
    torn: tuple[Path, list[int]],
    monkeypatch: pytest.MonkeyPatch,
    n_steps: int,
) -> None:
    bag = copy_of(torn, tmp_path)
    before = (bag / 'bag.mcap').read_bytes()
    replace, steps = Path.replace, iter(range(n_steps))

    def interrupted(source: Path, target: Path) -> Path:
        is_own = source.suffix != '.tmp'  # rosbags uses that name
        if is_own and next(steps, None) is None:
            raise KeyboardInterrupt
        return replace(source, target)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Path, 'replace', interrupted)
        repair(bag)
    assert repair(bag).n_messages == N_CHUNKS * PER_CHUNK
    assert sequences(bag) == list(range(N_CHUNKS * PER_CHUNK))
    assert (bag / 'bag.mcap.broken').read_bytes() == before
    assert sorted(p.name for p in bag.iterdir()) == [
        'bag.mcap',
        'bag.mcap.broken',
        'metadata.yaml',
    ]


@pytest.mark.parametrize(
    ('name', 'content', 'words'),
    [
        ('a.bag', b'#ROSBAG V2.0\n', 'is a bag of ROS 1'),
        ('a.db3', b'SQLite format 3', 'is no bag'),
        ('a.txt', b'hello', 'is no bag'),
    ],
)
def test_a_file_of_another_kind_is_refused_and_its_neighbours_are_left_alone(
    tmp_path: Path, torn: tuple[Path, list[int]], name: str, content: bytes, words: str
) -> None:
    bag = copy_of(torn, tmp_path)
    (bag / name).write_bytes(content)
    before = {file: file.read_bytes() for file in bag.iterdir()}
    with pytest.raises(BagError, match=f'{name}: {words}'):
        repair(bag / name)
    assert {file: file.read_bytes() for file in bag.iterdir()} == before
    assert repair(bag / 'bag.mcap').n_messages == N_CHUNKS * PER_CHUNK


def test_a_bag_that_is_being_recorded_is_not_touched(tmp_path: Path) -> None:
    bag = HandMadeBag(tmp_path / 'bag')
    write_radio(bag, range(4))
    with pytest.raises(BagError, match='still being recorded'):
        repair(tmp_path / 'bag')
    bag.writer.close()
    assert sequences(tmp_path / 'bag') == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ('files', 'complaint'),
    [
        (None, 'no such bag'),
        ({}, 'must hold one .mcap file to repair, holds 0'),
        ({'a.mcap': b'', 'b.mcap': b''}, 'holds 2'),
        ({'a.mcap': b''}, 'a.mcap: is not an MCAP file'),
        ({'a.mcap': b'#!/bin/sh\necho not a bag'}, 'a.mcap: is not an MCAP file'),
    ],
)
def test_what_is_no_bag_is_refused_and_left_alone(
    tmp_path: Path, files: dict[str, bytes] | None, complaint: str
) -> None:
    bag = tmp_path / 'bag'
    if files is not None:
        bag.mkdir()
        for name, content in files.items():
            (bag / name).write_bytes(content)
    with pytest.raises(BagError, match=complaint):
        repair(bag)
    if files is not None:
        assert {p.name: p.read_bytes() for p in bag.iterdir()} == files


def test_a_full_disk_costs_only_what_did_not_fit(tmp_path: Path) -> None:
    folder = tmp_path / 'bag'
    bag = HandMadeBag(folder)
    write_radio(bag, range(1000))
    bag.writer.flush()
    flushed_byte = (folder / 'bag.mcap').stat().st_size
    write_radio(bag, range(1000, 3000))
    with (
        no_file_beyond(flushed_byte + 50_000),  # enough for the index, not for the messages
        pytest.raises(RecordingError, match='2000 messages could not be written') as failure,
    ):
        bag.writer.flush()
    assert 'holds the 1000 before' in str(failure.value)
    assert sequences(folder) == list(range(1000))
    with AnyReader([folder]) as reader:
        assert reader.message_count == 1000


@pytest.mark.parametrize('room_byte', [0, 100, 2_500])
def test_a_repair_without_room_leaves_all_as_it_was(
    tmp_path: Path, torn: tuple[Path, list[int]], room_byte: int
) -> None:
    bag = copy_of(torn, tmp_path, cut_at=torn[1][3] + 100)
    before = {file: file.read_bytes() for file in bag.iterdir()}
    with no_file_beyond(room_byte), pytest.raises(OSError, match='File too large'):
        repair(bag)
    assert {file: file.read_bytes() for file in bag.iterdir()} == before
    assert repair(bag).n_messages == 3 * PER_CHUNK


@contextmanager
def nobody() -> Iterator[None]:
    """Without the rights of root, who may write anywhere."""
    own = os.geteuid()
    if own == 0:
        os.seteuid(65_534)
    try:
        yield
    finally:
        os.seteuid(own)


def test_a_repair_in_a_folder_that_cannot_be_written_says_so(
    tmp_path: Path, torn: tuple[Path, list[int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = copy_of(torn, tmp_path)
    names = sorted(bag.iterdir())
    monkeypatch.chdir(bag)  # the way to it is root's
    bag.chmod(0o555)
    with nobody(), pytest.raises(PermissionError):
        repair(Path())
    bag.chmod(0o700)
    assert sorted(bag.iterdir()) == names


@pytest.mark.parametrize('n_steps', [0, 1, 2])
def test_a_repair_that_fails_while_files_are_moved_moves_them_back(
    tmp_path: Path,
    torn: tuple[Path, list[int]],
    monkeypatch: pytest.MonkeyPatch,
    n_steps: int,
) -> None:
    bag = copy_of(torn, tmp_path)
    before = {file: file.read_bytes() for file in bag.iterdir()}
    replace, steps = Path.replace, iter(range(n_steps))

    def failing(source: Path, target: Path) -> Path:
        is_own = source.suffix != '.tmp' and source.suffix != '.broken'  # or goes back
        if is_own and next(steps, None) is None:
            raise OSError(errno.EIO, 'Input/output error', str(target))
        return replace(source, target)

    with monkeypatch.context() as patch, pytest.raises(OSError, match='Input/output'):
        patch.setattr(Path, 'replace', failing)
        repair(bag)
    assert {file: file.read_bytes() for file in bag.iterdir()} == before


def test_topics_without_messages_survive_a_repair(tmp_path: Path) -> None:
    bag = HandMadeBag(tmp_path / 'bag')
    for topic, name in (('/uav_1/command', 'Command'), ('/uav_2/command', 'Command')):
        bag.writer.add_topic(topic, f'uav_collect_msgs/msg/{name}', QOS)
    write_radio(bag, range(5))
    bag.writer.close()
    with AnyReader([tmp_path / 'bag']) as reader:
        before = {
            it.topic: (it.msgtype, it.msgdef, it.digest, it.ext) for it in reader.connections
        }
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    with (tmp_path / 'bag' / 'bag.mcap').open('r+b') as file:
        file.truncate(file.seek(0, 2) - 20)
    assert repair(tmp_path / 'bag').n_messages == 5
    with AnyReader([tmp_path / 'bag']) as reader:
        after = {it.topic: (it.msgtype, it.msgdef, it.digest, it.ext) for it in reader.connections}
    assert after == before
    assert len(after) == 3


def test_what_a_recorder_remarked_survives_a_repair(tmp_path: Path) -> None:
    bag = HandMadeBag(tmp_path / 'bag', chunk_byte=1_000)
    write_radio(bag, range(50))
    bag.writer.remark('origin', 'here')
    bag.writer.close()
    with (tmp_path / 'bag' / 'bag.mcap').open('r+b') as file:
        file.seek(3_000)
        byte = file.read(1)
        file.seek(3_000)
        file.write(bytes([byte[0] ^ 1]))
    done = repair(tmp_path / 'bag')
    assert 0 < done.n_messages < 50
    with open_bag(tmp_path / 'bag') as repaired:
        assert repaired.custom_data['origin'] == 'here'
        assert repaired.custom_data['left out by repair'] == '; '.join(done.left_out)
        assert repaired.damages == repaired.remarks == []


def test_a_disk_too_full_for_the_index_leaves_what_repair_can_read(tmp_path: Path) -> None:
    folder = tmp_path / 'bag'
    bag = HandMadeBag(folder)
    write_radio(bag, range(1000))
    bag.writer.flush()
    flushed_byte = (folder / 'bag.mcap').stat().st_size
    write_radio(bag, range(1000, 3000))
    with (
        no_file_beyond(flushed_byte + 10),
        pytest.raises(RecordingError, match=f'recorder --repair {folder}'),
    ):
        bag.writer.flush()
    repair(folder)
    assert sequences(folder) == list(range(1000))


def test_room_for_the_index_is_held_until_the_recording_closes(tmp_path: Path) -> None:
    bag = HandMadeBag(tmp_path / 'bag')
    (reserve,) = (file for file in bag.writer.folder.iterdir() if file.suffix != '.mcap')
    assert reserve.stat().st_blocks * 512 >= 1 << 20
    bag.writer.close()
    assert not reserve.exists()


def test_closing_a_recording_twice_is_harmless(tmp_path: Path) -> None:
    bag = HandMadeBag(tmp_path / 'bag')
    write_radio(bag, range(3))
    bag.writer.close()
    bag.writer.close()
    assert bag.writer.n_messages == 3
    assert sequences(tmp_path / 'bag') == [0, 1, 2]


def test_big_messages_do_not_wait_for_a_flush(tmp_path: Path) -> None:
    bag = HandMadeBag(tmp_path / 'bag', chunk_byte=1000)
    write_radio(bag, range(100))
    assert bag.writer.n_messages > 80
    bag.writer.close()
    assert sequences(tmp_path / 'bag') == list(range(100))


def test_a_name_that_readers_take_for_a_bag_of_ros_1_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r'mission\.bag: readers take a name'):
        HandMadeBag(tmp_path / 'mission.bag')

"""Checksums of bags: no byte changes unseen."""

from pathlib import Path
import re

from bag_damage import without_checksums
from bags import HandMadeBag
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import ChunkIndex
from mcap.stream_reader import StreamReader
import pytest
from uav_collect.errors import BagError
from uav_collect.recording.bag_messages import messages
from uav_collect.recording.bag_repair import repair
from uav_collect.recording.mcap_file import read_mcap

TOPIC = '/uav_1/radio_rx'
GOLDEN = Path(__file__).parents[1] / 'golden' / 'run_folder' / 'bag' / 'bag.mcap'


def written(folder: Path) -> Path:
    """The file of a bag of three chunks."""
    bag = HandMadeBag(folder)
    for chunk in range(3):
        for number in range(5):
            bag.add(TOPIC, 'RadioMessage', sequence=5 * chunk + number)
        bag.writer.flush()
    bag.writer.close()
    return folder / f'{folder.name}.mcap'


@pytest.fixture(scope='module')
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp('written') / 'bag')


def sequences(path: Path) -> list[int]:
    return [message.sequence for _, message in messages(path, lambda _: True)]


def chunks_of(path: Path) -> list[ChunkIndex]:
    with path.open('rb') as content:
        summary = make_reader(content).get_summary()
    assert summary is not None
    return summary.chunk_indexes


def test_a_bag_is_written_with_checksums_that_other_readers_check(file: Path) -> None:
    check = read_mcap(file)
    assert check.has_checksums
    assert check.damages == []
    with file.open('rb') as content:
        assert sum(1 for _ in StreamReader(content, validate_crcs=True).records) > 15
    with file.open('rb') as content:
        summary = make_reader(content, validate_crcs=True).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 15
    assert sequences(file) == [*range(15)]


@settings(max_examples=200, deadline=None)
@given(share=st.floats(0.0, 1.0, exclude_max=True), flipped=st.integers(1, 255))
def test_any_changed_byte_is_seen(
    tmp_path_factory: pytest.TempPathFactory, file: Path, share: float, flipped: int
) -> None:
    content = bytearray(file.read_bytes())
    content[int(share * len(content))] ^= flipped
    changed = tmp_path_factory.getbasetemp() / 'changed.mcap'
    changed.write_bytes(content)
    assert read_mcap(changed).damages != []


def test_a_damaged_chunk_is_named_by_its_number_and_place(file: Path, tmp_path: Path) -> None:
    content = bytearray(file.read_bytes())
    chunks = [chunk.chunk_start_offset for chunk in chunks_of(file)]
    content[chunks[2] + 100] ^= 1
    changed = tmp_path / 'changed.mcap'
    changed.write_bytes(content)
    [damage] = read_mcap(changed).damages
    place, _, what = str(damage).partition(': ')
    end = chunks[2] + chunks_of(file)[2].chunk_length
    assert place == f'chunk 3, bytes {chunks[2]} to {end}, simulated time 0.000 s to 0.000 s'
    assert re.match('its checksum differs|cannot be unpacked|its lengths contradict', what)
    with pytest.raises(BagError, match=r'changed\.mcap: chunk 3, '):
        sequences(changed)


def test_a_file_cut_anywhere_is_damaged(file: Path, tmp_path: Path) -> None:
    content = file.read_bytes()
    for length in (0, 5, 100, len(content) // 2, len(content) - 1):
        cut = tmp_path / 'cut.mcap'
        cut.write_bytes(content[:length])
        if length < 9:
            with pytest.raises(BagError, match='is not an MCAP file'):
                read_mcap(cut)
        else:
            assert read_mcap(cut).damages != []


def test_a_bag_without_checksums_stays_readable(file: Path, tmp_path: Path) -> None:
    bare = tmp_path / 'bare.mcap'
    bare.write_bytes(file.read_bytes())
    without_checksums(bare)
    for path in (bare, GOLDEN):
        check = read_mcap(path)
        assert not check.has_checksums
        assert check.damages == []
    assert sequences(bare) == [*range(15)]


def test_a_repaired_bag_has_checksums(tmp_path: Path) -> None:
    file = written(tmp_path / 'bag')
    file.write_bytes(file.read_bytes()[:-400])
    repair(file.parent)
    check = read_mcap(file)
    assert check.has_checksums
    assert check.damages == []
    assert sequences(file) == [*range(15)]


def test_what_is_in_the_metadata_is_in_the_file_as_well(file: Path) -> None:
    copy = read_mcap(file).metadata
    assert copy is not None
    words = file.with_name('metadata.yaml').read_text().split()
    assert words == ['rosbag2_bagfile_information:', *copy.split()]

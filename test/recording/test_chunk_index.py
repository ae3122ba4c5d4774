"""The index of a recording waits on the disk, and ends in the file as rosbags writes it."""

from io import BytesIO
from pathlib import Path
import tracemalloc

from bags import HandMadeBag
from full_disk import no_file_beyond
from mcap.reader import make_reader
import pytest
from uav_collect.recording.chunk_index import ChunkIndex

N_CHUNKS = 300


def write_chunks(bag: HandMadeBag, n_chunks: int) -> None:
    for number in range(n_chunks):
        for uav in range(1, 5):
            bag.add(f'/uav_{uav}/radio_tx', 'RadioMessage', sequence=number)
        bag.writer.flush()


def test_longer_recordings_take_no_more_memory(tmp_path: Path) -> None:
    bag = HandMadeBag(tmp_path / 'bag')
    write_chunks(bag, 10)
    tracemalloc.start()
    try:
        write_chunks(bag, 10)
        held_byte, _ = tracemalloc.get_traced_memory()
        write_chunks(bag, N_CHUNKS)
        grown_byte = tracemalloc.get_traced_memory()[0] - held_byte
    finally:
        tracemalloc.stop()
    bag.writer.close()
    assert grown_byte < 30 * N_CHUNKS


def test_the_index_names_every_chunk(tmp_path: Path) -> None:
    bag = HandMadeBag(tmp_path / 'bag')
    write_chunks(bag, N_CHUNKS)
    bag.writer.close()
    with (tmp_path / 'bag' / 'bag.mcap').open('rb') as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert len({chunk.chunk_start_offset for chunk in summary.chunk_indexes}) == N_CHUNKS
    assert sorted(file.name for file in (tmp_path / 'bag').iterdir()) == [
        'bag.mcap',
        'metadata.yaml',
    ]


def test_what_the_disk_did_not_take_whole_is_cut_off(tmp_path: Path) -> None:
    index = ChunkIndex(tmp_path)
    records = [bytes([number]) * 100 for number in range(20)]
    n_kept = 0
    with no_file_beyond(1_000), pytest.raises(OSError, match='too large'):
        for record in records:
            index.append(BytesIO(record))
            n_kept += 1
    index.cut(n_kept)
    assert [record.getvalue() for record in index] == records[:n_kept]
    index.append(BytesIO(b'after'))
    assert len(index) == n_kept + 1
    assert [record.getvalue() for record in index][-1] == b'after'
    index.close()

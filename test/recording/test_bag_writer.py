"""The writer of bags, where what it starts with fails."""

from pathlib import Path

from full_disk import no_file_beyond
import pytest
from uav_collect.errors import RecordingError
from uav_collect.recording.bag_writer import BagWriter, MessageTypes


def test_a_disk_that_is_full_at_the_start_leaves_no_folder(tmp_path: Path) -> None:
    bag = tmp_path / 'bag'
    types = MessageTypes(lambda name: '')
    full = pytest.raises(RecordingError, match=f'cannot record to {bag}: File too large')
    with no_file_beyond(100_000), full:  # the room that is kept for its index does not fit
        BagWriter(bag, types, chunk_byte=1_000)
    assert not bag.exists()

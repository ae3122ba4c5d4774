"""Checksums of a bag's file, written while it grows; `mcap_file` checks them.

An MCAP file has room for a CRC-32 of each chunk's content, of all bytes before the end of its data
and of its summary, so that no byte of it can change unseen. rosbags leaves all of them 0, which
stands for none; files of other recorders may have some.
"""

from binascii import crc32
from os import SEEK_END
from pathlib import Path
from typing import Any

from uav_collect.recording.mcap_records import FOOTER_BYTE, HEAD, MAGIC, SUM_BYTE

_CHUNK_SUM_AT = HEAD.size + 24
_DATA_END_BYTE = HEAD.size + SUM_BYTE
_BLOCK_BYTE = 1 << 20


class BagChecksums:
    """Adds the checksums to a file that rosbags writes."""

    def __init__(self, storage: Any) -> None:  # noqa: ANN401 - of rosbags
        """Add one to each chunk from now on; nothing is in a chunk yet."""
        self._storage = storage
        self._close_chunk = storage.close_chunk
        storage.close_chunk = self.close_chunk
        self._path: Path = storage.path
        self._data_sum = self._n_summed_byte = 0  # of what was read back

    def close_chunk(self) -> None:
        """Write the chunk, then its checksum into it."""
        storage = self._storage
        checksum, start = crc32(storage.chunk.bio.getbuffer()), storage.bio.tell()
        self._close_chunk()
        end = storage.bio.tell()
        storage.bio.seek(start + _CHUNK_SUM_AT)
        storage.bio.write(_sum_bytes(checksum))
        storage.bio.seek(end)

    def note_flushed(self) -> None:
        """Read back what was written to the end of the file and will stay as it is."""
        self._sum_up_to(self._path.stat().st_size)

    def finish(self) -> None:
        """Write the checksums of data and summary into the closed file.

        Raises:
            OSError: the file cannot be written.
        """
        with self._path.open('r+b') as file:
            footer_at = file.seek(-FOOTER_BYTE - len(MAGIC), SEEK_END)
            footer = file.read(FOOTER_BYTE)
            summary_at = int.from_bytes(footer[HEAD.size : HEAD.size + 8], 'little')
            file.seek(summary_at)
            summary_sum = crc32(footer[:-SUM_BYTE], crc32(file.read(footer_at - summary_at)))
            self._sum_up_to(summary_at - _DATA_END_BYTE)
            file.seek(summary_at - SUM_BYTE)
            file.write(_sum_bytes(self._data_sum))
            file.seek(footer_at + FOOTER_BYTE - SUM_BYTE)
            file.write(_sum_bytes(summary_sum))

    def _sum_up_to(self, end: int) -> None:
        with self._path.open('rb') as file:
            file.seek(self._n_summed_byte)
            while block := file.read(min(_BLOCK_BYTE, end - self._n_summed_byte)):
                self._data_sum = crc32(block, self._data_sum)
                self._n_summed_byte += len(block)


def _sum_bytes(checksum: int) -> bytes:
    return checksum.to_bytes(SUM_BYTE, 'little')

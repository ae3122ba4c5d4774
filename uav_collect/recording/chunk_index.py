"""The index of a bag's chunks while it is written.

It ends the file, and says of each chunk where it is, of what time, and where its topics are:
hundreds of bytes for each second of a recording. Until then it is kept on the disk, so that
recording for days takes no more memory than recording for a minute.
"""

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
import struct
import tempfile

_LENGTH = struct.Struct('<I')


class ChunkIndex:
    """Stands for the list of records that rosbags keeps of chunks."""

    def __init__(self, folder: Path) -> None:
        """Begin a file without a name, which is gone with its process.

        Args:
            folder: on whose file system it is.

        Raises:
            OSError: there is no room for it.
        """
        self._file = tempfile.TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115
        self._n_chunks = 0

    def append(self, record: BytesIO) -> None:
        """Keep what is said of one more chunk.

        Raises:
            OSError: it is not kept whole; `cut` removes what is there of it.
        """
        content = record.getvalue()
        written = _LENGTH.pack(len(content)) + content
        while written:
            written = written[self._file.write(written) :]
        self._n_chunks += 1

    def cut(self, n_chunks: int) -> None:
        """Forget all but the first ones."""
        self._file.seek(0)
        for _ in range(n_chunks):
            self._read()
        self._file.truncate()
        self._n_chunks = n_chunks

    def close(self) -> None:
        """Forget all."""
        self._file.close()

    def __len__(self) -> int:
        """How many chunks there are."""
        return self._n_chunks

    def __iter__(self) -> Iterator[BytesIO]:
        """What was said of each, as it was left: rosbags takes what is before its position."""
        self._file.seek(0)
        for _ in range(self._n_chunks):
            record = BytesIO()
            record.write(self._read())
            yield record

    def _read(self) -> bytes:
        (n_byte,) = _LENGTH.unpack(self._file.read(_LENGTH.size))
        return self._file.read(n_byte)

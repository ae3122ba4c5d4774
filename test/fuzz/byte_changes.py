"""What befalls the bytes of files."""

from typing import NamedTuple

from hypothesis import strategies as st


class ByteChange(NamedTuple):
    """What befalls bytes."""

    what: str
    share: float  # of them that lies before
    n_byte: int
    flipped: int
    inserted: bytes

    def made(self, content: bytes) -> bytes:
        """Bytes with the change."""
        changed = bytearray(content)
        at = int(self.share * max(len(changed), 1))
        match self.what:
            case 'flip' if changed:
                changed[at] ^= self.flipped
            case 'cut':
                del changed[at : at + self.n_byte]
            case 'end':
                del changed[at:]
            case 'insert':
                changed[at:at] = self.inserted
            case 'zero':
                n_byte = len(changed[at : at + self.n_byte])
                changed[at : at + n_byte] = bytes(n_byte)
        return bytes(changed)


BYTE_CHANGES = st.lists(
    st.builds(
        ByteChange,
        what=st.sampled_from(['flip', 'flip', 'flip', 'cut', 'end', 'insert', 'zero']),
        share=st.floats(0.0, 1.0, exclude_max=True),
        n_byte=st.integers(1, 3_000),
        flipped=st.integers(1, 255),
        inserted=st.binary(min_size=1, max_size=40),
    ),
    min_size=1,
    max_size=3,
)


def changed_bytes(content: bytes, changes: list[ByteChange]) -> bytes:
    """Bytes after some changes."""
    for change in changes:
        content = change.made(content)
    return content

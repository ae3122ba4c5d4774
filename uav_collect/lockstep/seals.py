"""Seals: proof that a message comes from who holds the secret of a mission, and only once.

A seal is the end of a serialized message: the sender's number, drawn at random, how many it has
sealed so far, and a tag over a name, a context and all bytes before the tag. The name is that of
the topic or service, so that no message counts for another UAV or another world; the context is
what a request or an answer is for, so that an old one counts for nothing new.
"""

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field
import hashlib
import hmac
from pathlib import Path
import secrets
import stat
import struct

from uav_collect.errors import NodeError

KEY_FILE = 'UAV_COLLECT_KEY_FILE'  # variable that names the file of the secret

_PERSON = b'uav_collect seal'
TAG_BYTE = 16
_NUMBERS = struct.Struct('<QQ')  # sender and sequence
SEAL_BYTE = _NUMBERS.size + TAG_BYTE
_NO_TAG = bytes(TAG_BYTE)
_LENGTH = struct.Struct('<I')
_LEAST_KEY_BYTE = 16
_MOST_FILE_BYTE = 65_536
_MOST_SENDERS = 10_000  # that a receiver remembers, those heard latest


@dataclass(frozen=True, kw_only=True)
class Secret:
    """What all processes of a mission know, and nobody else."""

    key: bytes = field(repr=False)
    file: Path
    is_readable_by_others: bool


def read_secret(environment: Mapping[str, str]) -> Secret | None:
    """The secret in the file that the environment names; None if it names none.

    Raises:
        NodeError: the file cannot be read, or is too short or too long.
    """
    name = environment.get(KEY_FILE)
    if name is None:
        return None
    if not name:
        raise NodeError(f'{KEY_FILE} is empty: must name a file, or be unset')
    file = Path(name)
    try:
        with file.open('rb') as opened:
            content = opened.read(_MOST_FILE_BYTE + 1)
            mode = stat.S_IMODE(file.stat().st_mode)
    except (OSError, ValueError) as error:
        raise NodeError(f'{KEY_FILE}: {error}') from error
    if not _LEAST_KEY_BYTE <= len(content) <= _MOST_FILE_BYTE:
        size = f'more than {_MOST_FILE_BYTE:,}' if len(content) > _MOST_FILE_BYTE else len(content)
        bounds = f'{_LEAST_KEY_BYTE} to {_MOST_FILE_BYTE:,}'
        raise NodeError(f'{KEY_FILE}: {file} has {size} bytes: must have {bounds}')
    return Secret(
        key=_key_of(content),
        file=file,
        is_readable_by_others=bool(mode & (stat.S_IRWXG | stat.S_IRWXO)),
    )


def _key_of(content: bytes) -> bytes:
    """What BLAKE2b takes as its key: at most 64 bytes."""
    if len(content) <= hashlib.blake2b.MAX_KEY_SIZE:
        return content
    return hashlib.blake2b(content, person=_PERSON).digest()


class _Tags:
    """The tags of what is sent under one name."""

    def __init__(self, secret: Secret, name: str) -> None:
        self._named = hashlib.blake2b(digest_size=TAG_BYTE, key=secret.key, person=_PERSON)
        self._named.update(framed(name.encode()))
        self._without_context = self._begun(b'')

    def tag(self, content: bytes, context: bytes) -> bytes:
        digest = self._begun(context) if context else self._without_context.copy()
        digest.update(content)
        return digest.digest()

    def _begun(self, context: bytes) -> hashlib.blake2b:
        digest = self._named.copy()
        digest.update(framed(context))
        return digest


class Signer:
    """Seals what one sender sends under one name."""

    def __init__(self, secret: Secret, name: str) -> None:
        """Be a sender that nobody has heard of.

        Args:
            secret: of the mission.
            name: of the topic, or of the service and whether it asks or answers.
        """
        self._tags = _Tags(secret, name)
        self.sender = secrets.randbits(64)
        self._sequence = 0
        self._numbers = b''  # sender and sequence of what is sealed next

    def next_sequence(self) -> int:
        """The number of the message that is sealed next."""
        self._sequence += 1
        self._numbers = _NUMBERS.pack(self.sender, self._sequence)
        return self._sequence

    def sealed(self, content: bytes, context: bytes = b'') -> bytes:
        """A message with the tag of its seal.

        Args:
            content: the message as it was serialized, sender and sequence in its seal.
            context: that the receiver knows too.
        """
        # A serializer may leave more behind the seal.
        body = content[: content.rindex(self._numbers) + _NUMBERS.size]
        return body + self._tags.tag(body, context)


class Checker:
    """Checks the seals of what one receiver gets under one name."""

    def __init__(self, secret: Secret, name: str, *, is_ordered: bool = True) -> None:
        """Know of no sender yet; the other arguments are those of a Signer.

        Args:
            is_ordered: False: messages of one sender may come in any order, as out of a bag.
        """
        self._tags = _Tags(secret, name)
        self._is_ordered = is_ordered
        self._latest: OrderedDict[int, int] = OrderedDict()  # sequence by sender, the latest last
        self._taken: set[tuple[int, int]] = set()  # sender and sequence, where there is no order

    def refusal(self, content: bytes, context: bytes = b'') -> str | None:
        """Why a serialized message is refused, or None: then it is refused from now on."""
        tag = content[-TAG_BYTE:]
        if len(content) < SEAL_BYTE or tag == _NO_TAG:
            return 'it has no seal'
        if not hmac.compare_digest(tag, self._tags.tag(content[:-TAG_BYTE], context)):
            return 'its seal is not of this key, place and content'
        sender, sequence = _NUMBERS.unpack_from(content, len(content) - SEAL_BYTE)
        if not self._is_ordered:
            return self._repetition(sender, sequence)
        latest = self._latest.get(sender, 0)
        if sequence <= latest:
            return f'its seal {sequence} is no newer than {latest}: a repetition'
        self._latest[sender] = sequence
        self._latest.move_to_end(sender)
        if len(self._latest) > _MOST_SENDERS:
            self._latest.popitem(last=False)
        return None

    def _repetition(self, sender: int, sequence: int) -> str | None:
        if (sender, sequence) in self._taken:
            return f'its seal {sequence} was there before: a repetition'
        self._taken.add((sender, sequence))
        return None


def seal_bytes(sender: int, sequence: int, tag: bytes) -> bytes:
    """A seal as it is serialized."""
    return _NUMBERS.pack(sender, sequence) + tag


def seal_of(content: bytes) -> bytes:
    """The seal of a serialized message: nothing else has the same."""
    return content[-SEAL_BYTE:]


def framed(part: bytes) -> bytes:
    """Bytes with their length before them, so that no two parts read like others."""
    return _LENGTH.pack(len(part)) + part

"""Only who has the key is listened to, once for each message, and only where it was sent."""

import hashlib
from pathlib import Path
import struct

import pytest
from uav_collect.errors import NodeError
from uav_collect.lockstep.seals import Checker, KEY_FILE, read_secret, Secret, Signer

NAME = '/uav_1/command'
FIELDS = b'\0\1\0\0what a command says'


def secret(key: bytes = b'k' * 32) -> Secret:
    return Secret(key=key, file=Path('key'), is_readable_by_others=False)


def serialized(sender: int, sequence: int, excess: bytes = b'') -> bytes:
    """A message as a serializer leaves it, perhaps with bytes behind it."""
    return FIELDS + struct.pack('<QQ', sender, sequence) + bytes(16) + excess


def sealed(signer: Signer, context: bytes = b'', excess: bytes = b'') -> bytes:
    sequence = signer.next_sequence()
    return signer.sealed(serialized(signer.sender, sequence, excess), context)


def test_who_has_the_key_is_listened_to() -> None:
    signer, checker = Signer(secret(), NAME), Checker(secret(), NAME)
    assert [checker.refusal(sealed(signer)) for _ in range(3)] == [None] * 3


def test_a_tag_is_the_keyed_digest_of_name_context_and_all_before_it() -> None:
    content = sealed(Signer(secret(), NAME), b'world')
    parts = struct.pack('<I', len(NAME)) + NAME.encode() + struct.pack('<I', 5) + b'world'
    expected = hashlib.blake2b(
        parts + content[:-16], digest_size=16, key=b'k' * 32, person=b'uav_collect seal'
    )
    assert content[-16:] == expected.digest()


@pytest.mark.parametrize('content', [b'', b'\0' * 31, serialized(1, 1), serialized(0, 0)])
def test_what_has_no_seal_is_refused(content: bytes) -> None:
    assert Checker(secret(), NAME).refusal(content) == 'it has no seal'


@pytest.mark.parametrize(
    'signer',
    [Signer(secret(b'other key of some length'), NAME), Signer(secret(), '/uav_2/command')],
    ids=['another key', 'another topic'],
)
def test_a_seal_of_another_key_or_place_is_refused(signer: Signer) -> None:
    why = Checker(secret(), NAME).refusal(sealed(signer))
    assert why == 'its seal is not of this key, place and content'


def test_one_bit_more_or_less_breaks_the_seal() -> None:
    content = sealed(Signer(secret(), NAME))
    for place in range(len(content)):
        changed = bytearray(content)
        changed[place] ^= 1
        assert Checker(secret(), NAME).refusal(bytes(changed)) is not None


def test_what_was_asked_of_another_world_counts_for_nothing() -> None:
    checker = Checker(secret(), '/world/control request')
    request = sealed(Signer(secret(), '/world/control request'), b'old world')
    assert checker.refusal(request, b'new world') is not None
    assert checker.refusal(request, b'old world') is None


def test_neither_a_repetition_nor_anything_older_is_taken() -> None:
    signer, checker = Signer(secret(), NAME), Checker(secret(), NAME)
    first, second, third = (sealed(signer) for _ in range(3))
    assert checker.refusal(second) is None
    for old in (first, second):
        assert 'a repetition' in str(checker.refusal(old))
    assert checker.refusal(third) is None


def test_out_of_a_bag_any_order_is_taken_and_a_repetition_still_is_none() -> None:
    signer, checker = Signer(secret(), NAME), Checker(secret(), NAME, is_ordered=False)
    first, second, third = (sealed(signer) for _ in range(3))
    assert [checker.refusal(each) for each in (second, first, third)] == [None] * 3
    assert 'a repetition' in str(checker.refusal(first))


def test_numbers_begin_at_1_whoever_seals() -> None:
    content = serialized(7, 0)[:-16]
    parts = struct.pack('<I', len(NAME)) + NAME.encode() + bytes(4) + content
    tag = hashlib.blake2b(parts, digest_size=16, key=b'k' * 32, person=b'uav_collect seal')
    assert Checker(secret(), NAME).refusal(content + tag.digest()) == (
        'its seal 0 is no newer than 0: a repetition'
    )


def test_what_is_refused_does_not_keep_out_what_follows() -> None:
    signer, checker = Signer(secret(), NAME), Checker(secret(), NAME)
    first = sealed(signer)
    forged = bytearray(first)
    forged[-17] = 255  # the highest byte of the sequence
    assert checker.refusal(bytes(forged)) is not None
    assert checker.refusal(first) is None


def test_who_starts_late_takes_a_history_from_its_beginning_as_who_was_there() -> None:
    signer, late = Signer(secret(), NAME), Checker(secret(), NAME)
    history = [sealed(signer) for _ in range(10)]
    assert [late.refusal(each) for each in history[4:]] == [None] * 6


def test_senders_count_for_themselves() -> None:
    checker = Checker(secret(), NAME)
    one, other = Signer(secret(), NAME), Signer(secret(), NAME)
    for signer in (one, one, other, one, other):
        assert checker.refusal(sealed(signer)) is None


def test_what_a_serializer_leaves_behind_a_message_is_cut_off() -> None:
    signer, checker = Signer(secret(), NAME), Checker(secret(), NAME)
    content = sealed(signer, excess=b'garbage!' * 100)
    assert len(content) == len(serialized(0, 0))
    assert checker.refusal(content) is None


def environment(tmp_path: Path, content: bytes, mode: int = 0o600) -> dict[str, str]:
    file = tmp_path / 'key'
    file.write_bytes(content)
    file.chmod(mode)
    return {KEY_FILE: str(file)}


def test_a_key_of_up_to_64_bytes_is_used_as_it_is_and_a_longer_one_by_its_digest(
    tmp_path: Path,
) -> None:
    for size in (16, 64):
        found = read_secret(environment(tmp_path, b'k' * size))
        assert found is not None and found.key == b'k' * size
    longer = read_secret(environment(tmp_path, b'k' * 65))
    longest = read_secret(environment(tmp_path, b'k' * 65_536))
    assert longer is not None and longest is not None
    assert len(longer.key) == len(longest.key) == 64
    assert longer.key != longest.key


def test_a_key_is_not_shown() -> None:
    assert 'kkkk' not in repr(secret())


def test_no_key_is_no_error() -> None:
    assert read_secret({}) is None


@pytest.mark.parametrize(('mode', 'is_open'), [(0o600, False), (0o640, True), (0o604, True)])
def test_a_key_that_others_may_read_is_noticed(tmp_path: Path, mode: int, is_open: bool) -> None:
    found = read_secret(environment(tmp_path, b'k' * 32, mode))
    assert found is not None and found.is_readable_by_others == is_open


@pytest.mark.parametrize(
    ('content', 'complaint'),
    [
        (b'', 'has 0 bytes: must have 16 to 65,536'),
        (b'k' * 15, 'has 15 bytes: must have 16 to 65,536'),
        (b'k' * 65_537, 'has more than 65,536 bytes: must have 16 to 65,536'),
    ],
)
def test_a_file_that_is_no_key_is_refused(tmp_path: Path, content: bytes, complaint: str) -> None:
    with pytest.raises(NodeError, match=complaint):
        read_secret(environment(tmp_path, content))


@pytest.mark.parametrize('name', ['', 'missing', '.', 'nul\0'])
def test_a_file_that_cannot_be_read_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    named = str(tmp_path / name) if name else name
    with pytest.raises(NodeError) as error:
        read_secret({KEY_FILE: named})
    assert str(error.value).startswith(KEY_FILE)
    assert '\n' not in str(error.value)

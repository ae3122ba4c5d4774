"""Bags: what `report` makes of those that a disk, a program or a liar has changed.

A bag of one small mission is made once. Its file is changed by bytes and by records, with and
without checksums that fit; its messages by field, its types by definition, its metadata by text.
"""

from functools import cache
from pathlib import Path
import shutil
from typing import NamedTuple

from bag_changes import (
    FIELD_CHANGES,
    FieldChange,
    HEAD,
    inner_records,
    MAGIC,
    MESSAGE_HEAD,
    NUMBERS,
    packed,
    Record,
    record_changes,
    RecordChange,
    records_of,
    SHARES,
    TEXTS,
)
from bag_damage import copied
from bags import HandMadeBag
from byte_changes import BYTE_CHANGES, ByteChange, changed_bytes
from fuzzing import check_lines, fuzzed, memory_folder
from hypothesis import strategies as st
from recordings import end_of, messages_of, start_of, write_bag
from tiny_world import tiny, uav
from uav_collect.analysis.proof import Verdict
from uav_collect.analysis.recording_proof import Given, prove_recording
from uav_collect.analysis.results import FlownMission
from uav_collect.errors import BagError, UavCollectError
from uav_collect.missions.rollout import fly
from uav_collect.recording.bag_reader import read_recording, Recording
from uav_collect.recording.bag_repair import repair
from uav_collect.recording.bag_storage import open_bag
from uav_collect.recording.mission_log import from_jsonl
from uav_collect.scenario.site import build_site
from uav_collect.world.sensor_field import demand_of


class Made(NamedTuple):
    """What is changed: a bag, and what is right of it."""

    content: bytes  # of its file
    metadata: str
    records: tuple[Record, ...]  # types, channels and messages
    log: bytes
    n_radio_messages: int


@cache
def made() -> Made:
    """A bag of a mission of two UAVs."""
    site = build_site(tiny(uav(5.0), uav(10.0)))
    [log] = fly(site, [0], 'sweep')
    folder = memory_folder('bag') / 'made'
    bag = HandMadeBag(folder, chunk_byte=2_500, step_ns=1_000_000)
    bag.add_scenario(site)
    bag.add_mission(log, 'world-0', n_radio_messages=3)
    bag.writer.close()
    content = (folder / 'made.mcap').read_bytes()
    metadata = (folder / 'metadata.yaml').read_text()
    return Made(content, metadata, tuple(inner_records(content)), log.to_jsonl(), 3)


def read(path: Path) -> Recording | None:
    """What `report` would show of a bag; None if it is refused."""
    try:
        recording = read_recording(path)
    except BagError as error:
        check_lines([str(error)], names=str(memory_folder('bag')))
        return None
    if recording.damages:
        check_lines(recording.damages[:20], names=str(memory_folder('bag')))
    for mission in recording.missions:
        if mission.is_complete and mission.log.to_jsonl() != made().log:
            flown = FlownMission(
                log=mission.log,
                site=mission.site,
                demand_bit=mission.demand_bit,
                n_radio_messages=mission.n_radio_messages,
            )
            assert 'nan' not in str(flown).split()
        if mission.is_complete:
            assert from_jsonl(mission.log.to_jsonl()).to_jsonl() == mission.log.to_jsonl()
    return recording


def check_unseen_is_equal(recording: Recording | None) -> None:
    """Hold a reading to what was recorded, unless it says that something is damaged."""
    if recording is None:
        return
    [mission] = recording.missions
    if mission.is_complete:
        assert mission.log.to_jsonl() == made().log
        assert mission.n_radio_messages == made().n_radio_messages
    else:
        assert recording.damages


def written(content: bytes) -> Path:
    """A file of a bag."""
    path = memory_folder('bag') / 'bag.mcap'
    path.write_bytes(content)
    return path


@fuzzed(share=0.25, changes=BYTE_CHANGES)
def test_bytes_of_a_file_with_checksums(changes: list[ByteChange]) -> None:
    check_unseen_is_equal(read(written(changed_bytes(made().content, changes))))


@fuzzed(
    share=0.15,
    changes=record_changes('drop', 'double', 'move', 'kind', 'body'),
    has_end=st.booleans(),
)
def test_records_of_a_file_with_checksums(changes: list[RecordChange], has_end: bool) -> None:
    records = records_of(made().content[len(MAGIC) :])
    for change in changes:
        change.made(records)
    inner = b''.join(HEAD.pack(it.kind, len(it.body)) + it.body for it in records)
    check_unseen_is_equal(read(written(MAGIC + inner + (MAGIC if has_end else b''))))


@fuzzed(share=0.2, changes=record_changes('drop', 'double', 'move', 'body', 'words', 'head'))
def test_forged_records_whose_checksums_fit(changes: list[RecordChange]) -> None:
    records = [*made().records]
    for change in changes:
        change.made(records)
    read(written(packed(records)))


@fuzzed(share=0.2, changes=FIELD_CHANGES)
def test_forged_messages_whose_checksums_fit(changes: list[FieldChange]) -> None:
    records = [*made().records]
    for change in changes:
        change.made(records)
    read(written(packed(records)))


@fuzzed(
    share=0.1,
    line_share=SHARES,
    what=st.sampled_from(['value', 'drop', 'bytes']),
    value=st.one_of(NUMBERS.map(str), TEXTS, st.sampled_from(['sqlite3', 'message', '{}'])),
    changes=BYTE_CHANGES,
)
def test_metadata_of_a_bag_that_is_whole(
    line_share: float, what: str, value: str, changes: list[ByteChange]
) -> None:
    lines = made().metadata.splitlines(keepends=True)
    at = int(line_share * len(lines))
    metadata = made().metadata.encode()
    if what == 'value':
        lines[at] = f'{lines[at].partition(":")[0]}: {value}\n'
        metadata = ''.join(lines).encode()
    elif what == 'drop':
        metadata = ''.join(lines[:at] + lines[at + 3 :]).encode()
    else:
        metadata = changed_bytes(metadata, changes)
    folder = memory_folder('bag') / 'run'
    folder.mkdir(exist_ok=True)
    (folder / 'run.mcap').write_bytes(made().content)
    (folder / 'metadata.yaml').write_bytes(metadata)
    check_unseen_is_equal(read(folder))


@cache
def database() -> bytes:
    """The same bag as a database."""
    made()
    folder = copied(memory_folder('bag') / 'made', memory_folder('bag') / 'database')
    return (folder / 'database.db3').read_bytes()


@fuzzed(share=0.05, changes=BYTE_CHANGES)
def test_bytes_of_a_database(changes: list[ByteChange]) -> None:
    path = memory_folder('bag') / 'bag.db3'
    path.write_bytes(changed_bytes(database(), changes))
    read(path)


@fuzzed(share=0.05, changes=BYTE_CHANGES)
def test_a_repaired_file_is_whole_and_holds_nothing_else(changes: list[ByteChange]) -> None:
    folder = memory_folder('bag') / 'repaired'
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    file = folder / 'repaired.mcap'
    file.write_bytes(changed_bytes(made().content, changes))
    before = file.read_bytes()
    try:
        repair(folder)
    except BagError as error:
        check_lines([str(error)], names=str(memory_folder('bag')))
        assert [it.read_bytes() for it in folder.iterdir()] == [before]
        return
    original = {record.body[MESSAGE_HEAD.size :] for record in made().records}
    with open_bag(folder) as bag:
        kept = [content for _, _, content in bag.messages(lambda _: True)]
        assert bag.damages == bag.remarks == []
    assert original.issuperset(kept)
    assert (folder / 'repaired.mcap.broken').read_bytes() == before


@cache
def whole() -> bytes:
    """The file of a bag with every message of the mission."""
    site = build_site(tiny(uav(5.0), uav(10.0)))
    [log] = fly(site, [0], 'sweep')
    demand_bit = demand_of(site, 0)
    phases = [start_of(site, log, demand_bit), end_of(site, log, demand_bit)]
    folder = write_bag(
        memory_folder('bag') / 'whole', site, {'world-0': (phases, messages_of(site, log))}
    )
    return (folder / 'whole.mcap').read_bytes()


def verdicts(path: Path) -> set[Verdict]:
    """What `verify` says of a bag."""
    try:
        proofs = [*prove_recording(path, Given())]
    except UavCollectError as error:
        check_lines([str(error)], names=str(memory_folder('bag')))
        return set()
    check_lines([str(proof) for proof in proofs][:20])
    return {proof.verdict for proof in proofs}


def test_the_bag_that_is_changed_is_proved() -> None:
    assert verdicts(written(whole())) == {Verdict.PROVED}


@fuzzed(share=0.02, changes=BYTE_CHANGES)
def test_a_changed_bag_is_never_proved(changes: list[ByteChange]) -> None:
    content = changed_bytes(whole(), changes)
    assert content == whole() or verdicts(written(content)) != {Verdict.PROVED}


@fuzzed(share=0.01, changes=st.one_of(FIELD_CHANGES, record_changes('body', 'words', 'head')))
def test_a_forged_bag_is_proved_or_not(changes: list[FieldChange | RecordChange]) -> None:
    records = inner_records(whole())
    for change in changes:
        change.made(records)
    verdicts(written(packed(records)))

"""What a world leaves of its missions: scenario and logs, or a word about why not."""

from pathlib import Path

from full_disk import no_file_beyond
import pytest
from scripted_logs import fly, header, uav
from uav_collect.errors import RecordingError
from uav_collect.recording.mission_folder import MissionFolder, scenario_file, take_log
from uav_collect.recording.mission_log import read


def test_a_run_folder_keeps_scenario_and_logs(tmp_path: Path) -> None:
    log = fly(header([uav(1)]), [['right', 'home']])
    folder = MissionFolder(str(tmp_path / 'a' / 'b'))
    assert folder.keep_scenario('name: x\n', 'f') is None
    assert folder.begin(log.header) is None
    assert folder.append(log.events) is None
    folder.end()
    assert (tmp_path / 'a' / 'b' / 'scenario.yaml').read_text() == 'name: x\n'
    assert read(tmp_path / 'a' / 'b' / 'mission_3.jsonl').to_jsonl() == log.to_jsonl()


def test_a_seed_that_is_flown_again_and_another_scenario_have_files_of_their_own(
    tmp_path: Path,
) -> None:
    log = fly(header([uav(1)]), [['right', 'home']])
    folder = MissionFolder(str(tmp_path))
    folder.keep_scenario('name: x\n', 'first')
    for index in (2, 5):
        folder.begin(log.header, index)
        folder.end()
    folder.keep_scenario('name: y\n', 'second')
    logs = {path.name: path for path in tmp_path.glob('*.jsonl')}
    assert set(logs) == {'mission_3.jsonl', 'mission_3_5.jsonl'}
    assert take_log(logs, 3, 5) == tmp_path / 'mission_3_5.jsonl'
    assert take_log(logs, 3, 2) == tmp_path / 'mission_3.jsonl'
    assert take_log(logs, 3, 2) is None
    texts = [scenario_file(tmp_path, it).read_text() for it in ('first', 'second')]
    assert texts == ['name: x\n', 'name: y\n']


def test_without_a_name_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    log = fly(header([uav(1)]), [['home']])
    folder = MissionFolder('')
    assert folder.keep_scenario('name: x\n', 'f') is None
    assert folder.begin(log.header) is None
    assert folder.append(log.events) is None
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('at', ['header', 'events'])
def test_a_disk_that_is_full_is_named_once_per_mission(at: str, tmp_path: Path) -> None:
    log = fly(header([uav(1)]), [['home']])
    folder = MissionFolder(str(tmp_path))
    header_byte = log.to_jsonl().index(b'\n') + 1
    with no_file_beyond(header_byte - (at == 'header')):
        failures = [folder.begin(log.header)]
        failures += [folder.append(log.events) for _ in range(3)]
        folder.end()
    said = [failure for failure in failures if failure]
    assert said == ['the mission log cannot be written: [Errno 27] File too large']


def test_a_folder_with_logs_of_another_world_is_refused_and_left_as_it_was(tmp_path: Path) -> None:
    (tmp_path / 'mission_12_3.jsonl').write_text('flown before')
    with pytest.raises(RecordingError) as refused:
        MissionFolder(str(tmp_path))
    assert str(refused.value) == (
        f'{tmp_path} holds logs of missions already, such as mission_12_3.jsonl: choose another'
        ' folder, or move them away'
    )
    assert [path.read_text() for path in tmp_path.iterdir()] == ['flown before']


def test_a_log_that_another_world_has_begun_meanwhile_stays_as_it_is(tmp_path: Path) -> None:
    log = fly(header([uav(1)]), [['home']])
    first, second = (MissionFolder(str(tmp_path)) for _ in range(2))
    assert first.begin(log.header) is None
    said = second.begin(log.header)
    assert said is not None
    assert said.startswith('the mission log cannot be written: [Errno 17] File exists')
    assert first.append(log.events) is None
    assert second.append(log.events) is None
    first.end()
    assert read(tmp_path / 'mission_3.jsonl').to_jsonl() == log.to_jsonl()


def test_a_folder_that_cannot_be_is_refused() -> None:
    with pytest.raises(OSError, match='Not a directory'):
        MissionFolder('/dev/null/run')


def test_a_folder_that_takes_logs_alone_flies_on_with_the_log(tmp_path: Path) -> None:
    log = fly(header([uav(1)]), [['home']])
    folder = MissionFolder(str(tmp_path))
    (tmp_path / 'origin.json').mkdir()
    said = folder.begin(log.header, versions={'p': '1'})
    assert said == (
        'the versions of the policies cannot be written:'
        f" [Errno 22] is a folder: must be a file: '{tmp_path / 'origin.json'}'"
    )
    assert folder.append(log.events) is None
    folder.end()
    assert read(tmp_path / 'mission_3.jsonl').to_jsonl() == log.to_jsonl()

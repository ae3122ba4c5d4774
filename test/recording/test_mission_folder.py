"""What a world leaves of its missions: scenario and logs, or a word about why not."""

from pathlib import Path

import pytest
from scripted_logs import fly, header, uav
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
    file = tmp_path / 'mission_3.jsonl'
    file.symlink_to('/dev/full' if at == 'header' else '/dev/null')
    failures = [folder.begin(log.header)]
    if at == 'events':
        assert folder._log is not None
        folder._log.close()
        folder._log._file = open('/dev/full', 'w')  # noqa: SIM115 - the log closes it
    failures += [folder.append(log.events) for _ in range(3)]
    said = [failure for failure in failures if failure]
    assert len(said) == 1
    assert said[0].startswith('the mission log cannot be written: [Errno 28]')
    folder.end()


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

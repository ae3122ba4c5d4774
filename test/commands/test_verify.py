"""The command verify, of logs, folders and bags flown in this process."""

from collections.abc import Callable
import json
from pathlib import Path
import shutil

from bag_damage import changed_byte
from fleets import flown_without
import pytest
from random_policies import header, of_before, saved
from recordings import flown_with_injected
from uav_collect.__main__ import main
from uav_collect.missions.rollout import fly
from uav_collect.recording.mission_folder import MissionFolder
from uav_collect.recording.mission_log import MissionLog
from uav_collect.recording.origin import ORIGIN_FILE
from uav_collect.scenario.load import fingerprint, load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site, Site

SEED = 4


@pytest.fixture(scope='module')
def small() -> Scenario:
    return load('paper_8x8', {'fleet.default.energy_budget_kj': 8.0})


@pytest.fixture(scope='module')
def site(small: Scenario) -> Site:
    return build_site(small)


@pytest.fixture(scope='module')
def log(site: Site) -> MissionLog:
    return fly(site, [SEED], 'sweep')[0]


def keep(folder: Path, scenario: Scenario, *logs: MissionLog) -> Path:
    """Write a run folder as a world does."""
    run = MissionFolder(str(folder))
    run.keep_scenario(scenario.to_yaml(), fingerprint(scenario))
    for log in logs:
        run.begin(log.header)
        run.append(log.events, log.faults)
    run.end()
    return folder


@pytest.fixture
def run_folder(small: Scenario, log: MissionLog, tmp_path: Path) -> Path:
    return keep(tmp_path / 'run', small, log)


@pytest.fixture
def verified(capsys: pytest.CaptureFixture[str]) -> Callable[..., list[str]]:
    """Runs the command; checks its exit status, gives the lines that it prints."""

    def verify(*arguments: object, status: int) -> list[str]:
        assert main(['verify', *map(str, arguments)]) == status
        return capsys.readouterr().out.splitlines()

    return verify


Verified = Callable[..., list[str]]


def test_a_mission_is_proved_by_its_log_and_scenario(
    run_folder: Path, log: MissionLog, verified: Verified
) -> None:
    for path in (run_folder, run_folder / f'mission_{SEED}.jsonl'):
        [mission, last] = verified(path, status=0)
        assert mission == f'mission_{SEED}.jsonl: proved, {len(log.events)} events'
        assert last == '1 mission: 1 proved'


@pytest.mark.parametrize('policy', ['hert', 'random', 'anywhere'])
def test_rules_and_shipped_policies_are_found_by_name(
    policy: str, small: Scenario, site: Site, tmp_path: Path, verified: Verified
) -> None:
    folder = keep(tmp_path / 'run', small, *fly(site, [1, 2], policy, 'equal', guard_after=3))
    *_, last = verified(folder, status=0)
    assert last == '2 missions: 2 proved'


def test_what_was_found_is_written_as_json(
    run_folder: Path, log: MissionLog, tmp_path: Path, verified: Verified
) -> None:
    verified(run_folder, '--json', tmp_path / 'found.json', status=0)
    assert json.loads((tmp_path / 'found.json').read_text()) == [
        {
            'mission': f'mission_{SEED}.jsonl',
            'verdict': 'proved',
            'events': len(log.events),
            'failsafes': 0,
            'injected_faults': 0,
            'cut_off': False,
            'findings': [],
        }
    ]


@pytest.mark.parametrize('n_cut_byte', [1, 40, 2000])
def test_a_log_that_was_cut_off_is_proved_as_far_as_it_goes(
    run_folder: Path, n_cut_byte: int, verified: Verified
) -> None:
    file = run_folder / f'mission_{SEED}.jsonl'
    file.write_bytes(file.read_bytes()[:-n_cut_byte])
    [mission, _] = verified(run_folder, status=0)
    assert mission.endswith(' events, cut off before its end')


def changed(text: str, other: str) -> Callable[[Path], None]:
    def change(file: Path) -> None:
        content = file.read_text()
        assert text in content
        file.write_text(content.replace(text, other, 1))

    return change


def instead_of(event: int, line: str) -> Callable[[Path], None]:
    def change(file: Path) -> None:
        lines = file.read_text().splitlines()
        lines[event + 1] = line
        file.write_text('\n'.join([*lines, '']))

    return change


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        (changed('"event": 2, "time_s": ', '"event": 2, "time_s": 1'), 'event 2: time_s is 1'),
        (changed('{"event": 3,', '{"event": 3,,'), 'event 3: is no line of a mission log'),
        (instead_of(3, '"text"'), 'event 3: is no line of a mission log: \'"text"\''),
        (instead_of(3, '"\\ud800"'), 'event 3: is no line of a mission log'),
        (instead_of(3, '3'), 'event 3: is no line of a mission log'),
        (changed('"heard": [', f'"heard": {900 * "["}{900 * "]"}, "x": ['), 'event 0: '),
        (changed('"uav": 1, "dec', '"uav": 1,"dec'), 'same values, different formatting'),
        (changed('"n_sensors"', '"m_sensors"'), 'n_sensors is missing, flown '),
        (changed('"total_bit": ', '"total_bit": 1'), 'header: total_bit is 1'),
        # Another policy takes another way somewhere.
        (changed('"policy": "sweep"', '"policy": "hert"'), 'event 5: action is right, flown'),
        (changed('"mission_seed": 4', '"mission_seed": 5'), 'header: mission_seed is 5, the file'),
        (changed('"mission_seed": 4', '"mission_seed": 4.5'), 'mission_seed is 4.5: must be'),
        (changed('"id": 2', '"id": 3'), 'UAV 2: id is 3: must be 2'),
        (
            changed('uav_collect mission log', 'uav-collect mission log'),
            'must be of format uav_collect mission log, version 1',
        ),
        (lambda file: changed_byte(file, b'\n', last=True), 'event '),
    ],
)
def test_the_first_event_that_differs_is_named_with_field_and_both_values(
    run_folder: Path, change: Callable[[Path], None], words: str, verified: Verified
) -> None:
    change(run_folder / f'mission_{SEED}.jsonl')
    [mission, last] = verified(run_folder, status=1)
    assert words in mission
    assert last == '1 mission: 1 differs'


def test_a_mission_that_goes_on_after_its_end_differs(
    run_folder: Path, verified: Verified
) -> None:
    file = run_folder / f'mission_{SEED}.jsonl'
    lines = file.read_text().splitlines(keepends=True)
    file.write_text(''.join([*lines, lines[-1]]))
    [mission, _] = verified(run_folder, status=1)
    assert 'the mission was over' in mission


def test_another_scenario_is_named(run_folder: Path, verified: Verified) -> None:
    changed('antennas: ', 'antennas: 1')(run_folder / 'scenario.yaml')
    [mission, _] = verified(run_folder, status=1)
    assert 'header: scenario paper_8x8 with fingerprint ' in mission


def test_a_change_of_the_scenario_that_means_nothing_is_none(
    run_folder: Path, verified: Verified
) -> None:
    file = run_folder / 'scenario.yaml'
    file.write_text(f'# mine\n{file.read_text()}')
    verified(run_folder, status=0)


def test_a_log_alone_takes_the_scenario_that_is_given(
    run_folder: Path, small: Scenario, tmp_path: Path, verified: Verified
) -> None:
    elsewhere = shutil.move(run_folder / f'mission_{SEED}.jsonl', tmp_path / 'alone.jsonl')
    (tmp_path / 'my.yaml').write_text(small.to_yaml())
    verified(elsewhere, status=1)  # the shipped one of its name has other energy
    verified(elsewhere, '--scenario', tmp_path / 'my.yaml', status=0)


def test_other_code_is_named_if_the_mission_is_another_one(
    run_folder: Path, verified: Verified
) -> None:
    origin = json.loads((run_folder / ORIGIN_FILE).read_text())
    (run_folder / ORIGIN_FILE).write_text(json.dumps({**origin, 'sources': 'elsewhere'}))
    verified(run_folder, status=0)
    changed('"event": 2, "time_s": ', '"event": 2, "time_s": 1')(
        run_folder / f'mission_{SEED}.jsonl'
    )
    [mission, _] = verified(run_folder, status=1)
    assert 'other code: sources elsewhere then, ' in mission


def test_a_policy_file_is_looked_for_in_the_run_folder_and_where_it_is_given(
    small: Scenario, site: Site, tmp_path: Path, verified: Verified
) -> None:
    policy = saved(tmp_path, 'mine', header(side=8))
    folder = keep(tmp_path / 'run', small, *fly(site, [SEED], str(policy)))
    [mission, last] = verified(folder, status=2)
    assert "UAV 1: policy 'mine' is not here: give its .safetensors file" in mission
    assert last == '1 mission: 1 cannot be proved'
    verified(folder, '--policy', policy, status=0)
    shutil.copy(policy, folder)
    verified(folder, status=0)


def test_a_function_of_the_user_is_run_and_proved_only_if_the_user_says_so(
    small: Scenario, site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    verified: Verified,
) -> None:  # fmt: skip
    source = 'def choose(situation):\n    return int(situation.legal.argmax())\n'
    (tmp_path / 'the_users_own.py').write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    [log] = fly(site, [SEED], 'the_users_own:choose')
    folder = keep(tmp_path / 'run', small, log)
    [mission, _] = verified(folder, status=2)
    assert 'is code that the recording names: run it with --policy the_users_own:choose' in mission
    verified(folder, '--policy', 'the_users_own:choose', status=0)
    text = (folder / f'mission_{SEED}.jsonl').read_text()
    (folder / f'mission_{SEED}.jsonl').write_text(text.replace('the_users_own', 'not_there'))
    [mission, _] = verified(folder, '--policy', 'not_there:choose', status=2)
    assert 'there is no module not_there' in mission


def test_a_log_without_its_events_or_a_folder_without_its_bag_is_not_proved(
    small: Scenario, log: MissionLog, tmp_path: Path, verified: Verified
) -> None:
    folder = keep(tmp_path / 'run', small, log)
    (folder / 'bag').mkdir()
    (folder / 'bag' / 'metadata.yaml').write_text('rosbag2_bagfile_information: {}\n')
    [bag, *_] = verified(folder, status=1)
    assert bag.startswith('bag: damaged: ')
    assert 'not a bag, it has metadata.yaml, but none of the files .mcap, .db3' in bag
    (folder / 'bag' / 'metadata.yaml').unlink()
    file = folder / f'mission_{SEED}.jsonl'
    file.write_text(file.read_text().partition('\n')[0] + '\n')
    assert verified(folder, status=2)[0] == f'{file.name}: cannot be proved: holds no event'
    file.write_text('[' * 100_000)
    verified(folder, status=2)


def test_what_the_failsafe_did_is_taken_as_recorded_and_counted(
    small: Scenario, tmp_path: Path, verified: Verified
) -> None:
    log = flown_without(small, SEED, 'sweep', uav=1, since=2)
    [mission, _] = verified(keep(tmp_path / 'run', small, log), status=0)
    assert mission.endswith(', 1 failsafe taken as recorded')


def test_a_uav_that_never_had_an_agent_is_flown_by_the_failsafe(
    small: Scenario, tmp_path: Path, verified: Verified
) -> None:
    log = flown_without(small, SEED, 'sweep', uav=1, since=0)
    folder = keep(tmp_path / 'run', small, log)
    file = folder / f'mission_{SEED}.jsonl'
    head, tail = file.read_text().split('"id": 2')
    absent = tail.replace('"sweep"', '"none"', 1).replace('"exact"', '"none"', 1)
    file.write_text(f'{head}"id": 2{absent}')
    verified(folder, status=0)


def test_a_mission_that_was_aborted_is_proved_as_far_as_it_was_flown(
    site: Site, log: MissionLog, tmp_path: Path, verified: Verified
) -> None:
    cut = MissionLog(header=log.header, events=log.events[:5])
    lines = verified(keep(tmp_path / 'run', site.scenario, cut), status=0)
    assert lines[0].endswith('5 events, cut off before its end')


@pytest.mark.parametrize(
    ('name', 'words'), [('nothing', 'No such file'), ('empty', 'no mission log')]
)
def test_it_says_where_there_is_no_mission(
    tmp_path: Path, name: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / 'empty').mkdir()
    assert main(['verify', str(tmp_path / name)]) == 2
    assert words in capsys.readouterr().err


def unreadable(path: Path) -> Path:
    """A file that is too large to be a mission log."""
    with path.open('wb') as file:
        file.truncate(1 << 30)
    return path


@pytest.mark.parametrize(
    ('is_changed', 'status', 'came_of'), [(False, 2, '1 proved'), (True, 1, '1 differs')]
)
def test_what_cannot_be_read_is_named_and_the_rest_is_proved(
    is_changed: bool, status: int, came_of: str, run_folder: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    if is_changed:
        changed('"event": 2, "time_s": ', '"event": 2, "time_s": 1')(
            run_folder / f'mission_{SEED}.jsonl'
        )
    (tmp_path / 'none.jsonl').write_text('none\n')
    paths = tmp_path / 'none.jsonl', tmp_path / 'nothing', unreadable(tmp_path / 'large.jsonl')
    found = tmp_path / 'found.json'
    asked = [*map(str, (*paths, run_folder)), '--json', str(found)]
    assert main(['verify', *asked]) == status
    shown = capsys.readouterr()
    assert [line.split(': ')[:2] for line in shown.err.splitlines()] == [
        ['error', str(path)] for path in paths
    ]
    [mission, last] = shown.out.splitlines()
    assert mission.startswith(f'{run_folder}: mission_{SEED}.jsonl: ')
    assert last == f'4 missions: {came_of}, 3 cannot be proved'
    assert len(json.loads(found.read_text())) == 4


def test_a_log_of_a_folder_that_cannot_be_read_does_not_end_the_others(
    run_folder: Path, verified: Verified
) -> None:
    unreadable(run_folder / 'a.jsonl')
    [first, second, last] = verified(run_folder, status=2)
    assert first.startswith('a.jsonl: cannot be proved: cannot be read: has 1,073,741,824 bytes')
    assert second.startswith(f'mission_{SEED}.jsonl: proved')
    assert last == '2 missions: 1 proved, 1 cannot be proved'


def test_a_mission_of_lost_messages_and_faults_is_proved_with_what_was_injected(
    tmp_path: Path, verified: Verified
) -> None:
    rough = load('rough_10x10', {'faults.0.share': 1.0})
    folder = keep(tmp_path / 'run', rough, *fly(build_site(rough), [1, 2], 'sweep'))
    *_, last = verified(folder, status=0)
    assert last == '2 missions: 2 proved'
    changed('"fault": "gone"', '"fault": "slow"')(folder / 'mission_1.jsonl')
    [first, *_] = verified(folder, status=1)
    assert 'differs: event ' in first


@pytest.fixture(scope='module')
def faulty(site: Site) -> MissionLog:
    return flown_with_injected(site, 'sweep', 6, ('slow', 1))


@pytest.mark.parametrize(
    ('field', 'other'),
    [
        ('"uav": 2', '"uav": "2"'),
        ('"uav": 2', '"uav": [2]'),
        ('"uav": 2', '"uav": true'),
        ('"uav": 2', '"UAV": 2'),
        ('"event": 6', '"event": 6.0'),
        ('"fault": "slow"', '"fault": ["slow"]'),
    ],
)
def test_a_fault_with_a_value_of_another_kind_differs(
    field: str, other: str, faulty: MissionLog, small: Scenario, tmp_path: Path, verified: Verified
) -> None:
    folder = keep(tmp_path / 'run', small, faulty)
    [line] = [it for it in faulty.to_jsonl().decode().splitlines() if '"fault": "slow"' in it]
    assert field in line
    changed(line, line.replace(field, other))(folder / 'mission_0.jsonl')
    [mission, _] = verified(folder, status=1)
    assert 'differs: event 6: 1 faults are recorded, flown 0' in mission


def test_a_policy_of_another_version_is_named_though_only_its_log_is_left(
    small: Scenario, log: MissionLog, tmp_path: Path, verified: Verified
) -> None:
    run = MissionFolder(str(tmp_path / 'run'))
    run.keep_scenario(small.to_yaml(), fingerprint(small))
    run.begin(log.header, 0, {'sweep': 'older'})
    run.append(log.events)
    run.end()
    [mission, _] = verified(tmp_path / 'run', status=1)
    assert mission.endswith(
        'flown to the same bytes; policy sweep is of version rule now, of older then'
    )


def test_a_function_that_would_end_the_program_is_a_difference(
    site: Site, small: Scenario, verified: Callable[..., list[str]], tmp_path: Path
) -> None:
    [log] = fly(site, [SEED], 'hostile_policies:numpy_number')
    lines = [
        line.replace('numpy_number', 'leaves') for line in log.to_jsonl().decode().splitlines()
    ]
    folder = tmp_path / 'run'
    folder.mkdir()
    (folder / f'mission_{SEED}.jsonl').write_text('\n'.join(lines) + '\n')
    (folder / 'scenario.yaml').write_text(small.to_yaml())
    said = verified(folder, '--policy', 'hostile_policies:leaves', status=1)
    assert any('UAV 1 at 0.0 s in cell 0: SystemExit: 7 (hostile_policies.py' in it for it in said)


def test_a_policy_file_of_before_is_taken_and_said_to_be_one(
    small: Scenario, site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = of_before(saved(tmp_path, 'mine', header(side=8)))
    folder = keep(tmp_path / 'run', small, *fly(site, [SEED], str(file)))
    assert main(['verify', '--policy', str(file), str(folder)]) == 0
    said = capsys.readouterr().err.splitlines()
    assert said[0].startswith('policy mine is of uav_collect.policy/1: ')

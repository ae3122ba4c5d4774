"""The command report, of logs, folders and bags."""

from collections.abc import Iterator
from dataclasses import replace
import errno
import math
import os
from pathlib import Path
import re
import shutil
import sys

from bags import ABORTED, HandMadeBag, STARTED
import numpy as np
from processes import complaints, completed
import pytest
from uav_collect.__main__ import main
from uav_collect.analysis import trajectories
from uav_collect.analysis.choice_file import CHOICE_JSON
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.analysis.plan_shares import time_share
from uav_collect.commands import report
from uav_collect.missions import rollout
from uav_collect.planning.bound import bound_of
from uav_collect.recording import bag_reader
from uav_collect.recording.bag_reader import RecordedMission, Recording
from uav_collect.recording.mission_log import MissionLog, read
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site


@pytest.fixture(scope='module')
def small() -> Scenario:
    return load('paper_8x8')


@pytest.fixture(scope='module')
def run_folder(small: Scenario, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('run')
    (log,) = rollout.fly(build_site(small), [4], 'sweep', 'exact')
    (folder / 'mission.jsonl').write_bytes(log.to_jsonl())
    (folder / 'scenario.yaml').write_text(small.to_yaml())
    return folder


@pytest.fixture
def report_folder(run_folder: Path, tmp_path: Path) -> Iterator[Path]:
    for file in ('mission.jsonl', 'scenario.yaml'):
        (tmp_path / file).write_bytes((run_folder / file).read_bytes())
    return tmp_path


def test_a_damaged_choice_is_a_line_and_the_missions_are_shown_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / CHOICE_JSON).write_text('{"format": "another"}')
    shown: list[object] = []
    monkeypatch.setattr(report, 'show_missions', lambda arguments: shown.append(arguments) or 0)
    assert main(['report', str(tmp_path)]) == 0
    assert len(shown) == 1
    [line] = complaints(capsys.readouterr().err)
    assert line.startswith(f'{tmp_path / CHOICE_JSON}: is no choice of a policy: format must be ')


@pytest.mark.parametrize('name', ['', 'mission.jsonl'])
def test_report_of_a_folder_or_a_log_prints_and_draws(
    report_folder: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['report', str(report_folder / name)]) == 0
    shown = capsys.readouterr().out
    for words in (
        'paper_8x8, mission seed 4',
        'Mbit',
        'kJ',
        'kbit/J',
        'decisions',
        'map complete',
    ):
        assert words in shown
    assert 'warning' not in shown
    assert (report_folder / 'mission.png').read_bytes().startswith(b'\x89PNG')


def test_report_waits_for_no_compiler(report_folder: Path, tmp_path: Path) -> None:
    kernels = {'XDG_CACHE_HOME': str(tmp_path / 'cache'), 'UAV_COLLECT_KERNELS': ''}
    command = (sys.executable, '-m', 'uav_collect', 'report', report_folder)
    done = completed(*command, env=os.environ | kernels)
    assert '% of the clairvoyant plan' in done.stdout
    assert not list((tmp_path / 'cache').rglob('*.nbi'))


def test_report_draws_where_it_is_asked_to(
    report_folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    elsewhere = tmp_path_factory.mktemp('pictures') / 'of' / 'mine'
    assert main(['report', str(report_folder), '--pictures', str(elsewhere)]) == 0
    assert [file.name for file in elsewhere.iterdir()] == [f'{report_folder.name}_mission.png']
    unread = elsewhere.parent / 'unread'
    assert main(['report', str(elsewhere / 'nothing'), '--pictures', str(unread)]) == 2
    assert not unread.exists()


def test_pictures_of_recordings_with_the_same_seed_lie_side_by_side(
    small: Scenario, tmp_path: Path
) -> None:
    site = build_site(small)
    [log] = rollout.fly(site, [4], 'sweep')
    for name in ('run/bag', 'run/again', 'other/bag'):
        bag = HandMadeBag(tmp_path / name)
        bag.add_scenario(site)
        bag.add_mission(log, 'world-0')
        bag.writer.close()
    assert main(['report', str(tmp_path / 'run'), '--html']) == 0
    drawn = {file.name for file in (tmp_path / 'run').iterdir() if file.is_file()}
    assert drawn == {
        'trajectories_seed_4.png', 'trajectories_again_seed_4.png', 'film.html',
        'film_seed_4.html',
    }  # fmt: skip
    for name in ('run', 'run/bag', 'run/again', 'other'):
        asked = ['--html', '--pictures', str(tmp_path / 'all')]
        assert main(['report', str(tmp_path / name), *asked]) == 0
    names = {file.name for file in (tmp_path / 'all').iterdir()}
    pictures = {'run_trajectories_seed_4.png', 'run_trajectories_again_seed_4.png'}
    assert names >= {*pictures, 'other_trajectories_seed_4.png', 'run_film.html'}
    assert 'other_film.html' in names


def test_films_of_two_bags_beside_each_other_have_names_of_their_own(
    small: Scenario, tmp_path: Path
) -> None:
    site = build_site(small)
    [log] = rollout.fly(site, [4], 'sweep')
    for name in ('monday', 'tuesday'):
        bag = HandMadeBag(tmp_path / name)
        bag.add_scenario(site)
        bag.add_mission(log, 'world-0')
        bag.writer.close()
        assert main(['report', str(tmp_path / name), '--html']) == 0
    assert {file.name for file in tmp_path.iterdir() if file.is_file()} == {
        'trajectories_monday_seed_4.png', 'film_monday_seed_4.html',
        'trajectories_tuesday_seed_4.png', 'film_tuesday_seed_4.html',
    }  # fmt: skip


def test_report_leaves_a_film_beside_the_picture_if_asked(
    report_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['report', str(report_folder), '--html']) == 0
    assert f'film: {report_folder / "film.html"}' in capsys.readouterr().out
    page = (report_folder / 'film.html').read_bytes()
    assert b'paper_8x8' in page
    assert len(page) < 400_000
    (report_folder / 'film.html').unlink()
    assert main(['report', str(report_folder / 'mission.jsonl'), '--html']) == 0
    assert (report_folder / 'film_mission.html').is_file()


def test_a_film_that_cannot_be_written_is_named(
    report_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (report_folder / 'film.html').mkdir()
    assert main(['report', str(report_folder), '--html']) == 2
    [line] = complaints(capsys.readouterr().err)
    assert 'film.html' in line


def test_report_finds_a_shipped_scenario_by_itself(report_folder: Path) -> None:
    (report_folder / 'scenario.yaml').unlink()
    assert main(['report', str(report_folder)]) == 0


def test_report_refuses_another_scenario(
    report_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (report_folder / 'scenario.yaml').write_text(load('paper_10x10').to_yaml())
    assert main(['report', str(report_folder)]) == 2
    assert 'must be the scenario of the log, paper_8x8' in capsys.readouterr().err


def test_report_refuses_a_log_that_does_not_add_up(
    report_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = report_folder / 'mission.jsonl'
    lines = path.read_text().splitlines(keepends=True)
    path.write_text(''.join(lines[:3] + lines[4:]))
    assert main(['report', str(report_folder)]) == 2
    wrong = 'event is 3: must be 2, they follow each other'
    error = f'error: {path}: line 4: no event of a mission log: {wrong}\n'
    assert capsys.readouterr().err == error


@pytest.mark.parametrize(
    'error',
    [
        OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)),
        OverflowError('Exceeded cell block limit'),  # by Matplotlib's renderer
        RuntimeError('Can not load face'),  # by its fonts
        ValueError('Image size is too large'),
    ],
    ids=repr,
)
def test_a_picture_that_cannot_be_drawn_costs_a_line(
    report_folder: Path,
    error: Exception,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def drawn(*_: object) -> None:
        raise error

    monkeypatch.setattr(trajectories, 'trajectories', drawn)
    assert main(['report', str(report_folder)]) == 2
    shown = capsys.readouterr()
    why = getattr(error, 'strerror', None) or error
    assert complaints(shown.err) == [f'error: {report_folder}/mission.png: cannot be drawn: {why}']
    assert 'completion time' in shown.out


def test_a_mistake_in_drawing_is_not_taken_for_a_picture_that_cannot_be_drawn(
    report_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def mistaken(*_: object) -> None:
        raise KeyError('uav')

    monkeypatch.setattr(trajectories, 'trajectories', mistaken)
    with pytest.raises(KeyError):
        main(['report', str(report_folder)])


@pytest.mark.parametrize(
    ('name', 'words'), [('nothing', 'No such file'), ('empty', 'holds no mission log')]
)
def test_report_says_where_there_is_no_mission(
    tmp_path: Path, name: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / 'empty').mkdir()
    assert main(['report', str(tmp_path / name)]) == 2
    assert words in capsys.readouterr().err


def recorded(scenario: Scenario, log: MissionLog, *, is_complete: bool) -> RecordedMission:
    site = build_site(scenario)
    return RecordedMission(
        log=log,
        site=site,
        demand_bit=np.zeros(site.n_sensors),
        n_radio_messages=31,
        is_complete=is_complete,
    )


@pytest.mark.parametrize('inside', ['', '..'])
def test_report_of_a_bag_or_the_folder_around_it_tells_the_messages(
    run_folder: Path, small: Scenario, inside: str, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag' / 'bag_0.mcap').touch()
    log = read(run_folder / 'mission.jsonl')
    flown = recorded(small, log, is_complete=True)
    monkeypatch.setattr(
        bag_reader, 'read_recording', lambda _: Recording(missions=[flown], damages=[])
    )
    assert main(['report', os.path.normpath(tmp_path / 'bag' / inside)]) == 0
    assert 'radio messages' in capsys.readouterr().out
    assert (tmp_path / 'trajectories_seed_4.png').exists()


def test_report_of_a_recording_with_a_gap_says_so(
    run_folder: Path, small: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    (tmp_path / 'bag_0.mcap').touch()
    log = read(run_folder / 'mission.jsonl')
    gappy = replace(log, events=np.delete(log.events, 3))
    flown = recorded(small, gappy, is_complete=False)
    recording = Recording(missions=[flown], damages=[])
    monkeypatch.setattr(bag_reader, 'read_recording', lambda _: recording)
    assert main(['report', str(tmp_path)]) == 0
    assert 'warning: the mission was given up, not all of it' in capsys.readouterr().out


def test_report_of_a_broken_bag_says_what_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / 'bag_0.mcap').touch()
    assert main(['report', str(tmp_path)]) == 2
    shown = capsys.readouterr().err
    assert shown.startswith('error: ')
    assert shown.count('\n') == 1
    assert 'is not an MCAP file' in shown


def test_report_of_a_run_whose_bag_is_broken_or_gappy_is_that_of_its_log(
    report_folder: Path, small: Scenario, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    (report_folder / 'mission.jsonl').rename(report_folder / 'mission_4.jsonl')
    (report_folder / 'bag').mkdir()
    (report_folder / 'bag' / 'bag_0.mcap').touch()
    assert main(['report', str(report_folder)]) == 0
    broken = capsys.readouterr()
    [line] = complaints(broken.err)
    assert line.endswith('the figures are those of the mission log')
    log = read(report_folder / 'mission_4.jsonl')
    gappy = replace(log, events=np.delete(log.events, 3))
    flown = recorded(small, gappy, is_complete=False)
    recording = Recording(missions=[flown], damages=[])
    monkeypatch.setattr(bag_reader, 'read_recording', lambda _: recording)
    assert main(['report', str(report_folder)]) == 0
    shown = capsys.readouterr()
    [line] = complaints(shown.err)
    assert line.endswith('lacks 1 event; the figures are those of mission_4.jsonl')
    assert 'warning' not in shown.out
    tables = [text.partition('\npicture')[0] for text in (broken.out, shown.out)]
    assert tables[0] == tables[1]


@pytest.mark.usefixtures('bound_cache')
def test_report_tells_how_near_a_mission_came(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = load('paper_8x8')
    [log] = rollout.fly(build_site(scenario), [4], 'sweep', 'equal')
    (tmp_path / 'mission.jsonl').write_bytes(log.to_jsonl())
    assert main(['report', str(tmp_path)]) == 0
    share = time_share(mission_metrics(log), bound_of(build_site(scenario), 4, 'equal'))
    wanted = f'{math.floor(1000 * share) / 10:.1f} % of the clairvoyant plan'
    assert wanted in capsys.readouterr().out


@pytest.mark.usefixtures('bound_cache')
def test_report_is_silent_where_a_bound_takes_too_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from uav_collect.commands import report

    monkeypatch.setattr(report, '_MAX_DATA_CELLS', 19)  # 0.3 of 64 is more
    site = build_site(load('paper_8x8'))
    [log] = rollout.fly(site, [4], 'sweep')
    (tmp_path / 'mission.jsonl').write_bytes(log.to_jsonl())
    assert main(['report', str(tmp_path)]) == 0
    assert 'clairvoyant' not in capsys.readouterr().out


@pytest.mark.parametrize('n_cut_byte', [5, 3000])
def test_report_of_a_log_that_was_cut_off_shows_its_whole_lines(
    report_folder: Path, n_cut_byte: int, capsys: pytest.CaptureFixture[str]
) -> None:
    path = report_folder / 'mission.jsonl'
    path.write_bytes(path.read_bytes()[:-n_cut_byte])
    assert main(['report', str(path)]) == 0
    shown = capsys.readouterr().out
    assert 'paper_8x8, mission seed 4' in shown
    assert 'warning: the mission was given up, not all of it' in shown


@pytest.mark.parametrize(
    ('content', 'words'),
    [(b'\xff\xfe', 'must be UTF-8 text'), (b'a: [', 'is not valid YAML')],
)
def test_report_names_the_scenario_file_that_is_none(
    report_folder: Path, content: bytes, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = report_folder / 'scenario.yaml'
    file.write_bytes(content)
    assert main(['report', str(report_folder)]) == 2
    shown = capsys.readouterr().err
    assert shown.startswith(f'error: {file}')
    assert words in shown


def test_report_of_a_damaged_bag_names_the_damage_and_shows_what_is_whole(
    small: Scenario, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site = build_site(small)
    [log] = rollout.fly(site, [4], 'sweep')
    bag = HandMadeBag(tmp_path / 'bag', chunk_byte=2_000)
    bag.add_scenario(site)
    bag.add_mission(log, 'world-0')
    bag.writer.close()
    file = tmp_path / 'bag' / 'bag.mcap'
    content = bytearray(file.read_bytes())
    content[len(content) // 3] ^= 1
    file.write_bytes(content)
    assert main(['report', str(tmp_path / 'bag')]) == 0
    shown = capsys.readouterr()
    damage, advice = complaints(shown.err)
    assert damage.startswith(f'{tmp_path}/bag: bag.mcap: chunk ')
    assert advice == f'recorder --repair {tmp_path}/bag keeps what is whole'
    assert 'warning: the mission was given up, not all of it' in shown.out


def test_report_of_a_mission_that_was_given_up_says_why_and_speaks_of_no_damage(
    small: Scenario, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site = build_site(small)
    [log] = rollout.fly(site, [4], 'sweep')
    cut_off = replace(log, events=log.events[:5])
    bag = HandMadeBag(tmp_path / 'bag')
    bag.add_scenario(site)
    bag.add_mission(cut_off, 'world-0', phases=[STARTED])
    bag.add('/world/mission', 'Mission', mission_id='world-0', phase=ABORTED, n_decisions=5,
            note='cut off by max_decisions')  # fmt: skip
    bag.writer.close()
    assert main(['report', str(tmp_path / 'bag')]) == 0
    shown = ' '.join(capsys.readouterr().out.split())
    assert 'warning: its world gave the mission up: cut off by max_decisions;' in shown
    assert 'damaged' not in shown


def test_report_shows_the_bags_of_a_folder_that_can_be_read(
    small: Scenario, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site = build_site(small)
    [log] = rollout.fly(site, [4], 'sweep')
    for name in ('a', 'b', 'c'):
        (tmp_path / name).mkdir()
        (tmp_path / name / 'none.mcap').write_bytes(b'none')
    shutil.rmtree(tmp_path / 'b')
    bag = HandMadeBag(tmp_path / 'b')
    bag.add_scenario(site)
    bag.add_mission(log, 'world-0')
    bag.writer.close()
    assert main(['report', str(tmp_path)]) == 2
    shown = capsys.readouterr()
    assert 'mission seed 4' in shown.out
    assert [line for line in shown.err.splitlines() if line.startswith('error: ')] == [
        f'error: {tmp_path}/{name}/none.mcap: is not an MCAP file' for name in ('a', 'c')
    ]


def test_report_shows_the_logs_of_a_folder_that_can_be_read(
    small: Scenario, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / 'scenario.yaml').write_text(small.to_yaml())
    for name, log in zip('bdf', rollout.fly(build_site(small), [4, 5, 6], 'sweep'), strict=True):
        (tmp_path / f'{name}.jsonl').write_bytes(log.to_jsonl())
    (tmp_path / 'a.jsonl').write_text('none\n')
    with (tmp_path / 'c.jsonl').open('wb') as large:
        large.truncate(1 << 30)
    does_not_add_up = tmp_path / 'd.jsonl'
    text = does_not_add_up.read_text()
    does_not_add_up.write_text(re.sub(r'"energy_left_j": [0-9.]+', '"energy_left_j": 1.5', text))
    (tmp_path / 'e.jsonl').symlink_to(tmp_path / 'nothing')
    table = tmp_path / 'readings.csv'
    assert main(['report', str(tmp_path), '--csv', str(table)]) == 2
    shown = capsys.readouterr()
    named = [line for line in shown.err.splitlines() if line.startswith('error: ')]
    assert [line.partition('.jsonl: ')[0] for line in named] == [
        f'error: {tmp_path}/{name}' for name in 'acde'
    ]
    for seed, is_shown in ((4, True), (5, False), (6, True)):
        assert (f'mission seed {seed}' in shown.out) == is_shown
    seeds = {line.partition(',')[0] for line in table.read_text().splitlines()[1:]}
    assert seeds == {'4', '6'}


def test_a_scenario_that_many_logs_lack_is_named_once(
    report_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(report_folder / 'mission.jsonl', report_folder / 'another.jsonl')
    (report_folder / 'scenario.yaml').write_text('a: [')
    assert main(['report', str(report_folder)]) == 2
    assert capsys.readouterr().err.count('is not valid YAML') == 1


def test_where_the_log_of_a_gappy_bag_cannot_be_read_the_bag_is_shown(
    small: Scenario, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site = build_site(small)
    [log] = rollout.fly(site, [4], 'sweep')
    bag = HandMadeBag(tmp_path / 'bag')
    bag.add_scenario(site)
    bag.add_mission(replace(log, events=log.events[:5]), 'world-0', phases=[STARTED])
    bag.writer.close()
    (tmp_path / 'mission_4.jsonl').write_text('none\n')
    assert main(['report', str(tmp_path)]) == 2
    shown = capsys.readouterr()
    assert 'mission seed 4' in shown.out
    assert f'error: {tmp_path}/mission_4.jsonl: line 1: ' in shown.err


@pytest.mark.parametrize('name', ['pipe', 'pipe.jsonl', 'pipe.mcap', 'pipe.db3', 'pipe.bag'])
@pytest.mark.parametrize('command', ['report', 'verify'])
def test_a_pipe_is_no_recording(
    tmp_path: Path, command: str, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    os.mkfifo(tmp_path / name)
    assert main([command, str(tmp_path / name)]) == 2
    shown = capsys.readouterr().err
    assert shown == f'error: {tmp_path}/{name}: is a pipe or a device: must be a file\n'


def test_a_log_whose_figures_do_not_add_up_is_named(
    report_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = report_folder / 'mission.jsonl'
    lines = path.read_text().splitlines(keepends=True)
    lines[3] = re.sub(r'"energy_left_j": ([0-9.]+)', '"energy_left_j": 1.5', lines[3])
    path.write_text(''.join(lines))
    assert main(['report', str(report_folder)]) == 2
    assert capsys.readouterr().err.startswith(f'error: {path}: event ')


@pytest.mark.parametrize('command', ['report', 'verify'])
def test_links_that_lead_in_a_circle_are_said_to(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    loop = tmp_path / 'loop'
    loop.symlink_to(loop)
    assert main([command, str(loop)]) == 2
    assert capsys.readouterr().err == f'error: {loop}: Too many levels of symbolic links\n'


@pytest.mark.parametrize('content', [b'', b'\xff\x00\n\x01', b'\xef\xbb\xbf{}\n'])
@pytest.mark.parametrize('command', ['report', 'verify', 'verify --scenario paper_8x8'])
def test_what_is_no_log_is_said_to_be_none(
    command: str, content: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'mission.jsonl'
    path.write_bytes(content)
    name, *options = command.split()
    assert main([name, str(path), *options]) == 2
    shown = capsys.readouterr()
    assert shown.out == ''
    assert shown.err.startswith(f'error: {path}: line 1: ')
    assert shown.err.count('\n') == 1

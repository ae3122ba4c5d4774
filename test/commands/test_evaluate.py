"""The commands: evaluate, report, doctor and what they have in common."""

from collections.abc import Callable, Iterator, Sequence
import csv
from dataclasses import replace
import json
import os
from pathlib import Path
import subprocess
import sys

import numpy as np
import pytest
from random_policies import header as header_of_policy
from random_policies import saved
from scripted_logs import fly, header, uav
from uav_collect import files
from uav_collect.__main__ import main, SUMMARIES
from uav_collect.analysis import statistics
from uav_collect.analysis.metrics import mission_metrics, MissionMetrics
from uav_collect.commands import doctor
from uav_collect.missions import rollout
from uav_collect.recording import bag_reader
from uav_collect.recording.bag_reader import RecordedMission
from uav_collect.recording.mission_log import MissionLog, read
from uav_collect.scenario.load import fingerprint, load, Scenario, with_uavs
from uav_collect.scenario.site import build_site, Site

MEASURES = (
    'efficiency_kbit_per_j',
    'completion_s',
    'energy_kj',
    'collected_share',
    'complete_share',
    'safe_share',
)
SMALL = ['--scenario', 'paper_8x8', '--missions', '12', '--seed', '5']


@pytest.fixture(scope='module')
def small() -> Scenario:
    return load('paper_8x8')


def mission(seed: int, hover_s: float, collected_mbit: float = 0.5) -> MissionMetrics:
    log = fly(header([uav(1)], total_bit=0.5e6), [[f'hover {hover_s} {collected_mbit}', 'home']])
    return mission_metrics(MissionLog(header=log.header, events=log.events))


def evaluate(*arguments: str) -> int:
    return main(['evaluate', *arguments])


# The estimates.


def test_the_interval_of_equal_missions_is_a_point() -> None:
    for row in statistics.estimates([mission(0, 3.0)] * 7, seed=0):
        assert row.low == row.mean == row.high == row.median


def test_the_interval_of_one_mission_is_that_mission() -> None:
    efficiency, *_ = statistics.estimates([mission(0, 2.0)], seed=0)
    assert efficiency.low == efficiency.mean == efficiency.high == 0.5e3 / 400.0


def test_the_interval_is_that_of_the_normal_law_for_many_missions() -> None:
    values = np.random.default_rng(1).normal(10.0, 2.0, size=(4000, 1))
    low, high = statistics.bootstrap_interval(values, seed=0)
    half = 1.96 * values.std() / np.sqrt(len(values))
    assert low[0] == pytest.approx(values.mean() - half, abs=0.15 * half)
    assert high[0] == pytest.approx(values.mean() + half, abs=0.15 * half)


def test_the_interval_covers_the_truth_as_often_as_it_says() -> None:
    rng = np.random.default_rng(2)
    samples = rng.exponential(1.0, size=(100, 200))  # 200 evaluations of 100 missions, mean 1
    bounds = [statistics.bootstrap_interval(column[:, None], 0) for column in samples.T]
    covered = np.mean([low[0] <= 1.0 <= high[0] for low, high in bounds])
    assert 0.88 <= covered <= 0.98


def test_the_interval_depends_on_the_seed_alone() -> None:
    values = np.random.default_rng(3).normal(size=(50, 2))
    once, again = (statistics.bootstrap_interval(values, seed=4) for _ in range(2))
    other = statistics.bootstrap_interval(values, seed=5)
    np.testing.assert_array_equal(once, again)
    assert not np.array_equal(once, other)


def test_the_interval_does_not_depend_on_the_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.random.default_rng(6).normal(size=(64, 3))
    whole = statistics.bootstrap_interval(values, seed=0)
    monkeypatch.setattr(statistics, '_MAX_DRAWS', 64 * 100)
    np.testing.assert_array_equal(statistics.bootstrap_interval(values, seed=0), whole)


def test_no_mission_gives_no_estimate() -> None:
    with pytest.raises(ValueError, match='at least one mission'):
        statistics.estimates([], seed=0)


def test_a_paired_difference_is_that_of_each_mission() -> None:
    ours = [mission(seed, 2.0 + seed) for seed in range(5)]
    theirs = [mission(seed, 1.0 + seed) for seed in range(5)]
    _, completion, energy, *_ = statistics.paired_differences(ours, theirs, seed=0)
    # One second of hovering more in each mission, so no doubt about the mean, however they vary.
    assert completion.mean == completion.median == pytest.approx(1.0, rel=1e-12)
    assert completion.high - completion.low < 1e-9
    assert energy.mean == pytest.approx(ours[0].energy_j / 1e3 - theirs[0].energy_j / 1e3)


def test_missions_that_differ_are_not_compared() -> None:
    one = mission(0, 2.0)
    with pytest.raises(ValueError, match='the same missions'):
        statistics.paired_differences(
            [one], [replace(one, mission_seed=one.mission_seed + 1)], seed=0
        )


# Evaluate, against the rollout it stands on.


def test_evaluate_writes_the_means_of_the_missions_it_flew(
    tmp_path: Path, small: Scenario
) -> None:
    path = tmp_path / 'figures.json'
    assert evaluate(*SMALL, '--policy', 'hert', '--json', str(path)) == 0
    written = json.loads(path.read_text())['hert']
    logs = rollout.fly(build_site(small), range(5, 17), 'hert', 'exact')
    flown = [mission_metrics(log) for log in logs]
    assert written['completion_s']['mean'] == pytest.approx(
        np.mean([one.completion_s for one in flown]), rel=1e-12
    )
    assert written['energy_kj']['mean'] == pytest.approx(
        np.mean([one.energy_j for one in flown]) / 1e3, rel=1e-12
    )
    for key in MEASURES:
        estimate = written[key]
        assert set(estimate) == {'mean', 'low', 'high'}
        assert estimate['low'] <= estimate['mean'] <= estimate['high']


def test_the_json_says_what_was_flown(tmp_path: Path, small: Scenario) -> None:
    path = tmp_path / 'figures.json'
    options_ = ['--policy', 'hert', 'sweep', '--bandwidth', 'equal', '--json', str(path)]
    assert evaluate(*SMALL, *options_) == 0
    written = json.loads(path.read_text())
    assert list(written) == ['hert', 'sweep']
    for entry in written.values():
        assert entry['scenario'] == 'paper_8x8'
        assert entry['fingerprint'] == fingerprint(small)
        assert (entry['seed'], entry['missions'], entry['bandwidth']) == (5, 12, 'equal')


def test_several_bandwidths_are_flown_one_beside_the_other(tmp_path: Path) -> None:
    both, one = tmp_path / 'both.json', tmp_path / 'one.json'
    base = [*SMALL, '--policy', 'hert', 'sweep']
    assert evaluate(*base, '--bandwidth', 'equal', 'exact', '--json', str(both)) == 0
    assert evaluate(*base, '--bandwidth', 'equal', '--json', str(one)) == 0
    written, alone = json.loads(both.read_text()), json.loads(one.read_text())
    assert [*written] == ['hert, equal', 'hert, exact', 'sweep, equal', 'sweep, exact']
    assert written['hert, equal'] == alone['hert']
    assert (written['hert, exact']['policy'], written['hert, exact']['bandwidth']) == (
        'hert',
        'exact',
    )
    assert written['hert, exact']['completion_s'] != written['hert, equal']['completion_s']


def test_compare_subtracts_each_other_policy_from_the_first_mission_by_mission(
    tmp_path: Path, small: Scenario, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'figures.json'
    policies = ['--policy', 'sweep', 'hert', 'hert-equal', '--bandwidth', 'equal', 'exact']
    assert evaluate(*SMALL, *policies, '--compare', '--json', str(path)) == 0
    written = json.loads(path.read_text())
    assert [name for name in written if 'minus' in written[name]] == [
        'sweep, equal',
        'sweep, exact',
    ]
    assert [*written['sweep, equal']['minus']] == ['hert, equal', 'hert-equal, equal']
    found = written['sweep, exact']['minus']['hert, exact']
    assert set(found) == set(MEASURES)
    sweep, hert = (
        np.array([mission_metrics(log).completion_s for log in logs])
        for logs in (
            rollout.fly(build_site(small), range(5, 17), policy, 'exact')
            for policy in ('sweep', 'hert')
        )
    )
    difference = found['completion_s']
    assert difference['mean'] == pytest.approx((sweep - hert).mean(), rel=1e-12)
    assert difference['low'] <= difference['mean'] <= difference['high'] < 0.0
    assert 'sweep, exact minus each other policy' in capsys.readouterr().out


def test_a_learned_policy_is_evaluated_by_its_file(tmp_path: Path) -> None:
    of = header_of_policy(side=8)
    path, output = saved(tmp_path, 'mine', of), tmp_path / 'figures.json'
    budget = ['--set', 'fleet.default.energy_budget_kj=50']
    options_ = [*SMALL, *budget, '--policy', 'hert', str(path), '--json', str(output)]
    assert evaluate(*options_) == 0
    written = json.loads(output.read_text())
    assert [*written] == ['hert', 'mine']
    assert (written['hert']['version'], written['mine']['version']) == ('rule', of.version)
    assert written['mine']['complete_share']['mean'] < 1.0


def test_two_files_of_one_name_are_told_apart_by_their_paths(tmp_path: Path) -> None:
    paths = []
    for seed, folder in enumerate((tmp_path / 'a', tmp_path / 'b')):
        folder.mkdir()
        paths.append(str(saved(folder, 'policy', header_of_policy(side=8), seed)))
    output = tmp_path / 'figures.json'
    budget = ['--set', 'fleet.default.energy_budget_kj=30']
    assert evaluate(*SMALL, *budget, '--policy', *paths, '--json', str(output)) == 0
    assert [*json.loads(output.read_text())] == paths


def test_a_learned_policy_that_does_not_fit_is_refused_before_anything_flies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = saved(tmp_path, 'mine', header_of_policy(side=10))
    assert evaluate(*SMALL, '--policy', 'hert', str(path)) == 2
    shown = capsys.readouterr()
    assert shown.err == 'error: policy mine: cells_per_side is 8: must be 10\n'
    assert shown.out == ''


def test_the_csv_has_one_row_per_mission_and_policy(tmp_path: Path) -> None:
    path = tmp_path / 'missions.csv'
    assert evaluate(*SMALL, '--policy', 'hert', 'sweep', '--csv', str(path)) == 0
    with path.open(newline='') as file:
        rows = list(csv.DictReader(file))
    assert [int(row['mission_seed']) for row in rows] == [*range(5, 17)] * 2
    assert [row['policy'] for row in rows] == ['hert'] * 12 + ['sweep'] * 12
    first, last = rows[0], rows[12]
    assert first['total_mbit'] == last['total_mbit']  # the same missions for each policy
    assert first['completion_s'] != last['completion_s']
    efficiency = float(first['collected_mbit']) / float(first['energy_kj'])
    assert float(first['efficiency_kbit_per_j']) == pytest.approx(efficiency, rel=1e-12)


def test_a_mission_does_not_depend_on_how_many_are_flown(tmp_path: Path) -> None:
    few, many = tmp_path / 'few.csv', tmp_path / 'many.csv'
    base = ['--scenario', 'paper_8x8', '--policy', 'sweep']
    assert evaluate(*base, '--missions', '3', '--seed', '9', '--csv', str(few)) == 0
    assert evaluate(*base, '--missions', '60', '--seed', '0', '--csv', str(many)) == 0
    assert few.read_text().splitlines()[1:] == many.read_text().splitlines()[10:13]


def test_the_table_shows_every_policy_and_measure(capsys: pytest.CaptureFixture[str]) -> None:
    assert evaluate(*SMALL, '--policy', 'hert', 'sweep') == 0
    shown = capsys.readouterr().out
    for words in (
        'hert',
        'sweep',
        'kbit/J',
        'completion time [s]',
        'energy [kJ]',
        '95 % interval',
    ):
        assert words in shown


def test_set_and_uavs_change_the_scenario(tmp_path: Path, small: Scenario) -> None:
    path = tmp_path / 'figures.json'
    changes = ['--set', 'demand.cell_share=0.6', 'radio.csi_error_variance=0.01', '--uavs', '3']
    assert evaluate(*SMALL, *changes, '--json', str(path)) == 0
    changed = load('paper_8x8', {'demand.cell_share': 0.6, 'radio.csi_error_variance': 0.01})
    changed = with_uavs(changed, 3)
    assert [one.speed_mps for one in changed.uavs] == [5.0, 10.0, 5.0]
    assert json.loads(path.read_text())['sweep']['fingerprint'] == fingerprint(changed)


def test_ctrl_c_shows_what_was_flown_and_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = iter(range(100))
    whole = rollout.fly

    def fly_some(
        site: Site, seeds: Sequence[int], policy: Callable, allocator: str
    ) -> list[MissionLog]:
        if next(calls) == 3:  # the second policy's second turn
            raise KeyboardInterrupt
        return whole(site, seeds, policy, allocator)

    monkeypatch.setattr(rollout, 'fly', fly_some)
    arguments = ['--missions', '120', '--policy', 'hert', 'sweep']
    path = tmp_path / 'figures.json'
    assert evaluate('--scenario', 'paper_8x8', *arguments, '--json', str(path)) == 130
    shown = capsys.readouterr().out
    assert 'interrupted after 50 of 120 missions' in shown
    assert '50 missions from seed 0' in shown
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--scenario', 'atlantis'], ["'atlantis'", 'paper_10x10']),
        (['--scenario', 'atlantis.yaml'], ['atlantis.yaml', 'cannot be read']),
        (['--policy', 'wander'], ["'wander'", 'hert', 'sweep']),
        (['--policy', 'hert', 'hert'], ['hert hert', 'twice']),
        (['--policy', 'nowhere.safetensors'], ['nowhere.safetensors', 'cannot be read']),
        (['--bandwidth', 'equal', 'equal'], ['equal equal', 'twice']),
        (['--compare'], ['--compare', 'two policies or more']),
        (['--set', 'demand.cell_share=2'], ['demand.cell_share is 2', '<= 1']),
        (['--set', 'demand.cell_share'], ['demand.cell_share', 'KEY=VALUE']),
        (['--set', 'demand.nonsense=1'], ['demand.nonsense', 'unknown']),
        (['--json', '/nowhere/at/all.json'], ['/nowhere/at/all.json', 'No such file']),
        (['--csv', '/'], ['/', 'folder']),
    ],
)
def test_what_cannot_be_evaluated_is_said_in_one_line(
    arguments: list[str], words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert evaluate('--missions', '1', *arguments) == 2
    shown = capsys.readouterr()
    assert shown.out == ''
    assert shown.err.count('\n') == 1
    assert shown.err.startswith('error: ')
    assert all(word in shown.err for word in words)


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--missions', '0'], ['--missions', "'0'", 'from 1 to']),
        (['--missions', 'many'], ['--missions', "'many'", 'whole number']),
        (['--seed', '-1'], ['--seed', 'from 0 to']),
        (['--uavs', '65'], ['--uavs', 'from 1 to 64']),
        (['--bandwidth', 'all'], ['--bandwidth', 'exact', 'equal', 'cvxpy']),
        (['--speed', '3'], ['--speed']),
        (['--json'], ['--json']),
    ],
)
def test_a_wrong_argument_is_named_in_one_line(
    arguments: list[str], words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as raised:
        evaluate(*arguments)
    assert raised.value.code == 2
    shown = capsys.readouterr().err
    assert shown.count('\n') == 1
    assert all(word in shown for word in words)


def test_a_full_disk_is_said_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    base = ['--scenario', 'paper_8x8', '--missions', '1']
    assert evaluate(*base, '--json', '/dev/full') == 2
    assert capsys.readouterr().err.endswith('error: /dev/full: No space left on device\n')


# What all commands share.


def run(*arguments: str, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, '-m', 'uav_collect', *arguments],
        text=True,
        check=False,
        cwd=Path(__file__).parents[2],
        env={key: value for key, value in os.environ.items() if key != 'PYTHONUNBUFFERED'},
        stderr=subprocess.PIPE,
        **options,
    )


def test_help_lists_the_commands_without_loading_them() -> None:
    program = (
        'import sys; from uav_collect.__main__ import main\n'
        'try: main(["--help"])\n'
        'except SystemExit: pass\n'
        'heavy = {"numpy", "numba", "pydantic", "rich", "rclpy"} & set(sys.modules)\n'
        'assert not heavy, heavy'
    )
    done = subprocess.run(
        [sys.executable, '-c', program],
        text=True,
        capture_output=True,
        check=True,
        cwd=Path(__file__).parents[2],
    )
    assert all(f'  {name} ' in done.stdout for name in SUMMARIES)


@pytest.mark.parametrize('command', ['evaluate', 'report', 'doctor'])
def test_each_command_has_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as raised:
        main([command, '--help'])
    assert raised.value.code == 0
    assert f'usage: python -m uav_collect {command}' in capsys.readouterr().out


@pytest.mark.parametrize('arguments', [[], ['fly'], ['--speed']])
def test_no_or_an_unknown_command_is_a_misuse(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as raised:
        main(arguments)
    assert raised.value.code == 2
    assert capsys.readouterr().err.startswith('error: ')


def test_a_full_disk_under_stdout_is_said_in_one_line() -> None:
    with Path('/dev/full').open('w') as full:
        done = run('doctor', stdout=full)
    assert done.returncode == 2
    assert done.stderr == 'error: No space left on device\n'


def test_a_reader_that_leaves_causes_no_traceback() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    done = run('doctor', stdout=writing)
    os.close(writing)
    assert done.returncode != 0
    assert done.stderr == ''


# Files.


def test_a_file_is_written_whole(tmp_path: Path) -> None:
    path = tmp_path / 'file'
    path.write_bytes(b'old and longer')
    files.write_atomically(path, b'new')
    assert path.read_bytes() == b'new'
    assert list(tmp_path.iterdir()) == [path]


def test_a_failed_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / 'file'
    path.write_bytes(b'old')

    def fail(descriptor: int) -> None:
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(os, 'fsync', fail)
    with pytest.raises(OSError, match=f'No space left on device: .{path}.'):
        files.write_atomically(path, b'new')
    assert path.read_bytes() == b'old'
    assert list(tmp_path.iterdir()) == [path]


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    target, link = tmp_path / 'target', tmp_path / 'link'
    target.touch()
    link.symlink_to(target)
    files.write_atomically(link, b'new')
    assert link.is_symlink()
    assert target.read_bytes() == b'new'


def test_a_pipe_is_written_not_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / 'pipe'
    os.mkfifo(pipe)
    with subprocess.Popen(['cat', pipe], stdout=subprocess.PIPE) as reader:
        files.check_writable(pipe)
        files.write_atomically(pipe, b'through')
        assert reader.communicate()[0] == b'through'
    assert pipe.is_fifo()


def test_new_files_have_the_permissions_of_the_user(tmp_path: Path) -> None:
    mine, theirs = tmp_path / 'mine', tmp_path / 'theirs'
    mine.touch()
    files.write_atomically(theirs, b'')
    assert mine.stat().st_mode == theirs.stat().st_mode


# Report.


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


def test_report_draws_where_it_is_told(
    report_folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    elsewhere = tmp_path_factory.mktemp('pictures')
    assert main(['report', str(report_folder), '--pictures', str(elsewhere)]) == 0
    assert [file.name for file in elsewhere.iterdir()] == ['mission.png']


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
    assert capsys.readouterr().err == 'error: record 2 says event 3\n'


@pytest.mark.parametrize(
    ('name', 'words'), [('nothing', 'no such file'), ('empty', 'holds no mission log')]
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
        bag_reader, 'read_missions', lambda path: [flown] if path.name == 'bag' else []
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
    monkeypatch.setattr(bag_reader, 'read_missions', lambda _: [flown])
    assert main(['report', str(tmp_path)]) == 0
    assert 'warning: not all of the mission was recorded' in capsys.readouterr().out


def test_report_of_a_broken_bag_says_what_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / 'bag_0.mcap').touch()
    assert main(['report', str(tmp_path)]) == 2
    shown = capsys.readouterr().err
    assert shown.startswith('error: ')
    assert shown.count('\n') == 1
    assert 'recorder --repair' in shown


# Doctor.


def problems(environment: dict[str, str]) -> dict[str, str]:
    healthy = {'HOME': str(Path.home()), 'ROS_DISTRO': 'jazzy'}
    findings = doctor.examine({**healthy, **environment})
    return {finding.topic: finding.problem for finding in findings if finding.problem}


@pytest.mark.parametrize(
    ('environment', 'topic'),
    [
        ({'ROS_DOMAIN_ID': '233'}, 'domain'),
        ({'ROS_DOMAIN_ID': 'one'}, 'domain'),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'}, 'discovery'),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'near'}, 'discovery'),
        ({'ROS_DISTRO': 'humble'}, 'ROS distribution'),
        ({'HOME': ''}, 'ROS log'),
    ],
)
def test_the_doctor_names_what_keeps_a_mission_from_flying(
    environment: dict[str, str], topic: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, '_imported', lambda name, *_: doctor.Finding(topic=name, found=''))
    assert set(problems({})) == set()
    assert set(problems(environment)) == {topic}


def test_the_doctor_says_why_an_import_fails() -> None:
    found = doctor._imported('thing', 'import a_module_that_is_not_there', 'install it')
    assert "No module named 'a_module_that_is_not_there'" in found.problem
    assert 'install it' in found.problem


def test_the_doctor_survives_a_library_that_kills_the_process() -> None:
    found = doctor._imported('thing', 'import os; os.abort()', 'mend it')
    assert 'exit status' in found.problem


@pytest.mark.parametrize(('broken', 'status'), [('', 0), ('it is broken', 1)])
def test_the_doctors_exit_status_tells_health(
    broken: str, status: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    finding = doctor.Finding(topic='thing', found='seen', problem=broken)
    monkeypatch.setattr(doctor, 'examine', lambda _: iter([finding]))
    assert main(['doctor']) == status
    shown = capsys.readouterr().out
    assert ('problem: thing: it is broken' in shown) == bool(broken)

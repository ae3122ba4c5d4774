"""The command that flies one mission: which policy, what it is compared with, what it refuses."""

import os
from pathlib import Path
import re
import signal
import sys
from urllib.request import urlopen

from fleets import Fleet
from processes import executable, Processes, RunningProcess, wait_until
import pytest
from random_policies import header, saved
from scripted_logs import fly, uav
from scripted_logs import header as log_header
from steered_world import steered_world
from uav_collect.__main__ import main
from uav_collect.analysis.choice_file import read_choice
from uav_collect.commands import mission
from uav_collect.missions import rollout
from uav_collect.recording.bag_reader import read_missions
from uav_collect.recording.bag_storage import open_bag
from uav_collect.recording.mission_log import MissionLog, read
from uav_collect.recording.origin import CHOICE_KEY
from uav_collect.scenario.load import fingerprint, load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.policy import frozen_policy
from uav_collect.uav.policy_file import save_policy

pytestmark = pytest.mark.long

TIGHT = 'fleet.default.energy_budget_kj=60'  # random weights fly until it is used up
SEED = 2
PLANS = ['shortest', 'thriftiest']
HELD = """#!/bin/sh
while [ ! -e '{until}' ]; do sleep 0.05; done
exec '{executable}' "$@"
"""


@pytest.fixture
def scenario() -> Scenario:
    return load('paper_10x10', {'fleet.default.energy_budget_kj': 60.0})


def command(processes: Processes, *arguments: str, **environment: str) -> RunningProcess:
    words = ['-m', 'uav_collect', 'mission', '--seed', str(SEED), '--set', TIGHT, *arguments]
    return processes.run('mission', sys.executable, *words, **environment)


def text(scenario: Scenario, policy: str) -> bytes:
    [log] = rollout.fly(build_site(scenario), [SEED], policy)
    return log.to_jsonl()


def policies_in(output: str) -> list[str]:
    """The policies of the comparison, in order, and the plans after them."""
    _, _, table = output.partition('the same mission by')
    table, _, _ = table.partition(' UAV ')  # what each UAV takes
    _, _, rows = table.rpartition('──')
    return [line.split()[0] for line in rows.splitlines() if line.strip()]


# Over ROS


@pytest.mark.ros
def test_a_mission_flies_a_policy_file_and_shows_what_rules_make_of_the_same_mission(
    processes: Processes, scenario: Scenario, tmp_path: Path
) -> None:
    path, run = saved(tmp_path, 'mine', header(), seed=1), tmp_path / 'run'
    flown = command(processes, '--policy', str(path), '--output', str(run))
    assert flown.wait_for_exit() == 0
    assert (run / f'mission_{SEED}.jsonl').read_bytes() == text(scenario, str(path))
    assert policies_in(flown.output) == ['mine', 'hert', 'sweep', *PLANS]
    # It listens to nothing else until it has heard of the world that was started with it.
    assert 'recording 1 topics' in (run / 'recorder.log').read_text()


@pytest.mark.ros
def test_a_function_that_ends_its_agent_costs_the_mission_one_line(
    processes: Processes, tmp_path: Path
) -> None:
    name = 'hostile_policies:leaves'
    helpers = Path(__file__).parents[1] / 'helpers'
    where = {'PYTHONPATH': os.pathsep.join([str(helpers), os.environ.get('PYTHONPATH', '')])}
    flown = command(processes, '--policy', name, '--output', str(tmp_path / 'run'), **where)
    assert flown.wait_for_exit() == 1
    [line] = [line for line in flown.output.splitlines() if line.startswith('error: ')]
    said = (
        f'policy {name}: UAV [12] at 0.0 s in cell 0: SystemExit: 7 [(]hostile_policies.py, line'
    )
    assert re.fullmatch(
        f'error: uav_[12] failed with exit status 2: {said} .*uav_[12].log[)]', line
    )
    assert flown.output.endswith(f'{line}\n')


@pytest.mark.nightly
@pytest.mark.ros
def test_a_mission_has_its_tables_and_pictures_without_home_or_locale_whatever_the_backend(
    processes: Processes, tmp_path: Path
) -> None:
    run = tmp_path / 'Größe'
    where = ['env', '-u', 'ROS_LOG_DIR', '-u', 'ROS_HOME', 'HOME=/proc/none', 'LC_ALL=C']
    where += ['PYTHONUTF8=0', 'PYTHONCOERCECLOCALE=0']
    where += ['MPLBACKEND=module://matplotlib_inline.backend_inline']
    words = ['-m', 'uav_collect', 'mission', '--set', TIGHT, '--policy', 'sweep', '--output']
    flown = processes.run('mission', *where, sys.executable, *words, str(run))
    assert flown.wait_for_exit() == 0
    assert all(f'{name} plan' in flown.output for name in PLANS)  # the table has no lines in ASCII
    [picture] = run.glob('*.png')
    assert picture.stat().st_size > 0
    assert b'clairvoyant plan' in (run / 'film.html').read_bytes()


@pytest.mark.ros
def test_the_best_policy_flies_unless_another_is_named_and_the_folder_says_why(
    processes: Processes, scenario: Scenario, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / 'run'
    flown = command(processes, '--output', str(run))
    assert flown.wait_for_exit() == 0
    choice = read_choice(run)
    assert choice is not None
    tried = [it.policy for it in choice.tried]
    assert tried == ['paper_10x10_n2_aqmix', 'anywhere', 'sweep', 'hert']
    assert (choice.policy, choice.fingerprint) == ('paper_10x10_n2_aqmix', fingerprint(scenario))
    assert str(choice) in flown.output
    assert (run / f'mission_{SEED}.jsonl').read_bytes() == text(scenario, choice.policy)
    assert policies_in(flown.output) == ['paper_10x10_n2_aqmix', 'hert', 'sweep', *PLANS]
    with open_bag(run / 'bag') as bag:
        assert bag.custom_data[CHOICE_KEY] == choice.why
    assert main(['report', str(run)]) == 0
    assert capsys.readouterr().out.startswith(f'{choice}\n')


@pytest.mark.nightly
@pytest.mark.ros
def test_what_lies_beside_the_scenario_flies_if_it_is_best(
    processes: Processes, scenario: Scenario, tmp_path: Path
) -> None:
    run, field = tmp_path / 'run', tmp_path / 'own.yaml'
    field.write_text('extends: paper_15x15\nname: own\n')  # no policy is shipped for it
    own = field.with_suffix('.safetensors')
    save_policy(own, frozen_policy('paper_15x15_n2_aqmix'))
    names = ['--candidates', 'random', '--policy', 'best']
    words = ['-m', 'uav_collect', 'mission', '--scenario', str(field), *names]
    flown = processes.run('mission', sys.executable, *words, '--output', str(run))
    assert flown.wait_for_exit() == 0
    choice = read_choice(run)
    assert choice is not None
    others = ['sweep', 'hert', 'random']  # anywhere would fly as the sweep does
    assert [it.policy for it in choice.tried] == [str(own), *others]
    assert choice.policy == str(own)
    assert read(run / 'mission_0.jsonl').header.uavs[1].policy == 'own'
    assert (run / own.name).read_bytes() == own.read_bytes()


@pytest.mark.ros
def test_a_mission_whose_recorder_dies_is_shown_by_its_log_and_the_status_tells(
    processes: Processes, scenario: Scenario, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / 'run'
    options = ['--policy', 'sweep', '--real-time-factor', '2', '--output', str(run)]
    flown = command(processes, *options)
    fleet = Fleet(processes=processes, scenario=scenario, folder=run)
    fleet.wait_for_events(SEED, 2)
    (recorder,) = processes.running('recorder')
    os.kill(recorder, signal.SIGKILL)
    with steered_world() as steered:
        steered.change('real_time_factor', 0.0)
    assert flown.wait_for_exit() == 1
    assert fleet.log(SEED) == text(scenario, 'sweep')
    assert 'the bag is not whole: the recorder failed with exit status -9' in flown.output
    assert flown.output.count('recorder --repair') == 1
    assert policies_in(flown.output) == ['sweep', 'hert', *PLANS]
    assert main(['report', str(run)]) == 0
    shown = capsys.readouterr()
    assert 'the figures are those of ' in shown.err
    assert f'paper_10x10, mission seed {SEED}' in shown.out


@pytest.mark.ros
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_choice_that_is_interrupted_leaves_nothing_behind(
    number: signal.Signals, processes: Processes, tmp_path: Path
) -> None:
    run, helpers = tmp_path / 'run', Path(__file__).parents[1] / 'helpers'
    where = {'PYTHONPATH': os.pathsep.join([str(helpers), os.environ.get('PYTHONPATH', '')])}
    candidates = ['--candidates', 'user_policies:slow']
    flown = command(processes, '--output', str(run), *candidates, **where)
    flown.wait_for('waiting for candidates that fly sampled missions')
    flown.send(number)
    assert flown.wait_for_exit() == 130
    assert 'Traceback' not in flown.output
    assert processes.survivors() == []
    assert not run.exists()


@pytest.mark.ros
def test_a_mission_that_is_viewed_keeps_its_page_until_ctrl_c(
    processes: Processes, tmp_path: Path
) -> None:
    flags = ['--policy', 'sweep', '--uavs', '1', '--view', '--real-time-factor', '0']
    flying = command(processes, *flags, '--output', str(tmp_path / 'run'), DISPLAY='')
    url = flying.wait_for(r'watch it at (http://127\.0\.0\.1:\d+/)$')[1]
    assert flying.wait_for(r'the page stays at (\S+) until Ctrl-C')[1] == url
    with urlopen(url) as page:
        assert f'paper_10x10, mission seed {SEED}' in page.read().decode()
    flying.send(signal.SIGINT)
    assert flying.wait_for_exit() == 0
    assert processes.survivors() == []


@pytest.mark.ros
def test_a_mission_waits_for_a_recorder_that_comes_late(
    processes: Processes, tmp_path: Path
) -> None:
    run, held = tmp_path / 'run', tmp_path / 'held' / 'lib' / 'uav_collect' / 'recorder'
    held.parent.mkdir(parents=True)
    held.write_text(HELD.format(until=tmp_path / 'now', executable=executable('recorder')))
    held.chmod(0o755)
    prefixes = os.pathsep.join([str(tmp_path / 'held'), os.environ['AMENT_PREFIX_PATH']])
    flags = ['--policy', 'sweep', '--output', str(run)]
    flown = command(processes, *flags, AMENT_PREFIX_PATH=prefixes)
    log = run / 'world_sim.log'
    wait_until(lambda: log.exists() and 'waiting for a recorder' in log.read_text())
    (tmp_path / 'now').touch()
    assert flown.wait_for_exit() == 0
    (recorded,) = read_missions(run / 'bag')
    assert recorded.log.to_jsonl() == (run / f'mission_{SEED}.jsonl').read_bytes()
    assert recorded.n_radio_messages > 0


# Which policy


def test_a_policy_that_flies_outside_what_it_learned_on_is_said_to(
    capsys: pytest.CaptureFixture[str],
) -> None:
    mission._checked_policy(
        'paper_10x10_n2_aqmix', load('paper_10x10', {'demand.cell_share': 0.5})
    )
    assert capsys.readouterr().err == (
        'policy paper_10x10_n2_aqmix flies outside what it learned on: cells with data 0.5'
        ' (learned: 0.3)\n'
    )


def test_a_policy_that_is_named_flies_or_nothing(tmp_path: Path) -> None:
    words = ['--set', 'area.cells_per_side=4', '--policy', 'paper_10x10_n2_aqmix']
    assert main(['mission', *words, '--output', str(tmp_path / 'run')]) == 2
    assert not (tmp_path / 'run').exists()


@pytest.mark.parametrize('kind', ['unfit', 'broken', 'missing'])
def test_a_policy_that_cannot_fly_the_mission_is_refused_before_anything_starts(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = saved(tmp_path, 'mine', header(n_uavs=3 if kind == 'unfit' else 2))
    if kind == 'broken':
        path.write_bytes(path.read_bytes()[:-1])
    if kind == 'missing':
        path.unlink()
    words = ['--set', TIGHT, '--policy', str(path), '--output', str(tmp_path / 'run')]
    assert main(['mission', *words]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith('error: ')
    assert 'mine' in line
    assert not (tmp_path / 'run').exists()


def test_candidates_without_a_choice_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ['--policy', 'sweep', '--candidates', 'random', '--output', str(tmp_path / 'run')]
    assert main(['mission', *words]) == 2
    assert capsys.readouterr().err == 'error: --candidates: must come with --policy best\n'
    assert not (tmp_path / 'run').exists()


@pytest.mark.parametrize('name', ['nope', 'paper_15x15_n2_aqmix'])
def test_a_candidate_that_cannot_fly_is_refused_before_anything_starts(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv('UAV_COLLECT_KERNELS', 'interpreted')
    words = ['--scenario', 'paper_8x8', '--candidates', name, '--output', str(tmp_path / 'run')]
    assert main(['mission', *words]) == 2
    [line] = [it for it in capsys.readouterr().err.splitlines() if it.startswith('error: ')]
    assert name in line
    assert not (tmp_path / 'run').exists()


# The comparison


def logged(folder: Path) -> Path:
    log = fly(log_header([uav(1)]), [['hover 2.0 0.5', 'home']])
    path = folder / 'mission_0.jsonl'
    path.write_bytes(MissionLog(header=log.header, events=log.events).to_jsonl())
    return path


@pytest.mark.parametrize('failure', [ValueError('it broke'), RuntimeError('it broke')])
def test_a_comparison_that_fails_is_one_line_and_no_more(
    failure: Exception, scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    def broken(*_: object) -> list[MissionLog]:
        raise failure

    monkeypatch.setattr(rollout, 'fly', broken)
    mission._compare(logged(tmp_path), scenario, 'exact')
    shown = capsys.readouterr()
    assert shown.err == 'the mission could not be compared with rules: it broke\n'
    assert shown.out == ''


def test_a_comparison_that_is_interrupted_is_left_out(
    scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    def interrupted(*_: object) -> list[MissionLog]:
        raise KeyboardInterrupt

    monkeypatch.setattr(rollout, 'fly', interrupted)
    mission._compare(logged(tmp_path), scenario, 'exact')
    assert 'not compared' in capsys.readouterr().err


def test_a_report_that_is_interrupted_says_what_makes_it_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(mission.report, 'show_missions', interrupted)
    assert mission._report(tmp_path) == 130
    assert f'"report {tmp_path} --html" makes them again' in capsys.readouterr().err


def test_a_policy_is_not_compared_with_itself(
    scenario: Scenario, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'mission.jsonl'
    path.write_bytes(text(scenario, 'sweep'))
    mission._compare(path, scenario, 'exact')
    assert policies_in(capsys.readouterr().out) == ['sweep', 'hert', *PLANS]

"""Whoever is asked to stop does: cleanly, soon, with nothing left running and nothing lost."""

from pathlib import Path
import re
import signal
import sys

from fleets import Fleet, logs, scenario_of
from processes import executable, Processes, RunningProcess, wait_until
import pytest
from rosbags.highlevel import AnyReader
from uav_collect.commands import mission, ros_processes
from uav_collect.kernels.stops import DEAF_S
from uav_collect.recording.bag_reader import read_missions
from uav_collect.recording.mission_log import read

pytestmark = [pytest.mark.ros, pytest.mark.long]

SEED = 5
BUDGET_KJ = 2000.0  # some 13,000 s at random
PACED = 50.0  # simulated over wall-clock time: the mission takes some minutes
ABORTED = 2  # Mission.ABORTED

SIGNALS = {
    'Ctrl-C': [signal.SIGINT],
    'Ctrl-C twice': [signal.SIGINT, signal.SIGINT],
    'SIGTERM': [signal.SIGTERM],
    'SIGHUP': [signal.SIGHUP],
}
every_signal = pytest.mark.parametrize('signals', SIGNALS.values(), ids=SIGNALS)


@pytest.fixture
def fleet(processes: Processes, tmp_path: Path) -> Fleet:
    return fleet_of(processes, tmp_path / 'run')


def fleet_of(processes: Processes, folder: Path) -> Fleet:
    scenario = scenario_of(fleet__default__energy_budget_kj=BUDGET_KJ)
    return Fleet(processes=processes, scenario=scenario, folder=folder)


def command_of(folder: Path) -> list[str]:
    """The command that flies the same mission."""
    options = ['--real-time-factor', str(PACED), '--seed', str(SEED), '--policy', 'random']
    options += ['--set', f'fleet.default.energy_budget_kj={BUDGET_KJ}', '--output', str(folder)]
    return [sys.executable, '-m', 'uav_collect', 'mission', *options]


def stop(process: RunningProcess, signals: list[signal.Signals]) -> None:
    """Send signals; the process must end well: one that is deaf ends itself, with a failure."""
    for number in signals:
        process.send(number)
    assert process.wait_for_exit() == 0, process.output
    assert 'Traceback' not in process.output


def phases(bag: Path) -> list[int]:
    """The phases of missions in a bag, in order."""
    with AnyReader([bag]) as reader:
        wanted = [each for each in reader.connections if each.topic == '/world/mission']
        messages = reader.messages(wanted)
        return [reader.deserialize(content, c.msgtype).phase for c, _, content in messages]


@every_signal
def test_nodes_that_wait_for_others_stop_when_asked(
    signals: list[signal.Signals], fleet: Fleet
) -> None:
    agent = fleet.start_agent(1)
    agent.wait_for('waiting for a world_sim')
    stop(agent, signals)
    world = fleet.start_world()
    world.wait_for('waiting for UAV 1, UAV 2')
    stop(world, signals)
    assert fleet.processes.survivors() == []


@pytest.mark.parametrize(
    ('name', 'kind'),
    [*(('uav_agent', kind) for kind in SIGNALS), ('world_sim', 'Ctrl-C'), ('recorder', 'Ctrl-C')],
)
def test_a_node_that_is_still_loading_stops_when_asked(
    name: str, kind: str, processes: Processes
) -> None:
    node = processes.start(name, *(['--id', '1'] if name == 'uav_agent' else []))
    libraries = Path(f'/proc/{node.pid}/maps')
    wait_until(lambda: '_multiarray_umath' in libraries.read_text())  # numpy; much is to come
    stop(node, SIGNALS[kind])


def test_a_mission_in_flight_stops_node_by_node_and_what_was_flown_is_kept(fleet: Fleet) -> None:
    recorder = fleet.start_recorder()
    flying, waiting = fleet.start_agents('random')
    world = fleet.start_world(seed=SEED, real_time_factor=PACED)
    fleet.wait_for_events(SEED, 10)
    stop(flying, SIGNALS['SIGTERM'])
    assert 'ended' not in world.output
    stop(world, SIGNALS['Ctrl-C twice'])
    world.wait_for('was aborted, the world was stopped')
    waiting.wait_for('a world is gone')
    stop(waiting, SIGNALS['SIGHUP'])
    stop(recorder, SIGNALS['Ctrl-C twice'])
    assert fleet.processes.survivors() == []
    (expected,) = logs(fleet.scenario, [SEED], 'random')
    assert expected.startswith(fleet.log(SEED))
    assert 10 <= len(read(fleet.log_file(SEED)).events) < expected.count(b'\n') - 1
    (recorded,) = read_missions(fleet.bag)
    assert not recorded.is_complete
    assert recorded.log.to_jsonl() == fleet.log(SEED)
    assert phases(fleet.bag) == [0, ABORTED]


# A second Ctrl-C comes while the first one is obeyed.
@pytest.mark.parametrize('signals', [*SIGNALS.values()][1:], ids=[*SIGNALS][1:])
def test_an_interrupted_mission_command_takes_its_processes_along_and_keeps_the_run_folder(
    signals: list[signal.Signals], processes: Processes, tmp_path: Path
) -> None:
    folder = tmp_path / 'run'
    command = processes.run('mission', *command_of(folder))
    fleet = fleet_of(processes, folder)
    fleet.wait_for_events(SEED, 10)
    for number in signals:
        command.send(number)
    assert command.wait_for_exit() == 130
    assert 'Traceback' not in command.output
    assert processes.survivors() == []
    assert f'interrupted; what was flown is in {folder}' in command.output
    (recorded,) = read_missions(folder / 'bag')
    assert recorded.log.to_jsonl() == fleet.log(SEED)


# Runs a command on a terminal of its own, and closes that when the file {ready} has so many lines.
TERMINAL = """
import os, pathlib, pty, select, sys
ready, n_lines, *command = sys.argv[1:]
pid, terminal = pty.fork()
if pid == 0:
    os.execvp(command[0], command)
ready = pathlib.Path(ready)
while not ready.exists() or ready.read_bytes().count(b'\\n') < int(n_lines):
    if select.select([terminal], [], [], 0.01)[0]:
        os.read(terminal, 65536)
os.close(terminal)
print('closed', os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
"""


def test_a_terminal_that_is_closed_leaves_a_closed_bag_and_an_aborted_mission(
    processes: Processes, tmp_path: Path
) -> None:
    folder = tmp_path / 'run'
    ready = [str(folder / f'mission_{SEED}.jsonl'), '10']
    terminal = processes.run(
        'terminal', sys.executable, '-c', TERMINAL, *ready, *command_of(folder)
    )
    assert terminal.wait_for(r'closed (-?\d+)')[1] == '130', terminal.output
    assert terminal.wait_for_exit() == 0
    assert processes.survivors() == []
    assert phases(folder / 'bag') == [0, ABORTED]
    (recorded,) = read_missions(folder / 'bag')
    assert recorded.log.to_jsonl() == (folder / f'mission_{SEED}.jsonl').read_bytes()


def test_who_asks_processes_to_end_lets_the_deaf_end_themselves_and_the_recorder_wait() -> None:
    node = pytest.importorskip('uav_collect.nodes.recorder.node')
    assert ros_processes._STOP_S > DEAF_S
    assert mission._RECORDER_S > node._MOST_WAIT_S + node._DRAIN_S


def test_a_recorder_under_nohup_outlives_its_terminal(
    processes: Processes, tmp_path: Path
) -> None:
    bag, path = tmp_path / 'bag', executable('recorder')
    recorder = processes.run('recorder', 'nohup', str(path), '--output', str(bag))
    recorder.wait_for('recording 9 topics')
    status = Path(f'/proc/{recorder.pid}/status').read_text()
    (ignored,) = re.findall(r'^SigIgn:\s*(\w+)', status, re.MULTILINE)
    assert int(ignored, 16) >> (signal.SIGHUP - 1) & 1
    stop(recorder, [signal.SIGTERM])

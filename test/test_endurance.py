"""Chaos and soak, as users run them, tell what they tried and what was lost."""

from collections.abc import Callable
import importlib.util
from pathlib import Path
import signal
import sys
from types import ModuleType

import flight
from processes import Processes
import pytest
from tiny_world import tiny

pytestmark = pytest.mark.ros

TOOLS = Path(__file__).parents[1] / 'tools' / 'endurance'


@pytest.mark.nightly
def test_chaos_loses_no_mission_of_an_agent_whose_packets_are_lost(processes: Processes) -> None:
    tool = str(TOOLS / 'chaos.py')
    chaos = processes.run('chaos', sys.executable, tool, '--only', 'agent: network')
    assert chaos.wait_for_exit() == 0, chaos.output
    assert 'agent │ network │ 1' in chaos.output
    chaos.wait_for(r'1 faults, \d+ missions, 0 lost, 0 other complaints')
    assert processes.survivors() == []


@pytest.mark.nightly
def test_a_soak_that_is_interrupted_says_what_it_saw(processes: Processes) -> None:
    soak = processes.run('soak', sys.executable, str(TOOLS / 'soak.py'), '--minutes', '2')
    soak.wait_for('the first mission has ended')
    soak.send(signal.SIGINT)
    soak.wait_for('interrupted: what was seen follows')
    assert soak.wait_for_exit() == 130, soak.output
    soak.wait_for(r'tells too little: .*; missions lost: 0 of \d+')
    assert processes.survivors() == []


def test_a_fault_that_is_none_is_refused_with_those_there_are(processes: Processes) -> None:
    chaos = processes.run('chaos', sys.executable, str(TOOLS / 'chaos.py'), '--only', 'snow')
    assert chaos.wait_for_exit() == 2
    assert 'faults are world: kill -9, ' in chaos.output


class Clock:
    """Time that passes only while somebody sleeps."""

    def __init__(self, on_sleep: Callable[[], object]) -> None:
        self._now_s, self._on_sleep = 0.0, on_sleep

    def monotonic(self) -> float:
        return self._now_s

    def sleep(self, time_s: float) -> None:
        del time_s  # milliseconds, which would need many
        self._now_s += 0.4 * flight.DEADLINE_S
        self._on_sleep()


@pytest.fixture
def nobody(tmp_path: Path) -> flight.Flight:
    """A fleet of which no node was started."""
    return flight.Flight(tmp_path, tiny(), pace=0.0)


def test_a_flight_may_last_as_long_as_missions_end(
    nobody: flight.Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = nobody.folder / 'world_0.log'
    said.touch()
    one_more = 'mission w-0 ended after 3 events\n'
    ends = Clock(lambda: said.write_text(said.read_text() + one_more))
    monkeypatch.setattr(flight, 'time', ends)
    nobody.wait_until(lambda: nobody.n_ended == 10, 'ten missions')
    assert ends.monotonic() > 3.0 * flight.DEADLINE_S


def test_a_flight_of_which_no_mission_ends_is_given_up(
    nobody: flight.Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(flight, 'time', Clock(lambda: None))
    with pytest.raises(RuntimeError, match='a mission: none ended within 120 s'):
        nobody.wait_until(bool, 'a mission')


@pytest.fixture
def soak() -> ModuleType:
    spec = importlib.util.spec_from_file_location('soak', TOOLS / 'soak.py')
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_what_grows_after_a_warm_up_shows_in_its_slope(soak: ModuleType) -> None:
    warming = [(0.0, 90e3), (10.0, 99e3)]  # what happens first does not count
    growing = [(10.0 * number, 100e3 + 3.0 * number) for number in range(5, 11)]
    taken = [
        soak.Sample(at_s=at_s, n_missions=int(at_s), resident_kb=kb, n_files=20)
        for at_s, kb in (*warming, *growing)
    ]
    memory_kb, n_files = soak.slopes(taken)
    assert memory_kb == pytest.approx(30.0)  # 3 kB in 10 missions
    assert n_files == pytest.approx(0.0)


def test_a_step_is_no_leak_once_it_is_flown_as_long_again(soak: ModuleType) -> None:
    def grown(kb: Callable[[int], float], until: int) -> list[str]:
        taken = [
            soak.Sample(at_s=number, n_missions=number, resident_kb=kb(number), n_files=20)
            for number in range(until + 1)
        ]
        return soak.growing({'recorder': taken})

    def step(number: int) -> float:
        return 100e3 if number < 80 else 120e3

    def leak(number: int) -> float:
        return 100e3 + 3.0 * number  # 300 kB in 100 missions

    assert grown(step, 100) == ['recorder']
    assert grown(step, 200) == []
    assert grown(leak, 100) == grown(leak, 200) == ['recorder']


@pytest.mark.nightly
def test_a_soak_says_of_every_node_by_how_much_it_grows(processes: Processes) -> None:
    soak = processes.run('soak', sys.executable, str(TOOLS / 'soak.py'), '--minutes', '0.1')
    assert soak.wait_for_exit() in (0, 1), soak.output  # so soon anything may still grow
    for node in ('recorder', 'trainer', 'uav_1', 'world'):
        soak.wait_for(rf'{node} │ +[0-9.]+ │ +[0-9.]+ │ +-?[0-9.]+ │ +-?[0-9.]+ │')
    soak.wait_for(r'missions lost: 0 of \d+')
    soak.wait_for('all nodes grow faster in their first 800 missions')
    assert processes.survivors() == []

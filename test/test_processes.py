"""The helper that runs processes for other tests."""

import signal
import sys

from processes import completed, Processes
import pytest
from ros_domains import own_domain

_SLEEPER = 'import time; print("up", flush=True); time.sleep(600)'
_PARENT = f"""
import subprocess, sys
child = subprocess.Popen(
    [sys.executable, '-c', {_SLEEPER!r}], stdout=subprocess.PIPE, start_new_session=True
)
child.stdout.readline()
"""


def test_two_holders_never_share_a_domain() -> None:
    with own_domain() as one, own_domain() as other:
        assert one != other


def test_a_process_is_watched_and_ended_by_signal(processes: Processes) -> None:
    sleeper = processes.run('sleeper', sys.executable, '-c', _SLEEPER)
    assert sleeper.wait_for('^up$').group() == 'up'
    assert processes.survivors() == [sleeper.pid]
    sleeper.send(signal.SIGTERM)
    assert sleeper.wait_for_exit() == -signal.SIGTERM
    assert processes.survivors() == []


def test_a_failure_shows_the_output(processes: Processes) -> None:
    speaker = processes.run('speaker', sys.executable, '-c', 'print("the reason")')
    with pytest.raises(AssertionError, match='the reason'):
        speaker.wait_for('never written')


def test_a_child_in_a_session_of_its_own_is_found_and_killed(processes: Processes) -> None:
    parent = processes.run('parent', sys.executable, '-c', _PARENT)
    assert parent.wait_for_exit() == 0
    assert len(processes.survivors()) == 1
    processes.close()
    assert processes.survivors() == []


def test_a_command_that_fails_shows_what_it_said() -> None:
    script = 'import sys; print("so far"); sys.exit("the reason")'
    with pytest.raises(AssertionError, match=r'ended with 1:\nso far\nthe reason'):
        completed(sys.executable, '-c', script)
    assert completed(sys.executable, '-c', script, status=1).stderr == 'the reason\n'


def test_a_command_that_does_not_end_shows_what_it_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('processes.DEADLINE_S', 1.0)
    with pytest.raises(AssertionError, match=r"sleep 600'\nruns after 1.0 s; b'up\\n'"):
        completed('sh', '-c', 'echo up; exec sleep 600')

"""Who waits hears for what, unless something else says it already."""

from queue import SimpleQueue
import threading

import pytest
from uav_collect.kernels import patience

HANG_S = 600.0


def test_a_wait_that_lasts_says_for_what() -> None:
    said: SimpleQueue[str] = SimpleQueue()
    with patience.waiting_for('the picture', said.put):
        assert said.get(timeout=HANG_S) == 'waiting for the picture'


def test_a_wait_that_something_else_explains_says_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: SimpleQueue[bool] = SimpleQueue()
    said: SimpleQueue[str] = SimpleQueue()

    def is_explained() -> bool:
        asked.put(True)
        return True

    monkeypatch.setattr(patience, '_is_explained', is_explained)
    with patience.waiting_for('the picture', said.put):
        assert asked.get(timeout=HANG_S)
    assert said.empty()


def test_the_first_line_comes_after_the_pause() -> None:
    said: SimpleQueue[str] = SimpleQueue()
    with patience.repeated_line(lambda waited_s: f'{waited_s}', said.put, after_s=0.1):
        assert float(said.get(timeout=HANG_S)) >= 0.1


def test_no_line_comes_after_what_was_waited_for() -> None:
    said: SimpleQueue[str] = SimpleQueue()
    with patience.repeated_line(lambda _: 'still', said.put, after_s=0.0):
        assert said.get(timeout=HANG_S) == 'still'
    assert 'patience' not in {thread.name for thread in threading.enumerate()}


def test_a_process_that_another_one_speaks_for_is_silent(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(patience, '_is_silent', False)
    patience.say('one')
    patience.be_silent()
    patience.say('two')
    assert capsys.readouterr().err == 'one\n'

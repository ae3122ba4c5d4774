"""What a user might write: policies that fly, remember, scribble and fail."""

from collections.abc import Iterator
import os
import signal
import time
from typing import Any

import numpy as np
from uav_collect.uav.action_codes import HOME, HOVER, LEFT
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.situation import Situation, step_towards

NUMBER = 7


def nearest(situation: Situation) -> int:
    """Collects what is below, else makes for the nearest cell that it does not know."""
    here, side = situation.view.cell, situation.briefing.n_columns
    if situation.legal[HOVER]:
        return HOVER
    unknown = np.flatnonzero(situation.belief.complete == 0)
    ways = abs(unknown // side - here // side) + abs(unknown % side - here % side)
    target = int(unknown[ways.argmin()])
    return step_towards(situation.briefing, here, target, situation.legal)


class Wanderer:
    """Takes the legal actions in turn, by a count that is its memory."""

    def __init__(self, briefing: Briefing, uav: int) -> None:
        self.n_decisions = uav

    def __call__(self, situation: Situation) -> np.int64:
        legal = np.flatnonzero(situation.legal)
        self.n_decisions += 1
        return legal[self.n_decisions % len(legal)]


def scribbler(situation: Situation) -> int:
    """Chooses as `nearest` and then writes over all that it was given."""
    action = nearest(situation)
    for rows in (situation.belief, situation.view, situation.briefing):
        for row in rows:
            if isinstance(row, np.ndarray):
                row[...] = 1
    situation.legal[...] = 1
    return action


def kinds(situation: Situation) -> int:
    """Fails with the types of all that it is given."""
    rows = (*situation.briefing, *situation.belief, *situation.view, situation.legal)
    raise ValueError(' '.join(sorted({_kind(row) for row in rows})))


def _kind(row: Any) -> str:  # noqa: ANN401 - what it is, is the question
    return f'{row.dtype}{row.shape}' if isinstance(row, np.ndarray) else type(row).__name__


def homebird(situation: Situation) -> int:
    return HOME


def westward(situation: Situation) -> int:
    return LEFT


def by_name(situation: Situation) -> str:
    return 'north'


def divider(situation: Situation) -> float:
    return situation.uav / (situation.view.n_sensors * 0)


def greedy_for_arguments(situation: Situation, more: int) -> int:
    return more


def late(situation: Situation) -> int:
    if situation.view.time_s > 20.0:
        raise RuntimeError('the wind\nis too strong')
    return nearest(situation)


class Stillborn:
    def __init__(self, briefing: Briefing, uav: int) -> None:
        raise OSError(f'no memory for UAV {uav}')


class Speechless:
    def __init__(self, briefing: Briefing, uav: int) -> None:
        pass


def script() -> Iterator[int]:
    yield HOME


def killed(situation: Situation) -> int:
    """Its process is killed, as for want of memory."""
    os.kill(os.getpid(), signal.SIGKILL)
    return HOME


def slow(situation: Situation) -> int:
    """Takes its time."""
    time.sleep(1.0)
    return HOME

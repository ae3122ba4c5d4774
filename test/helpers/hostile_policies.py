"""Policies that end badly, each in a way of its own; what they do wrong is said at the line."""

from collections.abc import AsyncIterator, Iterator
import functools
import signal
import sys
from typing import Any, NoReturn

import numpy as np
from uav_collect.uav.situation import Situation


class SilentError(Exception):
    def __str__(self) -> NoReturn:
        sys.exit(3)


class _Nameless(type):
    @property
    def __name__(cls) -> NoReturn:
        raise ValueError('no name')


class NamelessError(Exception, metaclass=_Nameless):
    pass


class Index:
    def __index__(self) -> int:
        raise ValueError('no index')  # line: index


class Liar:
    def __index__(self) -> str:  # type: ignore[override]
        return 'north'


class NoRepr:
    def __repr__(self) -> NoReturn:
        raise KeyboardInterrupt


class Number(int):
    def __eq__(self, other: object) -> NoReturn:
        sys.exit(5)

    __hash__ = int.__hash__


def leaves(situation: Situation) -> NoReturn:
    raise SystemExit(7)  # line: leaves


def exits_deeper(situation: Situation) -> NoReturn:
    _deeper()


def _deeper() -> NoReturn:
    sys.exit(7)  # line: exits_deeper


def interrupts(situation: Situation) -> NoReturn:
    raise KeyboardInterrupt  # line: interrupts


def throws(situation: Situation) -> NoReturn:
    (number for number in ()).throw(KeyboardInterrupt)  # line: throws
    raise AssertionError


def closes_generator(situation: Situation) -> NoReturn:
    raise GeneratorExit  # line: closes_generator


def groups(situation: Situation) -> NoReturn:
    raise BaseExceptionGroup('all', [ValueError('a'), SystemExit(1)])  # line: groups


def recurses(situation: Situation) -> int:
    return recurses(situation)  # line: recurses


def runs_out(situation: Situation) -> NoReturn:
    raise MemoryError  # line: runs_out


def is_silent(situation: Situation) -> NoReturn:
    raise SilentError  # line: is_silent


def is_nameless(situation: Situation) -> NoReturn:
    raise NamelessError('anonymous')  # line: is_nameless


def talks(situation: Situation) -> NoReturn:
    raise ValueError('\x1b[31m\nline [bold]' + 'x' * 100_000)  # line: talks


def fails_in_numpy(situation: Situation) -> NoReturn:
    np.linalg.inv(np.zeros((2, 2)))  # line: fails_in_numpy


def wrapped(function: Any) -> Any:  # noqa: ANN401 - any function
    @functools.wraps(function)
    def wrapper(*arguments: object) -> object:
        return function(*arguments)

    return wrapper


@wrapped
def decorated(situation: Situation) -> NoReturn:
    raise ValueError('within')  # line: decorated


def index(situation: Situation) -> Index:
    return Index()


def lies(situation: Situation) -> Liar:  # line: lies
    return Liar()


def no_repr(situation: Situation) -> NoRepr:  # line: no_repr
    return NoRepr()


def number(situation: Situation) -> Number:  # line: number
    return Number(77)


def true(situation: Situation) -> bool:  # line: true
    return True


def numpy_true(situation: Situation) -> np.bool_:  # line: numpy_true
    return np.True_


def fraction(situation: Situation) -> float:  # line: fraction
    return float('nan')


def huge(situation: Situation) -> int:  # line: huge
    return 10**30


def negative(situation: Situation) -> int:  # line: negative
    return -1


def row(situation: Situation) -> Any:  # noqa: ANN401  # line: row
    return np.zeros(100_000)


async def asynchronous(situation: Situation) -> int:  # line: asynchronous
    return 5


def yields(situation: Situation) -> Iterator[int]:  # line: yields
    yield 5


async def yields_later(situation: Situation) -> AsyncIterator[int]:  # line: yields_later
    yield 5


def nothing(situation: Situation) -> None:  # line: nothing
    return None


class FailsToCall:
    def __init__(self, briefing: object, uav: int) -> None:
        pass

    def __call__(self, situation: Situation) -> NoReturn:
        raise SystemExit('in a class')  # line: FailsToCall


class FailsToBegin:
    def __init__(self, briefing: object, uav: int) -> None:
        raise SystemExit(0)  # line: FailsToBegin


def numpy_number(situation: Situation) -> np.uint8:
    """Flies home: a number of a library is as good as any."""
    return np.uint8(5)


def closes_stdout(situation: Situation) -> int:  # line: closes_stdout
    sys.stdout.close()
    return 5


def closes_stderr(situation: Situation) -> int:  # line: closes_stderr
    sys.stderr.close()
    return 5


def replaces_streams(situation: Situation) -> int:
    """Leaves what is no stream where others write."""
    sys.stdout = sys.stderr = object()  # type: ignore[assignment]
    return 5


def asks_to_end(situation: Situation) -> int:
    """As Ctrl-C does, while the function runs."""
    signal.raise_signal(signal.SIGINT)
    return 5


def tidies_up_when_asked_to_end(situation: Situation) -> int:
    try:
        return asks_to_end(situation)
    except KeyboardInterrupt:
        sys.stdout.flush()
        raise

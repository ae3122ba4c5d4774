"""Runs code that users wrote: whatever it raises, returns or closes becomes one line about it."""

from collections.abc import Callable, Iterator
import importlib
from inspect import getattr_static
from pathlib import Path
import sys
from types import CodeType, FunctionType, MethodType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from uav_collect import files
from uav_collect.errors import in_one_line
from uav_collect.kernels.stops import interrupts

_MAX_TEXT = 200  # characters of what an error says
_MAX_SHOWN = 60  # of a value or a name
_STREAMS = ('stdout', 'stderr')
_IMPORTING = ('<frozen ', str(importlib.__file__))  # where Python's own code is that imports
_name_of = vars(type)['__name__'].__get__  # whatever a metaclass makes of it

_Place = tuple[str, int]  # file and line


class UserCodeError(Exception):
    """Code of a user failed: how, and in which file and line of it."""


def run_user_code(file: str | None, function: Callable[..., Any], *arguments: object) -> Any:  # noqa: ANN401
    """What a function of a user returns.

    Args:
        file: that the user wrote; None if nobody knows it yet.
        function: called with the arguments.

    Raises:
        UserCodeError: it raised anything at all, or closed the output of this program.
        KeyboardInterrupt: a signal came meanwhile.
    """
    streams = {name: getattr(sys, name) for name in _STREAMS}
    open_before = [name for name in _STREAMS if not _is_closed(name)]
    try:
        answer = _answer(function, *arguments)
    except _RaisedError as raised:
        error = raised.error
        place = _raised_at(error, file) or _defined_at(function)
        raise UserCodeError(f'{error_text(error)}{_in_brackets(place)}') from error
    finally:
        for name, stream in streams.items():
            setattr(sys, name, stream)  # whatever was put in its place
        closed = [name for name in open_before if _is_closed(name)]
        if closed:
            files.mend_standard_streams()
    if closed:
        raise UserCodeError(f'it closes sys.{closed[0]}{definition_text(function)}')
    return answer


def error_text(error: BaseException) -> str:
    """An exception in one line."""
    said = _text_of(lambda: str(error), _MAX_TEXT)
    return f'{kind_text(error)}: {said}' if said else kind_text(error)


def value_text(value: object) -> str:
    """A value in one line."""
    return _text_of(lambda: repr(value), _MAX_SHOWN) or f'a {kind_text(value)} without a repr'


def numbers_of(answer: object) -> NDArray[np.float64] | None:
    """What a user's code gave, as an array of numbers; None if it is none."""
    try:
        numbers: NDArray[np.float64] = _answer(np.array, answer, np.float64)
        return numbers
    except _RaisedError:
        return None


def kind_text(value: object) -> str:
    """What the class of a value is called."""
    return name_text(type(value))


def name_text(target: object) -> str:
    """What a class or a function is called, or else its class."""
    if isinstance(target, type):
        return _text_of(lambda: _name_of(target), _MAX_SHOWN) or 'class'
    return _text_of(lambda: getattr(target, '__name__', None), _MAX_SHOWN) or kind_text(target)


def definition_text(function: object) -> str:
    """In which file and line a function or a class was written, in brackets; or nothing."""
    return _in_brackets(_defined_at(function))


def _is_closed(stream: str) -> bool:
    return getattr(getattr(sys, stream), 'closed', True) is True


class _RaisedError(Exception):
    """A user's class or function raised something, which no signal did."""

    def __init__(self, error: BaseException) -> None:
        self.error = error


def _answer(function: Callable[..., Any], *arguments: object) -> Any:  # noqa: ANN401
    """What a user's function returns.

    Raises:
        _RaisedError: it raised something.
        KeyboardInterrupt: a signal came meanwhile.
    """
    with interrupts.counted():
        n_before = interrupts.n_raised
        try:
            return function(*arguments)
        except BaseException as error:  # SystemExit too
            if isinstance(error, KeyboardInterrupt) and interrupts.n_raised > n_before:
                raise
            raise _RaisedError(error) from error


def _raised_at(error: BaseException, file: str | None) -> _Place | None:
    """Where the user's code was last: in the file, else in the one that was called first."""
    places: list[_Place] = [
        (frame.tb_frame.f_code.co_filename, frame.tb_lineno) for frame in _frames(error)
    ]
    others = [place for place in places[1:] if not place[0].startswith(_IMPORTING)]
    if not others:
        return None
    first = file if any(place[0] == file for place in others) else others[0][0]
    return next(place for place in reversed(others) if place[0] == first)


def _frames(error: BaseException) -> Iterator[Any]:
    trace = error.__traceback__
    while trace is not None:
        yield trace
        trace = trace.tb_next


def _defined_at(function: object) -> _Place | None:
    special = '__init__' if isinstance(function, type) else '__call__'
    owner = function if isinstance(function, type) else type(function)
    for holder in (function, getattr_static(owner, special, None)):
        if isinstance(code := _code_of(holder), CodeType):
            return code.co_filename, code.co_firstlineno
    return None


def _code_of(function: object) -> CodeType | None:
    if type(function) is MethodType:
        function = function.__func__
    return function.__code__ if type(function) is FunctionType else None


def _in_brackets(place: _Place | None) -> str:
    return '' if place is None else f' ({Path(place[0]).name}, line {place[1]})'


def _text_of(show: Callable[[], object], longest: int) -> str | None:
    """What shows something, in one short line; None if it cannot or does not."""

    def line() -> str | None:
        text = show()
        return in_one_line(str.__str__(text), longest) if isinstance(text, str) else None

    try:
        shown: str | None = _answer(line)
        return shown
    except _RaisedError:
        return None

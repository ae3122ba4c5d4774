"""What is typed: arguments that are wrong, and whatever else is, are said in lines for people."""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
import sys
from typing import Any, NoReturn

from uav_collect.errors import in_one_line, reason_of, UavCollectError
from uav_collect.limits import UNUSABLE

_MOST_CHARACTERS = 1_000  # of a line about what is wrong
_PROGRAM = 'uav-collect'  # what pip and colcon install


def program_name() -> str:
    """What runs the commands, as it was typed: `uav-collect` or `python -m uav_collect`."""
    return _PROGRAM if Path(sys.argv[0]).stem == _PROGRAM else 'python -m uav_collect'


@dataclass(frozen=True)
class NumberList:
    """A type for argparse: numbers with commas between them, or, of a `Parser`, with blanks."""

    number: Callable[[str], float]  # reads one

    def __call__(self, text: str) -> tuple[float, ...]:
        """The numbers of a text."""
        return tuple(map(self.number, text.split(',')))


class Parser(argparse.ArgumentParser):
    """An ArgumentParser that says what is wrong in one line.

    An option of a `NumberList` ends at the first word that is no number: with `nargs='+'` it would
    take what stands behind it, too.
    """

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:  # noqa: ANN401
        """As of argparse."""
        words = sys.argv[1:] if args is None else [*args]
        return super().parse_known_args(self._with_commas(words), namespace)

    def _with_commas(self, words: Sequence[str]) -> list[str]:
        """`--speed 10 15 LIST` as `--speed=10,15 LIST`."""
        lists = {
            option
            for action in self._actions
            if isinstance(action.type, NumberList)
            for option in action.option_strings
        }
        joined: list[str] = []
        place = 0
        while place < len(words):
            word = words[place]
            place += 1
            if word in lists:
                numbers = [*takewhile(_is_number, words[place:])]
                place += len(numbers)
                word = f'{word}={",".join(numbers)}' if numbers else word
            joined.append(word)
        return joined

    def error(self, message: str) -> NoReturn:
        """End the process with the status of misuse."""
        said = in_one_line(f'{message} (see {self.prog} --help)', _MOST_CHARACTERS)
        self.exit(UNUSABLE, f'error: {said}\n')


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def error_lines(error: Exception) -> str:
    """What is wrong, as lines that people can read: one, but for errors of several lines."""
    lines = error.lines if isinstance(error, UavCollectError) else (_line_of(error),)
    # What still breaks a line is of a name: it is shown as Python writes it.
    whole = (line.replace('\n', '\\n').replace('\r', '\\r') for line in lines)
    return ''.join(f'error: {in_one_line(line, _MOST_CHARACTERS)}\n' for line in whole)


def _line_of(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return f'{error.filename}: {error.strerror}' if error.filename else error.strerror
    return reason_of(error)

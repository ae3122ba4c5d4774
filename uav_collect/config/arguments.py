"""What is typed: arguments that are wrong, and whatever else is, are said in lines for people."""

import argparse
from collections.abc import Sequence
from functools import partial
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


class Parser(argparse.ArgumentParser):
    """An ArgumentParser that says what is wrong in one line.

    An option of several values ends at the first word that cannot be one of them: argparse would
    take what stands behind it, too, as RUN in `--reference sweep=1.19 RUN`.
    """

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:  # noqa: ANN401
        """As of argparse."""
        words = sys.argv[1:] if args is None else [*args]
        if any(not action.option_strings for action in self._actions):
            words = self._with_lists_last(words)
        return super().parse_known_args(words, namespace)

    def _with_lists_last(self, words: Sequence[str]) -> list[str]:
        """The words with options of several values behind all others."""
        n_options = words.index('--') if '--' in words else len(words)
        others: list[str] = []
        lists: list[str] = []
        place = 0
        while place < n_options:
            word = words[place]
            place += 1
            action = self._option_string_actions.get(word)
            if action is None or action.nargs != '+':
                others.append(word)
                continue
            n_values = _n_values(action, words[place:n_options])
            lists += [word, *words[place : place + n_values]]
            place += n_values
        return [*others, *lists, *words[n_options:]]

    def error(self, message: str) -> NoReturn:
        """End the process with the status of misuse."""
        said = in_one_line(f'{message} (see {self.prog} --help)', _MOST_CHARACTERS)
        self.exit(UNUSABLE, f'error: {said}\n')


def _n_values(action: argparse.Action, words: Sequence[str]) -> int:
    """How many of the words behind an option are its values: the first, and all like these."""
    given = [*takewhile(lambda word: not word.startswith('-'), words)]
    like = takewhile(partial(_may_be_of, action), given[1:])
    return min(len(given), 1) + sum(1 for _ in like)


def _may_be_of(action: argparse.Action, word: str) -> bool:
    """Whether a word may be a value of an option."""
    try:
        value = action.type(word) if callable(action.type) else word
    except (argparse.ArgumentTypeError, TypeError, ValueError):
        return False
    return action.choices is None or value in action.choices


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

"""What is typed: arguments that are wrong, and whatever else is, are said in lines for people."""

import argparse
from pathlib import Path
import sys
from typing import NoReturn

from uav_collect.errors import in_one_line, reason_of, UavCollectError
from uav_collect.limits import UNUSABLE

_MOST_CHARACTERS = 1_000  # of a line about what is wrong
_PROGRAM = 'uav-collect'  # what pip and colcon install


def program_name() -> str:
    """What runs the commands, as it was typed: `uav-collect` or `python -m uav_collect`."""
    return _PROGRAM if Path(sys.argv[0]).stem == _PROGRAM else 'python -m uav_collect'


class Parser(argparse.ArgumentParser):
    """An ArgumentParser that says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        """End the process with the status of misuse."""
        said = in_one_line(f'{message} (see {self.prog} --help)', _MOST_CHARACTERS)
        self.exit(UNUSABLE, f'error: {said}\n')


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

"""What is typed: arguments that are wrong, and whatever else is, are said in lines for people."""

import argparse
from typing import NoReturn

from uav_collect.errors import in_one_line

_MISUSED = 2  # exit status
_MOST_CHARACTERS = 1_000  # of a line about what is wrong


class Parser(argparse.ArgumentParser):
    """An ArgumentParser that says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        """End the process with the status of misuse."""
        said = in_one_line(f'{message} (see {self.prog} --help)', _MOST_CHARACTERS)
        self.exit(_MISUSED, f'error: {said}\n')


def error_lines(text: str) -> str:
    """What is wrong, as lines that people can read."""
    lines = [in_one_line(line, _MOST_CHARACTERS) for line in text.splitlines()]
    return ''.join(f'error: {line}\n' for line in lines)

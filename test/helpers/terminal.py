"""Commands in a terminal, and what somebody who sits there sees of them."""

import io
import re
import shlex
from threading import Event

from processes import Processes, RunningProcess

_SIZE = {'COLUMNS': '100', 'LINES': '30'}
_PARTS = re.compile(r'\x1b\[([0-9;?]*)([A-Za-z])|(\r)|(\n)|([^\x1b\r\n]+)')
_REDRAWS = re.compile(r'\r\x1b\[')  # from the beginning of a line


class Ear(io.StringIO):
    """A stream that notices when something was said."""

    def __init__(self, words: str) -> None:
        super().__init__()
        self._words, self.heard = words, Event()

    def write(self, text: str) -> int:
        if self._words in text:
            self.heard.set()
        return super().write(text)


def in_terminal(
    processes: Processes, name: str, *command: str, **environment: str
) -> RunningProcess:
    """Start a command in a terminal of its own; its output is all that goes to the terminal."""
    surroundings = {'TERM': 'xterm', **_SIZE, **environment}
    return processes.run(name, 'script', '-qefc', shlex.join(command), '/dev/null', **surroundings)


def on_screen(output: str) -> str:
    """What stands in a terminal after some output, with what left it at the top."""
    lines, row, column = [''], 0, 0
    for values, letter, goes_back, goes_down, text in _PARTS.findall(output):
        if goes_back:
            column = 0
        elif goes_down:
            row += 1
            lines += [''] * (row == len(lines))
        elif text:
            before, after = lines[row].ljust(column)[:column], lines[row][column + len(text) :]
            lines[row], column = before + text + after, column + len(text)
        elif letter == 'A':
            row -= int(values)
        elif (values, letter) == ('2', 'K'):
            lines[row] = ''
        elif letter not in 'mhl':  # colours, and whether there is a cursor
            raise AssertionError(f'what is ESC [ {values} {letter}?')
    return '\n'.join(line.rstrip() for line in lines).rstrip('\n')


def pictures(output: str) -> list[str]:
    """The screen before each time that something on it was drawn anew."""
    ends = [redraw.start() for redraw in _REDRAWS.finditer(output)]
    return [on_screen(output[:end]) for end in ends]

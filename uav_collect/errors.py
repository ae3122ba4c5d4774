"""Every exception that this package raises for its callers to handle.

UavCollectError
  x ConfigError             a scenario or a preset that cannot be used
  x PolicyMismatchError     a policy that does not exist, is broken or does not fit
  x AllocationError         bandwidth that cannot be allocated
  x RecordingError          a mission that cannot be recorded
  x MissionLogError         a mission log that cannot be read
  x BagError                a bag that cannot be read
  x UnreadableError         bytes that are no message
  x RefusedError            a message that cannot be used
  + TrainingRunError        a run folder that cannot be used as asked
    x CheckpointError       a checkpoint that a training cannot go on from
  x DivergedError           a training whose loss or weights are no numbers any more
  x InterruptedRunError     a training that was stopped, and saved
  x StoreError              a store of results that holds something else than it should
  x ClusterError            a Ray cluster that cannot be joined
  x FilmError               a film that cannot be made
  x FleetError              processes of a mission that cannot start, or failed
  x NodeError               a node that cannot start
  x MissingPackageError     Python packages that are missing or too old

A command shows their text alone, without a traceback. Those about something that was given are a
ValueError besides. A plain ValueError or RuntimeError is a mistake of the code that calls.
"""

from collections.abc import Callable, Sequence
from typing import TypeVar

MOST_CHARACTERS = 400  # of a line about what others wrote, as long as they like
_MAX_LINES = 20  # of problems shown at once

_Found = TypeVar('_Found')


def in_one_line(text: str, most_characters: int = MOST_CHARACTERS) -> str:
    r"""A text of others as people can read it: one line, not too long.

    What would not be seen, or would steer a terminal, is written as Python writes it: `\x1b`.
    """
    words = ' '.join(text[: 2 * most_characters].split())
    shown = ''.join(map(_spelled, words))
    if len(shown) <= most_characters and len(text) <= 2 * most_characters:
        return shown
    return f'{shown[: most_characters - 3]}...'


def _spelled(character: str) -> str:
    if character.isprintable():
        return character
    return character.encode('unicode_escape').decode()


def counted(number: int, unit: str) -> str:
    """A number of things, `1 line` or `2 lines`."""
    return f'{number:,} {unit}{"" if number == 1 else "s"}'


def reason_of(error: BaseException) -> str:
    """What an exception says; its kind where it says nothing, as MemoryError does."""
    return str(error) or type(error).__name__


class UavCollectError(Exception):
    """Something that the user gave, or that happened, and not a mistake of this package."""

    @property
    def lines(self) -> Sequence[str]:
        """What is wrong; a name in it may hold a newline, so only some errors are split there."""
        return (reason_of(self),)


class ConfigError(UavCollectError, ValueError):
    """A configuration that cannot be used: one line per problem, ready to be shown."""

    def __init__(self, *problems: str) -> None:
        """Keep the problems; the message shows the first twenty."""
        super().__init__(*problems)
        self.problems = problems

    def __str__(self) -> str:
        """One line per problem."""
        return '\n'.join(self.lines)

    @property
    def lines(self) -> Sequence[str]:
        """The first twenty problems, and the number of the others."""
        left_out = len(self.problems) - _MAX_LINES
        more = [f'... and {left_out} more problems'] if left_out > 0 else []
        return [*self.problems[:_MAX_LINES], *more]

    @property
    def summary(self) -> str:
        """The first problem, and the number of the others."""
        n_more = len(self.problems) - 1
        return self.problems[0] + (f'; and {n_more} more problems' if n_more else '')


def noting(problems: list[str], step: Callable[[], _Found]) -> _Found | None:
    """What a step finds; None where it is refused, and why is added to the problems."""
    try:
        return step()
    except ConfigError as error:
        problems += error.problems
        return None


class PolicyMismatchError(UavCollectError, ValueError):
    """A policy that does not exist or does not fit: which, and what would."""


class AllocationError(UavCollectError, ValueError):
    """Bandwidth cannot be allocated for these numbers: the message names quantity and index."""


class RecordingError(UavCollectError):
    """A recording cannot be started or continued: one line that says why."""


class MissionLogError(UavCollectError, ValueError):
    """A mission log that cannot be read: what is wrong, and in which line."""


class BagError(UavCollectError, ValueError):
    """A bag that cannot be read: which, why, and what to do."""


class UnreadableError(UavCollectError, ValueError):
    """Bytes that are no message of a type: which type, and where they stop to be one."""


class RefusedError(UavCollectError, ValueError):
    """A message that cannot be used: which, what of it, its value, what it must be."""


class TrainingRunError(UavCollectError, ValueError):
    """A run folder that cannot be used as asked: which, why, and what would help."""


class CheckpointError(TrainingRunError):
    """A checkpoint that cannot be gone on from: which, and why."""


class DivergedError(UavCollectError, RuntimeError):
    """A training whose loss or weights are no numbers any more: which, and what is kept."""


class InterruptedRunError(UavCollectError, RuntimeError):
    """A training was stopped, and saved: how far it came."""


class StoreError(UavCollectError, ValueError):
    """A store that holds something else than it should: where, and what."""


class ClusterError(UavCollectError, RuntimeError):
    """A Ray cluster that cannot be joined: where, and why."""


class FilmError(UavCollectError):
    """A film cannot be made: one line that says why, and what would help."""


class FleetError(UavCollectError, RuntimeError):
    """A mission's processes cannot start, or one of them failed: which, and its last words."""

    @property
    def lines(self) -> Sequence[str]:
        """What failed, and each of its last words."""
        return str(self).splitlines()


class NodeError(UavCollectError):
    """A node that cannot start: one line that says why."""


class MissingPackageError(UavCollectError):
    """Python packages that are missing or too old: one line for each, with how to get it."""

    @property
    def lines(self) -> Sequence[str]:
        """One for each package."""
        return str(self).splitlines()

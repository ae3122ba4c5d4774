"""What decides for one UAV: the protocol that every policy follows, and the choice of one."""

from dataclasses import dataclass, field
from typing import Protocol

from uav_collect.arrays import Row
from uav_collect.belief import Belief
from uav_collect.briefing import Briefing
from uav_collect.heuristics import choose, Heuristic, MEMORY_SIZE
from uav_collect.missions import LocalView
from uav_collect.rows import new_row


class PolicyMismatchError(ValueError):
    """A policy that does not exist or does not fit: which, and what would."""


class Policy(Protocol):
    """Chooses one UAV's actions from what that UAV knows; it may remember within a mission."""

    @property
    def name(self) -> str:
        """What users call it; stands in the mission log."""

    @property
    def version(self) -> str:
        """Which version of it flies."""

    def begin(self, briefing: Briefing, uav: int) -> None:
        """Forget the last mission and get ready to fly a UAV, by index."""

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        """One of the legal actions (at least one is), or actions.HOME to end the mission."""


@dataclass
class RulePolicy:
    """A heuristic behind the protocol."""

    heuristic: Heuristic
    _briefing: Briefing | None = None
    _uav: int = 0
    _memory: Row[int] = field(default_factory=lambda: new_row(MEMORY_SIZE, 0))

    @property
    def name(self) -> str:
        """The heuristic's name."""
        return self.heuristic.label

    @property
    def version(self) -> str:
        """Rules do not change while they fly."""
        return 'rule'

    def begin(self, briefing: Briefing, uav: int) -> None:
        """Forget the last mission and get ready to fly a UAV, by index."""
        self._briefing = briefing
        self._uav = uav
        self._memory = new_row(MEMORY_SIZE, 0)

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        """One of the legal actions, or actions.HOME to end the mission."""
        if self._briefing is None:
            raise RuntimeError('a policy must begin a mission before it chooses')
        return choose(self.heuristic, self._briefing, self._uav, belief, view, legal, self._memory)


def policy_named(name: str) -> Policy:
    """The policy that a user names.

    Raises:
        PolicyMismatchError: there is none of that name.
    """
    match name:
        case 'hert':
            return RulePolicy(Heuristic.HERT)
        case 'hert-equal':
            return RulePolicy(Heuristic.HERT_EQUAL)
        case 'sweep':
            return RulePolicy(Heuristic.SWEEP)
        case 'random':
            return RulePolicy(Heuristic.RANDOM)
        case _:
            known = ', '.join(heuristic.label for heuristic in Heuristic)
            raise PolicyMismatchError(f'policy {name!r} is unknown; there are {known}')

"""A policy that knows a UAV's actions beforehand: those of a plan, or of a log."""

from collections.abc import Sequence

from uav_collect.kernels.arrays import Row
from uav_collect.uav.action_codes import HOME
from uav_collect.uav.belief import Belief
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.view import LocalView


class GivenActions:
    """Flies one UAV by given actions, and home after the last one."""

    def __init__(self, actions: Sequence[int], name: str) -> None:
        """Know the actions of the UAV's decisions, in order; the name stands for the policy."""
        self.name = name
        self.version = name
        self._actions = actions
        self._decision = 0

    def begin(self, briefing: Briefing, uav: int) -> None:
        """Begin with the first action again."""
        self._decision = 0

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        """The next action; home after the last one."""
        self._decision += 1
        return self._actions[self._decision - 1] if self._decision <= len(self._actions) else HOME

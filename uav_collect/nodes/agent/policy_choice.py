"""Which policy an agent flies: the one that it is told, or the best of several, found out here.

Every agent of a fleet has to come to the same choice, whatever runs beside it and whenever it was
started: so each flies the same number of missions by interpreted kernels, whoever has compiled
some, and no clock ends that early.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

from uav_collect.errors import NodeError
from uav_collect.limits import BEST
from uav_collect.scenario.load import fingerprint
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.agent import allocator_named
from uav_collect.uav.policy import (
    listed_names,
    NamedPolicy,
    policy_for,
    policy_named,
    STRONG,
    TOPIC,
)

if TYPE_CHECKING:  # loaded for a choice alone: who just flies one UAV needs none of it
    from uav_collect.analysis.choosing import Choosing


def check_choices(policy: str, candidates: str, allocator: str) -> None:
    """Refuse a policy or an allocator that there is not, before a world is waited for.

    Raises:
        NodeError: naming those that there are.
    """
    if candidates and policy != BEST:
        raise NodeError(f'candidates is {candidates!r}: must be empty unless policy is {BEST}')
    try:
        # Which ones these stand for, the world decides.
        named = [] if policy in (STRONG, BEST, TOPIC) else [policy]
        for name in (*named, *listed_names(candidates)):
            policy_named(name)
        allocator_named(allocator)
    except ValueError as error:
        raise NodeError(str(error)) from error


class PolicyChoice:
    """Finds the policy of an agent in each scenario; a choice takes several steps."""

    def __init__(
        self,
        policy: str,
        *,
        candidates: str,
        allocator: str,
        guard_after: int,
        log: Callable[[str], object],
    ) -> None:
        """Choose nothing yet.

        Args:
            policy: as the agent is told, but for TOPIC.
            candidates: for BEST, besides the shipped ones and the rules, separated by commas.
            allocator: how bandwidth is shared.
            guard_after: decisions without news after which the guard decides; 0: never.
            log: takes what is to be said of a choice.
        """
        self._policy, self._given = policy, listed_names(candidates)
        self._allocator, self._guard_after, self._log = allocator, guard_after, log
        self._names: dict[str, str] = {}  # chosen, by the fingerprint of the scenario
        self._choosing: Choosing | None = None
        self._fingerprint = ''  # of the scenario that is chosen for

    @property
    def is_open(self) -> bool:
        """Whether a choice is under way."""
        return self._choosing is not None

    def policy_for(self, scenario: Scenario) -> NamedPolicy | None:
        """The policy in a scenario; None while it is to be chosen: `go_on` until it is.

        Raises:
            PolicyMismatchError: it does not fit, or a candidate does not.
        """
        self._choosing, self._fingerprint = None, fingerprint(scenario)
        name = self._names.get(self._fingerprint) if self._policy == BEST else self._policy
        if name is not None:
            return policy_for(name, scenario)
        from uav_collect.analysis.choosing import candidates_for, Choosing

        candidates, left_out = candidates_for(scenario, self._given)
        self._choosing = Choosing(
            build_site(scenario),
            candidates,
            allocator=self._allocator,
            guard_after=self._guard_after,
        )
        names = ', '.join(it.name for it in candidates)
        n_missions = self._choosing.n_planned
        for line in (*left_out, f'choosing among {names} by {n_missions} missions of each'):
            self._log(line)
        return None

    def go_on(self) -> bool:
        """Let a candidate fly some missions; whether the choice is made by that.

        Raises:
            PolicyMismatchError: it breaks the rules in flight.
        """
        if self._choosing is None:
            return False
        self._choosing.fly_some()
        if not self._choosing.is_over:
            return False
        choice, self._choosing = self._choosing.choice(), None
        self._names[self._fingerprint] = choice.policy
        self._log(str(choice))
        return True

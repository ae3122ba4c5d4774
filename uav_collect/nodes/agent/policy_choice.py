"""Which policy an agent flies: the one that it is told, or the best of several, found out here.

Every agent of a fleet has to come to the same choice, whatever runs beside it and whenever it was
started: so each flies the same number of missions by interpreted kernels, whoever has compiled
some, and no clock ends that early.
"""

from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, TYPE_CHECKING

from uav_collect.errors import NodeError, PolicyMismatchError
from uav_collect.limits import BEST
from uav_collect.lockstep.published_policy import checked_policy
from uav_collect.scenario.load import fingerprint
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.agent import allocator_named
from uav_collect.uav.briefing import brief
from uav_collect.uav.policy import (
    checked_name,
    listed_names,
    NamedPolicy,
    policy_for,
    policy_named,
    STRONG,
    TOPIC,
)
from uav_collect.uav.policy_file import SUFFIX
from uav_collect.uav.policy_network import LearnedPolicy

if TYPE_CHECKING:  # loaded for a choice alone: who just flies one UAV needs none of it
    from uav_collect.analysis.choosing import Candidate, Choosing


def check_choices(policy: str, candidates: str, allocator: str) -> None:
    """Refuse a policy or an allocator that there is not, before a world is waited for.

    Raises:
        NodeError: naming those that there are.
    """
    if candidates and policy != BEST:
        raise NodeError(f'candidates is {candidates!r}: must be empty unless policy is {BEST}')
    try:
        # Which ones these stand for, the world decides.
        names = [] if policy in (BEST, TOPIC) else [policy]
        for name in (*names, *listed_names(candidates)):
            if name != STRONG:
                policy_named(name)
        allocator_named(allocator)
        if allocator == 'cvxpy':  # it loads late: what is missing is to be missed before take-off
            import_module('uav_collect.physics.bandwidth_convex')
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
        # By the fingerprint of the scenario and the digest of what was refined for it.
        self._chosen: dict[tuple[str, str], Candidate] = {}
        self._choosing: Choosing | None = None
        self._candidates: list[Candidate] = []  # of the choice under way
        self._key = ('', '')  # of what is chosen for

    @property
    def is_by_missions(self) -> bool:
        """Whether policies are chosen, by missions that they fly."""
        return self._policy == BEST

    @property
    def is_open(self) -> bool:
        """Whether a choice is under way."""
        return self._choosing is not None

    def policy_for(self, scenario: Scenario, own_policy: Any) -> NamedPolicy | None:
        """The policy in a scenario; None while it is to be chosen: `go_on` until it is.

        Args:
            own_policy: message of what was refined for the scenario, without content where nothing
                was; None: that is not known yet, and a choice waits for it.

        Raises:
            PolicyMismatchError: it does not fit, or a candidate that the user names does not.
        """
        self._choosing = None
        if not self.is_by_missions:
            return policy_for(self._policy, scenario)
        if own_policy is None:
            return None
        self._key = fingerprint(scenario), own_policy.sha256
        chosen = self._chosen.get(self._key)
        if chosen is not None:
            return replace(chosen.policy)  # with a memory of its own
        self._begin(scenario, own_policy)
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
        [self._chosen[self._key]] = [it for it in self._candidates if it.name == choice.policy]
        self._log(str(choice))
        return True

    def _begin(self, scenario: Scenario, own_policy: Any) -> None:
        from uav_collect.analysis.choosing import candidates_for, Choosing

        candidates, left_out = candidates_for(scenario, self._given)
        if own_policy.content:
            try:
                own = _own_candidate(scenario, own_policy)
                candidates = [own, *(it for it in candidates if it.name != own.name)]
            except PolicyMismatchError as error:
                left_out.append(f'what was refined for {scenario.name} cannot be chosen: {error}')
        self._candidates = candidates
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


def _own_candidate(scenario: Scenario, own_policy: Any) -> 'Candidate':
    """What was refined for a scenario; it is called as that is.

    Raises:
        PolicyMismatchError: it is not whole, cannot fly the scenario, or is called as another one.
    """
    from uav_collect.analysis.choosing import Candidate

    name = checked_name(Path(f'{scenario.name}{SUFFIX}'))
    frozen = checked_policy(own_policy, brief(scenario)).frozen
    return Candidate(name=name, policy=LearnedPolicy(name, frozen))

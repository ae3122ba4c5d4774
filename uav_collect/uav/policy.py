"""What decides for one UAV: the protocol that every policy follows, and the choice of one."""

import os
from pathlib import Path
from typing import Protocol

from uav_collect.config.installed import shared_folders
from uav_collect.config.yaml_text import shown
from uav_collect.errors import PolicyMismatchError
from uav_collect.kernels.arrays import Row
from uav_collect.limits import BEST, is_code_name, is_lookahead_name, LOOKAHEAD, NO_AGENT
from uav_collect.scenario.model import Scenario
from uav_collect.uav.action_codes import NONE
from uav_collect.uav.belief import Belief
from uav_collect.uav.briefing import brief, Briefing
from uav_collect.uav.heuristics import Heuristic, RulePolicy
from uav_collect.uav.learned_on import strangeness, strangeness_within
from uav_collect.uav.lookahead import lookahead_named, LookaheadPolicy, slowness
from uav_collect.uav.named_code import named_code
from uav_collect.uav.policy_file import FORMAT, load_policy, SUFFIX, WEIGHTS_FORMAT
from uav_collect.uav.policy_header import PolicyHeader
from uav_collect.uav.policy_network import FrozenPolicy, LearnedPolicy
from uav_collect.uav.user_policy import user_policy, UserPolicy
from uav_collect.uav.view import LocalView

STRONG = 'strong'  # stands for the learned policy that is shipped for the scenario at hand
ANYWHERE = 'anywhere'  # the shipped policy that flies any field, where there is one
TOPIC = 'topic'  # stands for what a trainer publishes, for agents over ROS


class Policy(Protocol):
    """Chooses one UAV's actions from what that UAV knows; it may remember within a mission."""

    @property
    def name(self) -> str:
        """What users call it; stands in the mission log."""

    @property
    def version(self) -> str:
        """Which version of it flies."""

    def begin(self, briefing: Briefing, uav: int) -> None:
        """Forget the last mission and get ready to fly a UAV, by index.

        Raises:
            PolicyMismatchError: it cannot fly this fleet over this area.
        """

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        """One of the legal actions (at least one is), or HOME to end the mission."""


NamedPolicy = RulePolicy | LookaheadPolicy | LearnedPolicy | UserPolicy


def policy_named(name: str) -> NamedPolicy:
    """The policy that a user names: a rule, one that looks ahead, a learned one or a function.

    Raises:
        PolicyMismatchError: there is none of that name, or its file or module is broken.
    """
    match name:
        case 'best':
            raise PolicyMismatchError(
                f'policy {BEST} is chosen before take-off: mission, evaluate, uav_agent and'
                ' mission.launch.py do so, and choose_policy in Python'
            )
        case 'hert':
            return RulePolicy(Heuristic.HERT)
        case 'hert-equal':
            return RulePolicy(Heuristic.HERT_EQUAL)
        case 'sweep':
            return RulePolicy(Heuristic.SWEEP)
        case 'random':
            return RulePolicy(Heuristic.RANDOM)
        case _ if is_lookahead_name(name):  # before functions, whose names look alike
            return lookahead_named(name)
        case _ if is_code_name(name):
            return user_policy(name)
    file = _file_of(name)
    if file is None:
        known = [heuristic.label for heuristic in Heuristic] + [*shipped_policies()]
        raise PolicyMismatchError(
            f'policy {shown(name)} is unknown; there are {", ".join(known)}, the path of a'
            f' {SUFFIX} file, {LOOKAHEAD}:RULE, or module:function'
        )
    return _learned(file)


def listed_names(text: str) -> list[str]:
    """The policies that a user names in one text, separated by commas; none if it is empty.

    Raises:
        PolicyMismatchError: a name is empty.
    """
    names = [name.strip() for name in text.split(',')] if text else []
    if not all(names):
        raise PolicyMismatchError(
            f'candidates are {shown(text)}: must be policies, separated by commas'
        )
    return names


def policy_for(name: str, scenario: Scenario) -> NamedPolicy:
    """The policy that a user names, checked to fit a scenario.

    Args:
        name: as for `policy_named`, or STRONG for the one that is shipped for the scenario, if it
            learned on the like of it, else ANYWHERE, if that is shipped.

    Raises:
        PolicyMismatchError: there is none of that name, it is broken, or it does not fit.
    """
    if name == STRONG:
        return _strong(scenario)
    return _fitting(policy_named(name), scenario)


def remarks(policy: Policy, scenario: Scenario) -> list[str]:
    """What whoever flies a policy in a scenario should know of it, in one line each."""
    slow = slowness(policy, scenario) if isinstance(policy, LookaheadPolicy) else None
    lines = [slow, unfamiliar(policy, scenario)]
    if isinstance(policy, LearnedPolicy):
        lines = [outdated(policy.name, policy.frozen), *lines, changed(policy)]
    return [line for line in lines if line is not None]


def outdated(name: str, policy: FrozenPolicy) -> str | None:
    """In one line, that nothing covers the header of a learned policy; None if it is covered."""
    if policy.is_header_covered:
        return None
    return (
        f'policy {name} is of {WEIGHTS_FORMAT}: its digest covers the weights, not the header;'
        f' tools/rewrite_policies.py of a clone writes it as {FORMAT}'
    )


def unfamiliar(policy: Policy, scenario: Scenario) -> str | None:
    """In one line, by what a scenario lies outside what a policy learned on; None if by nothing.

    Rules and functions learned nothing, and old files do not say on what.
    """
    if not isinstance(policy, LearnedPolicy):
        return None
    header = policy.frozen.header
    if header.domains:
        return _flown_by_adviser(policy.name, header, scenario)
    strange = strangeness(header.learned_on, scenario)
    for within in header.learned_within:
        strange += strangeness_within(within, scenario)
    what = f'policy {policy.name} flies outside what it learned on'
    return f'{what}: {"; ".join(strange)}' if strange else None


def rule_of(policy: Policy, briefing: Briefing) -> Heuristic | None:
    """The rule by which a policy flies a fleet: its own, or that of a learned one's domains."""
    match policy:
        case RulePolicy(heuristic=rule):
            return rule
        case LearnedPolicy(frozen=network):
            return network.header.rule_for(briefing)
    return None


def _flown_by_adviser(name: str, header: PolicyHeader, scenario: Scenario) -> str | None:
    """In one line, that a rule flies outside a policy's domains and why; None within one."""
    briefing = brief(scenario)
    rule = header.rule_for(briefing)
    if rule is None:
        return None
    # Of domains for as many UAVs, if there are any, the one that it is nearest to.
    near = [it for it in header.domains if it.is_for(briefing.n_uavs)] or header.domains
    misfits = min(([*it.misfits(briefing)] for it in near), key=len)
    return f'policy {name} flies as {rule.label} here: {", ".join(misfits)}'


def changed(policy: LearnedPolicy) -> str | None:
    """In one line, that users' code by which a policy flies is not what it learned with."""
    header = policy.frozen.header
    flown = [name for name in (header.layout.label, header.network) if is_code_name(name)]
    differing = [
        label
        for label in header.code.split()
        if label.split('@')[0] in flown and label != named_code(label.split('@')[0]).label
    ]
    if not differing:
        return None
    return f'policy {policy.name} learned with {" and ".join(differing)}, which has changed since'


def guard_for(policy: Policy, guard_after: int, briefing: Briefing) -> int:
    """After how many decisions without news a policy's guard decides; NONE: a rule has none."""
    is_rule = isinstance(policy, LookaheadPolicy) or rule_of(policy, briefing) is not None
    return NONE if is_rule else guard_after


def frozen_policy(name: str) -> FrozenPolicy:
    """The weights of a learned policy that a user names: a shipped one or a file.

    Raises:
        PolicyMismatchError: there is none of that name, or its file is broken.
    """
    file = _file_of(name)
    if file is None:
        raise PolicyMismatchError(
            f'no learned policy is called {shown(name)}; there are'
            f' {", ".join(shipped_policies())}, or the path of a {SUFFIX} file'
        )
    return load_policy(file)


def shipped_policies() -> tuple[str, ...]:
    """The names of the learned policies that come with the package."""
    files = [file for folder in shared_folders('policies') for file in folder.glob(f'*{SUFFIX}')]
    return tuple(sorted({file.stem for file in files}))


def specialist_name(scenario: Scenario) -> str:
    """The name of the policy that is shipped for a scenario's name and number of UAVs.

    Raises:
        PolicyMismatchError: there is none.
    """
    # The one place that knows how shipped policies are named.
    name = f'{scenario.name}_n{scenario.n_uavs}_aqmix'
    if name not in shipped_policies():
        own = [it for it in shipped_policies() if it.startswith(f'{scenario.name}_n')]
        there = f' (there are {", ".join(own)})' if own else ''
        fleet = f'{scenario.n_uavs} UAV{"s" if scenario.n_uavs > 1 else ""}'
        raise PolicyMismatchError(
            f'no learned policy is shipped for {scenario.name} with {fleet}{there}'
        )
    return name


def _strong(scenario: Scenario) -> NamedPolicy:
    """The specialist of a scenario where it has learned on the like of it, else ANYWHERE."""
    try:
        name = specialist_name(scenario)
    except PolicyMismatchError as error:
        return _anywhere(scenario, str(error))
    specialist = policy_named(name)  # raises where its file is broken
    try:
        _fitting(specialist, scenario)
    except PolicyMismatchError as error:
        return _anywhere(scenario, str(error))
    strange = unfamiliar(specialist, scenario)
    if strange is not None:
        return _anywhere(scenario, f'{strange}; --policy {name} flies it all the same')
    return specialist


def _anywhere(scenario: Scenario, why: str) -> NamedPolicy:
    """The policy that flies where no specialist does, for a reason."""
    if ANYWHERE not in shipped_policies():
        hint = f'--policy {BEST} flies the best of what there is'
        raise PolicyMismatchError(f'{why}; {hint}')
    return _fitting(policy_named(ANYWHERE), scenario)


def _fitting(policy: NamedPolicy, scenario: Scenario) -> NamedPolicy:
    policy.begin(brief(scenario), 0)
    return policy


def _file_of(name: str) -> Path | None:
    """The file of a learned policy that a user names; None if no shipped one is called so."""
    if name.endswith(SUFFIX) or os.sep in name:
        return Path(name)
    files = (folder / f'{name}{SUFFIX}' for folder in shared_folders('policies'))
    return next((file for file in files if os.path.isfile(file)), None)


def checked_name(file: Path) -> str:
    """What the policy of a file is called.

    Raises:
        PolicyMismatchError: no policy's file can have this name.
    """
    if file.stem in (STRONG, BEST, TOPIC, NO_AGENT, *(heuristic.label for heuristic in Heuristic)):
        raise PolicyMismatchError(
            f'{file}: must not be called as another policy is, nor none: rename it'
        )
    # The same in every locale, and for files whose names are of another.
    name = os.fsencode(file.stem).decode(errors='backslashreplace')
    if not name.isprintable():
        raise PolicyMismatchError(f'{shown(str(file))}: its name must be printable: rename it')
    return name


def _learned(file: Path) -> LearnedPolicy:
    name = checked_name(file)
    return LearnedPolicy(name=name, frozen=load_policy(file))

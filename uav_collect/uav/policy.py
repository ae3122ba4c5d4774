"""What decides for one UAV: the protocol that every policy follows, and the choice of one."""

from dataclasses import dataclass, field
import os
from pathlib import Path
from typing import Protocol

import numpy as np
from uav_collect.config.installed import shared_folders
from uav_collect.errors import PolicyMismatchError
from uav_collect.kernels.arrays import Floats, Row
from uav_collect.kernels.rows import new_row
from uav_collect.scenario.load import Scenario
from uav_collect.uav.actions import NONE
from uav_collect.uav.belief import Belief
from uav_collect.uav.briefing import brief, Briefing
from uav_collect.uav.exploration import explore
from uav_collect.uav.heuristics import choose, Heuristic, MEMORY_SIZE
from uav_collect.uav.observation import encode
from uav_collect.uav.policy_file import load_policy, SUFFIX
from uav_collect.uav.policy_network import best_actions, FrozenPolicy
from uav_collect.uav.user_policy import callable_policy, CallablePolicy, is_callable_name
from uav_collect.uav.view import LocalView

STRONG = 'strong'  # stands for the learned policy that is shipped for the scenario at hand
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
        """One of the legal actions (at least one is), or actions.HOME to end the mission."""


@dataclass
class RulePolicy:
    """A heuristic behind the protocol."""

    heuristic: Heuristic
    _briefing: Briefing | None = field(default=None, init=False)
    _uav: int = field(default=0, init=False)
    _memory: Row[int] = field(default_factory=lambda: new_row(MEMORY_SIZE, 0), init=False)

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


@dataclass
class LearnedPolicy:
    """A frozen policy behind the protocol, with the hidden state of the UAV that it flies.

    Those of a fleet share the frozen policy.
    """

    name: str
    frozen: FrozenPolicy
    _briefing: Briefing | None = field(default=None, init=False)
    _uav: int = field(default=0, init=False)
    _hidden: Floats = field(default_factory=lambda: np.zeros((1, 0)), init=False)  # (1, H)
    _observation: Row[float] = field(default_factory=lambda: new_row(0, 0.0), init=False)

    @property
    def version(self) -> str:
        """Run, update and weights that it came from."""
        return self.frozen.header.version

    @property
    def observation(self) -> Row[float]:
        """What it chose from last, encoded; not to be written."""
        return self._observation

    def begin(self, briefing: Briefing, uav: int) -> None:
        """Forget the last mission and get ready to fly a UAV, by index.

        Raises:
            PolicyMismatchError: it did not learn to fly such a fleet, or such an area.
        """
        misfit = self.frozen.misfit(briefing)
        if misfit is not None:
            raise PolicyMismatchError(f'policy {self.name}: {misfit}')
        self._briefing = briefing
        self._uav = uav
        self._hidden = self.frozen.new_hidden(1)
        self._observation = new_row(self.frozen.header.observation_size, 0.0)

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        """The legal action of the highest value."""
        if self._briefing is None:
            raise RuntimeError('a policy must begin a mission before it chooses')
        layout = int(self.frozen.header.layout)
        encode(layout, self._briefing, self._uav, belief, view, self._observation)
        observed = np.array([self._observation], dtype=np.float64)
        values, self._hidden = self.frozen.step(observed, self._hidden)
        return int(best_actions(values, np.array([legal]) == 1)[0])


@dataclass
class ExploringPolicy:
    """A learned policy whose UAV takes a random action now and then, by the key of the mission."""

    learned: LearnedPolicy
    epsilon: float  # probability to explore
    hover_share: float  # see `exploration.explore`
    mission_seed: int  # of the mission that is flown
    _uav: int = field(default=0, init=False)
    _n_decisions: int = field(default=0, init=False)

    @property
    def name(self) -> str:
        """That of the learned policy."""
        return self.learned.name

    @property
    def version(self) -> str:
        """Weights and how much it explores."""
        return flown_version(self.learned.version, self.epsilon)

    def begin(self, briefing: Briefing, uav: int) -> None:
        """Forget the last mission and get ready to fly a UAV, by index.

        Raises:
            PolicyMismatchError: it did not learn to fly such a fleet, or such an area.
        """
        self.learned.begin(briefing, uav)
        self._uav = uav
        self._n_decisions = 0

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        """The random action of this decision, or else the legal one of the highest value."""
        best = self.learned.choose(belief, view, legal)  # always: it remembers what it saw
        decision = self._n_decisions
        self._n_decisions += 1
        explored = explore(
            self.mission_seed, self._uav, decision, self.epsilon, self.hover_share, legal
        )
        return best if explored == NONE else explored


def flown_version(version: str, epsilon: float) -> str:
    """How commands, logs and transitions name a learned policy that explores so much."""
    return f'{version} eps {epsilon:g}' if epsilon > 0.0 else version


NamedPolicy = RulePolicy | LearnedPolicy | CallablePolicy


def policy_named(name: str) -> NamedPolicy:
    """The policy that a user names: a heuristic, a shipped policy, a file or `module:function`.

    Raises:
        PolicyMismatchError: there is none of that name, or its file or module is broken.
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
        case _ if is_callable_name(name):
            return callable_policy(name)
    file = _file_of(name)
    if file is None:
        known = [heuristic.label for heuristic in Heuristic] + [*shipped_policies()]
        raise PolicyMismatchError(
            f'policy {name!r} is unknown; there are {", ".join(known)}, the path of a {SUFFIX} '
            'file, or module:function'
        )
    return _learned(file)


def policy_for(name: str, scenario: Scenario) -> NamedPolicy:
    """The policy that a user names, checked to fit a scenario.

    Args:
        name: as for `policy_named`, or STRONG for the one that is shipped for the scenario's name
            and number of UAVs.

    Raises:
        PolicyMismatchError: there is none of that name, it is broken, or it does not fit.
    """
    policy = policy_named(_strong_name(scenario) if name == STRONG else name)
    policy.begin(brief(scenario), 0)
    return policy


def frozen_policy(name: str) -> FrozenPolicy:
    """The weights of a learned policy that a user names: a shipped one or a file.

    Raises:
        PolicyMismatchError: there is none of that name, or its file is broken.
    """
    file = _file_of(name)
    if file is None:
        raise PolicyMismatchError(
            f'no learned policy is called {name!r}; there are {", ".join(shipped_policies())}, '
            f'or the path of a {SUFFIX} file'
        )
    return load_policy(file)


def shipped_policies() -> tuple[str, ...]:
    """The names of the learned policies that come with the package."""
    files = [file for folder in shared_folders('policies') for file in folder.glob(f'*{SUFFIX}')]
    return tuple(sorted({file.stem for file in files}))


def _strong_name(scenario: Scenario) -> str:
    # The one place that knows how shipped policies are named.
    name = f'{scenario.name}_n{scenario.n_uavs}_aqmix'
    if name not in shipped_policies():
        shipped = ', '.join(shipped_policies()) or 'none'
        fleet = f'{scenario.n_uavs} UAV{"s" if scenario.n_uavs > 1 else ""}'
        raise PolicyMismatchError(
            f'no learned policy is shipped for {scenario.name} with {fleet} '
            f'({name}{SUFFIX}; there are {shipped})'
        )
    return name


def _file_of(name: str) -> Path | None:
    """The file of a learned policy that a user names; None if no shipped one is called so."""
    if name.endswith(SUFFIX) or os.sep in name:
        return Path(name)
    files = (folder / f'{name}{SUFFIX}' for folder in shared_folders('policies'))
    return next((file for file in files if file.is_file()), None)


def _learned(file: Path) -> LearnedPolicy:
    if file.stem in (STRONG, TOPIC, *(heuristic.label for heuristic in Heuristic)):
        raise PolicyMismatchError(f'{file}: must not be called as another policy is: rename it')
    return LearnedPolicy(name=file.stem, frozen=load_policy(file))

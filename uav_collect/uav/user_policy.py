"""Policies that users write: a function of what one UAV knows, named as `module:function`.

A function gets a `Situation` and returns one of the legal actions, or HOME. To remember, name a
class instead: it is called with the briefing and the UAV's index at the start of each mission, and
what it makes is called with each `Situation` of that UAV. Both must decide by what they are given
alone: then a mission is the same to the byte however it is flown.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
import operator
from types import CoroutineType
from typing import Any

import numpy as np
from uav_collect.errors import PolicyMismatchError
from uav_collect.kernels.arrays import Row
from uav_collect.uav.action_codes import HOME, N_ACTIONS, NONE
from uav_collect.uav.belief import Belief, BeliefRows
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.named_code import code_of, named_code
from uav_collect.uav.situation import Situation
from uav_collect.uav.user_code import (
    definition_text,
    kind_text,
    run_user_code,
    UserCodeError,
    value_text,
)
from uav_collect.uav.view import LocalView


@dataclass
class UserPolicy:
    """A function or class behind the protocol `policy.Policy`."""

    name: str
    version: str
    target: Callable[..., Any]
    file: str | None = None  # in which it was written
    _decide: Callable[..., Any] | None = field(default=None, init=False)
    _briefing: Briefing | None = field(default=None, init=False)
    _uav: int = field(default=0, init=False)

    def begin(self, briefing: Briefing, uav: int) -> None:
        """Forget the last mission and get ready to fly a UAV, by index.

        Raises:
            PolicyMismatchError: the class fails, or makes nothing that can be called.
        """
        self._briefing, self._uav = arrayed(briefing), uav
        self._decide = self.target
        if isinstance(self.target, type):
            try:
                self._decide = run_user_code(self.file, self.target, self._briefing, uav)
            except UserCodeError as error:
                raise self._failure(f'UAV {uav + 1}, at the start: {error}') from error
        if not callable(self._decide):
            what = f'a {kind_text(self._decide)} cannot be called{definition_text(self.target)}'
            raise self._failure(what)

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        """One of the legal actions, or HOME to end the mission.

        Raises:
            PolicyMismatchError: the function fails, or returns anything else.
        """
        if self._briefing is None or self._decide is None:
            raise RuntimeError('a policy must begin a mission before it chooses')
        situation = situation_of(self._briefing, self._uav, belief, view, legal)
        try:
            answer = run_user_code(self.file, self._decide, situation)
            action = self._action(answer)
            if action == HOME or (0 <= action < N_ACTIONS and legal[action] == 1):
                return action
            allowed = [each for each in range(N_ACTIONS) if legal[each] == 1]
            raise UserCodeError(
                f'{value_text(answer)} is no legal action; legal are {allowed} and {HOME} to fly'
                f' home{definition_text(self._decide)}'
            )
        except UserCodeError as error:
            where = f'UAV {self._uav + 1} at {view.time_s:.1f} s in cell {view.cell}'
            raise self._failure(f'{where}: {error}') from error

    def _action(self, answer: object) -> int:
        """The number that was returned, of whatever library's kind; NONE if it is no number."""
        if type(answer) is int:
            return answer
        if type(answer) is CoroutineType:
            answer.close()  # else Python complains of it later
        if isinstance(answer, bool):
            return NONE
        try:
            return int(run_user_code(self.file, operator.index, answer))
        except UserCodeError as error:
            if isinstance(error.__cause__, TypeError):
                return NONE
            raise

    def _failure(self, what: str) -> PolicyMismatchError:
        return PolicyMismatchError(f'policy {self.name}: {what}')


def user_policy(name: str) -> UserPolicy:
    """The policy `module:function`; the module may lie in the working directory.

    Raises:
        PolicyMismatchError: there is no such module or function, or the module fails.
    """
    try:
        code = named_code(name)
    except UserCodeError as error:
        raise PolicyMismatchError(f'policy {name}: {error}') from error
    return UserPolicy(name=name, version=code.version, target=code.target, file=code.file)


def policy_of(target: Callable[..., Any]) -> UserPolicy:
    """A function or class as a policy, called as it is.

    Raises:
        PolicyMismatchError: it cannot be called.
    """
    if not callable(target):
        what = value_text(target)
        raise PolicyMismatchError(f'policy {what}: must be a name, a function or a class')
    code = code_of(target)
    return UserPolicy(name=code.name, version=code.version, target=target, file=code.file)


def situation_of(
    briefing: Briefing, uav: int, belief: Belief, view: LocalView, legal: Row[int]
) -> Situation:
    """What a UAV knows, copied: whoever gets it may write into it."""
    # Interpreted kernels hand out lists, and an empty list does not tell what it would hold.
    n_sensors = view.n_sensors
    complete = np.array(belief.complete, dtype=np.uint8)
    own_belief: Any = BeliefRows(*map(np.array, belief))._replace(complete=complete)
    return Situation(
        briefing=briefing,
        uav=uav,
        belief=own_belief,
        view=view._replace(
            region_bit=np.array(view.region_bit),
            sensor=np.array(view.sensor[:n_sensors], dtype=np.int64),
            sensor_bit=np.array(view.sensor_bit[:n_sensors], dtype=np.float64),
            sensor_gain=np.array(view.sensor_gain[:n_sensors], dtype=np.float64),
            sensor_error_gain=np.array(view.sensor_error_gain[:n_sensors], dtype=np.float64),
        ),
        legal=np.array(legal, dtype=np.int64),
    )


def arrayed(briefing: Briefing) -> Briefing:
    """A briefing whose rows are numpy arrays, copies of its own."""
    values: Any = (it if isinstance(it, int | float) else np.array(it) for it in briefing)
    return Briefing(*values)

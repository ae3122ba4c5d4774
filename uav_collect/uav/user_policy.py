"""Policies that users write: a function of what one UAV knows, named as `module:function`.

A function gets a `Situation` and returns one of the legal actions, or HOME. To remember, name a
class instead: it is called with the briefing and the UAV's index at the start of each mission, and
what it makes is called with each `Situation` of that UAV. Both must decide by what they are given
alone: then a mission is the same to the byte however it is flown.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
import hashlib
import importlib
from importlib.machinery import ModuleSpec
import operator
import os
from pathlib import Path
import sys
from traceback import extract_tb
from types import ModuleType
from typing import Any

import numpy as np
from uav_collect.errors import PolicyMismatchError
from uav_collect.kernels.arrays import Ints, Row
from uav_collect.uav.action_codes import HOME, N_ACTIONS
from uav_collect.uav.belief import Belief, BeliefRows
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.view import LocalView

_VERSION_DIGITS = 12


@dataclass(frozen=True, kw_only=True)
class Situation:
    """What one UAV knows as it decides. Rows are numpy arrays, copies of its own."""

    briefing: Briefing
    uav: int  # index of the UAV
    belief: Belief
    view: LocalView  # rows of sensors are (n_sensors,)
    legal: Ints  # (N_ACTIONS,) 1 for each legal action; at least one is


@dataclass
class UserPolicy:
    """A function or class behind the protocol `policy.Policy`."""

    name: str
    version: str
    target: Callable[..., Any]
    _decide: Callable[..., Any] | None = field(default=None, init=False)
    _briefing: Briefing | None = field(default=None, init=False)
    _uav: int = field(default=0, init=False)

    def begin(self, briefing: Briefing, uav: int) -> None:
        """Forget the last mission and get ready to fly a UAV, by index.

        Raises:
            PolicyMismatchError: the class fails, or makes nothing that can be called.
        """
        self._briefing, self._uav = Briefing(*map(_arrayed, briefing)), uav
        self._decide = self.target
        if isinstance(self.target, type):
            try:
                self._decide = self.target(self._briefing, uav)
            except Exception as error:  # the user's code may raise anything
                raise self._failure(f'UAV {uav + 1}, at the start', error) from error
        if not callable(self._decide):
            kind = type(self._decide).__name__
            raise PolicyMismatchError(f'policy {self.name}: a {kind} cannot be called')

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        """One of the legal actions, or HOME to end the mission.

        Raises:
            PolicyMismatchError: the function fails, or returns anything else.
        """
        if self._briefing is None or self._decide is None:
            raise RuntimeError('a policy must begin a mission before it chooses')
        where = f'UAV {self._uav + 1} at {view.time_s:.1f} s in cell {view.cell}'
        situation = _situation(self._briefing, self._uav, belief, view, legal)
        try:
            answer = self._decide(situation)
        except Exception as error:  # the user's code may raise anything
            raise self._failure(where, error) from error
        try:
            action = operator.index(answer)
        except TypeError:
            action = HOME + 1
        if action == HOME or (0 <= action < N_ACTIONS and legal[action] == 1):
            return action
        allowed = [each for each in range(N_ACTIONS) if legal[each] == 1]
        raise PolicyMismatchError(
            f'policy {self.name}: {where}: {answer!r} is no legal action; legal are {allowed} and '
            f'{HOME} to fly home'
        )

    def _failure(self, where: str, error: Exception) -> PolicyMismatchError:
        # The first frame is ours, the second the user's; there is none if the call itself failed.
        lines = [
            f' ({Path(frame.filename).name}, line {frame.lineno})'
            for frame in extract_tb(error.__traceback__)[1:2]
        ]
        return PolicyMismatchError(
            f'policy {self.name}: {where}: {_in_one_line(error)}{"".join(lines)}'
        )


def is_user_policy_name(name: str) -> bool:
    """Whether a name has the form `module:function`."""
    module, colon, function = name.partition(':')
    return bool(colon) and all(part.isidentifier() for part in (*module.split('.'), function))


def user_policy(name: str) -> UserPolicy:
    """The policy `module:function`; the module may lie in the working directory.

    Raises:
        PolicyMismatchError: there is no such module or function, or the module fails.
    """
    module_name, _, function = name.partition(':')
    module = _imported(name, module_name)
    try:
        target = vars(module)[function]
    except KeyError:
        raise PolicyMismatchError(
            f'policy {name}: module {module_name} has no {function}'
        ) from None
    if not callable(target):
        kind = type(target).__name__
        raise PolicyMismatchError(f'policy {name}: {function} is a {kind}: must be a function')
    return UserPolicy(name=name, version=_version(module.__spec__), target=target)


def policy_of(target: Callable[..., Any]) -> UserPolicy:
    """A function or class as a policy, called as it is.

    Raises:
        PolicyMismatchError: it cannot be called.
    """
    if not callable(target):
        raise PolicyMismatchError(f'policy {target!r}: must be a name, a function or a class')
    name = getattr(target, '__name__', type(target).__name__)
    version = _version(sys.modules[target.__module__].__spec__)
    return UserPolicy(name=name, version=version, target=target)


def _imported(policy: str, module: str) -> ModuleType:
    # An installed command, unlike "python -m", does not look where the user is.
    if not {'', os.getcwd()} & set(sys.path):
        sys.path.append(os.getcwd())
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or not f'{module}.'.startswith(f'{error.name}.'):
            raise PolicyMismatchError(
                f'policy {policy}: module {module} cannot be imported: {_in_one_line(error)}'
            ) from error
        raise PolicyMismatchError(
            f'policy {policy}: there is no module {error.name} in {os.getcwd()} or where else '
            'Python looks (PYTHONPATH)'
        ) from None
    except (Exception, SystemExit) as error:  # the user's code may raise anything
        raise PolicyMismatchError(
            f'policy {policy}: module {module} cannot be imported: {_in_one_line(error)}'
        ) from error


def _version(spec: ModuleSpec | None) -> str:
    """A digest of the module's file, so that results tell which one was flown."""
    if spec is None or spec.origin is None or not spec.has_location:
        return 'built-in'
    return hashlib.sha256(Path(spec.origin).read_bytes()).hexdigest()[:_VERSION_DIGITS]


def _in_one_line(error: BaseException) -> str:
    """An exception in one line."""
    return ' '.join(f'{type(error).__name__}: {error}'.split())


def _situation(
    briefing: Briefing, uav: int, belief: Belief, view: LocalView, legal: Row[int]
) -> Situation:
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


def _arrayed(value: Any) -> Any:  # noqa: ANN401 - a number or a row
    return value if isinstance(value, int | float) else np.array(value)

"""Observations that users write: numbers of their own behind those of one of the layouts.

`observation: module:Name` names a class. It runs in Python, in compiled processes too, so that it
gives the same bits on board, in batches and when a learner rebuilds what a UAV saw.
"""

from collections.abc import Sequence
from functools import cache
from typing import Protocol

import numpy as np
from uav_collect.config.yaml_text import shown
from uav_collect.errors import ConfigError, PolicyMismatchError
from uav_collect.kernels.arrays import Floats
from uav_collect.limits import is_code_name, MAX_LAYER_SIZE
from uav_collect.uav.named_code import named_code
from uav_collect.uav.observation import AnyLayout, Layout, OwnLayout
from uav_collect.uav.situation import Situation
from uav_collect.uav.user_code import numbers_of, UserCodeError, value_text

_MEMBERS = ('base', 'size', 'numbers')


class Observation(Protocol):
    """What a user's class has; it is called without arguments."""

    base: str  # paper, egocentric or relative: the layout whose numbers stand before its own
    size: int  # how many numbers it adds

    def numbers(self, situation: Situation) -> Sequence[float]:
        """What a UAV sees besides, by what it knows alone; of the order of one, shape (size,).

        The view shows no sensors (`n_sensors` is 0): a learner does not keep them.
        """


def layout_named(name: str) -> AnyLayout:
    """The layout that a setting names: paper, egocentric, relative or module:Name.

    Raises:
        UserCodeError: there is no such code, or it is no observation.
    """
    return own_layout(name) if is_code_name(name) else Layout[name.upper()]


def layout_labelled(label: str) -> AnyLayout:
    """The layout that a file or a message tells by its label.

    Raises:
        PolicyMismatchError: in one line: there is none, or a user's class is missing.
    """
    if is_code_name(label):
        try:
            return own_layout(label)
        except UserCodeError as error:
            what = f'{error}; such a policy sees by its class alone'
            raise PolicyMismatchError(f'layout is {shown(label)}: {what}') from error
    known = {layout.label: layout for layout in Layout}
    if label not in known:
        raise PolicyMismatchError(f'layout is {shown(label)}: must be {" or ".join(known)}')
    return known[label]


@cache
def own_layout(name: str) -> OwnLayout:
    """The layout of a user's class, `module:Name`.

    Raises:
        UserCodeError: there is none, or it is no observation.
    """
    code = named_code(name, _MEMBERS)
    observation: Observation = code.call(code.target)
    bases = {layout.name.lower(): layout for layout in Layout}
    base, size, own = (code.call(getattr, observation, member) for member in _MEMBERS)
    if type(base) is not str or base not in bases:
        raise UserCodeError(f'base is {value_text(base)}: must be {" or ".join(bases)}')
    if type(size) is not int or not 1 <= size <= MAX_LAYER_SIZE:
        raise UserCodeError(f'size is {value_text(size)}: must be from 1 to {MAX_LAYER_SIZE}')

    def numbers(situation: Situation) -> Floats:
        try:
            answer = code.call(own, situation)
        except UserCodeError as error:
            raise ConfigError(f'observation {name}: {error}') from error
        row = numbers_of(answer)
        if row is None or row.shape != (size,) or not np.isfinite(row).all():
            what = f'numbers gives {value_text(answer)}: must be {size} finite numbers'
            raise ConfigError(f'observation {name}: {what}')
        return row

    return OwnLayout(name, bases[base], size, numbers)

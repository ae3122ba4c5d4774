"""Everything one UAV does when it decides: hear, observe, share its bandwidth, choose.

`missions.batch_kernels.fly_on` calls the kernels; an agent node and `missions.simulation` call the
class, which calls the same kernels.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from uav_collect.errors import AllocationError
from uav_collect.kernels.arrays import new_row, Row
from uav_collect.kernels.compile import kernel
from uav_collect.limits import ALLOCATOR_NAMES
from uav_collect.physics.bandwidth import EQUAL, EXACT, share_bandwidth
from uav_collect.uav import action_codes, actions
from uav_collect.uav.action_codes import HOME, HOVER, N_ACTIONS, NONE
from uav_collect.uav.belief import belief_of, forget, hear, new_beliefs, observe
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.messages import Decision, RadioMessage
from uav_collect.uav.policy import Policy
from uav_collect.uav.view import LocalView

_ROOM = 64  # sensors of a view that an agent has rows for before it makes longer ones


class Workspace(NamedTuple):
    """Rows an agent works with at a decision."""

    signal_w: Row[float]  # received power by sensor of the view
    error_w: Row[float]  # of which estimation error
    share_hz: Row[float]  # bandwidth by sensor of the view
    legal: Row[int]  # (N_ACTIONS,)


# Shares the bandwidth among the sensors of a view and returns the hover's duration [s].
Allocator = Callable[[Briefing, LocalView, Workspace], float]


def new_workspace(max_sensors: int) -> Workspace:
    """Rows for views of at most so many sensors."""
    return Workspace(
        signal_w=new_row(max_sensors, 0.0),
        error_w=new_row(max_sensors, 0.0),
        share_hz=new_row(max_sensors, 0.0),
        legal=new_row(N_ACTIONS, 0),
    )


@kernel
def allocate(allocator: int, briefing: Briefing, view: LocalView, workspace: Workspace) -> float:
    """Share the UAV's bandwidth among the view's sensors.

    Returns:
        How long a hover would take [s]; 0 where no data waits.
    """
    if view.n_sensors == 0:
        return 0.0
    write_powers(briefing, view, workspace)
    hover_s, _ = share_bandwidth(
        allocator,
        workspace.signal_w,
        workspace.error_w,
        view.sensor_bit,
        view.n_sensors,
        briefing.bandwidth_hz,
        briefing.noise_w_per_hz,
        workspace.share_hz,
    )
    return hover_s


@kernel
def write_powers(briefing: Briefing, view: LocalView, workspace: Workspace) -> None:
    """Write the power received from each of the view's sensors, and the error's part of it."""
    for index in range(view.n_sensors):
        workspace.signal_w[index] = briefing.tx_power_w * view.sensor_gain[index]
        workspace.error_w[index] = briefing.tx_power_w * view.sensor_error_gain[index]


@kernel
def reason_to_go_home(
    briefing: Briefing,
    uav: int,
    n_complete: int,
    view: LocalView,
    hover_s: float,
    legal: Row[int],
) -> int:
    """Mark the legal actions and say why the UAV must go home, or NONE if it may choose."""
    n_legal = actions.mark_legal(
        briefing,
        uav,
        view.x_m,
        view.y_m,
        view.energy_left_j,
        view.previous_action,
        hover_s,
        legal,
    )
    if n_complete == briefing.cells_per_side * briefing.cells_per_side:
        return action_codes.MAP_COMPLETE
    return NONE if n_legal > 0 else action_codes.ENERGY_RESERVE


def allocator_named(name: str) -> Allocator:
    """The allocator that a user names, one of `limits.ALLOCATOR_NAMES`.

    Raises:
        AllocationError: there is none of that name.
    """
    match name:
        case 'exact':
            return partial(allocate, EXACT)
        case 'equal':
            return partial(allocate, EQUAL)
        case 'cvxpy':
            return _allocate_by_cvxpy
        case _:
            known = ', '.join(ALLOCATOR_NAMES)
            raise AllocationError(f'allocator {name!r} is unknown; there are {known}')


def _allocate_by_cvxpy(briefing: Briefing, view: LocalView, workspace: Workspace) -> float:
    from uav_collect.physics.bandwidth_convex import allocate_cvxpy  # seconds to import

    if view.n_sensors == 0:
        return 0.0
    seen = range(view.n_sensors)
    allocation = allocate_cvxpy(
        np.array([[briefing.tx_power_w * view.sensor_gain[index] for index in seen]]),
        np.array([[briefing.tx_power_w * view.sensor_error_gain[index] for index in seen]]),
        np.array([[view.sensor_bit[index] for index in seen]]),
        briefing.bandwidth_hz,
        briefing.noise_w_per_hz,
    )
    for index, share_hz in enumerate(allocation.share_hz[0].tolist()):
        workspace.share_hz[index] = share_hz
    return float(allocation.hover_s[0])


class Agent:
    """One UAV on board: its belief, its policy, its allocator."""

    def __init__(self, briefing: Briefing, uav: int, policy: Policy, allocator: Allocator) -> None:
        """Get ready for a first mission; the UAV is given by its index."""
        self.policy = policy
        self.belief = belief_of(new_beliefs(briefing, 1), 0)
        self._briefing = briefing
        self._uav = uav
        self._allocator = allocator
        self._workspace = new_workspace(_ROOM)
        policy.begin(briefing, uav)

    @property
    def legal(self) -> Row[int]:
        """Which actions were legal at the latest decision, (N_ACTIONS,)."""
        return self._workspace.legal

    def begin(self) -> None:
        """Forget the last mission."""
        forget(self.belief)
        self.policy.begin(self._briefing, self._uav)

    def hear(self, message: RadioMessage) -> None:
        """Merge a message of another UAV."""
        hear(
            self.belief,
            message.sender,
            message.complete,
            message.x_m,
            message.y_m,
            message.time_s,
        )

    def observe(self, view: LocalView) -> None:
        """Take a local view into the belief."""
        observe(self.belief, self._briefing, view)

    def message(self, view: LocalView) -> RadioMessage:
        """What the UAV's radio sends after a view was observed."""
        return RadioMessage(
            sender=self._uav,
            complete=self.belief.complete,
            x_m=view.x_m,
            y_m=view.y_m,
            time_s=view.time_s,
        )

    def decide(self, view: LocalView) -> Decision:
        """Choose the next action from the belief and the view observed last."""
        if view.n_sensors > len(self._workspace.share_hz):
            self._workspace = new_workspace(view.n_sensors)
        hover_s = self._allocator(self._briefing, view, self._workspace)
        legal = self._workspace.legal
        reason = reason_to_go_home(
            self._briefing, self._uav, self.belief.n_complete[0], view, hover_s, legal
        )
        if reason != NONE:
            return Decision(action=HOME, reason=reason)
        action = self.policy.choose(self.belief, view, legal)
        share_hz = self._workspace.share_hz
        served = range(view.n_sensors if action == HOVER else 0)
        return Decision(
            action=action,
            reason=action_codes.BY_POLICY,
            sensor=tuple(int(view.sensor[index]) for index in served),
            share_hz=tuple(float(share_hz[index]) for index in served),
        )

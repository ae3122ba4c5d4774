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
from uav_collect.uav.belief import Belief, belief_of, forget, hear, new_beliefs, observe
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.messages import Decision, RadioMessage
from uav_collect.uav.moves import measure, Moves, n_moves_to, new_moves, NO_WAY, step
from uav_collect.uav.policy import Policy
from uav_collect.uav.view import LocalView

WATCH_SIZE = 3  # what a guard keeps of a UAV's decisions, NONE before the first
_KNOWN = 0  # complete cells at the latest decision
_IDLE = 1  # decisions before it since there were fewer
_STEPPED_IN = 2  # 1 once the guard has decided

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
    if n_complete == briefing.n_rows * briefing.n_columns:
        return action_codes.MAP_COMPLETE
    return NONE if n_legal > 0 else action_codes.ENERGY_RESERVE


@kernel
def guarded(
    guard_after: int,
    briefing: Briefing,
    belief: Belief,
    view: LocalView,
    legal: Row[int],
    chosen: int,
    watch: Row[int],
    moves: Moves,
) -> tuple[int, int]:
    """What a UAV does when its policy has chosen, and why: it never circles.

    Once so many decisions in a row taught it of no complete cell, by its own look or by radio, the
    guard decides until it knows more: hover, or make for the nearest other cell that is not
    complete on its map. From then on it decides after each decision that taught it of none: who
    has circled once does so again. A policy that chooses to fly home does.

    While its energy lasts for what the guard wants, a UAV over C = H x H cells, all of them open,
    decides at most C (guard_after + 2 H + 1) times. There are C news at most, and each hover is
    one, as is an incomplete cell that is seen to be empty. Between two news the policy has
    guard_after decisions, the guard a hover and the way to the nearest incomplete cell: 2 (H - 1)
    moves, each of which brings it nearer, and two more where the first would be straight back,
    which is not legal, and is a step aside. No later move is straight back: what is nearest then
    is so because the last move led there. Around closed cells ways are longer, and a step aside
    may lead into a dead end, at whose end the way back is legal.

    Energy that does not last for a move of the guard is less than two moves above the reserve;
    where it does not last for a hover, less than that hover. What is left pays for no more moves
    than that and the way home.

    Args:
        guard_after: decisions without news; 0 or less: there is no guard.
        legal: 1 for each legal action, shape (N_ACTIONS,), at least one.
        chosen: a legal action, or HOME.
        watch: read and written, shape (WATCH_SIZE,), NONE before the first decision.
        moves: scratch.

    Returns:
        The action, and GUARD if it is another one than the policy chose, else BY_POLICY.
    """
    if guard_after <= 0:
        return chosen, action_codes.BY_POLICY
    watch[_IDLE] += 1
    if belief.n_complete[0] > watch[_KNOWN]:
        watch[_KNOWN] = belief.n_complete[0]
        watch[_IDLE] = 0
    patience = 1 if watch[_STEPPED_IN] == 1 else guard_after
    if watch[_IDLE] < patience or chosen == HOME:
        return chosen, action_codes.BY_POLICY
    watch[_STEPPED_IN] = 1
    action = HOVER
    if legal[HOVER] == 0:
        target = _nearest_incomplete(briefing, belief, view.cell, moves)
        if target < 0:  # but its own, for which the energy does not last
            return chosen, action_codes.BY_POLICY
        action = step(briefing, view.cell, target, legal, moves)
    return action, action_codes.BY_POLICY if action == chosen else action_codes.GUARD


@kernel
def _nearest_incomplete(briefing: Briefing, belief: Belief, cell: int, moves: Moves) -> int:
    """The nearest other cell that is not complete, the first of those that tie; -1: there is none.

    Counted in moves.
    """
    measure(briefing, cell, moves)
    nearest = -1
    least = 0
    for other in range(len(belief.complete)):
        if belief.complete[other] == 1 or other == cell:
            continue
        n_moves = n_moves_to(briefing, cell, other, moves)
        if n_moves != NO_WAY and (nearest < 0 or n_moves < least):
            nearest = other
            least = n_moves
    return nearest


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

    def __init__(
        self,
        briefing: Briefing,
        uav: int,
        policy: Policy,
        allocator: Allocator,
        *,
        guard_after: int = NONE,
    ) -> None:
        """Get ready for a first mission; the UAV is given by its index.

        Args:
            guard_after: decisions without news after which the guard decides; 0 or NONE: never.
        """
        self.policy = policy
        self.belief = belief_of(new_beliefs(briefing, 1), 0)
        self._briefing = briefing
        self._uav = uav
        self._allocator = allocator
        self._workspace = new_workspace(_ROOM)
        self._guard_after = guard_after
        self._watch = new_row(WATCH_SIZE, NONE)
        self._moves = new_moves(briefing)
        policy.begin(briefing, uav)

    @property
    def legal(self) -> Row[int]:
        """Which actions were legal at the latest decision, (N_ACTIONS,)."""
        return self._workspace.legal

    def begin(self) -> None:
        """Forget the last mission."""
        forget(self.belief, self._briefing)
        self._watch = new_row(WATCH_SIZE, NONE)
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
        chosen = self.policy.choose(self.belief, view, legal)
        action, reason = guarded(
            self._guard_after,
            self._briefing,
            self.belief,
            view,
            legal,
            chosen,
            self._watch,
            self._moves,
        )
        share_hz = self._workspace.share_hz
        served = range(view.n_sensors if action == HOVER else 0)
        return Decision(
            action=action,
            reason=reason,
            sensor=tuple(int(view.sensor[index]) for index in served),
            share_hz=tuple(float(share_hz[index]) for index in served),
        )

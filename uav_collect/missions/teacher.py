"""A teacher: a learned policy that says, at every decision of missions, what it would do.

It sees what the UAVs see, and remembers as if it had flown them, whoever does: so one that learns
from it meets the situations that its own flying leads to, not the teacher's alone.

Source: Ross, Gordon and Bagnell, A reduction of imitation learning and structured prediction to
no-regret online learning, 2011; Rusu et al., Policy distillation, 2016.
"""

import numpy as np
from uav_collect.kernels.arrays import Bools, Floats, Ints, new_table, Row
from uav_collect.kernels.compile import long_kernel
from uav_collect.missions.batch_kernels import Batch
from uav_collect.uav.action_codes import N_ACTIONS, NONE
from uav_collect.uav.belief import belief_of
from uav_collect.uav.observation import encode, frames
from uav_collect.uav.policy_network import FrozenPolicy
from uav_collect.world.dynamics import look, mission_of


class Teacher:
    """What a frozen policy would do in missions that wait for decisions."""

    def __init__(self, policy: FrozenPolicy, batch: Batch) -> None:
        """Get ready to be asked.

        Args:
            policy: one that fits the missions' briefing, of a layout without users' code.
        """
        self._policy = policy
        n_worlds, n_uavs = len(batch.n_events), batch.briefing.n_uavs
        size = policy.header.observation_size
        self._layout = int(policy.header.layout.base)
        self._frames = frames(policy.header.layout, batch.briefing)
        self._observation: Row[Row[float]] = new_table(n_worlds, size, 0.0)
        # As it remembers after each UAV's latest decision, by mission, then UAV.
        self._hidden = policy.new_hidden(n_worlds * n_uavs)
        self._asked: tuple[Ints, Floats] | None = None

    def actions(self, batch: Batch) -> Ints:
        """What it would do in each mission, by the compass; NONE where one is over. Shape (W,)."""
        return self._answers(batch)[0]

    def forget(self) -> None:
        """Note that a mission has taken off anew."""
        self._asked = None

    def record(self, batch: Batch, is_answered: Bools) -> None:
        """Record what it would do at the decisions that are being answered, and remember them.

        Args:
            is_answered: shape (W,).
        """
        actions, hidden = self._answers(batch)
        waiting, n_rows, n_uavs = batch.waiting, batch.settings.n_rows, batch.briefing.n_uavs
        for world in np.flatnonzero(is_answered & (actions != NONE)).tolist():
            self._hidden[world * n_uavs + int(waiting.uav[world])] = hidden[world]
            if waiting.n_records[world] > 0:
                row = world * n_rows + int(waiting.n_records[world]) - 1
                batch.records.branched[row] = 1
                batch.records.worth[row] = np.arange(N_ACTIONS) == actions[world]
        self._asked = None

    def _answers(self, batch: Batch) -> tuple[Ints, Floats]:
        """Its actions, and what it then remembers of the UAVs that decide: (W,), (W, H)."""
        if self._asked is not None:
            return self._asked
        waiting = batch.waiting
        uav = np.asarray(waiting.uav, dtype=np.int64)
        awaited = np.flatnonzero(uav != NONE)
        actions = np.full(len(uav), NONE)
        hidden = np.zeros((len(uav), self._hidden.shape[1]))
        if len(awaited):
            _observe_all(self._layout, batch, self._observation)
            before = self._hidden[awaited * batch.briefing.n_uavs + uav[awaited]]
            decided = np.array(
                [batch.missions.n_decisions[world][uav[world]] for world in awaited.tolist()]
            )
            before = np.where(decided[:, None] == 0, 0.0, before)  # a mission has begun
            values, hidden[awaited] = self._policy.step(
                np.asarray(self._observation)[awaited], before
            )
            legal = np.asarray(waiting.legal)[awaited] == 1
            advice = np.asarray(waiting.advice)[awaited]
            frame = self._frames[uav[awaited]]
            actions[awaited] = self._policy.actions(values, legal, frame, advice)
        self._asked = actions, hidden
        return self._asked


@long_kernel
def _observe_all(layout: int, batch: Batch, out: Row[Row[float]]) -> None:
    """Write what the UAVs that missions wait for observe in a layout, shape (W, ...)."""
    for world in range(len(out)):
        uav = batch.waiting.uav[world]
        if uav == NONE:
            continue
        mission = mission_of(batch.missions, world)
        # Another look shows the same channels as the one before.
        view = look(batch.briefing, batch.sensor_field, mission, uav, batch.view_rows)
        belief = belief_of(batch.beliefs, world * batch.briefing.n_uavs + uav)
        advice = batch.waiting.advice[world]
        encode(layout, batch.briefing, batch.shares, uav, belief, view, advice, out[world])

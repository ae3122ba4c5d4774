"""A teacher: a policy that says, at every decision of missions, what it would do.

It sees what the UAVs see, and remembers as if it had flown them, whoever does: so one that learns
from it meets the situations that its own flying leads to, not the teacher's alone.

Source: Ross, Gordon and Bagnell, A reduction of imitation learning and structured prediction to
no-regret online learning, 2011; Rusu et al., Policy distillation, 2016.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from uav_collect.kernels.arrays import Bools, Floats, Ints, new_table, Row
from uav_collect.kernels.compile import long_kernel
from uav_collect.missions.batch_kernels import Batch
from uav_collect.uav.action_codes import HOME, N_ACTIONS, NONE
from uav_collect.uav.belief import belief_of
from uav_collect.uav.observation import encode, frames
from uav_collect.uav.policy import NamedPolicy, rule_of
from uav_collect.uav.policy_network import FrozenPolicy, LearnedPolicy
from uav_collect.world.dynamics import GONE, look, mission_of, SILENT


class Teacher:
    """What a policy would do in missions that wait for decisions; it is asked once of each."""

    def __init__(self, policy: NamedPolicy, batch: Batch) -> None:
        """Get ready to be asked.

        Args:
            policy: one that fits the missions' briefing; a learned one of a layout without users'
                code.
        """
        n_worlds = len(batch.n_events)
        self._pilots: _Network | _Copies = (
            _Network(policy.frozen.over(batch.briefing), batch)
            if isinstance(policy, LearnedPolicy) and rule_of(policy, batch.briefing) is None
            else _Copies(policy, batch)
        )
        self._actions = np.full(n_worlds, NONE)
        self._is_asked = np.zeros(n_worlds, dtype=bool)

    def actions(self, batch: Batch) -> Ints:
        """What it would do in each mission, by the compass; NONE where one is over. Shape (W,).

        It is what the adviser would do where the teacher would fly home and the adviser would not,
        and once a UAV is lost or silent: teachers count on all of them.
        """
        awaited = np.asarray(batch.waiting.uav) != NONE
        worlds = np.flatnonzero(awaited & ~self._is_asked)
        if len(worlds):
            said = self._pilots.actions(batch, worlds.tolist())
            advice = np.asarray(batch.waiting.advice)[worlds]
            is_advised = (said == HOME) | _misses_a_uav(batch, worlds)
            self._actions[worlds] = np.where(is_advised, advice, said)
            self._is_asked[worlds] = True
        return np.where(awaited, self._actions, NONE)

    def forget(self, worlds: Sequence[int]) -> None:
        """Note that missions have taken off anew."""
        self._is_asked[worlds] = False

    def record(self, batch: Batch, is_answered: Bools) -> None:
        """Record what it would do at the decisions that are being answered.

        Args:
            is_answered: shape (W,).
        """
        actions, waiting, n_rows = self.actions(batch), batch.waiting, batch.settings.n_rows
        for world in np.flatnonzero(is_answered & (actions != NONE)).tolist():
            if waiting.n_records[world] > 0:
                row = world * n_rows + int(waiting.n_records[world]) - 1
                batch.records.is_judged[row] = 1
                batch.records.worth[row] = np.arange(N_ACTIONS) == actions[world]
        self._is_asked &= ~is_answered


class _Network:
    """A network that decides in all missions at once."""

    def __init__(self, policy: FrozenPolicy, batch: Batch) -> None:
        self._policy = policy
        n_worlds, n_uavs = len(batch.n_events), batch.briefing.n_uavs
        size = policy.header.observation_size
        self._layout = int(policy.header.layout.base)
        self._frames = frames(policy.header.layout, batch.briefing)
        self._observation: Row[Row[float]] = new_table(n_worlds, size, 0.0)
        # As it remembers after each UAV's latest decision, by mission, then UAV.
        self._hidden: Floats = policy.new_hidden(n_worlds * n_uavs)

    def actions(self, batch: Batch, worlds: Sequence[int]) -> Ints:
        """What it does in missions that wait, shape (len(worlds),)."""
        waiting = batch.waiting
        _observe_all(self._layout, batch, self._observation)
        uav = np.asarray(waiting.uav, dtype=np.int64)[worlds]
        rows = np.asarray(worlds) * batch.briefing.n_uavs + uav
        is_first = [_is_first(batch, world) for world in worlds]
        before = np.where(np.array(is_first)[:, None], 0.0, self._hidden[rows])
        seen = np.asarray(self._observation)[worlds]
        values, self._hidden[rows] = self._policy.step(seen, before)
        legal, advice = np.asarray(waiting.legal)[worlds] == 1, np.asarray(waiting.advice)[worlds]
        return self._policy.actions(values, legal, self._frames[uav], advice)


class _Copies:
    """A policy of its own for each UAV of each mission."""

    def __init__(self, policy: NamedPolicy, batch: Batch) -> None:
        n_places = len(batch.n_events) * batch.briefing.n_uavs  # by mission, then UAV
        self._policies = [replace(policy) for _ in range(n_places)]

    def actions(self, batch: Batch, worlds: Sequence[int]) -> Ints:
        """What it does in missions that wait, HOME included, shape (len(worlds),)."""
        briefing, chosen = batch.briefing, []
        for world in worlds:
            uav = int(batch.waiting.uav[world])
            place = world * briefing.n_uavs + uav
            policy = self._policies[place]
            if _is_first(batch, world):
                policy.begin(briefing, uav)
            mission = mission_of(batch.missions, world)
            view = look(briefing, batch.sensor_field, mission, uav, batch.view_rows)
            belief = belief_of(batch.beliefs, place)
            chosen.append(policy.choose(belief, view, batch.waiting.legal[world]))
        return np.array(chosen)


def _misses_a_uav(batch: Batch, worlds: Ints) -> Bools:
    """Whether a UAV of a mission has been lost or fallen silent, shape (len(worlds),)."""
    n_uavs = batch.briefing.n_uavs
    since_s = np.asarray(batch.missions.fault_s)[worlds]  # (len(worlds), K * U)
    rows = [kind * n_uavs + uav for kind in (GONE, SILENT) for uav in range(n_uavs)]
    is_missed: Bools = (
        since_s[:, rows].min(axis=1) <= np.asarray(batch.missions.clock_s)[worlds, 0]
    )
    return is_missed


def _is_first(batch: Batch, world: int) -> bool:
    """Whether the UAV that a mission waits for has not decided before."""
    return int(batch.missions.n_decisions[world][batch.waiting.uav[world]]) == 0


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

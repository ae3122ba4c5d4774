"""Branches: what each action of a decision would have been worth, had a rule flown all the rest.

A learner that trains in its own worlds can do what no UAV in flight can: fly the same mission on,
once by each legal action, and look which end is best. All branches of a decision share the
mission's demand and channels, so that they differ by little else than the action. Their mean over
decisions that look alike to a UAV is what a step of policy improvement needs.

Source: Tesauro and Galperin, On-line policy improvement using Monte-Carlo search, 1996.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from uav_collect.kernels.arrays import Bools, Floats, new_row
from uav_collect.kernels.handle import Handle
from uav_collect.kernels.keyed_random import BRANCH, draw_uniform
from uav_collect.missions.batch_kernels import Batch, fly_batch
from uav_collect.missions.batch_start import new_batch
from uav_collect.scenario.site import Site
from uav_collect.uav.action_codes import N_ACTIONS, NONE

_WORTH_OF_CELL = 2.0  # to complete a cell, in what the energy unit counts


class Branches:
    """Flies missions on from where others are."""

    def __init__(self, site: Site, batch: Batch, energy_unit_j: float) -> None:
        """Make room for those of one decision.

        Args:
            batch: of missions of the same site, to be flown on by their adviser.
            energy_unit_j: energy that counts as one [J].
        """
        settings = batch.settings._replace(
            rule=batch.settings.adviser,
            layout=NONE,
            adviser=NONE,
            reward=NONE,
            is_logged=0,
            n_rows=0,
        )
        self._branches = Handle(new_batch(site, [0] * N_ACTIONS, settings))
        self._energy_unit_j = energy_unit_j

    def record(self, batch: Batch, is_answered: Bools, decision_share: float) -> None:
        """Record what each action is worth at a share of the decisions that are being answered.

        Which ones those are is keyed as exploration is: who flies a mission again branches alike.

        Args:
            is_answered: shape (W,).
        """
        waiting, n_rows = batch.waiting, batch.settings.n_rows
        for world in np.flatnonzero(is_answered & (np.asarray(waiting.uav) != NONE)).tolist():
            uav, seed = int(waiting.uav[world]), int(batch.missions.seed[world][0])
            decision = int(batch.missions.n_decisions[world][uav])
            if draw_uniform(seed, BRANCH, uav, decision, 0) < decision_share:
                row = world * n_rows + int(waiting.n_records[world]) - 1
                batch.records.is_judged[row] = 1
                batch.records.worth[row] = np.nan_to_num(self.worth(batch, world))

    def worth(self, batch: Batch, world: int) -> Floats:
        """What a mission would be worth by each action of the UAV that it waits for.

        Returns:
            Cells that are complete in the end, each counted twice, less the energy of all UAVs in
            the unit; nan where an action is not legal. Shape (N_ACTIONS,).
        """
        branches = self._branches.rows
        legal = [each for each in range(N_ACTIONS) if batch.waiting.legal[world][each] == 1]
        answers = new_row(N_ACTIONS, NONE)
        for slot in range(N_ACTIONS):
            branches.waiting.uav[slot] = NONE
        for action in legal:
            self._copy(batch, world, action)
            answers[action] = action
        fly_batch(self._branches, answers)
        n_uavs = batch.briefing.n_uavs
        worth = np.full(N_ACTIONS, np.nan)
        for action in legal:
            first = action * n_uavs
            maps = [np.asarray(branches.beliefs.complete[first + uav]) for uav in range(n_uavs)]
            n_complete = int(np.count_nonzero(np.any(maps, axis=0)))
            spent_j = sum(batch.briefing.energy_budget_j)
            spent_j -= sum(branches.missions.energy_left_j[action])
            worth[action] = _WORTH_OF_CELL * n_complete - spent_j / self._energy_unit_j
        return worth

    def _copy(self, batch: Batch, world: int, slot: int) -> None:
        """Put a mission into a place, as it is."""
        branches, n_uavs = self._branches.rows, batch.briefing.n_uavs
        _copy_rows(branches.missions, batch.missions, slot, world)
        if batch.link.is_ideal == 0:
            _copy_rows(branches.airwaves, batch.airwaves, slot, world)
        for uav in range(n_uavs):
            to, of = slot * n_uavs + uav, world * n_uavs + uav
            _copy_rows(branches.beliefs, batch.beliefs, to, of)
            _copy_rows((branches.memory, branches.watch), (batch.memory, batch.watch), to, of)
        branches.n_events[slot] = batch.n_events[world]
        branches.waiting.uav[slot] = batch.waiting.uav[world]
        branches.waiting.heard[slot] = batch.waiting.heard[world]
        _copy_rows((branches.waiting.legal,), (batch.waiting.legal,), slot, world)


def _copy_rows(targets: Sequence[Any], sources: Sequence[Any], to: int, of: int) -> None:
    """Copy a row of each of some tables, whether they are arrays or lists."""
    for target, source in zip(targets, sources, strict=True):
        target[to][:] = source[of]

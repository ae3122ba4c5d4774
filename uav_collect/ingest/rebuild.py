"""Makes the records of a mission out of its reports: the very bytes a rollout would have kept.

Rewards are summed up by the kernels of the rollout, over the legs as they are reported.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from uav_collect.errors import ConfigError, RefusedError
from uav_collect.ingest.reports import (
    EventReport,
    FLOAT32,
    FLOAT64,
    MissionReport,
    TransitionReport,
)
from uav_collect.kernels.arrays import Floats, Ints, Row
from uav_collect.kernels.compile import kernel
from uav_collect.missions.experience import (
    Episode,
    N_UAV_SCALARS,
    new_records,
    observations,
    Records,
)
from uav_collect.missions.own_reward import OwnReward, rewarded
from uav_collect.scenario.site import Site
from uav_collect.uav.action_codes import HOME, NONE
from uav_collect.uav.briefing import Briefing, briefing_of
from uav_collect.uav.observation import AnyLayout, observation_size
from uav_collect.world.dynamics import (
    ACTIVE,
    end_s,
    Mission,
    mission_of,
    start_leg,
)
from uav_collect.world.mission_start import new_missions, restart_mission
from uav_collect.world.reward import (
    earn,
    earn_interval,
    Earnings,
    energy_reward,
    KILOJOULE_J,
    new_earnings,
    news_reward,
    Reward,
    reward_terms,
    RewardTerms,
    start_earning,
)
from uav_collect.world.sensor_field import demand_by_cell, lay_out

_ENERGY = int(Reward.ENERGY)


@dataclass(frozen=True, kw_only=True)
class MissionParts:
    """All reports of a mission that can be learned from."""

    mission: MissionReport
    events: Sequence[EventReport]  # from the first on, without a gap
    transitions: Mapping[int, TransitionReport]  # of all decisions among them, by event
    is_whole: bool  # False: cut off, the outcome of the last decision does not count


class _Events(NamedTuple):
    """Columns of K events that rewards are summed up from."""

    uav: Ints
    action: Ints
    time_s: Floats
    duration_s: Floats
    x_m: Floats
    y_m: Floats
    energy_j: Floats
    reward: Floats  # the scenario's, of the interval after each event
    known: NDArray[np.uint8]  # (K, C) the deciding UAV's map


class EpisodeBuilder:
    """Turns the reports of missions of one scenario into episodes."""

    def __init__(
        self,
        site: Site,
        layout: AnyLayout,
        reward: Reward,
        discount_per_s: float,
        energy_unit_j: float = KILOJOULE_J,
        own_reward: OwnReward | None = None,
    ) -> None:
        """Lay the site out once for all its missions.

        Args:
            layout: of the observations that the learner takes.
            reward: to be learned.
            discount_per_s: of the training.
            energy_unit_j: energy that takes one from the energy reward [J].
            own_reward: a user's, in place of `reward`, which is ENERGY then.

        Raises:
            ConfigError: the scenario's own reward is to be learned, but under another discount
                than that by which the world sums it up.
        """
        scenario = site.scenario
        if reward is Reward.PAPER and scenario.reward.discount_per_s != discount_per_s:
            raise ConfigError(
                f'reward.discount_per_s is {discount_per_s:g}: must be '
                f'{scenario.reward.discount_per_s:g}, by which the world counts the rewards of '
                f'scenario {scenario.name}'
            )
        self._layout, self._reward, self._own_reward = layout, reward, own_reward
        self._first_sensor = site.first_sensor.tolist()
        self._briefing = briefing_of(site)
        self._sensor_field = lay_out(site)
        self._terms = reward_terms(site.with_discount(discount_per_s), energy_unit_j)
        self._mission = mission_of(new_missions(self._briefing, self._sensor_field, [0]), 0)
        self._earnings = new_earnings(1)
        self._union: Any = np.zeros(scenario.n_cells, dtype=np.uint8)

    def warm_up(self) -> None:
        """Let kernels be compiled, which takes minutes once."""
        n_cells = len(self._briefing.is_open)
        size = observation_size(self._layout, n_cells, self._briefing.n_uavs)
        records = new_records(0, self._briefing)
        none = np.zeros(0, dtype=np.int64)
        nothing = np.zeros((0, size), dtype=np.float32)
        demand_bit = np.zeros((1, n_cells))
        observations(self._layout, self._briefing, records, demand_bit, none, none, nothing)
        never, known = np.zeros(0), np.zeros((0, n_cells), dtype=np.uint8)
        events = _Events(none, none, never, never, never, never, never, never, known)
        self._write_rewards(events, records, is_whole=False)

    def episode(self, parts: MissionParts) -> Episode:
        """The mission as the learner keeps it.

        Raises:
            RefusedError: an event comes before its predecessor, event and transition contradict
                each other, or a UAV has not seen what it says that it has.
        """
        demand_bit = demand_by_cell(
            self._first_sensor, np.frombuffer(parts.mission.demand_bit, FLOAT64).tolist()
        )
        events = parts.events
        decided = [event for event in events if event.is_decision]
        decisions = [parts.transitions[event.event] for event in decided]
        if not decided:
            raise RefusedError(f'{parts.mission.where}: no UAV has decided anything')
        _check_order(events)
        _check_agreement(decided, decisions, self._briefing.n_uavs)
        records = new_records(len(decided), self._briefing)
        _write_decisions(records, decisions)
        _write_world(records, self._briefing, events, demand_bit)
        self._check_observations(records, decisions, demand_bit)
        events_flown = _columns(events, self._briefing.n_uavs, len(self._union))
        self._write_rewards(events_flown, records, is_whole=parts.is_whole)
        if not parts.is_whole:
            records.action[-1] = NONE
        episode = Episode(
            mission_seed=parts.mission.mission_seed,
            demand_bit=demand_bit,
            records=records,
            is_whole=parts.is_whole,
        )
        if self._own_reward is None:
            return episode
        left_j = np.frombuffer(events[-1].uav_energy_left_j, FLOAT64).tolist()
        n_complete = int(self._union.sum())
        return rewarded(self._own_reward, episode, self._briefing, left_j, n_complete)

    def efficiency_kbit_per_j(self, parts: MissionParts) -> float:
        """Data that the mission has collected over the energy it has spent."""
        left_j = np.frombuffer(parts.events[-1].uav_energy_left_j, FLOAT64)
        spent_j = sum(self._briefing.energy_budget_j) - sum(left_j.tolist())
        collected_bit = sum(event.collected_bit for event in parts.events)
        return collected_bit / spent_j / 1e3 if spent_j > 0.0 else 0.0

    def _write_rewards(self, events: _Events, records: Records, *, is_whole: bool) -> None:
        """Write what each decision earned until the next one, and how long that took."""
        self._union[:] = self._briefing.known_complete
        restart_mission(self._briefing, self._sensor_field, self._mission)
        _sum_rewards(
            int(self._reward),
            self._briefing,
            self._terms,
            self._mission,
            events,
            is_whole,
            self._union,
            self._earnings,
            records.reward,
            records.duration_s,
        )

    def _check_observations(
        self, records: Records, decisions: Sequence[TransitionReport], demand_bit: Floats
    ) -> None:
        """Refuse an observation that was encoded from something else than what is reported."""
        sent = _stacked((it.observation for it in decisions), FLOAT32, len(decisions))
        rebuilt = np.empty(sent.shape, dtype=np.float32)
        rows = np.arange(len(decisions))
        observations(
            self._layout,
            self._briefing,
            records,
            demand_bit[None],
            np.zeros_like(rows),
            rows,
            rebuilt,
        )
        wrong = np.argwhere(sent != rebuilt)
        if len(wrong):
            row, place = wrong[0].tolist()
            raise RefusedError(
                f'{decisions[row].where}: observation[{place}] is {sent[row, place]:g}: '
                f'what it was encoded from gives {rebuilt[row, place]:g}'
            )


def _check_order(events: Sequence[EventReport]) -> None:
    """Refuse events that do not follow each other in time."""
    for before, event in pairwise(events):
        if event.time_s < before.time_s:
            raise RefusedError(
                f'{event.where}: time_s is {event.time_s}: must be at least {before.time_s}'
            )


def _check_agreement(
    events: Sequence[EventReport], decisions: Sequence[TransitionReport], n_uavs: int
) -> None:
    """Refuse a decision that UAV and world report differently."""
    n_decided = [0] * n_uavs
    for event, decision in zip(events, decisions, strict=True):
        n_bytes = len(decision.complete)
        known = event.uav_complete[event.uav * n_bytes : (event.uav + 1) * n_bytes]
        for name, value, wanted in (
            ('uav', decision.uav, event.uav),
            ('decision', decision.decision, event.decision),
            ('decision', decision.decision, n_decided[event.uav]),
            ('time_s', decision.time_s, event.time_s),
            ('energy_left_j', decision.energy_left_j, event.energy_left_j),
            ('action', decision.action, event.action),
            ('complete', decision.complete.hex(), known.hex()),
        ):
            if value != wanted:
                raise RefusedError(f'{decision.where}: {name} is {value}: the world has {wanted}')
        n_decided[event.uav] += 1


def _write_decisions(records: Records, decisions: Sequence[TransitionReport]) -> None:
    """Write what each UAV reports of itself."""
    for name in (
        'uav', 'decision', 'time_s', 'energy_left_j', 'cell', 'previous_action', 'legal', 'action'
    ):  # fmt: skip
        getattr(records, name)[:] = [getattr(it, name) for it in decisions]
    for name in ('peer_x_m', 'peer_y_m', 'peer_s', 'seen'):
        kind = np.uint8 if name == 'seen' else FLOAT64
        column = _stacked((getattr(it, name) for it in decisions), kind, len(decisions))
        getattr(records, name)[:] = column


def _write_world(
    records: Records, briefing: Briefing, events: Sequence[EventReport], demand_bit: Floats
) -> None:
    """Write what only the world knows: all maps, and the fleet before the UAV's action."""
    n_events = len(events)
    at = np.flatnonzero([event.is_decision for event in events])
    complete = _stacked((it.uav_complete for it in events), np.uint8, n_events)
    records.complete[:] = complete[at]
    # Events report what is true after an action; before it holds what was true after the last.
    first = np.packbits(demand_bit <= 0.0, bitorder='little')
    after = _stacked((it.true_complete for it in events), np.uint8, n_events)
    records.true_complete[:] = np.concatenate([first[None], after[:-1]])[at]
    sizes_m = (briefing.n_columns * briefing.cell_size_m, briefing.n_rows * briefing.cell_size_m)
    uav = np.array([event.uav for event in events])
    for place, (name, size_m) in enumerate(zip(('uav_x_m', 'uav_y_m'), sizes_m, strict=True)):
        fleet_m = _stacked((getattr(it, name) for it in events), FLOAT64, n_events)
        records.fleet[:, place::N_UAV_SCALARS] = fleet_m[at] / size_m
    left_j = _stacked((it.uav_energy_left_j for it in events), FLOAT64, n_events)
    left_j[np.arange(n_events), uav] = [event.energy_left_j for event in events]
    records.fleet[:, 2::N_UAV_SCALARS] = left_j[at] / np.asarray(briefing.energy_budget_j)
    phase = _stacked((it.uav_phase for it in events), np.uint8, n_events)
    records.fleet[:, 3::N_UAV_SCALARS] = phase[at] == ACTIVE


def _stacked(contents: Any, kind: Any, n_rows: int) -> NDArray[Any]:
    """Arrays of messages as the rows of one table."""
    return np.frombuffer(b''.join(contents), kind).reshape(n_rows, -1).copy()


def _columns(events: Sequence[EventReport], n_uavs: int, n_cells: int) -> _Events:
    """The events as the columns that rewards are summed up from."""
    uav = np.array([event.uav for event in events])
    complete = _stacked((it.uav_complete for it in events), np.uint8, len(events))
    own = complete.reshape(len(events), n_uavs, -1)[np.arange(len(events)), uav]
    floats = {
        name: np.array([getattr(event, name) for event in events], dtype=np.float64)
        for name in ('time_s', 'duration_s', 'x_m', 'y_m', 'energy_j', 'reward')
    }
    return _Events(
        uav=uav,
        action=np.array([event.action for event in events]),
        known=np.unpackbits(own, axis=1, count=n_cells, bitorder='little'),
        **floats,
    )


@kernel
def _sum_rewards(
    goal: int,
    briefing: Briefing,
    terms: RewardTerms,
    mission: Mission,
    events: _Events,
    is_whole: bool,
    union: Row[int],
    earnings: Earnings,
    reward_out: Row[float],
    duration_out: Row[float],
) -> None:
    """Sum up what each decision brought until the next one, as `batch_kernels.fly_on` does.

    Args:
        mission: at its start; its legs are flown.
        earnings: scratch, of one mission.
        union: of the maps before the first event, (C,); written.
        reward_out: written, one for each decision; where a mission is cut off, not for the last.
        duration_out: the same.
    """
    start_earning(earnings, 0, 0.0)
    n_events = len(events.uav)
    row = -1
    for event in range(n_events + 1):
        if event == n_events and not is_whole:
            break
        start_s = earnings.until_s[0]
        stop_s = events.time_s[event] if event < n_events else end_s(mission)
        reward = events.reward[event - 1] if event > 0 else 0.0
        if goal == _ENERGY:
            reward = energy_reward(briefing, terms, mission, start_s, stop_s)
        earn_interval(earnings, 0, terms, reward, stop_s)
        if event < n_events and goal == _ENERGY:
            earn(earnings, 0, terms, news_reward(events.known[event], union))
        if event == n_events or events.action[event] != HOME:
            if row >= 0:
                reward_out[row] = earnings.reward[0]
                duration_out[row] = stop_s - earnings.since_s[0]
            row += 1
            start_earning(earnings, 0, stop_s)
        if event < n_events:
            start_leg(
                mission,
                events.uav[event],
                events.action[event],
                events.x_m[event],
                events.y_m[event],
                events.duration_s[event],
                events.energy_j[event],
            )

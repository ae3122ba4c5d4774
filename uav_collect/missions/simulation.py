"""One mission, event by event: what the world node and the stepwise rollout drive.

It holds the world, the UAVs' radios and the log. A UAV's radio keeps the completion map that its
UAV sent last, merges what it hears, and answers with that.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import math

from uav_collect.kernels.arrays import Row
from uav_collect.kernels.rows import new_row, row_of
from uav_collect.missions.event_log import (
    grown_log,
    log_event,
    log_interval,
    logged_events,
    new_log,
    signed_bits,
)
from uav_collect.physics.bandwidth import hover_time_s
from uav_collect.recording.mission_log import Events, MissionHeader, MissionLog, UavHeader
from uav_collect.scenario.load import fingerprint, Scenario
from uav_collect.scenario.site import Site
from uav_collect.uav import actions
from uav_collect.uav.actions import BY_POLICY, check_can_start, HOME, HOVER, N_ACTIONS
from uav_collect.uav.belief import Belief, belief_of, merge, new_beliefs
from uav_collect.uav.briefing import brief
from uav_collect.uav.messages import Decision, RadioMessage
from uav_collect.uav.view import LocalView, new_view_rows
from uav_collect.world.dynamics import (
    end_s,
    has_landed,
    in_contact,
    look,
    next_uav,
    start_action,
    x_m_at,
    y_m_at,
)
from uav_collect.world.sensor_field import lay_out, most_sensors
from uav_collect.world.state import mission_of, new_missions

KERNELS = (look, start_action)  # that Python calls once an event
_FIRST_CAPACITY = 512  # events that the log has room for before it must grow
_REASONS_TO_GO_HOME = (BY_POLICY, actions.MAP_COMPLETE, actions.ENERGY_RESERVE)
_BANDWIDTH_TOLERANCE = 1e-9  # relative; what a sum of shares may lose in rounding
_LEAST_SHARE = 1e-100  # of the bandwidth; its noise and rate are still normal numbers


@dataclass(frozen=True, kw_only=True)
class Event:
    """A UAV has finished its action and decides."""

    index: int  # running number over the fleet
    uav: int
    decision: int  # running number of the UAV's own decisions
    view: LocalView
    heard: tuple[RadioMessage, ...]  # of the UAVs in contact, by index


def mission_header(
    scenario: Scenario,
    mission_seed: int,
    demand_bit: Iterable[float],
    policies: Sequence[str],
    allocators: Sequence[str],
) -> MissionHeader:
    """The log header of a mission; policies and allocators by UAV."""
    uavs = tuple(
        UavHeader(
            id=index + 1,
            speed_mps=uav.speed_mps,
            energy_budget_j=uav.energy_budget_j,
            energy_margin_j=uav.energy_margin_j,
            policy=policies[index],
            allocator=allocators[index],
        )
        for index, uav in enumerate(scenario.uavs)
    )
    return MissionHeader(
        scenario=scenario.name,
        scenario_fingerprint=fingerprint(scenario),
        mission_seed=mission_seed,
        cells_per_side=scenario.area.cells_per_side,
        cell_size_m=scenario.area.cell_size_m,
        total_bit=math.fsum(demand_bit),
        uavs=uavs,
    )


class Simulation:
    """A mission in flight: ask for the event, transmit, start the action; until it is over."""

    def __init__(self, site: Site, mission_seed: int) -> None:
        """Put the mission to its start.

        Raises:
            ConfigError: no UAV has the energy to start.
        """
        self.briefing = brief(site.scenario)
        check_can_start(site.scenario, self.briefing)
        self._ground = lay_out(site)
        missions = new_missions(self.briefing, self._ground, [mission_seed])
        self._mission = mission_of(missions, 0)
        self._radios = new_beliefs(self.briefing, self.briefing.n_uavs)
        self._view_rows = new_view_rows(most_sensors(self._ground))
        self._log = new_log(1, _FIRST_CAPACITY)
        self._capacity = _FIRST_CAPACITY
        self.n_events = 0
        self.demand_bit = [float(bit) for bit in self._mission.demand_bit]

    def next_event(self) -> Event | None:
        """The next UAV to decide and what it sees and hears; None when all fly home."""
        uav = next_uav(self._mission)
        if uav < 0:
            return None
        time_s = self._mission.leg_end_s[uav]
        self._close_interval(time_s)
        view = look(self.briefing, self._ground, self._mission, uav, self._view_rows)
        return Event(
            index=self.n_events,
            uav=uav,
            decision=int(self._mission.n_decisions[uav]),  # compiled kernels' rows hold numpy's
            view=view,
            heard=tuple(self.radio(other) for other in self.contacts(uav, time_s)),
        )

    def contacts(self, uav: int, time_s: float) -> list[int]:
        """The UAVs in range of one, by index."""
        return [
            other
            for other in range(self.briefing.n_uavs)
            if in_contact(self.briefing, self._mission, uav, other, time_s)
        ]

    def radio(self, uav: int) -> RadioMessage:
        """What a UAV's radio answers now."""
        time_s = self.time_s
        return RadioMessage(
            sender=uav,
            complete=self._radios.complete[uav],
            x_m=x_m_at(self._mission, uav, time_s),
            y_m=y_m_at(self._mission, uav, time_s),
            time_s=time_s,
        )

    def transmit(self, uav: int, complete: Row[int]) -> list[int]:
        """The deciding UAV sends its map.

        Returns:
            The UAVs that hear it, by index.
        """
        merge(self._held(uav), complete)
        hearers = self.contacts(uav, self.time_s)
        for other in hearers:
            merge(self._held(other), self._radios.complete[uav])
        return hearers

    def refusal(self, event: Event, decision: Decision) -> str | None:
        """Why a decision cannot be carried out; None if it can."""
        action, view = decision.action, event.view
        if action not in range(HOME + 1):
            return f'action {action} is none of 0..{HOME}'
        if decision.reason not in (_REASONS_TO_GO_HOME if action == HOME else (BY_POLICY,)):
            return f'reason {decision.reason} is none for action {action}'
        if action == HOME:
            return None
        if action == HOVER:
            return self._hover_refusal(event.uav, view, decision)
        legal = new_row(N_ACTIONS, 0)
        actions.mark_legal(
            self.briefing,
            event.uav,
            view.x_m,
            view.y_m,
            view.energy_left_j,
            view.previous_action,
            0.0,
            legal,
        )
        if legal[action] == 1:
            return None
        return (
            f'action {action} is illegal at ({view.x_m:g}, {view.y_m:g}) m after action '
            f'{view.previous_action} with {view.energy_left_j:.0f} J left'
        )

    def start(self, event: Event, decision: Decision) -> None:
        """Carry out a decision that is not refused, and log it."""
        if self.n_events == self._capacity:
            self._log = grown_log(self._log, 1)
            self._capacity *= 2
        collected_bit = start_action(
            self.briefing,
            self._mission,
            event.uav,
            event.view,
            decision.action,
            row_of(decision.share_hz or (0.0,)),
        )
        log_event(
            self._log,
            0,
            self.n_events,
            self._mission,
            self._radios.n_complete[event.uav][0],
            event.uav,
            event.view,
            decision.reason,
            collected_bit,
            signed_bits(message.sender for message in event.heard),
        )
        self.n_events += 1
        if next_uav(self._mission) < 0:
            self._close_interval(end_s(self._mission))

    @property
    def time_s(self) -> float:
        """Time of the latest event."""
        return self._mission.clock_s[0]

    @property
    def is_over(self) -> bool:
        """Whether every UAV flies home or has landed."""
        return next_uav(self._mission) < 0

    @property
    def end_s(self) -> float:
        """When the last running action ends."""
        return end_s(self._mission)

    def events(self) -> Events:
        """The events so far; the last one's interval is open until the next event."""
        return logged_events(self._log, 0, self.n_events)

    def last_event(self) -> Events:
        """The latest event alone, (1,); its interval is open until the next event."""
        return logged_events(self._log, 0, self.n_events, self.n_events - 1)

    def log(self, header: MissionHeader) -> MissionLog:
        """The log of the mission so far under a header."""
        return MissionLog(header=header, events=self.events())

    def position_m(self, uav: int, time_s: float) -> tuple[float, float]:
        """Where a UAV is at a time of its running action."""
        return x_m_at(self._mission, uav, time_s), y_m_at(self._mission, uav, time_s)

    def energy_left_j(self, uav: int) -> float:
        """What a UAV has left when its running action ends."""
        return float(self._mission.energy_left_j[uav])

    def phase(self, uav: int, time_s: float) -> int:
        """0 active, 1 flying home, 2 landed."""
        return 2 if has_landed(self._mission, uav, time_s) else self._mission.phase[uav]

    def known_complete(self, uav: int) -> Row[int]:
        """The completion map that a UAV's radio keeps, (C,)."""
        return self._radios.complete[uav]

    def waiting_bit(self) -> list[float]:
        """Data not yet claimed, by cell."""
        return [float(bit) for bit in self._mission.cell_bit]

    def _held(self, uav: int) -> Belief:
        return belief_of(self._radios, uav)

    def _close_interval(self, stop_s: float) -> None:
        if self.n_events > 0:
            log_interval(
                self._log,
                0,
                self.n_events - 1,
                self.briefing,
                self._ground,
                self._mission,
                stop_s,
            )

    def _hover_refusal(self, uav: int, view: LocalView, decision: Decision) -> str | None:
        share_hz = decision.share_hz
        if view.n_sensors == 0:
            return 'a hover, but no data waits in the cell'
        waiting = tuple(int(view.sensor[index]) for index in range(view.n_sensors))
        if decision.sensor != waiting:
            return f'bandwidth for the sensors {decision.sensor}, but data waits at {waiting}'
        if len(share_hz) != view.n_sensors:
            return f'{len(share_hz)} bandwidth shares for {view.n_sensors} sensors'
        for share in share_hz:
            if not (math.isfinite(share) and share > 0.0):
                return f'a bandwidth share of {share} Hz: each must be above 0 and finite'
        # Not fsum: it raises where a sum overflows.
        total_hz, limit_hz = sum(share_hz), self.briefing.bandwidth_hz
        if total_hz > limit_hz * (1.0 + _BANDWIDTH_TOLERANCE):
            return f'bandwidth shares sum to {total_hz:.6g} Hz of {limit_hz:.6g} Hz'
        hover_s = math.inf
        if min(share_hz) >= limit_hz * _LEAST_SHARE:
            hover_s = self._hover_s(view, share_hz)
        if not actions.may_hover(
            self.briefing, uav, view.x_m, view.y_m, view.energy_left_j, hover_s
        ):
            return f'a hover of {hover_s:.3g} s would leave too little energy for the way home'
        return None

    def _hover_s(self, view: LocalView, share_hz: tuple[float, ...]) -> float:
        power_w = self.briefing.tx_power_w
        seen = range(view.n_sensors)
        return hover_time_s(
            row_of([power_w * view.sensor_gain[index] for index in seen]),
            row_of([power_w * view.sensor_error_gain[index] for index in seen]),
            view.sensor_bit,
            row_of(share_hz),
            view.n_sensors,
            self.briefing.noise_w_per_hz,
        )

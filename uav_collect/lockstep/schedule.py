"""Which mission comes next, and how fast simulated time may pass."""

from collections.abc import Callable
from dataclasses import dataclass
import math
import time

from uav_collect.limits import MAX_SEED

_LONGEST_LOOK_S = 0.25  # wall-clock time between two looks at the clock; longer is a stall
_MOST_MADE_UP_S = 0.05  # wall-clock time that a decision may take and be made up for
_CLOCK_PERIOD_S = 0.02  # at least, between two messages of the clock: 50 Hz


@dataclass
class MissionSchedule:
    """The missions of a world: so many in a row, or those that are asked for."""

    n_missions: int  # to fly in a row; -1: without end; 0: only on request, without end
    next_seed: int | None  # of the mission that starts once the fleet is complete
    n_started: int = 0
    last_seed: int | None = None  # of the mission that was started last
    is_closed: bool = False  # the world ends: nothing more is planned on request

    @property
    def is_over(self) -> bool:
        """Whether the last mission in a row has been started: of its number, or of all seeds."""
        is_last = self.n_started == self.n_missions or self.last_seed == MAX_SEED
        return self.n_missions != 0 and is_last

    def start_next(self) -> int:
        """Count the next mission as started; its seed."""
        seed, self.next_seed = self.next_seed, None
        if seed is None:
            raise RuntimeError('no mission is to start')
        self.n_started += 1
        self.last_seed = seed
        return seed

    def plan_after(self, seed: int) -> None:
        """Plan what follows the mission with a seed."""
        if self.n_missions != 0 and not self.is_over:
            self.next_seed = seed + 1

    def refusal(self, seed: int, *, is_flying: bool) -> str | None:
        """Why a mission cannot be planned on request; None if it can."""
        if self.is_closed:
            return 'the world is being stopped'
        if self.n_missions != 0:
            return 'this world flies its missions in a row: start it with missions:=0'
        if is_flying or self.next_seed is not None:
            return 'a mission is in flight or about to start: abort it first'
        if seed > MAX_SEED:
            return f'the seed must be at most {MAX_SEED}, got {seed}'
        return None

    def request(self, seed: int, *, is_flying: bool) -> tuple[bool, str]:
        """Plan a mission on request; whether that works, and what to say."""
        refusal = self.refusal(seed, is_flying=is_flying)
        if refusal is not None:
            return False, refusal
        self.next_seed = seed
        return True, 'a mission starts when the fleet is complete'

    def cancel(self, *, is_flying: bool) -> tuple[bool, str]:
        """Drop the mission that is about to start; whether one can be aborted, what to say.

        A row goes on: only the mission in flight can be aborted.
        """
        if is_flying:
            return True, 'the mission is aborted'
        if self.n_missions != 0:
            return False, 'no mission is in flight; the next one starts when the fleet is complete'
        if self.next_seed is not None:
            self.next_seed = None
            return True, 'the mission that was about to start is called off'
        return False, 'no mission is in flight or about to start'


class SimulationPacer:
    """Holds simulated time back to a multiple of wall-clock time.

    After a stall, of the world or of an agent that is waited for, time goes on from where it
    stood: it makes up for a moment at most, which is what decisions usually take.
    """

    def __init__(
        self, real_time_factor: float, clock_s: Callable[[], float] = time.monotonic
    ) -> None:
        """Let simulated time pass so many times as fast as the clock; 0: as fast as can be."""
        self._factor = real_time_factor
        self._clock_s = clock_s
        self._is_held = False
        self._looked_s = 0.0  # at the clock
        self._time_s = 0.0  # how far simulated time may have gone by then

    @property
    def is_unlimited(self) -> bool:
        """Whether simulated time need not wait for the clock."""
        return self._factor == 0.0

    def restart(self) -> None:
        """Count simulated time from 0 again, from now on."""
        self._looked_s = self._clock_s()
        self._time_s = 0.0

    def change(self, real_time_factor: float) -> None:
        """Let simulated time pass so many times as fast from now on; 0: as fast as can be."""
        self._looked_s = self._clock_s()
        self._factor = real_time_factor

    def hold(self, is_held: bool) -> None:
        """Let no simulated time pass, or let it pass again from now on."""
        self._looked_s = self._clock_s()
        self._is_held = is_held

    def skip_to(self, time_s: float) -> None:
        """Let the simulated time of an event have come."""
        self._time_s = max(self._time_s, time_s)

    def pass_until(self, event_s: float) -> float:
        """Let time pass to now, but hardly further than to the time of the next event.

        Returns:
            The simulated time now.
        """
        now_s = self._clock_s()
        passed_s = 0.0 if self._is_held else min(now_s - self._looked_s, _LONGEST_LOOK_S)
        self._looked_s = now_s
        most_s = event_s + _MOST_MADE_UP_S * self._factor
        self._time_s = min(self._time_s + passed_s * self._factor, max(most_s, self._time_s))
        return min(self._time_s, event_s)

    def is_due(self, time_s: float) -> bool:
        """Whether the simulated time of the next event has come."""
        if self.is_unlimited:
            self.skip_to(time_s)  # from here it goes on if a pace is set
        return self.is_unlimited or self.pass_until(time_s) >= time_s


class ClockRate:
    """When the clock is published: at most 50 times per second of simulated time.

    Nodes follow simulated time, so that is what counts, however fast it passes. From one event to
    the next, where nothing happens, it is at most 50 times per second of wall-clock time too.
    """

    def __init__(self, clock_s: Callable[[], float] = time.monotonic) -> None:
        """Nothing has been published yet."""
        self._clock_s = clock_s
        self._published_s = -math.inf  # simulated time
        self._published_at_s = -math.inf  # wall-clock time then

    def is_due(self, time_s: float, *, is_event: bool) -> bool:
        """Whether a simulated time is to be published; it counts as published then.

        Args:
            is_event: something happens at that time.
        """
        now_s = self._clock_s()
        is_early = not is_event and now_s - self._published_at_s < _CLOCK_PERIOD_S
        if is_early or time_s - self._published_s < _CLOCK_PERIOD_S:
            return False
        self._published_s, self._published_at_s = time_s, now_s
        return True

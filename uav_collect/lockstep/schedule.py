"""Which mission comes next, and how fast simulated time may pass."""

from collections.abc import Callable
from dataclasses import dataclass
import time

from uav_collect.limits import MAX_SEED


@dataclass
class MissionSchedule:
    """The missions of a world: so many in a row, or those that are asked for."""

    n_missions: int  # to fly in a row; -1: without end; 0: only on request, without end
    next_seed: int | None  # of the mission that starts once the fleet is complete
    n_started: int = 0

    @property
    def is_over(self) -> bool:
        """Whether the last mission in a row has been started."""
        return 0 < self.n_missions <= self.n_started

    def start_next(self) -> int:
        """Count the next mission as started; its seed."""
        seed, self.next_seed = self.next_seed, None
        if seed is None:
            raise RuntimeError('no mission is to start')
        self.n_started += 1
        return seed

    def plan_after(self, seed: int) -> None:
        """Plan what follows the mission with a seed."""
        if self.n_missions != 0 and not self.is_over:
            self.next_seed = seed + 1

    def request(self, seed: int, *, is_flying: bool) -> tuple[bool, str]:
        """Plan a mission on request; whether that works, and what to say."""
        if is_flying or self.next_seed is not None:
            return False, 'a mission is in flight or about to start: abort it first'
        if seed > MAX_SEED:
            return False, f'the seed must be at most {MAX_SEED}, got {seed}'
        self.next_seed = seed
        return True, 'a mission starts when the fleet is complete'

    def cancel(self, *, is_flying: bool) -> tuple[bool, str]:
        """Drop the mission that is about to start; whether one can be aborted, what to say."""
        is_planned, self.next_seed = self.next_seed is not None, None
        if is_flying:
            return True, 'the mission is aborted'
        if is_planned:
            return True, 'the mission that was about to start is called off'
        return False, 'no mission is in flight or about to start'


class SimulationPacer:
    """Holds simulated time back to a multiple of wall-clock time."""

    def __init__(
        self, real_time_factor: float, clock_s: Callable[[], float] = time.monotonic
    ) -> None:
        """Let simulated time pass so many times as fast as the clock; 0: as fast as can be."""
        self._factor = real_time_factor
        self._clock_s = clock_s
        self._started_s = 0.0

    @property
    def is_unlimited(self) -> bool:
        """Whether simulated time need not wait for the clock."""
        return self._factor == 0.0

    def restart(self) -> None:
        """Count simulated time from 0 again, from now on."""
        self._started_s = self._clock_s()

    @property
    def time_s(self) -> float:
        """How far simulated time may have gone by now."""
        return (self._clock_s() - self._started_s) * self._factor

    def is_due(self, time_s: float) -> bool:
        """Whether a simulated time has come."""
        return self.is_unlimited or time_s <= self.time_s

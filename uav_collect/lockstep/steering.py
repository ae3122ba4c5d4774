"""What people ask of a world while it runs, and what it answers: start, abort, pause, step.

A pause is the world's, not the mission's: it holds whatever flies, and the mission that starts
next, before its first event. What was asked before is still answered: an agent that decides while
the world is paused has decided, and its event is complete.
"""

from dataclasses import dataclass

from uav_collect.lockstep.schedule import MissionSchedule, SimulationPacer

_MOST_CHARGED_S = 0.02  # of a look; longer, the world was busy or stood still: it heard no answer
Answer = tuple[bool, str]  # whether it is done, and what happens now or why not


@dataclass
class Steering:
    """Whether the next event may happen, by request, pause and pace."""

    schedule: MissionSchedule
    pacer: SimulationPacer
    decision_timeout_s: float  # that an agent has to answer, by the wall clock
    is_paused: bool = False
    n_steps: int = 0  # events that may happen although the world is paused
    _waited_s: float = 0.0  # that the agent which is asked has had to answer
    _uncharged_s: float = 0.0  # the latest look
    _looked_s: float = 0.0  # monotonic time

    def begin(self) -> None:
        """A mission starts: its time counts from 0, and it takes no step of the one before."""
        self.n_steps = 0
        self.pacer.restart()

    def start(self, seed: int, *, is_flying: bool) -> Answer:
        """Plan a mission."""
        is_done, text = self.schedule.request(seed, is_flying=is_flying)
        held = ', and waits at its start: the world is paused'
        return is_done, text + (held if is_done and self.is_paused else '')

    def abort(self, *, is_flying: bool) -> Answer:
        """Give up the mission in flight, or the one that was about to start."""
        self.n_steps = 0
        is_done, text = self.schedule.cancel(is_flying=is_flying)
        return is_done, text + ('; the world stays paused' if is_done and self.is_paused else '')

    def pause(self, *, is_flying: bool, awaited: int | None) -> Answer:
        """Let nothing more happen.

        Args:
            awaited: id of the UAV that has to answer, if one has.
        """
        self.is_paused, self.n_steps = True, 0
        self.pacer.hold(True)
        if not is_flying:
            return True, 'paused: the next mission waits at its start'
        if awaited is None:
            return True, 'paused'
        return True, f'paused; UAV {awaited}, which was asked before, may still answer'

    def resume(self, *, is_flying: bool) -> Answer:
        """Go on as before the pause."""
        if not self.is_paused:
            return True, 'the world is not paused'
        self.is_paused, self.n_steps = False, 0
        self.pacer.hold(False)
        return True, 'the mission goes on' if is_flying else 'the next mission starts unpaused'

    def step(self, *, is_flying: bool, awaited: int | None) -> Answer:
        """Let one event more happen; when there is none left, the mission ends.

        Args:
            awaited: id of the UAV that has to answer first, if one has.
        """
        if not self.is_paused:
            return False, 'the world is not paused: pause it first'
        if not is_flying:
            return False, 'no mission is in flight'
        self.n_steps += 1
        first = '' if awaited is None else f', when UAV {awaited} has answered'
        return True, f'one event more{first}'

    def change_timeout(self, decision_timeout_s: float) -> None:
        """Let agents take so long from now on, the one that decides now included."""
        self.decision_timeout_s = decision_timeout_s

    def ask(self) -> None:
        """An agent is asked: its time to answer begins."""
        self._waited_s = self._uncharged_s = 0.0

    def look(self, now_s: float) -> None:
        """Let monotonic time pass, of which agents are charged what this process ran.

        Each look is charged at the next one: an answer that came meanwhile is heard before.
        """
        self._waited_s += self._uncharged_s
        self._uncharged_s = min(now_s - self._looked_s, _MOST_CHARGED_S)
        self._looked_s = now_s

    def is_overdue(self) -> bool:
        """Whether an agent had its time to answer; while the world is paused, all have time."""
        return not self.is_paused and self._waited_s > self.decision_timeout_s

    def lets_pass(self, time_s: float) -> bool:
        """Whether the next event, at a simulated time, may happen now; that uses a step up."""
        if not self.is_paused:
            return self.pacer.is_due(time_s)
        if self.n_steps == 0:
            return False
        self.n_steps -= 1
        self.pacer.skip_to(time_s)
        return True

"""The action /world/fly_mission: a goal is one mission, with feedback while it flies."""

from collections.abc import Callable, Sequence
import math
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from uav_collect.lockstep.steering import Answer
from uav_collect.nodes.process import ProcessNode
from uav_collect.nodes.world.mission import MissionInFlight
from uav_collect_msgs.action import FlyMission
from uav_collect_msgs.msg import Mission

_PERIOD_S = 0.1  # at least, between two feedbacks, wall clock
_REPEATED_S = 1.0  # the same feedback
_CANCELLED = 'the client cancelled it'
_MOST_SPINS = 50  # to answer a client as the process ends
_SPIN_S = 0.01


class _GoalServer(ActionServer):
    """Executes a goal by a task only when the task has something to do.

    One that waits for the end of a mission would keep the events executor busy until then.
    """

    def notify_execute(
        self, goal_handle: Any, execute_callback: Callable[[Any], Any] | None
    ) -> None:
        """Start a task if there is one."""
        if execute_callback is not None:
            super().notify_execute(goal_handle, execute_callback)


class FlyMissionServer:
    """The goal in hand, if there is one: it ends with its mission, and cancelled ends that."""

    def __init__(
        self,
        node: ProcessNode,
        name: str,
        start: Callable[[int, str], Answer],
        abort: Callable[[str], Answer],
    ) -> None:
        """Serve the action, unless only who has a key may steer: goals have no seal.

        Args:
            name: of the action.
            start: plans a mission with a seed, over a scenario that is named.
            abort: ends the mission that was planned, for a reason.
        """
        self._node, self._start, self._abort = node, start, abort
        self._goal: Any = None
        self._has_begun = False
        self._said: Any = None
        self._said_s = -math.inf
        self._n_owed = 0  # results that clients were not given yet
        if node.secret is None:
            self._server = _GoalServer(
                node,
                FlyMission,
                name,
                lambda goal: FlyMission.Result(),  # never asked: `end` says what to do
                goal_callback=self._on_goal,
                handle_accepted_callback=self._on_accepted,
                cancel_callback=self._on_cancel,
            )

    def begin(self) -> None:
        """A mission starts: that of the goal, for there is one at a time."""
        if self._goal is not None:
            self._has_begun, self._said_s = True, -math.inf
            self._goal.execute()

    def inform(
        self,
        now_s: float,
        mission: MissionInFlight | None,
        missing: Sequence[int],
        *,
        is_paused: bool,
    ) -> None:
        """Abort the mission of a goal that was cancelled, or else say now and then how it is.

        Args:
            now_s: monotonic time.
            missing: ids of the UAVs without an agent.
        """
        if self._goal is None:
            return
        if self._goal.is_cancel_requested:
            self._abort(_CANCELLED)
            return
        if now_s - self._said_s < _PERIOD_S:
            return
        feedback = _feedback(mission, missing, is_paused=is_paused)
        if feedback != self._said or now_s - self._said_s > _REPEATED_S:
            self._said, self._said_s = feedback, now_s
            self._goal.publish_feedback(feedback)

    def end(self, mission: Any) -> None:
        """The mission has ended as the message says; so has the goal."""
        goal, self._goal = self._goal, None
        if goal is None:
            return
        if mission.phase == Mission.ENDED:
            goal.succeed()
        elif goal.is_cancel_requested:
            goal.canceled()
        else:
            if not self._has_begun:
                goal.execute()  # only what is executed can be aborted
            goal.abort()
        self._n_owed += 1
        self._server.notify_execute(goal, lambda _: self._paid(mission))

    def end_if_called_off(self, *, is_planned: bool) -> None:
        """End the goal if its mission is not to start any more."""
        if self._goal is not None and not self._has_begun and not is_planned:
            self.end(Mission(phase=Mission.ABORTED, note='called off before it started'))

    def close(self) -> None:
        """Give clients the results that they are owed, as the process ends."""
        n_spins = _MOST_SPINS
        while n_spins > 0 and self._node.executor is not None:
            self._node.executor.spin_once(timeout_sec=_SPIN_S)
            # A result that is there is sent by tasks of its own.
            n_spins = min(n_spins - 1, _MOST_SPINS if self._n_owed else 3)

    def _paid(self, mission: Any) -> Any:
        self._n_owed -= 1
        return FlyMission.Result(mission=mission)

    def _on_goal(self, goal: Any) -> GoalResponse:
        is_planned, text = self._start(int(goal.seed), goal.scenario)
        if is_planned:
            self._node.get_logger().info(f'goal of seed {goal.seed} accepted: {text}')
            return GoalResponse.ACCEPT
        self._node.warn('goal refused', f'goal of seed {goal.seed} rejected: {text}')
        return GoalResponse.REJECT

    def _on_accepted(self, goal: Any) -> None:
        self._goal, self._has_begun = goal, False
        self._said, self._said_s = None, -math.inf

    def _on_cancel(self, goal: Any) -> CancelResponse:
        is_own = self._goal is not None and goal.goal_id == self._goal.goal_id
        return CancelResponse.ACCEPT if is_own else CancelResponse.REJECT


def _feedback(
    mission: MissionInFlight | None, missing: Sequence[int], *, is_paused: bool
) -> FlyMission.Feedback:
    if mission is None:
        return FlyMission.Feedback(phase=FlyMission.Feedback.GATHERING, waiting_for=missing)
    simulation, awaited = mission.simulation, mission.awaited_uav
    return FlyMission.Feedback(
        stamp=mission.stamp(mission.time_s),
        phase=FlyMission.Feedback.PAUSED if is_paused else FlyMission.Feedback.FLYING,
        waiting_for=[] if awaited is None else [awaited],
        time_s=mission.time_s,
        collected_share=simulation.collected_share,
        energy_j=simulation.energy_used_j,
        n_decisions=mission.n_decisions,
    )

"""Missions that were flown elsewhere, handed to the learner at a stated ratio.

One thread adds them as they are joined, another one learns.
"""

from collections import deque
from collections.abc import Callable
from threading import Condition
from typing import Any

import numpy as np
from uav_collect.ingest.join import JoinedMission
from uav_collect.ingest.mission_ids import MissionIds
from uav_collect.learning.network import AgentNetwork
from uav_collect.learning.packing import packed, unpacked
from uav_collect.learning.saved import SavedPart
from uav_collect.missions.experience import Episode
from uav_collect.training.progress import RecentMissions
from uav_collect.uav.briefing import Briefing


def _ignore(epsilon: float) -> None:
    """Leave the policy as it is: the missions were recorded."""


class FleetSource:
    """Where the learner waits for missions; an `EpisodeSource` of a `task.Task`."""

    def __init__(
        self, briefing: Briefing, most_waiting: int, fly: Callable[[float], None] = _ignore
    ) -> None:
        """Start empty.

        Args:
            briefing: of the fleet that flies.
            most_waiting: decisions that may wait for the learner. Where it is slower than the
                fleet it takes what waits at once: updates become fewer, no mission is lost.
            fly: called, each time that missions are asked for, with the epsilon by which they
                should explore; how the network gets on board is its matter.
        """
        self._briefing, self._most_waiting, self._fly = briefing, most_waiting, fly
        self._changed = Condition()
        self._waiting: deque[JoinedMission] = deque()
        self._n_waiting = 0  # decisions
        self._is_closed = False
        self._credit = 0  # decisions handed out that were not asked for yet
        self.recent = RecentMissions()
        self.known = MissionIds()  # all missions that were ever added: none is learned from twice
        self.is_awaited = False  # whether the learner waits for a mission
        self.is_over = False
        self.n_decisions = 0
        self.n_missions = 0

    @property
    def n_waiting(self) -> int:
        """Decisions that wait for the learner."""
        return self._n_waiting

    def add(self, joined: JoinedMission) -> None:
        """Queue a mission for the learner, unless it was added before."""
        with self._changed:
            if joined.mission_id in self.known:
                return
            self.known.add(joined.mission_id)
            self._waiting.append(joined)
            self._n_waiting += _n_made(joined.episode)
            self._changed.notify()

    def close(self) -> None:
        """Say that no more missions will be added."""
        with self._changed:
            self._is_closed = True
            self._changed.notify()

    def wait(self) -> bool:
        """Wait for a mission; whether there is one, or ever will be."""
        with self._changed:
            self._wait()
            return bool(self._waiting)

    def collect(self, agent: AgentNetwork, n_decisions: int, epsilon: float) -> list[Episode]:
        """Wait for so many decisions more than those that were asked for before.

        Returns:
            The missions that came; fewer than asked for once there will be no more.
        """
        del agent  # what flies is far away
        self._fly(epsilon)
        taken: list[Episode] = []
        with self._changed:
            while self._credit < n_decisions and not self.is_over:
                self._wait()
                self.is_over = not self._waiting
                if self._waiting:
                    taken.append(self._pop())
                    self._credit += _n_made(taken[-1])
            if not self.is_over:
                self._credit -= n_decisions
            while self._n_waiting > self._most_waiting:
                taken.append(self._pop())
        return taken

    def _wait(self) -> None:
        self.is_awaited = True
        self._changed.wait_for(lambda: self._waiting or self._is_closed)
        self.is_awaited = False

    def state(self) -> dict[str, Any]:
        """All that it needs to go on; the inverse is `restore`."""
        with self._changed:
            return {
                'waiting': [*map(_joined_state, self._waiting)],
                'known': self.known.state(),
                'recent': self.recent.state(),
                'credit': self._credit,
                'n_decisions': self.n_decisions,
                'n_missions': self.n_missions,
            }

    def restore(self, saved: SavedPart) -> None:
        """Take over the state of another one.

        Raises:
            CheckpointError: something that was saved is not what such a source saves.
        """
        waiting = [_restored(each, self._briefing) for each in saved.parts('waiting')]
        with self._changed:
            self._waiting.extend(waiting)
            self._n_waiting = sum(_n_made(it.episode) for it in self._waiting)
            self._restore_known(saved)
            self.recent.restore(saved.array('recent', np.float64, (None, 2)))
            self._credit = saved.whole('credit')
            self.n_decisions = saved.whole('n_decisions')
            self.n_missions = saved.whole('n_missions')

    def _restore_known(self, saved: SavedPart) -> None:
        known = saved.part('known')
        try:
            self.known.restore({world: known.wholes(world) for world in known.names})
        except ValueError as error:
            raise saved.refusal('known', f'is no set of missions: {error}') from error

    def _pop(self) -> Episode:
        joined = self._waiting.popleft()
        episode = joined.episode
        self.recent.add(joined.efficiency_kbit_per_j, float(np.sum(episode.records.reward)))
        self._n_waiting -= _n_made(episode)
        self.n_decisions += _n_made(episode)
        self.n_missions += 1
        return episode


def _joined_state(joined: JoinedMission) -> dict[str, Any]:
    return {
        'mission_id': joined.mission_id,
        'efficiency_kbit_per_j': joined.efficiency_kbit_per_j,
        'episode': packed([joined.episode]),
    }


def _restored(saved: SavedPart, briefing: Briefing) -> JoinedMission:
    episodes = unpacked(saved.part('episode'), briefing)
    if len(episodes) != 1:
        raise saved.refusal('episode', f'holds {len(episodes)} missions: must hold 1')
    return JoinedMission(
        mission_id=saved.text('mission_id'),
        episode=episodes[0],
        efficiency_kbit_per_j=saved.number('efficiency_kbit_per_j'),
    )


def _n_made(episode: Episode) -> int:
    """How many decisions were made: of a mission cut off, the last one was not."""
    return episode.n_decisions - (not episode.is_whole)

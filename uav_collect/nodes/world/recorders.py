"""Lets missions of a world wait until its recorders hear everything."""

from collections.abc import Callable, Collection
import time
from typing import Any

from uav_collect.errors import in_one_line
from uav_collect.lockstep.recorders import RecorderReport, RecorderWatch, TakeOff, world_key
from uav_collect.nodes.process import ProcessNode
from uav_collect.nodes.topics import subscription, WorldTopics
from uav_collect.nodes.world.settings import WorldSettings

_SAID_EVERY_S = 5.0  # while a mission waits for the same
_MOST_ENTRIES = 1_000  # of a list in a status
_MOST_CHARACTERS = 1_000  # of a text in it


class WorldRecorders:
    """Hears what recorders say, and says for whom the world waits."""

    def __init__(
        self,
        node: ProcessNode,
        names: WorldTopics,
        settings: WorldSettings,
        world_instance: str,
        warn: Callable[[str, str], None],
    ) -> None:
        """Listen to recorders.

        Args:
            warn: gets the kind and the text of an incident.
        """
        self._node, self._names, self._warn = node, names, warn
        self._timeout_s = settings.recorder_timeout_s
        self._instance = world_instance
        self._watch = RecorderWatch(
            world_instance, n_expected=settings.recorders, timeout_s=self._timeout_s
        )
        self._said: tuple[str, ...] = ()
        self._said_s = 0.0
        subscription(node, names.recorder, self._on_status)

    def await_scenario(self, scenario_fingerprint: str) -> None:
        """Wait until recorders have heard of this scenario of the world."""
        self._watch.world = world_key(self._instance, scenario_fingerprint)

    def are_ready(self, uavs: Collection[int], now_s: float) -> bool:
        """Whether a mission may take off that is ready otherwise.

        Args:
            uavs: ids of those that have an agent.
            now_s: monotonic time.
        """
        awaited = [topic.name for topic in self._names.awaited(uavs)]
        answer = self._watch.take_off(now_s, awaited)
        self._say(answer, now_s)
        return answer.is_clear

    def rest(self) -> None:
        """No mission is ready to take off: the next one waits its whole time."""
        self._watch.rest()

    def _say(self, answer: TakeOff, now_s: float) -> None:
        said, self._said = self._said, answer.unready
        if not answer.unready:
            return
        what = in_one_line('; '.join(answer.unready))
        if answer.is_clear:
            text = f'a mission starts after {self._timeout_s:g} s without {what}'
            self._warn('recorder not ready', text)
        elif said != answer.unready or now_s - self._said_s > _SAID_EVERY_S:
            self._said_s = now_s
            self._node.get_logger().info(f'waiting for {what}')

    def _on_status(self, msg: Any) -> None:
        worlds = [*msg.world_instances, *msg.scenario_fingerprints]
        texts = [msg.recorder_instance, msg.bag, *worlds, *msg.waits_for]
        if len(texts) > _MOST_ENTRIES or max(map(len, texts)) > _MOST_CHARACTERS:
            self._warn('recorder refused', f'{self._names.recorder.name}: a status is too long')
            return
        report = RecorderReport(
            recorder=msg.recorder_instance,
            bag=msg.bag,
            worlds=frozenset(map(world_key, msg.world_instances, msg.scenario_fingerprints)),
            waits_for=frozenset(msg.waits_for),
        )
        self._watch.add(report, time.monotonic())

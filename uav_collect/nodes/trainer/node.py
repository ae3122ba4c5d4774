"""The trainer node: learns from what fleets fly, and publishes the policy that they fly."""

import argparse
from array import array
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from functools import partial
import hashlib
import math
from pathlib import Path
import time
from typing import Any
import uuid

from rclpy.clock import Clock, ClockType
from uav_collect.config.arguments import Parser
from uav_collect.errors import (
    BagError,
    ConfigError,
    NodeError,
    PolicyMismatchError,
    RefusedError,
    TrainingRunError,
)
from uav_collect.ingest.from_messages import converter_for
from uav_collect.ingest.join import (
    JoinCounts,
    JoinedMission,
    MissionJoiner,
)
from uav_collect.ingest.rebuild import EpisodeBuilder
from uav_collect.ingest.reports import FleetReport, MissionReport, report_spec
from uav_collect.kernels.compile import kernels_are_compiled
from uav_collect.learning.background import BackgroundTraining, BehaviourPolicy, Ending
from uav_collect.learning.learner import keep_freed_memory
from uav_collect.learning.replay import replay_bytes
from uav_collect.learning.units import reward_units
from uav_collect.limits import FAILED, UNUSABLE
from uav_collect.nodes import topics
from uav_collect.nodes.convert import stamp
from uav_collect.nodes.parameters import help_text, wrapped
from uav_collect.nodes.process import parse_arguments, ProcessNode, run_node
from uav_collect.nodes.sealing import seals_of_bag
from uav_collect.nodes.trainer.settings import (
    PARAMETERS,
    planned_run,
    read_settings,
    TrainerSettings,
)
from uav_collect.nodes.trainer.vouching import MissionVouching
from uav_collect.recording.bag_messages import messages
from uav_collect.scenario.site import build_site
from uav_collect.training.display import progress_display
from uav_collect.uav.briefing import brief
from uav_collect.uav.policy_file import policy_bytes
from uav_collect_msgs.msg import Policy

_DESCRIPTION = """
Learns from the missions that fleets fly: joins what worlds and agents tell of them, updates the
policy beside that, and publishes it for agents that fly the policy "topic". Goes on by itself with
the run that its folder holds.
"""
_TICK_S = 0.05
_READ_S = 0.04  # of a tick, to read a bag in
_SHOWN_PERIOD_S = 1.0
_WAITING_PERIOD_S = 10.0  # between two lines that say what the trainer waits for
_READER_DEPTH = 20_000  # messages of a topic that wait while the learner has the processor
_MOST_WAITING_UPDATES = 64  # that the learner may be late by before it skips some


class TrainerNode(ProcessNode):
    """Subscribes, joins, publishes; learning happens in another thread."""

    def __init__(self, bags: Sequence[Path]) -> None:
        """Get ready as the run's folder says, then subscribe, or read bags.

        Args:
            bags: to learn from instead of what flies.
        """
        super().__init__('trainer')
        settings = read_settings(self)
        self._joiners: dict[str, MissionJoiner] = {}  # by namespace
        try:
            self._prepare_training(settings, () if bags else settings.namespaces)
        except (ConfigError, PolicyMismatchError, TrainingRunError) as error:
            raise NodeError(str(error)) from error
        except OSError as error:
            raise NodeError(f'output_dir: {error}') from error
        self._vouching = MissionVouching(self)
        self._instance, self._sequence = str(uuid.uuid4()), 0
        self._version = ''
        self._shown_s = self._logged_s = -math.inf
        self._closing = ExitStack()
        self._show = self._closing.enter_context(
            progress_display(self._run.folder.name, self._join_status)
        )
        # What is learned from recordings is nobody's to fly yet.
        self._policy_pub = None if bags else topics.publisher(self, topics.POLICY)
        self._bags = self._read(bags) if bags else None
        self._learning.start()
        for namespace in self._joiners:
            self._subscribe_to_world(namespace)
        self.create_timer(_TICK_S, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def on_stop(self) -> None:
        """Save what was learned, and publish the last policy."""
        ending = self._learning.stop()
        self._publish(self._learning.new_policy())
        self._closing.close()
        if self.end_status is None:  # a signal
            self.get_logger().info(f'{ending.text}; start it again to go on')

    def _prepare_training(self, settings: TrainerSettings, namespaces: Sequence[str]) -> None:
        """Plan or resume the run, and what joins the missions of each world."""
        self._run = planned_run(settings)
        self._log_memory()
        self._learning = BackgroundTraining(
            self._run,
            most_waiting=_MOST_WAITING_UPDATES * self._run.config.rollout.decisions_per_update,
            publish_every_updates=settings.publish_every_updates,
            checkpoint_s=settings.checkpoint_period_s,
        )
        for namespace in namespaces:
            ask = partial(self._ask, namespace)
            self._joiners[namespace] = self._new_joiner(ask)

    def _log_memory(self) -> None:
        settings = self._run.config.replay
        n_bytes = replay_bytes(settings.decisions, brief(self._run.scenarios[0]))
        self.get_logger().info(
            f'the replay has room for {settings.decisions:,} decisions: {n_bytes / 1e6:,.0f} MB,'
            f' and {settings.most_observation_bytes / 1e6:,.0f} MB for observations'
        )

    # What comes in.

    def _subscribe_to_world(self, namespace: str) -> None:
        """Subscribe to all that a world and its fleet report."""
        world = topics.world_topics(namespace)
        topics.subscription(self, world.scenario, self._vouching.note_world)
        uavs = range(1, self._run.scenarios[0].n_uavs + 1)
        for topic in (world.mission, world.epoch, *(world.uav(uav).transition for uav in uavs)):
            found = converter_for(topic.name)
            if found is None:
                raise RuntimeError(f'topic {topic.name} reports nothing to a learner')
            _, convert = found
            on_message = partial(self._ingest, self._joiners[namespace], convert)
            topics.subscription(
                self, topic, on_message, qos=topics.patient_qos(topic.qos, _READER_DEPTH)
            )

    def _new_joiner(self, ask: Callable[[MissionReport], None] | None = None) -> MissionJoiner:
        """What joins the missions of one world into episodes as the run learns from them."""
        scenario, config = self._run.scenarios[0], self._run.config
        site = build_site(scenario)
        rewards = config.reward_kind, *reward_units(config, site), config.own_reward
        builder = EpisodeBuilder(site, config.layout, *rewards)
        if kernels_are_compiled():
            builder.warm_up()
        return MissionJoiner(
            report_spec(site, config.layout),
            builder,
            max_decisions=config.max_decisions(scenario.n_cells),
            known=self._learning.source.known,
            ask=ask,
        )

    def _ask(self, namespace: str, mission: MissionReport) -> None:
        """Ask the world of a mission whether it is its own."""
        joiner = self._joiners[namespace]

        def on_answer(is_own: bool) -> None:
            self._take(lambda: joiner.answer(mission.mission_id, is_own=is_own))

        self._vouching.ask(mission, on_answer)

    def _ingest(
        self, joiner: MissionJoiner, convert: Callable[[Any], FleetReport], msg: Any
    ) -> None:
        self._take(lambda: joiner.add(convert(msg)))

    def _take(self, join: Callable[[], JoinedMission | None]) -> None:
        """Hand the mission that was joined to the learner, if one was."""
        try:
            joined = join()
        except RefusedError as error:
            self.warn('refused', f'refused: {error}; its mission is dropped')
            return
        if joined is not None:
            self._learning.source.add(joined)

    def _read(self, bags: Sequence[Path]) -> Iterator[None]:
        """Ingest message after message of recordings, and say what was in each."""
        for bag in bags:
            joiners: dict[str, MissionJoiner] = {}  # by namespace
            seals = seals_of_bag(self, bag)
            for topic, msg in messages(bag, lambda name: converter_for(name) is not None, seals):
                found = converter_for(topic)
                if found is not None:
                    world, convert = found
                    if world not in joiners:
                        joiners[world] = self._joiners[f'{bag}{world}'] = self._new_joiner()
                    self._ingest(joiners[world], partial(_converted, bag, convert), msg)
                yield
            for joiner in joiners.values():
                joiner.drop_incomplete()
            counts = JoinCounts.sum(joiner.counts for joiner in joiners.values())
            self.get_logger().info(
                f'{bag}: {counts.n_missions} missions found: {counts.missions_text}'
            )
        self._learning.source.close()

    # What goes out.

    def _tick(self) -> None:
        self._publish(self._learning.new_policy())
        self._vouching.look()
        now_s = time.monotonic()
        if now_s - self._shown_s >= _SHOWN_PERIOD_S:
            self._shown_s = now_s
            self._show_progress(now_s)
        if self._learning.ending is not None:
            self._end(self._learning.ending)
        elif self._bags is not None:
            self._read_on(self._bags, now_s + _READ_S)

    def _read_on(self, bags: Iterator[None], until_s: float) -> None:
        """Read until a time, or until enough waits for the learner."""
        most = _MOST_WAITING_UPDATES * self._run.config.rollout.decisions_per_update // 2
        try:
            while time.monotonic() < until_s and self._learning.source.n_waiting < most:
                if next(bags, self) is self:
                    self._bags = None
                    return
        except BagError as error:
            self.get_logger().error(str(error))
            self.end(UNUSABLE)

    def _publish(self, flown: BehaviourPolicy | None) -> None:
        """Publish what the fleets shall fly from now on, if that is something new."""
        if flown is None:
            return
        self._version = flown.policy.header.version
        if self._policy_pub is None:
            return
        content = policy_bytes(flown.policy)
        self._sequence += 1
        self._policy_pub.publish(
            Policy(
                stamp=stamp(time.time()),  # wall-clock time, whatever ROS takes for its clock
                version=self._version,
                trainer_instance=self._instance,
                sequence=self._sequence,
                content=array('B', content),
                sha256=hashlib.sha256(content).hexdigest(),
                epsilon=flown.epsilon,
                hover_share=self._run.config.exploration.hover_share,
                advice_share=self._run.config.advice_share,
            )
        )

    def _show_progress(self, now_s: float) -> None:
        """Show how the training stands, or say now and then that it waits for missions."""
        progress = self._learning.progress
        if progress is not None:
            self._show(progress)
        elif self._learning.source.is_awaited and now_s - self._logged_s >= _WAITING_PERIOD_S:
            self._logged_s = now_s
            self.get_logger().info(', '.join(('waiting for missions', *self._join_status())))

    def _join_status(self) -> tuple[str, ...]:
        """Which policy is flown, and what became of missions and messages, for people."""
        total = JoinCounts.sum(joiner.counts for joiner in self._joiners.values())
        n_waiting = sum(joiner.n_waiting for joiner in self._joiners.values())
        n_unvouched = sum(joiner.n_unvouched for joiner in self._joiners.values())
        asked = f'{n_unvouched} to be confirmed by their world' if n_unvouched else ''
        waiting = f'{n_waiting} waiting for the rest of their missions' if n_waiting else ''
        messages = ', '.join(filter(None, (waiting, total.messages_text)))
        return (
            f'policy {self._version}' if self._version else 'no policy yet',
            ', '.join(filter(None, (total.missions_text, asked))),
            *([f'messages: {messages}'] if messages else []),
        )

    def _end(self, ending: Ending) -> None:
        log = self.get_logger().error if ending.has_failed else self.get_logger().info
        log(ending.text)
        self.end(FAILED if ending.has_failed else 0)


def _converted(bag: Path, convert: Callable[[Any], FleetReport], msg: Any) -> FleetReport:
    """The report in a recorded message.

    Raises:
        BagError: the message lacks a field.
    """
    try:
        return convert(msg)
    except RefusedError:
        raise
    except (AttributeError, OverflowError, TypeError, ValueError) as error:
        raise BagError(f'{bag}: was recorded by another version: {error}') from error


def main(argv: Sequence[str]) -> int:
    """Run the trainer; the exit status."""
    import torch

    parser = Parser(
        prog='trainer',
        description=wrapped(_DESCRIPTION),
        epilog=help_text(PARAMETERS),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        '--from-bag',
        type=Path,
        nargs='+',
        default=[],
        metavar='BAG',
        help='learn from recorded missions instead of those that are flown',
    )
    arguments = parse_arguments(parser, argv)
    torch.set_num_threads(1)  # measured: more threads on busy cores are several times slower
    keep_freed_memory()
    return run_node(lambda: TrainerNode(arguments.from_bag), argv)

"""The world node: simulates missions in lockstep with the fleet's agents, and relays their radio."""

import argparse
from collections.abc import Sequence
from pathlib import Path
import time
from typing import Any
import uuid

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.utilities import remove_ros_args
from rosgraph_msgs.msg import Clock as ClockMsg
from uav_collect.mission_log import LogWriter
from uav_collect.nodes import convert, topics
from uav_collect.nodes.display import Display
from uav_collect.nodes.flight import Flight, mission_msg
from uav_collect.nodes.incidents import diagnostics, Incidents, status
from uav_collect.nodes.parameters import declare, help_text, Parameter
from uav_collect.nodes.roster import Pilot, Roster
from uav_collect.nodes.spin import FAILED, NodeError, ProcessNode, run_node
from uav_collect.nodes.topics import publisher, subscription
from uav_collect.scenario import ConfigError, fingerprint, load, Scenario
from uav_collect.simulation import Event
from uav_collect.site import build_site, Site
from uav_collect_msgs.msg import Mission, Observation
from uav_collect_msgs.msg import Scenario as ScenarioMsg
from uav_collect_msgs.srv import ControlMission, Join

_DESCRIPTION = """
Simulates sensors, radio, flight and energy of a mission, hands each UAV's agent what it observes,
waits for its command, and relays messages between UAVs in range. Waits for the whole fleet, flies
its missions, writes their logs and exits.
"""
_TICK_S = 0.02
_TOLD_PERIOD_S = 5.0  # between two lines that say for whom the world waits
_DIAGNOSTICS_PERIOD_S = 1.0
_OTHER_WORLD_S = 0.5  # how long a starting world listens for one that is there already

PARAMETERS = (
    Parameter(
        name='scenario',
        default='paper_10x10',
        description='name of a shipped scenario, or path of a YAML file',
    ),
    Parameter(
        name='seed',
        default=0,
        description='seed of the first mission; each further one adds 1',
        low=0,
        high=2**62,
    ),
    Parameter(
        name='missions',
        default=1,
        description='missions to fly in a row before the world exits; 0: only those that '
        '/world/control starts, without end',
        low=0,
        high=1_000_000,
    ),
    Parameter(
        name='real_time_factor',
        default=0.0,
        description='simulated over wall-clock time; 0: as fast as the fleet decides',
        low=0.0,
        high=1000.0,
    ),
    Parameter(
        name='wait_for_agents',
        default=True,
        description='wait for the whole fleet; if false, UAVs without an agent fly home at once',
    ),
    Parameter(
        name='decision_timeout_s',
        default=10.0,
        description='wall-clock time [s] that an agent has to answer before the failsafe flies '
        'its UAV home',
        low=0.1,
        high=3600.0,
    ),
    Parameter(
        name='output_dir',
        default='',
        description='folder for the mission logs and the resolved scenario; empty: none',
    ),
    Parameter(
        name='viewer_rate_hz',
        default=5.0,
        description='how often [Hz, wall clock] markers and grid are published; 0: never',
        low=0.0,
        high=60.0,
    ),
)


class WorldNode(ProcessNode):
    """Converts, asks the flight, publishes."""

    def __init__(self) -> None:
        """Read the scenario; the world opens when no other one answers."""
        super().__init__('world_sim')
        declare(self, PARAMETERS)
        self._instance = str(uuid.uuid4())
        self._started_s = time.time()
        try:
            self._scenario: Scenario = load(self._value('scenario'))
            self._site: Site = build_site(self._scenario)
        except ConfigError as error:
            raise NodeError(str(error)) from error
        self._roster = Roster(self._scenario.n_uavs)
        self._incidents = Incidents()
        self._flight: Flight | None = None
        self._log: LogWriter | None = None
        self._n_started = 0
        self._next_seed: int | None = self._value('seed') if self._value('missions') else None
        self._due: Event | None = None  # waits for its time, if paced
        self._begun_s = self._asked_s = self._told_s = self._reported_s = time.monotonic()
        self._reports = publisher(self, topics.DIAGNOSTICS)
        self._other = subscription(self, topics.SCENARIO, self._on_scenario)
        self._is_open = False
        self.create_timer(_TICK_S, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def on_stop(self) -> None:
        """A mission in flight is aborted, and what is known of it kept."""
        if self._flight is not None:
            self._end_mission(Mission.ABORTED, 'the world was stopped')

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _open(self) -> None:
        self._is_open = True
        self._clock_topic = publisher(self, topics.CLOCK)
        self._epochs = publisher(self, topics.EPOCH)
        self._missions = publisher(self, topics.MISSION)
        self._scenarios = publisher(self, topics.SCENARIO)
        uavs = range(1, self._scenario.n_uavs + 1)
        own = {uav: topics.uav_topics(uav) for uav in uavs}
        self._observations = {uav: publisher(self, own[uav].observation) for uav in uavs}
        self._radio = {uav: publisher(self, own[uav].radio_rx) for uav in uavs}
        for uav in uavs:
            watch = SubscriptionEventCallbacks(
                liveliness=lambda event, uav=uav: self._on_liveliness(uav, event)
            )
            subscription(
                self,
                own[uav].command,
                lambda msg, uav=uav: self._on_command(uav, msg),
                on_event=watch,
            )
            subscription(
                self, own[uav].radio_tx, lambda msg, uav=uav: self._on_radio(uav, msg)
            )
        self.create_service(Join, topics.JOIN_SERVICE, self._on_join)
        self.create_service(ControlMission, topics.CONTROL_SERVICE, self._on_control)
        self._scenarios.publish(self._scenario_msg())
        rate_hz = self._value('viewer_rate_hz')
        self._display = Display(self, self._scenario, self._site, rate_hz)
        self._keep_scenario()
        self.get_logger().info(
            f'scenario {self._scenario.name}: {self._scenario.n_uavs} UAVs, '
            f'{self._site.n_sensors} sensors'
        )

    def _mission_id(self, index: int) -> str:
        return f'{self._instance[:8]}-{index}'

    def _scenario_msg(self) -> ScenarioMsg:
        return ScenarioMsg(
            stamp=convert.stamp(self._started_s),
            world_instance=self._instance,
            yaml=self._scenario.to_yaml(),
            fingerprint=fingerprint(self._scenario),
            sensor_id=list(self._site.sensor_ids),
            sensor_x_m=self._site.position_m[:, 0].tolist(),
            sensor_y_m=self._site.position_m[:, 1].tolist(),
        )

    # Who is there.

    def _on_scenario(self, msg: Any) -> None:
        if msg.world_instance == self._instance:
            return
        text = f'another world_sim flies scenario {_name_of(msg)} in this ROS domain'
        own = (convert.stamp(self._started_s), self._instance)
        is_later = (_nanoseconds(own[0]), own[1]) > (
            _nanoseconds(msg.stamp),
            msg.world_instance,
        )
        if self._is_open and not is_later:
            self._note('second world', f'{text}; it came later and has to give way')
            return
        self._note('second world', f'{text}: this one gives way; set another ROS_DOMAIN_ID')
        self._report()
        self.end(FAILED)

    def _on_join(self, request: Any, response: Any) -> Any:
        pilot = Pilot(
            uav=request.uav,
            instance=request.agent_instance,
            host=request.host,
            pid=request.pid,
            policy=request.policy,
            policy_version=request.policy_version,
            allocator=request.allocator,
        )
        answer = self._roster.ask(pilot)
        response.accepted, response.retry = answer.accepted, answer.retry
        response.reason = answer.reason
        response.scenario_fingerprint = fingerprint(self._scenario)
        if not answer.accepted:
            self._note('join refused', f'UAV {pilot.uav}: {pilot} refused: {answer.reason}')
            return response
        self.get_logger().info(
            f'UAV {pilot.uav}: {pilot} joined, policy {pilot.policy}, bandwidth {pilot.allocator}'
        )
        response.mission_id = self._mission_id(self._n_started)
        if self._flight is not None:
            response.mission_id = self._flight.mission_id
            history = self._flight.history(pilot.uav)
            response.observations, response.radio, response.decision_pending = history
        return response

    def _on_liveliness(self, uav: int, event: Any) -> None:
        if event.alive_count > 0:
            self._roster.regain(uav)
            return
        lost = self._roster.lose(uav)
        if lost is not None:
            self._note('agent lost', f'UAV {uav}: its agent is gone, {lost}')

    # What agents say.

    def _on_command(self, uav: int, msg: Any) -> None:
        flight = self._flight
        if flight is None or msg.mission_id != flight.mission_id:
            return self._refuse_foreign(uav, 'command', msg.mission_id, msg.decision)
        if not self._roster.is_flown_by(uav, msg.agent_instance):
            return self._refuse(uav, 'command', 'it is not from the agent that flies this UAV')
        if flight.pending is not None and flight.pending.event.uav + 1 != uav:
            return self._refuse(uav, 'command', f'decision {msg.decision} is not awaited')
        refusal = flight.take_command(msg)
        if refusal is not None:
            return self._refuse(uav, 'command', refusal)
        return self._go_on()

    def _on_radio(self, uav: int, msg: Any) -> None:
        flight = self._flight
        if flight is None or msg.mission_id != flight.mission_id:
            return self._refuse_foreign(uav, 'radio message', msg.mission_id, msg.sequence)
        if flight.pending is not None and flight.pending.event.uav + 1 != uav:
            return self._refuse(uav, 'radio message', f'decision {msg.sequence} is not awaited')
        refusal = flight.take_radio(msg)
        if refusal is not None:
            return self._refuse(uav, 'radio message', refusal)
        return self._go_on()

    def _refuse_foreign(self, uav: int, what: str, mission_id: str, decision: int) -> None:
        if not mission_id.startswith(self._instance[:8]):
            self._refuse(uav, what, f'mission {mission_id!r} is not of this world')
        elif self._flight is not None:
            self._refuse(uav, what, f'decision {decision} is of the past mission {mission_id}')

    def _refuse(self, uav: int, what: str, why: str) -> None:
        self._note(f'{what} refused', f'UAV {uav}: {what} refused: {why}')

    def _on_control(self, request: Any, response: Any) -> Any:
        if request.command == ControlMission.Request.START:
            response.success = self._flight is None and self._next_seed is None
            response.message = 'a mission starts when the fleet is complete'
            if response.success:
                self._next_seed = int(request.seed)
            else:
                response.message = 'a mission is in flight or about to start: abort it first'
        elif request.command == ControlMission.Request.ABORT:
            response.success = self._flight is not None
            response.message = 'aborted' if self._flight is not None else 'no mission is in flight'
            if self._flight is not None:
                self._end_mission(Mission.ABORTED, 'aborted by request')
        else:
            response.success = False
            response.message = f'command {request.command} is neither START nor ABORT'
        return response

    # The mission.

    def _tick(self) -> None:
        now_s = time.monotonic()
        if not self._is_open:
            if now_s - self._begun_s > _OTHER_WORLD_S and self.end_status is None:
                self._open()
            return
        if self._flight is None:
            self._start_if_ready(now_s)
        else:
            self._watch(self._flight, now_s)
        if now_s - self._reported_s > _DIAGNOSTICS_PERIOD_S:
            self._report()

    def _start_if_ready(self, now_s: float) -> None:
        if self._next_seed is None:
            return
        missing = self._roster.missing()
        if missing and self._value('wait_for_agents'):
            if now_s - self._told_s > _TOLD_PERIOD_S or self._told_s == self._begun_s:
                self._told_s = now_s
                names = ', '.join(f'UAV {uav}' for uav in missing)
                self.get_logger().info(f'waiting for {names}')
            return
        seed, self._next_seed = self._next_seed, None
        self._start_mission(seed)

    def _start_mission(self, seed: int) -> None:
        self._roster.begin()
        try:
            flight = Flight(
                self._scenario,
                self._site,
                seed,
                mission_id=self._mission_id(self._n_started),
                pilots=self._roster.flying,
            )
        except ConfigError as error:
            self.get_logger().error(str(error))
            self.end(FAILED)
            return
        self._flight = flight
        self._n_started += 1
        self._begun_s = time.monotonic()
        self._open_log(flight)
        self._missions.publish(
            mission_msg(flight, self._instance, self._n_started - 1, Mission.STARTED)
        )
        self.get_logger().info(f'mission {flight.mission_id} starts, seed {seed}')
        self._display.begin(flight.simulation)
        self._advance()

    def _advance(self) -> None:
        """Go to the next event that needs an agent, or to the end of the mission."""
        flight = self._flight
        while flight is not None:
            event = flight.next_event()
            if event is None:
                self._publish_epoch(flight)
                self._end_mission(Mission.ENDED, flight.failsafe_note)
                return
            if event.uav + 1 not in flight.unflown:
                self._offer(flight, event)
                self._publish_epoch(flight)
                return
            self._publish_epoch(flight)
            flight.fly_home(event)

    def _offer(self, flight: Flight, event: Event) -> None:
        """Let the deciding UAV hear and see, at its time."""
        if time.monotonic() < self._due_s(event.view.time_s):
            self._due = event
            return
        self._due = None
        uav = event.uav + 1
        for message in flight.deliver(event):
            self._radio[uav].publish(message)
        self._observations[uav].publish(flight.ask(event))
        self._clock_topic.publish(ClockMsg(clock=convert.stamp(event.view.time_s)))
        self._asked_s = time.monotonic()

    def _due_s(self, time_s: float) -> float:
        factor = self._value('real_time_factor')
        return self._begun_s + time_s / factor if factor > 0.0 else 0.0

    def _go_on(self) -> None:
        flight = self._flight
        if flight is None or flight.pending is None or not flight.pending.is_answered:
            return
        if flight.pending.decision is not None:
            self._display.viewers.note_event(flight.pending.event, flight.pending.decision)
        for uav, message in flight.carry_out():
            self._radio[uav].publish(message)
        self._advance()

    def _watch(self, flight: Flight, now_s: float) -> None:
        time_s = flight.simulation.time_s
        factor = self._value('real_time_factor')
        if factor > 0.0:
            time_s = (now_s - self._begun_s) * factor
            self._clock_topic.publish(ClockMsg(clock=convert.stamp(time_s)))
        self._display.show(time_s)
        if self._due is not None:
            self._offer(flight, self._due)
        elif flight.pending and now_s - self._asked_s > self._value('decision_timeout_s'):
            event = flight.pending.event
            uav = event.uav + 1
            self._note(
                'failsafe',
                f'UAV {uav}: no answer to decision {event.decision} within '
                f'{self._value("decision_timeout_s"):g} s; the failsafe flies it home',
            )
            flight.fly_home(event)
            self._observations[uav].publish(_terminated(flight, event))
            self._advance()

    def _publish_epoch(self, flight: Flight) -> None:
        epoch = flight.closed_epoch()
        if epoch is None:
            return
        self._epochs.publish(epoch)
        if self._log is not None:
            try:
                self._log.append(flight.simulation.last_event())
            except OSError as error:
                self._note('log lost', f'the mission log cannot be written: {error}')
                self._log = None

    def _end_mission(self, phase: int, note: str) -> None:
        flight, self._flight, self._due = self._flight, None, None
        if flight is None:
            return
        self._roster.end()
        message = mission_msg(flight, self._instance, self._n_started - 1, phase)
        message.note = note
        self._missions.publish(message)
        self._display.show(flight.simulation.end_s, now=True)
        if self._log is not None:
            self._log.close()
        word = 'ended' if phase == Mission.ENDED else f'was aborted, {note},'
        self.get_logger().info(
            f'mission {flight.mission_id} {word} after {message.n_decisions} decisions: '
            f'{message.collected_bit / 1e6:.2f} of {message.total_bit / 1e6:.2f} Mbit, '
            f'{message.energy_j / 1e3:.2f} kJ, {message.completion_s:.1f} s, '
            f'{message.efficiency_bit_per_j / 1e3:.4f} kbit/J'
        )
        self._plan_next(flight.seed)

    def _plan_next(self, seed: int) -> None:
        n_missions = self._value('missions')
        if n_missions == 0:
            return
        if self._n_started < n_missions:
            self._next_seed = seed + 1
        else:
            self._report()
            self.end()

    # Files and diagnostics.

    def _keep_scenario(self) -> None:
        folder = self._value('output_dir')
        if folder:
            try:
                Path(folder).mkdir(parents=True, exist_ok=True)
                (Path(folder) / 'scenario.yaml').write_text(self._scenario.to_yaml())
            except OSError as error:
                self.get_logger().error(f'output_dir {folder}: {error}')
                self.end(FAILED)

    def _open_log(self, flight: Flight) -> None:
        folder = self._value('output_dir')
        if not folder:
            return
        try:
            path = Path(folder) / f'mission_{flight.seed}.jsonl'
            self._log = LogWriter(path, flight.header)
        except OSError as error:
            self._note('log lost', f'the mission log cannot be written: {error}')

    def _note(self, kind: str, text: str) -> None:
        self._incidents.note(kind, text)
        self.get_logger().warning(text)

    def _report(self) -> None:
        self._reported_s = time.monotonic()
        flight = self._flight
        values = self._incidents.key_values()
        level = DiagnosticStatus.WARN if values else DiagnosticStatus.OK
        told = f'mission {flight.mission_id} in flight' if flight else 'no mission in flight'
        statuses = [status(level, 'world_sim: mission', told, values)]
        for uav in range(1, self._scenario.n_uavs + 1):
            statuses.append(self._uav_status(flight, uav))
        now = self.get_clock().now().to_msg()
        self._reports.publish(diagnostics(now, statuses))

    def _uav_status(self, flight: Flight | None, uav: int) -> DiagnosticStatus:
        if flight is not None and uav in flight.unflown:
            return status(DiagnosticStatus.ERROR, f'uav_{uav}: agent', 'flown home by the failsafe')
        if uav in self._roster.missing():
            return status(DiagnosticStatus.WARN, f'uav_{uav}: agent', 'no agent')
        return status(DiagnosticStatus.OK, f'uav_{uav}: agent', f'{self._roster.pilots[uav]}')


def _terminated(flight: Flight, event: Event) -> Observation:
    observation = convert.observation_msg(event, flight.mission_id, 0)
    observation.terminated = True
    return observation


def _nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _name_of(msg: Any) -> str:
    first = str(msg.yaml).partition('\n')[0]
    return first.removeprefix('name:').strip()


def main(argv: Sequence[str]) -> int:
    """Run the world node; the exit status."""
    parser = argparse.ArgumentParser(
        prog='world_sim',
        description=_DESCRIPTION,
        epilog=help_text(PARAMETERS),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.parse_args(remove_ros_args(list(argv)))
    return run_node(WorldNode, argv)

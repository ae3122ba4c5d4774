"""The world node: simulates missions in lockstep with its fleet, and relays their radio."""

import argparse
from collections.abc import Sequence
from functools import partial
import time
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from uav_collect.config.arguments import Parser
from uav_collect.errors import ConfigError, NodeError, RecordingError
from uav_collect.limits import BEST, FAILED
from uav_collect.lockstep.checks import join_problem
from uav_collect.lockstep.published_policy import PolicyStore
from uav_collect.lockstep.roster import Pilot, Roster
from uav_collect.lockstep.schedule import MissionSchedule, SimulationPacer
from uav_collect.lockstep.steering import Steering
from uav_collect.missions.simulation import Event
from uav_collect.nodes import convert, topics
from uav_collect.nodes.identity import scenario_msg, WorldIdentity
from uav_collect.nodes.parameters import add_world_option, help_text, wrapped
from uav_collect.nodes.process import parse_arguments, ProcessNode, run_node
from uav_collect.nodes.sealing import serve
from uav_collect.nodes.topics import subscription
from uav_collect.nodes.trainer_listener import subscribe_to_trainers
from uav_collect.nodes.world.control import WorldControl
from uav_collect.nodes.world.diagnostics import WorldDiagnostics
from uav_collect.nodes.world.mission import mission_msg, mission_summary, MissionInFlight
from uav_collect.nodes.world.own_policy import own_policy_msg
from uav_collect.nodes.world.publishers import ViewerPublisher, WorldPublishers
from uav_collect.nodes.world.recorders import WorldRecorders
from uav_collect.nodes.world.rivals import RivalWatch
from uav_collect.nodes.world.settings import PARAMETERS, read_settings
from uav_collect.planning.reach import take_off_lines
from uav_collect.recording.mission_folder import MissionFolder
from uav_collect.scenario.load import fingerprint, load
from uav_collect.scenario.site import build_site, Site
from uav_collect.uav.actions import check_can_start
from uav_collect.uav.briefing import briefing_of
from uav_collect.uav.policy import TOPIC
from uav_collect_msgs.msg import Mission, Policy
from uav_collect_msgs.srv import Join, Vouch

_DESCRIPTION = """
Simulates sensors, radio, flight and energy of a mission, hands each UAV's agent what it observes,
waits for its command, and relays the messages between UAVs. Waits for the whole fleet, flies
its missions, writes their logs and exits.
"""
_TICK_S = 0.005
_MOST_CLOCK_S = 2.0**31 - 1e6  # ROS counts seconds in 32 bits
_WAITING_PERIOD_S = 5.0  # between two lines that say for whom the world waits
_OTHER_WORLD_S = 0.5  # how long a starting world listens for one that is there already
_GATHER_S = 3.0  # for agents to join a world, once it can be asked, that does not wait for all


class WorldNode(ProcessNode):
    """Converts messages, asks the mission in flight, publishes what it answers."""

    def __init__(self, world: str = '') -> None:
        """Read the scenario; the world opens when no other one of its name answers."""
        super().__init__('world_sim', namespace=world)
        self._names = topics.world_topics(topics.world_of(self.get_namespace()))
        self._settings = settings = read_settings(self)
        try:
            scenario = load(settings.scenario)
            self.site: Site = build_site(scenario)
            briefing = briefing_of(self.site)
            check_can_start(scenario, briefing)
            self._folder = MissionFolder(settings.output_dir)
        except ConfigError as error:
            raise NodeError(str(error)) from error
        except (OSError, RecordingError) as error:
            raise NodeError(f'output_dir: {error}') from error
        self._identity = WorldIdentity(started_s=time.time(), instance=settings.world_instance)
        self.roster = Roster(scenario.n_uavs)
        self._policies = PolicyStore(briefing)
        self._own_policy = own_policy_msg(settings.scenario, briefing, self.get_logger().warning)
        first_seed = settings.seed if settings.missions else None
        self._schedule = MissionSchedule(n_missions=settings.missions, next_seed=first_seed)
        self._pacer = SimulationPacer(settings.real_time_factor)
        self._steering = Steering(self._schedule, self._pacer, settings.decision_timeout_s)
        self.mission: MissionInFlight | None = None
        self._clock_s = 0.0  # simulated time of all missions before
        self._begun_s = time.monotonic()
        self._is_stopping = False
        self._logged_s = 0.0
        self._logged_missing: list[int] = []
        self._diagnostics = WorldDiagnostics(self, self._names.namespace)
        self._rivals = RivalWatch(self, self._names.scenario, self._identity)
        self.create_timer(_TICK_S, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def on_stop(self) -> None:
        """Abort the mission in flight, and keep what is known of it."""
        self._is_stopping = True
        self.abort('the world was stopped')
        if self._rivals.is_open:
            self._control.close()

    def _open(self) -> None:
        self._rivals.is_open = True
        self._gathering_since_s = time.monotonic()
        instance = self._identity.instance
        self._n_served = 0  # UAVs whose topics there are
        self._pubs = WorldPublishers(self, self._names)
        serve(self, Join, self._names.join_service, self._on_join)
        self._viewers = ViewerPublisher(self, self._names, self._settings)
        warn = self._diagnostics.warn
        self._recorders = WorldRecorders(self, self._names, self._settings, instance, warn)
        subscribe_to_trainers(self, self._policies, partial(warn, 'policy refused'))
        self._vouch_service = f'{self._names.vouch_prefix}{self._identity.short}'
        serve(self, Vouch, self._vouch_service, self._on_vouch)
        self._control = WorldControl(self, self, self._steering, self._names, instance)
        self._present_scenario()

    def _present_scenario(self) -> None:
        """Serve the fleet of the scenario, and say what it is."""
        site, scenario = self.site, self.site.scenario
        for uav in range(self._n_served + 1, scenario.n_uavs + 1):
            self._pubs.add_uav(uav)
            self._subscribe_to_agent(uav, self._names.uav(uav))
        self._n_served = max(self._n_served, scenario.n_uavs)
        self._fingerprint = fingerprint(scenario)
        self._recorders.await_scenario(self._fingerprint)
        self._viewers.show(site)
        lost = self._folder.keep_scenario(scenario.to_yaml(), self._fingerprint)
        self._diagnostics.warn_if_lost(lost)
        self._pubs.publish_scenario(scenario_msg(self._identity, site, self._vouch_service))
        for line in take_off_lines(site):
            self.get_logger().info(line)

    def _subscribe_to_agent(self, uav: int, own: topics.UavTopics) -> None:
        watch = SubscriptionEventCallbacks(
            liveliness=lambda event: self._on_liveliness(uav, event)
        )
        subscription(self, own.command, lambda msg: self._on_command(uav, msg), on_event=watch)
        subscription(self, own.radio_tx, lambda msg: self._on_radio(uav, msg))

    def _on_join(self, request: Any, response: Any) -> Any:
        response.world_instance = self._identity.instance
        if request.world_instance != self._identity.instance:
            response.retry = True  # it asked another world, and may have found this one by now
            response.reason = 'it asked to join another world'
            return response
        if request.scenario_fingerprint not in ('', self._fingerprint):
            response.retry = True  # it will hear of this world's
            response.reason = f'another scenario is flown, {self.site.scenario.name}'
            return response
        problem = join_problem(request)
        if problem is not None:
            response.reason = problem
            self._diagnostics.warn('join refused', f'a request to join is refused: {problem}')
            return response
        pilot = convert.pilot_from_request(request)
        if pilot.policy == BEST:  # it is to choose, and joins when it has
            response.waits_for_policy, response.policy = True, self._own_policy
            return response
        response.waits_for_policy = pilot.policy == TOPIC and self._policies.latest is None
        if response.waits_for_policy:
            return response
        answer = self.roster.join(pilot)
        response.accepted, response.retry = answer.accepted, answer.retry
        response.reason = answer.reason
        if not answer.accepted:
            text = f'UAV {pilot.uav}: {pilot} refused: {answer.reason}'
            self._diagnostics.warn('join refused', text)
            return response
        response.mission_id = self._identity.mission_id(self._schedule.n_started)
        if self.mission is not None:
            self.mission.fill_history(response, pilot)
        elif self._policies.latest is not None and pilot.policy == TOPIC:
            response.policy = self._policies.latest.message
        return response

    def _on_vouch(self, request: Any, response: Any) -> Any:
        response.world_instance = self._identity.instance
        response.is_own = self._identity.owns(request.mission_id, self._schedule.n_started)
        response.scenario_fingerprint = self._fingerprint
        return response

    def _on_liveliness(self, uav: int, event: Any) -> None:
        if event.alive_count > 0:
            given_up = self.roster.mark_alive(
                uav, is_back=event.alive_count_change > 0 > event.not_alive_count_change
            )
            if given_up is not None:  # it may not know, and would wait to be asked
                why = 'it was thought to be gone'
                refusal = convert.refusal_of_greeting(given_up.instance, why, self._now())
                self._pubs.publish_refusal(uav, refusal)
            return
        lost = self.roster.mark_gone(uav)
        if lost is not None:
            self._say_lost(lost)

    def _say_lost(self, lost: Pilot) -> None:
        self._diagnostics.warn('agent lost', f'UAV {lost.uav}: its agent is gone, {lost}')

    def _on_greeting(self, uav: int, msg: Any) -> None:
        """Let the agent fly that has joined and shows now that it is there."""
        was_flown = self.roster.is_flown_by(uav, msg.agent_instance)
        was_present = uav not in self.roster.missing()
        answer = self.roster.greet(uav, msg.agent_instance, time.monotonic())
        if not answer.accepted:
            self._refuse(uav, convert.GREETING, msg, answer.reason)
        elif not (was_flown and was_present):
            pilot = self.roster.pilots[uav]
            self.get_logger().info(
                f'UAV {uav}: {pilot} joined, policy {pilot.policy}, bandwidth {pilot.allocator}'
            )

    # What agents and people send.

    def _on_command(self, uav: int, msg: Any) -> None:
        mission = self.mission
        if convert.is_greeting(msg):
            self._on_greeting(uav, msg)
            return
        if mission is None or msg.mission_id != mission.mission_id:
            refusal: str | None = self._identity.refusal_of(msg.mission_id, msg.decision)
        elif not self.roster.is_flown_by(uav, msg.agent_instance):
            refusal = 'it is not from the agent that flies this UAV'
        else:
            refusal = mission.accept_command(uav, msg)
        if refusal is not None:
            self._refuse(uav, 'command', msg, refusal)
        elif mission is not None:
            self._carry_out(mission)

    def _on_radio(self, uav: int, msg: Any) -> None:
        mission = self.mission
        if mission is None or msg.mission_id != mission.mission_id:
            refusal: str | None = self._identity.refusal_of(msg.mission_id, msg.sequence)
        else:
            refusal = mission.accept_radio(uav, msg)
        if refusal is not None:
            self._refuse(uav, 'radio message', msg, refusal)
        elif mission is not None:
            self._carry_out(mission)

    # What people ask, by way of its control.

    def fly_over(self, site: Site) -> None:
        """Take another scenario; its agents have to join anew."""
        self.site, self._own_policy = site, Policy()  # beside a text or a shipped file lies none
        self.roster.change_fleet(site.scenario.n_uavs)
        self._gathering_since_s = time.monotonic()
        for refusal in self._policies.recheck(briefing_of(site)):
            self._diagnostics.warn('policy refused', refusal)
        self._present_scenario()

    def abort(self, note: str) -> None:
        """End the mission in flight, if there is one."""
        self._end_mission(Mission.ABORTED, note)

    def go_on(self) -> None:
        """Do what may happen now, and be patient with agents anew."""
        self._steering.ask()
        self._advance()

    # The mission.

    def _tick(self) -> None:
        now_s = time.monotonic()
        self._steering.look(now_s)
        if self._is_stopping or now_s - self._begun_s < _OTHER_WORLD_S:
            return
        if self._rivals.gives_way:
            self._diagnostics.publish(self.roster, self.mission)
            self.end(FAILED)
            return
        if not self._rivals.is_open:
            if not self._rivals.is_waiting:
                self._open()
            return
        for lost in self.roster.remove_silent(now_s):
            self._say_lost(lost)
        if self.mission is not None:
            self._keep_time(self.mission)
        elif self._schedule.next_seed is None:
            self._recorders.rest()
        elif self._is_fleet_ready(now_s):
            self._start_mission()
        self._control.inform(now_s)
        if self._diagnostics.is_due(now_s):
            self._diagnostics.publish(self.roster, self.mission)

    def _is_fleet_ready(self, now_s: float) -> bool:
        missing = self.roster.missing()
        has_gathered = (
            not self._settings.wait_for_agents and now_s - self._gathering_since_s > _GATHER_S
        )
        if not missing or has_gathered:
            return self._recorders.are_ready(self.roster.present, now_s)
        self._recorders.rest()
        if missing != self._logged_missing or now_s - self._logged_s > _WAITING_PERIOD_S:
            self._logged_missing, self._logged_s = missing, now_s
            self.get_logger().info(f'waiting for {", ".join(f"UAV {uav}" for uav in missing)}')
        return False

    def _start_mission(self) -> None:
        if self._clock_s > _MOST_CLOCK_S:
            self.get_logger().error('the clock of ROS has no room for more missions: start anew')
            self.end(FAILED)
            return
        mission_id = self._identity.mission_id(self._schedule.n_started)
        seed = self._schedule.start_next()
        self.roster.begin_mission()
        pilots = self.roster.flying
        mission = MissionInFlight(
            self.site,
            seed,
            mission_id=mission_id,
            pilots=pilots,
            policy=self._policies.latest,
            clock_start_s=self._clock_s,
        )
        self.mission = mission
        self._steering.begin()
        self._control.goals.begin()
        index, versions = self._schedule.n_started - 1, mission.policy_versions
        self._diagnostics.warn_if_lost(self._folder.begin(mission.header, index, versions))
        self._publish_mission(mission, Mission.STARTED)
        self.get_logger().info(f'mission {mission.mission_id} starts, seed {seed}')
        self._viewers.begin(mission.simulation, mission.clock_start_s)
        self._advance()

    def _advance(self) -> None:
        """Go on until an agent has to answer, or the time of the next event has not come."""
        while self.mission is not None and self.mission.pending is None:
            mission, event = self.mission, self.mission.next_event()
            time_s = mission.simulation.end_s if event is None else event.view.time_s
            if not self._steering.lets_pass(time_s):
                self._publish_radio(mission)
                if self._steering.is_paused:  # all of the latest event is to be seen
                    self._close_event(mission)
                return
            if event is None:
                self._publish_event(mission)
                self._end_mission(Mission.ENDED, mission.failsafe_note)
            elif 0 < self._settings.max_decisions < mission.n_decisions:
                self._publish_event(mission)
                self._end_mission(Mission.ABORTED, 'cut off by max_decisions')
            elif event.is_gone or event.uav + 1 in mission.unflown:
                self._publish_event(mission)
                self._fly_home(mission, event)
            else:
                self._request_decision(mission, event)
                self._publish_event(mission)  # while the agent decides

    def _request_decision(self, mission: MissionInFlight, event: Event) -> None:
        """Publish what the deciding UAV hears and sees; its agent is to answer."""
        uav = event.uav + 1
        for message in mission.radio_before(event):
            self._pubs.publish_radio(uav, message)
        self._pubs.publish_observation(uav, mission.request_decision(event))
        self._steering.ask()
        self._pubs.publish_time(mission.clock_start_s + event.view.time_s, is_event=True)

    def _refuse(self, uav: int, what: str, msg: Any, why: str) -> None:
        """Say what is not done, and why: in the log, in diagnostics and to the agent."""
        self._diagnostics.warn(f'{what} refused', f'UAV {uav}: {what} refused: {why}')
        self._pubs.publish_refusal(uav, convert.refusal_msg(what, msg, why, self._now()))

    def _carry_out(self, mission: MissionInFlight) -> None:
        """Carry a decision out, once all that belongs to it has come."""
        if mission.pending is None or not mission.pending.is_answered:
            return
        event, decision = mission.pending.event, mission.pending.decision
        mission.carry_out()
        self._viewers.note_event(event, decision)
        self._advance()

    def _now(self) -> Time:
        """What the clock shows."""
        mission = self.mission
        if mission is None:
            return convert.stamp(self._clock_s)
        return mission.stamp(mission.time_s)

    def _fly_home(self, mission: MissionInFlight, event: Event) -> None:
        has_agent = event.uav + 1 not in mission.unflown
        decision = mission.fly_home(event)
        if has_agent:
            self._pubs.publish_observation(event.uav + 1, mission.final_observation(event))
        self._viewers.note_event(event, decision)

    def _keep_time(self, mission: MissionInFlight) -> None:
        """See to what is due: the clock, viewers, an agent that has not answered in time."""
        time_s = mission.time_s
        if not self._pacer.is_unlimited:
            time_s = self._pacer.pass_until(mission.next_time_s)
            self._pubs.publish_time(mission.clock_start_s + time_s)
        self._viewers.publish(time_s)
        if mission.pending is not None and self._steering.is_overdue():
            event = mission.pending.event
            text = f'UAV {event.uav + 1}: no answer to decision {event.decision} within'
            limit = f'{self._steering.decision_timeout_s:g} s'
            self._diagnostics.warn('failsafe', f'{text} {limit}; the failsafe flies it home')
            self._fly_home(mission, event)
        self._advance()

    def _publish_radio(self, mission: MissionInFlight) -> None:
        """Publish what UAVs have heard since they were asked last."""
        for hearer, message in mission.undelivered():
            self._pubs.publish_radio(hearer, message)

    def _publish_event(self, mission: MissionInFlight) -> None:
        """Publish what the others heard, and what the latest event was."""
        self._publish_radio(mission)
        self._close_event(mission)
        self._viewers.publish_until(mission.next_time_s)

    def _close_event(self, mission: MissionInFlight) -> None:
        """Publish and log the latest event, unless that is done."""
        closed = mission.closed_event()
        if closed is not None:
            epoch, event, faults = closed
            self._pubs.publish_epoch(epoch)
            self._diagnostics.warn_if_lost(self._folder.append(event, faults))

    def _publish_mission(self, mission: MissionInFlight, phase: int, note: str = '') -> Mission:
        index = self._schedule.n_started - 1
        message = mission_msg(mission, self._identity.instance, index, phase)
        message.note = note
        self._pubs.publish_mission(message)
        return message

    def _end_mission(self, phase: int, note: str) -> None:
        mission, self.mission = self.mission, None
        if mission is None:
            return
        self._close_event(mission)  # the figures count it
        self.roster.end_mission()
        self._folder.end()
        message = self._publish_mission(mission, phase, note)
        end_s = mission.simulation.end_s
        self._viewers.publish_end(end_s)
        self._clock_s += end_s
        self._pubs.publish_time(self._clock_s, is_event=True)
        self.get_logger().info(mission_summary(message))
        self._control.goals.end(message)
        self._schedule.plan_after(mission.seed)
        if self._schedule.is_over:
            self._diagnostics.publish(self.roster, self.mission)
            self.end()


def main(argv: Sequence[str]) -> int:
    """Run the world node; the exit status."""
    parser = Parser(
        prog='world_sim',
        description=wrapped(_DESCRIPTION),
        epilog=help_text(PARAMETERS),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_world_option(parser)
    arguments = parse_arguments(parser, argv)
    return run_node(lambda: WorldNode(arguments.world), argv)

"""Flies missions by processes as users start them, and the same missions in this process.

The processes must leave the very bytes that the function `logs` gives.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from processes import DEADLINE_S, Processes, RunningProcess, wait_until
from uav_collect.limits import GUARD_AFTER
from uav_collect.missions.event_log import mission_header
from uav_collect.missions.rollout import fly
from uav_collect.missions.simulation import Event, Simulation
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav import action_codes
from uav_collect.uav.agent import Agent, allocator_named
from uav_collect.uav.messages import Decision, RadioMessage
from uav_collect.uav.policy import guard_for, policy_for

_SPEEDS_MPS = (5.0, 10.0, 7.5, 12.5)
_LISTEN_S = 0.02


def scenario_of(n_uavs: int = 2, **overrides: object) -> Scenario:
    """The paper's scenario with so many UAVs; a double underscore stands for a dot of a path."""
    fleet = [{'speed_mps': speed_mps} for speed_mps in _SPEEDS_MPS[:n_uavs]]
    dotted = {name.replace('__', '.'): value for name, value in overrides.items()}
    return load('paper_10x10', {'fleet.uavs': fleet, **dotted})


def logs(
    scenario: Scenario,
    seeds: Sequence[int],
    policy: str = 'sweep',
    allocator: str = 'exact',
    guard_after: int = GUARD_AFTER,
) -> list[bytes]:
    """The logs of missions flown in this process."""
    flown = fly(build_site(scenario), seeds, policy, allocator, guard_after)
    return [log.to_jsonl() for log in flown]


def stamp_s(stamp: Any) -> float:  # noqa: ANN401 - Time of builtin_interfaces
    """The time of a message [s]."""
    return float(stamp.sec + 1e-9 * stamp.nanosec)


FAILSAFE = Decision(action=action_codes.HOME, reason=action_codes.FAILSAFE)


def flown_without(
    scenario: Scenario, seed: int, policy: str, *, uav: int, since: int
) -> MissionLog:
    """A mission in which a UAV, by index, has no agent from one of its decisions on."""
    pilots = Pilots(scenario, seed, policy)
    simulation = pilots.simulation
    while (event := simulation.next_event()) is not None:
        is_lost = event.uav == uav and event.decision >= since
        simulation.start(event, FAILSAFE if is_lost else pilots.decide(event))
    n_uavs = scenario.n_uavs
    pilots_of = [policy] * n_uavs, ['exact'] * n_uavs, [action_codes.NONE] * n_uavs
    return simulation.log(mission_header(scenario, seed, simulation.demand_bit, *pilots_of))


class Pilots:
    """The agents of one mission in this process, guarded as users' are."""

    def __init__(self, scenario: Scenario, seed: int, policy: str) -> None:
        self.simulation = Simulation(build_site(scenario), seed)
        briefing, allocator = self.simulation.briefing, allocator_named('exact')
        policies = [policy_for(policy, scenario) for _ in range(scenario.n_uavs)]
        guards = [guard_for(each, GUARD_AFTER, briefing) for each in policies]
        self.agents = [
            Agent(briefing, uav, each, allocator, guard_after=guard)
            for uav, (each, guard) in enumerate(zip(policies, guards, strict=True))
        ]
        self.radio: list[list[RadioMessage]] = [[] for _ in self.agents]  # heard, by UAV

    def decide(self, event: Event) -> Decision:
        """What the deciding UAV does after it has seen and exchanged; it does not start it."""
        agent, simulation = self.agents[event.uav], self.simulation
        for message in event.heard:
            self._hear(event.uav, message)
        agent.observe(event.view)
        for hearer in simulation.transmit(event.uav, agent.belief.complete):
            self._hear(hearer, simulation.radio(event.uav))
        return agent.decide(event.view)

    def _hear(self, uav: int, message: RadioMessage) -> None:
        self.agents[uav].hear(message)
        self.radio[uav].append(deepcopy(message))  # the sender's map goes on changing


def parameters(**values: object) -> list[str]:
    """ROS parameters as command line arguments."""
    words = {
        name: str(value).lower() if isinstance(value, bool) else value
        for name, value in values.items()
    }
    return ['--ros-args', *(word for each in words for word in ('-p', f'{each}:={words[each]}'))]


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """The processes that fly one scenario; logs go to the folder."""

    processes: Processes
    scenario: Scenario
    folder: Path
    world: str = ''  # its name, if it has one

    def start_world(self, **values: object) -> RunningProcess:
        """Start the world with parameters.

        Unless they say otherwise it waits for agents and recorders however slow they are.
        """
        file = self.folder.with_suffix('.yaml')
        file.write_text(self.scenario.to_yaml())
        patient = {'decision_timeout_s': DEADLINE_S, 'recorder_timeout_s': DEADLINE_S}
        values = {'scenario': file, 'output_dir': self.folder, **patient, **values}
        return self.processes.start('world_sim', *self._named(), *parameters(**values))

    def start_agent(
        self, uav: int, policy: str = 'sweep', allocator: str = 'exact', **values: object
    ) -> RunningProcess:
        """Start the agent of a UAV with flags and parameters."""
        flags = ['--id', str(uav), '--policy', policy, '--bandwidth', allocator]
        return self.processes.start('uav_agent', *self._named(), *flags, *parameters(**values))

    def start_agents(
        self, policy: str = 'sweep', allocator: str = 'exact', **values: object
    ) -> list[RunningProcess]:
        """Start the agents of all UAVs."""
        uavs = range(1, self.scenario.n_uavs + 1)
        return [self.start_agent(uav, policy, allocator, **values) for uav in uavs]

    def start_recorder(self, **values: object) -> RunningProcess:
        """Start the recorder and wait until it records."""
        flags = [*self._named(), '--output', str(self.bag)]
        recorder = self.processes.start('recorder', *flags, *parameters(**values))
        recorder.wait_for('recording .* topics')
        return recorder

    def _named(self) -> list[str]:
        return ['--world', self.world] if self.world else []

    @property
    def bag(self) -> Path:
        """What the recorder writes."""
        return self.folder.with_name(f'{self.folder.name}_bag')

    def log_file(self, seed: int) -> Path:
        """The log of a mission."""
        return self.folder / f'mission_{seed}.jsonl'

    def log(self, seed: int) -> bytes:
        """What the world has written of a mission."""
        return self.log_file(seed).read_bytes()

    def logs(self, seeds: Sequence[int]) -> list[bytes]:
        """What the world has written of missions."""
        return [self.log(seed) for seed in seeds]

    def n_events(self, seed: int) -> int:
        """How many events of a mission the world has logged."""
        file = self.log_file(seed)
        return max(0, file.read_bytes().count(b'\n') - 1) if file.exists() else 0

    def wait_for_events(self, seed: int, n_events: int) -> None:
        """Wait until so many events of a mission are logged.

        Raises:
            AssertionError: they were not in time; with what the processes wrote.
        """
        try:
            wait_until(lambda: self.n_events(seed) >= n_events)
        except AssertionError as error:
            count = f'{self.n_events(seed)} events of {n_events} {error}'
            raise AssertionError(f'{count}\n{self.processes.outputs()}') from None


class Listener:
    """A node of the test that keeps what it hears."""

    def __init__(self, node: Any, executor: Any, heard: dict[str, list[Any]]) -> None:  # noqa: ANN401
        self.node = node
        self._executor = executor
        self.heard = heard  # messages by topic, in order

    def wait_until(self, condition: Callable[[], bool]) -> None:
        """Listen until something holds.

        Raises:
            AssertionError: it did not in time.
        """
        wait_until(condition, meanwhile=lambda: self._executor.spin_once(timeout_sec=_LISTEN_S))


@contextmanager
def listener(*topics: Any) -> Iterator[Listener]:  # noqa: ANN401
    """Listen to topics of the table in the ROS domain of the test."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from uav_collect.nodes.middleware import use_quick_discovery

    use_quick_discovery()
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node('listener', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    heard: dict[str, list[Any]] = {topic.name: [] for topic in topics}
    for topic in topics:
        node.create_subscription(topic.message, topic.name, heard[topic.name].append, topic.qos)
    try:
        yield Listener(node, executor, heard)
    finally:  # else a test that fails would publish on, in a domain that another one takes
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()

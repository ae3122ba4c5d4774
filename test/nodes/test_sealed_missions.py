"""Whoever has not got the key steers nothing: one mission among forgers, and its outcome."""

from collections import defaultdict
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatch
from functools import partial
from pathlib import Path
import signal
from typing import Any

import pytest

for needed in ('rclpy', 'uav_collect_msgs'):
    pytest.importorskip(needed)

from fleets import Fleet, Listener, listener, logs, scenario_of
from node_starts import refusal
from processes import (
    DEADLINE_S,
    Processes,
    ros_environment,
    RunningProcess,
)
from rcl_interfaces.srv import SetParameters
from rclpy.duration import Duration
from rclpy.node import NodeNameNonExistentError
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from ros_domains import own_domain
from uav_collect.limits import FAILED
from uav_collect.lockstep.seals import KEY_FILE, read_secret
from uav_collect.nodes import topics
from uav_collect.nodes.process import ProcessNode
from uav_collect.nodes.sealing import has_seal, SealedClient, seals_of_bag
from uav_collect.recording.bag_messages import messages
from uav_collect.recording.bag_reader import read_missions
from uav_collect_msgs.msg import Policy, RecorderStatus, Refusal, Seal
from uav_collect_msgs.srv import ControlMission, Join

from tools import sros2_policy

pytestmark = pytest.mark.ros

SEED = 6
LONG_S = 300.0  # of simulated time, about what the mission takes
FLOWN_S = 6.0  # of wall-clock time
NO_SEAL = 'it has no seal'
WRONG_SEAL = 'its seal is not of this key, place and content'
REPETITION = 'a repetition'
PATIENT = ['--patience', str(DEADLINE_S)]
START = ControlMission.Request(command=ControlMission.Request.START, seed=SEED + 1)
PAUSE = ControlMission.Request(command=ControlMission.Request.PAUSE)
ABORT = ControlMission.Request(command=ControlMission.Request.ABORT)

ONE, OTHER = topics.uav_topics(1), topics.uav_topics(2)
# What the world, an agent and the recorder take from others, and who of them takes it.
TAKEN = {
    'world_sim': (ONE.command, ONE.radio_tx, topics.SCENARIO, topics.POLICY, topics.RECORDER),
    'uav_agent': (ONE.observation, ONE.radio_rx, ONE.refusal, topics.SCENARIO),
    'recorder': (topics.MISSION, topics.EPOCH, ONE.transition, topics.SCENARIO, ONE.command),
}
MADE = {
    ONE.refusal.name: Refusal(what='command', reason='none'),
    topics.RECORDER.name: RecorderStatus(recorder_instance='r', waits_for=['x']),
    topics.POLICY.name: Policy(version='v'),
}
ALL_TAKEN = {topic.name: topic for taken in TAKEN.values() for topic in taken}
VERBS = ('publishes', 'subscribes', 'serves', 'asks')
# Who is there as the graph is looked at, and what each could do besides: nobody else is there.
THERE = [f'/uav_collect/{name}' for name in ('world_sim', 'uav_1', 'uav_2', 'recorder')]
BESIDES = {
    '/uav_collect/world_sim asks': ['/world/vouch_*'],
    '/uav_collect/uav_1 subscribes': [topics.POLICY.name],
    '/uav_collect/uav_2 subscribes': [topics.POLICY.name],
}
FLOWN = ALL_TAKEN.keys() - MADE  # what is sent in any mission


class Forger(ProcessNode):
    """A node with a key, of the mission or another one."""

    def __init__(self, context: Any) -> None:  # noqa: ANN401
        super().__init__('forger', context=context)


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What is left of a mission among forgers."""

    fleet: Fleet
    processes: dict[str, RunningProcess]
    answers: dict[str, Any]  # of services, by who asked what
    key_file: Path
    graph: dict[str, set[str]]  # what nodes publish, hear, serve and ask


@pytest.fixture(scope='module')
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """A mission that was flown with a key, while others sent all that they can."""
    folder = tmp_path_factory.mktemp('sealed')
    key_file, other_file = folder / 'key', folder / 'other_key'
    for file in (key_file, other_file):
        file.write_bytes(file.name.encode() * 8)
        file.chmod(0o600)
    with own_domain() as domain, pytest.MonkeyPatch.context() as patch:
        environment = ros_environment(domain, folder / 'ros_log')
        for name, value in {**environment, KEY_FILE: str(key_file)}.items():
            patch.setenv(name, value)
        processes = Processes(folder, environment)
        try:
            flight = _Flight(processes, folder, other_file, patch)
            answers = flight.fly()
        finally:
            processes.close()
    return Outcome(
        fleet=flight.fleet,
        processes=flight.started,
        answers=answers,
        key_file=key_file,
        graph=flight.graph,
    )


class _Flight:
    """The fleet, those who forge its messages, and what they try."""

    def __init__(
        self, processes: Processes, folder: Path, other_file: Path, patch: pytest.MonkeyPatch
    ) -> None:
        self.processes, self._other_file, self._patch = processes, other_file, patch
        self.fleet = Fleet(processes=processes, scenario=scenario_of(), folder=folder / 'run')
        self.started: dict[str, RunningProcess] = {}
        self.graph: dict[str, set[str]] = {}
        self._raw: defaultdict[str, list[bytes]] = defaultdict(list)

    def fly(self) -> dict[str, Any]:
        """Fly and forge; what services answered."""
        fleet, started = self.fleet, self.started
        started['recorder'] = fleet.start_recorder(stop_after_missions=2)
        started['uav_agent'], other = fleet.start_agents(observation_layout='egocentric')
        started['world_sim'] = fleet.start_world(missions=0, real_time_factor=LONG_S / FLOWN_S)
        control = self.processes.start('control', 'start', '--seed', str(SEED), *PATIENT)
        with listener() as listening:
            self._tap(listening)
            started['control'] = control
            assert control.wait_for_exit() == 0
            fleet.wait_for_events(SEED, 8)
            nodes = self._nodes(listening)
            self._forge(listening, [nodes['none'], nodes['other key']])
            self._play_again(listening)
            other.kill()
            fleet.start_agent(2, observation_layout='egocentric')
            with suppress(AssertionError):  # what is not found in time is named by a test
                listening.wait_until(lambda: self._knows_graph(listening.node))
            answers = self._ask(listening, nodes)
            fault = ['--uav', '9', '--fault', 'gone']
            inject = self.processes.start('control', 'inject', *fault, *PATIENT)
            started['inject'] = inject
            assert inject.wait_for_exit() == 1
            listening.wait_until(lambda: 'ended after' in started['world_sim'].output)
            answers |= self._ask_again(listening, nodes['key'])
        # It may lack the last words of the agent that was killed.
        assert started['recorder'].wait_for_exit() in (0, FAILED)
        started['world_sim'].send(signal.SIGINT)
        assert started['world_sim'].wait_for_exit() == 0
        return answers

    def _knows_graph(self, node: Any) -> bool:  # noqa: ANN401
        """Whether all is discovered of the nodes that do all that they may."""
        self.graph = _graph(node)
        return len(self.graph) == len(THERE) * len(VERBS) and unused(self.graph) == BESIDES

    def _nodes(self, listening: Listener) -> dict[str, Any]:
        """A node of the test with no key, one with another key, and one with that of the fleet."""
        context = listening.node.context
        trusted = Forger(context)
        with self._patch.context() as patch:
            patch.setenv(KEY_FILE, str(self._other_file))
            foreign = Forger(context)
        for node in (trusted, foreign):
            listening._executor.add_node(node)
        return {'none': listening.node, 'other key': foreign, 'key': trusted}

    def _tap(self, listening: Listener) -> None:
        for topic in ALL_TAKEN.values():
            keep = self._raw[topic.name].append
            listening.node.create_subscription(
                topic.message, topic.name, keep, topic.qos, raw=True
            )

    def _sample(self, topic: Any) -> Any:  # noqa: ANN401
        """What is sent next on a topic, or as good as that."""
        if topic.name not in FLOWN:
            return MADE[topic.name]
        msg = deserialize_message(self._raw[topic.name][-1], topic.message)
        for name in ('decision', 'sequence', 'delivery', 'event'):
            if hasattr(msg, name):
                setattr(msg, name, getattr(msg, name) + 1)
        if hasattr(msg, 'phase'):
            msg.phase = 1  # the mission is over
        msg.seal = Seal()
        return msg

    def _forge(self, listening: Listener, nodes: Sequence[Any]) -> None:
        """Send what is due next on each topic, without a seal and with a wrong one."""
        listening.wait_until(lambda: all(self._raw[name] for name in FLOWN))
        forging = [
            (topics.publisher(node, topic), self._sample(topic))
            for node in nodes
            for topic in ALL_TAKEN.values()
        ]
        listening.wait_until(
            lambda: all(publisher.get_subscription_count() > 1 for publisher, _ in forging)
        )
        for publisher, sample in forging:
            publisher.publish(sample)
            publisher.publish(sample)
        for publisher, _ in forging:
            assert publisher.wait_for_all_acked(Duration(seconds=DEADLINE_S))

    def _play_again(self, listening: Listener) -> None:
        """Send again what was sent, where it was sent and elsewhere."""
        for topic in (ONE.command, ONE.radio_rx, topics.SCENARIO, topics.MISSION):
            publisher = topics.publisher(listening.node, topic)
            for content in self._raw[topic.name][:2]:
                publisher.publish(content)
            assert publisher.wait_for_all_acked(Duration(seconds=DEADLINE_S))
        elsewhere = topics.publisher(listening.node, OTHER.radio_tx)
        elsewhere.publish(self._raw[ONE.radio_tx.name][-1])
        assert elsewhere.wait_for_all_acked(Duration(seconds=DEADLINE_S))

    def _ask(self, listening: Listener, nodes: dict[str, Any]) -> dict[str, Any]:
        answers = {}
        world = deserialize_message(
            self._raw[topics.SCENARIO.name][0], topics.SCENARIO.message
        ).world_instance
        join = Join.Request(world_instance=world, uav=1, agent_instance='forged', policy='sweep')
        for who in ('none', 'other key'):
            ask = partial(_answer, listening, nodes[who])
            answers[f'{who}: abort'] = ask(ControlMission, topics.CONTROL_SERVICE, ABORT, world)
            answers[f'{who}: join'] = ask(Join, topics.JOIN_SERVICE, join, '')
        ask = partial(_answer, listening, nodes['key'])
        of_old = ask(ControlMission, topics.CONTROL_SERVICE, ABORT, 'a world that was here before')
        answers['key: abort of an old world'] = of_old
        self._world_instance = world
        change = Parameter('decision_timeout_s', value=0.1).to_parameter_msg()
        request = SetParameters.Request(parameters=[change])
        answers['parameter'] = _answer(
            listening, nodes['none'], SetParameters, '/world_sim/set_parameters', request, ''
        )
        return answers

    def _ask_again(self, listening: Listener, node: Any) -> dict[str, Any]:  # noqa: ANN401
        """Let a request of a trusted node be heard by another one, who sends it again."""
        sent: list[Any] = []
        own, instance = (ControlMission, topics.CONTROL_SERVICE), self._world_instance
        _answer(listening, node, *own, PAUSE, instance)  # to be in time for an abort
        first = _answer(listening, node, *own, START, instance, sent=sent)
        # What was only about to start, the recorder never hears of.
        world = self.started['world_sim']
        listening.wait_until(lambda: world.output.count(' starts, seed ') == 2)
        second = _answer(listening, node, *own, ABORT, instance)
        again = _answer(listening, listening.node, *own, sent[0], '')
        return {'key: start': first, 'key: abort': second, 'start again': again}


def _answer(
    listening: Listener,
    node: Any,  # noqa: ANN401
    service_type: Any,  # noqa: ANN401
    service: str,
    request: Any,  # noqa: ANN401
    context: str,
    sent: list[Any] | None = None,
) -> Any:  # noqa: ANN401
    """What a service answers to a node."""
    client, call = None, None
    if isinstance(node, Forger):
        sealing = SealedClient(node, service_type, service)
        client, asked = sealing.client, sealing.client.call_async

        def keep(message: Any) -> Any:  # noqa: ANN401
            if sent is not None:
                sent.append(message)
            return asked(message)

        client.call_async = keep
        call = partial(sealing.call, request, lambda _: None, context)
    else:
        client = node.create_client(service_type, service)
        call = partial(client.call_async, request)
    listening.wait_until(client.service_is_ready)
    future = call()
    listening.wait_until(future.done)
    return future.result()


def _graph(node: Any) -> dict[str, set[str]]:  # noqa: ANN401
    """What the nodes of a fleet publish, hear, serve and ask."""
    found = {}
    for role in sros2_policy.roles(2):
        for verb, names_of in zip(
            VERBS,
            (
                node.get_publisher_names_and_types_by_node,
                node.get_subscriber_names_and_types_by_node,
                node.get_service_names_and_types_by_node,
                node.get_client_names_and_types_by_node,
            ),
            strict=True,
        ):
            with suppress(NodeNameNonExistentError):  # no trainer, no viewer
                named = names_of(role.node, role.namespace)
                found[f'{role.enclave} {verb}'] = {name for name, _ in named}
    return found


def allowed() -> dict[str, list[str]]:
    """Patterns of what each node may publish, hear, serve and ask."""
    return {
        f'{role.enclave} {verb}': [
            *getattr(role, verb),
            *sros2_policy.of_every_node(role, verb),
        ]
        for role in sros2_policy.roles(2)
        for verb in VERBS
    }


def unused(graph: dict[str, set[str]]) -> dict[str, list[str]]:
    """The patterns of what nodes may do and do not, of those that are there."""
    may = allowed()
    left = {
        key: [each for each in may[key] if not any(fnmatch(it, each) for it in used)]
        for key, used in graph.items()
    }
    return {key: patterns for key, patterns in left.items() if patterns}


def test_sros2_lets_every_node_do_what_it_does_and_no_more(outcome: Outcome) -> None:
    may = allowed()
    for who in THERE:
        for key in (f'{who} {verb}' for verb in VERBS):
            used = outcome.graph[key]
            assert [it for it in used if not any(fnmatch(it, each) for each in may[key])] == []
    assert unused(outcome.graph) == BESIDES


def test_the_fleet_flies_as_if_nobody_had_sent_anything_with_an_agent_that_was_restarted(
    outcome: Outcome,
) -> None:
    assert outcome.fleet.log(SEED) == logs(outcome.fleet.scenario, [SEED])[0]


@pytest.mark.parametrize('process', TAKEN)
@pytest.mark.parametrize('why', [NO_SEAL, WRONG_SEAL])
def test_what_has_no_seal_of_the_key_is_refused(outcome: Outcome, process: str, why: str) -> None:
    output = outcome.processes[process].output
    for topic in TAKEN[process]:
        assert f'{topic.name}: a message is refused: {why}' in output


def test_what_was_sent_once_is_refused_when_it_comes_again(outcome: Outcome) -> None:
    for process, topic in (('world_sim', ONE.command), ('uav_agent', ONE.radio_rx)):
        lines = outcome.processes[process].output.splitlines()
        assert any(topic.name in line and REPETITION in line for line in lines)


def test_what_one_uav_sent_is_refused_as_from_another(outcome: Outcome) -> None:
    refused = f'{OTHER.radio_tx.name}: a message is refused: {WRONG_SEAL}'
    assert refused in outcome.processes['world_sim'].output


@pytest.mark.parametrize(
    ('asked', 'why'),
    [
        ('none: abort', NO_SEAL),
        ('other key: abort', WRONG_SEAL),
        ('key: abort of an old world', WRONG_SEAL),
        ('start again', REPETITION),
    ],
)
def test_a_world_is_controlled_with_the_key_alone(outcome: Outcome, asked: str, why: str) -> None:
    assert not outcome.answers[asked].success
    assert why in outcome.answers[asked].message


@pytest.mark.parametrize(
    ('asked', 'why'), [('none: join', NO_SEAL), ('other key: join', WRONG_SEAL)]
)
def test_nobody_joins_without_the_key(outcome: Outcome, asked: str, why: str) -> None:
    assert not outcome.answers[asked].accepted
    assert why in outcome.answers[asked].reason


def test_who_has_the_key_controls_the_world(outcome: Outcome) -> None:
    assert 'a mission starts when the fleet is complete' in outcome.processes['control'].output
    assert outcome.answers['key: start'].success
    assert outcome.answers['key: abort'].success


def test_who_has_the_key_is_heard_when_it_injects_a_fault(outcome: Outcome) -> None:
    answers = 'uav is 9: must be from 1 to 2', 'there is no mission in flight'
    assert any(answer in outcome.processes['inject'].output for answer in answers)


def test_no_parameter_is_changed(outcome: Outcome) -> None:
    assert not outcome.answers['parameter'].results[0].successful


def test_a_recording_holds_what_was_sealed_and_nothing_else(outcome: Outcome) -> None:
    mission, *_ = read_missions(outcome.fleet.bag)  # of the next one, perhaps its start
    assert mission.is_complete is (outcome.processes['recorder'].wait_for_exit() == 0)
    assert mission.log.to_jsonl() == outcome.fleet.log(SEED)
    secret = read_secret({KEY_FILE: str(outcome.key_file)})
    node = type('Node', (), {'secret': secret, 'warn': pytest.fail})()
    checked = {it.name for it in topics.fleet_topics(2) if has_seal(it.message)}
    is_sealed = seals_of_bag(node, outcome.fleet.bag)
    recorded = list(messages(outcome.fleet.bag, checked.__contains__, is_sealed))
    assert len(recorded) > 300


def test_learners_refuse_what_was_recorded_without_the_key(outcome: Outcome) -> None:
    refused: list[str] = []
    secret = read_secret({KEY_FILE: str(outcome.key_file.with_name('other_key'))})
    node = type('Node', (), {'secret': secret, 'warn': lambda _, *text: refused.append(text)})()
    seals = seals_of_bag(node, outcome.fleet.bag)
    assert list(messages(outcome.fleet.bag, lambda name: 'epoch' in name, seals)) == []
    assert WRONG_SEAL in refused[0][1]


@pytest.mark.parametrize('room', ['world', 'agent', 'recorder', 'control'])
def test_a_node_whose_key_cannot_be_read_does_not_start(
    room: str, ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    arguments = {'agent': ['--id', '1'], 'control': ['abort']}.get(room, [])
    missing = str(tmp_path / 'missing')
    monkeypatch.setenv(KEY_FILE, missing)
    assert refusal(room, arguments, capsys) == [
        f"error: {KEY_FILE}: [Errno 2] No such file or directory: '{missing}'"
    ]


def test_without_a_key_a_node_says_so_and_a_loose_one_is_named(
    processes: Processes, tmp_path: Path
) -> None:
    without = processes.start('world_sim')
    without.wait_for(f'{KEY_FILE} is not set: anyone in this ROS domain can steer')
    file = tmp_path / 'key'
    file.write_bytes(b'k' * 32)
    file.chmod(0o644)
    loose = processes.start('world_sim', '--world', 'a', **{KEY_FILE: str(file)})
    loose.wait_for(f'only who has the key of {file} can steer')
    loose.wait_for(f'{file} is open to other users: chmod 600 {file}')

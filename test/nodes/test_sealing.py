"""What nodes seal is taken by who checks it, as it was sent and nothing else."""

from array import array
from collections.abc import Callable
import math
from pathlib import Path
import re
from typing import Any

import numpy as np
import pytest

for needed in ('rclpy', 'uav_collect_msgs'):
    pytest.importorskip(needed)

from rclpy.serialization import deserialize_message, serialize_message
from uav_collect.lockstep.seals import Checker, KEY_FILE, read_secret, SEAL_BYTE, Secret
from uav_collect.nodes import sealing, topics
from uav_collect_msgs.msg import Command, Observation, RadioMessage
from uav_collect_msgs.srv import ControlMission, Join, Vouch

pytestmark = pytest.mark.ros

KEY = b'a key of 24 random bytes'
SECRET = Secret(key=KEY, file=Path('key'), is_readable_by_others=False)
SECURITY = Path(__file__).parents[2] / 'docs' / 'security.md'


class Node:
    """What sealing needs of a node, with a service in reach."""

    secret = SECRET

    def __init__(self, serve: Callable[[Any], Any] | None = None) -> None:
        self.warned: list[str] = []
        self.answer: Callable[[Any, Any], Any] | None = None
        self._serve = serve

    def warn(self, kind: str, text: str) -> None:
        assert kind == 'seal refused'
        self.warned.append(text)

    def create_client(self, service_type: Any, name: str) -> Any:  # noqa: ANN401
        return self

    def create_service(self, service_type: Any, name: str, callback: Any) -> None:  # noqa: ANN401
        self.answer = callback

    def call_async(self, request: Any) -> Any:  # noqa: ANN401
        """Ask the service, over the wire, and have the answer."""
        assert self._serve is not None
        response = over_the_wire(self._serve(over_the_wire(request)))
        future = type('Future', (), {'result': lambda _: response})()
        future.add_done_callback = lambda callback: callback(future)
        return future


def over_the_wire(msg: Any) -> Any:  # noqa: ANN401
    return deserialize_message(serialize_message(msg), type(msg))


def asked(
    service_type: Any,  # noqa: ANN401
    request: Any,  # noqa: ANN401
    *,
    context: str = '',
    served_context: str = '',
    on_the_way: Callable[[Any], Any] = lambda msg: msg,
) -> tuple[Any, Node]:
    """What a client gets that asks a service, and the node of the service."""
    server = Node()

    def reply(request: Any, response: Any) -> Any:  # noqa: ANN401
        if isinstance(response, Join.Response):
            response.observations = [Observation(mission_id='m', region_demand_bit=[math.nan] * 9)]
            response.radio = [RadioMessage(complete=array('B', [1, 2, 3]))]
        return response

    sealing.serve(server, service_type, '/world/it', reply, served_context)
    serve = server.answer
    assert serve is not None
    node = Node(lambda msg: on_the_way(serve(on_the_way(msg), service_type.Response())))
    answers: list[Any] = []
    client = sealing.SealedClient(node, service_type, '/world/it')
    client.call(request, answers.append, context)
    return answers[0], server


@pytest.mark.parametrize(
    ('service_type', 'request_'),
    [
        (Vouch, Vouch.Request(mission_id='x-1')),
        (Join, Join.Request(uav=1, host='odd', guard_after=-1)),
        (ControlMission, ControlMission.Request(seed=2**64 - 1)),
    ],
)
def test_a_question_and_its_answer_arrive(service_type: Any, request_: Any) -> None:  # noqa: ANN401
    for _ in range(50):  # bytes between fields are as the memory was
        answer, server = asked(service_type, request_)
        assert isinstance(answer, service_type.Response)
        assert server.warned == []


def test_another_question_than_was_asked_is_refused() -> None:
    def change(msg: Any) -> Any:  # noqa: ANN401
        if isinstance(msg, ControlMission.Request):
            msg.command = ControlMission.Request.ABORT
        return msg

    answer, server = asked(ControlMission, ControlMission.Request(), on_the_way=change)
    assert answer is None
    assert 'its seal is not of this key' in server.warned[0]


def test_an_answer_to_another_question_is_refused() -> None:
    kept: list[Any] = []

    def keep_the_first(msg: Any) -> Any:  # noqa: ANN401
        if isinstance(msg, Vouch.Response):
            kept.append(msg)
            return kept[0]
        return msg

    request = Vouch.Request(mission_id='x-1')
    assert asked(Vouch, request, on_the_way=keep_the_first)[0] is not None
    assert asked(Vouch, request, on_the_way=keep_the_first)[0] is None


def test_what_is_for_another_world_is_refused() -> None:
    request = ControlMission.Request()
    assert asked(ControlMission, request, context='a', served_context='a')[0] is not None
    assert asked(ControlMission, request, context='a', served_context='b')[0] is None


def test_messages_that_differ_read_differently() -> None:
    messages = [
        Join.Response(reason='ab', mission_id=''),
        Join.Response(reason='a', mission_id='b'),
        Join.Response(observations=[Observation(), Observation()]),
        Join.Response(observations=[Observation(sensor=array('I', [1]))]),
        Join.Response(observations=[Observation(sensor_gain=array('d', [1.0]))]),
        Join.Response(radio=[RadioMessage()]),
        Join.Response(radio=[RadioMessage(x_m=-0.0)]),
    ]
    assert len({sealing._plain(msg) for msg in messages}) == len(messages)


def test_the_fields_of_all_messages_can_be_read() -> None:
    own = [it.message for it in (*topics.fleet_topics(1), topics.RECORDER)]
    for message in filter(sealing.has_seal, own):
        assert sealing._plain(message())[-SEAL_BYTE:] == bytes(SEAL_BYTE)
    assert isinstance(Observation().region_demand_bit, np.ndarray)


def test_what_the_document_seals_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / 'key'
    file.write_bytes(KEY)
    monkeypatch.setenv(KEY_FILE, str(file))
    [program] = re.findall(r'^```python\n(.*?)^```', SECURITY.read_text(), re.M | re.S)
    names: dict[str, Any] = {}
    exec(program, names)
    secret = read_secret({KEY_FILE: str(file)})
    assert secret is not None
    checker = Checker(secret, '/uav_1/command')
    for action in range(6):
        command = Command(mission_id='m' * action, action=action)
        content = names['sealed'](command, '/uav_1/command', serialize_message)
        assert checker.refusal(content) is None
        assert deserialize_message(content, Command).action == action

"""What nodes send and take with a seal, once there is a secret: topics and services alike.

Of uav_collect_msgs, what is sent on a topic and both parts of a service end with a seal; actions
and parts of other messages have none, nor have messages of other packages.
"""

from array import array
from collections.abc import Callable
from functools import partial
from pathlib import Path
import struct
from typing import Any

import numpy as np
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.task import Future
from uav_collect.lockstep.seals import (
    Checker,
    framed,
    seal_bytes,
    seal_of,
    Signer,
    TAG_BYTE,
)
from uav_collect.nodes.process import ProcessNode
from uav_collect_msgs.msg import Seal

_NUMBER = struct.Struct('<d')
_REASONS = ('reason', 'message')  # fields of an answer that tell people why something is not done


def has_seal(message_class: Any) -> bool:
    """Whether the messages of a class end with a seal."""
    return 'seal' in message_class.get_fields_and_field_types()


class SealedPublisher(Publisher):
    """A publisher that seals each message as it is published."""

    signer: Signer

    def publish(self, msg: Any) -> None:
        """Publish a message with a seal; the message itself stays without."""
        _number(msg, self.signer)
        super().publish(self.signer.sealed(serialize_message(msg)))
        msg.seal.sender = msg.seal.sequence = 0


class SealedClient:
    """A client of a service; with a secret it seals what it asks and checks what is answered."""

    def __init__(self, node: ProcessNode, service_type: Any, name: str) -> None:
        """Ask on behalf of a node, as Node.create_client does."""
        self._node, self._name = node, name
        self.refusal = ''  # why the latest answer that was none is refused
        self.client = node.create_client(service_type, name)
        self._signer = self._checker = None
        if node.secret is not None:
            self._signer = Signer(node.secret, _asking(name))
            self._checker = Checker(node.secret, _answering(name))

    def call(self, request: Any, on_answer: Callable[[Any], None], context: str = '') -> Future:
        """Ask; the answer comes later, None if it has no seal for this question.

        Args:
            context: that the service knows too, such as the world that is asked.
        """
        seal = b''
        if self._signer is not None:
            request = _with_seal(self._signer, request, context.encode())
            seal = seal_of(_plain(request))
        future = self.client.call_async(request)
        future.add_done_callback(partial(self._on_done, on_answer, seal))
        return future

    def _on_done(self, on_answer: Callable[[Any], None], seal: bytes, future: Future) -> None:
        answer = future.result()
        if self._checker is not None and answer is not None:
            why = self._checker.refusal(_plain(answer), seal)
            if why is not None:
                warn_of(self._node, f'{self._name}: an answer', why)
                self.refusal, answer = why, None
        on_answer(answer)


def serve(
    node: ProcessNode,
    service_type: Any,
    name: str,
    callback: Callable[[Any, Any], Any],
    context: str = '',
) -> None:
    """Serve as Node.create_service does; with a secret, only what is sealed for this context."""
    if node.secret is None:
        node.create_service(service_type, name, callback)
        return
    checker = Checker(node.secret, _asking(name))
    signer = Signer(node.secret, _answering(name))

    def answer(request: Any, response: Any) -> Any:
        asked = _plain(request)
        why = checker.refusal(asked, context.encode())
        if why is not None:
            warn_of(node, f'{name}: a request', why)
            return _with_reason(response, f'refused: {why}')
        return _with_seal(signer, callback(request, response), seal_of(asked))

    node.create_service(service_type, name, answer)


def seals_of_bag(node: ProcessNode, bag: Path) -> Callable[[str, bytes], bool]:
    """What tells whether a recorded message is sealed, by its topic; without a secret all are."""
    checkers: dict[str, Checker] = {}

    def is_sealed(topic: str, content: bytes) -> bool:
        if node.secret is None:
            return True
        if topic not in checkers:
            checkers[topic] = Checker(node.secret, topic, is_ordered=False)  # sorted by log time
        why = checkers[topic].refusal(content)
        if why is not None:
            warn_of(node, f'{bag}: {topic}: a message', why)
        return why is None

    return is_sealed


def warn_of(node: ProcessNode, what: str, why: str) -> None:
    """Count and log that something is refused for its seal."""
    node.warn('seal refused', f'{what} is refused: {why}')


def _number(msg: Any, signer: Signer) -> None:
    """Write into a message what its seal is to have before it is serialized."""
    msg.seal.sender, msg.seal.sequence = signer.sender, signer.next_sequence()


def _with_seal(signer: Signer, msg: Any, context: bytes) -> Any:
    """A request or an answer with its seal, as its receiver gets it."""
    _number(msg, signer)
    received = deserialize_message(serialize_message(msg), type(msg))
    sealed = signer.sealed(_plain(received), context)
    received.seal.tag = list(sealed[-TAG_BYTE:])
    return received


def _plain(value: Any) -> bytes:
    """All that a message says, as bytes that end with its seal.

    A message that was received is an object: serialized again, it differs in the bytes between its
    fields, which nobody sets. Whole numbers are written in decimal with a semicolon, others as
    float64, texts in UTF-8, and what has a length with that before it.
    """
    match value:
        case bool() | int():
            return b'%d;' % value
        case float():
            return _NUMBER.pack(value)
        case str():
            return framed(value.encode(errors='surrogatepass'))
        case Seal():
            return seal_bytes(value.sender, value.sequence, value.tag.tobytes())
        case array() | np.ndarray():
            return framed(value.tobytes())
        case list():
            return framed(b''.join(map(_plain, value)))
    names = value.get_fields_and_field_types()
    return b''.join([_plain(getattr(value, name)) for name in names])


def _with_reason(response: Any, why: str) -> Any:
    """An answer that only says why there is none."""
    for name in _REASONS:
        if hasattr(response, name):
            setattr(response, name, why)
    return response


def _asking(service: str) -> str:
    return f'{service} request'


def _answering(service: str) -> str:
    return f'{service} response'

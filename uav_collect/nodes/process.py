"""How a node runs as a process: start, events, signals, a clean end.

rclpy's own signal handlers shut the context down at once, so a node could neither publish a last
message nor log that it stops. Here signals only raise a flag that the loop looks at.
"""

from argparse import ArgumentParser, Namespace
from collections import deque
from collections.abc import Callable, Sequence
import os
import signal
import sys
import time
from types import FrameType
from typing import Any

from rcl_interfaces.msg import SetParametersResult
import rclpy
from rclpy.duration import Duration
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from rclpy.utilities import remove_ros_args
from uav_collect.errors import NodeError
from uav_collect.kernels.stops import obeyed_signals, watchdog
from uav_collect.limits import FAILED, stop_signals, UNUSABLE
from uav_collect.lockstep.seals import KEY_FILE, read_secret, Secret
from uav_collect.nodes.incidents import Incidents
from uav_collect.nodes.middleware import use_quick_discovery

_WAIT_S = 0.1  # longest time until a signal is noticed by an idle node
# Longest wait of a stopped node for the readers of what it published: a late one takes the whole
# history of missions, and where processors are busy that takes seconds. A second signal ends it.
_FLUSH_S = 3.0
# The same of a node that ends by itself: so long a reader counts as there that is not heard, see
# leaseDuration in config/fastdds.xml. DDS repeats lost packets every 3 s.
_HANDOVER_S = 20.0
_N_RETIRED = 8  # subscriptions kept after their end; what was queued for more has passed
_DISCOVERED_S = 1.0  # until subscribers find a new node; one that ends by itself lives as long


class ProcessNode(Node):
    """A node that owns its process: it can end it, and is called when it is ended."""

    end_status: int | None = None  # exit status, once the node has asked to end
    secret: Secret | None = None  # what it seals messages with, and takes none without

    def __init__(self, node_name: str, **options: Any) -> None:
        """Begin as a Node does, with the same options.

        Raises:
            NodeError: the environment names a secret that cannot be used.
        """
        self.secret = read_secret(os.environ)
        super().__init__(node_name, **options)
        self.incidents = Incidents()
        self._retired: deque[Subscription] = deque(maxlen=_N_RETIRED)

    def warn(self, kind: str, text: str) -> bool:
        """Count an incident of a kind such as 'command refused', and log it.

        Returns:
            Whether it was logged: what repeats itself, or comes too often, is only counted.
        """
        line = self.incidents.note(kind, text, time.monotonic())
        if line is not None:
            self.get_logger().warning(line)
        return line is not None

    def retire(self, subscription: Subscription) -> None:
        """Destroy a subscription that has no callbacks for events: one that has them must stay.

        What the events executor has queued does not keep alive what it is for. Of messages it is
        enough that the subscription is not freed: they are passed over. An event whose turn comes
        after its subscription was destroyed crashes the process.
        """
        self.destroy_subscription(subscription)
        self._retired.append(subscription)

    def end(self, status: int = 0) -> None:
        """Ask the process to end with an exit status, after the callback that says so.

        The node logs why before it asks.
        """
        if self.end_status is None:
            self.end_status = status

    def on_stop(self) -> None:
        """Called once as the process ends, for whatever reason; publishers still publish."""


class _Stop:
    """Remembers that a signal asked the process to end, once or many times."""

    def __init__(self) -> None:
        self._n_signals = 0
        self._numbers = stop_signals()
        for number in self._numbers:
            signal.signal(number, self._on_signal)

    @property
    def asked(self) -> bool:
        """Whether there was a signal."""
        return self._n_signals > 0

    @property
    def urged(self) -> bool:
        """Whether there was more than one: who asks does not want to wait."""
        return self._n_signals > 1

    def acknowledge(self) -> bool:
        """Whether there was a signal; if so, who asks ends the process, however long it takes."""
        if self.asked:
            watchdog.acknowledge()
        return self.asked

    def ignore_more(self) -> None:
        """Make further signals harmless; Python's own exit would restore their deadly default."""
        for number in self._numbers:
            signal.signal(number, signal.SIG_IGN)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self._n_signals += 1


def parse_arguments(parser: ArgumentParser, argv: Sequence[str]) -> Namespace:
    """Parse what is not for ROS; whatever is wrong ends the process with status 2.

    Args:
        parser: of the program's own arguments.
        argv: what follows the program's name on the command line.
    """
    try:
        own = remove_ros_args(list(argv))
    except _rclpy.RCLInvalidROSArgsError as error:
        parser.error(' '.join(str(error).split()))
    except UnicodeEncodeError as error:
        parser.error(f'{error.object!a} must be UTF-8')
    return parser.parse_args(own)


def run_node(make_node: Callable[[], ProcessNode], argv: Sequence[str]) -> int:
    """Run a node until a signal, or until it asks to end.

    Args:
        make_node: constructs the node; raises NodeError, or rclpy's errors about parameters,
            when it cannot start.
        argv: what follows the program's name on the command line, `--ros-args` included.

    Returns:
        Exit status of the process: 0 after a signal to end, else what the node asked for. One
        that does not come to obey a signal ends with `FAILED`.
    """
    with obeyed_signals(lambda _: FAILED):
        return _run_in_ros(make_node, argv, _Stop())


def _run_in_ros(make_node: Callable[[], ProcessNode], argv: Sequence[str], stop: _Stop) -> int:
    use_quick_discovery()
    try:
        rclpy.init(args=list(argv), signal_handler_options=SignalHandlerOptions.NO)
    except (_rclpy.RCLError, _rclpy.UnknownROSArgsError) as error:
        return _refuse(f'cannot start ROS: {error}', UNUSABLE)
    try:
        node = make_node()
    except (NodeError, ParameterException) as error:
        return _refuse(str(error), UNUSABLE)
    else:
        _guard(node)
        return _run(node, stop)
    finally:
        rclpy.try_shutdown()
        stop.ignore_more()


def make_executor() -> Any:
    """The fastest executor that works here.

    The events executor answers in a third of the time; its `spin` does not work in all releases,
    so it is driven by `spin_once`. Releases without it, or where it does nothing, get the usual
    one.
    """
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor()
    executor = EventsExecutor()
    if _delivers(executor):
        return executor
    executor.shutdown()
    return SingleThreadedExecutor()


def _delivers(executor: Any) -> bool:
    ran: list[bool] = []
    executor.create_task(lambda: ran.append(True))
    for _ in range(3):
        executor.spin_once(timeout_sec=_WAIT_S)
        if ran:
            return True
    return False


def _guard(node: ProcessNode) -> None:
    """Say who may steer; unless everybody may, parameters are fixed, for they have no seal."""
    secret, log = node.secret, node.get_logger()
    if secret is None:
        log.info(f'{KEY_FILE} is not set: anyone in this ROS domain can steer')
        return
    log.info(f'only who has the key of {secret.file} can steer')
    if secret.is_readable_by_others:
        log.warning(f'{secret.file} is open to other users: chmod 600 {secret.file}')
    why = f'parameters are fixed while {KEY_FILE} is set: whoever changes them proves nothing'
    refused = SetParametersResult(successful=False, reason=why)
    node.add_on_set_parameters_callback(lambda _: refused)


def _run(node: ProcessNode, stop: _Stop) -> int:
    started_s = time.monotonic()
    executor = make_executor()
    executor.add_node(node)
    try:
        while node.end_status is None and not stop.acknowledge():
            _spin_once(node, executor)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        watchdog.acknowledge()  # a signal from now on asks for what happens already
        node.on_stop()
        if node.end_status == 0:
            _wait_to_be_discovered(started_s, stop)
        _flush_publishers(node, stop)
        executor.shutdown()
        node.destroy_node()
    return node.end_status or 0


def _spin_once(node: ProcessNode, executor: Any) -> None:
    """Run the callbacks that are due, or wait a moment for some.

    Something may be queued for a subscription that was retired meanwhile: the events executor
    raises where the usual one passes over it.
    """
    try:
        executor.spin_once(timeout_sec=_WAIT_S)
    except _rclpy.InvalidHandle as error:
        node.get_logger().debug(f'passed over an event: {error}')


def _wait_to_be_discovered(started_s: float, stop: _Stop) -> None:
    """Keep what a short-lived node has published until those who wait for it know the node."""
    while not stop.asked and time.monotonic() < started_s + _DISCOVERED_S:
        time.sleep(_WAIT_S / 10)


def _flush_publishers(node: ProcessNode, stop: _Stop) -> None:
    """Give the readers time to get what was published; a dead one must not hold us for ever."""
    begun_s = time.monotonic()
    for publisher in node.publishers:
        while not publisher.wait_for_all_acked(Duration(seconds=_WAIT_S / 10)):
            is_leisurely = node.end_status == 0 and not stop.asked
            patience_s = _HANDOVER_S if is_leisurely else _FLUSH_S
            if stop.urged or time.monotonic() > begun_s + patience_s:
                return


def _refuse(message: str, status: int) -> int:
    sys.stderr.write(f'error: {" ".join(message.split())}\n')
    return status

"""Chooses the policy of a mission in a process of its own.

There kernels are compiled ones where there are any: all else of one mission takes less,
interpreted, than to load them.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
import os
import subprocess
import sys
from typing import TYPE_CHECKING

from uav_collect.errors import FleetError, UavCollectError
from uav_collect.kernels.compile import interpret_unless_cached
from uav_collect.limits import is_lookahead_name

if TYPE_CHECKING:  # loaded by that process alone, unless there is a choice to be received
    from uav_collect.analysis.choice import Choice

MOST_S = 30.0  # of computing; a safety net: what is planned takes a fraction of it
_KERNELS = ('batch_kernels.fly_batch', 'batch_kernels.answer')  # of rules, and of networks
_SERVE = 'from uav_collect.commands.choice_process import serve; serve({})'


@dataclass(frozen=True, kw_only=True)
class ChoiceRequest:
    """What is to be chosen."""

    scenario: str  # as YAML, every value stated
    candidates: str  # besides the shipped ones and the rules, separated by commas
    allocator: str
    guard_after: int
    own: tuple[str, ...] = ()  # files of policies that were refined for the scenario


Answer = tuple['Choice', list[str]]  # and lines about who could not be a candidate


@contextmanager
def started_choice(
    request: ChoiceRequest, environment: Mapping[str, str]
) -> Iterator[Callable[[], Answer]]:
    """Choose in a process of its own while the block lasts; what it yields waits for the answer.

    It raises what the choice raises, or FleetError if the process ends without an answer.

    Args:
        environment: of that process: says how kernels run there.
    """
    ours, theirs = Pipe()
    number = theirs.fileno()
    process = subprocess.Popen(
        [sys.executable, '-c', _SERVE.format(number)],
        stdin=subprocess.DEVNULL,
        pass_fds=[number],
        process_group=0,  # Ctrl-C is for this process, which ends that one
        env={**environment, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))},
    )
    theirs.close()

    def answer() -> Answer:
        try:
            found: Answer | UavCollectError = ours.recv()
        except (EOFError, ConnectionResetError):
            what = f'the process that chooses the policy ended with status {process.wait()}'
            raise FleetError(what) from None
        if isinstance(found, UavCollectError):
            raise found
        return found

    try:
        ours.send(request)
        yield answer
    finally:
        process.kill()  # it has answered, or nobody waits for it any more
        process.wait()
        ours.close()


def serve(number: int) -> None:
    """Receive a request from whoever has started this process, and send the choice, or an error.

    Args:
        number: of the file by which they talk.
    """
    with Connection(number) as starter, suppress(BrokenPipeError):  # it may be gone
        request: ChoiceRequest = starter.recv()
        if not any(map(is_lookahead_name, request.candidates.split(','))):
            any(map(interpret_unless_cached, _KERNELS))
        starter.send(_found(request))


def _found(request: ChoiceRequest) -> Answer | UavCollectError:
    from uav_collect.analysis.choosing import candidates_for, choose
    from uav_collect.scenario.load import from_yaml
    from uav_collect.scenario.site import build_site
    from uav_collect.uav.policy import listed_names

    try:
        scenario = from_yaml(request.scenario)
        given = listed_names(request.candidates)
        candidates, left_out = candidates_for(scenario, given, request.own)
        choice = choose(
            build_site(scenario),
            candidates,
            allocator=request.allocator,
            guard_after=request.guard_after,
            most_s=MOST_S,
        )
    except UavCollectError as error:
        return error
    return choice, left_out

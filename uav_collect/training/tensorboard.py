"""Scalars as a TensorBoard event file.

TensorBoard's own writer works in a thread, where a full disk cannot be caught. This one writes at
once.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
import os
from pathlib import Path
import time
from typing import Any

from tensorboard.compat.proto.event_pb2 import Event, SessionLog
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.record_writer import RecordWriter

_VERSION = 'brain.Event:2'


@contextmanager
def scalar_writer(
    folder: Path, first_step: int
) -> Iterator[Callable[[int, Mapping[str, float]], None]]:
    """A new event file in a folder; call what it yields with a step and its scalars by tag.

    Args:
        folder: to be made if it is not there.
        first_step: what older files of the folder have from this step on does not count any more.

    Raises:
        OSError: it cannot be written.
    """
    folder.mkdir(exist_ok=True)
    # TensorBoard knows the files by this beginning and reads them in the order of their time.
    path = folder / f'events.out.tfevents.{time.time_ns() // 1000:017d}.{os.getpid()}'
    with path.open('wb', buffering=0) as file:
        records = RecordWriter(file)
        _write(records, file_version=_VERSION)
        _write(records, step=first_step, session_log=SessionLog(status=SessionLog.START))
        yield lambda step, scalars: _write(
            records,
            step=step,
            summary=Summary(
                value=[Summary.Value(tag=tag, simple_value=it) for tag, it in scalars.items()]
            ),
        )


def _write(records: RecordWriter, **content: Any) -> None:  # noqa: ANN401 - a message of protobuf
    records.write(Event(wall_time=time.time(), **content).SerializeToString())
    records.flush()

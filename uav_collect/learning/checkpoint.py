"""The checkpoint of a training: written whole or not at all."""

import io
import os
from pathlib import Path
from typing import Any

import torch
from uav_collect.errors import CheckpointError

_FILE = 'state.pt'


def write_checkpoint(folder: Path, state: dict[str, Any]) -> None:
    """Write a state in place of the last one.

    Raises:
        OSError: it cannot be written; the last one is still there.
    """
    written = io.BytesIO()  # torch hides what the disk says behind errors of its own
    torch.save(state, written)
    folder.mkdir(parents=True, exist_ok=True)
    partial = folder / f'{_FILE}.part'
    try:
        with partial.open('wb') as file:
            file.write(written.getbuffer())
            file.flush()
            os.fsync(file.fileno())
        partial.replace(folder / _FILE)
    finally:
        partial.unlink(missing_ok=True)


def read_checkpoint(folder: Path) -> dict[str, Any]:
    """Read the state that was written last.

    Raises:
        CheckpointError: there is none, or it is broken.
    """
    path = folder / _FILE
    try:
        state: dict[str, Any] = torch.load(path, map_location='cpu', weights_only=False)
    except OSError as error:
        raise CheckpointError(f'{path}: cannot be read: {error.strerror}') from error
    except Exception as error:  # torch raises whatever its readers do
        raise CheckpointError(f'{path}: is no whole checkpoint: {error}') from error
    return state

"""The checkpoint of a training: written whole or not at all."""

import io
from pathlib import Path
from typing import Any

import torch
from uav_collect import files
from uav_collect.errors import CheckpointError

STATE_FILE = 'state.pt'


def write_checkpoint(folder: Path, state: dict[str, Any]) -> None:
    """Write a state in place of the last one.

    Raises:
        OSError: it cannot be written; the last one is still there.
    """
    written = io.BytesIO()  # torch hides what the disk says behind errors of its own
    torch.save(state, written)
    folder.mkdir(parents=True, exist_ok=True)
    files.write_atomically(folder / STATE_FILE, written.getbuffer())


def read_checkpoint(folder: Path) -> dict[str, Any]:
    """Read the state that was written last.

    Raises:
        CheckpointError: there is none, or it is broken.
    """
    path = folder / STATE_FILE
    try:
        state: dict[str, Any] = torch.load(path, map_location='cpu', weights_only=False)
    except OSError as error:
        raise CheckpointError(f'{path}: cannot be read: {error.strerror}') from error
    except Exception as error:  # torch raises whatever its readers do
        raise CheckpointError(f'{path}: is no whole checkpoint: {error}') from error
    return state

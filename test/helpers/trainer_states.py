"""What trainers hold, and where two of them differ."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from uav_collect.learning.checkpoint import read_checkpoint
from uav_collect.learning.learner import Learner
from uav_collect.learning.trainer import Trainer


def state_of(trainer: Trainer, folder: Path) -> dict[str, Any]:
    """All that a trainer holds, but for the time that it took."""
    trainer.save(folder)
    state = read_checkpoint(folder)
    for name in ('validation', 'best'):
        state[name]['wall_s'] = 0.0
    state['trained_s'] = 0.0
    return state


def differences(one: object, other: object, path: str = '') -> list[str]:
    """Where two states differ, to the bit."""
    if isinstance(one, dict) and isinstance(other, dict):
        keys = sorted({*one, *other}, key=str)
        pairs = [(key, one.get(key), other.get(key)) for key in keys]
    elif isinstance(one, list | tuple) and isinstance(other, list | tuple):
        if len(one) != len(other):
            return [f'{path}: {len(one)} and {len(other)}']
        pairs = [(index, *pair) for index, pair in enumerate(zip(one, other, strict=True))]
    elif isinstance(one, np.ndarray):
        return [] if np.asarray(one).tobytes() == np.asarray(other).tobytes() else [path]
    else:
        return [] if one == other else [f'{path}: {one} and {other}']
    return [it for key, mine, theirs in pairs for it in differences(mine, theirs, f'{path}/{key}')]


def poisoned(monkeypatch: pytest.MonkeyPatch, after: int) -> None:
    """Let the loss be no number after so many updates."""
    update = Learner.update

    def spoilt(self: Learner, *arguments: object) -> object:
        if self.n_updates == after:
            next(self.networks.parameters()).data.fill_(float('nan'))
        return update(self, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(Learner, 'update', spoilt)

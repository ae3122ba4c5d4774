"""Checkpoints of tiny trainings, and what may befall their files."""

from collections.abc import Callable, Mapping
import hashlib
import os
from pathlib import Path
from typing import Any

from episodes import small
from tiny_world import tiny, uav
from uav_collect.learning.checkpoint import checkpoint_bytes, checkpoint_from_bytes
from uav_collect.learning.saved import SavedPart

FLEET = uav(5.0, energy_budget_kj=9.0), uav(10.0, energy_budget_kj=5.0)  # soon home
CONFIG = small('strong', validation__every_updates=1000)
_DIGEST = slice(24, 56)  # the bytes that hold it; it is that of all that follows


def read_back(state: Mapping[str, Any]) -> SavedPart:
    """A state as a checkpoint gives it back."""
    return SavedPart(checkpoint_from_bytes(checkpoint_bytes(state)))


class Trap:
    """What a pickle would do to whoever reads it."""

    def __reduce__(self) -> tuple[Callable[..., object], tuple[str]]:
        return os.mkdir, ('trapped',)


def forged(content: bytes) -> bytes:
    """A checkpoint's bytes under a digest that is theirs, as if they had been written so."""
    digest = hashlib.sha256(content[_DIGEST.stop :]).digest()
    return content[: _DIGEST.start] + digest + content[_DIGEST.stop :]


def saved_training(folder: Path, decisions: int = 200) -> None:
    """Train a tiny fleet for a moment and save that."""
    from uav_collect.learning.trainer import Trainer
    from uav_collect.training.progress import Budget

    trainer = new_trainer()
    assert isinstance(trainer, Trainer)
    list(trainer.run(Budget(decisions=decisions)))
    trainer.save(folder)


def new_trainer() -> Any:  # noqa: ANN401 - a Trainer, whose module needs torch
    """The trainer of a tiny fleet at its start."""
    from uav_collect.learning.trainer import Trainer

    return Trainer([tiny(*FLEET)], CONFIG, 'aqmix', 0)

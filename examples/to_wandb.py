"""A training's curves as a run of Weights & Biases: needs the package wandb besides TensorBoard.

python examples/to_wandb.py runs/train/NAME [PROJECT]
With WANDB_MODE=offline it is written below wandb/, for "wandb sync" to upload.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
import sys

from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
import yaml


def scalars_by_step(run_folder: Path) -> Iterator[tuple[int, Mapping[str, float]]]:
    """What was known after so many decisions, by tag, in order."""
    events = EventAccumulator(str(run_folder / 'tensorboard'), size_guidance={'scalars': 0})
    events.Reload()
    at: dict[int, dict[str, float]] = defaultdict(dict)
    for tag in events.Tags()['scalars']:
        for event in events.Scalars(tag):
            at[event.step][tag] = event.value
    yield from sorted(at.items())


def upload(run_folder: Path, project: str) -> None:
    """One run, by the folder's name, with the settings that it was trained with."""
    import wandb

    settings = yaml.safe_load((run_folder / 'training.yaml').read_text(encoding='utf-8'))
    with wandb.init(project=project, name=run_folder.name, config=settings) as run:
        for step, scalars in scalars_by_step(run_folder):
            run.log(dict(scalars), step=step)


if __name__ == '__main__':
    upload(Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else 'uav_collect')

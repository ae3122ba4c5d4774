"""What the example for Weights & Biases hands on is what a training has written."""

from pathlib import Path

from uav_collect.training.tensorboard import scalar_writer

from examples.to_wandb import scalars_by_step


def test_scalars_come_by_step_in_order_those_of_a_resumed_training_once(tmp_path: Path) -> None:
    folder = tmp_path / 'tensorboard'
    with scalar_writer(folder, 0) as write:
        write(100, {'training/loss': 0.5})
        write(100, {'validation/energy_kj': 50.0})
        write(200, {'training/loss': 0.125})
    with scalar_writer(folder, 200) as write:
        write(200, {'training/loss': 0.25})
    assert [*scalars_by_step(tmp_path)] == [
        (100, {'training/loss': 0.5, 'validation/energy_kj': 50.0}),
        (200, {'training/loss': 0.25}),
    ]

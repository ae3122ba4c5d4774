"""The mission seeds of trainings: ranges that users do not evaluate on by chance."""

VALIDATION_SEED = 2**60  # of the first validation mission
_FIRST_SEED = 2**61  # of the missions to learn from
# Runs, the worlds of a run and the starts of a world each have a part of the range of their own.
_SEEDS_PER_RUN, _SEEDS_PER_WORLD, _SEEDS_PER_START = 2**32, 2**28, 2**20
_N_RUNS = 2**28
_N_STARTS = _SEEDS_PER_WORLD // _SEEDS_PER_START


def first_training_seed(run_seed: int, world: int = 0, start: int = 0) -> int:
    """Seed of the first mission that a world of a run flies.

    Args:
        run_seed: of the training run.
        world: number of the world; one process flies in one.
        start: how many times the run was started before.
    """
    first = _FIRST_SEED + run_seed % _N_RUNS * _SEEDS_PER_RUN
    return first + world * _SEEDS_PER_WORLD + start % _N_STARTS * _SEEDS_PER_START

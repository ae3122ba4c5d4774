"""The mission seeds of trainings: ranges that users do not evaluate on by chance."""

from pathlib import Path

from uav_collect import files
from uav_collect.errors import TrainingRunError

STARTS_FILE = 'world_starts.csv'  # of a run folder: each start of a world, and its first seed
_COLUMNS = ('world', 'first_seed')

VALIDATION_SEED = 2**60  # of the first validation mission
_FIRST_SEED = 2**61  # of the missions to learn from
# Runs, the worlds of a run and the starts of a world each have a part of the range of their own.
_SEEDS_PER_RUN, _SEEDS_PER_WORLD, _SEEDS_PER_START = 2**32, 2**28, 2**20
_N_RUNS = 2**28
_MOST_BYTES = 2**26  # of the starts
_N_PARTS = _SEEDS_PER_RUN // _SEEDS_PER_START
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


def first_seed_of_part(run_seed: int, part: int) -> int:
    """Seed of the first mission of one of the parts that a run's range falls into.

    Args:
        part: number of the part; after some thousands of them they begin again.
    """
    return _FIRST_SEED + run_seed % _N_RUNS * _SEEDS_PER_RUN + part % _N_PARTS * _SEEDS_PER_START


def next_training_seed(folder: Path, run_seed: int, world: int) -> int:
    """Seed of the first mission of a world that is to start, for the first time or again.

    Each start is written down in the run's folder, so that no later one flies the same missions.

    Args:
        folder: of the run; it is made where there is none.
        run_seed: of the training run.
        world: number of the world.

    Raises:
        OSError: naming what cannot be read or written.
        TrainingRunError: the world was started too often, or the starts cannot be told.
    """
    path = folder / STARTS_FILE
    lines = _starts(path)
    n_starts = sum(line.startswith(f'{world},') for line in lines)
    if n_starts >= _N_STARTS:
        raise TrainingRunError(
            f'{path}: world {world} was started {n_starts} times, and there are no more missions'
            ' that it has not flown: begin another run'
        )
    seed = first_training_seed(run_seed, world, n_starts)
    rows = [line.split(',') for line in lines]
    folder.mkdir(parents=True, exist_ok=True)
    files.write_atomically(path, files.csv_of([_COLUMNS, *rows, (world, seed)]))
    return seed


def _starts(path: Path) -> list[str]:
    """The rows of a file of starts; none where there is no such file."""
    try:
        return files.read_bounded(path, _MOST_BYTES).decode().splitlines()[1:]
    except FileNotFoundError:
        return []
    except UnicodeDecodeError as error:
        what = 'is no text: no one can tell which missions were flown: begin another run'
        raise TrainingRunError(f'{path}: {what}') from error

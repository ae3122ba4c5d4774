"""What users set of the trainer node, and the run that they mean."""

from dataclasses import dataclass, replace
from pathlib import Path

from rclpy.node import Node
from uav_collect.errors import NodeError, TrainingRunError
from uav_collect.limits import MAX_DECISIONS, MAX_SEED
from uav_collect.nodes.parameters import declare, is_namespace, Parameter, values_of
from uav_collect.scenario.load import load, parse_override
from uav_collect.training.config import load_preset
from uav_collect.training.folder import BEGINNING, BEST_POLICY
from uav_collect.training.planned_run import new_record, PlannedRun, stored_run
from uav_collect.training.plug_ins import check_fleet_algorithm
from uav_collect.training.run_record import (
    PROGRESS_FILE,
    read_run,
    RUN_FILE,
    VALIDATION_FILE,
)
from uav_collect.training.seeds import STARTS_FILE
from uav_collect.uav.policy import frozen_policy

_MINUTES = 60.0

PARAMETERS = (
    Parameter(
        name='scenario',
        default='paper_10x10',
        description='what the fleets fly: name of a shipped scenario, or path of a YAML file',
    ),
    Parameter(
        name='algorithm',
        default='aqmix',
        description='how it learns: aqmix, aiql, or module:Name of a class like one of these',
    ),
    Parameter(
        name='preset',
        default='strong',
        description='settings of the training: paper, strong, refine or a YAML file',
    ),
    Parameter(
        name='overrides',
        default=[''],
        description='replace values of the preset, such as target.trace=0.8',
    ),
    Parameter(
        name='start_from',
        default='',
        description='policy whose weights to start from: a shipped one or a .safetensors file;'
        ' empty: random ones',
    ),
    Parameter(
        name='seed',
        default=0,
        description='of the first weights and of what is replayed',
        low=0,
        high=MAX_SEED,
    ),
    Parameter(
        name='worlds',
        default=[''],
        description="namespaces of the worlds to learn from, such as [a, b]; '': the one without",
    ),
    Parameter(
        name='output_dir',
        default='',
        description='folder of the run; one that holds a run already is continued',
    ),
    Parameter(
        name='minutes',
        default=0.0,
        description=f'how long to train; 0: {_MINUTES:g}, unless decisions says how long',
        low=0.0,
        high=1e6,
    ),
    Parameter(
        name='decisions',
        default=0,
        description='or how many decisions to learn from; 0: minutes count',
        low=0,
        high=MAX_DECISIONS,
    ),
    Parameter(
        name='decisions_per_update',
        default=0,
        description='decisions flown for each update of the weights; 0: as in the preset',
        low=0,
        high=10**9,
    ),
    Parameter(
        name='replay_decisions',
        default=0,
        description='decisions that the replay has room for; 0: as in the preset',
        low=0,
        high=10**9,
    ),
    Parameter(
        name='publish_every_updates',
        default=10,
        description='updates from one policy on /trainer/policy to the next',
        low=1,
        high=1_000_000,
    ),
    Parameter(
        name='checkpoint_period_s',
        default=60.0,
        description='time [s] between two checkpoints',
        low=0.1,
        high=86_400.0,
    ),
)


@dataclass(frozen=True, kw_only=True)
class TrainerSettings:
    """What users have set of the trainer node, by the names of PARAMETERS."""

    scenario: str
    algorithm: str
    preset: str
    overrides: list[str]
    start_from: str
    seed: int
    worlds: list[str]
    output_dir: str
    minutes: float
    decisions: int
    decisions_per_update: int
    replay_decisions: int
    publish_every_updates: int
    checkpoint_period_s: float

    @property
    def namespaces(self) -> tuple[str, ...]:
        """Of the worlds, '' or such as '/a'."""
        names = (name.strip('/') for name in self.worlds)
        return tuple(dict.fromkeys(f'/{name}' if name else '' for name in names))

    @property
    def assignments(self) -> tuple[str, ...]:
        """What replaces values of the preset, KEY=VALUE."""
        own = {
            'rollout.decisions_per_update': self.decisions_per_update,
            'replay.decisions': self.replay_decisions,
        }
        given = tuple(f'{key}={value}' for key, value in own.items() if value)
        return (*filter(None, self.overrides), *given)


def read_settings(node: Node) -> TrainerSettings:
    """Declare the parameters and read them, once: they do not change while the node runs.

    Raises:
        NodeError: a world cannot have such a name.
    """
    declare(node, PARAMETERS)
    settings = TrainerSettings(**values_of(node, PARAMETERS))
    for name in settings.worlds:
        if not is_namespace(name.strip('/')):
            raise NodeError(f'worlds has {name!r}: must be ROS names, as a or north/a')
    return settings


def planned_run(settings: TrainerSettings) -> PlannedRun:
    """The run that the settings mean: a new one, or the one that the folder holds.

    Raises:
        TrainingRunError: the folder is of something else.
        ConfigError: scenario or preset are not valid, or the algorithm needs one process.
        PolicyMismatchError: the policy to start from cannot be read.
    """
    check_fleet_algorithm(settings.algorithm)
    if not settings.output_dir:
        raise TrainingRunError('output_dir is missing: must be a folder for the run')
    run = _new_run(settings, Path(settings.output_dir))
    if (run.folder / RUN_FILE).is_file():
        return _gone_on_with(run)
    if _holds_something(run.folder) and not run.scenario_files[0].exists():
        raise TrainingRunError(f'{run.folder}: holds something else: choose another output_dir')
    for name in (PROGRESS_FILE, VALIDATION_FILE, BEST_POLICY):
        if (run.folder / name).exists():
            raise TrainingRunError(
                f'{run.folder}: holds {name} of a run, but no {RUN_FILE} to go on with: put it'
                ' back, or choose another output_dir'
            )
    return run


def _holds_something(folder: Path) -> bool:
    """Whether a folder has more in it than that worlds were started for a run."""
    ours = (STARTS_FILE, BEGINNING)
    return folder.is_dir() and any(path.name not in ours for path in folder.iterdir())


def _new_run(settings: TrainerSettings, folder: Path) -> PlannedRun:
    scenario = load(settings.scenario)
    overrides = dict(parse_override(assignment) for assignment in settings.assignments)
    config = load_preset(settings.preset, overrides)
    initial = frozen_policy(settings.start_from) if settings.start_from else None
    minutes = settings.minutes or (None if settings.decisions else _MINUTES)
    if settings.minutes and settings.decisions:
        raise TrainingRunError('minutes and decisions are given: must be one of them')
    record = new_record(
        [scenario],
        config,
        initial,
        training=folder.resolve().name,
        algorithm=settings.algorithm,
        overrides=settings.assignments,
        seed=settings.seed,
        minutes=minutes,
        decisions=settings.decisions or None,
        device='cpu',
        seeds=(settings.seed,),
    )
    return PlannedRun(
        folder=folder, record=record, scenarios=(scenario,), config=config, initial=initial
    )


def _gone_on_with(run: PlannedRun) -> PlannedRun:
    """The run in the folder, for as long as the new one would be trained.

    Raises:
        TrainingRunError: it is trained otherwise.
    """
    known, wanted = read_run(run.folder), run.record
    for name in ('algorithm', 'scenario_fingerprint', 'training_fingerprint', 'initial', 'seed'):
        value, own = getattr(known, name), getattr(wanted, name)
        if value != own:
            raise TrainingRunError(
                f'{run.folder}: holds a run whose {name} is {value!r}: must be {own!r},'
                ' or choose another output_dir'
            )
    record = replace(known, minutes=wanted.minutes, decisions=wanted.decisions, is_done=False)
    return stored_run(run.folder, record)

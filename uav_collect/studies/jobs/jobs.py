"""What a study is made of: pieces of work that depend on nothing but what they say.

A job's digest names it. Whoever does it, wherever and whenever, gets the same bytes, so what was
found for a digest once holds for every study that asks for it.
"""

from dataclasses import asdict, dataclass
import hashlib
import json
from pathlib import Path

from uav_collect.config import layers
from uav_collect.config.rules import validated
from uav_collect.revision import VERSION
from uav_collect.scenario.model import Scenario
from uav_collect.training.config import TrainingConfig

# Raised when a job's result means something else than before, though its fields are the same.
_FORMATS = {'training': 2, 'flights': 1, 'plans': 1}
_DIGEST_LENGTH = 24  # hex digits: 96 bits

# The files that come out of jobs.
MISSIONS = 'missions.csv'  # flights, plans
POLICY = 'policy.safetensors'
CURVE = 'curve.csv'
SUMMARY = 'summary.json'  # trainings

# A row for each validation. Of the training's own missions, which explore, what the last ones
# gave; for QMIX these are synchronous.
CURVE_COLUMNS = (
    'n_decisions', 'n_updates', 'training_reward', 'training_efficiency_kbit_per_j',
    'efficiency_kbit_per_j', 'completion_s', 'energy_kj', 'collected_share', 'complete_share',
    'safe_share', 'team_reward',
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class TrainingJob:
    """The training of one policy."""

    scenario: str  # YAML that stands alone
    settings: str  # YAML that stands alone
    layout: str  # of the observation, with its version
    algorithm: str
    seed: int
    decisions: int


@dataclass(frozen=True, kw_only=True)
class FlightsJob:
    """Missions flown by one policy: a rule, a shipped one, or the best that trainings gave."""

    scenario: str
    policy: str  # a rule's name, a shipped one's name and version, or what logs call the learned
    trainings: tuple[str, ...]  # digests; none for a rule and a shipped policy
    bandwidth: str
    first_seed: int
    n_missions: int
    keeps_logs: bool


@dataclass(frozen=True, kw_only=True)
class PlansJob:
    """Clairvoyant plans of missions."""

    scenario: str
    bandwidth: str
    first_seed: int
    n_missions: int
    n_rounds: int  # of the search for each plan


Job = TrainingJob | FlightsJob | PlansJob


def job_kind(job: Job) -> str:
    """The kind of a job, as messages and files name it."""
    match job:
        case TrainingJob():
            return 'training'
        case FlightsJob():
            return 'flights'
        case PlansJob():
            return 'plans'


def training_job(
    scenario: Scenario, config: TrainingConfig, algorithm: str, seed: int, decisions: int
) -> TrainingJob:
    """The job of training a policy."""
    return TrainingJob(
        scenario=scenario.to_yaml(),
        settings=config.to_yaml(),
        layout=' '.join((config.layout.label, *config.code)),
        algorithm=algorithm,
        seed=seed,
        decisions=decisions,
    )


def job_config(job: TrainingJob) -> TrainingConfig:
    """How a training learns.

    Raises:
        ConfigError: this version knows other settings.
    """
    document = layers.parse(job.settings, label='settings', folder=Path())
    return validated(TrainingConfig, document)


def job_inputs(job: Job) -> tuple[str, ...]:
    """Digests of the jobs whose results a job needs."""
    return job.trainings if isinstance(job, FlightsJob) else ()


def to_json(job: Job) -> bytes:
    """The job as JSON: everything that its result depends on."""
    kind = job_kind(job)
    about = {'kind': kind, 'format': _FORMATS[kind], 'uav_collect': VERSION}
    return (json.dumps(about | asdict(job), sort_keys=True, indent=1) + '\n').encode()


def digest_of(job: Job) -> str:
    """The job's name: digits that change with anything that its result depends on."""
    return hashlib.sha256(to_json(job)).hexdigest()[:_DIGEST_LENGTH]

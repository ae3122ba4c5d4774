"""The settings of a training: frozen models; values live in config/training/*.yaml.

config/training/paper.yaml says what each one means.
"""

from collections.abc import Mapping
import hashlib
from pathlib import Path
from typing import Annotated, Literal

from uav_collect.config import layers, yaml_text
from uav_collect.config.installed import shared_folders
from uav_collect.config.rules import (
    Entries,
    name,
    number,
    Section,
    text,
    truth,
    validated,
    whole,
    words,
    words_or_code,
)
from uav_collect.errors import ConfigError
from uav_collect.limits import is_code_name, MAX_LAYER_SIZE
from uav_collect.missions.own_reward import own_reward, OwnReward
from uav_collect.training.plug_ins import memory_size, own_mixer, own_network
from uav_collect.uav.action_codes import NONE
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.named_code import named_code
from uav_collect.uav.observation import AnyLayout
from uav_collect.uav.own_observation import layout_named
from uav_collect.uav.user_code import UserCodeError
from uav_collect.world.reward import crossing_units, KILOJOULE_J, Reward, RewardUnits

_Share = Annotated[float, number(0, 1)]
_DECISION_MS = 4.0  # as much as some fifty decisions of who learns
_OBSERVATION_MB = 512  # that every machine which trains has

_Size = Annotated[int, whole(1, MAX_LAYER_SIZE)]


class RewardSettings(Section):
    """What the team is rewarded for."""

    goal: Annotated[str, words_or_code('paper', 'energy')]
    discount_per_s: Annotated[float, number(1e-6, 1, 'per s')]
    scale: Annotated[float, number(1e-6, 1e6)]
    # What energy and time count in: kJ and s; crossings of a cell; or, for energy, what the sweep
    # spends on a cell. Absent: kJ and s.
    unit: Annotated[str | None, words('absolute', 'crossing', 'sweep')] = None


class NetworkSettings(Section):
    """Size of the agent network."""

    hidden_size: _Size
    # A user's network; absent: the recurrent one.
    kind: Annotated[str | None, words_or_code('recurrent')] = None
    # Added to the value of what the sweep advises, where observations show that; absent: 0.
    advice_bonus: Annotated[float | None, number(0, 1e9)] = None
    # What it falls to, evenly over this share of the training, or all of it; absent: it stays.
    advice_bonus_last: Annotated[float | None, number(0, 1e9)] = None
    advice_decay_share: Annotated[float | None, number(0, 1)] = None

    @property
    def own(self) -> str:
        """The name of a user's network; '': it is the recurrent one."""
        return _code_name(self.kind)


class MixerSettings(Section):
    """The mixing network and its hypernetworks."""

    embedding_size: _Size
    hypernetwork_size: _Size
    pool_side: Annotated[int, whole(1, 64)]
    pooling: Literal['sum', 'mean']
    # One for each fleet and area, or one for any set of UAVs, or a user's; absent: fleet.
    kind: Annotated[str | None, words_or_code('fleet', 'set')] = None

    @property
    def is_of_sets(self) -> bool:
        """Whether one mixer does for all fleets and areas."""
        return self.kind == 'set'

    @property
    def own(self) -> str:
        """The name of a user's mixer; '': it is one of ours."""
        return _code_name(self.kind)


class ExplorationSettings(Section):
    """How often actions are random while learning, and how that decays."""

    epsilon_first: _Share
    epsilon_last: _Share
    decay_share: _Share
    hover_share: Annotated[float, number(-1, 1)]
    # A UAV that explores follows the advice with this probability; absent: 0.
    advice_share: Annotated[float | None, number(0, 1)] = None


class TargetSettings(Section):
    """How the targets of action values are made."""

    trace: _Share
    double_q: Annotated[bool, truth()]
    update_rate: Annotated[float, number(1e-6, 1)]
    # Updates over which what follows a decision comes to count, from nothing; absent: at once.
    warm_up_updates: Annotated[int | None, whole(0, 10**9)] = None

    def future_share(self, n_updates: int) -> float:
        """How much of what follows a decision counts after so many updates, 0..1."""
        return min(1.0, n_updates / self.warm_up_updates) if self.warm_up_updates else 1.0


class OptimiserSettings(Section):
    """Adam, its learning rate over the training, and gradient clipping."""

    learning_rate: Annotated[float, number(1e-9, 1)]
    learning_rate_last: Annotated[float, number(1e-9, 1)]
    decay_from_share: _Share
    adam_epsilon: Annotated[float, number(1e-12, 1)]
    clip_norm: Annotated[float, number(1e-6, 1e6)]
    bf16: Annotated[bool, truth()]


class ReplaySettings(Section):
    """What the replay holds, and how many missions, or excerpts of them, an update takes."""

    decisions: Annotated[int, whole(1000, 10**9)]
    missions_per_batch: Annotated[int, whole(1, 4096)]
    # As many as long as epsilon falls; absent or 0: as many as later.
    missions_per_batch_first: Annotated[int | None, whole(0, 4096)] = None
    # Decisions from which on a batch takes no more missions; absent or 0: it takes them all.
    rows_per_batch: Annotated[int | None, whole(0, 10**6)] = None
    # Decisions of an excerpt that is learned from; absent or 0: missions are learned from whole.
    sequence_decisions: Annotated[int | None, whole(0, 10**6)] = None
    # Decisions of each UAV for which the network is run before those of an excerpt; absent: 0.
    burn_in_decisions: Annotated[int | None, whole(0, 10**6)] = None
    # Decisions that the replay holds before the first update; absent: none but those of a batch.
    decisions_before_updates: Annotated[int | None, whole(0, 10**9)] = None

    # Memory for observations as they were encoded; absent: _OBSERVATION_MB.
    observation_mb: Annotated[int | None, whole(0, 10**6)] = None

    @property
    def most_observation_bytes(self) -> int:
        """Memory for observations that are kept as they were encoded; others are rebuilt."""
        given = self.observation_mb
        return 10**6 * (_OBSERVATION_MB if given is None else given)

    @property
    def most_rows(self) -> int:
        """Decisions from which on a batch takes no more missions; 0: it takes all of them."""
        return self.rows_per_batch or 0

    @property
    def excerpt_decisions(self) -> int:
        """Decisions of an excerpt that is learned from; 0: missions are learned from whole."""
        return self.sequence_decisions or 0


class RolloutSettings(Section):
    """How training missions are flown, and how often an update follows."""

    missions_at_once: Annotated[int, whole(1, 65536)]
    max_decisions_per_cell: Annotated[float, number(1e-3, 1000)]
    decisions_per_update: Annotated[int, whole(1, 10**9)]
    bandwidth: Literal['equal', 'exact']


class ValidationSettings(Section):
    """How many missions validate a policy, and how often."""

    missions: Annotated[int, whole(1, 100_000)]
    every_updates: Annotated[int, whole(1, 10**9)]
    # Missions that are learned from until the next validation; absent or 0: updates are counted.
    every_missions: Annotated[int | None, whole(0, 10**9)] = None
    # What the best policy is chosen by: first that missions are completed, or efficiency alone.
    best_by: Annotated[str | None, words('completeness', 'efficiency')] = None


class CourseSettings(Section):
    """How a policy learns on courses that are drawn, by turns and for a while each."""

    at_once: Annotated[int, whole(1, 1024)]
    # From so many of them an update learns; absent: from one.
    per_update: Annotated[int | None, whole(1, 1024)] = None
    updates_each: Annotated[int, whole(1, 10**9)]
    least_need: Annotated[float, number(1e-3, 1)]


class BranchSettings(Section):
    """How the algorithm `branches` gets to know what actions are worth."""

    # At which each legal action is tried, of as many as a mission of the sweep takes.
    decisions_per_mission: Annotated[float, number(1e-3, 1e6)]


class ImitationSettings(Section):
    """Whom the algorithm `imitation` learns from."""

    # Policies: each teaches where it does better than the sweep, which teaches elsewhere.
    teachers: Annotated[tuple[Annotated[str, text(4096)], ...], Entries(0, 64)]
    teacher_share: Annotated[float, number(0, 1)]  # of missions, flown by the teacher itself
    # Who looks ahead does not teach where a decision takes longer; absent: _DECISION_MS.
    decision_ms: Annotated[float | None, number(1e-3, 1e6, 'ms')] = None

    @property
    def most_decision_ms(self) -> float:
        """What a decision of a teacher that looks ahead may take [ms]."""
        return _DECISION_MS if self.decision_ms is None else self.decision_ms


class TrainingConfig(Section):
    """All settings of a training."""

    name: Annotated[str, name()]
    observation: Annotated[str, words_or_code('paper', 'egocentric', 'relative')]
    reward: RewardSettings
    network: NetworkSettings
    mixer: MixerSettings
    exploration: ExplorationSettings
    target: TargetSettings
    optimiser: OptimiserSettings
    replay: ReplaySettings
    rollout: RolloutSettings
    validation: ValidationSettings
    courses: CourseSettings | None = None  # absent: it cannot learn on courses
    branches: BranchSettings | None = None  # absent: there are none
    imitation: ImitationSettings | None = None  # absent: there is none

    @property
    def layout(self) -> AnyLayout:
        """Layout of the observations."""
        return layout_named(self.observation)

    @property
    def memory_size(self) -> int:
        """Numbers that a UAV remembers from decision to decision."""
        size, own = self.network.hidden_size, self.network.own
        return memory_size(own, size) if own else size

    @property
    def code(self) -> tuple[str, ...]:
        """What users wrote of it, as module:name@version."""
        names = map(_code_name, self._named.values())
        return tuple(named_code(name).label for name in names if name)

    @property
    def _named(self) -> dict[tuple[str, ...], str | None]:
        """The settings that may name code, by their path."""
        return {
            ('observation',): self.observation,
            ('reward', 'goal'): self.reward.goal,
            ('network', 'kind'): self.network.kind,
            ('mixer', 'kind'): self.mixer.kind,
        }

    def advice_bonus(self, share_done: float) -> float:
        """What is added to the value of the advice after a share of the training."""
        first, last = self.network.advice_bonus or 0.0, self.network.advice_bonus_last
        decay_share = self.network.advice_decay_share
        if decay_share is None:
            decay_share = 1.0
        share = share_done / decay_share if decay_share > 0 else 1.0
        return _between(first, first if last is None else last, share)

    @property
    def advice_share(self) -> float:
        """Probability that a UAV which explores does what the layout's adviser would."""
        return self.exploration.advice_share or 0.0

    @property
    def reward_kind(self) -> Reward:
        """Which of the rewards missions sum up: where a user's follows, the energy's."""
        return Reward.PAPER if self.reward.goal == 'paper' else Reward.ENERGY

    @property
    def own_reward(self) -> OwnReward | None:
        """A user's reward, if the team gets one."""
        name = _code_name(self.reward.goal)
        return own_reward(name) if name else None

    def reward_units(self, briefing: Briefing) -> RewardUnits:
        """What a second and a joule are worth in a scenario, see also `learning.units`."""
        if self.reward.unit in ('crossing', 'sweep'):
            return crossing_units(self.reward.discount_per_s, briefing)
        return RewardUnits(discount_per_s=self.reward.discount_per_s, energy_j=KILOJOULE_J)

    def epsilon(self, share_done: float) -> float:
        """Probability to explore after a share of the training."""
        settings = self.exploration
        share = share_done / settings.decay_share if settings.decay_share > 0 else 1.0
        return _between(settings.epsilon_first, settings.epsilon_last, share)

    def missions_per_batch(self, share_done: float) -> int:
        """Missions that an update takes after a share of the training."""
        settings = self.replay
        is_exploring = share_done < self.exploration.decay_share
        first = settings.missions_per_batch_first or 0
        return first if is_exploring and first > 0 else settings.missions_per_batch

    def learning_rate(self, share_done: float) -> float:
        """Learning rate after a share of the training."""
        settings = self.optimiser
        left = 1.0 - settings.decay_from_share
        share = (share_done - settings.decay_from_share) / left if left > 0 else 0.0
        return _between(settings.learning_rate, settings.learning_rate_last, share)

    def max_decisions(self, n_cells: int) -> int:
        """After how many decisions a mission is cut off."""
        return max(2, round(self.rollout.max_decisions_per_cell * n_cells))

    @property
    def fingerprint(self) -> str:
        """16 hex digits that change with any setting, and with users' code that one names."""
        return hashlib.sha256('\n'.join((self.to_yaml(), *self.code)).encode()).hexdigest()[:16]

    def to_yaml(self) -> str:
        """The settings as a file that stands alone."""
        return yaml_text.dump(self.as_mapping())


def load_preset(
    name_or_path: str | Path, overrides: Mapping[str, object] | None = None
) -> TrainingConfig:
    """Read settings by their name among the shipped ones, or by the path of a YAML file.

    Args:
        name_or_path: 'strong', or 'my/settings.yaml'.
        overrides: values by dotted path ('target.trace'), which count more than the file's.

    Raises:
        ConfigError: one line per problem: file and line, key, value, what is allowed.
    """
    folders = shared_folders('training')
    document = layers.load(name_or_path, folders, field='preset', overrides=overrides)
    config = validated(TrainingConfig, document)
    _check_code(config, document)
    if config.layout.adviser == NONE:
        _refuse_advice(config, document)
    if config.network.advice_decay_share is not None and config.network.advice_bonus_last is None:
        raise ConfigError(
            document.problem(
                ('network', 'advice_decay_share'),
                f'is {config.network.advice_decay_share:g}: must come with'
                ' network.advice_bonus_last, to which the bonus falls',
            )
        )
    if config.replay.excerpt_decisions and config.replay.most_rows:
        keys = 'replay', 'rows_per_batch'
        what = f'is {config.replay.most_rows}: must be 0 where replay.sequence_decisions is not'
        raise ConfigError(document.problem(keys, what))
    return config


def _refuse_advice(config: TrainingConfig, document: layers.Document) -> None:
    """Refuse settings of an advice that observations do not show."""
    values = {
        ('network', 'advice_bonus'): config.network.advice_bonus,
        ('network', 'advice_bonus_last'): config.network.advice_bonus_last,
        ('exploration', 'advice_share'): config.advice_share,
    }
    what = f'must be 0 where observation is {config.observation}, which shows no advice'
    problems = [
        document.problem(keys, f'is {value:g}: {what}') for keys, value in values.items() if value
    ]
    if problems:
        raise ConfigError(*problems)


def _check_code(config: TrainingConfig, document: layers.Document) -> None:
    """Refuse names of users' code that is not there, or is not what it is named for."""
    problems = []
    for keys, given in config._named.items():
        if name := _code_name(given):
            try:
                _load_code(keys, name, config)
            except UserCodeError as error:
                problems.append(document.problem(keys, f'is {name}: {error}'))
    if problems:
        raise ConfigError(*problems)


def _load_code(keys: tuple[str, ...], name: str, config: TrainingConfig) -> None:
    match keys:
        case ('observation',):
            layout_named(name)
        case ('reward', 'goal'):
            own_reward(name)
        case ('network', 'kind'):
            own_network(name)
            memory_size(name, config.network.hidden_size)
        case _:
            own_mixer(name)


def _code_name(given: str | None) -> str:
    """The name of a user's code; '' where a setting has none."""
    return given if given is not None and is_code_name(given) else ''


def code_of_training(config: TrainingConfig, algorithm: str) -> tuple[str, ...]:
    """What users wrote that a training goes by, as module:name@version, each once."""
    own = (named_code(algorithm).label,) if is_code_name(algorithm) else ()
    return tuple(dict.fromkeys((*config.code, *own)))


def _between(first: float, last: float, share: float) -> float:
    return first + (last - first) * min(max(share, 0.0), 1.0)

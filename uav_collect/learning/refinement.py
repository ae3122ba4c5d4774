"""Goes on from a policy on one field: trains, and keeps what flies that field better.

A policy is chosen by missions of the field that all fly, with optimal bandwidth. What it is then
said to be, beside the rules, comes of other missions, which nothing was chosen by.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import torch
from uav_collect.analysis.against_rules import Flown, RULES, Standing, standing_of
from uav_collect.analysis.statistics import mission_seeds
from uav_collect.errors import ConfigError, DivergedError
from uav_collect.learning.learner import keep_freed_memory
from uav_collect.learning.trainer import Trainer
from uav_collect.missions.rollout import fly_for_metrics
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import Site
from uav_collect.training.progress import Budget, Progress
from uav_collect.training.seeds import VALIDATION_SEED
from uav_collect.uav.briefing import brief
from uav_collect.uav.observation import Layout, observation_size
from uav_collect.uav.policy_network import FrozenPolicy, LearnedPolicy

# Apart from each other, and from the missions that trainings validate by.
_CHOOSING_SEED, _JUDGING_SEED = VALIDATION_SEED + 2**30, VALIDATION_SEED + 2**31
# Settings by the observation of what is gone on from.
PRESETS = {Layout.EGOCENTRIC: 'field', Layout.RELATIVE: 'field_anywhere'}
_STALLED_SHARE = 0.25  # of the budget
_LEAST_SHARE = 0.5  # of the budget: before, the learning rate has hardly fallen


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """A policy, and what it achieved in the missions by which policies are chosen."""

    name: str
    policy: FrozenPolicy
    flown: Flown

    @property
    def rank(self) -> tuple[float, float]:
        """How good it is: of two, the one of greater rank is kept."""
        return self.flown.rank


@dataclass(frozen=True, kw_only=True)
class Step:
    """Where a refinement stands."""

    trained_s: float
    n_decisions: int
    best: Attempt | None  # None: nothing has flown yet
    is_better: bool  # it is another one than the step before had
    has_stalled: bool  # nothing more is to come: it ends here


class Trials:
    """The missions of a field by which policies are chosen, and those by which they are judged."""

    def __init__(self, site: Site, n_choosing: int, n_judging: int) -> None:
        """Fly the rules.

        Args:
            n_choosing: missions that policies are chosen by; `n_judging`: others, that say how
                the chosen one stands to the rules.

        Raises:
            ConfigError: the fleet has not the energy to start.
        """
        self._site = site
        self._choosing = mission_seeds(_CHOOSING_SEED, n_choosing)
        self._judging = mission_seeds(_JUDGING_SEED, n_judging)
        self.rules = {
            rule: Flown(metrics=fly_for_metrics(site, self._judging, rule)) for rule in RULES
        }

    def tried(self, name: str, policy: FrozenPolicy) -> Attempt:
        """Let a policy fly the missions by which policies are chosen."""
        return Attempt(name=name, policy=policy, flown=self._flown(policy, self._choosing))

    def judged(self, policy: FrozenPolicy) -> tuple[Flown, Standing]:
        """What a policy achieves in missions that it was not chosen by, and how it stands."""
        flown = self._flown(policy, self._judging)
        return flown, standing_of(flown, self.rules, _JUDGING_SEED)

    def _flown(self, policy: FrozenPolicy, seeds: Sequence[int]) -> Flown:
        make_policy = partial(replace, LearnedPolicy('refined', policy))
        return Flown(metrics=fly_for_metrics(self._site, seeds, make_policy))


def compute_as_trainings_do() -> None:
    """Let torch use one thread, and memory again: more threads on busy cores are slower."""
    torch.set_num_threads(1)
    keep_freed_memory()


def why_no_start(policy: FrozenPolicy, scenario: Scenario) -> str:
    """Why a policy cannot go on learning in a scenario, for people; '' if it can."""
    header = policy.header
    if header.network:
        return f'its network is {header.network}: must be the one of this program'
    own = f'its observation, {header.layout.label} of {header.observation_size} numbers,'
    if header.layout not in PRESETS:
        return f'{own} is none that is refined'
    # Outside of its domains a network knows nothing to go on from.
    if (rule := header.rule_for(brief(scenario))) is not None:
        return f'none of its networks decides there: it flies as {rule.label}'
    try:
        size = observation_size(header.layout, scenario.area.n_cells, scenario.n_uavs)
    except ConfigError as error:  # it has no room for the fleet
        return str(error)
    if header.observation_size != size:
        return f'{own} must have {size} there'
    return ''


def start_for(policy: FrozenPolicy, scenario: Scenario) -> FrozenPolicy | None:
    """A policy as one that flies a scenario, whatever it learned on; None: its network cannot."""
    if why_no_start(policy, scenario):
        return None
    header, area = policy.header, scenario.area
    policy, sides = policy.over(brief(scenario)), (area.n_rows, area.n_columns)
    widened = replace(
        header,
        cells_per_side_min=min(sides),
        cells_per_side_max=max(sides),
        n_uavs_min=scenario.n_uavs,
        n_uavs_max=scenario.n_uavs,
        domains=(),
    )
    return FrozenPolicy(widened, policy.weights)


def refinement(
    trainer: Trainer,
    trials: Trials,
    best: Attempt | None,
    budget: Budget,
    is_stopped: Callable[[], bool],
) -> Iterator[Step]:
    """Train until the budget is spent, nothing better comes any more, or it is stopped.

    Nothing better comes where, with half of the budget spent, a quarter of it brought none.

    Args:
        best: what a policy must be better than to be kept; None: any is.
        is_stopped: asked about once a second.

    Yields:
        About once a second, where it stands.

    Raises:
        DivergedError: loss or weights are no numbers any more.
    """
    better_at: float | None = None  # share of the budget; of the first try, if none was better
    for progress in _progress_of(trainer, budget, is_stopped):
        is_better = False
        if progress.validation is not None:
            tried = trials.tried('refined', trainer.policy())
            is_better = best is None or tried.rank > best.rank
            if is_better:
                best = tried
            if is_better or better_at is None:
                better_at = progress.share_done
        has_stalled = (
            better_at is not None
            and _LEAST_SHARE <= progress.share_done < 1.0
            and progress.share_done - better_at >= _STALLED_SHARE
        )
        yield Step(
            trained_s=progress.wall_s,
            n_decisions=progress.n_decisions,
            best=best,
            is_better=is_better,
            has_stalled=has_stalled,
        )
        if has_stalled or is_stopped():
            return


def _progress_of(
    trainer: Trainer, budget: Budget, is_stopped: Callable[[], bool]
) -> Iterator[Progress]:
    try:
        yield from trainer.run(budget, is_stopped)
    except DivergedError as error:
        raise DivergedError(f'the training diverged {error}') from error

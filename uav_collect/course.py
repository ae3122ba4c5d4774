"""A course: one of the scenarios that a policy learns to fly, and the experience with it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from uav_collect.briefing import brief, Briefing
from uav_collect.collector import Collector
from uav_collect.minibatch import Algorithm, Minibatch, minibatch
from uav_collect.mission_log import MissionLog
from uav_collect.observation import observation_size
from uav_collect.policy import LearnedPolicy
from uav_collect.replay import Replay
from uav_collect.rollout import fly
from uav_collect.scenario import ConfigError, Scenario
from uav_collect.site import build_site, Site
from uav_collect.training_config import TrainingConfig


@dataclass(frozen=True, kw_only=True)
class Course:
    """A scenario, who collects experience in it, and what was collected."""

    scenario: Scenario
    site: Site
    briefing: Briefing
    collector: Collector
    replay: Replay

    def minibatch(
        self, config: TrainingConfig, algorithm: Algorithm, rng: np.random.Generator
    ) -> Minibatch:
        """Missions drawn from the replay, ready for an update."""
        return minibatch(
            self.replay.sample(config.replay.missions_per_batch, rng),
            self.briefing,
            config.layout,
            algorithm,
            config.reward.discount_per_s,
        )

    def validate(self, pilot: LearnedPolicy, mission_seeds: Sequence[int]) -> list[MissionLog]:
        """Fly missions as the scenario has them, bandwidth shared equally as the paper trains."""
        return fly(self.scenario, self.site, mission_seeds, lambda: pilot, 'equal')


def new_courses(
    scenarios: Sequence[Scenario],
    config: TrainingConfig,
    algorithm: Algorithm,
    seed: int,
    device: str,
) -> list[Course]:
    """Courses at their start; they share the room of the replay.

    Raises:
        ConfigError: a fleet cannot start, or the scenarios' observations differ in size.
    """
    _check_same_size(scenarios, config)
    replay_size = config.replay.decisions // len(scenarios)
    courses = []
    for scenario in scenarios:
        site, briefing = build_site(scenario), brief(scenario)
        learned = _with_discount(scenario, config.reward.discount_per_s)
        collector = Collector(learned, site, config, algorithm, seed, device)
        replay = Replay(replay_size, briefing)
        courses.append(
            Course(
                scenario=scenario,
                site=site,
                briefing=briefing,
                collector=collector,
                replay=replay,
            )
        )
    return courses


def _with_discount(scenario: Scenario, discount_per_s: float) -> Scenario:
    """The scenario with the training's discount in its reward."""
    reward = scenario.reward.model_copy(update={'discount_per_s': discount_per_s})
    return scenario.model_copy(update={'reward': reward})


def _check_same_size(scenarios: Sequence[Scenario], config: TrainingConfig) -> None:
    sizes = {
        observation_size(config.layout, scenario.area.cells_per_side, scenario.n_uavs)
        for scenario in scenarios
    }
    if len(sizes) > 1:
        raise ConfigError(
            f'observation is {config.observation!r}: must be egocentric for scenarios of several '
            'areas or fleets'
        )

"""A task: one of the scenarios that a policy learns to fly, and the experience with it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from uav_collect.errors import ConfigError
from uav_collect.learning.collector import Collector
from uav_collect.learning.fleet_source import FleetSource
from uav_collect.learning.minibatch import Algorithm, make_minibatch, Minibatch
from uav_collect.learning.replay import Replay
from uav_collect.missions.rollout import fly
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site, Site
from uav_collect.training.config import TrainingConfig
from uav_collect.uav.briefing import Briefing, briefing_of
from uav_collect.uav.observation import observation_size
from uav_collect.uav.policy_network import LearnedPolicy

EpisodeSource = Collector | FleetSource  # where a task's episodes come from


@dataclass(frozen=True, kw_only=True)
class Task:
    """A site, where experience with its scenario comes from, and what was collected."""

    site: Site
    briefing: Briefing
    source: EpisodeSource
    replay: Replay

    def minibatch(
        self, config: TrainingConfig, algorithm: Algorithm, rng: np.random.Generator
    ) -> Minibatch:
        """Missions drawn from the replay, ready for an update."""
        return make_minibatch(
            self.replay.sample(config.replay.missions_per_batch, rng),
            self.briefing,
            config.layout,
            algorithm,
            config.reward.discount_per_s,
        )

    def validate(
        self,
        policy: LearnedPolicy,
        mission_seeds: Sequence[int],
        between_decisions: Callable[[], None] | None = None,
    ) -> list[MissionLog]:
        """Fly missions as the scenario has them, bandwidth shared equally as the paper trains.

        Without a guard: a policy that circles is to be seen to.
        """
        return fly(self.site, mission_seeds, lambda: policy, 'equal', 0, between_decisions)


def make_tasks(
    scenarios: Sequence[Scenario],
    config: TrainingConfig,
    algorithm: Algorithm,
    seed: int,
    device: str,
    sources: Sequence[EpisodeSource] | None,
) -> list[Task]:
    """Tasks at their start; they share the room of the replay.

    Args:
        sources: of each scenario's missions; None: each flies its own in this process.

    Raises:
        ConfigError: a fleet cannot start, or the scenarios' observations differ in size.
    """
    _check_same_size(scenarios, config)
    replay_size = config.replay.decisions // len(scenarios)
    tasks = []
    for index, scenario in enumerate(scenarios):
        site = build_site(scenario)
        briefing = briefing_of(site)
        if sources is None:
            learned = site.with_discount(config.reward.discount_per_s)
            source: EpisodeSource = Collector(learned, config, algorithm, seed, device)
        else:
            source = sources[index]
        replay = Replay(replay_size, briefing)
        tasks.append(Task(site=site, briefing=briefing, source=source, replay=replay))
    return tasks


def _check_same_size(scenarios: Sequence[Scenario], config: TrainingConfig) -> None:
    sizes = {
        observation_size(config.layout, scenario.n_cells, scenario.n_uavs)
        for scenario in scenarios
    }
    if len(sizes) > 1:
        raise ConfigError(
            f'observation is {config.observation!r}: must be egocentric for scenarios of several '
            'areas or fleets'
        )

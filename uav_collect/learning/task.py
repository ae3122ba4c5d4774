"""A task: one of the scenarios that a policy learns to fly, and the experience with it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from uav_collect.errors import ConfigError
from uav_collect.learning.collector import Collector
from uav_collect.learning.fleet_source import FleetSource
from uav_collect.learning.minibatch import (
    Algorithm,
    make_excerpt_minibatch,
    make_minibatch,
    Minibatch,
)
from uav_collect.learning.replay import Replay
from uav_collect.learning.saved import SavedPart
from uav_collect.learning.teaching import teaching
from uav_collect.missions.rollout import fly
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site, Site
from uav_collect.training.config import TrainingConfig
from uav_collect.uav.action_codes import NONE
from uav_collect.uav.briefing import Briefing, briefing_of
from uav_collect.uav.observation import observation_size
from uav_collect.uav.policy import NamedPolicy
from uav_collect.uav.policy_network import LearnedPolicy

EpisodeSource = Collector | FleetSource  # where a task's episodes come from


@dataclass(frozen=True, kw_only=True)
class Task:
    """A site, where experience with its scenario comes from, and what was collected."""

    site: Site
    briefing: Briefing
    source: EpisodeSource
    replay: Replay

    def has_batch(self, n_missions: int, config: TrainingConfig) -> bool:
        """Whether enough has been collected for an update by so many missions, or excerpts."""
        settings, n_decisions = config.replay, self.replay.n_decisions
        if n_decisions < (settings.decisions_before_updates or 0):
            return False
        if settings.excerpt_decisions:
            return self.replay.n_missions > 0
        if self.replay.n_missions >= n_missions:
            return True
        return 0 < settings.most_rows <= n_decisions

    def minibatch(
        self,
        n_missions: int,
        config: TrainingConfig,
        algorithm: Algorithm,
        rng: np.random.Generator,
    ) -> Minibatch:
        """Missions drawn from the replay, or excerpts of so many, ready for an update."""
        settings, replay = config.replay, self.replay
        discount_per_s = config.reward_units(self.briefing).discount_per_s
        how = self.briefing, config.layout, algorithm, discount_per_s
        if settings.excerpt_decisions:
            excerpts = replay.sample_excerpts(n_missions, settings.excerpt_decisions, rng)
            return make_excerpt_minibatch(excerpts, settings.burn_in_decisions or 0, *how)
        return make_minibatch(replay.sample(n_missions, rng, settings.most_rows), *how)

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


class FixedTasks:
    """Tasks of the same scenarios all the time, each in its turn."""

    def __init__(self, tasks: Sequence[Task]) -> None:
        """Begin with the first one."""
        self.tasks = tuple(tasks)
        self._turn = 0

    @property
    def n_decisions(self) -> int:
        """How many decisions were collected so far."""
        return sum(task.source.n_decisions for task in self.tasks)

    @property
    def n_missions(self) -> int:
        """How many missions were collected so far."""
        return sum(task.source.n_missions for task in self.tasks)

    def next_turn(self) -> tuple[int, ...]:
        """The place of the task whose turn it is: each update learns from one."""
        self._turn += 1
        return ((self._turn - 1) % len(self.tasks),)

    def teaches(self, place: int) -> bool:
        """Whether there is something to learn on the task of a place."""
        return True

    def count_update(self, place: int) -> None:
        """Note that the task of a place had its turn."""

    def state(self) -> dict[str, Any]:
        """All that they need to go on; the inverse is `restore`."""
        return {**states_of(self.tasks), 'turn': self._turn}

    def restore(self, saved: SavedPart) -> None:
        """Go on from the state of tasks of the same scenarios.

        Raises:
            CheckpointError: something that was saved is not what such tasks save.
        """
        restore_tasks(self.tasks, saved)
        self._turn = saved.whole('turn')


def states_of(tasks: Sequence[Task]) -> dict[str, Any]:
    """What tasks need to go on; the inverse is `restore_tasks`."""
    return {
        'sources': [task.source.state() for task in tasks],
        'replays': [{'held': task.replay.state()} for task in tasks],
    }


def restore_tasks(tasks: Sequence[Task], saved: SavedPart) -> None:
    """Let tasks of the same scenarios go on.

    Raises:
        CheckpointError: something that was saved is not what such tasks save.
    """
    parts = zip(
        tasks, saved.parts('sources', len(tasks)), saved.parts('replays', len(tasks)), strict=True
    )
    for task, source, replay in parts:
        task.source.restore(source)
        task.replay.restore(replay.optional('held'))


def make_tasks(
    scenarios: Sequence[Scenario],
    config: TrainingConfig,
    algorithm: Algorithm,
    seed: int,
    device: str,
    sources: Sequence[EpisodeSource] | None,
) -> FixedTasks:
    """Tasks at their start; they share the room of the replay.

    Args:
        sources: of each scenario's missions; None: each flies its own in this process.

    Raises:
        ConfigError: a fleet cannot start, the scenarios' observations differ in size, or the
            replay has no room for a batch.
    """
    _check_same_size(scenarios, config)
    n_tasks = len(scenarios)
    check_room(config, max(scenario.n_cells for scenario in scenarios), n_tasks)
    tasks = []
    for index, scenario in enumerate(scenarios):
        site = build_site(scenario)
        if sources is None:
            teacher = None
            if algorithm is Algorithm.IMITATION:
                teacher = teaching(site, config, algorithm, seed).policy
            source: EpisodeSource = new_collector(
                site, config, algorithm, seed, device, teacher=teacher
            )
        else:
            source = sources[index]
        tasks.append(new_task(site, source, config, n_tasks))
    return FixedTasks(tasks)


def new_collector(
    site: Site,
    config: TrainingConfig,
    algorithm: Algorithm,
    seed: int,
    device: str,
    part: int = 0,
    teacher: NamedPolicy | None = None,
) -> Collector:
    """What flies missions of a site to learn from, in this process.

    Args:
        part: of the run's mission seeds; each has its own.
        teacher: whom to imitate; None: the sweep.
    """
    units = config.reward_units(briefing_of(site))
    learned = site.with_discount(units.discount_per_s)
    return Collector(learned, config, algorithm, seed, device, part, teacher)


def new_task(site: Site, source: EpisodeSource, config: TrainingConfig, n_tasks: int) -> Task:
    """A task without experience.

    Args:
        n_tasks: that share the replay's room.
    """
    briefing, settings = briefing_of(site), config.replay
    sizes = settings.decisions // n_tasks, settings.most_observation_bytes // n_tasks
    replay = Replay(sizes[0], briefing, config.layout, sizes[1])
    return Task(site=site, briefing=briefing, source=source, replay=replay)


def check_algorithm(algorithm: Algorithm, config: TrainingConfig) -> None:
    """Refuse settings that an algorithm cannot learn by.

    Raises:
        ConfigError: one line that says which setting to change.
    """
    sections = {
        Algorithm.BRANCHES: (config.branches, 'anywhere'),
        Algorithm.IMITATION: (config.imitation, 'imitation'),
    }
    if algorithm not in sections:
        return
    section, preset = sections[algorithm]
    if section is None:
        raise ConfigError(
            f'preset {config.name}: {algorithm} is missing: must be there to learn by the '
            f'algorithm {algorithm}, as the preset {preset} has it'
        )
    if config.layout.adviser == NONE:
        raise ConfigError(
            f'observation is {config.observation!r}: must be relative to learn by the algorithm '
            f'{algorithm}, for which the adviser flies where nothing better is known'
        )


def check_room(config: TrainingConfig, n_cells: int, n_tasks: int) -> None:
    """Refuse settings by which some task could never hold enough missions for an update.

    Args:
        n_cells: of the largest area.
        n_tasks: that share the replay's room.

    Raises:
        ConfigError: one line that says which setting to change.
    """
    replay, longest = config.replay, config.max_decisions(n_cells)
    room = replay.decisions // n_tasks
    _check_first_update(config, room - longest)
    n_missions = max(replay.missions_per_batch, replay.missions_per_batch_first or 0)
    batch = n_missions * longest
    takes = f'{n_missions} missions of up to {longest:,} decisions'
    if replay.most_rows:
        # A mission may be dropped as another comes that is not in the batch yet.
        batch = min(batch, replay.most_rows + 2 * longest)
        takes = f'{replay.most_rows:,} decisions of missions of up to {longest:,}'
    if replay.excerpt_decisions:
        batch = longest
        takes = f'excerpts of a mission of up to {longest:,} decisions'
    if room < batch:
        each = f' for each of {n_tasks}' if n_tasks > 1 else ''
        raise ConfigError(
            f'replay.decisions is {replay.decisions:,}, room for {room:,}{each}, but a batch '
            f'takes {takes} in an area of {n_cells} cells: must be at least '
            f'{batch * n_tasks:,}, or replay.missions_per_batch or '
            'rollout.max_decisions_per_cell be less'
        )


def _check_first_update(config: TrainingConfig, most: int) -> None:
    """Refuse to wait for more decisions than a replay surely comes to hold."""
    least = config.replay.decisions_before_updates or 0
    if least > max(most, 0):
        raise ConfigError(
            f'replay.decisions_before_updates is {least:,}: must be at most {max(most, 0):,}, '
            'which each replay has room for beside one mission'
        )


def _check_same_size(scenarios: Sequence[Scenario], config: TrainingConfig) -> None:
    sizes = {
        observation_size(config.layout, scenario.n_cells, scenario.n_uavs)
        for scenario in scenarios
    }
    if len(sizes) > 1:
        raise ConfigError(
            f'observation is {config.observation!r}: must be egocentric or relative for scenarios '
            'of several areas or fleets'
        )

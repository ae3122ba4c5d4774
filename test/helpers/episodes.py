"""What tests learn from: small settings, missions written by hand and missions flown at random.

A mission by hand has two UAVs of the tiny world, a full completion map nowhere, and moves its UAVs
about at random; what matters is who decides when, what it does and what that earns.
"""

from collections.abc import Sequence
from types import ModuleType
from typing import NamedTuple

import numpy as np
import pytest
from uav_collect.kernels.arrays import Floats, Ints
from uav_collect.learning.minibatch import Algorithm, make_minibatch, Minibatch
from uav_collect.missions.experience import Episode, N_UAV_SCALARS, new_records
from uav_collect.missions.vector_env import VectorEnv, VectorEnvConfig
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.training.config import load_preset, TrainingConfig
from uav_collect.uav.action_codes import N_ACTIONS, NONE
from uav_collect.uav.briefing import brief, Briefing

ALL_LEGAL = 2**N_ACTIONS - 1


def single_threaded_torch() -> ModuleType:
    """The module torch; tests that need it are skipped where it is missing."""
    torch: ModuleType = pytest.importorskip('torch', reason='training needs torch')
    torch.set_num_threads(1)  # tests run side by side
    return torch


def small(preset: str = 'paper', **overrides: object) -> TrainingConfig:
    """Settings of a small training; overrides by dotted path, with __ for the dot."""
    sizes = {
        'network.hidden_size': 8, 'mixer.embedding_size': 4, 'mixer.hypernetwork_size': 6,
        'mixer.pool_side': 2, 'replay.decisions': 2000, 'replay.missions_per_batch': 4,
        'rollout.missions_at_once': 4, 'rollout.max_decisions_per_cell': 2.5,
        'rollout.decisions_per_update': 40, 'validation.missions': 2,
        'validation.every_updates': 4, 'validation.every_missions': 0,
        'replay.sequence_decisions': 0,
    }  # fmt: skip
    values = {name.replace('__', '.'): value for name, value in overrides.items()}
    return load_preset(preset, sizes | values)


class HandDecision(NamedTuple):
    """One decision of a mission by hand."""

    uav: int
    time_s: float
    action: int
    reward: float = 0.0  # until the next decision, discounted to this one
    home: Sequence[int] = ()  # UAVs that decide no more
    legal: int = ALL_LEGAL  # bits by action


def hand_episode(
    briefing: Briefing, decisions: Sequence[HandDecision], end_s: float | None, seed: int = 0
) -> Episode:
    """A mission by hand.

    Args:
        end_s: when it ends; None: cut off at its last decision, whose action is not known.
        seed: of what its UAVs see.
    """
    n_cells = len(briefing.is_open)
    records, rng = new_records(len(decisions), briefing), np.random.default_rng(seed)
    for table in (records.complete, records.true_complete, records.seen):
        table[...] = rng.integers(256, size=table.shape)
    records.fleet[...] = rng.uniform(size=records.fleet.shape)
    records.energy_left_j[...] = rng.uniform(high=1e6, size=len(decisions))
    records.cell[...] = rng.integers(n_cells, size=len(decisions))
    records.previous_action[...] = rng.integers(N_ACTIONS, size=len(decisions))
    for row, decision in enumerate(decisions):
        records.uav[row] = decision.uav
        records.decision[row] = sum(it.uav == decision.uav for it in decisions[:row])
        records.time_s[row] = decision.time_s
        records.action[row] = decision.action
        records.reward[row] = decision.reward
        records.legal[row] = decision.legal
        active = records.fleet[row, N_UAV_SCALARS - 1 :: N_UAV_SCALARS]
        active[...] = [uav not in decision.home for uav in range(briefing.n_uavs)]
    ends_s = [decision.time_s for decision in decisions[1:]] + [end_s or decisions[-1].time_s]
    records.duration_s[...] = np.array(ends_s) - records.time_s
    if end_s is None:
        records.action[-1] = NONE
    return Episode(
        mission_seed=seed,
        demand_bit=rng.uniform(high=1e6, size=n_cells),
        records=records,
        is_whole=end_s is not None,
    )


def drawn_episode(briefing: Briefing, n_decisions: int, seed: int) -> Episode:
    """A mission by chance: who decides, when, what that earns, and whether it is cut off."""
    rng = np.random.default_rng(seed)
    times_s = np.cumsum(rng.choice([0.0, 2.5, 5.0], size=n_decisions))
    decisions = [
        HandDecision(
            uav=int(rng.integers(briefing.n_uavs)),
            time_s=float(time_s),
            action=int(rng.integers(N_ACTIONS)),
            reward=float(rng.normal()),
            legal=int(rng.integers(1, ALL_LEGAL + 1)),
        )
        for time_s in times_s
    ]
    end_s = float(times_s[-1] + 3.0) if rng.random() < 0.7 else None
    return hand_episode(briefing, decisions, end_s, seed)


def batch_of(
    episodes: Sequence[Episode],
    scenario: Scenario,
    config: TrainingConfig,
    algorithm: Algorithm = Algorithm.AQMIX,
) -> Minibatch:
    """The missions ready for an update."""
    discount_per_s = config.reward.discount_per_s
    return make_minibatch(episodes, brief(scenario), config.layout, algorithm, discount_per_s)


class Flown(NamedTuple):
    """Missions flown at random, and what was handed out on the way."""

    episodes: list[Episode]
    observations: list[list[Floats]]  # of each decision of each mission


def flown(scenario: Scenario, seeds: Sequence[int], max_decisions: int, **how: object) -> Flown:
    """Fly missions by random legal actions, up to so many decisions of each."""
    config = VectorEnvConfig(max_decisions=max_decisions, **how)  # type: ignore[arg-type]
    env = VectorEnv(build_site(scenario), seeds, config)
    rng = np.random.default_rng(0)
    observations: list[list[Floats]] = [[] for _ in seeds]
    decisions = env.decisions
    for step in range(max_decisions + 1):
        for world in np.flatnonzero(decisions.uav != NONE):
            observations[world].append(decisions.observation[world].copy())
        if step < max_decisions:
            drawn = decisions.legal * rng.uniform(0.1, 1.0, decisions.legal.shape)
            chosen: Ints = drawn.argmax(axis=1)
            decisions = env.step(chosen)
    return Flown([env.episode(world) for world in range(len(seeds))], observations)

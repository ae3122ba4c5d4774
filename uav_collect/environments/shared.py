"""What all environments share: arguments, spaces, masks, and which missions they fly."""

from dataclasses import dataclass
from itertools import pairwise
import operator
from pathlib import Path
from typing import Any

from gymnasium.spaces import Box, Dict
import numpy as np
from numpy.typing import NDArray
from uav_collect.kernels.arrays import Bools
from uav_collect.limits import MAX_SEED
from uav_collect.missions.vector_env import VectorEnv, VectorEnvConfig
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site, Site
from uav_collect.uav.action_codes import HOVER, N_ACTIONS
from uav_collect.uav.observation import Layout, observation_bound
from uav_collect.world.reward import Reward
from uav_collect.world.sensor_field import lay_out

# Missions that learners alone fly: above those of trainings (`training/seeds.py`), which are
# above all that users name by hand. Each seed of a learner has 2^32 of its own.
_FIRST_OF_RESETS, _N_RANGES, _SEEDS_PER_RANGE = 3 * 2**60, 2**28, 2**32

RGB_ARRAY = 'rgb_array'
IN_INFO, IN_OBSERVATION = 'info', 'observation'

Mask = NDArray[np.int8]
Seen = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, eq=False)
class EnvironmentSetup:
    """What an environment is made of, checked."""

    site: Site
    config: VectorEnvConfig
    max_decisions: int | None  # of a mission, by the whole fleet; None: until all have landed
    is_mask_observed: bool  # the mask is part of what is observed
    render_mode: str | None

    @property
    def discount_per_s(self) -> float:
        """What a reward is worth a second earlier."""
        return self.site.scenario.reward.discount_per_s

    def seen(self, observed: Seen, mask: Mask) -> Any:  # noqa: ANN401 - an array or a dictionary
        """What an agent is handed: the observation, with the mask if that is wanted there."""
        return (
            {'observation': observed, 'action_mask': mask} if self.is_mask_observed else observed
        )

    def observation_space(self, env: VectorEnv) -> Box | Dict:
        """The space of what one agent is handed, within a rough bound; a new one each time."""
        if self.config.layout is None:
            raise ValueError('config.layout is None: agents must observe something')
        bound = observation_bound(self.config.layout, env.briefing, _most_bit(self.site))
        shape = env.decisions.observation.shape[1:]
        box = Box(-bound, bound, shape, np.float32)
        if not self.is_mask_observed:
            return box
        return Dict({'observation': box, 'action_mask': Box(0, 1, (N_ACTIONS,), np.int8)})


def environment_setup(
    scenario: Scenario | str | Path,
    *,
    reward: str,
    layout: str,
    bandwidth: str,
    max_decisions: int | None,
    mask_in: str,
    render_mode: str | None = None,
    is_synchronous: bool = False,
    is_logged: bool = True,
) -> EnvironmentSetup:
    """The arguments that all environments take, checked.

    Args:
        scenario: a shipped one by its name, a YAML file, or one that is loaded.
        reward: paper or energy, see `reward`.
        layout: of observations: egocentric, for up to 6 UAVs, paper, or relative, for up to 16,
            where actions are in a frame of the UAV's own and the sweep has UAVs fly home.
        bandwidth: how a hover shares bandwidth: exact or equal.
        max_decisions: of the whole fleet, after which a mission is cut off.
        mask_in: info, or observation: then what is observed is a dictionary of both.
        render_mode: rgb_array to draw the ways so far.

    Raises:
        ConfigError: the scenario is not valid.
        ValueError: another argument is none of these.
    """
    if max_decisions is not None and max_decisions < 1:
        raise ValueError(f'max_decisions is {max_decisions}: must be 1 or more')
    if render_mode not in (None, RGB_ARRAY):
        raise ValueError(f'render_mode is {render_mode!r}: must be {RGB_ARRAY!r} or None')
    if mask_in not in (IN_INFO, IN_OBSERVATION):
        raise ValueError(f'mask_in is {mask_in!r}: must be {IN_INFO} or {IN_OBSERVATION}')
    config = VectorEnvConfig(
        layout=Layout[_one_of('layout', layout, Layout)],
        allocator=bandwidth,
        reward=Reward[_one_of('reward', reward, Reward)],
        is_synchronous=is_synchronous,
        is_logged=is_logged,
    )
    given = scenario if isinstance(scenario, Scenario) else load(scenario)
    return EnvironmentSetup(
        site=build_site(given),
        config=config,
        max_decisions=max_decisions,
        is_mask_observed=mask_in == IN_OBSERVATION,
        render_mode=render_mode,
    )


class MissionSeeds:
    """Which mission each reset flies: the one asked for, or else one that nobody tests on."""

    def __init__(self) -> None:
        self._next = first_seed_of_resets(0)

    def of_reset(self, seed: int | None) -> int:
        """The mission of a reset: a given seed itself, and it settles what later ones fly.

        Raises:
            ValueError: the seed is out of range.
        """
        if seed is None:
            return self.draw()
        chosen = checked_seed(seed)
        self.begin(chosen)
        return chosen

    def begin(self, seed: int) -> None:
        """Begin the missions that follow from a seed."""
        self._next = first_seed_of_resets(seed)

    def draw(self) -> int:
        """The next mission of those that are kept for learners."""
        self._next += 1
        return self._next - 1


def first_seed_of_resets(seed: int) -> int:
    """Seed of the first mission that is flown after a seed was given, and no mission is named."""
    return _FIRST_OF_RESETS + seed % _N_RANGES * _SEEDS_PER_RANGE


def checked_seed(seed: int) -> int:
    """The seed of a mission.

    Raises:
        ValueError: it is out of range.
    """
    chosen = operator.index(seed)
    if not 0 <= chosen <= MAX_SEED:
        raise ValueError(f'seed is {chosen}: must be 0..2^62')
    return chosen


def mask_of(legal: Bools | None) -> Mask:
    """Which actions are legal, 1 or 0; none where nobody decides."""
    return np.zeros(N_ACTIONS, np.int8) if legal is None else legal.astype(np.int8)


def idle_mask() -> Mask:
    """That of a UAV which does not decide, where each must act: hover, which does nothing."""
    mask = np.zeros(N_ACTIONS, np.int8)
    mask[HOVER] = 1
    return mask


def _one_of(argument: str, value: str, kinds: type[Layout] | type[Reward]) -> str:
    names = [kind.name.lower() for kind in kinds]
    if value not in names:
        raise ValueError(f'{argument} is {value!r}: must be {" or ".join(names)}')
    return value.upper()


def _most_bit(site: Site) -> float:
    """The most data that a cell can hold."""
    sensor_field = lay_out(site)
    given_bit = np.asarray(sensor_field.given_bit)
    amounts_bit = np.where(np.isnan(given_bit), sensor_field.high_bit, given_bit)
    return max(
        float(amounts_bit[first:stop].sum()) for first, stop in pairwise(sensor_field.first_sensor)
    )

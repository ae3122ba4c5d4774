"""Many missions at once as a Gymnasium vector environment over arrays, flown by the kernels.

Each world is a mission as `TurnEnv` flies it: the UAV decides whose action ended first, and a step
answers all worlds. Arrays have a row for each world, and are the caller's own:

- observations (W, size) float32; with `mask_in='observation'` a dictionary of `observation` and
  `action_mask`
- rewards (W,): the team's since the world's decision before, discounted to that
- `infos['action_mask']` (W, 5) int8, `['uav']` (W,) from 1, `['time_s']`, `['duration_s']` since
  the decision before, `['discount']`: gamma to the power of that

A world whose mission has ended begins another one in the same step (Gymnasium's `SAME_STEP`): its
row of the observations and masks is of the new mission, its reward, duration and discount of the
old. What was seen last of missions that ended, however they did, is `infos['final_obs']`, where
`_final_obs` is true; what they achieved, `infos['final_info']`, where `_final_info` is.

Where a fault leaves nobody to decide from the start on, `uav` is 0, and hover, the one legal
action, ends the mission.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
from gymnasium.spaces import Discrete
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
import numpy as np
from numpy.typing import NDArray
from uav_collect.environments.shared import (
    checked_seed,
    environment_setup,
    IN_INFO,
    Mask,
    MissionSeeds,
)
from uav_collect.kernels.arrays import Bools, check_shape, Floats, Ints
from uav_collect.missions.vector_env import AwaitedDecisions, VectorEnv
from uav_collect.scenario.model import Scenario
from uav_collect.uav.action_codes import HOVER, N_ACTIONS, NONE
from uav_collect.uav.frames import COMPASS_ACTIONS

_Step = tuple[Any, Floats, Bools, Bools, dict[str, Any]]


class WorldsEnv(gymnasium.vector.VectorEnv):
    """Missions of a scenario side by side; the arguments are those of `env`."""

    metadata: ClassVar[dict[str, Any]] = {
        'render_modes': [],
        'autoreset_mode': AutoresetMode.SAME_STEP,
    }

    def __init__(
        self,
        scenario: Scenario | str | Path = 'paper_10x10',
        *,
        num_envs: int = 64,
        reward: str = 'paper',
        layout: str = 'egocentric',
        bandwidth: str = 'exact',
        max_decisions: int | None = None,
        mask_in: str = IN_INFO,
    ) -> None:
        """Get ready for `reset`.

        Args:
            num_envs: how many worlds there are.

        Raises:
            ConfigError: the scenario is not valid, or has too many UAVs for the layout.
            ValueError: another argument is none of those that `env` takes.
        """
        if num_envs < 1:
            raise ValueError(f'num_envs is {num_envs}: must be 1 or more')
        self._setup = environment_setup(
            scenario,
            reward=reward,
            layout=layout,
            bandwidth=bandwidth,
            max_decisions=max_decisions,
            mask_in=mask_in,
            is_logged=False,
        )
        self.num_envs = num_envs
        self._env = VectorEnv(self._setup.site, range(num_envs), self._setup.config)
        self._seeds, self._worlds = MissionSeeds(), np.arange(num_envs)
        self._mission_seeds = np.zeros(num_envs, np.int64)
        self._n_decisions = np.zeros(num_envs, np.int64)
        self.single_observation_space = self._setup.observation_space(self._env)
        self.single_action_space = Discrete(N_ACTIONS)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Let a mission take off in each world.

        Args:
            seed: from which all later missions follow. They are those that are kept for learners:
                no test flies them.
            options: `mission_seeds`, (W,): the missions to fly first instead, whatever they are.

        Raises:
            ValueError: a seed is out of range, or there are not as many as worlds.
        """
        chosen = None if seed is None else checked_seed(seed)
        super().reset(seed=chosen)
        if chosen is not None:
            self._seeds.begin(chosen)
        given: Sequence[int] | None = (options or {}).get('mission_seeds')
        if given is None:
            given = [self._seeds.draw() for _ in range(self.num_envs)]
        check_shape(np.asarray(given), (self.num_envs,), 'mission_seeds')
        self._begin(self._worlds.tolist(), [checked_seed(each) for each in given])
        return self._handed_out(), self._infos(np.zeros(self.num_envs))

    def step(self, actions: Ints) -> _Step:
        """Carry out an action of each mission, and fly on to the next decision of each.

        Args:
            actions: shape (W,); whole numbers.

        Returns:
            Observations, rewards, terminations, truncations and infos.

        Raises:
            ValueError: an action is not legal; then nothing has changed.
        """
        chosen = np.asarray(actions)
        check_shape(chosen, (self.num_envs,), 'actions')
        self._check_legal(chosen)
        decisions = self._env.step(self._turned[self._worlds, chosen])
        reward, duration_s = decisions.reward.copy(), decisions.duration_s.copy()
        self._n_decisions += 1
        is_over = decisions.uav == NONE
        is_cut = self._cut_off(is_over)
        ended = np.flatnonzero(is_over | is_cut)
        last = self._last(decisions, ended) if len(ended) else {}
        if len(ended):
            self._begin(ended.tolist(), [self._seeds.draw() for _ in ended])
        return self._handed_out(), reward, is_over, is_cut, self._infos(duration_s) | last

    def _begin(self, worlds: Sequence[int], mission_seeds: Sequence[int]) -> None:
        self._env.restart_all(worlds, mission_seeds)
        self._mission_seeds[worlds] = mission_seeds
        self._n_decisions[worlds] = 0

    def _cut_off(self, is_over: Bools) -> Bools:
        limit = self._setup.max_decisions
        if limit is None:
            return np.zeros(self.num_envs, bool)
        is_cut: Bools = (self._n_decisions >= limit) & ~is_over
        return is_cut

    def _check_legal(self, chosen: NDArray[Any]) -> None:
        if chosen.dtype.kind not in 'iu':
            raise ValueError(f'actions are {chosen.dtype}: must be whole numbers')
        is_action = (chosen >= 0) & (chosen < N_ACTIONS)
        refused = ~is_action | (self._mask[self._worlds, chosen * is_action] == 0)
        if refused.any():
            world = int(np.flatnonzero(refused)[0])
            raise ValueError(
                f'action {chosen[world]} of UAV {self._env.decisions.uav[world] + 1} in mission '
                f'{self._mission_seeds[world]} is not legal; legal are '
                f'{np.flatnonzero(self._mask[world]).tolist()}'
            )

    def _handed_out(self) -> Any:  # noqa: ANN401 - an array or a dictionary
        """What is observed now; and what is legal, which the next step is checked by."""
        decisions = self._env.decisions
        self._turned = COMPASS_ACTIONS[decisions.frame]  # (W, N_ACTIONS)
        self._mask: Mask = decisions.legal[self._worlds[:, None], self._turned].view(np.int8)
        observed = decisions.observation.astype(np.float32)
        if (is_over := decisions.uav == NONE).any():  # before anybody was asked
            self._mask[is_over, HOVER] = 1
            observed[is_over] = 0.0
        return self._setup.seen(observed, self._mask.copy())

    def _infos(self, duration_s: Floats) -> dict[str, Any]:
        decisions = self._env.decisions
        return {
            'action_mask': self._mask.copy(),
            'uav': decisions.uav + 1,
            'time_s': decisions.time_s.copy(),
            'duration_s': duration_s,
            'discount': self._setup.discount_per_s**duration_s,
        }

    def _last(self, decisions: AwaitedDecisions, ended: Ints) -> dict[str, Any]:
        """What there is to say of missions that end with this step."""
        has_ended = np.isin(self._worlds, ended)
        achieved = {
            'mission_seed': self._mission_seeds.copy(),
            'time_s': decisions.time_s.copy(),
            'efficiency_kbit_per_j': np.zeros(self.num_envs),
            'collected_share': np.zeros(self.num_envs),
        }
        for world in ended.tolist():
            achieved['efficiency_kbit_per_j'][world] = self._env.efficiency_kbit_per_j(world)
            achieved['collected_share'][world] = self._env.collected_share(world)
        turned = COMPASS_ACTIONS[decisions.frame]
        mask = decisions.legal[self._worlds[:, None], turned].view(np.int8)
        mask[decisions.uav == NONE] = 0
        return {
            'final_obs': self._setup.seen(decisions.observation.astype(np.float32), mask),
            '_final_obs': has_ended,
            'final_info': achieved,
            '_final_info': has_ended,
        }

"""A mission as a Gymnasium environment: one learner decides for whichever UAV is next.

- An observation is that of the UAV whose action ended first, `info['uav']`, from 1; actions are 0
  hover, 1 north, 2 east, 3 south, 4 west. The mask of legal actions is `info['action_mask']`, and
  with `mask_in='observation'` part of what is observed.
- A reward is the team's since the decision before, whoever made it, discounted to that;
  `info['duration_s']` are the seconds in between and `info['discount']` is gamma to their power.
- A mission terminates when all have landed, and is truncated after `max_decisions` of the fleet.
  Where a fault leaves nobody to decide from the start on, `uav` is 0, and hover, the one legal
  action, ends it.

`WorldsEnv` is the same for many missions at once.
"""

import operator
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
from gymnasium.spaces import Discrete
import numpy as np
from numpy.typing import NDArray
from uav_collect.environments.shared import (
    checked_seed,
    environment_setup,
    idle_mask,
    IN_INFO,
    Mask,
    mask_of,
    MissionSeeds,
    RGB_ARRAY,
)
from uav_collect.missions.vector_env import VectorEnv
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.model import Scenario
from uav_collect.uav.action_codes import N_ACTIONS, NONE
from uav_collect.uav.frames import COMPASS_ACTIONS
from uav_collect.world.sensor_field import demand_of


class TurnEnv(gymnasium.Env):
    """One mission after the other of a scenario; the arguments are those of `env`."""

    metadata: ClassVar[dict[str, Any]] = {'render_modes': [RGB_ARRAY]}

    def __init__(
        self,
        scenario: Scenario | str | Path = 'paper_10x10',
        *,
        reward: str = 'paper',
        layout: str = 'egocentric',
        bandwidth: str = 'exact',
        max_decisions: int | None = None,
        mask_in: str = IN_INFO,
        render_mode: str | None = None,
    ) -> None:
        """Get ready for `reset`.

        Raises:
            ConfigError: the scenario is not valid, or has too many UAVs for the layout.
            ValueError: another argument is none of those that `env` takes.
        """
        self._setup = environment_setup(
            scenario,
            reward=reward,
            layout=layout,
            bandwidth=bandwidth,
            max_decisions=max_decisions,
            mask_in=mask_in,
            render_mode=render_mode,
        )
        self.render_mode = render_mode
        self._seeds = MissionSeeds()
        self._env = VectorEnv(self._setup.site, [0], self._setup.config)
        self.observation_space = self._setup.observation_space(self._env)
        self.action_space = Discrete(N_ACTIONS)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Let a mission take off.

        Args:
            seed: of the mission, 0..2^62. If it is not given, of the next of those that are kept
                for learners, and which that is follows from the seed given last.
            options: none is known.

        Raises:
            ValueError: the seed is out of range.
        """
        chosen = None if seed is None else checked_seed(seed)
        super().reset(seed=chosen)
        self._seed = self._seeds.of_reset(chosen)
        self._env.restart(0, self._seed)
        self._n_decisions = 0
        return self._seen(), self._info()

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Carry out the action of the UAV that decides, and fly on to the next decision.

        Raises:
            ValueError: the action is not legal; then nothing has changed.
        """
        decisions, mask, chosen = self._env.decisions, self._mask(), operator.index(action)
        if not (0 <= chosen < N_ACTIONS and mask[chosen]):
            raise ValueError(
                f'action {chosen} of UAV {decisions.uav[0] + 1} in mission {self._seed} is not'
                f' legal; legal are {np.flatnonzero(mask).tolist()}'
            )
        compass_action = COMPASS_ACTIONS[decisions.frame[0], chosen]
        decisions = self._env.step(np.array([compass_action]))
        self._n_decisions += 1
        is_over = bool(decisions.uav[0] == NONE)
        is_cut = not is_over and self._n_decisions == self._setup.max_decisions
        return self._seen(), float(decisions.reward[0]), is_over, is_cut, self._info()

    def mission_log(self, policy_name: str = 'gymnasium') -> MissionLog:
        """The log of the mission so far; a name for what flies it stands in its header."""
        return self._env.mission_log(0, policy_name)

    def render(self) -> NDArray[np.uint8] | None:
        """The picture of the ways so far, (height, width, 3), if `render_mode` says so."""
        if self.render_mode is None:
            return None
        # Here, as many environments never draw.
        from uav_collect.analysis.trajectories import pixels

        site = self._setup.site
        return pixels(self.mission_log(), site, demand_of(site, self._seed))

    def _mask(self) -> Mask:
        decisions = self._env.decisions
        if decisions.uav[0] == NONE:
            return idle_mask() if self._n_decisions == 0 else mask_of(None)
        return mask_of(decisions.legal[0][COMPASS_ACTIONS[decisions.frame[0]]])

    def _seen(self) -> Any:  # noqa: ANN401 - an array or a dictionary
        decisions = self._env.decisions
        observed = decisions.observation[0].astype(np.float32)
        if decisions.uav[0] == NONE and self._n_decisions == 0:
            observed[:] = 0.0  # not what the mission before showed
        return self._setup.seen(observed, self._mask())

    def _info(self) -> dict[str, Any]:
        decisions = self._env.decisions
        duration_s = float(decisions.duration_s[0])
        return {
            'action_mask': self._mask(),
            'uav': int(decisions.uav[0]) + 1,
            'mission_seed': self._seed,
            'time_s': float(decisions.time_s[0]),
            'duration_s': duration_s,
            'discount': self._setup.discount_per_s**duration_s,
        }

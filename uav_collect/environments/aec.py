"""The world as a PettingZoo environment: a mission in which the UAV that is done decides next.

- Agents are `uav_1`, `uav_2`, ...; `agent_selection` is the one whose action ended first. Actions
  are 0 hover, 1 north, 2 east, 3 south, 4 west.
- An observation is the vector that learned policies fly by. The mask of legal actions is
  `infos[agent]['action_mask']`, and with `mask_in='observation'` part of what is observed; an
  illegal action is a ValueError and changes nothing.
- All UAVs earn the team's reward. Between two decisions of a UAV it is summed over what all UAVs
  do meanwhile, each part discounted to the UAV's earlier decision; `last()` hands that sum out at
  the later one, with the seconds in between as `infos[agent]['duration_s']` and gamma to that
  power as `infos[agent]['discount']`. So a target of the earlier decision is the sum plus
  `discount` times the value of the later one. Before its first decision a UAV earns nothing.
- A UAV that must fly home, for its energy or its complete map, decides no more but goes on to earn
  until the mission ends: then all agents terminate, and their last sums tell what was earned since
  their last decisions, the way home and the bonus included. After `max_decisions` of the fleet all
  are truncated; what a UAV would have seen next is then known of the one alone that has a mask.
- `state()` is the global state of the mission, for a mixer or a central critic.

A mission is the one that any other way of flying it gives: the same kernels, the same log.
PettingZoo's `api_test` and `seed_test` pass without a warning.
"""

import operator
from pathlib import Path
from typing import Any, ClassVar

from gymnasium import logger
from gymnasium.spaces import Box, Dict, Discrete
import numpy as np
from numpy.typing import NDArray
from pettingzoo import AECEnv
from pettingzoo.utils.wrappers import OrderEnforcingWrapper
from uav_collect.environments.shared import (
    environment_setup,
    EnvironmentSetup,
    IN_INFO,
    mask_of,
    MissionSeeds,
    RGB_ARRAY,
    Seen,
)
from uav_collect.kernels.arrays import Bools
from uav_collect.missions.vector_env import VectorEnv
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.model import Scenario
from uav_collect.uav.action_codes import N_ACTIONS, NONE
from uav_collect.uav.frames import COMPASS_ACTIONS
from uav_collect.world.sensor_field import demand_of


def env(
    scenario: Scenario | str | Path = 'paper_10x10',
    *,
    reward: str = 'paper',
    layout: str = 'egocentric',
    bandwidth: str = 'exact',
    max_decisions: int | None = None,
    mask_in: str = IN_INFO,
    render_mode: str | None = None,
) -> AECEnv:
    """A mission as an AECEnv that says when its methods are called in the wrong order.

    Args:
        scenario: a shipped one by its name, a YAML file, or one that is loaded.
        reward: paper or energy, see `reward`.
        layout: of observations: egocentric, for up to 6 UAVs, paper, or relative, for up to 16,
            where actions are in a frame of the UAV's own and the sweep has UAVs fly home.
        bandwidth: how a hover shares bandwidth: exact or equal.
        max_decisions: of the whole fleet, after which a mission is cut off.
        mask_in: info; or observation, then what an agent observes is a dictionary of
            `observation` and `action_mask`.
        render_mode: rgb_array to draw the ways so far.

    Raises:
        ConfigError: the scenario is not valid, or has too many UAVs for the layout.
        ValueError: another argument is none of these.
    """
    setup = environment_setup(
        scenario,
        reward=reward,
        layout=layout,
        bandwidth=bandwidth,
        max_decisions=max_decisions,
        mask_in=mask_in,
        render_mode=render_mode,
    )
    return OrderEnforcingWrapper(MissionEnv(setup))


class MissionEnv(AECEnv):
    """One mission after the other of a scenario; `env` makes it."""

    metadata: ClassVar[dict[str, Any]] = {
        'name': 'uav_collect_v0',
        'render_modes': [RGB_ARRAY],
        'is_parallelizable': False,  # UAVs decide one by one
    }

    def __init__(self, setup: EnvironmentSetup) -> None:
        """Get ready for `reset`."""
        super().__init__()
        self.render_mode = setup.render_mode
        self._setup, self._site = setup, setup.site
        self._discount_per_s = setup.discount_per_s
        self._seeds = MissionSeeds()
        self._env = VectorEnv(self._site, [0], setup.config)
        self.possible_agents = [f'uav_{uav + 1}' for uav in range(self._site.scenario.n_uavs)]
        # Each agent has spaces of its own: they are seeded one by one.
        self.observation_spaces = {
            agent: setup.observation_space(self._env) for agent in self.possible_agents
        }
        self.action_spaces = {agent: Discrete(N_ACTIONS) for agent in self.possible_agents}
        self.state_space = Box(0.0, 1.0, self._env.global_state(0).shape, np.float32)

    def observation_space(self, agent: str) -> Box | Dict:
        """The observations of an agent: numbers of the order of one, within a rough bound."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Discrete:
        """The actions of an agent."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        """Let a mission take off.

        Args:
            seed: of the mission, 0..2^62. If it is not given, of the next of those that are kept
                for learners, and which that is follows from the seed given last.
            options: none is known.

        Raises:
            ValueError: the seed is out of range.
        """
        self._seed = self._seeds.of_reset(seed)
        self._env.restart(0, self._seed)
        self._n_decisions = 0
        self._decided_s: dict[str, float] = {}  # when each agent decided last
        self.agents = self.possible_agents[:]
        self.agent_selection = self.agents[0]
        self._skip_agent_selection = None
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        nothing: Seen = np.zeros(self._env.decisions.observation.shape[1], np.float32)
        self._seen = dict.fromkeys(self.agents, nothing)
        self.infos = {agent: self._info(agent, 0.0, None) for agent in self.agents}
        self._look()

    def step(self, action: int | None) -> None:
        """Start the action of the agent that decides, or let one go whose mission is over.

        Args:
            action: a legal one; None once the agent is terminated or truncated.

        Raises:
            ValueError: the action is not legal.
        """
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        if action is None:
            raise ValueError(f'{agent} decides: its action must not be None')
        now_s = float(self._env.decisions.time_s[0])
        chosen = operator.index(action)
        if not -(2**63) <= chosen < 2**63:  # what no array holds
            raise ValueError(f'action of {agent} is {chosen}: must be 0..{N_ACTIONS - 1}')
        reward = float(self._env.step(np.array([self._compass_action(chosen)])).reward[0])
        self._n_decisions += 1
        self._decided_s[agent] = now_s
        self._cumulative_rewards[agent] = 0.0
        for each, decided_s in self._decided_s.items():
            self.rewards[each] = reward * self._discount_per_s ** (now_s - decided_s)
        self._accumulate_rewards()
        self._look()

    def _compass_action(self, chosen: int) -> int:
        """An action of the UAV that decides, in whose frame it is given.

        Raises:
            ValueError: it is not legal.
        """
        mask = self.infos[self.agent_selection]['action_mask']
        if not (0 <= chosen < N_ACTIONS and mask[chosen]):
            uav = int(self._env.decisions.uav[0])
            raise ValueError(
                f'action {chosen} of UAV {uav + 1} in mission {self._seed} is not legal; legal '
                f'are {np.flatnonzero(mask).tolist()}'
            )
        return int(COMPASS_ACTIONS[self._env.decisions.frame[0], chosen])

    def observe(self, agent: str) -> Any:  # noqa: ANN401 - an array or a dictionary
        """What an agent saw at its latest decision; zeros before its first."""
        return self._setup.seen(self._seen[agent], self.infos[agent]['action_mask'])

    def state(self) -> NDArray[np.float32]:
        """The global state, see `VectorEnv.global_state`."""
        return self._env.global_state(0).astype(np.float32)

    def mission_log(self, policy_name: str = 'pettingzoo') -> MissionLog:
        """The log of the mission so far; a name for what flies it stands in its header."""
        return self._env.mission_log(0, policy_name)

    def render(self) -> NDArray[np.uint8] | None:
        """The picture of the ways so far, (height, width, 3), if `render_mode` says so."""
        if self.render_mode is None:
            logger.warn(f'nothing is drawn: call env(render_mode={RGB_ARRAY!r})')
            return None
        # Here, as many environments never draw.
        from uav_collect.analysis.trajectories import pixels

        return pixels(self.mission_log(), self._site, demand_of(self._site, self._seed))

    def close(self) -> None:
        """Nothing is held open."""

    def _look(self) -> None:
        """Turn to the agent that decides next, or to the end of the mission."""
        decisions = self._env.decisions
        uav, time_s = int(decisions.uav[0]), float(decisions.time_s[0])
        is_over = uav == NONE
        is_cut = not is_over and self._n_decisions == self._setup.max_decisions
        if is_over or is_cut:
            self.infos = {agent: self._info(agent, time_s, None) for agent in self.agents}
            self.terminations = dict.fromkeys(self.agents, is_over)
            self.truncations = dict.fromkeys(self.agents, is_cut)
            self.agent_selection = self.agents[0]
        if is_over:
            return
        agent = self.possible_agents[uav]
        self._seen[agent] = decisions.observation[0].astype(np.float32)
        legal = decisions.legal[0][COMPASS_ACTIONS[decisions.frame[0]]]
        self.infos[agent] = self._info(agent, time_s, legal)
        if not is_cut:
            self.agent_selection = agent

    def _info(self, agent: str, time_s: float, legal: Bools | None) -> dict[str, Any]:
        duration_s = time_s - self._decided_s.get(agent, time_s)
        return {
            'action_mask': mask_of(legal),
            'time_s': time_s,
            'duration_s': duration_s,
            'discount': self._discount_per_s**duration_s,
        }

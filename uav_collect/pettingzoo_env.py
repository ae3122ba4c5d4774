"""The world as a PettingZoo environment: a mission in which the UAV that is done decides next.

- Agents are `uav_1`, `uav_2`, ...; `agent_selection` is the one whose action ended first. Actions
  are 0 hover, 1 north, 2 east, 3 south, 4 west.
- An observation is the vector that learned policies fly by. The mask of legal actions is
  `infos[agent]['action_mask']`; an illegal action is a ValueError and changes nothing.
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

from itertools import pairwise
import operator
from pathlib import Path
from typing import Any, ClassVar

from gymnasium import logger
from gymnasium.spaces import Box, Discrete
import numpy as np
from numpy.typing import NDArray
from pettingzoo import AECEnv
from pettingzoo.utils.wrappers import OrderEnforcingWrapper
from uav_collect.kernels.arrays import Bools
from uav_collect.limits import MAX_SEED
from uav_collect.missions.vector_env import VectorEnv, VectorEnvConfig
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import N_ACTIONS, NONE
from uav_collect.uav.frames import COMPASS_ACTIONS
from uav_collect.uav.observation import Layout, observation_bound
from uav_collect.world.reward import Reward
from uav_collect.world.sensor_field import demand_of, lay_out, SensorField

_RGB_ARRAY = 'rgb_array'


def env(
    scenario: Scenario | str | Path = 'paper_10x10',
    *,
    reward: str = 'paper',
    layout: str = 'egocentric',
    bandwidth: str = 'exact',
    max_decisions: int | None = None,
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
        render_mode: rgb_array to draw the ways so far.

    Raises:
        ConfigError: the scenario is not valid, or has too many UAVs for the layout.
        ValueError: another argument is none of these.
    """
    if max_decisions is not None and max_decisions < 1:
        raise ValueError(f'max_decisions is {max_decisions}: must be 1 or more')
    if render_mode not in (None, _RGB_ARRAY):
        raise ValueError(f'render_mode is {render_mode!r}: must be {_RGB_ARRAY!r} or None')
    config = VectorEnvConfig(
        layout=Layout[_one_of('layout', layout, Layout)],
        allocator=bandwidth,
        reward=Reward[_one_of('reward', reward, Reward)],
        is_logged=True,
    )
    given = scenario if isinstance(scenario, Scenario) else load(scenario)
    return OrderEnforcingWrapper(MissionEnv(given, config, max_decisions, render_mode))


class MissionEnv(AECEnv):
    """One mission after the other of a scenario; `env` makes it."""

    metadata: ClassVar[dict[str, Any]] = {
        'name': 'uav_collect_v0',
        'render_modes': [_RGB_ARRAY],
        'is_parallelizable': False,  # UAVs decide one by one
    }

    def __init__(
        self,
        scenario: Scenario,
        config: VectorEnvConfig,
        max_decisions: int | None,
        render_mode: str | None,
    ) -> None:
        """Get ready for `reset`.

        Args:
            config: logged, with observations, not synchronous.

        Raises:
            ValueError: there are no observations.
        """
        super().__init__()
        if config.layout is None:
            raise ValueError('config.layout is None: agents must observe something')
        self.render_mode = render_mode
        self._site = build_site(scenario)
        self._sensor_field = lay_out(self._site)
        self._discount_per_s = scenario.reward.discount_per_s
        self._max_decisions = max_decisions
        self._seed = -1  # of the mission in flight
        self._env = VectorEnv(self._site, [0], config)
        self.possible_agents = [f'uav_{uav + 1}' for uav in range(scenario.n_uavs)]
        briefing, most_bit = self._env.briefing, _most_bit(self._sensor_field)
        bound = observation_bound(config.layout, briefing, most_bit)
        shape = self._env.decisions.observation.shape[1:]
        # Each agent has spaces of its own: they are seeded one by one.
        self.observation_spaces = {
            agent: Box(-bound, bound, shape, np.float32) for agent in self.possible_agents
        }
        self.action_spaces = {agent: Discrete(N_ACTIONS) for agent in self.possible_agents}
        self.state_space = Box(0.0, 1.0, self._env.global_state(0).shape, np.float32)

    def observation_space(self, agent: str) -> Box:
        """The observations of an agent: numbers of the order of one, within a rough bound."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Discrete:
        """The actions of an agent."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        """Let a mission take off.

        Args:
            seed: of the mission, 0..2^62; that after the last one, from 0, if not given.
            options: none is known.

        Raises:
            ValueError: the seed is out of range.
        """
        chosen = self._seed + 1 if seed is None else operator.index(seed)
        if not 0 <= chosen <= MAX_SEED:
            raise ValueError(f'seed is {chosen}: must be 0..2^62')
        self._seed = chosen
        self._env.restart(0, chosen)
        self._n_decisions = 0
        self._decided_s: dict[str, float] = {}  # when each agent decided last
        self.agents = self.possible_agents[:]
        self.agent_selection = self.agents[0]
        self._skip_agent_selection = None
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self._seen = {agent: self._nothing_seen(agent) for agent in self.agents}
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

    def observe(self, agent: str) -> NDArray[np.float32]:
        """What an agent saw at its latest decision; zeros before its first."""
        return self._seen[agent]

    def state(self) -> NDArray[np.float32]:
        """The global state, see `VectorEnv.global_state`."""
        return self._env.global_state(0).astype(np.float32)

    def mission_log(self, policy_name: str = 'pettingzoo') -> MissionLog:
        """The log of the mission so far; a name for what flies it stands in its header."""
        return self._env.mission_log(0, policy_name)

    def render(self) -> NDArray[np.uint8] | None:
        """The picture of the ways so far, (height, width, 3), if `render_mode` says so."""
        if self.render_mode is None:
            logger.warn(f'nothing is drawn: call env(render_mode={_RGB_ARRAY!r})')
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
        is_cut = not is_over and self._n_decisions == self._max_decisions
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
            'action_mask': np.zeros(N_ACTIONS, np.int8) if legal is None else legal.view(np.int8),
            'time_s': time_s,
            'duration_s': duration_s,
            'discount': self._discount_per_s**duration_s,
        }

    def _nothing_seen(self, agent: str) -> NDArray[np.float32]:
        return np.zeros(self.observation_spaces[agent].shape, np.float32)


def _one_of(argument: str, value: str, kinds: type[Layout] | type[Reward]) -> str:
    names = [kind.name.lower() for kind in kinds]
    if value not in names:
        raise ValueError(f'{argument} is {value!r}: must be {" or ".join(names)}')
    return value.upper()


def _most_bit(sensor_field: SensorField) -> float:
    """The most data that a cell can hold."""
    given_bit = np.asarray(sensor_field.given_bit)
    amounts_bit = np.where(np.isnan(given_bit), sensor_field.high_bit, given_bit)
    return max(
        float(amounts_bit[first:stop].sum()) for first, stop in pairwise(sensor_field.first_sensor)
    )

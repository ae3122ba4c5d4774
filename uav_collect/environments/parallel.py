"""Synchronous missions as a PettingZoo parallel environment: all UAVs act and await the slowest.

- A step is an instant at which all UAVs that still decide are asked. Those that are done first
  hover until the slowest is: that takes time and energy which other environments do not spend.
- All UAVs are there until the mission ends or is cut off. One that flies home decides no more:
  its `infos[agent]['decides']` is False, and hover, its one legal action, does nothing.
- Of UAVs over the same cell only the first that may hover does; the others must move, if they can.
  What UAVs observe at an instant is from before any of them acts.
- All earn what the team earned since the step before, discounted to it. `duration_s` and
  `discount` stand in `infos`, as in the environment where UAVs decide one by one.

A mission is that of `VectorEnv` with `is_synchronous`, by the same kernels and with the same log.
"""

from collections.abc import Mapping
import operator
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from gymnasium import logger
from gymnasium.spaces import Box, Dict, Discrete
import numpy as np
from numpy.typing import NDArray
from pettingzoo import ParallelEnv
from uav_collect.environments.shared import (
    environment_setup,
    EnvironmentSetup,
    idle_mask,
    IN_INFO,
    Mask,
    mask_of,
    MissionSeeds,
    RGB_ARRAY,
    Seen,
)
from uav_collect.missions.vector_env import VectorEnv
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.model import Scenario
from uav_collect.uav.action_codes import HOVER, N_ACTIONS, NONE
from uav_collect.uav.frames import COMPASS_ACTIONS
from uav_collect.world.sensor_field import demand_of

_SAME_PLACE = 1e-9  # share of the area's side
_PLACES = 4  # scalars of a UAV in the global state, the first two of them its place


class _Asked(NamedTuple):
    """What a UAV is asked at an instant."""

    seen: Seen
    mask: Mask  # in the UAV's frame


def parallel_env(
    scenario: Scenario | str | Path = 'paper_10x10',
    *,
    reward: str = 'paper',
    layout: str = 'egocentric',
    bandwidth: str = 'exact',
    max_decisions: int | None = None,
    mask_in: str = IN_INFO,
    render_mode: str | None = None,
) -> ParallelEnv:
    """Synchronous missions, one after the other; the arguments are those of `env`.

    Args:
        max_decisions: of the whole fleet: the first step that reaches it cuts the mission off.

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
        is_synchronous=True,
    )
    return ParallelMissionEnv(setup)


class ParallelMissionEnv(ParallelEnv):
    """One synchronous mission after the other of a scenario; `parallel_env` makes it."""

    metadata: ClassVar[dict[str, Any]] = {'name': 'uav_collect_v0', 'render_modes': [RGB_ARRAY]}

    def __init__(self, setup: EnvironmentSetup) -> None:
        """Get ready for `reset`."""
        self.render_mode = setup.render_mode
        self._setup = setup
        self._seeds = MissionSeeds()
        self._env = VectorEnv(setup.site, [0], setup.config)
        self.possible_agents = [f'uav_{uav + 1}' for uav in range(setup.site.scenario.n_uavs)]
        self.agents: list[str] = []
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

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Let a mission take off; returns what agents observe, and their infos.

        Args:
            seed: of the mission, 0..2^62. If it is not given, of the next of those that are kept
                for learners, and which that is follows from the seed given last.
            options: none is known.

        Raises:
            ValueError: the seed is out of range.
        """
        self._seed = self._seeds.of_reset(seed)
        self._env.restart(0, self._seed)
        self.agents = self.possible_agents[:]
        self._n_decisions, self._before_s = 0, 0.0
        nothing: Seen = np.zeros(self._env.decisions.observation.shape[1], np.float32)
        self._seen = dict.fromkeys(self.agents, nothing)
        self._look()
        return self._observations(), self._infos()

    def step(
        self, actions: Mapping[str, int]
    ) -> tuple[
        dict[str, Any],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Start the actions of all UAVs that decide, and go on to the next instant.

        Args:
            actions: of all agents; that of a UAV which does not decide counts not.

        Returns:
            Observations, rewards, terminations, truncations and infos by agent.

        Raises:
            ValueError: an action is not legal; then nothing has changed.
        """
        agents = self.agents
        if not agents:
            return {}, {}, {}, {}, {}
        chosen = {agent: self._checked(agent, actions) for agent in self._asked}
        self._before_s = float(self._env.decisions.time_s[0])
        reward = self._act(chosen)
        self._n_decisions += len(chosen)
        self._look()
        is_over = not self._asked
        limit = self._setup.max_decisions
        is_cut = not is_over and limit is not None and self._n_decisions >= limit
        result = (
            self._observations(),
            dict.fromkeys(agents, reward),
            dict.fromkeys(agents, is_over),
            dict.fromkeys(agents, is_cut),
            self._infos(),
        )
        if is_over or is_cut:
            self.agents = []
        return result

    def state(self) -> NDArray[np.float32]:
        """The global state, see `VectorEnv.global_state`."""
        return self._env.global_state(0).astype(np.float32)

    def mission_log(self, policy_name: str = 'pettingzoo') -> MissionLog:
        """The log of the mission so far; a name for what flies it stands in its header."""
        return self._env.mission_log(0, policy_name)

    def render(self) -> NDArray[np.uint8] | None:
        """The picture of the ways so far, (height, width, 3), if `render_mode` says so."""
        if self.render_mode is None:
            logger.warn(f'nothing is drawn: call parallel_env(render_mode={RGB_ARRAY!r})')
            return None
        # Here, as many environments never draw.
        from uav_collect.analysis.trajectories import pixels

        site = self._setup.site
        return pixels(self.mission_log(), site, demand_of(site, self._seed))

    def close(self) -> None:
        """Nothing is held open."""

    def _checked(self, agent: str, actions: Mapping[str, int]) -> int:
        """The action of an agent that decides; raises ValueError if it is not legal."""
        if agent not in actions:
            raise ValueError(f'{agent} decides: it must have an action')
        action, mask = operator.index(actions[agent]), self._asked[agent].mask
        if not (0 <= action < N_ACTIONS and mask[action]):
            raise ValueError(
                f'action {action} of {agent} in mission {self._seed} is not legal; legal are '
                f'{np.flatnonzero(mask).tolist()}'
            )
        return action

    def _act(self, chosen: Mapping[str, int]) -> float:
        """Let each UAV of this instant act in its turn; the reward since, discounted to it."""
        reward, left, decisions = 0.0, dict(chosen), self._env.decisions
        while (agent := self._agent_at(self._before_s, decisions)) in left:
            action = COMPASS_ACTIONS[decisions.frame[0], left.pop(agent)]
            if not decisions.legal[0, action]:
                # Another UAV has just taken what this one, which cannot move, was to collect.
                action = np.argmax(decisions.legal[0])
            since_s = float(decisions.time_s[0]) - self._before_s
            decisions = self._env.step(np.array([action]))
            reward += self._setup.discount_per_s**since_s * float(decisions.reward[0])
        return reward

    def _look(self) -> None:
        """Ask all UAVs of this instant, as if each one flew on before the next is asked.

        They are asked in a twin of the mission. There nobody collects anything, and so all see
        what there is before the instant.
        """
        self._asked: dict[str, _Asked] = {}
        twin, time_s = self._env.twin(), float(self._env.decisions.time_s[0])
        places = self._env.global_state(0)
        hovering: list[NDArray[np.float64]] = []  # places of those that may hover
        decisions = twin.decisions
        while (
            agent := self._agent_at(time_s, decisions)
        ) is not None and agent not in self._asked:
            legal = decisions.legal[0].copy()
            first = int(decisions.uav[0]) * _PLACES
            place = places[first : first + 2]
            can_move = legal.sum() > legal[HOVER]
            is_taken = any(np.abs(place - other).max() < _SAME_PLACE for other in hovering)
            if is_taken and can_move:
                legal[HOVER] = False
            elif legal[HOVER]:
                hovering.append(place)
            self._asked[agent] = _Asked(
                seen=decisions.observation[0].astype(np.float32),
                mask=mask_of(legal[COMPASS_ACTIONS[decisions.frame[0]]]),
            )
            moves = np.flatnonzero(legal[HOVER + 1 :]) + HOVER + 1
            decisions = twin.step(np.array([moves[0] if can_move else HOVER]))
        self._seen |= {agent: asked.seen for agent, asked in self._asked.items()}

    def _agent_at(self, time_s: float, decisions: Any) -> str | None:  # noqa: ANN401
        """The agent that decides next, if it does at this instant."""
        uav = int(decisions.uav[0])
        is_now = uav != NONE and float(decisions.time_s[0]) == time_s
        return self.possible_agents[uav] if is_now else None

    def _mask(self, agent: str) -> Mask:
        asked = self._asked.get(agent)
        return idle_mask() if asked is None else asked.mask

    def _observations(self) -> dict[str, Any]:
        return {
            agent: self._setup.seen(self._seen[agent], self._mask(agent)) for agent in self.agents
        }

    def _infos(self) -> dict[str, dict[str, Any]]:
        time_s = float(self._env.decisions.time_s[0])
        duration_s = time_s - self._before_s
        return {
            agent: {
                'action_mask': self._mask(agent),
                'decides': agent in self._asked,
                'time_s': time_s,
                'duration_s': duration_s,
                'discount': self._setup.discount_per_s**duration_s,
            }
            for agent in self.agents
        }

"""Synchronous missions behind the interface of PyMARL and EPyMARL, for QMIX and its relatives.

In a checkout of EPyMARL, put this file into `src/envs/`, in its `__init__.py` add
`REGISTRY['uav_collect'] = UavCollectEnv`, and in a file of `src/config/envs/` say
`env: uav_collect`, with `env_args` as those of `UavCollectEnv`.

Alone it flies at random: python examples/epymarl_env.py
"""

from typing import Any

import numpy as np
from uav_collect import mission_metrics, parallel_env

Arrays = list[np.ndarray]


class UavCollectEnv:
    """All UAVs act at the same instants; they share one reward."""

    def __init__(
        self,
        scenario: str = 'paper_8x8',
        reward: str = 'energy',
        layout: str = 'egocentric',
        time_limit: int = 150,  # steps, in each of which every UAV acts once
        seed: int | None = None,
        common_reward: bool = True,
        reward_scalarisation: str = 'mean',
        **others: Any,
    ) -> None:
        if not common_reward or reward_scalarisation not in ('mean', 'sum'):
            raise ValueError('UAVs share one reward: common_reward must be True')
        self._env = parallel_env(scenario, reward=reward, layout=layout, **others)
        self._agents = self._env.possible_agents
        self._weight = len(self._agents) if reward_scalarisation == 'sum' else 1
        self.n_agents, self.episode_limit = len(self._agents), time_limit
        self._first_seed = seed

    def reset(self, seed: int | None = None, options: Any = None) -> tuple[Arrays, dict[str, Any]]:
        """Let a mission take off; without a seed one that no test flies."""
        if seed is None and self._first_seed is not None:
            seed, self._first_seed = self._first_seed, None
        self._observed, self._infos = self._env.reset(seed=seed)
        self._n_steps = 0
        return self.get_obs(), {}

    def step(self, actions: Any) -> tuple[Arrays, float, bool, bool, dict[str, Any]]:
        chosen = dict(zip(self._agents, (int(action) for action in actions), strict=True))
        self._observed, rewards, terminated, truncated, self._infos = self._env.step(chosen)
        self._n_steps += 1
        is_over = terminated[self._agents[0]]
        is_late = self._n_steps >= self.episode_limit
        is_cut = not is_over and (truncated[self._agents[0]] or is_late)
        info: dict[str, Any] = {'episode_limit': True} if is_cut else {}
        if is_over or is_cut:
            metrics = mission_metrics(self._env.mission_log())
            info |= {
                'collected_share': metrics.collected_share,
                'efficiency_kbit_per_j': metrics.efficiency_kbit_per_j,
            }
        reward = rewards[self._agents[0]] * self._weight
        return self.get_obs(), reward, is_over, is_cut, info

    def get_obs(self) -> Arrays:
        return [self._observed[agent] for agent in self._agents]

    def get_obs_agent(self, agent_id: int) -> np.ndarray:
        return self._observed[self._agents[agent_id]]

    def get_obs_size(self) -> int:
        return int(self._env.observation_space(self._agents[0]).shape[0])

    def get_state(self) -> np.ndarray:
        return self._env.state()

    def get_state_size(self) -> int:
        return int(self._env.state_space.shape[0])

    def get_avail_actions(self) -> list[list[int]]:
        return [self.get_avail_agent_actions(number) for number in range(self.n_agents)]

    def get_avail_agent_actions(self, agent_id: int) -> list[int]:
        return self._infos[self._agents[agent_id]]['action_mask'].tolist()

    def get_total_actions(self) -> int:
        return int(self._env.action_space(self._agents[0]).n)

    def get_env_info(self) -> dict[str, int]:
        return {
            'state_shape': self.get_state_size(),
            'obs_shape': self.get_obs_size(),
            'n_actions': self.get_total_actions(),
            'n_agents': self.n_agents,
            'episode_limit': self.episode_limit,
        }

    def get_stats(self) -> dict[str, float]:
        return {}

    def seed(self, seed: int | None = None) -> None:
        self._first_seed = seed

    def render(self) -> Any:
        return self._env.render()

    def save_replay(self) -> None:
        """There is nothing to save but mission logs."""

    def close(self) -> None:
        self._env.close()


if __name__ == '__main__':
    world, rng = UavCollectEnv(), np.random.default_rng(0)
    world.reset()
    is_over = is_cut = False
    while not (is_over or is_cut):
        masks = np.array(world.get_avail_actions())
        actions = (masks * rng.uniform(0.1, 1.0, masks.shape)).argmax(axis=1)
        _, _, is_over, is_cut, said = world.step(actions)
    print(world.get_env_info(), said)

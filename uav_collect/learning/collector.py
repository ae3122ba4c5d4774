"""The training rollout: many missions at once, flown by the learner's network with exploration."""

from typing import Any

import numpy as np
import torch
from uav_collect.kernels.arrays import Ints
from uav_collect.kernels.keyed_random import draw_uniform, TEACHER
from uav_collect.learning.minibatch import Algorithm
from uav_collect.learning.network import AgentNetwork
from uav_collect.learning.saved import SavedPart
from uav_collect.learning.units import branch_share, reward_units
from uav_collect.missions.experience import Episode
from uav_collect.missions.vector_env import (
    AwaitedDecisions,
    Flights,
    VectorEnv,
    VectorEnvConfig,
)
from uav_collect.scenario.site import Site
from uav_collect.training.config import TrainingConfig
from uav_collect.training.progress import RecentMissions
from uav_collect.training.seeds import first_seed_of_part
from uav_collect.uav.action_codes import NONE
from uav_collect.uav.frames import COMPASS_ACTIONS
from uav_collect.uav.policy import NamedPolicy


class Collector:
    """Flies missions side by side, each world one after another, and returns those that ended."""

    is_over = False  # there is always another one

    def __init__(
        self,
        site: Site,
        config: TrainingConfig,
        algorithm: Algorithm,
        seed: int,
        device: str = 'cpu',
        part: int = 0,
        teacher: NamedPolicy | None = None,
    ) -> None:
        """Start a mission in each world.

        Args:
            site: with the training's discount in its reward.
            part: of the run's mission seeds, see `seeds.first_seed_of_part`.
            teacher: whom the algorithm `imitation` learns from; None: from the adviser.
        """
        n_worlds = config.rollout.missions_at_once
        self._config = config
        self._max_decisions = config.max_decisions(site.scenario.n_cells)
        self._device = torch.device(device)
        self._next_seed = first_seed_of_part(seed, part)
        self._env = VectorEnv(
            site,
            [self._draw_seed() for _ in range(n_worlds)],
            VectorEnvConfig(
                layout=config.layout,
                allocator=config.rollout.bandwidth,
                reward=config.reward_kind,
                own_reward=config.own_reward,
                energy_unit_j=reward_units(config, site).energy_j,
                is_synchronous=algorithm is Algorithm.QMIX,
                max_decisions=self._max_decisions,
                branch_share=(
                    branch_share(config, site) if algorithm is Algorithm.BRANCHES else 0.0
                ),
                teacher=teacher,
            ),
        )
        size = (n_worlds, site.scenario.n_uavs, config.memory_size)
        self._hidden = torch.zeros(size, device=self._device)
        self._worlds = torch.arange(n_worlds, device=self._device)
        settings = config.imitation if algorithm is Algorithm.IMITATION else None
        self._teacher_share = 0.0 if settings is None else settings.teacher_share
        self.recent = RecentMissions()
        self.n_decisions = 0
        self.n_missions = 0

    def collect(self, agent: AgentNetwork, n_decisions: int, epsilon: float) -> list[Episode]:
        """Fly on for that many decisions, or a few more.

        Returns:
            The missions that ended, or were cut off, meanwhile.
        """
        ended: list[Episode] = []
        goal = self.n_decisions + n_decisions
        waiting = self._env.decisions
        while self.n_decisions < goal:
            actions = self._choose_actions(agent, waiting, epsilon)
            self.n_decisions += len(actions)
            waiting = self._env.step(actions)
            is_over = waiting.uav == NONE
            is_over |= self._env.n_recorded > self._max_decisions
            if is_over.any():
                over = [self._restart(int(world)) for world in np.flatnonzero(is_over)]
                ended += [episode for episode in over if episode.n_decisions]  # faults may end it
                waiting = self._env.decisions
        return ended

    def state(self) -> dict[str, Any]:
        """All that a collector needs to go on; the inverse is `restore`."""
        return {
            **self._env.flights()._asdict(),
            'hidden': self._hidden.cpu().numpy(),
            'recent': self.recent.state(),
            'next_seed': self._next_seed,
            'n_decisions': self.n_decisions,
            'n_missions': self.n_missions,
        }

    def restore(self, saved: SavedPart) -> None:
        """Go on from where another collector of the same settings was.

        Raises:
            CheckpointError: something that was saved is not what one of these settings saves.
        """
        like = self._env.flights()
        flights = Flights(*(saved.array_like(name, getattr(like, name)) for name in like._fields))
        try:
            self._env.fly_again(flights)
        except ValueError as error:
            raise saved.refusal('actions', f'cannot be flown: {error}') from error
        hidden = saved.array('hidden', np.float32, tuple(self._hidden.shape))
        self._hidden.copy_(torch.from_numpy(hidden))
        self.recent.restore(saved.array('recent', np.float64, (None, 2)))
        self._next_seed = saved.whole('next_seed')
        self.n_decisions = saved.whole('n_decisions')
        self.n_missions = saved.whole('n_missions')

    def _choose_actions(
        self, agent: AgentNetwork, waiting: AwaitedDecisions, epsilon: float
    ) -> Ints:
        uav = torch.from_numpy(waiting.uav).to(self._device)
        observation = torch.from_numpy(waiting.observation).to(self._device, torch.float32)
        turned, bonus = COMPASS_ACTIONS[waiting.frame], agent.advice_bonus
        is_legal = np.take_along_axis(waiting.legal, turned, axis=1)
        illegal = torch.from_numpy(~is_legal).to(self._device)
        is_advised = torch.from_numpy(turned == waiting.advice[:, None]).to(self._device)
        with torch.no_grad():
            values, hidden = agent.step(observation, self._hidden[self._worlds, uav])
            self._hidden[self._worlds, uav] = hidden
            if bonus > 0.0:
                values = values + bonus * is_advised
            best = values.masked_fill_(illegal, -torch.inf).argmax(dim=1).cpu().numpy()
        exploration = self._config.exploration
        explored = self._env.explore(epsilon, exploration.hover_share, self._config.advice_share)
        chosen = turned[np.arange(len(best)), best]
        chosen = np.where(explored == NONE, chosen, explored)
        if self._teacher_share == 0.0:
            return chosen
        seeds = self._env.mission_seeds.tolist()
        return np.where([self._is_teachers(seed) for seed in seeds], self._env.taught, chosen)

    def _is_teachers(self, mission_seed: int) -> bool:
        """Whether a mission is flown by the teacher; by the key of the mission."""
        return bool(draw_uniform(mission_seed, TEACHER, 0, 0, 0) < self._teacher_share)

    def _restart(self, world: int) -> Episode:
        episode = self._env.episode(world)
        if not self._is_teachers(episode.mission_seed):
            reward = float(np.sum(episode.records.reward))
            self.recent.add(self._env.efficiency_kbit_per_j(world), reward)
        self._env.restart(world, self._draw_seed())
        self._hidden[world] = 0.0
        self.n_missions += 1
        return episode

    def _draw_seed(self) -> int:
        self._next_seed += 1
        return self._next_seed - 1

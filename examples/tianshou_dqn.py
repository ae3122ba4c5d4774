"""Tianshou's double DQN flies a mission: one learner decides for whichever UAV is next.

pip install tianshou; python examples/tianshou_dqn.py --decisions 20000

Tianshou discounts each decision alike, however many seconds it takes; `gamma` stands for that.
"""

import argparse
from functools import partial
from typing import Any

import gymnasium
import numpy as np
from tianshou.algorithm import DQN
from tianshou.algorithm.modelfree.dqn import DiscreteQLearningPolicy
from tianshou.algorithm.optim import AdamOptimizerFactory
from tianshou.data import Collector, VectorReplayBuffer
from tianshou.env import DummyVectorEnv
from tianshou.trainer import OffPolicyTrainerParams
from tianshou.utils.net.common import Net
import torch
from uav_collect.environments.turns import TurnEnv

N_WORLDS = 8


class MaskedObservation(gymnasium.ObservationWrapper):
    """What is observed under the names by which Tianshou knows it."""

    def __init__(self, env: TurnEnv) -> None:
        super().__init__(env)
        spaces = env.observation_space
        mask = gymnasium.spaces.MultiBinary(spaces['action_mask'].shape)
        self.observation_space = gymnasium.spaces.Dict(
            {'obs': spaces['observation'], 'mask': mask}
        )

    def observation(self, seen: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        return {'obs': seen['observation'], 'mask': seen['action_mask'].astype(bool)}


def world(scenario: str, seed: int) -> MaskedObservation:
    """A world with missions of its own: all that it flies later follow from its seed."""
    env = TurnEnv(
        scenario, reward='energy', layout='relative', bandwidth='equal', max_decisions=250,
        mask_in='observation',
    )  # fmt: skip
    env.reset(seed=seed)
    return MaskedObservation(env)


def train(scenario: str, n_decisions: int, seed: int) -> Any:
    """Learn; returns what Tianshou has to say of it."""
    np.random.seed(seed)  # noqa: NPY002 - Tianshou draws by it
    torch.manual_seed(seed)
    torch.set_num_threads(1)  # on busy cores more are slower
    seeds = range(seed * N_WORLDS, (seed + 1) * N_WORLDS)
    worlds = DummyVectorEnv([partial(world, scenario, each) for each in seeds])
    one = world(scenario, seed)
    n_inputs = one.observation_space['obs'].shape
    network = Net(state_shape=n_inputs, action_shape=one.action_space.n, hidden_sizes=(128, 128))
    policy = DiscreteQLearningPolicy(
        model=network, action_space=one.action_space, eps_training=0.2, eps_inference=0.0
    )
    algorithm = DQN(
        policy=policy, optim=AdamOptimizerFactory(lr=5e-4), gamma=0.98, target_update_freq=200
    )
    buffer = VectorReplayBuffer(100_000, N_WORLDS)
    per_epoch = max(N_WORLDS, n_decisions // 4)
    return algorithm.run_training(
        OffPolicyTrainerParams(
            training_collector=Collector(algorithm, worlds, buffer, exploration_noise=True),
            max_epochs=4, epoch_num_steps=per_epoch, batch_size=64, verbose=False,
            collection_step_num_env_steps=min(per_epoch, 10 * N_WORLDS),
            update_step_num_gradient_steps_per_sample=0.1, show_progress=False,
        )
    )  # fmt: skip


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--scenario', default='paper_8x8')
    parser.add_argument('--decisions', type=int, default=20_000)
    parser.add_argument('--seed', type=int, default=0)
    arguments = parser.parse_args()
    said = train(arguments.scenario, arguments.decisions, arguments.seed)
    print(f'{said.train_step:,} decisions, {said.update_step:,} updates')

"""TorchRL's PPO flies synchronous missions: each UAV by its own observation, one critic for all.

pip install torchrl; python examples/torchrl_ppo.py --steps 6000
"""

import argparse

from tensordict.nn import TensorDictModule
import torch
from torch import nn
from torchrl.collectors import Collector
from torchrl.data import Categorical as CategoricalSpec
from torchrl.envs import PettingZooWrapper, RewardSum, TransformedEnv
from torchrl.modules import MaskedCategorical, MultiAgentMLP, ProbabilisticActor
from torchrl.objectives import ClipPPOLoss, ValueEstimators
from uav_collect import parallel_env

GROUP = 'uavs'
PER_UPDATE = 500  # steps between two updates, each a decision of every UAV


def world(scenario: str, seed: int) -> TransformedEnv:
    made = parallel_env(
        scenario, reward='energy', layout='relative', bandwidth='equal', max_decisions=250
    )
    wrapped = PettingZooWrapper(
        made, group_map={GROUP: made.possible_agents}, categorical_actions=True, use_mask=False,
        seed=seed, done_on_any=False,
    )  # fmt: skip
    returns = RewardSum(in_keys=[(GROUP, 'reward')], out_keys=[(GROUP, 'episode_reward')])
    return TransformedEnv(wrapped, returns)


def perceptron(n_inputs: int, n_outputs: int, n_uavs: int, *, is_central: bool) -> MultiAgentMLP:
    return MultiAgentMLP(
        n_agent_inputs=n_inputs, n_agent_outputs=n_outputs, n_agents=n_uavs, share_params=True,
        centralized=is_central, depth=2, num_cells=128, activation_class=nn.Tanh,
    )  # fmt: skip


def train(scenario: str, n_steps: int, seed: int) -> list[float]:
    """Learn; the mean return of the missions that ended before each update, where any did."""
    torch.manual_seed(seed)
    torch.set_num_threads(1)  # on busy cores more are slower
    env = world(scenario, seed)
    seen, mask = (GROUP, 'observation'), (GROUP, 'action_mask')
    n_uavs, n_inputs = env.observation_spec[seen].shape
    spec = env.full_action_spec[env.action_key]
    n_actions = spec.space.n if isinstance(spec, CategoricalSpec) else spec.shape[-1]
    actor_net = perceptron(n_inputs, n_actions, n_uavs, is_central=False)
    critic_net = perceptron(n_inputs, 1, n_uavs, is_central=True)
    actor = ProbabilisticActor(
        TensorDictModule(actor_net, in_keys=[seen], out_keys=[(GROUP, 'logits')]),
        spec=env.action_spec,
        in_keys={'logits': (GROUP, 'logits'), 'mask': mask},
        out_keys=[env.action_key],
        distribution_class=MaskedCategorical,
        return_log_prob=True,
        log_prob_key=(GROUP, 'sample_log_prob'),
    )
    critic = TensorDictModule(critic_net, in_keys=[seen], out_keys=[(GROUP, 'state_value')])
    loss = ClipPPOLoss(actor, critic, clip_epsilon=0.2, entropy_coeff=0.01)
    loss.set_keys(
        reward=env.reward_key, action=env.action_key, value=(GROUP, 'state_value'),
        done=(GROUP, 'done'), terminated=(GROUP, 'terminated'),
        sample_log_prob=(GROUP, 'sample_log_prob'),
    )  # fmt: skip
    loss.make_value_estimator(ValueEstimators.GAE, gamma=0.98, lmbda=0.95)
    optimiser = torch.optim.Adam(loss.parameters(), 5e-4)
    per_update = min(PER_UPDATE, n_steps)
    collector = Collector(env, actor, frames_per_batch=per_update, total_frames=n_steps)
    returns = []
    for steps in collector:
        with torch.no_grad():
            loss.value_estimator(steps)
        for _ in range(4):
            for rows in torch.randperm(len(steps)).chunk(4):
                losses = loss(steps[rows])
                total = losses['loss_objective'] + losses['loss_critic'] + losses['loss_entropy']
                optimiser.zero_grad()
                total.backward()
                nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
                optimiser.step()
        ended = steps['next', GROUP, 'done'][..., 0, 0]
        if ended.any():
            of_missions = steps['next', GROUP, 'episode_reward'][ended]
            returns.append(float(of_missions.mean()))
    collector.shutdown()
    return returns


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--scenario', default='paper_8x8')
    parser.add_argument('--steps', type=int, default=6_000)
    parser.add_argument('--seed', type=int, default=0)
    arguments = parser.parse_args()
    for number, value in enumerate(train(arguments.scenario, arguments.steps, arguments.seed), 1):
        print(f'update {number}: return {value:.2f}')

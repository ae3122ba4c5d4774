"""PPO with masked actions in one file: one network flies all UAVs of many missions at once.

python examples/ppo.py --scenario paper_8x8 --decisions 300000
"""

import argparse
from dataclasses import dataclass

import numpy as np
import torch
from torch import nn
from torch.distributions import Categorical
from uav_collect import Scenario, WorldsEnv


@dataclass(frozen=True, kw_only=True)
class Settings:
    n_worlds: int = 64
    n_steps: int = 64  # of each world between two updates
    n_epochs: int = 4
    n_minibatches: int = 8
    hidden_size: int = 128
    learning_rate: float = 5e-4
    trace: float = 0.95  # lambda of generalised advantages
    clip: float = 0.2
    entropy_weight: float = 0.01
    value_weight: float = 0.5
    max_gradient_norm: float = 0.5


class ActorCritic(nn.Module):
    """Logits of the actions, minus infinity where illegal, and the value, of observations."""

    def __init__(self, n_inputs: int, n_actions: int, hidden_size: int) -> None:
        super().__init__()

        def perceptron(n_outputs: int, scale: float) -> nn.Sequential:
            last = nn.Linear(hidden_size, n_outputs)
            nn.init.orthogonal_(last.weight, scale)
            first, second = nn.Linear(n_inputs, hidden_size), nn.Linear(hidden_size, hidden_size)
            return nn.Sequential(first, nn.Tanh(), second, nn.Tanh(), last)

        self.actor, self.critic = perceptron(n_actions, 0.01), perceptron(1, 1.0)

    def forward(self, seen: torch.Tensor, mask: torch.Tensor) -> tuple[Categorical, torch.Tensor]:
        logits = self.actor(seen).masked_fill(mask == 0, -torch.inf)
        return Categorical(logits=logits), self.critic(seen)[..., 0]


class Rollout:
    """What was seen and done in so many steps, each table (T, W, ...)."""

    def __init__(self, n_steps: int, n_worlds: int, n_inputs: int, n_actions: int) -> None:
        shape = (n_steps, n_worlds)
        self.seen, self.mask = torch.zeros(*shape, n_inputs), torch.zeros(*shape, n_actions)
        self.action = torch.zeros(shape, dtype=torch.int64)
        self.log_prob, self.value, self.reward = (torch.zeros(shape) for _ in range(3))
        self.discount = torch.zeros(shape)  # of what comes after; 0 once a mission is over
        self.is_last = torch.zeros(shape, dtype=torch.bool)  # the next row is another mission
        self.cut_value = torch.zeros(shape)  # of what comes after a mission that was cut off

    def advantages(self, next_value: torch.Tensor, trace: float) -> torch.Tensor:
        """Generalised advantages; a decision takes seconds, so each has a discount of its own."""
        result, later = torch.zeros_like(self.value), torch.zeros_like(next_value)
        for step in reversed(range(len(self.value))):
            after = torch.where(self.is_last[step], self.cut_value[step], next_value)
            error = self.reward[step] + self.discount[step] * after - self.value[step]
            later = error + self.discount[step] * trace * later * ~self.is_last[step]
            result[step], next_value = later, self.value[step]
        return result


def train(
    scenario: Scenario | str, n_decisions: int, seed: int, settings: Settings
) -> list[tuple[int, float, float]]:
    """Learn; after each update decisions so far, mean kbit/J and share collected of missions.

    An update in which no mission ended has no row.
    """
    per_update = settings.n_steps * settings.n_worlds
    if n_decisions < per_update:
        raise ValueError(f'n_decisions is {n_decisions}: must be {per_update} or more, an update')
    torch.manual_seed(seed)
    torch.set_num_threads(1)  # on busy cores more are slower
    worlds = WorldsEnv(
        scenario, num_envs=settings.n_worlds, reward='energy', layout='relative',
        bandwidth='equal', max_decisions=250,
    )  # fmt: skip
    n_inputs, n_actions = worlds.single_observation_space.shape[0], worlds.single_action_space.n
    network = ActorCritic(n_inputs, n_actions, settings.hidden_size)
    optimiser = torch.optim.Adam(network.parameters(), settings.learning_rate, eps=1e-5)
    seen, infos = worlds.reset(seed=seed)
    progress = []
    for done in range(per_update, n_decisions + 1, per_update):
        optimiser.param_groups[0]['lr'] = settings.learning_rate * (1.0 - done / (n_decisions + 1))
        rollout = Rollout(settings.n_steps, settings.n_worlds, n_inputs, n_actions)
        efficiencies, shares = [], []
        for step in range(settings.n_steps):
            rollout.seen[step] = torch.from_numpy(seen)
            rollout.mask[step] = torch.from_numpy(infos['action_mask'])
            with torch.no_grad():
                policy, rollout.value[step] = network(rollout.seen[step], rollout.mask[step])
                rollout.action[step] = action = policy.sample()
                rollout.log_prob[step] = policy.log_prob(action)
            seen, reward, is_over, is_cut, infos = worlds.step(action.numpy())
            rollout.reward[step] = torch.from_numpy(reward)
            rollout.discount[step] = torch.from_numpy(infos['discount'] * ~is_over)
            rollout.is_last[step] = torch.from_numpy(is_over | is_cut)
            if is_cut.any():
                with torch.no_grad():
                    last = network.critic(torch.from_numpy(infos['final_obs']))[:, 0]
                rollout.cut_value[step] = last * torch.from_numpy(is_cut)
            if '_final_info' in infos:
                ended, final = infos['_final_info'], infos['final_info']
                efficiencies += final['efficiency_kbit_per_j'][ended].tolist()
                shares += final['collected_share'][ended].tolist()
        with torch.no_grad():
            next_value = network.critic(torch.from_numpy(seen))[:, 0]
        update(network, optimiser, rollout, next_value, settings)
        if shares:
            progress.append((done, float(np.mean(efficiencies)), float(np.mean(shares))))
    return progress


def update(
    network: ActorCritic, optimiser: torch.optim.Adam, rollout: Rollout,
    next_value: torch.Tensor, settings: Settings,
) -> None:  # fmt: skip
    """Some epochs of clipped steps over a rollout."""
    advantage = rollout.advantages(next_value, settings.trace)
    target = (advantage + rollout.value).flatten()
    advantage = ((advantage - advantage.mean()) / (advantage.std() + 1e-8)).flatten()
    seen, mask = rollout.seen.flatten(0, 1), rollout.mask.flatten(0, 1)
    action, log_prob = rollout.action.flatten(), rollout.log_prob.flatten()
    for _ in range(settings.n_epochs):
        for rows in torch.randperm(len(action)).chunk(settings.n_minibatches):
            policy, value = network(seen[rows], mask[rows])
            ratio = (policy.log_prob(action[rows]) - log_prob[rows]).exp()
            clipped = ratio.clamp(1.0 - settings.clip, 1.0 + settings.clip)
            gain = torch.min(ratio * advantage[rows], clipped * advantage[rows]).mean()
            value_loss = 0.5 * (value - target[rows]).square().mean()
            entropy = policy.entropy().mean()
            loss = settings.value_weight * value_loss - gain - settings.entropy_weight * entropy
            optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(network.parameters(), settings.max_gradient_norm)
            optimiser.step()


def lines_of(rows: list[tuple[int, float, float]]) -> list[str]:
    """What came of a training, for people."""
    lines = ['{:>9,} decisions: {:.3f} kbit/J, {:.0%} of the data'.format(*row) for row in rows]
    return lines or ['no mission has ended: it takes more --decisions']


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--scenario', default='paper_8x8')
    parser.add_argument('--decisions', type=int, default=300_000)
    parser.add_argument('--seed', type=int, default=0)
    arguments = parser.parse_args()
    try:
        rows = train(arguments.scenario, arguments.decisions, arguments.seed, Settings())
    except ValueError as error:
        parser.error(str(error))
    print('\n'.join(lines_of(rows)))

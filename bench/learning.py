"""The reference of bench/learning.py: a learner as most are written, plainly, over padded steps.

Missions lie side by side as steps; at each one every UAV's GRU cell runs, whether that UAV decides
or another one, and what belongs to no decision is masked afterwards, as EPyMARL's QLearner does.
It learns the same as `uav_collect.learner` does, AQMIX with one-step targets or lambda-returns:
loss and gradients agree to rounding.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor
from uav_collect.learner import Networks
from uav_collect.minibatch import Minibatch, NOBODY
from uav_collect.network import Drqn


class Padded(NamedTuple):
    """N missions of up to T decisions; zeros where nothing is."""

    observation: Tensor  # (T, N, U, observation_size)
    legal: Tensor  # (T, N, U, N_ACTIONS), all where the UAV does not decide
    decides: Tensor  # (T, N, U)
    has_action: Tensor  # (T, N, U) running, or chosen here
    action: Tensor  # (T, N, U)
    fleet: Tensor  # (T, N, U * N_UAV_SCALARS)
    complete: Tensor  # (T, N, U + 1, C)
    reward: Tensor  # (T, N)
    discount: Tensor  # (T, N), 0 at the end
    is_entry: Tensor  # (T, N)


def padded(minibatch: Minibatch, n_decisions: Sequence[int], reward_scale: float) -> Padded:
    """A minibatch of AQMIX as dense steps.

    Args:
        n_decisions: of each mission, those whose outcome is not known included, shape (N,).
    """
    start = np.cumsum([0, *n_decisions])
    mission = np.repeat(np.arange(len(n_decisions)), n_decisions)
    step = np.arange(len(mission)) - start[mission]
    shape, (_, n_uavs) = (max(n_decisions), len(n_decisions)), minibatch.latest.shape

    def dense(values: Any, *inner: int, fill: float = 0.0) -> Tensor:  # noqa: ANN401 - any array
        table = np.full((*shape, *inner), fill, dtype=values.dtype)
        table[step, mission] = values
        return torch.from_numpy(table)

    deciding = minibatch.latest == np.arange(len(mission))[:, None]
    observation = deciding[..., None] * minibatch.observation[minibatch.row][:, None]
    legal = ~deciding[..., None] | minibatch.legal[minibatch.row][:, None]
    known = np.zeros((3, len(mission)))
    known[:, minibatch.entry] = [
        reward_scale * minibatch.reward,
        minibatch.discount,
        np.ones(len(minibatch.entry)),
    ]
    reward, discount, is_entry = known.astype(np.float32)
    return Padded(
        observation=dense(observation, n_uavs, observation.shape[2]),
        legal=dense(legal, n_uavs, legal.shape[2], fill=1.0),
        decides=dense(deciding, n_uavs),
        has_action=dense(minibatch.latest != NOBODY, n_uavs),
        action=dense(minibatch.action[np.maximum(minibatch.latest, 0)], n_uavs),
        fleet=dense(minibatch.fleet, minibatch.fleet.shape[1]),
        complete=dense(minibatch.complete, *minibatch.complete.shape[1:]),
        reward=dense(reward),
        discount=dense(discount),
        is_entry=dense(is_entry),
    )


def values_by_step(agent: Drqn, steps: Padded) -> Tensor:
    """Q values of every UAV at every step, by its own decisions so far, (T, N, U, N_ACTIONS)."""
    n_missions, n_uavs = steps.decides.shape[1:]
    hidden = steps.observation.new_zeros(n_missions * n_uavs, agent.hidden_size)
    values = []
    for observation, decides in zip(steps.observation, steps.decides, strict=True):
        encoded = torch.relu(agent.encoder(observation.flatten(0, 1)))
        hidden = torch.where(decides.view(-1, 1), agent.gru(encoded, hidden), hidden)
        values.append(agent.head(hidden).view(n_missions, n_uavs, -1))
    return torch.stack(values)


def plain_loss(
    networks: Networks, target: Networks, steps: Padded, *, double_q: bool, trace: float
) -> Tensor:
    """Mean squared error of the team's action values against their targets."""
    values = values_by_step(networks.agent, steps)
    team = _mixed(networks, _of(values, steps.action), steps)
    with torch.no_grad():
        later = values_by_step(target.agent, steps)
        judge = values if double_q else later
        best = judge.masked_fill(~steps.legal, -torch.inf).argmax(dim=3)
        greedy = torch.where(steps.decides, _of(later, best), _of(later, steps.action))
        goals = _goals(_mixed(target, greedy, steps), steps, trace)
    error = (team - goals) * steps.is_entry
    return error.square().sum() / steps.is_entry.sum()


def _goals(future: Tensor, steps: Padded, trace: float) -> Tensor:
    """What the team's values are to become, from the last step backwards, (T, N)."""
    goals = torch.zeros_like(future)
    goals[-1] = steps.reward[-1]
    for step in range(len(future) - 2, -1, -1):
        is_known = steps.is_entry[step + 1]
        share = trace * is_known
        after = (1.0 - share) * future[step + 1] + share * goals[step + 1]
        goals[step] = steps.reward[step] + steps.discount[step] * after
    return goals


def _of(values: Tensor, action: Tensor) -> Tensor:
    return values.gather(3, action[..., None]).squeeze(3)


def _mixed(networks: Networks, values: Tensor, steps: Padded) -> Tensor:
    mixer = networks.mixer(0)
    state = mixer.state(steps.fleet.flatten(0, 1), steps.complete.flatten(0, 1))
    total: Tensor = mixer((values * steps.has_action).flatten(0, 1), state)
    return total.view(steps.reward.shape)

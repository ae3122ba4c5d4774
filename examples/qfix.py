"""QFIX over QMIX: any team value whose best actions are the UAVs' own best ones.

QMIX's values can only rise with each UAV's. What an action takes from QMIX's best value is scaled
here by a weight above 0 of state and actions, so that more values can be told, and the best
actions stay the best. Source: Baisero and others, Fixing incomplete value function decomposition
for cooperative multi-agent reinforcement learning, 2025.

python -m uav_collect train --override mixer.kind=qfix:QFix
"""

import torch
from torch import nn


class QFix(nn.Module):
    def __init__(self, space):
        super().__init__()
        self.usual = space.new_mixer()
        n_states = space.n_uavs * space.n_uav_scalars
        maps = torch.zeros(1, space.n_uavs + 1, space.n_rows * space.n_columns)
        n_inputs = self.usual.state(torch.zeros(1, n_states), maps).shape[1] + space.n_uavs
        size = space.hypernetwork_size
        self.weight = nn.Sequential(nn.Linear(n_inputs, size), nn.ReLU(), nn.Linear(size, 1))

    def state(self, fleet, complete):
        return self.usual.state(fleet, complete)

    def forward(self, values, best, state):
        highest = self.usual(best, state)
        lost = self.usual(values, state) - highest  # 0 where all act as they like best
        seen = torch.cat((state, (values - best).detach()), dim=1)
        weight = nn.functional.softplus(self.weight(seen)).squeeze(1)
        return highest + weight * lost

"""A network without memory: two layers, and one for the values.

python -m uav_collect train --override network.kind=mlp:Mlp
"""

import torch
from torch import nn


class Mlp(nn.Module):
    layers = 'first', 'relu', 'second', 'relu', 'head'  # by these a policy flies without this file

    def __init__(self, observation_size, hidden_size):
        super().__init__()
        self.first = nn.Linear(observation_size, hidden_size)
        self.second = nn.Linear(hidden_size, hidden_size)
        self.head = nn.Linear(hidden_size, 5)

    @staticmethod
    def memory_size(hidden_size):
        return 0

    def step(self, observation, memory):
        return self.forward(observation, []), memory

    def forward(self, observation, step_sizes):
        return self.head(torch.relu(self.second(torch.relu(self.first(observation)))))

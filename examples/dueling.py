"""A dueling network without memory, whose values no list of layers tells: it has `fly` instead.

Its policies need this file on board, but no torch there.

python -m uav_collect train --override network.kind=dueling:Dueling
"""

import numpy as np

try:
    from torch import nn
except ImportError:  # on board
    nn = None


class Dueling(nn.Module if nn else object):
    def __init__(self, observation_size, hidden_size):
        super().__init__()
        self.encoder = nn.Linear(observation_size, hidden_size)
        self.worth = nn.Linear(hidden_size, 1)
        self.gain = nn.Linear(hidden_size, 5)

    @staticmethod
    def memory_size(hidden_size):
        return 0

    def step(self, observation, memory):
        return self.forward(observation, []), memory

    def forward(self, observation, step_sizes):
        encoded = self.encoder(observation).relu()
        gain = self.gain(encoded)
        return self.worth(encoded) + gain - gain.mean(dim=1, keepdim=True)

    @staticmethod
    def fly(weights, observation, memory):
        def layer(name, x):
            return weights[f'{name}.weight'] @ x + weights[f'{name}.bias']

        encoded = np.maximum(layer('encoder', observation), 0.0)
        gain = layer('gain', encoded)
        return layer('worth', encoded) + gain - gain.mean(), memory

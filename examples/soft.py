"""AQMIX with softer targets: the next decision is worth a mellow maximum, and errors count less.

The mellowmax of Asadi and Littman, 2017, lies between the mean and the maximum of the legal
actions' values; Huber's loss grows no faster than the error where that is large.

python -m uav_collect train --algorithm soft:Soft
"""

import math

import torch

SHARPNESS = 20.0  # per unit of value; the maximum where it is infinite


class Soft:
    like = 'aqmix'

    def next_values(self, online, target, legal):
        scaled = (SHARPNESS * target).masked_fill(~legal, -math.inf)
        n_legal = legal.sum(dim=1).clamp(min=1)
        total = torch.logsumexp(scaled, dim=1).masked_fill(~legal.any(dim=1), 0.0)
        return (total - torch.log(n_legal)) / SHARPNESS

    def loss(self, team, target):
        return torch.nn.functional.smooth_l1_loss(team, target)

"""Adam (Kingma and Ba, 2015) by torch's own step, without what torch's class brings along.

The first optimiser of `torch.optim` that a process makes loads torch's compiler, and sympy, for
nothing that is used here: that takes as long again as to load torch itself.
"""

from collections.abc import Iterable

import torch
from torch import nn, Tensor
from torch.optim.adam import adam

_FIRST, _SECOND = 0.9, 0.999  # what a moment keeps at a step


class Adam:
    """Steps of parameters along their gradients, each by its own first two moments.

    `state` has what is known of the parameters that have ever had a gradient: `step`, how many
    steps it has made, `exp_avg` and `exp_avg_sq`.
    """

    def __init__(self, parameters: Iterable[nn.Parameter], epsilon: float) -> None:
        self._parameters, self._epsilon = [*parameters], epsilon
        self.state: dict[Tensor, dict[str, Tensor]] = {}

    def forget_gradients(self) -> None:
        """Let the next backward pass begin anew."""
        for parameter in self._parameters:
            parameter.grad = None

    @torch.no_grad()
    def step(self, learning_rate: float) -> None:
        """Move each parameter that has a gradient."""
        moved: list[Tensor] = [it for it in self._parameters if it.grad is not None]
        states = [self._state_of(parameter) for parameter in moved]
        adam(
            moved,
            [it.grad for it in moved if it.grad is not None],
            [state['exp_avg'] for state in states],
            [state['exp_avg_sq'] for state in states],
            [],
            [state['step'] for state in states],
            fused=True,
            amsgrad=False,
            beta1=_FIRST,
            beta2=_SECOND,
            lr=learning_rate,
            weight_decay=0.0,
            eps=self._epsilon,
            maximize=False,
        )

    def _state_of(self, parameter: Tensor) -> dict[str, Tensor]:
        """What is known of a parameter; at its first step it has rested."""
        if parameter not in self.state:
            self.state[parameter] = {
                'step': torch.zeros((), dtype=torch.float32, device=parameter.device),
                'exp_avg': torch.zeros_like(parameter),
                'exp_avg_sq': torch.zeros_like(parameter),
            }
        return self.state[parameter]

"""Adam without torch's class: the same steps, and nothing loaded that no learner needs."""

import sys

import pytest

torch = pytest.importorskip('torch', reason='training needs torch')
from processes import completed
from uav_collect.learning.adam import Adam

EPSILON = 1e-3


def test_it_steps_like_torch_s_own_class_to_the_bit() -> None:
    draws = torch.Generator().manual_seed(0)
    begun = [torch.randn(shape, generator=draws) for shape in ((3, 2), (4,), (2,))]
    ours = [torch.nn.Parameter(tensor.clone()) for tensor in begun]
    theirs = [torch.nn.Parameter(tensor.clone()) for tensor in begun]
    mine = Adam(ours, EPSILON)
    other = torch.optim.Adam(theirs, eps=EPSILON, fused=True)
    for turn in range(5):
        learning_rate = 0.1 / (turn + 1)
        mine.forget_gradients()
        other.zero_grad()
        other.param_groups[0]['lr'] = learning_rate
        for place, (one, same) in enumerate(zip(ours, theirs, strict=True)):
            if place < 2 or turn == 3:  # the last one is used once
                one.grad = torch.randn(one.shape, generator=draws)
                same.grad = one.grad.clone()
        mine.step(learning_rate)
        other.step()
    for one, same in zip(ours, theirs, strict=True):
        assert torch.equal(one, same)
        assert {*mine.state[one]} == {*other.state[same]}
        for name, tensor in other.state[same].items():
            assert torch.equal(mine.state[one][name], tensor)


def test_a_process_that_learns_loads_neither_torch_s_compiler_nor_sympy() -> None:
    code = (
        'import sys, torch\n'
        'from uav_collect.learning.adam import Adam\n'
        'weight = torch.nn.Parameter(torch.ones(2))\n'
        'weight.sum().backward()\n'
        'Adam([weight], 1e-3).step(0.1)\n'
        'print({"torch._dynamo", "sympy"} & {*sys.modules})'
    )
    assert completed(sys.executable, '-c', code).stdout == 'set()\n'

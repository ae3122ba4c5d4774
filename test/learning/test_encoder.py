"""The first layer over sparse observations is the layer over dense ones."""

from episodes import single_threaded_torch
import numpy as np
import pytest

torch = single_threaded_torch()
from torch import nn, Tensor
from uav_collect.kernels.compile import kernels_are_compiled
from uav_collect.learning.encoder import encoded
from uav_collect.missions.experience import SparseRows

pytestmark = pytest.mark.skipif(not kernels_are_compiled(), reason='kernels are interpreted')

N_ROWS, OBSERVATION_SIZE = 300, 70


def dense_rows(share: float) -> Tensor:
    """Rows of which such a share is not zero; the first is zero throughout."""
    generator = torch.Generator().manual_seed(0)
    drawn = torch.randn((N_ROWS, OBSERVATION_SIZE), generator=generator)
    drawn[torch.rand(drawn.shape, generator=generator) >= share] = 0.0
    drawn[0] = 0.0
    return drawn


def sparse(dense: Tensor) -> SparseRows:
    row, column = np.nonzero(dense.numpy())
    stop = np.cumsum(np.bincount(row, minlength=len(dense)))
    start = np.concatenate([[0], stop[:-1]])
    values = dense.numpy()[row, column]
    return SparseRows(column=column.astype(np.int32), value=values, start=start, stop=stop)


def layer_of(size: int) -> nn.Linear:
    torch.manual_seed(0)
    return nn.Linear(OBSERVATION_SIZE, size)


def slopes(layer: nn.Linear, output: Tensor) -> list[Tensor]:
    """What comes out, and the gradients of a loss that weighs each number differently."""
    weights = torch.linspace(-1.0, 2.0, output.numel(), dtype=output.dtype).view_as(output)
    found = torch.autograd.grad((weights * output.square()).mean(), (layer.weight, layer.bias))
    return [output.detach(), *found]


@pytest.mark.parametrize('size', [16, 64, 256])
@pytest.mark.parametrize('share', [0.0, 0.2, 1.0])
def test_it_is_the_dense_layer_in_double_precision_to_1e_6(share: float, size: int) -> None:
    layer, rows = layer_of(size), dense_rows(share)
    ours = slopes(layer, encoded(layer, sparse(rows)))
    layer = layer.double()
    for mine, exact in zip(ours, slopes(layer, encoded(layer, rows.double())), strict=True):
        assert (mine.double() - exact).norm() <= 1e-6 * exact.norm()


def test_rows_may_lie_in_any_order() -> None:
    layer, rows = layer_of(16), dense_rows(0.2)
    order = np.random.default_rng(0).permutation(N_ROWS)
    packed = sparse(rows)
    packed = packed._replace(start=packed.start[order], stop=packed.stop[order])
    expected = slopes(layer, encoded(layer, rows[order]))
    for mine, theirs in zip(slopes(layer, encoded(layer, packed)), expected, strict=True):
        torch.testing.assert_close(mine, theirs)


def test_the_same_rows_give_the_same_bits() -> None:
    layer, rows = layer_of(64), sparse(dense_rows(0.2))
    first, again = (slopes(layer, encoded(layer, rows)) for _ in range(2))
    assert all(torch.equal(one, other) for one, other in zip(first, again, strict=True))


def test_what_is_no_number_is_seen_in_its_row_alone() -> None:
    layer, rows = layer_of(16), dense_rows(0.2)
    rows[7, 3] = torch.nan
    is_number = encoded(layer, sparse(rows)).isfinite().all(dim=1)
    assert torch.nonzero(~is_number).flatten().tolist() == [7]

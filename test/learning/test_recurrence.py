"""The compiled steps of a GRU are those of torch's own cell, and of the steps by operations."""

from collections.abc import Sequence

from episodes import single_threaded_torch
from interpreted import interpreted
import pytest

torch = single_threaded_torch()
from torch import nn, Tensor
from uav_collect.kernels.compile import kernels_are_compiled
from uav_collect.learning.recurrence import CompiledRecurrence, hidden_states, Recurrence

LENGTHS = {  # of sequences, longest first
    'one alone': [9],
    'fewer than eight': [12, 12, 7, 1],
    'eight, then fewer': [30, 28, 28, 28, 20, 19, 3, 3],
    'more than eight': [40, 39, 39, 38, 35, 33, 33, 30, 21, 20, 20, 20, 20, 19, 18, 17, 9, 4, 1],
    'one step': [1] * 11,
}
SIZES = (16, 64, 256)

compiled = pytest.mark.skipif(not kernels_are_compiled(), reason='kernels are interpreted')


def step_sizes(lengths: Sequence[int]) -> list[int]:
    """How many sequences reach each step."""
    return [sum(length > step for length in lengths) for step in range(lengths[0])]


def cell_of(size: int) -> nn.GRUCell:
    torch.manual_seed(size)
    return nn.GRUCell(size, size)


def inputs(lengths: Sequence[int], size: int, kind: torch.dtype = torch.float32) -> Tensor:
    generator = torch.Generator().manual_seed(1)
    drawn = torch.randn((sum(lengths), size), generator=generator).relu()
    return drawn.to(kind).requires_grad_()


def by_cell(encoded: Tensor, cell: nn.GRUCell, sizes: Sequence[int]) -> Tensor:
    """The hidden states by torch's own cell and its autograd."""
    hidden = encoded.new_zeros(sizes[0], encoded.shape[1])
    steps = []
    for rows in encoded.split(list(sizes)):
        hidden = cell(rows, hidden[: len(rows)])
        steps.append(hidden)
    return torch.cat(steps)


def slopes(hidden: Tensor, encoded: Tensor, cell: nn.GRUCell) -> dict[str, Tensor]:
    """The hidden states, and the gradients of a loss that weighs each of them differently."""
    weights = torch.linspace(-1.0, 2.0, hidden.numel(), dtype=hidden.dtype).view_as(hidden)
    wanted = {'encoded': encoded, **dict(cell.named_parameters())}
    found = torch.autograd.grad((weights * hidden.square()).mean(), list(wanted.values()))
    return {'hidden': hidden.detach(), **dict(zip(wanted, found, strict=True))}


@compiled
@pytest.mark.parametrize('size', SIZES)
@pytest.mark.parametrize('lengths', LENGTHS.values(), ids=LENGTHS)
def test_compiled_in_single_precision_it_is_the_cell_in_double_to_1e_6(
    lengths: list[int], size: int
) -> None:
    sizes, cell, encoded = step_sizes(lengths), cell_of(size), inputs(lengths, size)
    ours = slopes(hidden_states(encoded, cell, sizes), encoded, cell)
    cell, encoded = cell_of(size).double(), inputs(lengths, size, torch.float64)
    for way in (by_cell, hidden_states):  # the latter in double precision by operations of torch
        exact = slopes(way(encoded, cell, sizes), encoded, cell)
        for name, expected in exact.items():
            error = (ours[name].double() - expected).norm()
            assert error <= 1e-6 * expected.norm(), (way, name)


@compiled
def test_the_same_inputs_give_the_same_bits() -> None:
    lengths = LENGTHS['more than eight']
    sizes, cell, encoded = step_sizes(lengths), cell_of(64), inputs(lengths, 64)
    first, again = (slopes(hidden_states(encoded, cell, sizes), encoded, cell) for _ in range(2))
    assert all(torch.equal(first[name], again[name]) for name in first)


@compiled
def test_a_sequence_has_the_same_hidden_states_alone() -> None:
    cell, encoded = cell_of(16), inputs([7] * 8, 16)
    together = hidden_states(encoded, cell, [8] * 7)
    alone = hidden_states(encoded[::8], cell, [1] * 7)
    torch.testing.assert_close(together[::8], alone)


@compiled
def test_what_is_no_number_is_seen_in_all_that_follows_it() -> None:
    cell, encoded = cell_of(16), inputs([5, 5], 16)
    with torch.no_grad():
        encoded[4, 3] = torch.nan  # of the first sequence, at its third step
        is_number = hidden_states(encoded, cell, [2] * 5).isfinite().all(dim=1)
    assert is_number.tolist() == [True, True, True, True, False, True, False, True, False, True]


@compiled
def test_large_inputs_saturate_the_gates() -> None:
    cell, encoded = cell_of(16), 1e4 * inputs([3], 16)
    hidden = hidden_states(encoded, cell, [1] * 3)
    torch.testing.assert_close(hidden, by_cell(encoded, cell, [1] * 3), rtol=0.0, atol=1e-6)


def way_taken(encoded: Tensor, size: int, monkeypatch: pytest.MonkeyPatch) -> str:
    """Which of the two computes the hidden states of one row."""
    taken = []
    for way in (CompiledRecurrence, Recurrence):
        monkeypatch.setattr(way, 'apply', lambda *given, way=way: taken.append(way.__name__))
    hidden_states(encoded, nn.GRUCell(size, size), [1])
    return taken[0]


@compiled
@pytest.mark.parametrize(('kind', 'size', 'expected'), [
    (torch.float32, 16, 'CompiledRecurrence'),
    (torch.float32, 12, 'Recurrence'),  # no whole number of vectors
    (torch.float64, 16, 'Recurrence'),
    (torch.bfloat16, 16, 'Recurrence'),
])  # fmt: skip
def test_kernels_take_vectors_in_single_precision(
    kind: torch.dtype, size: int, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert way_taken(torch.zeros(1, size, dtype=kind), size, monkeypatch) == expected


def way_in_single_precision() -> str:
    """The way of a process, by what the loss's slope went through."""
    encoded = inputs([1], 16)
    return type(hidden_states(encoded, cell_of(16), [1]).grad_fn).__name__


def test_where_kernels_are_interpreted_torch_computes_the_steps() -> None:
    assert interpreted(way_in_single_precision) == 'RecurrenceBackward'

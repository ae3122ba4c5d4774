"""The agent network: packed sequences are what a plain GRU cell computes step by step."""

from episodes import single_threaded_torch
import numpy as np

torch = single_threaded_torch()
from torch import nn
from uav_collect.learning.network import Drqn
from uav_collect.uav.action_codes import N_ACTIONS

OBSERVATION_SIZE, HIDDEN_SIZE = 7, 12
LENGTHS = (9, 6, 6, 5, 1)  # of sequences, longest first
STEP_SIZES = [5, 4, 4, 4, 4, 3, 1, 1, 1]
N_ROWS = sum(LENGTHS)


def network(seed: int = 0) -> Drqn:
    torch.manual_seed(seed)
    return Drqn(OBSERVATION_SIZE, HIDDEN_SIZE).double()


def rows_of(sequence: int) -> list[int]:
    """Where the steps of a sequence lie."""
    starts = np.cumsum([0, *STEP_SIZES])
    return [int(starts[step]) + sequence for step in range(LENGTHS[sequence])]


def drawn(seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn((N_ROWS, OBSERVATION_SIZE), generator=generator, dtype=torch.float64)


def plain(net: Drqn, observation: torch.Tensor) -> torch.Tensor:
    """The same step by step, each sequence alone, by torch's own cell."""
    values = torch.empty((N_ROWS, N_ACTIONS), dtype=observation.dtype)
    for sequence in range(len(LENGTHS)):
        hidden = observation.new_zeros(1, HIDDEN_SIZE)
        for row in rows_of(sequence):
            encoded = torch.relu(net.encoder(observation[row : row + 1]))
            hidden = net.gru(encoded, hidden)
            values[row] = net.head(hidden)[0]
    return values


def gradients(net: Drqn, values: torch.Tensor) -> dict[str, torch.Tensor]:
    """Of a loss that weighs every value differently."""
    net.zero_grad()
    weights = torch.linspace(-1.0, 2.0, values.numel(), dtype=values.dtype).view_as(values)
    (weights * values.square()).sum().backward()
    return {name: it.grad.clone() for name, it in net.named_parameters()}


def test_packed_values_and_gradients_are_those_of_a_plain_gru_cell() -> None:
    net, observation = network(), drawn()
    packed, stepped = net(observation, STEP_SIZES), plain(net, observation)
    torch.testing.assert_close(packed, stepped, rtol=1e-12, atol=1e-12)
    ours, theirs = gradients(net, packed), gradients(net, stepped)
    for name, gradient in theirs.items():
        torch.testing.assert_close(ours[name], gradient, rtol=1e-10, atol=1e-10, msg=name)


def test_packed_values_and_gradients_agree_in_single_precision_to_1e_5() -> None:
    net, observation = network().float(), drawn().float()
    packed, stepped = net(observation, STEP_SIZES), plain(net, observation)
    torch.testing.assert_close(packed, stepped, rtol=1e-5, atol=1e-6)
    ours, theirs = gradients(net, packed), gradients(net, stepped)
    for name, gradient in theirs.items():
        assert (ours[name] - gradient).norm() <= 1e-5 * gradient.norm(), name


def test_gradients_are_those_of_finite_differences() -> None:
    net, observation = network(), drawn()
    parameters = dict(net.named_parameters())

    def values(*weights: torch.Tensor) -> torch.Tensor:
        given = dict(zip(parameters, weights, strict=True))
        return torch.func.functional_call(net, given, (observation, STEP_SIZES))

    torch.autograd.gradcheck(values, tuple(parameters.values()), atol=1e-7, rtol=1e-5)


def test_the_gradient_reaches_the_observations_too() -> None:
    net, observation = network(), drawn()
    given = [observation.clone().requires_grad_() for _ in range(2)]
    net(given[0], STEP_SIZES).square().sum().backward()
    plain(net, given[1]).square().sum().backward()
    torch.testing.assert_close(given[0].grad, given[1].grad)


def test_a_step_of_many_uavs_is_a_step_of_their_sequences() -> None:
    net, observation = network(), drawn()
    packed = net(observation, STEP_SIZES)
    values, hidden = net.step(observation[:5], torch.zeros(5, HIDDEN_SIZE, dtype=torch.float64))
    torch.testing.assert_close(values, packed[:5])
    values, _ = net.step(observation[5:9], hidden[:4])
    torch.testing.assert_close(values, packed[5:9])


def test_a_foreign_sequence_changes_nothing() -> None:
    net, observation = network(), drawn()
    before = net(observation, STEP_SIZES)
    observation[rows_of(1)] += 1.0
    after = net(observation, STEP_SIZES)
    kept = [row for sequence in (0, 2, 3, 4) for row in rows_of(sequence)]
    assert torch.equal(before[kept], after[kept])
    assert not torch.equal(before[rows_of(1)], after[rows_of(1)])


def test_a_value_depends_on_its_sequences_past_and_not_on_its_future() -> None:
    net, observation = network(), drawn()
    before = net(observation, STEP_SIZES)
    rows = rows_of(0)
    observation[rows[4]] += 1.0
    after = net(observation, STEP_SIZES)
    assert torch.equal(before[rows[:4]], after[rows[:4]])
    assert (before[rows[4:]] != after[rows[4:]]).any(dim=1).all()


def test_sequences_of_one_step_need_no_recurrence() -> None:
    net, observation = network(), drawn()[:5]
    values = net(observation, [5])
    expected, _ = net.step(observation, torch.zeros(5, HIDDEN_SIZE, dtype=torch.float64))
    torch.testing.assert_close(values, expected)
    gradients(net, values)
    assert net.gru.weight_ih.grad.abs().sum() > 0.0
    assert net.gru.weight_hh.grad.abs().sum() == 0.0


def test_every_parameter_gets_a_gradient() -> None:
    net = network()
    found = gradients(net, net(drawn(), STEP_SIZES))
    assert {name for name, gradient in found.items() if not gradient.abs().sum() > 0.0} == set()


def test_its_weights_are_torchs_own_gru_in_the_order_reset_update_new() -> None:
    net = network()
    reference = nn.GRU(HIDDEN_SIZE, HIDDEN_SIZE).double()
    state = {f'{name}_l0': value for name, value in net.gru.state_dict().items()}
    reference.load_state_dict(state)
    observation = drawn()[rows_of(0)]
    with torch.no_grad():
        hidden, _ = reference(torch.relu(net.encoder(observation))[:, None])
        expected = net.head(hidden[:, 0])
        torch.testing.assert_close(net(observation, [1] * len(observation)), expected)


def test_bfloat16_products_change_values_and_gradients_by_little() -> None:
    net, observation = network().float(), drawn().float()
    exact = gradients(net, net(observation, STEP_SIZES))
    with torch.autocast('cpu', torch.bfloat16):
        values = net(observation, STEP_SIZES)
    rounded = gradients(net, values.float())
    flat = [
        torch.cat([it.flatten().float() for it in found.values()]) for found in (exact, rounded)
    ]
    assert torch.cosine_similarity(*flat, dim=0) > 0.999

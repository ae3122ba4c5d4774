"""The mixing network: monotonic in every UAV's value, so that each UAV may maximise its own."""

from episodes import single_threaded_torch
import pytest
from tiny_world import tiny

torch = single_threaded_torch()
from uav_collect.learning.mixer import Mixer, pooling_windows, SetMixer
from uav_collect.uav.action_codes import N_ACTIONS
from uav_collect.uav.briefing import brief

N_MIXERS = 2_500  # for each of four fleets
N_CELLS = 16


def drawn_mixer(n_uavs: int, generator: torch.Generator, pooling: str = 'sum') -> Mixer:
    """A mixer of random weights."""
    mixer = Mixer(
        n_uavs=n_uavs,
        n_uav_scalars=4,
        n_rows=4,
        n_columns=4,
        pool_side=3,
        pooling=pooling,
        embedding_size=3,
        hypernetwork_size=3,
    )
    for parameter in mixer.parameters():
        parameter.data.normal_(std=0.5, generator=generator)
    return mixer.double()


def drawn_state(
    mixer: Mixer, n_states: int, n_uavs: int, generator: torch.Generator
) -> torch.Tensor:
    return mixer.state(*drawn_maps(n_states, n_uavs, generator))


def drawn_values(generator: torch.Generator, *shape: int) -> torch.Tensor:
    return torch.randn(shape, generator=generator, dtype=torch.float64)


def drawn_maps(
    n_states: int, n_uavs: int, generator: torch.Generator
) -> tuple[torch.Tensor, torch.Tensor]:
    """The UAVs' numbers and all completion maps."""
    fleet = torch.rand((n_states, n_uavs * 4), generator=generator, dtype=torch.float64)
    complete = torch.randint(2, (n_states, n_uavs + 1, N_CELLS), generator=generator)
    return fleet, complete.to(torch.uint8)


@pytest.mark.parametrize('n_uavs', [2, 3, 4, 6])
def test_the_deciding_uavs_own_best_action_is_the_teams_best(n_uavs: int) -> None:
    # Lemma 1, by enumeration in 10,000 mixers in all: every action of the UAV that decides, while
    # the others' running ones stay.
    generator = torch.Generator().manual_seed(n_uavs)
    mixer = drawn_mixer(n_uavs, generator)
    weights = {
        name: 0.5 * drawn_values(generator, N_MIXERS, *parameter.shape)
        for name, parameter in mixer.named_parameters()
    }
    own = drawn_values(generator, N_MIXERS, N_ACTIONS)
    joint = drawn_values(generator, N_MIXERS, 1, n_uavs).repeat(1, N_ACTIONS, 1)
    deciding = torch.randint(n_uavs, (N_MIXERS,), generator=generator)
    joint[torch.arange(N_MIXERS), :, deciding] = own
    state = drawn_state(mixer, N_MIXERS, n_uavs, generator).unsqueeze(1)
    state = state.expand(-1, N_ACTIONS, -1)

    def mixed(own_weights: dict[str, torch.Tensor], *inputs: torch.Tensor) -> torch.Tensor:
        return torch.func.functional_call(mixer, own_weights, inputs)

    with torch.no_grad():
        team = torch.func.vmap(mixed)(weights, joint, state)
    best = team.gather(1, own.argmax(dim=1, keepdim=True)).squeeze(1)
    # An ELU may be flat to the last bit; then the team's values differ by their rounding.
    torch.testing.assert_close(best, team.max(dim=1).values, rtol=1e-13, atol=1e-13)
    assert (team.argmax(dim=1) == own.argmax(dim=1)).double().mean() > 0.999


def test_a_team_value_falls_in_no_uavs_value() -> None:
    generator = torch.Generator().manual_seed(1)
    for n_uavs in (1, 2, 6):
        mixer = drawn_mixer(n_uavs, generator)
        values = drawn_values(generator, 500, n_uavs).requires_grad_()
        mixer(values, drawn_state(mixer, 500, n_uavs, generator)).sum().backward()
        assert (values.grad >= 0.0).all()
        assert (values.grad > 0.0).double().mean() > 0.99


def test_a_team_value_depends_on_every_part_of_the_state() -> None:
    generator = torch.Generator().manual_seed(2)
    mixer = drawn_mixer(2, generator)
    fleet, complete = drawn_maps(200, 2, generator)
    values = drawn_values(generator, 200, 2)
    with torch.no_grad():
        team = mixer(values, mixer.state(fleet, complete))
        for place in range(fleet.shape[1]):
            moved = fleet.clone()
            moved[:, place] += 1.0
            assert (mixer(values, mixer.state(moved, complete)) != team).any()
        for index in range(3):
            for cell in range(N_CELLS):
                flipped = complete.clone()
                flipped[:, index, cell] = 1 - flipped[:, index, cell]
                assert (mixer(values, mixer.state(fleet, flipped)) != team).any()


def test_a_state_is_mixed_alike_alone_and_among_others() -> None:
    generator = torch.Generator().manual_seed(3)
    mixer = drawn_mixer(3, generator)
    values = drawn_values(generator, 7, 3)
    state = drawn_state(mixer, 7, 3, generator)
    together = mixer(values, state)
    alone = mixer(values[4:5], state[4:5])
    torch.testing.assert_close(together[4:5], alone)


@pytest.mark.parametrize('pool_side', [1, 2, 3, 4, 5])
def test_pooling_sums_the_cells_of_each_window_those_at_the_edge_too(pool_side: int) -> None:
    complete = torch.rand(10, 10)
    n_windows = -(-10 // pool_side)
    expected = [
        complete[row : row + pool_side, column : column + pool_side].sum()
        for row in range(0, n_windows * pool_side, pool_side)
        for column in range(0, n_windows * pool_side, pool_side)
    ]
    pooled = complete.flatten() @ pooling_windows(10, 10, pool_side)
    torch.testing.assert_close(pooled, torch.stack(expected))


def test_the_state_of_the_paper_is_four_numbers_a_uav_and_their_pooled_maps() -> None:
    side = brief(tiny()).n_rows
    mixer = drawn_mixer(2, torch.Generator())
    n_windows = (-(-side // 3)) ** 2
    state = drawn_state(mixer, 5, 2, torch.Generator())
    assert state.shape == (5, 2 * 4 + 3 * n_windows)


def test_mean_pooling_is_sum_pooling_over_the_cells_of_a_whole_window() -> None:
    generator = torch.Generator().manual_seed(4)
    mixers = [drawn_mixer(2, generator, pooling) for pooling in ('sum', 'mean')]
    maps = drawn_maps(5, 2, generator)
    sums, means = (mixer.state(*maps) for mixer in mixers)
    torch.testing.assert_close(means[:, 8:], sums[:, 8:] / 9.0)  # after two UAVs' four numbers
    assert torch.equal(means[:, :8], sums[:, :8])


def drawn_set_mixer(generator: torch.Generator) -> SetMixer:
    """A set mixer of random weights."""
    mixer = SetMixer(n_uav_scalars=4, embedding_size=3, hypernetwork_size=5)
    for parameter in mixer.parameters():
        parameter.data.normal_(std=0.5, generator=generator)
    return mixer.double()


@pytest.mark.parametrize('n_uavs', [1, 2, 5, 8])
def test_a_set_mixer_falls_in_no_uavs_value(n_uavs: int) -> None:
    generator = torch.Generator().manual_seed(n_uavs)
    mixer = drawn_set_mixer(generator)
    values = drawn_values(generator, 500, n_uavs).requires_grad_()
    state = mixer.state(*drawn_maps(500, n_uavs, generator), (2, 8))
    mixer(values, state).sum().backward()
    assert (values.grad >= 0.0).all()
    assert (values.grad > 0.0).double().mean() > 0.99


def test_a_set_mixer_does_not_care_which_uav_is_which() -> None:
    generator = torch.Generator().manual_seed(5)
    mixer, order = drawn_set_mixer(generator), torch.tensor([2, 0, 3, 1])
    fleet, complete = drawn_maps(50, 4, generator)
    values = drawn_values(generator, 50, 4)
    fleet_then = fleet.view(50, 4, 4)[:, order].reshape(50, 16)
    complete_then = torch.cat((complete[:, order], complete[:, 4:]), dim=1)
    team = mixer(values, mixer.state(fleet, complete, (4, 4)))
    then = mixer(values[:, order], mixer.state(fleet_then, complete_then, (4, 4)))
    torch.testing.assert_close(team, then)


def test_a_set_mixer_depends_on_every_part_of_the_state_and_on_the_area() -> None:
    generator = torch.Generator().manual_seed(6)
    mixer = drawn_set_mixer(generator)
    fleet, complete = drawn_maps(200, 2, generator)
    values = drawn_values(generator, 200, 2)
    with torch.no_grad():
        team = mixer(values, mixer.state(fleet, complete, (4, 4)))
        assert (mixer(values, mixer.state(fleet, complete, (2, 8))) != team).any()
        for place in range(fleet.shape[1]):
            moved = fleet.clone()
            moved[:, place] += 1.0
            assert (mixer(values, mixer.state(moved, complete, (4, 4))) != team).any()
        for index in range(3):
            for cell in range(N_CELLS):
                flipped = complete.clone()
                flipped[:, index, cell] = 1 - flipped[:, index, cell]
                assert (mixer(values, mixer.state(fleet, flipped, (4, 4))) != team).any()


@pytest.mark.parametrize('area', [(10, 10), (7, 13), (3, 24), (1, 1)])
def test_maps_of_a_set_are_pooled_to_the_means_of_five_by_five_blocks(
    area: tuple[int, int],
) -> None:
    generator = torch.Generator().manual_seed(7)
    mixer = drawn_set_mixer(generator)
    complete = torch.randint(2, (6, 3, area[0] * area[1]), generator=generator).to(torch.uint8)
    state = mixer.state(torch.zeros(6, 8), complete, area)
    pooled = torch.nn.functional.adaptive_avg_pool2d(complete.view(6, 3, *area).float(), 5)
    torch.testing.assert_close(state[:, 4:29], pooled[:, 0].flatten(1))
    torch.testing.assert_close(state[:, 33:58], pooled[:, 1].flatten(1))
    torch.testing.assert_close(state[:, 58:83], pooled[:, 2].flatten(1))
    sizes = torch.tensor([2 / 8, area[0] / 24, area[1] / 24])
    torch.testing.assert_close(state[:, 83:], sizes.expand(6, 3))

from collections.abc import Callable
from decimal import Decimal, localcontext
import math
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from interpreted import interpreted
import numpy as np
import pytest
from uav_collect.errors import AllocationError
from uav_collect.kernels.arrays import Floats, new_row, row_of
from uav_collect.limits import ALLOCATOR_NAMES
from uav_collect.physics import bandwidth
from uav_collect.physics.allocation import allocate_equal, allocate_exact, Allocation

# Signal, error, demand of one hover, and B and N_0.
Hover = tuple[Floats, Floats, Floats, float, float]
Draw = Callable[[np.random.Generator], Hover]

by_the_same_cases = settings(deadline=None, derandomize=True, database=None)


def allocate_cvxpy(*hovers: Any, **link: float) -> Allocation:  # noqa: ANN401
    """Imported late: cvxpy takes seconds, and each worker collects this module."""
    from uav_collect.physics import bandwidth_convex

    return bandwidth_convex.allocate_cvxpy(*hovers, **link)


def link(rng: np.random.Generator, *, csi_error: float) -> Hover:
    """A hover over a cell of the paper: 1 to 30 sensors within 25 m, 100 m below."""
    n = int(rng.integers(1, 31))
    distance_m = np.sqrt((rng.uniform(-25.0, 25.0, (n, 2)) ** 2).sum(axis=1) + 100.0**2)
    alpha = 1.42286e-4 * distance_m**-2.6 * np.where(rng.random(n) < 0.02, 0.2, 1.0)
    signal_w = 0.01 * alpha * rng.gamma(20.0, 1 / 20.0, n)
    return signal_w, 0.01 * alpha * csi_error, rng.uniform(0.1e6, 1e6, n), 0.5e6, 1e-18


def perfect_csi(rng: np.random.Generator) -> Hover:
    return link(rng, csi_error=0.0)


def imperfect_csi(rng: np.random.Generator) -> Hover:
    return link(rng, csi_error=10.0 ** rng.uniform(-3.0, -1.0))


def spread(
    rng: np.random.Generator, n: int, *, signal: float, error: float, demand: float
) -> Hover:
    """Numbers spread over so many decades, a tenth of the sensors without demand."""
    bandwidth_hz, noise_w_per_hz = 10.0 ** rng.uniform(4.0, 8.0), 10.0 ** rng.uniform(-21, -15)
    noise_w = bandwidth_hz * noise_w_per_hz
    signal_w = noise_w * 10.0 ** rng.uniform(1.0 - signal / 2, 1.0 + signal / 2, n)
    error_w = noise_w * 10.0 ** rng.uniform(-error, 0.0, n) * (rng.random(n) < 0.5)
    demand_bit = 10.0 ** rng.uniform(5.0 - demand / 2, 5.0 + demand / 2, n)
    demand_bit[1:] *= rng.random(n - 1) < 0.9
    return signal_w, error_w * (error > 0.0), demand_bit, bandwidth_hz, noise_w_per_hz


def wild(rng: np.random.Generator) -> Hover:
    return spread(rng, int(rng.integers(1, 13)), signal=6.0, error=0.0, demand=2.0)


def wild_with_error(rng: np.random.Generator) -> Hover:
    return spread(rng, int(rng.integers(1, 13)), signal=5.0, error=2.0, demand=2.0)


def absurd(rng: np.random.Generator) -> Hover:
    decades = rng.uniform(6.0, 60.0)
    n = int(rng.integers(2, 13))
    hover = spread(rng, n, signal=decades, error=decades, demand=decades / 2)
    return hover[0], hover[1] * 10.0 ** rng.uniform(0.0, decades / 2), *hover[2:]


def batch(hover: Hover) -> Hover:
    signal_w, error_w, demand_bit, *rest = hover
    return signal_w[None], error_w[None], demand_bit[None], *rest


def hover_of(signal: list[float], error: list[float], demand: list[float]) -> Hover:
    """A hover in scaled numbers: B = 1 Hz and N_0 = 1 W/Hz."""
    return np.array(signal), np.array(error), np.array(demand), 1.0, 1.0


def only(allocation: Allocation) -> tuple[Floats, float, float]:
    return allocation.share_hz[0], float(allocation.hover_s[0]), float(allocation.gap[0])


def check_feasible(hover: Hover, share_hz: Floats) -> None:
    assert (share_hz >= 0.0).all()
    assert share_hz.sum() <= hover[3] * (1.0 + 1e-12)
    assert (share_hz[hover[2] == 0.0] == 0.0).all()


@pytest.mark.parametrize('draw', [perfect_csi, imperfect_csi, wild, wild_with_error])
def test_exact_hover_times_equal_those_that_clarabel_finds(draw: Draw) -> None:
    from uav_collect.physics import bandwidth_convex

    rng = np.random.default_rng(17)
    for _ in range(500):
        hover = draw(rng)
        share_hz, hover_s, gap = only(allocate_exact(*batch(hover)))
        assert hover_s == pytest.approx(bandwidth_convex.shortest_hover_s(*hover), rel=1e-8)
        assert gap <= 1e-10
        assert hover_s <= allocate_equal(*batch(hover)).hover_s[0]
        check_feasible(hover, share_hz)


def needed_share(s: Decimal, e: Decimal, wanted: Decimal) -> Decimal:
    """The x with x ln(1 + s / (e + x)) = wanted, from below; 1 if it is more than that."""

    def f(x: Decimal) -> Decimal:
        return x * (1 + s / (e + x)).ln()

    if f(Decimal(1)) <= wanted:
        return Decimal(1)
    x = Decimal(1)
    while f(x) > wanted:
        x /= 1000
    # The tangents of a concave function lie above it: left of the solution, Newton stays there.
    for _ in range(60):
        slope = (1 + s / (e + x)).ln() - x * s / ((e + x) * (e + x + s))
        step = (wanted - f(x)) / slope
        x += step
        if step < x * Decimal('1e-30'):
            break
    return x


def needed_bandwidth(hover: Hover, hover_s: Decimal) -> Decimal:
    """Part of the bandwidth without which a hover takes longer, in arithmetic of many digits."""
    signal_w, error_w, demand_bit, bandwidth_hz, noise_w_per_hz = hover
    noise_w = Decimal(bandwidth_hz) * Decimal(noise_w_per_hz)
    used = Decimal(0)
    for i in np.flatnonzero(demand_bit):
        s, e = Decimal(signal_w[i]) / noise_w, Decimal(error_w[i]) / noise_w
        wanted = Decimal(demand_bit[i]) * Decimal(2).ln() / Decimal(bandwidth_hz) / hover_s
        used += needed_share(s, e, wanted)
    return used


@pytest.mark.parametrize('draw', [imperfect_csi, wild_with_error, absurd])
def test_in_arithmetic_of_many_digits_a_hover_can_be_so_short_but_not_shorter(draw: Draw) -> None:
    rng = np.random.default_rng(23)
    with localcontext(prec=100):  # an r of 1e-60 still changes 1 + r
        for _ in range(60):
            hover = draw(rng)
            hover_s = Decimal(float(allocate_exact(*batch(hover)).hover_s[0]))
            assert needed_bandwidth(hover, hover_s * Decimal('1.00000000001')) < 1
            assert needed_bandwidth(hover, hover_s * Decimal('0.99999999999')) >= 1


def test_numbers_over_60_decades_are_solved_and_never_slower_than_the_equal_split() -> None:
    rng = np.random.default_rng(29)
    for _ in range(2_000):
        hover = absurd(rng)
        share_hz, hover_s, gap = only(allocate_exact(*batch(hover)))
        assert gap <= 1e-10
        assert hover_s <= allocate_equal(*batch(hover)).hover_s[0]
        check_feasible(hover, share_hz)


@pytest.mark.parametrize('draw', [perfect_csi, imperfect_csi, wild, wild_with_error])
def test_the_equal_splits_gap_bounds_what_is_lost_by_it(draw: Draw) -> None:
    rng = np.random.default_rng(31)
    for _ in range(200):
        hover = draw(rng)
        best_s = allocate_exact(*batch(hover)).hover_s[0]
        share_hz, hover_s, gap = only(allocate_equal(*batch(hover)))
        assert best_s <= hover_s <= (1.0 + gap) * best_s * (1.0 + 1e-12)
        served = hover[2] > 0.0
        assert share_hz[served] == pytest.approx(hover[3] / served.sum())
        check_feasible(hover, share_hz)


@pytest.mark.parametrize('draw', [perfect_csi, imperfect_csi, wild_with_error])
def test_cvxpy_finds_the_exact_hover_time_to_six_digits(draw: Draw) -> None:
    rng = np.random.default_rng(37)
    for _ in range(20):
        hover = draw(rng)
        best_s = allocate_exact(*batch(hover)).hover_s[0]
        share_hz, hover_s, gap = only(allocate_cvxpy(*batch(hover)))
        assert hover_s == pytest.approx(best_s, rel=1e-6)
        assert hover_s <= (1.0 + gap) * best_s * (1.0 + 1e-12)
        check_feasible(hover, share_hz)


@pytest.mark.parametrize('seed', [13, 17, 138, 197])
def test_cvxpy_shares_bandwidth_where_its_solver_fails_by_default_settings(seed: int) -> None:
    # Sensors 30 dB below the paper's power.
    signal_w, error_w, *rest = link(np.random.default_rng(seed), csi_error=0.01)
    hover = signal_w * 1e-3, error_w * 1e-3, *rest
    best_s = allocate_exact(*batch(hover)).hover_s[0]
    share_hz, hover_s, gap = only(allocate_cvxpy(*batch(hover)))
    assert hover_s == pytest.approx(best_s, rel=1e-4)
    assert hover_s <= (1.0 + gap) * best_s * (1.0 + 1e-12)
    check_feasible(hover, share_hz)


def test_at_the_best_shares_all_sensors_end_together() -> None:
    hover = imperfect_csi(np.random.default_rng(3))
    share_hz, hover_s, _ = only(allocate_exact(*batch(hover)))
    signal_w, error_w, demand_bit, _, noise_w_per_hz = hover
    for i in range(len(signal_w)):
        alone = [row[i : i + 1] for row in (signal_w, error_w, demand_bit, share_hz)]
        own_s = bandwidth.hover_time_s(*alone, 1, noise_w_per_hz)
        assert own_s == pytest.approx(hover_s, rel=1e-10)
    assert share_hz.sum() == pytest.approx(0.5e6, rel=1e-12)


@pytest.mark.parametrize('draw', [perfect_csi, imperfect_csi, wild_with_error])
def test_the_order_of_the_sensors_does_not_matter(draw: Draw) -> None:
    rng = np.random.default_rng(41)
    for _ in range(50):
        signal_w, error_w, demand_bit, *rest = draw(rng)
        order = rng.permutation(len(signal_w))
        share_hz, hover_s, _ = only(allocate_exact(*batch((signal_w, error_w, demand_bit, *rest))))
        shuffled = (signal_w[order], error_w[order], demand_bit[order], *rest)
        shuffled_hz, shuffled_s, _ = only(allocate_exact(*batch(shuffled)))
        assert shuffled_s == pytest.approx(hover_s, rel=1e-11)
        assert shuffled_hz == pytest.approx(share_hz[order], rel=1e-6)


sizes = st.integers(1, 8)
seeds = st.integers(0, 2**32 - 1)


@by_the_same_cases
@given(seeds, sizes, st.floats(1.01, 10.0))
def test_more_bandwidth_or_signal_shortens_and_more_error_or_demand_lengthens_a_hover(
    seed: int, n: int, factor: float
) -> None:
    rng = np.random.default_rng(seed)
    signal_w, error_w, demand_bit, bandwidth_hz, noise_w_per_hz = spread(
        rng, n, signal=6.0, error=2.0, demand=2.0
    )

    def hover_s(*row: Floats, bandwidth_hz: float) -> float:
        return only(allocate_exact(*(x[None] for x in row), bandwidth_hz, noise_w_per_hz))[1]

    here_s = hover_s(signal_w, error_w, demand_bit, bandwidth_hz=bandwidth_hz)
    slack = 1.0 + 1e-11
    more_hz = factor * bandwidth_hz
    assert hover_s(signal_w, error_w, demand_bit, bandwidth_hz=more_hz) <= here_s * slack
    assert (
        hover_s(factor * signal_w, error_w, demand_bit, bandwidth_hz=bandwidth_hz)
        <= here_s * slack
    )
    assert (
        hover_s(signal_w, factor * error_w, demand_bit, bandwidth_hz=bandwidth_hz) * slack
        >= here_s
    )
    assert hover_s(
        signal_w, error_w, factor * demand_bit, bandwidth_hz=bandwidth_hz
    ) == pytest.approx(factor * here_s, rel=1e-10)


@by_the_same_cases
@given(seeds, sizes)
def test_another_sensor_lengthens_a_hover(seed: int, n: int) -> None:
    hover = spread(np.random.default_rng(seed), n + 1, signal=6.0, error=2.0, demand=2.0)
    signal_w, error_w, demand_bit, *rest = hover
    fewer = (signal_w[:n], error_w[:n], demand_bit[:n], *rest)
    without_s = allocate_exact(*batch(fewer)).hover_s[0]
    assert without_s <= allocate_exact(*batch(hover)).hover_s[0] * (1.0 + 1e-11)


ALLOCATORS = [allocate_exact, allocate_equal, allocate_cvxpy]


@pytest.mark.parametrize('allocate', ALLOCATORS)
class TestEveryAllocator:
    """What holds for all three."""

    def test_gives_a_lone_sensor_everything(self, allocate: Callable[..., Allocation]) -> None:
        # log2(1 + 3 / (0 + 1)) = 2 bit/s, for 4 bit
        share_hz, hover_s, gap = only(allocate(*batch(hover_of([3.0], [0.0], [4.0]))))
        assert share_hz == pytest.approx([1.0])
        assert hover_s == pytest.approx(2.0)
        assert gap == pytest.approx(0.0, abs=1e-7)

    def test_gives_nothing_where_nothing_waits(self, allocate: Callable[..., Allocation]) -> None:
        share_hz, hover_s, _ = only(
            allocate(*batch(hover_of([3.0, 9.0, 0.0], [0.0, 1.0, 0.0], [4.0, 0.0, 0.0])))
        )
        assert share_hz == pytest.approx([1.0, 0.0, 0.0])
        assert hover_s == pytest.approx(2.0)

    def test_needs_no_time_without_demand(self, allocate: Callable[..., Allocation]) -> None:
        share_hz, hover_s, gap = only(allocate(*batch(hover_of([3.0, 0.0], [0.0] * 2, [0.0] * 2))))
        assert share_hz.tolist() == [0.0, 0.0]
        assert (hover_s, gap) == (0.0, 0.0)

    def test_never_ends_with_a_sensor_that_it_cannot_hear(
        self, allocate: Callable[..., Allocation]
    ) -> None:
        hover = hover_of([3.0, 0.0], [0.0, 0.0], [4.0, 4.0])
        share_hz, hover_s, gap = only(allocate(*batch(hover)))
        assert (hover_s, gap) == (math.inf, 0.0)
        check_feasible(hover, share_hz)

    def test_treats_equal_sensors_equally(self, allocate: Callable[..., Allocation]) -> None:
        hover = hover_of([3.0] * 7, [0.5] * 7, [4.0] * 7)
        share_hz, hover_s, _ = only(allocate(*batch(hover)))
        assert share_hz == pytest.approx([1 / 7] * 7, rel=1e-4)
        assert hover_s == pytest.approx(allocate_equal(*batch(hover)).hover_s[0], rel=1e-7)

    def test_treats_hovers_of_a_batch_as_if_alone(
        self, allocate: Callable[..., Allocation]
    ) -> None:
        rng = np.random.default_rng(5)
        # Links of 5 hovers in one row, cut into a table.
        while len((row := imperfect_csi(rng)[:3])[0]) < 20:
            pass
        rows = [numbers[:20].reshape(5, 4) for numbers in row]
        together = allocate(*rows, 0.5e6, 1e-18)
        for m in range(5):
            alone = allocate(*(row[m : m + 1] for row in rows), 0.5e6, 1e-18)
            assert alone.share_hz[0] == pytest.approx(together.share_hz[m], rel=1e-4)
            assert alone.hover_s[0] == pytest.approx(together.hover_s[m], rel=1e-7)

    def test_allocates_nothing_for_no_hovers_and_no_sensors(
        self, allocate: Callable[..., Allocation]
    ) -> None:
        assert allocate(*[np.zeros((0, 4))] * 3, 1.0, 1.0).share_hz.shape == (0, 4)
        no_sensors = allocate(*[np.zeros((2, 0))] * 3, 1.0, 1.0)
        assert no_sensors.share_hz.shape == (2, 0)
        assert no_sensors.hover_s.tolist() == [0.0, 0.0]

    @pytest.mark.parametrize('bad', [math.nan, math.inf, -1.0])
    @pytest.mark.parametrize(
        ('index', 'name', 'unit'),
        [(0, 'signal_w', 'W'), (1, 'error_w', 'W'), (2, 'demand_bit', 'bit')],
    )
    def test_names_the_sensor_of_a_bad_number(
        self, allocate: Callable[..., Allocation], index: int, name: str, unit: str, bad: float
    ) -> None:
        rows = [np.ones((2, 3)) for _ in range(3)]
        rows[index][1, 2] = bad
        message = (
            f'{name} must be finite and >= 0 {unit}, got {bad:g} {unit} for sensor 2 of hover 1'
        )
        with pytest.raises(AllocationError) as caught:
            allocate(*rows, 1.0, 1.0)
        assert str(caught.value) == message

    @pytest.mark.parametrize('bad', [math.nan, math.inf, -1.0, 0.0])
    @pytest.mark.parametrize('name', ['bandwidth_hz', 'noise_w_per_hz'])
    def test_refuses_a_bad_bandwidth_or_noise(
        self, allocate: Callable[..., Allocation], name: str, bad: float
    ) -> None:
        numbers = {'bandwidth_hz': 1.0, 'noise_w_per_hz': 1.0} | {name: bad}
        with pytest.raises(AllocationError, match=f'^{name} must be finite and > 0 .*{bad:g}'):
            allocate(*[np.ones((1, 2))] * 3, **numbers)

    def test_refuses_numbers_that_would_leave_the_range_of_doubles(
        self, allocate: Callable[..., Allocation]
    ) -> None:
        rows = [np.ones((1, 2)) for _ in range(3)]
        rows[0][0, 1] = 1e200
        with pytest.raises(AllocationError, match='signal_w must be 0 or within'):
            allocate(*rows, 1.0, 1.0)

    def test_refuses_shapes_that_differ(self, allocate: Callable[..., Allocation]) -> None:
        with pytest.raises(ValueError, match=r'error_w must have shape \(2, 3\), got \(3,\)'):
            allocate(np.ones((2, 3)), np.ones(3), np.ones((2, 3)), 1.0, 1.0)
        with pytest.raises(ValueError, match=r'signal_w must have shape \(hovers, sensors\)'):
            allocate(*[np.ones(3)] * 3, 1.0, 1.0)


def test_an_allocation_error_is_a_value_error() -> None:
    assert issubclass(AllocationError, ValueError)


def test_a_names_place_is_its_code() -> None:
    assert ALLOCATOR_NAMES[bandwidth.EXACT] == 'exact'
    assert ALLOCATOR_NAMES[bandwidth.EQUAL] == 'equal'


@pytest.mark.parametrize('allocator', [bandwidth.EXACT, bandwidth.EQUAL])
def test_what_lies_behind_the_last_sensor_is_neither_read_nor_written(allocator: int) -> None:
    rows = [row_of([*numbers, math.nan]) for numbers in ([3.0, 8.0], [0.0, 1.0], [4.0, 2.0])]
    share_hz = new_row(3, -7.0)
    hover_s, gap = bandwidth.share_bandwidth(allocator, *rows, 2, 1.0, 1.0, share_hz)
    assert math.isfinite(hover_s)
    assert math.isfinite(gap)
    assert share_hz[2] == -7.0


@pytest.mark.parametrize('allocator', [bandwidth.EXACT, bandwidth.EQUAL])
def test_a_kernel_ends_even_where_a_number_is_none(allocator: int) -> None:
    rows = [row_of(numbers) for numbers in ([3.0, 8.0], [0.0, math.nan], [4.0, 2.0])]
    hover_s, _ = bandwidth.share_bandwidth(allocator, *rows, 2, 1.0, 1.0, new_row(2, 0.0))
    assert hover_s == math.inf


def test_a_hover_lasts_until_the_slowest_sensor_ends() -> None:
    # 0.25 log2(1 + 0.75 / (0.25 + 0.25)) = 0.330482, 0.75 log2(1 + 5.25 / 0.75) = 2.25
    rows = [row_of(x) for x in ([0.75, 5.25], [0.25, 0.0], [1.0, 9.0], [0.25, 0.75])]
    assert bandwidth.hover_time_s(*rows, 2, 1.0) == pytest.approx(9.0 / 2.25)
    assert bandwidth.hover_time_s(*rows, 1, 1.0) == pytest.approx(1.0 / 0.330482, rel=1e-6)
    rows[3][1] = 0.0
    assert bandwidth.hover_time_s(*rows, 2, 1.0) == math.inf


def bits() -> str:
    rng = np.random.default_rng(43)
    lines = []
    for draw in (perfect_csi, imperfect_csi, wild, wild_with_error, absurd):
        for _ in range(50):
            hover = batch(draw(rng))
            for allocate in (allocate_exact, allocate_equal):
                share_hz, hover_s, gap = only(allocate(*hover))
                numbers = [*share_hz.tolist(), hover_s, gap]
                lines.append(' '.join(number.hex() for number in numbers))
    return '\n'.join(lines)


def test_interpreted_allocations_equal_compiled_ones_to_the_bit() -> None:
    assert interpreted(bits) == bits()

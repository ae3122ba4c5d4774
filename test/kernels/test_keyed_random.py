import math

from hypothesis import given, settings
from hypothesis import strategies as st
from interpreted import interpreted
import numpy as np
import pytest
from uav_collect.kernels import keyed_random

by_the_same_cases = settings(deadline=None, derandomize=True, database=None)
seeds = st.integers(0, 2**63 - 1)
indices = st.integers(0, 2**32 - 1)


def words(text: str) -> tuple[int, ...]:
    return tuple(int(word, 16) for word in text.split())


@pytest.mark.parametrize(
    ('key', 'counter', 'drawn'),
    [
        (
            '00000000 00000000',
            '00000000 00000000 00000000 00000000',
            '6627e8d5 e169c58d bc57ac4c 9b00dbd8',
        ),
        (
            'ffffffff ffffffff',
            'ffffffff ffffffff ffffffff ffffffff',
            '408f276d 41c83b0e a20bc7c6 6d5451fd',
        ),
        (
            'a4093822 299f31d0',
            '243f6a88 85a308d3 13198a2e 03707344',
            'd16cfe09 94fdcceb 5001e420 24126ea1',
        ),
    ],
    ids=['zeros', 'ones', 'pi'],
)
def test_philox_draws_the_known_answers_of_random123(key: str, counter: str, drawn: str) -> None:
    assert keyed_random.philox(*words(key), *words(counter)) == words(drawn)


def test_a_draw_uses_all_bits_of_seed_and_indices() -> None:
    plain = keyed_random.draw_words(5, 1, 2, 3, 4)
    assert keyed_random.draw_words(5, 1, 2, 3, 4) == plain
    others = {
        keyed_random.draw_words(*key)
        for key in (
            (6, 1, 2, 3, 4),
            (5 + 2**32, 1, 2, 3, 4),
            (5, 2, 2, 3, 4),
            (5, 1, 3, 3, 4),
            (5, 1, 2, 4, 4),
            (5, 1, 2, 3, 5),
        )
    }
    assert len(others) == 6
    assert plain not in others


@by_the_same_cases
@given(seeds, indices, indices, indices)
def test_words_have_32_bits_and_uniforms_lie_in_0_to_1(
    seed: int, index_0: int, index_1: int, index_2: int
) -> None:
    drawn = keyed_random.draw_words(seed, keyed_random.CHANNEL, index_0, index_1, index_2)
    assert all(0 <= word < 2**32 for word in drawn)
    assert (
        0.0
        <= keyed_random.draw_uniform(seed, keyed_random.CHANNEL, index_0, index_1, index_2)
        < 1.0
    )


def test_uniforms_fill_0_to_1_evenly() -> None:
    drawn = np.array([keyed_random.draw_uniform(11, 0, index, 0, 0) for index in range(20_000)])
    counts, _ = np.histogram(drawn, bins=20, range=(0.0, 1.0))
    chi_square = ((counts - 1000.0) ** 2 / 1000.0).sum()
    assert chi_square < 43.8  # 99.9 % point for 19 degrees of freedom
    assert abs(np.corrcoef(drawn[:-1], drawn[1:])[0, 1]) < 4.0 / math.sqrt(20_000)


def test_normal_pairs_have_the_moments_of_two_independent_normals() -> None:
    drawn = np.array(
        [
            keyed_random.normal_pair(
                *keyed_random.draw_words(7, keyed_random.CHANNEL, index, 0, 0)[:2]
            )
            for index in range(20_000)
        ]
    )
    spread = 1.0 / math.sqrt(len(drawn))
    assert np.abs(drawn.mean(axis=0)).max() < 4.0 * spread
    assert np.abs(drawn.var(axis=0) - 1.0).max() < 4.0 * math.sqrt(2.0) * spread
    assert np.abs((drawn**4).mean(axis=0) - 3.0).max() < 4.0 * math.sqrt(96.0) * spread
    assert abs((drawn[:, 0] * drawn[:, 1]).mean()) < 4.0 * spread


def test_the_extreme_words_give_finite_normal_numbers() -> None:
    for pair in (keyed_random.normal_pair(0, 0), keyed_random.normal_pair(2**32 - 1, 2**32 - 1)):
        assert all(math.isfinite(number) for number in pair)


@pytest.mark.parametrize('mean', [0.3, 1.0, 10.0, 30.0, 1200.0])
def test_poisson_numbers_have_mean_and_variance_of_the_mean(mean: float) -> None:
    drawn = np.array(
        [
            keyed_random.draw_poisson(mean, 3, keyed_random.SENSOR_COUNT, index)
            for index in range(10_000)
        ]
    )
    assert abs(drawn.mean() - mean) < 4.0 * math.sqrt(mean / len(drawn))
    variance_spread = math.sqrt((mean + 2.0 * mean * mean) / len(drawn))
    assert abs(drawn.var() - mean) < 4.0 * variance_spread


def test_a_poisson_number_of_mean_zero_is_zero() -> None:
    assert keyed_random.draw_poisson(0.0, 3, keyed_random.SENSOR_COUNT, 0) == 0


def test_a_shuffle_brings_each_value_to_the_front_equally_often() -> None:
    n_shuffles, n_values, n_first = 6_000, 6, 2
    chosen = np.zeros(n_values)
    for seed in range(n_shuffles):
        values = np.arange(n_values)
        keyed_random.shuffle_first(values, n_values, n_first, seed, keyed_random.DATA_CELL)
        assert sorted(values.tolist()) == list(range(n_values))
        chosen[values[:n_first]] += 1.0
    expected = n_shuffles * n_first / n_values
    assert ((chosen - expected) ** 2 / expected).sum() < 20.5  # 99.9 % point for 5


def bits() -> str:
    lines = []
    for index in range(300):
        drawn = keyed_random.draw_words(
            2**62 + index, keyed_random.CHANNEL, index, 2**31 + index, 3
        )
        real, imaginary = keyed_random.normal_pair(drawn[0], drawn[1])
        uniform = keyed_random.draw_uniform(index, 0, 1, 2, 3)
        count = keyed_random.draw_poisson(
            0.07 * index * index, index, keyed_random.SENSOR_COUNT, 4
        )
        lines.append(f'{drawn} {real.hex()} {imaginary.hex()} {uniform.hex()} {count}')
    return '\n'.join(lines)


def test_interpreted_draws_equal_compiled_ones_to_the_bit() -> None:
    assert interpreted(bits) == bits()

"""Keyed random draws: a counter-based generator, so that no draw depends on how many came before.

Philox4x32-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011). The key is a
seed, the counter says what is drawn: a stream and up to three indices. The order of events, the
size of a batch and the process change nothing.
"""

import math

from uav_collect.kernels.arrays import Row
from uav_collect.kernels.compile import kernel

# Streams: one per thing that is drawn. Never renumber: seeds would mean other missions.
DENSE_CELL = 0
SENSOR_COUNT = 1
SENSOR_POSITION = 2
DATA_CELL_COUNT = 3
DATA_CELL = 4
DATA_AMOUNT = 5
CHANNEL = 6
EXPLORATION = 7
UAV_RADIO = 8
FAULT = 9
BRANCH = 10
FUTURE = 11
TEACHER = 12

_MASK_32 = 0xFFFFFFFF
_MULTIPLIER_0 = 0xD2511F53
_MULTIPLIER_1 = 0xCD9E8D57
_WEYL_0 = 0x9E3779B9
_WEYL_1 = 0xBB67AE85
_ROUNDS = 10
_CHUNK_MEAN = 500.0  # exp(-500) is still a normal double


@kernel
def _high_word(factor: int, multiplier: int) -> int:
    # The 64-bit product of two 32-bit words, without leaving signed 64-bit integers.
    low = factor * (multiplier & 0xFFFF)
    high = factor * (multiplier >> 16)
    return (high + (low >> 16)) >> 16


@kernel
def _low_word(factor: int, multiplier: int) -> int:
    low = factor * (multiplier & 0xFFFF)
    high = factor * (multiplier >> 16)
    return (low + ((high & 0xFFFF) << 16)) & _MASK_32


@kernel
def philox(
    key_0: int, key_1: int, counter_0: int, counter_1: int, counter_2: int, counter_3: int
) -> tuple[int, int, int, int]:
    """Four random 32-bit words of a 64-bit key and a 128-bit counter, all as 32-bit words."""
    for _ in range(_ROUNDS):
        high_0 = _high_word(counter_0, _MULTIPLIER_0)
        low_0 = _low_word(counter_0, _MULTIPLIER_0)
        high_1 = _high_word(counter_2, _MULTIPLIER_1)
        low_1 = _low_word(counter_2, _MULTIPLIER_1)
        counter_0 = high_1 ^ counter_1 ^ key_0
        counter_1 = low_1
        counter_2 = high_0 ^ counter_3 ^ key_1
        counter_3 = low_0
        key_0 = (key_0 + _WEYL_0) & _MASK_32
        key_1 = (key_1 + _WEYL_1) & _MASK_32
    return counter_0, counter_1, counter_2, counter_3


@kernel
def draw_words(
    seed: int, stream: int, index_0: int, index_1: int, index_2: int
) -> tuple[int, int, int, int]:
    """Four random 32-bit words for what (stream, indices) names; seed in 0..2^63-1."""
    return philox(
        seed & _MASK_32,
        seed >> 32,
        stream & _MASK_32,
        index_0 & _MASK_32,
        index_1 & _MASK_32,
        index_2 & _MASK_32,
    )


@kernel
def draw_uniform(seed: int, stream: int, index_0: int, index_1: int, index_2: int) -> float:
    """A uniform number in [0, 1) with 53 random bits."""
    high, low, _, _ = draw_words(seed, stream, index_0, index_1, index_2)
    return uniform_of(high, low)


@kernel
def uniform_of(high: int, low: int) -> float:
    """The uniform number in [0, 1) of two random 32-bit words."""
    return ((high >> 5) * 67108864.0 + (low >> 6)) / 9007199254740992.0


@kernel
def normal_pair(word_0: int, word_1: int) -> tuple[float, float]:
    """Two independent standard normal numbers out of two 32-bit words (Box-Muller)."""
    radius = math.sqrt(-2.0 * math.log((word_0 + 1.0) / 4294967296.0))
    angle = 2.0 * math.pi * (word_1 / 4294967296.0)
    return radius * math.cos(angle), radius * math.sin(angle)


@kernel
def draw_poisson(mean: float, seed: int, stream: int, index: int) -> int:
    """A Poisson number, by inversion of one uniform for each 500 of the mean."""
    total = 0
    chunk = 0
    while mean > 0.0:
        part = min(mean, _CHUNK_MEAN)
        mean -= part
        uniform = draw_uniform(seed, stream, index, chunk, 0)
        chunk += 1
        probability = math.exp(-part)
        cumulative = probability
        count = 0
        # Beyond 20 standard deviations the terms vanish below the last bit of the sum.
        while cumulative <= uniform and count < part + 20.0 * math.sqrt(part) + 50.0:
            count += 1
            probability *= part / count
            cumulative += probability
        total += count
    return total


@kernel
def shuffle_first(values: Row[int], n_values: int, n_first: int, seed: int, stream: int) -> None:
    """Bring a random choice of the values, in random order, to the first places (Fisher-Yates)."""
    for place in range(n_first):
        uniform = draw_uniform(seed, stream, place, 0, 0)
        other = place + int(uniform * (n_values - place))
        value = values[other]
        values[other] = values[place]
        values[place] = value

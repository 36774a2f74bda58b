"""Random numbers of compiled code: by counter, in a row, and as numpy draws them.

By counter, every draw is a hash of (key of the episode, step, channel, index): it depends neither
on threads, nor on other chairs, nor on what was drawn before. A `Stream` gives one number after
another, and a `NumpyStream` the very numbers that its numpy generator would give. numba's own
random state is global and hidden; here the state is an argument like any other.
"""

import math
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined, kernel

# One channel for each use, so that no two sensors ever share a draw.
(
    LASER, LASER_BIAS, ULTRASONIC, WHEELS, POSE, PARAMETERS, WORLDS, LOCALIZATION, SLAM, ACTORS,
    STARTS, FAULTS, SHIELDS, RANDOMIZATION, DRIVERS, TRAINING,
) = range(16)  # fmt: skip

Split = Literal["train", "test"]  # streams of worlds: to train and choose on, to be judged on
SEEDS = 2**63  # number of seeds, from 0 on

# Sum of four uniform 16-bit numbers: mean and standard deviation (Irwin-Hall, n = 4, cut at 3.46).
_MEAN = 2.0 * 65535.0
_DEVIATION = float(np.sqrt(4.0 * (65536.0**2 - 1.0) / 12.0))

# Steele, Lea and Flood 2014, Fast splittable pseudorandom number generators: splitmix64.
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST = np.uint64(0xBF58476D1CE4E5B9)
_SECOND = np.uint64(0x94D049BB133111EB)

Stream = NDArray[np.uint64]  # (1,) the counter of splitmix64

_PREDRAWN_BITS = 10
_PREDRAWN = 1 << _PREDRAWN_BITS  # a floor plan takes 260, 480 at most


@kernel
def mix(value: np.uint64) -> np.uint64:
    """64 well-mixed bits of 64: the finaliser of splitmix64."""
    x = np.uint64(value)
    x = (x ^ (x >> np.uint64(30))) * _FIRST
    x = (x ^ (x >> np.uint64(27))) * _SECOND
    return x ^ (x >> np.uint64(31))


@kernel
def to_unit(word: np.uint64) -> float:
    """A number in [0, 1) of 64 random bits."""
    return float(word >> np.uint64(11)) * 2.0**-53


@kernel
def bits(key: np.uint64, step: int, channel: int, index: int) -> np.uint64:
    """64 random bits of one draw."""
    x = mix(np.uint64(key) + _GOLDEN * np.uint64(step + 1))
    draw = np.uint64(channel) * np.uint64(65536) + np.uint64(index) + np.uint64(1)
    return mix(x + _GOLDEN * draw)


@kernel
def uniform(key: np.uint64, step: int, channel: int, index: int) -> float:
    """A number in [0, 1)."""
    return to_unit(bits(key, step, channel, index))


@kernel
def normal(key: np.uint64, step: int, channel: int, index: int) -> float:
    """A nearly normal number of mean 0 and deviation 1, never beyond 3.46."""
    x, mask = bits(key, step, channel, index), np.uint64(0xFFFF)
    low = (x & mask) + ((x >> np.uint64(16)) & mask)
    high = ((x >> np.uint64(32)) & mask) + (x >> np.uint64(48))
    return (float(low + high) - _MEAN) / _DEVIATION


def episode_key(seed: int, episode: int, split: Split) -> int:
    """Return the key of one episode of one seed."""
    return int(bits(np.uint64(seed), episode, TRAINING if split == "train" else 0, 0))


def world_seed(split: Split, *entropy: int) -> np.random.SeedSequence:
    """Return the state that one world is drawn from.

    Training worlds have a spawn key, which numpy appends after at least four words. Test worlds
    have none, and at most four words (seeds are below 2**63), so no state belongs to both splits.
    """
    return np.random.SeedSequence(entropy, spawn_key=(TRAINING,) if split == "train" else ())


def stream(rng: np.random.Generator) -> Stream:
    """A stream for kernels (1,), seeded by one draw from a generator."""
    return rng.integers(0, 2**64, size=1, dtype=np.uint64)


@inlined
def next_uniform(state: Stream) -> float:
    """The next number of a stream, uniform in [0, 1)."""
    state[0] = state[0] + _GOLDEN
    return to_unit(mix(state[0]))


@borrowing_kernel
def next_in_disc(state: Stream) -> tuple[float, float]:
    """The next point of a stream, uniform in the unit disc."""
    radius = math.sqrt(next_uniform(state))
    angle = 2.0 * math.pi * next_uniform(state)
    return radius * math.cos(angle), radius * math.sin(angle)


class NumpyStream(NamedTuple):
    """Random bits that a numpy generator drew in advance, and how many of them are used."""

    bits: NDArray[np.uint64]
    used: NDArray[np.int64]  # (1,)
    half: NDArray[np.uint64]  # (2,): whether half a word is left over, and which


def numpy_stream(rng: np.random.Generator) -> NumpyStream:
    """Bits of a generator; where they do not last, the same ones times 3, times 5, and so on."""
    words = rng.integers(0, 2**64, _PREDRAWN, dtype=np.uint64)
    return NumpyStream(words, np.zeros(1, np.int64), np.zeros(2, np.uint64))


@borrowing_kernel
def _next_word(source: NumpyStream) -> Any:
    k = source.used[0]
    source.used[0] = k + 1
    return source.bits[k & (_PREDRAWN - 1)] * np.uint64(2 * (k >> _PREDRAWN_BITS) + 1)


@borrowing_kernel
def numpy_uniform(source: NumpyStream, low: float, high: float) -> float:
    """The next number, as Generator.uniform draws it."""
    return low + (high - low) * to_unit(_next_word(source))


@borrowing_kernel
def numpy_integer(source: NumpyStream, count: int) -> int:
    """An integer from 0 to count - 1, as Generator.integers draws it: Lemire's method."""
    if count <= 1:
        return 0
    many, mask = np.uint64(count), np.uint64(0xFFFFFFFF)
    while True:
        if source.half[0]:
            word, source.half[0] = source.half[1], np.uint64(0)
        else:
            both = _next_word(source)
            word = both & mask
            source.half[0], source.half[1] = np.uint64(1), both >> np.uint64(32)
        product = word * many
        if (product & mask) >= (mask + np.uint64(1) - many) % many:
            return int(np.int64(product >> np.uint64(32)))

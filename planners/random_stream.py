"""Random numbers inside compiled loops: a splitmix64 stream seeded by a numpy Generator.

numba's own random state is global and hidden; here the state is an argument like any other, so
the same generator gives the same run whatever ran before it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined

Stream = NDArray[np.uint64]  # (1,) the counter of splitmix64

# Steele, Lea and Flood 2014, Fast splittable pseudorandom number generators.
_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31, _S11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
_TO_UNIT = 2.0**-53


def stream(rng: np.random.Generator) -> Stream:
    """A stream for kernels (1,), seeded by one draw from a generator."""
    return rng.integers(0, 2**64, size=1, dtype=np.uint64)


@inlined
def uniform(state: Stream) -> float:
    """The next number of a stream, uniform in [0, 1)."""
    state[0] = state[0] + _GAMMA
    z = state[0]
    z = (z ^ (z >> _S30)) * _MIX_1
    z = (z ^ (z >> _S27)) * _MIX_2
    z = z ^ (z >> _S31)
    return float(z >> _S11) * _TO_UNIT


@borrowing_kernel
def in_disc(state: Stream) -> tuple[float, float]:
    """The next point of a stream, uniform in the unit disc."""
    radius = math.sqrt(uniform(state))
    angle = 2.0 * math.pi * uniform(state)
    return radius * math.cos(angle), radius * math.sin(angle)

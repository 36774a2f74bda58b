"""Draws for kernels: the same numbers as those of the generator that they come from."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel

_BITS = 10
_ENOUGH = 1 << _BITS  # a floor plan takes 260, 480 at most


class RandomStream(NamedTuple):
    """Random bits drawn in advance, and how many are spent."""

    bits: NDArray[np.uint64]
    spent: NDArray[np.int64]  # (1,)
    half: NDArray[np.uint64]  # (2,): whether half a word is left over, and which


def random_stream(rng: np.random.Generator) -> RandomStream:
    """Bits of a generator; where they do not last, the same ones times 3, times 5, and so on."""
    bits = rng.integers(0, 2**64, _ENOUGH, dtype=np.uint64)
    return RandomStream(bits, np.zeros(1, np.int64), np.zeros(2, np.uint64))


@borrowing_kernel
def _word(source: RandomStream) -> Any:
    k = source.spent[0]
    source.spent[0] = k + 1
    return source.bits[k & (_ENOUGH - 1)] * np.uint64(2 * (k >> _BITS) + 1)


@borrowing_kernel
def uniform(source: RandomStream, low: float, high: float) -> float:
    """As Generator.uniform draws it."""
    share = (_word(source) >> np.uint64(11)) * (1.0 / 9007199254740992.0)
    return float(low + (high - low) * share)


@borrowing_kernel
def uniform_int(source: RandomStream, count: int) -> int:
    """A whole number from 0 to count - 1, as Generator.integers draws it: Lemire's method."""
    if count <= 1:
        return 0
    many, mask = np.uint64(count), np.uint64(0xFFFFFFFF)
    while True:
        if source.half[0]:
            word, source.half[0] = source.half[1], np.uint64(0)
        else:
            both = _word(source)
            word = both & mask
            source.half[0], source.half[1] = np.uint64(1), both >> np.uint64(32)
        product = word * many
        if (product & mask) >= (mask + np.uint64(1) - many) % many:
            return int(np.int64(product >> np.uint64(32)))

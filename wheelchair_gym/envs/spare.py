"""Memory for results that are handed out and never overwritten."""

from __future__ import annotations

import math
import weakref
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]


class Spare:
    """Arrays to write results to, none of which anyone still holds.

    The memory of an array is used again once the array and all parts of it are gone, so that large
    results need no fresh memory at each step and yet are never overwritten. A copy has memory of
    its own.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._shape = shape
        self._free: list[bytearray] = []
        self._taken: dict[int, weakref.ref[Floats]] = {}

    def take(self) -> Floats:
        """An array that only the caller knows; what it holds is arbitrary."""
        memory = self._free.pop() if self._free else bytearray(4 * math.prod(self._shape))
        # Parts of an array refer to it, since its memory is no array: it goes when they have gone.
        array: Floats = np.ndarray(self._shape, np.float32, memory)
        free, taken = self._free, self._taken

        def give_back(gone: weakref.ref[Floats]) -> None:
            del taken[id(gone)]
            free.append(memory)

        held = weakref.ref(array, give_back)
        taken[id(held)] = held
        return array

    def __reduce__(self) -> tuple[type[Spare], tuple[Any, ...]]:
        return type(self), (self._shape,)

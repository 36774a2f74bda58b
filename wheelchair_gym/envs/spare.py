"""Memory for results that are handed out and never overwritten."""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]


class Spare:
    """Arrays to write results to, none of which anyone still holds.

    An array is used again once nothing outside refers to it or to a part of it, so that large
    results need no fresh memory at each step and yet are never overwritten.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._shape = shape
        self._arrays: list[Floats] = []

    def take(self) -> Floats:
        """An array that only this store knows."""
        for array in self._arrays:
            if sys.getrefcount(array) == 3:  # by the list, by the loop and by the question
                return array
        self._arrays.append(np.zeros(self._shape, np.float32))
        return self._arrays[-1]

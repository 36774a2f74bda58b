"""A clock that stands still while kernels are compiled or loaded.

By it, a planner's first call in a process has as much time as all others.
"""

import contextlib
import threading
from collections.abc import Iterator
from time import perf_counter


class _Clock:
    """Seconds in which no thread compiles, loads kernels, or waits to do so."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._depth, self._begun, self._total = 0, 0.0, 0.0

    @contextlib.contextmanager
    def standing_still(self) -> Iterator[None]:
        with self._lock:
            if self._depth == 0:
                self._begun = perf_counter()
            self._depth += 1
        try:
            yield
        finally:
            with self._lock:
                self._depth -= 1
                if self._depth == 0:
                    self._total += perf_counter() - self._begun

    def read(self) -> float:
        """Seconds of `perf_counter`, less those in which any thread compiled or loaded kernels."""
        with self._lock:
            return (self._begun if self._depth else perf_counter()) - self._total


_CLOCK = _Clock()
standing_still = _CLOCK.standing_still  # stops the clock for a block of code
clock = _CLOCK.read

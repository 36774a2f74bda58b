"""A clock that stands still while kernels are compiled or loaded.

By it, a planner's first call in a process has as much time as all others.
"""

from __future__ import annotations

import threading
from time import perf_counter
from typing import Any

from numba.core import event


class _Compiling(event.Listener):
    """Seconds in which some thread compiles, loads kernels, or waits to do so."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._depth, self._begun, self._total = 0, 0.0, 0.0

    def on_start(self, event: Any) -> None:
        with self._lock:
            if self._depth == 0:
                self._begun = perf_counter()
            self._depth += 1

    def on_end(self, event: Any) -> None:
        with self._lock:
            self._depth -= 1
            if self._depth == 0:
                self._total += perf_counter() - self._begun

    def clock(self) -> float:
        with self._lock:
            return (self._begun if self._depth else perf_counter()) - self._total


_COMPILING = _Compiling()
event.register("numba:compiler_lock", _COMPILING)  # type: ignore[no-untyped-call]


def clock() -> float:
    """Seconds of `time.perf_counter`, less those in which any thread compiled or loaded kernels."""
    return _COMPILING.clock()

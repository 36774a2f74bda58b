"""Time for what drives a real chair: absolute deadlines, and a guard beside whoever drives.

Time is an argument: the wall's, or that of a simulated world, in which nothing waits.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NAP = 0.01  # s between two looks at what arrives beside
QUIET = 1.0  # s that may pass before it is told what is waited for


class Clock(Protocol):
    """Time, and what happens while it passes."""

    def now(self) -> float:
        """Seconds that only grow."""
        ...

    def wait(self, until: float, gone: threading.Event | None = None) -> None:
        """Let time pass until then, or until something is gone."""
        ...

    def guard(self, look: Callable[[], object], interval: float, name: str) -> Callable[[], None]:
        """Call `look` every so many seconds, whatever the caller does; the result ends that."""
        ...


class WallClock:
    """Real time; guards are threads.

    A planner at work does not hold them up: kernels let go of Python's lock.
    """

    def now(self) -> float:
        """See `Clock.now`."""
        return time.monotonic()

    def wait(self, until: float, gone: threading.Event | None = None) -> None:
        """See `Clock.wait`."""
        left = max(0.0, until - time.monotonic())
        if gone is None:
            time.sleep(left)
        else:
            gone.wait(left)

    def guard(self, look: Callable[[], object], interval: float, name: str) -> Callable[[], None]:
        """See `Clock.guard`."""
        done = threading.Event()

        def watch() -> None:
            while not done.wait(interval):
                look()

        thread = threading.Thread(target=watch, name=f"{name} guard", daemon=True)
        thread.start()

        def end() -> None:
            done.set()
            if threading.current_thread() is not thread:
                thread.join()

        return end


class Pace:
    """The control periods of a chair that is driven from outside.

    Args:
        clock: whose time it is.
        period: of control [s].
        hold: how long a command counts beyond its period [s].
    """

    def __init__(self, clock: Clock, period: float, hold: float) -> None:
        self.clock, self.period, self.hold = clock, period, hold
        self._until, self._due, self._begun = -math.inf, 0.0, math.nan

    def begin(self) -> None:
        """An episode begins now."""
        self._due = self._begun = self.clock.now()

    def end(self) -> None:
        """There is no episode."""
        self._begun, self._until = math.nan, -math.inf

    def asked(self, twist: Array) -> tuple[float, float]:
        """A target twist (2,) [m/s, rad/s], which counts from now.

        Raises:
            ValueError: it is not two finite numbers, or no episode has begun.
        """
        v, w = twist.tolist()
        if not math.isfinite(v + w):
            raise ValueError(f"twist is ({v}, {w}); expected two finite numbers")
        if math.isnan(self._begun):
            raise ValueError("the chair was never reset, or it was closed")
        self._until = self.clock.now() + self.period + self.hold
        return v, w

    def rest(self, gone: threading.Event | None = None) -> None:
        """Wait for the end of the period, or until something is gone.

        Ends lie at multiples of the period; those that a policy slept through are left out.
        """
        missed = math.floor((self.clock.now() - self._due) / self.period)
        self._due += self.period * (1 + max(0, missed))
        self.clock.wait(self._due, gone)

    @property
    def late(self) -> bool:
        """Whether the last command counts no longer."""
        return self.clock.now() > self._until

    @property
    def elapsed(self) -> float:
        """Seconds since the episode began."""
        return self.clock.now() - self._begun

    def until(
        self,
        missing: Callable[[], str],
        patience: float,
        gone: threading.Event | None = None,
        nap: float = NAP,
        tell: Callable[[str], object] | None = None,
    ) -> str:
        """Wait until nothing is missing; what still is when patience [s] ends.

        Args:
            missing: says what is; empty: nothing.
            patience: for it [s].
            gone: ends the wait, too.
            nap: between two looks [s].
            tell: is called with what is missing after a second, and whenever that is another,
                whatever it says in brackets.
        """
        begun, told = self.clock.now(), ""
        while (why := missing()) and self.clock.now() < begun + patience:
            what = why.partition(" (")[0]
            if tell is not None and what != told and self.clock.now() - begun >= QUIET:
                told = what
                tell(why)
            self.clock.wait(self.clock.now() + nap, gone)
        return why

"""ROS's simulated time, by /clock, for chairs that are simulations."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

from wheelchair_gym.hardware.control_loop import WallClock

_POLL = 0.05  # s of wall time between two checks of what else may end a wait


class SimulatedClock:
    """The newest time of /clock as a `control_loop.Clock`; it never runs backwards.

    Where a simulation restarts at a smaller time, this clock goes on from its last time.

    Args:
        topic: its name, for error messages.
        stall: s of wall time for which it may stand still.
    """

    def __init__(self, topic: str, stall: float) -> None:
        self.topic, self.stall = topic, stall
        self._now, self._last, self._offset = 0.0, -math.inf, 0.0
        self._moved = time.monotonic()
        self._changed = threading.Condition()

    def update(self, time_: float) -> None:
        """Take a time [s] of /clock."""
        with self._changed:
            if time_ == self._last:
                return
            if time_ < self._last or self._last == -math.inf:
                self._offset = self._now - time_
            self._last, self._now = time_, self._offset + time_
            self._moved = time.monotonic()
            self._changed.notify_all()

    def host_time(self, stamp: float) -> float:
        """When a message was made by this clock, at the latest now.

        Now for an unknown stamp, NaN, and while no time is known: a latched map comes only once.

        Raises:
            ValueError: the stamp is too far ahead to be by this clock.
        """
        now = self.now()
        known = self._last > -math.inf and not math.isnan(stamp)
        made = self._offset + stamp if known else now
        if made - now > 10.0:
            raise ValueError(
                f"is stamped {made - now:.3g} s ahead of {self.topic}; expected simulated time"
            )
        return min(made, now)

    @property
    def ros_time(self) -> float:
        """The newest time of /clock [s]; 0 before the first."""
        return max(0.0, self._last)

    @property
    def stopped(self) -> str:
        """Why time stands still, as a line of text; empty: it runs."""
        stalled = self.stalled_for
        if stalled <= self.stall:
            return ""
        if self._last == -math.inf:
            return (
                f"{self.topic} has reported no time for {stalled:.1f} s: start the simulation, or "
                "set use_sim_time to false in the chair's settings"
            )
        return f"{self.topic} has stood still for {stalled:.1f} s: the simulation is paused or over"

    @property
    def stalled_for(self) -> float:
        """Seconds of wall time since it last advanced."""
        return time.monotonic() - self._moved

    def now(self) -> float:
        """See `Clock.now`."""
        return self._now

    def wait(self, deadline: float, cancelled: threading.Event | None = None) -> None:
        """See `Clock.wait`; ends, too, when the clock has stood still for too long."""
        with self._changed:
            while self._now < deadline and self.stalled_for <= self.stall:
                if cancelled is not None and cancelled.is_set():
                    return
                self._changed.wait(_POLL)
        if self.stopped:
            time.sleep(_POLL)  # a caller that waits again at once does not keep a core busy

    def call_every(
        self, callback: Callable[[], object], interval: float, name: str
    ) -> Callable[[], None]:
        """See `Clock.call_every`; by wall time, which goes on while this clock stands."""
        return WallClock().call_every(callback, interval, name)

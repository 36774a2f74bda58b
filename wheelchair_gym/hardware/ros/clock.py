"""ROS's simulated time: what /clock says, for chairs that are simulations themselves."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

from wheelchair_gym.hardware.control_loop import WallClock

_LOOK = 0.05  # s of wall time between two looks at what else may end a wait


class SimulatedClock:
    """The newest of /clock as a `pacing.Clock`; it never runs backwards.

    A simulation that begins anew tells smaller times: they count on from the last one.

    Args:
        topic: that tells it, for messages.
        stall: s of wall time that it may stand still.
    """

    def __init__(self, topic: str, stall: float) -> None:
        self.topic, self.stall = topic, stall
        self._now, self._told, self._begun = 0.0, -math.inf, 0.0
        self._moved = time.monotonic()
        self._changed = threading.Condition()

    def update(self, told: float) -> None:
        """/clock says a time [s]."""
        with self._changed:
            if told == self._told:
                return
            if told < self._told or self._told == -math.inf:
                self._begun = self._now - told
            self._told, self._now = told, self._begun + told
            self._moved = time.monotonic()
            self._changed.notify_all()

    def host_time(self, stamp: float) -> float:
        """When a message was made by this clock, at the latest now; NaN, unknown, is now.

        Raises:
            ValueError: it lies so far ahead that it cannot be by this clock.
        """
        now = self.now()
        made = now if math.isnan(stamp) else self._begun + stamp
        if made - now > 10.0:
            raise ValueError(
                f"is stamped {made - now:.3g} s ahead of {self.topic}; expected simulated time"
            )
        return min(made, now)

    @property
    def stopped(self) -> str:
        """That it stands still, as a line of text; empty: it runs."""
        stood = self.stalled_for
        if stood <= self.stall:
            return ""
        if self._told == -math.inf:
            return (
                f"{self.topic} has told no time for {stood:.1f} s: start the simulation, or set "
                "use_sim_time to false in the chair's settings"
            )
        return (
            f"{self.topic} has stood still for {stood:.1f} s: the simulation is paused or has ended"
        )

    @property
    def stalled_for(self) -> float:
        """Seconds of wall time since it moved."""
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
                self._changed.wait(_LOOK)
        if self.stopped:
            time.sleep(_LOOK)  # whoever waits again at once does not keep a core busy

    def call_every(
        self, callback: Callable[[], object], interval: float, name: str
    ) -> Callable[[], None]:
        """See `Clock.guard`; by the wall's time, so that it looks while this one stands."""
        return WallClock().call_every(callback, interval, name)

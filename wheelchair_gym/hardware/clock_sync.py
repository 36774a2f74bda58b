"""How old a message is: clocks of two computers, and the newest of each topic."""

from __future__ import annotations

import math
from typing import Any, NamedTuple


class Stamped(NamedTuple):
    """The newest of a topic."""

    value: Any
    measured_at: float  # s, `time.monotonic`


NEVER = Stamped(math.nan, -math.inf)
_MAX_JUMP = 60.0  # s that a clock may jump ahead of this computer's: an hour or a year is an error


class ClockSync:
    """When messages of one topic were made, by this computer's clock."""

    def __init__(self, drift: float) -> None:
        self._drift = drift
        self._last, self._ahead, self._came = -math.inf, math.inf, 0.0

    def host_time(self, stamp: float, came: float) -> float:
        """When a message was made that came then [s]; `stamp` is by its maker's clock, or NaN.

        Raises:
            ValueError: it is no newer than the one before, or it is a jump ahead.
        """
        if math.isnan(stamp):
            return came
        if stamp <= self._last:
            raise ValueError(f"is {self._last - stamp:.3g} s older than the one before")
        if (jump := self._ahead - (came - stamp)) > _MAX_JUMP and math.isfinite(self._ahead):
            raise ValueError(
                f"is stamped {jump:.3g} s later than its clock told before; if that clock was set, "
                "reset the chair"
            )
        # How far the clocks are apart, at most: what the quickest message showed, and their drift.
        ahead = min(came - stamp, self._ahead + self._drift * (came - self._came))
        self._last, self._ahead, self._came = stamp, ahead, came
        return stamp + ahead


class Latest:
    """The newest of one topic, whose maker may start its clock anew.

    Args:
        drift: s per s that the two clocks may part.

    Attributes:
        heard: the newest; its time is -inf before the first.
    """

    def __init__(self, drift: float) -> None:
        self._drift = drift
        self.clear()

    def clear(self) -> None:
        """Nothing was heard."""
        self.message = NEVER
        self._clock = ClockSync(self._drift)

    def update(self, value: Any, stamp: float, came: float) -> None:
        """Something was heard, made at a time of its maker's clock."""
        try:
            taken = self._clock.host_time(stamp, came)
        except ValueError:  # it was switched off and on
            self._clock = ClockSync(self._drift)
            taken = self._clock.host_time(stamp, came)
        self.message = Stamped(value, taken)

    def age(self, now: float) -> float:
        """Seconds since the newest was made; +inf before the first."""
        return now - self.message.measured_at

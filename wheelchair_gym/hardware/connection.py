"""Connections that are opened again when they are lost, and the age of received messages."""

import contextlib
import math
from collections.abc import Callable
from typing import Any, Generic, NamedTuple, TypeVar

from wheelchair_gym.hardware.boards.ports import Port

RETRY = 0.5  # s between attempts to open what is not there
_MAX_JUMP = 60.0  # s that a clock may jump ahead of this computer's: an hour or a year is an error


Connection = TypeVar("Connection", bound=Port)


class Reconnecting(Generic[Connection]):
    """A connection that is opened again while it is lost; errors are kept in `error`, not raised.

    Args:
        opener: opens a connection, or raises OSError or ValueError.

    Attributes:
        connection: the open one, or None.
        error: reason without a connection, else empty; callers may set it ("does not stream yet").
    """

    def __init__(self, opener: Callable[[], Connection]) -> None:
        self.connection: Connection | None = None
        self.error = "not opened yet"
        self._opener, self._tried, self._closed = opener, -math.inf, False

    def get(self, now: float) -> Connection | None:
        """The connection; opened, if it is time [s] to try."""
        if self.connection is not None or self._closed or now - self._tried < RETRY:
            return self.connection
        self._tried = now
        try:
            self.connection = self._opener()
            self.error = ""
            self._begin(self.connection)
        except Exception as error:  # ValueError for a malformed URL; termios.error is no OSError
            self.lose(error)
        return self.connection

    def _begin(self, connection: Connection) -> None:
        """Begin with a new connection; if this raises an OSError, that one is lost, too."""

    def lose(self, why: object) -> None:
        """Close the connection, which has failed."""
        lost, self.connection = self.connection, None
        self.error = str(why)
        if lost is not None:
            with contextlib.suppress(OSError):  # it may be gone already
                lost.close()

    def close(self) -> None:
        """Close the connection for good."""
        self._closed = True
        self.lose("closed")


class Stamped(NamedTuple):
    """The newest message of a topic."""

    value: Any
    measured_at: float  # s, `time.monotonic`


NEVER = Stamped(math.nan, -math.inf)


class ClockSync:
    """Times of the messages of one topic, by this computer's clock.

    The quickest message so far bounds this clock minus the maker's clock from above. A round trip
    bounds it from below: without one, a constant latency cannot be seen.

    Args:
        drift: s per s that the two clocks may drift apart.
        error: maximum difference of two synchronized clocks [s]; +inf: they are not.

    Attributes:
        uncertainty: distance of both bounds at the last round trip [s]; 0 before the first.
        latency: maximum time [s] that the last message was under way.
    """

    def __init__(self, drift: float, error: float = math.inf) -> None:
        self._drift, self._error = drift, error
        self._last, self._offset_bound, self._received_at = -math.inf, math.inf, 0.0
        self.uncertainty = self.latency = 0.0

    def answered(self, sent: float, stamp: float) -> None:
        """Use a round trip: a request that was sent at `sent` [s] was answered at a stamp [s]."""
        if math.isfinite(self._offset_bound):
            self.uncertainty = max(0.0, self._offset_bound - (sent - stamp))

    def host_time(self, stamp: float, received_at: float) -> float:
        """Compute when a message was made [s]; `stamp` is by its maker's clock, or NaN.

        Raises:
            ValueError: it is not newer than the one before, in the future, or its clock has jumped.
        """
        if math.isnan(stamp):
            return received_at
        if stamp <= self._last:
            raise ValueError(f"is {self._last - stamp:.3g} s older than the one before, not newer")
        offset = received_at - stamp
        if (jump := self._offset_bound - offset) > _MAX_JUMP and math.isfinite(self._offset_bound):
            raise ValueError(
                f"is stamped {jump:.3g} s later than its clock showed before; if that clock was "
                "set, reset the chair"
            )
        if offset < -self._error:
            raise ValueError(
                f"is stamped {-offset:.3g} s in the future, although both clocks are said to "
                f"agree to {self._error:g} s"
            )
        # The quickest message so far gives the bound; since then the clocks may have drifted.
        bound = min(offset, self._offset_bound + self._drift * (received_at - self._received_at))
        self._last, self._offset_bound, self._received_at = stamp, bound, received_at
        if math.isfinite(self._error):
            self.uncertainty = bound + self._error
        self.latency = offset - bound + self.uncertainty
        return stamp + bound


class Latest:
    """The newest message of one topic, whose maker may restart its clock.

    Args:
        drift: s per s that the two clocks may drift apart.

    Attributes:
        message: the newest; its time is -inf before the first.
        clock: of its maker.
    """

    def __init__(self, drift: float) -> None:
        self._drift = drift
        self.message, self.clock = NEVER, ClockSync(drift)

    def clear(self) -> None:
        """Forget all messages, but not the bound of the clock."""
        self.message = NEVER

    def update(self, value: Any, stamp: float, received_at: float) -> None:
        """Take a message with the stamp [s] of its maker's clock."""
        try:
            made = self.clock.host_time(stamp, received_at)
        except ValueError:  # its maker was switched off and on
            self.clock = ClockSync(self._drift)
            made = self.clock.host_time(stamp, received_at)
        self.message = Stamped(value, made)

    def age(self, now: float) -> float:
        """Seconds since the newest message was made; +inf before the first."""
        return now - self.message.measured_at

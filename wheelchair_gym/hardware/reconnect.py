"""What is opened, and opened anew when it was lost: lines, lasers, joysticks."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

RETRY = 0.5  # s between attempts to open what is not there


class Closes(Protocol):
    """Something that can be let go."""

    def close(self) -> None:
        """Let it go."""
        ...


Thing = TypeVar("Thing", bound=Closes)


class Reconnecting(Generic[Thing]):
    """A thing that is tried again, so often, while it is not there; what fails is data.

    Args:
        opener: makes it, or raises OSError or ValueError.
        begin: is called with each new one; where it raises an OSError, that one is lost, too.

    Attributes:
        thing: what is open, or None.
        why: why there is none, as a line of text; empty while there is, unless its user says so.
    """

    def __init__(
        self, opener: Callable[[], Thing], begin: Callable[[Thing], object] = lambda thing: None
    ) -> None:
        self.connection: Thing | None = None
        self.error = "not opened yet"
        self._opener, self._begin = opener, begin
        self._tried: float | None = None
        self._closed = False

    def get(self, now: float) -> Thing | None:
        """The thing; opened, if it is time [s] to try."""
        if self.connection is not None or self._closed:
            return self.connection
        if self._tried is not None and now - self._tried < RETRY:
            return None
        self._tried = now
        try:
            self.connection = self._opener()
            self.error = ""
            self._begin(self.connection)
        except (OSError, ValueError) as error:  # ValueError: pyserial's for a malformed URL
            self.lose(error)
        return self.connection

    def lose(self, why: object) -> None:
        """It is lost."""
        thing, self.connection = self.connection, None
        self.error = str(why)
        if thing is not None:
            with contextlib.suppress(OSError):  # it may be gone already
                thing.close()

    def close(self) -> None:
        """Let it go for good."""
        self._closed = True
        self.lose("closed")

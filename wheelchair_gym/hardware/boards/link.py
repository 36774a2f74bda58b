"""A serial line to one board: frames out and in, never waiting, opened anew when it was lost."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from wheelchair_gym.hardware.boards.ports import Port, explain, load_serial, open_port
from wheelchair_gym.hardware.boards.protocol import VERSION, Frame, Message, Receiver, encode
from wheelchair_gym.hardware.reconnect import Reconnecting

_CHUNK = 4096  # bytes read at once
_STRANGE = 20  # frames refused, and none understood: no noise does that


@dataclass
class LinkStatistics:
    """What passed over a link since it was made."""

    sent: int = 0  # frames
    received: int = 0  # good frames
    bad: int = 0  # frames refused
    missed: int = 0  # gaps in the board's sequence, by frames
    unsent: int = 0  # frames given while there was no line, or no room
    opened: int = 0  # times that the line was opened


class Link:
    """A line to a board that heals: what fails is data, never an exception.

    Args:
        url: device or URL for `open_port`.
        clock: seconds that only grow; simulated time runs on another than the wall's.
        opener: makes the port.

    Attributes:
        statistics: what passed.

    Raises:
        InputError: pyserial is needed, and not installed.
    """

    def __init__(
        self,
        url: str,
        clock: Callable[[], float] = time.monotonic,
        opener: Callable[[str], Port] = open_port,
    ) -> None:
        if opener is open_port:
            load_serial()
        self.url = url
        self.statistics = LinkStatistics()
        self._clock = clock
        self._line = Reconnecting(lambda: opener(url), self._begin)
        self._receiver, self._understood = Receiver(), False
        self._heard: float | None = None
        self._sequence = 0
        self._last: int | None = None  # sequence of the board
        self._bad_before = 0  # frames refused before the line was opened this time

    @property
    def connected(self) -> bool:
        """Whether the line is open; a board may still be silent."""
        return self._line.connection is not None

    @property
    def error(self) -> str:
        """Why the line is not open, as a line of text; empty while it is."""
        return self._line.error

    @property
    def mismatch(self) -> str:
        """Why what comes is not understood, as a line of text; empty: it is, or nothing comes."""
        receiver = self._receiver
        if receiver.other is not None:
            return (
                f"{self.url}: the board speaks version {receiver.other} of the protocol, this "
                f"program version {VERSION}: flash the firmware of this release (make firmware)"
            )
        if self.statistics.opened and not self._understood and receiver.bad >= _STRANGE:
            return (
                f"{self.url}: what comes is not understood ({receiver.bad} frames refused): a "
                "different device or firmware is at this port"
            )
        return ""

    @property
    def silence(self) -> float:
        """Seconds since the last good frame; +inf before the first."""
        return float("inf") if self._heard is None else self._clock() - self._heard

    def send(self, message: Message) -> int | None:
        """Send a message; its sequence number, None if it could not be sent.

        Raises:
            ValueError: a value is not finite or does not fit its field.
        """
        self._sequence = (self._sequence + 1) & 0xFF
        # A zero byte ahead: what noise put there costs itself only.
        data = b"\0" + encode(message, self._sequence)
        port = self._line.get(self._clock())
        if port is None:
            self.statistics.unsent += 1
            return None
        try:
            written = port.write(data)
        except OSError as error:  # pyserial's errors are OSErrors
            self.statistics.unsent += 1
            if "timeout" not in type(error).__name__.lower():  # no room: only this frame is lost
                self._line.lose(explain(self.url, error))
            return None
        if written is not None and written < len(data):  # no room; the board drops what it got
            self.statistics.unsent += 1
            return None
        self.statistics.sent += 1
        return self._sequence

    def poll(self) -> list[Frame]:
        """All good frames that have come; never waits."""
        port = self._line.get(self._clock())
        frames: list[Frame] = []
        try:
            while port is not None and (waiting := port.in_waiting):
                frames += self._receiver.feed(port.read(min(waiting, _CHUNK)))
        except OSError as error:
            self._line.lose(explain(self.url, error))
        self.statistics.bad = self._bad_before + self._receiver.bad
        for frame in frames:
            if self._last is not None:
                self.statistics.missed += (frame.sequence - self._last - 1) & 0xFF
            self._last = frame.sequence
        if frames:
            self._understood = True
            self._heard = self._clock()
            self.statistics.received += len(frames)
        return frames

    def close(self) -> None:
        """Let the line go for good."""
        self._line.close()

    def _begin(self, port: Port) -> None:
        port.write(b"\0")  # ends whatever the board has half heard
        self._last, self._receiver, self._understood = None, Receiver(), False
        self._bad_before = self.statistics.bad
        self.statistics.opened += 1

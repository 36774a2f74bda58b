"""A serial line to one board: frames out and in, reopened when it was lost."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from wheelchair_gym.base.errors import load_extra
from wheelchair_gym.hardware.boards.ports import Port, explain, open_port
from wheelchair_gym.hardware.boards.protocol import VERSION, Frame, Message, Receiver, encode
from wheelchair_gym.hardware.connection import Reconnecting

_UNREADABLE = 20  # frames refused, and none understood: noise does not do that


@dataclass
class LinkStatistics:
    """Traffic over a link since it was made."""

    sent: int = 0  # frames
    received: int = 0  # good frames
    bad: int = 0  # frames refused
    missed: int = 0  # frames missing in the board's sequence
    unsent: int = 0  # frames dropped for want of a line, or of room in its buffer
    opened: int = 0  # how often the line was opened


class Link(Reconnecting[Port]):
    """A line to a board that reconnects: a failure is data, not an exception.

    Args:
        url: device or URL for `open_port`.
        clock: seconds that never decrease.
        opener: makes the port.

    Attributes:
        statistics: of its traffic.
        other_board: a different board was heard, since the line was last opened.
        sent_at: when the last message of each sequence number was sent [s].

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
            load_extra("serial")
        super().__init__(lambda: opener(url))
        self.url = url
        self.statistics = LinkStatistics()
        self._clock = clock
        self._receiver, self._understood = Receiver(), False
        self._sequence = 0
        self.other_board = False
        self.sent_at: dict[int, float] = {}
        self._last: int | None = None  # the board's last sequence number
        self._bad_before = 0  # frames refused before the line was last opened

    @property
    def mismatch(self) -> str:
        """Why the board's data are not used, as a line of text; empty: no reason."""
        receiver = self._receiver
        if self.other_board:
            ports = "hardware.drive_port and hardware.range_port"
            return f"{self.url}: the other board is at this port: exchange {ports}"
        if receiver.other is not None:
            return (
                f"{self.url}: the board speaks version {receiver.other} of the protocol, this "
                f"program version {VERSION}: flash the firmware of this release (make firmware)"
            )
        if self.statistics.opened and not self._understood and receiver.bad >= _UNREADABLE:
            return (
                f"{self.url}: its data are not understood ({receiver.bad} frames refused): a "
                "different device or firmware is at this port"
            )
        return ""

    def send(self, message: Message) -> int | None:
        """Send a message; its sequence number, None if it could not be sent.

        Raises:
            ValueError: a value is not finite or does not fit its field.
        """
        self._sequence = (self._sequence + 1) & 0xFF
        # The zero byte ends what noise may have put on the line.
        data = b"\0" + encode(message, self._sequence)
        port = self.get(self._clock())
        written = 0
        try:
            if port is not None:
                written = port.write(data)
                self.error = "" if written == len(data) else f"{self.url}: it takes no data"
        except OSError as error:  # pyserial's errors are OSErrors
            self.lose(explain(self.url, error))
        if written < len(data):  # the board drops what it got of a frame
            self.statistics.unsent += 1
            return None
        self.statistics.sent += 1
        self.sent_at[self._sequence] = self._clock()
        return self._sequence

    def poll(self) -> list[Frame]:
        """All good frames that have come; never waits."""
        port = self.get(self._clock())
        frames: list[Frame] = []
        try:
            while port is not None and (data := port.read_all()):
                frames += self._receiver.feed(data)
        except OSError as error:
            self.lose(explain(self.url, error))
        self.statistics.bad = self._bad_before + self._receiver.bad
        for frame in frames:
            if self._last is not None:
                self.statistics.missed += (frame.sequence - self._last - 1) & 0xFF
            self._last = frame.sequence
        self._understood = self._understood or bool(frames)
        self.statistics.received += len(frames)
        return frames

    def _begin(self, port: Port) -> None:
        self._last, self._receiver, self._understood = None, Receiver(), False
        self.other_board = False
        self._bad_before = self.statistics.bad
        self.statistics.opened += 1

"""URLs twin://NAME for pyserial: an in-process serial port at a wire of `wire.WIRES`.

Time does not pass here: whoever holds the twin lets it.
"""

from __future__ import annotations

from typing import Any

from wheelchair_gym.hardware.twin.wire import WIRES, Wire


class Serial:
    """What `serial.serial_for_url` makes for such a URL."""

    def __init__(self, _port: None = None, **_settings: Any) -> None:
        self.port = ""
        self.dtr = True
        self._wire: Wire | None = None
        self._waiting = b""

    def open(self) -> None:
        """Plug in.

        Raises:
            OSError: there is no such wire, or it is unplugged.
        """
        name = self.port.removeprefix("twin://")
        wire = WIRES.get(name)
        if wire is None or not wire.plugged:
            raise OSError(f"{self.port}: no such device")
        self._wire = wire
        wire.open()

    @property
    def in_waiting(self) -> int:
        """Bytes that can be read at once."""
        self._waiting += self._plugged().read()
        return len(self._waiting)

    def read(self, size: int = 1) -> bytes:
        """At most so many bytes, at once."""
        data, self._waiting = self._waiting[:size], self._waiting[size:]
        return data

    def write(self, data: bytes) -> int:
        """Send bytes."""
        self._plugged().write(bytes(data))
        return len(data)

    def close(self) -> None:
        """Unplug."""
        self._wire = None

    def _plugged(self) -> Wire:
        if self._wire is None or not self._wire.plugged:
            raise OSError(f"{self.port}: device reports readiness to read but it was unplugged")
        return self._wire

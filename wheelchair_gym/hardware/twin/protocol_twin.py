"""Serial cables between a host and the emulated boards, and pyserial's URLs twin://NAME for them.

pyserial finds the class `Serial` by the name of this module. No time passes here: the owner of the
twin runs it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wheelchair_gym.hardware.twin.board import EmulatedBoard


@dataclass
class LineNoise:
    """Errors of a cable, in both directions."""

    corrupt: float = 0.0  # share of bytes replaced by random ones
    flip: float = 0.0  # share of bytes with one bit wrong
    drop: float = 0.0  # share of bytes that are lost
    burst: float = 0.0  # share of bytes at which 20 random ones begin


_BURST = 20


@dataclass
class SerialCable:
    """One board's cable; bytes pass when the host reads and writes.

    Attributes:
        board: at the other end.
        rng: of the errors.
        noise: errors of the bytes.
        plugged: false: both ends receive nothing, and the host gets an error.
        resets_on_open: the board is reset when a host opens the port, as an Arduino is.
        log: bytes that the board has sent, without errors, while it is a list.
    """

    board: EmulatedBoard
    rng: np.random.Generator
    noise: LineNoise = field(default_factory=LineNoise)
    plugged: bool = True
    resets_on_open: bool = False
    log: list[bytes] | None = None

    def open(self) -> None:
        """React to a host that opens the port."""
        if self.resets_on_open:
            self.board.reset()

    def write(self, data: bytes) -> None:
        """Send bytes from the host to the board."""
        if self.plugged:
            self.board.write(self._with_noise(data))

    def read(self) -> bytes:
        """Receive bytes from the board at the host."""
        data = self.board.read()
        if self.log is not None:
            self.log.append(data)
        return self._with_noise(data) if self.plugged else b""

    def _with_noise(self, data: bytes) -> bytes:
        noise = self.noise
        if not data or not (noise.corrupt or noise.flip or noise.drop or noise.burst):
            return data
        rng, n = self.rng, len(data)
        out = np.frombuffer(data, np.uint8).copy()
        changed = rng.random(n) < noise.corrupt
        for start in np.flatnonzero(rng.random(n) < noise.burst):
            changed[start : start + _BURST] = True
        out[changed] = rng.integers(0, 256, int(changed.sum()))
        flipped = rng.random(n) < noise.flip
        out[flipped] ^= np.uint8(1) << rng.integers(0, 8, int(flipped.sum()), dtype=np.uint8)
        return out[rng.random(n) >= noise.drop].tobytes()


CABLES: dict[str, SerialCable] = {}  # by name, for URLs twin://NAME


class Serial:
    """The port that `serial.serial_for_url` makes for such a URL."""

    def __init__(self, _port: None = None, **_settings: Any) -> None:
        self.port = ""
        self.dtr = True
        self._cable: SerialCable | None = None
        self._waiting = b""

    def open(self) -> None:
        """Open the port.

        Raises:
            OSError: there is no such cable, or it is unplugged.
        """
        name = self.port.removeprefix("twin://")
        cable = CABLES.get(name)
        if cable is None or not cable.plugged:
            raise OSError(f"{self.port}: no such device")
        self._cable = cable
        cable.open()

    @property
    def in_waiting(self) -> int:
        """Bytes that can be read without waiting."""
        self._waiting += self._plugged().read()
        return len(self._waiting)

    def read(self, size: int = 1) -> bytes:
        """At most this many bytes, without waiting."""
        data, self._waiting = self._waiting[:size], self._waiting[size:]
        return data

    def write(self, data: bytes) -> int:
        """Send bytes."""
        self._plugged().write(bytes(data))
        return len(data)

    def close(self) -> None:
        """Close the port."""
        self._cable = None

    def _plugged(self) -> SerialCable:
        if self._cable is None or not self._cable.plugged:
            raise OSError(f"{self.port}: device reports readiness to read but it was unplugged")
        return self._cable

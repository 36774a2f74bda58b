"""Serial cables between a host and the emulated boards, and pyserial's URLs twin://NAME for them.

pyserial finds the class `Serial` by the name of this module. No time passes here: whoever owns the
twin runs it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wheelchair_gym.hardware.twin.board import EmulatedBoard


@dataclass
class LineNoise:
    """What a cable does to bytes, each way."""

    corrupt: float = 0.0  # share of bytes changed to anything
    flip: float = 0.0  # share of bytes with one bit wrong
    drop: float = 0.0  # share of bytes that vanish
    burst: float = 0.0  # share of bytes at which a run of 20 is changed to anything


_BURST = 20


@dataclass
class SerialCable:
    """One board's cable; bytes pass when the host reads and writes.

    Attributes:
        board: at the other end.
        rng: of the harm.
        harm: what is done to bytes.
        plugged: false: both ends hear nothing, and the host gets an error.
        resets: the board is reset when a host opens the port, as an Arduino is with its automatic
            reset in place.
        log: bytes that the board has said, unharmed, while it is a list.
    """

    board: EmulatedBoard
    rng: np.random.Generator
    noise: LineNoise = field(default_factory=LineNoise)
    plugged: bool = True
    resets_on_open: bool = False
    log: list[bytes] | None = None

    def open(self) -> None:
        """A host has opened the port."""
        if self.resets_on_open:
            self.board.reset()

    def write(self, data: bytes) -> None:
        """From the host to the board."""
        if self.plugged:
            self.board.write(self._harmed(data))

    def read(self) -> bytes:
        """From the board to the host."""
        data = self.board.read()
        if self.log is not None:
            self.log.append(data)
        return self._harmed(data) if self.plugged else b""

    def _harmed(self, data: bytes) -> bytes:
        harm = self.noise
        if not data or not (harm.corrupt or harm.flip or harm.drop or harm.burst):
            return data
        rng, n = self.rng, len(data)
        out = np.frombuffer(data, np.uint8).copy()
        changed = rng.random(n) < harm.corrupt
        for start in np.flatnonzero(rng.random(n) < harm.burst):
            changed[start : start + _BURST] = True
        out[changed] = rng.integers(0, 256, int(changed.sum()))
        flipped = rng.random(n) < harm.flip
        out[flipped] ^= np.uint8(1) << rng.integers(0, 8, int(flipped.sum()), dtype=np.uint8)
        return out[rng.random(n) >= harm.drop].tobytes()


CABLES: dict[str, SerialCable] = {}  # by name, for URLs twin://NAME


class Serial:
    """What `serial.serial_for_url` makes for such a URL."""

    def __init__(self, _port: None = None, **_settings: Any) -> None:
        self.port = ""
        self.dtr = True
        self._wire: SerialCable | None = None
        self._waiting = b""

    def open(self) -> None:
        """Plug in.

        Raises:
            OSError: there is no such wire, or it is unplugged.
        """
        name = self.port.removeprefix("twin://")
        wire = CABLES.get(name)
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

    def _plugged(self) -> SerialCable:
        if self._wire is None or not self._wire.plugged:
            raise OSError(f"{self.port}: device reports readiness to read but it was unplugged")
        return self._wire

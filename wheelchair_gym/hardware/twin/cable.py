"""Serial cables between a host and the emulated boards.

No time passes here: the owner of the twin runs it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

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
    """One board's cable, and the port at the host's end; bytes pass when the host reads and writes.

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

    def open(self) -> SerialCable:
        """The port that a host opens.

        Raises:
            OSError: the cable is unplugged.
        """
        self._check()
        if self.resets_on_open:
            self.board.reset()
        return self

    def write(self, data: bytes) -> int:
        """Send bytes from the host to the board."""
        self._check()
        self.board.write(self._with_noise(data))
        return len(data)

    def receive(self) -> bytes:
        """All bytes that the board has sent; none where the cable is unplugged."""
        data = self.board.read()
        if self.log is not None:
            self.log.append(data)
        return self._with_noise(data) if self.plugged else b""

    def read_all(self) -> bytes:
        """All bytes that the board has sent, for the host."""
        self._check()
        return self.receive()

    def close(self) -> None:
        """Close the port; the cable stays."""

    def _check(self) -> None:
        if not self.plugged:
            raise OSError("the board is unplugged")

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

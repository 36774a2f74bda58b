"""The cable between the host and an emulated board: passes bytes, and harms them on command."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from wheelchair_gym.hardware.twin.board import EmulatedBoard


@dataclass
class Harm:
    """What a cable does to bytes, each way."""

    corrupt: float = 0.0  # share of bytes changed to anything
    flip: float = 0.0  # share of bytes with one bit wrong
    lose: float = 0.0  # share of bytes that vanish
    burst: float = 0.0  # share of bytes at which a run of 20 is changed to anything


_BURST = 20


@dataclass
class Wire:
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
    harm: Harm = field(default_factory=Harm)
    plugged: bool = True
    resets: bool = False
    log: list[bytes] | None = None

    def open(self) -> None:
        """A host has opened the port."""
        if self.resets:
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
        harm = self.harm
        if not data or not (harm.corrupt or harm.flip or harm.lose or harm.burst):
            return data
        rng, n = self.rng, len(data)
        out = np.frombuffer(data, np.uint8).copy()
        changed = rng.random(n) < harm.corrupt
        for start in np.flatnonzero(rng.random(n) < harm.burst):
            changed[start : start + _BURST] = True
        out[changed] = rng.integers(0, 256, int(changed.sum()))
        flipped = rng.random(n) < harm.flip
        out[flipped] ^= np.uint8(1) << rng.integers(0, 8, int(flipped.sum()), dtype=np.uint8)
        return out[rng.random(n) >= harm.lose].tobytes()


WIRES: dict[str, Wire] = {}  # by name, for URLs twin://NAME

"""The twin in real time: a pseudo-terminal for each board, a TCP port for the laser.

Any program for the real chair can use it unchanged.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import termios
import time
import tty
from collections.abc import Callable

import numpy as np

from wheelchair_gym.hardware.twin.cable import SerialCable
from wheelchair_gym.hardware.twin.laser import TwinLaser
from wheelchair_gym.hardware.twin.lockstep import Twin

SLICE = 0.005  # s of simulated time between two reads of the lines
LATE = 5.0  # s behind real time, up to which the simulation catches up
_CHUNK = 65536


class Terminal:
    """A pseudo-terminal at a cable; bytes that no host reads are dropped.

    Attributes:
        path: of the device that a host opens.
    """

    def __init__(self, wire: SerialCable) -> None:
        self.wire = wire
        self._near, far = os.openpty()
        tty.setraw(far)
        os.set_blocking(self._near, False)
        self.path = os.ttyname(far)
        os.close(far)  # so that the near end shows whether a host has it open
        self._poll = select.poll()
        self._poll.register(self._near, select.POLLIN)
        self._open = False

    def pump(self) -> None:
        """Pass bytes both ways; never waits."""
        hung_up = any(event & select.POLLHUP for _, event in self._poll.poll(0))
        before, self._open = self._open, not hung_up
        with contextlib.suppress(OSError):  # nothing to read, no host, or unplugged
            if self._open and not before:
                self.wire.open()
            self.wire.write(os.read(self._near, _CHUNK))
        data = self.wire.receive()
        if data and self._open:
            try:
                os.write(self._near, data)
            except BlockingIOError:  # the host does not read: the bytes are old
                self._flush()

    def _flush(self) -> None:
        """Drop the bytes that wait at the far end, unless a host has locked it."""
        with contextlib.suppress(OSError):
            far = os.open(self.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            termios.tcflush(far, termios.TCIFLUSH)
            os.close(far)

    def close(self) -> None:
        """Remove the device."""
        os.close(self._near)


class LaserServer:
    """A TCP port at a laser of the twin, for one host at a time; a newer one replaces the older."""

    def __init__(self, laser: TwinLaser, port: int) -> None:
        self._laser = laser
        self._listener = socket.create_server(("127.0.0.1", port))
        self._listener.setblocking(False)
        self._peer: socket.socket | None = None
        self._unsent = b""
        self.port = int(self._listener.getsockname()[1])

    def pump(self) -> None:
        """Pass bytes both ways; never waits."""
        with contextlib.suppress(BlockingIOError):
            peer, _ = self._listener.accept()
            peer.setblocking(False)
            self._disconnect()
            self._peer = peer
        if not self._laser.plugged:
            self._disconnect()
        if self._peer is None:
            return
        try:
            with contextlib.suppress(BlockingIOError):
                data = self._peer.recv(_CHUNK)
                if not data:
                    self._disconnect()
                    return
                self._laser.write(data)
            if not self._unsent:  # a host that does not read misses whole scans
                self._unsent = self._laser.read_all()
            with contextlib.suppress(BlockingIOError):
                self._unsent = self._unsent[self._peer.send(self._unsent) :]
        except OSError:
            self._disconnect()

    def _disconnect(self) -> None:
        if self._peer is not None:
            self._peer.close()
        self._peer, self._unsent = None, b""
        self._laser.close()

    def close(self) -> None:
        """Close the port."""
        self._disconnect()
        self._listener.close()


class ServedTwin:
    """A twin that runs in real time, behind devices.

    Args:
        twin: after its reset.
        port: of the laser, and the next ones of further lasers; 0 chooses them.

    Attributes:
        drive: terminal of the drive board.
        range: terminal of the range board.
        lasers: servers of the lasers.
        max_delay: the longest delay behind real time so far [s].

    Raises:
        OSError: no pseudo-terminal, or the port is taken.
    """

    def __init__(self, twin: Twin, port: int = 0) -> None:
        self.twin = twin
        self.lasers = [
            LaserServer(laser, port + k if port else 0) for k, laser in enumerate(twin.lasers)
        ]
        self.drive = Terminal(SerialCable(twin.drive, np.random.default_rng(0)))
        self.range = Terminal(SerialCable(twin.range, np.random.default_rng(1)))
        self._ends: list[Terminal | LaserServer] = [self.drive, self.range, *self.lasers]
        self.max_delay = 0.0

    def run(self, until: Callable[[], bool]) -> None:
        """Run in real time, with absolute deadlines, until `until` returns true."""
        due = time.monotonic()
        while not until():
            self.twin.run(SLICE)
            for end in self._ends:
                end.pump()
            due += SLICE
            late = time.monotonic() - due
            self.max_delay = max(self.max_delay, late)
            if late < 0.0:
                time.sleep(-late)
            elif late > LATE:  # the machine is too slow: so is the simulation
                due += late

    def close(self) -> None:
        """Remove the devices and the port; the twin stays."""
        for end in self._ends:
            end.close()

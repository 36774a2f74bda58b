"""The twin's laser: a Hokuyo that answers SCIP requests with scans of the simulated world."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.config import InputError
from wheelchair_gym.hardware.laser.scip import (
    DATA_LINE,
    NO_ECHO_FROM,
    STAMP_WRAP,
    checksum,
    encode_number,
    encode_numbers,
)
from wheelchair_gym.sensors.settings import LaserSettings


class Model(NamedTuple):
    """What a model says of itself."""

    name: str
    nearest: int  # mm
    farthest: int  # mm
    steps_per_turn: int
    first: int
    last: int
    front: int
    rpm: int

    @property
    def beams(self) -> int:
        """Ranges in a scan."""
        return self.last - self.first + 1


UST_10LX = Model("UST-10LX", 20, 30000, 1440, 0, 1080, 540, 2400)
URG_04LX = Model("URG-04LX", 20, 5600, 1024, 44, 725, 384, 600)


def _line(data: bytes) -> bytes:
    return data + bytes((checksum(data),)) + b"\n"


class ScipSensor:
    """A laser that is spoken to; it streams while it was asked to and its laser is on.

    Args:
        model: which one.

    Attributes:
        on: the laser shines.
        streaming: the request that scans answer; empty while there is none.
    """

    def __init__(self, model: Model = UST_10LX) -> None:
        self.model = model
        self.on = False
        self.streaming = ""
        self._bytes = b""
        self._left: int | None = None

    def feed(self, data: bytes) -> bytes:
        """Take bytes from the host; the replies."""
        *requests, self._bytes = (self._bytes + data).split(b"\n")
        return b"".join(self._answer(request) for request in requests if request)

    def scan(self, millimetres: NDArray[np.integer], stamp: int) -> bytes:
        """What is said when a scan (beams,) [mm] is done; nothing while not streaming.

        Args:
            millimetres: from the model's first step to its last.
            stamp: ms of the sensor's clock; it wraps.
        """
        if not self.streaming or not self.on:
            return b""
        request = self.streaming
        if self._left is not None:
            self._left -= 1
            if self._left == 0:
                self.streaming = ""
        return self._ranges(request, "99", millimetres, stamp)

    def _ranges(
        self, request: str, status: str, millimetres: NDArray[np.integer], stamp: int
    ) -> bytes:
        first, last = int(request[2:6]), int(request[6:10])
        cluster = max(1, int(request[10:12]))
        part = millimetres[first - self.model.first : last - self.model.first + 1]
        # The nearest of a cluster stands for it.
        starts = np.arange(0, len(part), cluster)
        data = encode_numbers(np.minimum.reduceat(part, starts), 3)
        lines = [data[k : k + DATA_LINE] for k in range(0, len(data), DATA_LINE)]
        head = request.encode("ascii") + b"\n" + _line(status.encode("ascii"))
        body = b"".join(map(_line, [encode_number(stamp % STAMP_WRAP, 4), *lines]))
        return head + body + b"\n"

    def _answer(self, request: bytes) -> bytes:
        status, lines = self._obey(request.decode("ascii", "replace"))
        return request + b"\n" + b"".join(map(_line, [status.encode("ascii"), *lines])) + b"\n"

    def _obey(self, request: str) -> tuple[str, list[bytes]]:
        command = request[:2]
        if request == "SCIP2.0":
            return "0E", []  # it speaks it anyway
        if command == "PP":
            m = self.model
            entries = (
                ("MODL", m.name),
                ("DMIN", m.nearest),
                ("DMAX", m.farthest),
                ("ARES", m.steps_per_turn),
                ("AMIN", m.first),
                ("AMAX", m.last),
                ("AFRT", m.front),
                ("SCAN", m.rpm),
            )
            return "00", [f"{key}:{value};".encode("ascii") for key, value in entries]
        if command == "BM":
            before, self.on = self.on, True
            return ("02" if before else "00"), []
        if command in ("QT", "RS", "RB"):
            self.on, self.streaming = False, ""
            return "00", []
        if command == "MD" and len(request) >= 15 and request[2:15].isdecimal():
            first, last = int(request[2:6]), int(request[6:10])
            if not self.model.first <= first <= last <= self.model.last:
                return "05", []
            if not self.on:
                return "10", []
            self.streaming = request
            self._left = int(request[13:15]) or None
            return "00", []
        return "0E", []


TURN = 25  # ms: 40 Hz, as a UST-10LX
_INVALID = 1  # mm: an error code


def sensor_model(laser: LaserSettings) -> Model:
    """How a sensor with these beams describes itself.

    Raises:
        InputError: no whole number of steps a turn gives these beams, with one straight ahead.
    """
    steps = 2.0 * math.pi * (laser.beams - 1) / laser.fov
    if laser.beams % 2 == 0 or abs(steps - round(steps)) > 1e-6:
        raise InputError(
            f"laser: {laser.beams} beams over {math.degrees(laser.fov):g} deg are no steps of a"
            " Hokuyo; expected an odd number of beams that divides a turn, such as 1081 over 270"
        )
    last, farthest = laser.beams - 1, NO_ECHO_FROM - 1
    return Model("twin", 20, farthest, round(steps), 0, last, last // 2, 60_000 // TURN)


def to_millimetres(ranges: NDArray[np.float32]) -> NDArray[np.int64]:
    """What a sensor says of ranges (beams,) [m], REP-117."""
    said = np.where(np.isposinf(ranges), NO_ECHO_FROM, _INVALID).astype(np.int64)
    finite = np.isfinite(ranges)
    said[finite] = np.round(ranges[finite] * 1000.0)
    return said


class TwinLaser:
    """A laser in the simulated world, and the connection to it.

    It is itself the port that `Hokuyo` opens: `Hokuyo("twin", opener=lambda _: twin.laser)`.

    Args:
        look: the ranges (beams,) [m] of a turn, by its number.
        settings: of the sensor.

    Attributes:
        plugged: false: the host gets an error.
        silent: it says nothing.
    """

    def __init__(self, look: Callable[[int], NDArray[np.float32]], settings: LaserSettings) -> None:
        self._look, self._settings = look, settings
        self._sensor: ScipSensor | None = None
        self._said = b""
        self.plugged, self.silent = True, False

    def turn(self, milliseconds: int) -> None:
        """One turn of the mirror is done at a time of the sensor's clock."""
        sensor = self._sensor
        if sensor is None or not sensor.streaming or self.silent:
            return
        ranges = self._look(milliseconds // TURN)
        self._said += sensor.scan(to_millimetres(ranges), milliseconds)

    @property
    def in_waiting(self) -> int:
        """Bytes that can be read at once."""
        self._check()
        return len(self._said)

    def read(self, size: int) -> bytes:
        """At most so many bytes, at once."""
        data, self._said = self._said[:size], self._said[size:]
        return data

    def write(self, data: bytes) -> int:
        """Requests of the host."""
        self._check()
        if self._sensor is None:
            self._sensor = ScipSensor(sensor_model(self._settings))
        answer = self._sensor.feed(data)
        if not self.silent:
            self._said += answer
        return len(data)

    def close(self) -> None:
        """The host hangs up: the sensor stops."""
        self._sensor, self._said = None, b""

    def _check(self) -> None:
        if not self.plugged:
            raise OSError("the laser is unplugged")

"""The twin's laser: a Hokuyo that answers SCIP requests with scans of the simulated world."""

import math
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.settings import InputError
from wheelchair_gym.hardware.laser import scip
from wheelchair_gym.sensors.settings import LaserSettings

_BAD_STEPS, _UNKNOWN = "05", "0E"  # status


class ScipSensor:
    """A laser that answers requests, and streams scans while it is switched on and asked to.

    Attributes:
        on: the laser is switched on.
        time: time of its clock [ms].
        streaming: the scan request being served; empty when idle.
    """

    def __init__(self, specs: scip.Specs) -> None:
        self.specs = specs
        self.on = False
        self.time = 0
        self.streaming = ""
        self._bytes = b""

    def feed(self, data: bytes) -> bytes:
        """The replies to bytes from the host."""
        *requests, self._bytes = (self._bytes + data).split(b"\n")
        return b"".join(
            self._answer(request.decode("ascii", "replace")) for request in requests if request
        )

    def scan(self, millimetres: NDArray[np.integer], stamp: int) -> bytes:
        """The reply with a scan (beams,) [mm] at a stamp [ms]; empty while not streaming."""
        if not self.streaming or not self.on:
            return b""
        return scip.encode_scan(self.streaming, millimetres, self.specs.first, stamp)

    def _answer(self, request: str) -> bytes:
        lines = self.specs.encode() if request[:2] == "PP" else ()
        if request == "TM1":
            lines = (scip.encode_numbers([self.time % scip.STAMP_WRAP], 4),)
        return scip.Reply(request, self._obey(request), lines).encode()

    def _obey(self, request: str) -> str:
        """Carry out a request; returns the status of the reply."""
        command = request[:2]
        if command == "PP" or request in ("TM0", "TM1", "TM2"):
            return scip.OK
        if command == "BM":
            before, self.on = self.on, True
            return scip.DONE_ALREADY if before else scip.OK
        if command in ("QT", "RS", "RB"):
            self.on, self.streaming = False, ""
            return scip.OK
        if (steps := scip.scan_steps(request)) is not None:
            if not self.specs.first <= steps[0] <= steps[1] <= self.specs.last:
                return _BAD_STEPS
            if not self.on:
                return scip.LASER_OFF
            self.streaming = request
            return scip.OK
        return _UNKNOWN  # SCIP2.0, too: newer sensors speak nothing else


SCAN_PERIOD_MS = 25  # one turn of the mirror: 40 Hz, as a UST-10LX
_INVALID = 1  # mm: an error code


def sensor_specs(laser: LaserSettings) -> scip.Specs:
    """The specification of a sensor with these beams.

    Raises:
        InputError: the beam spacing does not divide a full turn, or no beam is straight ahead.
    """
    steps = 2.0 * math.pi * (laser.beams - 1) / laser.fov
    if laser.beams % 2 == 0 or abs(steps - round(steps)) > 1e-6:
        raise InputError(
            f"laser: {laser.beams} beams over {math.degrees(laser.fov):g} deg are no steps of a"
            " Hokuyo; expected an odd number whose spacing divides a turn, such as 1081 over 270"
        )
    last, farthest = laser.beams - 1, scip.NO_ECHO_FROM - 1
    rpm = 60_000 // SCAN_PERIOD_MS
    return scip.Specs("twin", 20, farthest, round(steps), 0, last, last // 2, rpm)


def to_millimetres(ranges: NDArray[np.float32]) -> NDArray[np.int64]:
    """The numbers that a sensor reports for ranges (beams,) [m], REP-117."""
    numbers = np.where(np.isposinf(ranges), scip.NO_ECHO_FROM, _INVALID).astype(np.int64)
    numbers[np.isneginf(ranges)] = scip.ERRORS_UP_TO + 1  # too near, and no error code
    finite = np.isfinite(ranges)
    numbers[finite] = np.round(ranges[finite] * 1000.0)
    return numbers


class TwinLaser:
    """A laser in the simulated world, and the port that `Hokuyo` opens.

    Args:
        scan: returns the ranges (beams,) [m] of a turn, by its number.
        settings: of the sensor.
        now: milliseconds of the sensor's clock.

    Attributes:
        plugged: false: the host gets an error.
        silent: it sends nothing.
        delay: time that its bytes are under way [ms].
    """

    def __init__(
        self,
        scan: Callable[[int], NDArray[np.float32]],
        settings: LaserSettings,
        now: Callable[[], int],
    ) -> None:
        self._scan, self._settings, self._now = scan, settings, now
        self._sensor: ScipSensor | None = None
        self._sent: deque[tuple[int, bytes]] = deque()  # when they arrive
        self.plugged, self.silent, self.delay = True, False, 0

    def turn(self, milliseconds: int) -> None:
        """Complete a turn of the mirror at a time of the sensor's clock."""
        sensor = self._sensor
        if sensor is None or not sensor.streaming or self.silent:
            return
        ranges = self._scan(milliseconds // SCAN_PERIOD_MS)
        self._send(sensor.scan(to_millimetres(ranges), milliseconds))

    def read_all(self) -> bytes:
        """All bytes that have arrived, without waiting."""
        self._check()
        data = b""
        while self._sent and self._sent[0][0] <= self._now():
            data += self._sent.popleft()[1]
        return data

    def write(self, data: bytes) -> int:
        """Take requests of the host."""
        self._check()
        if self._sensor is None:
            self._sensor = ScipSensor(sensor_specs(self._settings))
        self._sensor.time = self._now()
        answer = self._sensor.feed(data)
        if not self.silent:
            self._send(answer)
        return len(data)

    def close(self) -> None:
        """Stop the sensor: the host has closed the connection."""
        self._sensor = None
        self._sent.clear()

    def _send(self, data: bytes) -> None:
        self._sent.append((self._now() + self.delay, data))

    def _check(self) -> None:
        if not self.plugged:
            raise OSError("the laser is unplugged")

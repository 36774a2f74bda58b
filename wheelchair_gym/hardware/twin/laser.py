"""The twin's laser: scans of the simulated world, said as a Hokuyo says them."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.config import InputError
from wheelchair_gym.hardware.laser.scip import NO_ECHO_FROM
from wheelchair_gym.hardware.twin.scip_sensor import Model, ScipSensor
from wheelchair_gym.sensors.settings import LaserSettings

TURN = 25  # ms: 40 Hz, as a UST-10LX
_INVALID = 1  # mm: an error code


def model_of(laser: LaserSettings) -> Model:
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


def millimetres(ranges: NDArray[np.float32]) -> NDArray[np.int64]:
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
        self._said += sensor.scan(millimetres(ranges), milliseconds)

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
            self._sensor = ScipSensor(model_of(self._settings))
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

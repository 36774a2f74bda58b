"""The suite: what all chairs of a kind share, as one record that kernels take in one piece."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.address import (
    Pointers,
    Target,
    doubles_at,
    floats_at,
    integers_at,
    pointer_record,
    table_at,
    words_at,
)
from wheelchair_gym.compiled.kernel import inlined
from wheelchair_gym.physics.engine import ENGINE, engine_record
from wheelchair_gym.sensors.laser import LaserArrays
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sensors.ultrasonic import UltrasonicArrays

_LASER_FIELDS = ("first", "per_angle", "reach", "nearest", "sigma", "no_echo", "bias")
_RANGER_FIELDS = ("slope", "reach", "blind", "sigma", "ghosts", "loss_from", "loss_at")

SUITE, _TARGETS = pointer_record(
    ("beams", "i8"),
    ("cosine", Target("f4", None)),
    ("sine", Target("f4", None)),
    ("salt", Target("u4", None)),
    ("laser_mount", Target("f8", 3)),
    *((f"laser_{name}", "f8") for name in _LASER_FIELDS),
    ("rangers", "i8"),
    ("ranger_mount", Target("f8", None, 3)),
    ("order", Target("i8", None)),
    *((f"ranger_{name}", Target("f8", None)) for name in _RANGER_FIELDS),
    *((name, "u8") for name in ENGINE.names or ()),
)


class SensorSuite:
    """Sensors and engine of a kind of chair; `record` (1,) points to what it keeps alive.

    It never changes: a copy in this process is itself, one in another process is made anew.
    """

    def __init__(self, sensors: SensorSettings) -> None:
        self._sensors = sensors
        self.laser = LaserArrays.of(sensors.laser, sensors.noise)
        self.rangers = UltrasonicArrays.of(sensors.ultrasonic, sensors.noise)
        self.pointers = pointers = Pointers(np.zeros(1, SUITE), _TARGETS, constant=True)
        self.record: NDArray[np.void] = pointers.record
        r: Any = self.record[0]
        for name in ENGINE.names or ():
            r[name] = engine_record()[name][0]
        r["beams"], r["rangers"] = sensors.laser.beams, len(self.rangers.order)
        pointers.point("cosine", self.laser.cosine)
        pointers.point("sine", self.laser.sine)
        pointers.point("salt", self.laser.salt)
        pointers.point("laser_mount", self.laser.mount)
        for name in _LASER_FIELDS:
            r[f"laser_{name}"] = getattr(self.laser, name)
        pointers.point("ranger_mount", self.rangers.mount)
        pointers.point("order", self.rangers.order)
        for name in _RANGER_FIELDS:
            pointers.point(f"ranger_{name}", getattr(self.rangers, name))

    def __deepcopy__(self, memo: dict[int, Any]) -> SensorSuite:
        return self

    def __reduce__(self) -> tuple[type[SensorSuite], tuple[SensorSettings]]:
        return type(self), (self._sensors,)


@inlined
def laser_of(suite: Any) -> LaserArrays:
    """The laser of a suite's record."""
    return LaserArrays(
        floats_at(suite.cosine, suite.beams),
        floats_at(suite.sine, suite.beams),
        words_at(suite.salt, suite.beams),
        suite.laser_first,
        suite.laser_per_angle,
        doubles_at(suite.laser_mount, 3),
        suite.laser_reach,
        suite.laser_nearest,
        suite.laser_sigma,
        suite.laser_no_echo,
        suite.laser_bias,
    )


@inlined
def rangers_of(suite: Any) -> UltrasonicArrays:
    """The ultrasonics of a suite's record."""
    return UltrasonicArrays(
        table_at(suite.ranger_mount, suite.rangers, 3),
        doubles_at(suite.ranger_slope, suite.rangers),
        doubles_at(suite.ranger_reach, suite.rangers),
        doubles_at(suite.ranger_blind, suite.rangers),
        doubles_at(suite.ranger_sigma, suite.rangers),
        doubles_at(suite.ranger_ghosts, suite.rangers),
        doubles_at(suite.ranger_loss_from, suite.rangers),
        doubles_at(suite.ranger_loss_at, suite.rangers),
        integers_at(suite.order, suite.rangers),
    )

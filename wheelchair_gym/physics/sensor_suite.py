"""The suite: what all chairs of a kind share, as one record that kernels take in one piece."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.address import (
    Pointers,
    Target,
    doubles_at,
    integers_at,
    pointer_record,
    table_at,
)
from wheelchair_gym.compiled.kernel import inlined
from wheelchair_gym.physics.engine import ENGINE, engine_record
from wheelchair_gym.sensors.laser import LaserArrays
from wheelchair_gym.sensors.scanners import SCANNER, scanner_at, scanner_pointers
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sensors.ultrasonic import UltrasonicArrays

_RANGER_FIELDS = ("slope", "reach", "blind", "ghosts", "loss_from", "loss_at")

SUITE, _TARGETS = pointer_record(
    ("n_scanners", "i8"),
    ("scanners", Target(SCANNER, None)),
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
        self.scanners = scanner_pointers(sensors, sensors.noise)
        self.rangers = UltrasonicArrays.of(sensors.ultrasonic, sensors.noise)
        self.pointers = pointers = Pointers(np.zeros(1, SUITE), _TARGETS, constant=True)
        self.record: NDArray[np.void] = pointers.record
        r: Any = self.record[0]
        for name in ENGINE.names or ():
            r[name] = engine_record()[name][0]
        r["n_scanners"], r["rangers"] = len(self.scanners.record), len(self.rangers.order)
        pointers.point("scanners", self.scanners)
        pointers.point("ranger_mount", self.rangers.mount)
        pointers.point("order", self.rangers.order)
        for name in _RANGER_FIELDS:
            pointers.point(f"ranger_{name}", getattr(self.rangers, name))

    def __deepcopy__(self, memo: dict[int, Any]) -> SensorSuite:
        return self

    def __reduce__(self) -> tuple[type[SensorSuite], tuple[SensorSettings]]:
        return type(self), (self._sensors,)


@inlined
def scanner_of(suite: Any, p: Any, k: int) -> LaserArrays:
    """Scanner k of a suite's record, with the mount and the errors of an episode's parameters."""
    one = scanner_at(suite.scanners, suite.n_scanners, k)
    return LaserArrays(
        one.cosine,
        one.sine,
        one.salt,
        one.first,
        one.per_angle,
        p.laser_mount[k],
        one.reach,
        one.nearest,
        p.laser_sigma[k],
        p.laser_dropout[k],
        p.laser_bias[k],
        one.number,
        one.start,
        one.shows_free,
    )


@inlined
def rangers_of(suite: Any, p: Any) -> UltrasonicArrays:
    """The ultrasonics of a suite's record, with the errors of an episode's parameters."""
    return UltrasonicArrays(
        table_at(suite.ranger_mount, suite.rangers, 3),
        doubles_at(suite.ranger_slope, suite.rangers),
        doubles_at(suite.ranger_reach, suite.rangers),
        doubles_at(suite.ranger_blind, suite.rangers),
        p.ranger_sigma[:],
        doubles_at(suite.ranger_ghosts, suite.rangers),
        doubles_at(suite.ranger_loss_from, suite.rangers),
        doubles_at(suite.ranger_loss_at, suite.rangers),
        integers_at(suite.order, suite.rangers),
    )

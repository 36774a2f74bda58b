"""The suite: what all chairs of a kind share, as one record that kernels take in one piece."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelchair_gym.compiled.address import Pointers, Target, pointer_record
from wheelchair_gym.compiled.kernel import inlined
from wheelchair_gym.engine import ENGINE, engine_record
from wheelchair_gym.sensors.laser import (
    SCANNER,
    LaserArrays,
    laser_arrays,
    scanner_pointers,
    scanners_at,
)
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sensors.ultrasonic import RANGER, ranger_rows, rangers_at

SUITE, _TARGETS = pointer_record(
    ("n_scanners", "i8"),
    ("scanners", Target(SCANNER, None)),
    ("rangers", "i8"),
    ("ranger_rows", Target(RANGER, None)),
    ("order", Target("i8", None)),  # ranger that fires k-th
    *((name, "u8") for name in ENGINE.names or ()),
)


class SensorSuite(Pointers):
    """Sensors and engine of a kind of chair; `record` (1,) points to what it keeps alive.

    It never changes: a copy in this process is itself, one in another process is made anew.
    """

    def __init__(self, sensors: SensorSettings) -> None:
        super().__init__(np.zeros(1, SUITE), _TARGETS, constant=True)
        self._sensors = sensors
        self.scanners = scanner_pointers(sensors, sensors.noise)
        self.order = np.array(sensors.ultrasonic.firing_order, np.int64)
        for name in ENGINE.names or ():
            self.record[name] = engine_record()[name]
        self.fill(
            n_scanners=len(self.scanners.record), scanners=self.scanners, rangers=len(self.order),
            ranger_rows=ranger_rows(sensors.ultrasonic, sensors.noise), order=self.order,
        )  # fmt: skip

    def __reduce__(self) -> tuple[type[SensorSuite], tuple[SensorSettings]]:
        return type(self), (self._sensors,)


@inlined
def scanner_of(suite: Any, p: Any, k: int) -> LaserArrays:
    """Scanner k of a suite's record, with the mount and the errors of an episode's parameters."""
    one, mount, bias = scanners_at(suite.scanners, suite.n_scanners)[k], p.laser_mount, p.laser_bias
    sigma, dropout, offset = p.laser_sigma[k], p.laser_dropout[k], p.laser_offset[k]
    return laser_arrays(one, mount[k], sigma, dropout, bias[k], offset)


@inlined
def ranger_of(suite: Any, which: int) -> Any:
    """One of the ultrasonics of a suite's record, a record of RANGER."""
    return rangers_at(suite.ranger_rows, suite.rangers)[which]

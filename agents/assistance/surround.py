"""Obstacles around the chair: of each sector the nearest one, remembered where nothing looks."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry import world_to_body, wrap
from wheelchair_gym.kinematics import arc_step
from wheelchair_gym.types import Reading

if TYPE_CHECKING:
    from wheelchair_gym.physics.settings import ChairSettings
    from wheelchair_gym.sensors.settings import SensorSettings

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

SECTORS = 128  # around the middle of the outline
REACH = 4.0  # m: farther is of no concern
MEMORY = 10.0  # s for which what nothing looks at any more is remembered


@borrowing_kernel
def _take(x: float, y: float, until: float, middle: float, sectors: Array) -> None:
    """Keep a point of the chair's frame if it is the nearest of its sector."""
    far = math.hypot(x - middle, y)
    if far > REACH:
        return
    k = int((math.atan2(y, x - middle) + math.pi) / (2.0 * math.pi) * sectors.shape[0])
    k = min(sectors.shape[0] - 1, max(0, k))
    if far < sectors[k, 3]:
        sectors[k, 0], sectors[k, 1], sectors[k, 2], sectors[k, 3] = x, y, until, far


@borrowing_kernel
def _update(
    scan: Floats, directions: Array, mount: Array, half_view: float, motion: Array, now: float,
    middle: float, before: Array, sectors: Array, points: Array,
) -> int:  # fmt: skip
    """Take a scan, and carry along what it cannot show; how many points there are.

    Rows of sectors (n, 4): x, y [m], stamp until which it is kept [s], distance [m].
    """
    for k in range(sectors.shape[0]):
        for j in range(4):
            before[k, j] = sectors[k, j]
        sectors[k, 3] = math.inf
    c, s = math.cos(motion[2]), math.sin(motion[2])
    for k in range(before.shape[0]):
        if not (before[k, 3] < math.inf and now < before[k, 2]):
            continue
        x, y = world_to_body(c, s, before[k, 0] - motion[0], before[k, 1] - motion[1])
        bearing = math.atan2(y - mount[1], x - mount[0]) - mount[2]
        if abs(wrap(bearing)) > half_view:  # else the scan shows what is there
            _take(x, y, before[k, 2], middle, sectors)
    for k in range(scan.shape[0]):
        r = scan[k]
        if r > np.float32(0.0) and r < np.float32(REACH + 1.0):
            x, y = mount[0] + r * directions[k, 0], mount[1] + r * directions[k, 1]
            _take(x, y, now + MEMORY, middle, sectors)
    n = 0
    for k in range(sectors.shape[0]):
        if sectors[k, 3] < math.inf:
            points[n, 0], points[n, 1] = sectors[k, 0], sectors[k, 1]
            n += 1
    return n


class Surround:
    """Obstacles around a chair, by its first scanner and its odometry.

    Args:
        chair: its outline.
        sensors: where the scanner sits.
        period: of control [s].
    """

    def __init__(self, chair: ChairSettings, sensors: SensorSettings, period: float) -> None:
        laser, outline = sensors.laser, chair.footprint
        self._beams, self._directions = laser.beams, laser.directions
        self._mount = np.array([laser.x, laser.y, laser.yaw])
        self._half_view, self._period = 0.5 * laser.fov, period
        self._middle = 0.5 * (outline.front - outline.rear)
        self._sectors = np.full((SECTORS, 4), math.inf)
        self._before = np.empty_like(self._sectors)
        self._stamp: float | None = None

    def update(self, reading: Reading) -> Array:
        """The obstacles (n, 2) [m] in the chair's frame, after a reading."""
        since = 0.0 if self._stamp is None else reading.stamp - self._stamp
        self._stamp = reading.stamp
        v, w = reading.twist.tolist()
        motion = np.array(arc_step(0.0, 0.0, 0.0, v, w, since))
        points = np.empty((SECTORS, 2))
        n = _update(
            reading.laser[: self._beams], self._directions, self._mount, self._half_view, motion,
            reading.stamp, self._middle, self._before, self._sectors, points,
        )  # fmt: skip
        return points[:n]

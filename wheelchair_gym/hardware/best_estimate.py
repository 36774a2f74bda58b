"""The best that a real chair knows of itself, where a simulated one would know the truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.geometry import Footprint, relative_pose
from wheelchair_gym.localization.scan import read_scan
from wheelchair_gym.sensors.settings import LaserSettings
from wheelchair_gym.types import Truth

Array = NDArray[np.float64]

_CLEARANCE = 2.0  # m: beyond, `Truth.clearance` says no more


class Known:
    """Where it is by odometry, how far it has come, how near things are.

    Args:
        outline: of the chair.
        laser: whose echoes are measured against it.

    Attributes:
        reckoned: the odometry's pose (3,).
        truth: the pose believed, the nearest echo, what strips felt; no energy.
    """

    def __init__(self, outline: Footprint, laser: LaserSettings) -> None:
        self.outline, self._laser = outline, laser
        self.begin(np.zeros(3))

    def begin(self, reckoned: Array) -> None:
        """An episode begins at a pose (3,) of the odometry."""
        self.reckoned = reckoned
        self.truth = Truth(reckoned, np.zeros(2), _CLEARANCE, False, False, 0.0, 0.0)

    def update(
        self, reckoned: Array, pose: Array, twist: Array, laser: NDArray[np.float32], felt: bool
    ) -> None:
        """A period has passed.

        Args:
            reckoned: the odometry's pose (3,).
            pose: the one believed (3,).
            twist: (2,).
            laser: ranges (beams,) [m].
            felt: a strip was pressed.
        """
        way = self.truth.distance + float(np.hypot(*relative_pose(self.reckoned, reckoned)[:2]))
        self.reckoned, touched = reckoned, self.truth.touched or felt
        self.truth = Truth(pose, twist, self._gap(laser), felt, touched, way, 0.0)

    def found(self, pose: Array) -> None:
        """It is believed to be at a pose (3,), by what was seen."""
        self.truth = self.truth._replace(pose=pose)

    def _gap(self, laser: NDArray[np.float32]) -> float:
        """Distance [m] from the outline to the nearest echo."""
        ends = read_scan(self._laser, laser, 0.0).echoes
        front, rear, half = self.outline.array
        aside = np.maximum(np.abs(ends[:, 1]) - half, 0.0)
        ahead = np.maximum(np.maximum(ends[:, 0] - front, -rear - ends[:, 0]), 0.0)
        return float(np.hypot(ahead, aside).min(initial=_CLEARANCE))

"""Dead reckoning from the drive board's counts, moved on to any instant; and as a localizer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.geometry import compose, wrap_angle
from wheelchair_gym.hardware.boards.protocol import Odometry
from wheelchair_gym.kinematics import DriveGeometry, odometric_step, twist_of_wheels
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]

_WRAP = 1 << 32  # counts
# As plain Python: a few calls a second are not worth a compiler.
_step: Any = odometric_step
_twist: Any = twist_of_wheels


def _moved(pose: Array, ways: Array, track: float) -> Array:
    """A pose (3,) after the ways of both wheels (2,) [m]."""
    x, y, yaw = _step.py_func(*pose.tolist(), *_twist.py_func(*ways.tolist(), track))
    return np.array([x, y, float(wrap_angle(yaw))])


class WheelOdometry:
    """Where the wheels have come since it was made.

    Odometry may be a few hundredths of a second old when it is wanted: what the wheels did since
    is worked out from their speeds.

    Args:
        geometry: track, counts of a metre.
        most: how far [s] it is moved on at most.
    """

    def __init__(self, geometry: DriveGeometry, most: float) -> None:
        self._geometry, self._most = geometry, most
        self._pose, self._ways = np.zeros(3), np.zeros(2)
        self._speeds = np.zeros(2)
        self._counts: tuple[int, int] | None = None
        self._taken = 0.0

    def restart(self) -> None:
        """The board counts anew: what it counted in between is lost."""
        self._counts = None

    def update(self, odometry: Odometry, taken: float) -> None:
        """Odometry that was made at a time [s]."""
        counts = odometry.left, odometry.right
        if self._counts is not None:
            steps = [
                (after - before + _WRAP // 2) % _WRAP - _WRAP // 2
                for before, after in zip(self._counts, counts, strict=True)
            ]
            ways = np.array(steps) / self._geometry.counts_per_metre
            self._pose = _moved(self._pose, ways, self._geometry.track)
            self._ways = self._ways + ways
        self._counts, self._taken = counts, taken
        self._speeds = np.array([odometry.speed_left, odometry.speed_right])

    def at(self, now: float) -> tuple[Array, Array]:
        """The pose (3,), and the ways (2,) [m] of left and right wheel, at a time [s]."""
        more = self._speeds * min(self._most, max(0.0, now - self._taken))
        return _moved(self._pose, more, self._geometry.track), self._ways + more

    def twist(self, ways: Array, seconds: float) -> Array:
        """The mean twist (2,) of ways (2,) [m] in so many seconds."""
        return np.array(_twist.py_func(*(ways / seconds).tolist(), self._geometry.track))


class OdometryLocalizer:
    """Takes the pose from the odometry alone; see `localization.localized_chair.Localizer`."""

    def begin(self, episode: Episode, key: int) -> None:
        """Start where an episode does; nothing is drawn."""
        self._pose = np.array(episode.start, np.float64)

    def update(self, increment: Array, ranges: NDArray[np.float32]) -> Array:
        """The pose (3,), moved on by what the odometry says (3,); ranges are not looked at."""
        self._pose = compose(self._pose, increment)
        return self._pose

    @property
    def poses(self) -> Array:
        """The one pose (1, 3)."""
        return self._pose[None]

    @property
    def built_map(self) -> Callable[[], OccupancyGrid] | None:
        """It draws no map."""
        return None

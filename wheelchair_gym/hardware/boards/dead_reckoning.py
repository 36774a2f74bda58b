"""Dead reckoning from the drive board's counts, extrapolated to any instant; and as a localizer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.arrays import Array
from wheelchair_gym.geometry import compose, wrap_angle
from wheelchair_gym.hardware.boards.protocol import Odometry
from wheelchair_gym.kinematics import DriveGeometry, odometric_step, twist_of_wheels
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.types import Episode

_WRAP = 1 << 32  # counts
# As plain Python: a few calls per second need no compiled code.
_step: Any = odometric_step
_twist: Any = twist_of_wheels


def _advanced(pose: Array, travel: Array, track: float) -> Array:
    """A pose (3,) after both wheels have rolled (2,) [m]."""
    x, y, yaw = _step.py_func(*pose.tolist(), *_twist.py_func(*travel.tolist(), track))
    return np.array([x, y, float(wrap_angle(yaw))])


class WheelOdometry:
    """The pose by the wheels since it was made.

    Odometry may be some hundredths of a second old when it is used: it is extrapolated by the
    wheels' speeds, for at most `most` [s].
    """

    def __init__(self, geometry: DriveGeometry, most: float) -> None:
        self._geometry, self._most = geometry, most
        self._pose, self._travel = np.zeros(3), np.zeros(2)
        self._speeds = np.zeros(2)
        self._counts: tuple[int, int] | None = None
        self._made = 0.0

    def restart(self) -> None:
        """The board has restarted its counters: what it counted in between is lost."""
        self._counts = None

    def update(self, odometry: Odometry, made: float) -> None:
        """Take odometry that was made at a time [s]."""
        counts = odometry.left, odometry.right
        if self._counts is not None:
            steps = [
                (after - before + _WRAP // 2) % _WRAP - _WRAP // 2
                for before, after in zip(self._counts, counts, strict=True)
            ]
            travel = np.array(steps) / self._geometry.counts_per_metre
            self._pose = _advanced(self._pose, travel, self._geometry.track)
            self._travel = self._travel + travel
        self._counts, self._made = counts, made
        self._speeds = np.array([odometry.speed_left, odometry.speed_right])

    def at(self, now: float) -> tuple[Array, Array]:
        """Pose (3,) and travel (2,) [m] of the left and the right wheel, at a time [s]."""
        more = self._speeds * min(self._most, max(0.0, now - self._made))
        return _advanced(self._pose, more, self._geometry.track), self._travel + more

    def twist(self, travel: Array, seconds: float) -> Array:
        """The mean twist (2,) of wheels that travel (2,) [m] in a time [s]."""
        return np.array(_twist.py_func(*(travel / seconds).tolist(), self._geometry.track))


class OdometryLocalizer:
    """The pose by odometry alone; see `localization.localized_chair.Localizer`."""

    def begin(self, episode: Episode, key: int) -> None:
        """Start at an episode's start; nothing is random."""
        self._pose = np.array(episode.start, np.float64)

    def update(self, increment: Array, ranges: NDArray[np.float32]) -> Array:
        """The pose (3,) after an increment (3,) of the odometry; ranges are ignored."""
        self._pose = compose(self._pose, increment)
        return self._pose

    @property
    def poses(self) -> Array:
        """The one pose (1, 3)."""
        return self._pose[None]

    @property
    def built_map(self) -> Callable[[], OccupancyGrid] | None:
        """None: it builds no map."""
        return None

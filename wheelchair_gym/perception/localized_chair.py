"""A chair whose pose comes from a localizer instead of dead reckoning."""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.geometry.planar import relative_pose
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.types import Belief, Chair, Episode, Reading, Truth


class Localizer(Protocol):
    """Estimates the pose of a chair: localization on a known map, or SLAM."""

    def begin(self, episode: Episode, key: int) -> None:
        """Start where an episode does; the key seeds every draw until the next one begins."""

    def update(self, increment: Array, ranges: NDArray[np.float32]) -> Array:
        """The pose (3,) after an odometry increment (3,) [m, m, rad] and a scan."""

    @property
    def poses(self) -> Array:
        """Possible poses of the chair (particles, 3) [m, m, rad]."""

    @property
    def built_map(self) -> Callable[[], OccupancyGrid] | None:
        """A function that returns the map built so far; None where the map is given."""


class LocalizedChair(Chair):
    """A chair whose readings hold the poses of a localizer, from the episode's start on.

    Args:
        chair: its readings hold dead-reckoned poses, in any frame.
        localizer: estimates its pose.
        beams: ranges of a reading that it gets: those of the first scanner; None: all.
    """

    def __init__(self, chair: Chair, localizer: Localizer, beams: int | None = None) -> None:
        self.chair, self.localizer, self._beams = chair, localizer, beams

    def reset(self, episode: Episode, key: int) -> Reading:
        """See `Chair.reset`."""
        reading = self.chair.reset(episode, key)
        self.localizer.begin(episode, key)
        self._odometry = reading.pose
        return self._localized(reading)

    def drive(self, twist: Array, protective: bool = False) -> Reading:
        """See `Chair.drive`."""
        return self._localized(self.chair.drive(twist, protective))

    def _localized(self, reading: Reading) -> Reading:
        increment = relative_pose(self._odometry, reading.pose)
        self._odometry = reading.pose
        pose = self.localizer.update(increment, reading.laser[: self._beams])
        self.chair.set_localized_pose(pose)
        return reading._replace(pose=pose)

    @property
    def belief(self) -> Belief:
        """The odometry's pose, the particles, and the map that SLAM builds."""
        localizer = self.localizer
        return Belief(self._odometry, localizer.poses, localizer.built_map)

    @property
    def truth(self) -> Truth:
        """See `Chair.truth`."""
        return self.chair.truth

    def close(self) -> None:
        """See `Chair.close`."""
        self.chair.close()


def unwrapped(chair: Chair) -> Chair:
    """The chair without its localizers."""
    while isinstance(chair, LocalizedChair):
        chair = chair.chair
    return chair

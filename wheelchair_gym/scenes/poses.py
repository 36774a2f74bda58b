"""Collision-free poses: checks, and random draws."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.config import InputError
from wheelchair_gym.geometry import Footprint, footprint_clearance
from wheelchair_gym.maps import bottleneck
from wheelchair_gym.random import NumpyStream, numpy_uniform
from wheelchair_gym.scenes.raster import CELL
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]
Index = NDArray[np.int64]

FOOTPRINT: Final = Footprint()  # of the default chair
_INSET: Final = 0.4  # m: from the axle to the walls of a room, at least


def passing_radius(footprint: Footprint) -> float:
    """Radius [m] of a disc that passes where the footprint does: half its width, and a cell."""
    return footprint.half_width + CELL


def is_free_pose(
    pose: Array, walls: Array, discs: Array, footprint: Footprint, clearance: float
) -> bool:
    """Whether a footprint at a pose (3,) is at least `clearance` [m] from everything."""
    x, y, yaw = pose
    gap = footprint_clearance(x, y, yaw, footprint.array, walls, discs, clearance + 0.01)
    return bool(gap >= clearance and gap > 0.0)


def check_start(episode: Episode, footprint: Footprint) -> None:
    """Check that a chair can stand at an episode's start.

    Raises:
        InputError: it cannot.
    """
    if not is_free_pose(episode.start, episode.walls, episode.discs, footprint, 0.0):
        x, y, yaw = episode.start
        raise InputError(
            f"scene {episode.name}: {footprint} does not fit at the start "
            f"({x:.2f}, {y:.2f}, {yaw:.2f})"
        )


def check_passable(episode: Episode, footprint: Footprint) -> float:
    """The greatest radius [m] of a disc that gets from an episode's start to its goal on the map.

    Raises:
        InputError: it is less than half the footprint's width, by more than half a cell.
    """
    radius = bottleneck(episode.map, episode.start[:2], episode.goal[:2])
    if radius + 0.5 * episode.map.resolution < footprint.half_width:
        raise InputError(
            f"scene {episode.name}: {footprint} does not pass from start to goal; the widest way "
            f"is {max(0.0, 2.0 * radius):.2f} m wide at its narrowest spot"
        )
    return radius


@borrowing_kernel
def sample_pose(
    source: NumpyStream,
    room: Index,
    walls: Array,
    discs: Array,
    outline: Array,
    clearance: float,
    tries: int,
    pose: Array,
) -> bool:
    """Draw poses until the footprint is free; whether one was found."""
    for _ in range(tries):
        pose[0] = numpy_uniform(source, room[0] * CELL + _INSET, room[2] * CELL - _INSET)
        pose[1] = numpy_uniform(source, room[1] * CELL + _INSET, room[3] * CELL - _INSET)
        pose[2] = numpy_uniform(source, -math.pi, math.pi)
        reach = clearance + 0.01
        gap = footprint_clearance(pose[0], pose[1], pose[2], outline, walls, discs, reach)
        if gap >= clearance and gap > 0.0:
            return True
    return False

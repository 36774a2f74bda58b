"""Checks of poses, episodes and settings: what stands free, passes and makes sense."""

from __future__ import annotations

from typing import Final

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.geometry.outline import Footprint, footprint_clearance
from wheelchair_gym.maps import bottleneck
from wheelchair_gym.scenes.raster import CELL
from wheelchair_gym.types import Episode

FOOTPRINT: Final = Footprint()  # of the default chair
CLEARANCE: Final = 0.15  # m round the footprint at starts and goals that are drawn


Pose = tuple[float, float, float]  # m, m, rad


@settings
class Ends:
    """Start and goal of a scene."""

    start: Pose | None = setting(default=None, unit="m, m, rad")
    """Start pose; null draws it at random."""
    goal: Pose | None = setting(default=None, unit="m, m, rad")
    """Goal pose; null draws it at random."""


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

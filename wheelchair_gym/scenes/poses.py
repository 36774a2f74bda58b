"""Where a chair can stand: poses drawn until the whole footprint is free."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.geometry import Footprint, footprint_clearance
from wheelchair_gym.scenes.raster import CELL

Array = NDArray[np.float64]

FOOTPRINT: Final = Footprint()
RADIUS: Final = FOOTPRINT.half_width + CELL  # m: its way through a straight gap, and a cell


def stands(pose: Array, walls: Array, discs: Array, clearance: float) -> bool:
    """Whether the chair's footprint at a pose (3,) is at least `clearance` [m] from everything."""
    x, y, yaw = pose
    gap = footprint_clearance(x, y, yaw, FOOTPRINT.array, walls, discs, clearance + 0.01)
    return bool(gap >= clearance and gap > 0.0)


def draw_pose(
    rng: np.random.Generator,
    place: Callable[[], tuple[float, float]],
    walls: Array,
    discs: Array,
    clearance: float,
    tries: int = 20,
) -> Array | None:
    """A pose (3,) at a drawn place with a drawn heading, where the chair stands free.

    Args:
        rng: draws the heading.
        place: draws a place [m].
        walls: (n, 4) [m].
        discs: (m, 3) [m].
        clearance: from the footprint to everything [m].
        tries: None is returned after so many.
    """
    for _ in range(tries):
        pose = np.array([*place(), rng.uniform(-math.pi, math.pi)])
        if stands(pose, walls, discs, clearance):
            return pose
    return None

"""Where a chair can stand: poses drawn until the whole footprint is free."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.geometry import Footprint, footprint_clearance
from wheelchair_gym.kernel import borrowing_kernel
from wheelchair_gym.scenes.raster import CELL
from wheelchair_gym.scenes.stream import Stream, uniform

Array = NDArray[np.float64]
Index = NDArray[np.int64]

FOOTPRINT: Final = Footprint()
RADIUS: Final = FOOTPRINT.half_width + CELL  # m: its way through a straight gap, and a cell
_INSET: Final = 0.4  # m: from the axle to the walls of a room, at least


def stands(pose: Array, walls: Array, discs: Array, clearance: float) -> bool:
    """Whether the chair's footprint at a pose (3,) is at least `clearance` [m] from everything."""
    x, y, yaw = pose
    gap = footprint_clearance(x, y, yaw, FOOTPRINT.array, walls, discs, clearance + 0.01)
    return bool(gap >= clearance and gap > 0.0)


@borrowing_kernel
def draw_pose(
    source: Stream,
    room: Index,
    walls: Array,
    discs: Array,
    outline: Array,
    clearance: float,
    tries: int,
    pose: Array,
) -> bool:
    """Whether a pose was found where the chair stands free.

    Args:
        source: draws places and headings.
        room: (4,) [cells] in which to stand.
        walls: (n, 4) [m].
        discs: (m, 3) [m].
        outline: of the chair, `Footprint.array`.
        clearance: from the footprint to everything [m].
        tries: so many are made.
        pose: (3,) receives it.
    """
    for _ in range(tries):
        pose[0] = uniform(source, room[0] * CELL + _INSET, room[2] * CELL - _INSET)
        pose[1] = uniform(source, room[1] * CELL + _INSET, room[3] * CELL - _INSET)
        pose[2] = uniform(source, -math.pi, math.pi)
        reach = clearance + 0.01
        gap = footprint_clearance(pose[0], pose[1], pose[2], outline, walls, discs, reach)
        if gap >= clearance and gap > 0.0:
            return True
    return False

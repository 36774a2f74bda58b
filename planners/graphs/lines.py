"""Lines of poses that a search reaches exactly: through narrow places, and to the goal."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from planners.footprint import Sweeps, sweeps
from planners.graphs.states import Lines, Manner, free_gap
from planners.nearby import Nearby
from wheelchair_gym.kernel import kernel

Array = NDArray[np.float64]

REACH = 0.8  # m: from how far a line is joined: about a chair's length
ASKEW = 0.8  # rad: by how much the heading may differ there


@kernel
def _standing(
    near: Nearby, manner: Manner, poses: Array, room: Sweeps, free: NDArray[np.bool_]
) -> None:
    """Mark the poses (n, 3) at which the outline keeps the margin."""
    seen = np.empty_like(near.segments)
    for k in range(poses.shape[0]):
        x, y, yaw = poses[k]
        gap = free_gap(near, manner, x, y, yaw, 0.0, 0.0, room, seen)
        free[k] = gap >= manner.margin


def lines_of(
    near: Nearby, manner: Manner, narrows: Array, goal: Array, stride: float, join: float
) -> Lines:
    """The lines through narrow places, both ways, and that of a goal with a heading, (3,).

    Args:
        near: what lies where.
        manner: the chair.
        narrows: middles and directions (n, 3) of narrow places.
        goal: (2,) or (3,).
        stride: way [m] from pose to pose.
        join: from how far [m] the goal is tried.
    """
    front = float(manner.outline[0])
    count = math.ceil(front / stride) + 1
    middles = np.vstack([narrows, narrows + np.array([0.0, 0.0, math.pi])])
    headed = len(goal) == 3
    if headed:
        middles = np.vstack([goal[None], middles])
    along = stride * np.arange(-count, count + 1)
    poses = np.repeat(middles[:, None], len(along), axis=1)  # (lines, along, 3)
    poses[..., 0] += along * np.cos(middles[:, 2:])
    poses[..., 1] += along * np.sin(middles[:, 2:])
    free = np.zeros(poses.shape[:2], dtype=np.bool_)
    _standing(near, manner, poses.reshape(-1, 3), sweeps(1), free.reshape(-1))
    index = np.full((len(middles), len(along) + 2), -1)
    index[:, 1:-1][free] = np.arange(np.count_nonzero(free))
    reach, turn = np.full(free.shape, REACH), np.full(free.shape, ASKEW)
    if headed:
        reach[0, count], turn[0, count] = join, math.pi
    return Lines(
        poses[free],
        index[:, 2:][free],
        index[:, :-2][free],
        reach[free],
        turn[free],
        int(index[0, count + 1]) if headed else -1,
    )

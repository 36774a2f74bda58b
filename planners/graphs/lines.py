"""Lines of poses that a search reaches exactly: through narrow places, and to the goal."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from planners.footprint import Sweeps, sweeps
from planners.graphs.drive import Manner, free_gap, seconds
from planners.graphs.states import Lines
from planners.nearby import Nearby
from wheelchair_gym.kernel import kernel

Array = NDArray[np.float64]

REACH = 0.8  # m: from how far a line is joined: about a chair's length
LONGEST = 3.0  # m: of a straight last stretch
BESIDE = 0.5  # m: from so far beside its beginning it is tried
TURNS = 0.5 * math.pi  # rad: a chair that can turn so far to both hands can come from anywhere
YAWS = 24  # headings tried at a goal that has none
ASKEW = 0.8  # rad: by how much the heading may differ there


@kernel
def gaps_at(near: Nearby, manner: Manner, poses: Array, room: Sweeps) -> Array:
    """Gaps (n,) [m] of the outline at poses (n, 3), at most the wish; below the margin any."""
    seen, gaps = np.empty_like(near.segments), np.empty(poses.shape[0])
    for k in range(poses.shape[0]):
        x, y, yaw = poses[k]
        gaps[k] = free_gap(near, manner, x, y, yaw, 0.0, 0.0, room, seen)
    return gaps


@kernel
def entries(
    near: Nearby, manner: Manner, goals: Array, step: float, room: Sweeps
) -> tuple[Array, Array]:
    """Where the straight last stretch to each of some goal poses (n, 3) begins.

    That is the nearest place from which it is free, ahead or back, and where the chair can turn;
    if there is none, the farthest from which it is free.

    Returns:
        Places (k, 3): x, y and the seconds left; and how far [m] the farther is from each goal.
    """
    n = goals.shape[0]
    seen = np.empty_like(near.segments)
    places, far = np.empty((2 * n, 3)), np.zeros(n)
    roomy = np.zeros(2 * n, np.bool_)
    for k in range(2 * n):
        x, y, yaw = goals[k // 2]
        sign = 1.0 if k % 2 == 0 else -1.0
        d = 0.0
        while d < LONGEST:
            px, py = x - sign * d * math.cos(yaw), y - sign * d * math.sin(yaw)
            turns = True
            for turn in (TURNS, -TURNS):
                if turns:
                    gap = free_gap(near, manner, px, py, yaw, 0.0, turn, room, seen)
                    turns = gap >= manner.margin
            if turns:
                roomy[k] = True
                break
            qx, qy = px - sign * step * math.cos(yaw), py - sign * step * math.sin(yaw)
            if free_gap(near, manner, qx, qy, yaw, sign * step, 0.0, room, seen) < manner.margin:
                break
            d += step
        places[k, 0], places[k, 1] = x - sign * d * math.cos(yaw), y - sign * d * math.sin(yaw)
        places[k, 2] = seconds(manner, sign * d, 0.0)
        far[k // 2] = max(far[k // 2], d)
    return (places[roomy] if roomy.any() else places), far


def lines_of(
    near: Nearby, manner: Manner, narrows: Array, goal: Array, stride: float, join: float
) -> tuple[Lines, Array]:
    """The lines through narrow places, both ways; and where the goal is reached.

    A goal with a heading, (3,), has a line of its own. One without, where only some headings are
    free, is tried at each of these.

    Args:
        near: what lies where.
        manner: the chair.
        narrows: middles and directions (n, 3) of narrow places.
        goal: (2,) or (3,).
        stride: way [m] from pose to pose.
        join: from how far [m] the goal is tried.

    Returns:
        The lines; and places (k, 3) where ways to the goal end, with the seconds left from there.
    """
    headed = len(goal) == 3
    at_goal = goal[None]
    if not headed:
        yaws = np.arange(YAWS) * (2.0 * math.pi / YAWS)
        at_goal = np.column_stack([np.tile(goal, (YAWS, 1)), yaws])
        free = gaps_at(near, manner, at_goal, sweeps(1)) >= manner.margin
        at_goal = at_goal[free & (not free.all())]
    seeds, reach = np.array([[goal[0], goal[1], 0.0]]), np.zeros(0)
    if len(at_goal):
        seeds, reach = entries(near, manner, at_goal, stride, sweeps(1))
    count = math.ceil(float(manner.outline[0]) / stride) + 1
    middles = np.vstack([narrows, narrows + np.array([0.0, 0.0, math.pi])])
    if headed:
        middles = np.vstack([goal, middles])
    along = stride * np.arange(-count, count + 1)
    poses = np.repeat(middles[:, None], len(along), axis=1)  # (lines, along, 3)
    poses[..., 0] += along * np.cos(middles[:, 2:])
    poses[..., 1] += along * np.sin(middles[:, 2:])
    standing = gaps_at(near, manner, poses.reshape(-1, 3), sweeps(1)) >= manner.margin
    free = standing.reshape(poses.shape[:2])
    # Anchors: where the goal is reached, then the rest; the goal's own place in its line is first.
    index = np.full((len(middles), len(along) + 2), -1)
    if headed:
        free[0, count] = False
    index[:, 1:-1][free] = len(at_goal) + np.arange(np.count_nonzero(free))
    none = np.full(len(at_goal), -1)
    ahead, behind = none, none.copy()
    if headed:
        ahead, behind = index[0, [count + 2]], index[0, [count]]
        index[0, count + 1] = 0
    many = np.count_nonzero(free)
    lines = Lines(
        np.vstack([at_goal, poses[free]]),
        np.concatenate([ahead, index[:, 2:][free]]),
        np.concatenate([behind, index[:, :-2][free]]),
        np.concatenate([np.maximum(join, reach + BESIDE), np.full(many, REACH)]),
        np.concatenate([np.full(len(at_goal), math.pi), np.full(many, ASKEW)]),
        len(at_goal),
        headed,
    )
    return lines, seeds

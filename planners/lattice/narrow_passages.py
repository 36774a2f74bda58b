"""Narrow passages of a map, and the lines of poses along which an outline passes them.

In the middle of a narrow passage the distance to obstacles has a saddle: the two nearest points lie
opposite each other. A chair that fits through with little play is aligned there: on the line
through the middle, at right angles to the gap. The search over poses reaches the poses of these
lines, and the goal's, exactly.
"""

import math

import numpy as np

from planners.collision.footprint import Surroundings, free_gap, gaps_at, with_headings
from planners.collision.nearby import Nearby, passage_middle
from planners.lattice.heuristic import SPACING, Field
from planners.lattice.pose_search import Lines
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.maps.driving_cost import duration

SETTLED = 1e-4  # m
APART = 0.3  # m: narrow places in line that are nearer to each other are one
ALIGNED = math.radians(3.0)  # of places that are in line


@borrowing_kernel
def _is_found(places: Array, count: int, x: float, y: float, yaw: float) -> bool:
    """Return whether a place is in line with one of the first `count` places, and near to it."""
    for k in range(count):
        dx, dy = places[k, 0] - x, places[k, 1] - y
        aside = abs(math.cos(yaw) * dy - math.sin(yaw) * dx)
        misaligned = abs(math.sin(places[k, 2] - yaw))
        if aside < 0.2 * SPACING and misaligned < ALIGNED and math.hypot(dx, dy) < APART:
            return True
    return False


@kernel
def narrow_places(near: Nearby, gaps: Field, minimum: float, maximum: float) -> Array:
    """Return the middles of narrow places and the directions through them (n, 3) [m, m, rad].

    Args:
        near: the map's boundary, up to twice `maximum`.
        gaps: distances at the points of a grid.
        minimum: smallest half width [m] of a gap.
        maximum: largest half width [m] of a gap.
    """
    rows, columns = gaps.shape
    found = np.empty((gaps.size, 3))
    n = 0
    for i in range(1, rows - 1):
        for j in range(1, columns - 1):
            here = gaps[i, j]
            if not minimum - SPACING <= here <= maximum:
                continue
            saddle = False
            for di, dj in ((0, 1), (1, 0), (1, 1), (1, -1)):
                across = max(gaps[i + di, j + dj], gaps[i - di, j - dj]) <= here
                along = min(gaps[i + dj, j - di], gaps[i - dj, j + di]) >= here - 0.2 * SPACING
                saddle |= across and along
            if not saddle:
                continue
            x, y = near.box[0] + j * SPACING, near.box[1] + i * SPACING
            half, (x, y, yaw) = passage_middle(near, x, y, maximum, SETTLED)
            yaw %= math.pi
            if minimum <= half <= maximum and not _is_found(found, n, x, y, yaw):
                found[n, 0], found[n, 1], found[n, 2] = x, y, yaw
                n += 1
    return found[:n].copy()


REACH = 4.0  # strides: distance up to which a line is joined
LONGEST = 3.0  # m: length of a straight last stretch
BESIDE = 0.5  # m: distance beside its beginning up to which it is tried
TURNS = 0.5 * math.pi  # rad: a chair that turns this far to both sides can come from anywhere
YAWS = 24  # headings tried at a goal that has none
HEADING_RANGE = 0.8  # rad: difference of the headings up to which a line is joined


@kernel
def entries(around: Surroundings, goals: Array, step: float) -> tuple[Array, Array]:
    """Return the beginnings of the straight last stretches to some goal poses (n, 3).

    A stretch begins at the nearest place from which it is free, ahead or back, and where the chair
    can turn; if there is none, at the farthest place from which it is free.

    Returns:
        Places (k, 3): x, y and the duration left; and the largest distance [m] from each goal.
    """
    n, motion = goals.shape[0], around.motion
    places, far = np.empty((2 * n, 3)), np.zeros(n)
    turnable = np.zeros(2 * n, np.bool_)
    for k in range(2 * n):
        x, y, yaw = goals[k // 2]
        sign = 1.0 if k % 2 == 0 else -1.0
        d = 0.0
        while d < LONGEST:
            px, py = x - sign * d * math.cos(yaw), y - sign * d * math.sin(yaw)
            turns = True
            for turn in (TURNS, -TURNS):
                if turns:
                    turns = free_gap(around, (px, py, yaw), 0.0, turn) >= motion.margin
            if turns:
                turnable[k] = True
                break
            qx, qy = px - sign * step * math.cos(yaw), py - sign * step * math.sin(yaw)
            if free_gap(around, (qx, qy, yaw), sign * step, 0.0) < motion.margin:
                break
            d += step
        places[k, 0], places[k, 1] = x - sign * d * math.cos(yaw), y - sign * d * math.sin(yaw)
        places[k, 2] = duration(motion, sign * d, 0.0)
        far[k // 2] = max(far[k // 2], d)
    return (places[turnable] if turnable.any() else places), far


def make_lines(
    around: Surroundings, narrows: Array, goal: Array, stride: float, join: float
) -> tuple[Lines, Array]:
    """Return the lines through narrow places, both ways; and where paths to the goal end.

    A goal with a heading, (3,), has a line of its own. One without, where only some headings are
    free, is tried at each of these.

    Args:
        around: the map and the chair.
        narrows: middles and directions (n, 3) of narrow places.
        goal: (2,) or (3,).
        stride: distance [m] from pose to pose.
        join: distance [m] up to which the goal is tried.

    Returns:
        The lines; and places (k, 3): x, y and the duration left from there.
    """
    headed, motion = len(goal) == 3, around.motion
    at_goal = with_headings(goal, YAWS)
    if not headed:
        free = gaps_at(around, at_goal) >= motion.margin
        at_goal = at_goal[free & (not free.all())]
    seeds, reach = np.array([[goal[0], goal[1], 0.0]]), np.zeros(0)
    free_goal = np.empty((0, 3)) if headed else np.array([[goal[0], goal[1], math.nan]])
    if len(at_goal):
        seeds, reach = entries(around, at_goal, stride)
    count = math.ceil(float(motion.outline[0]) / stride) + 1
    middles = np.vstack([narrows, narrows + np.array([0.0, 0.0, math.pi])])
    if headed:
        middles = np.vstack([goal, middles])
    along = stride * np.arange(-count, count + 1)
    poses = np.repeat(middles[:, None], len(along), axis=1)  # (lines, along, 3)
    poses[..., 0] += along * np.cos(middles[:, 2:])
    poses[..., 1] += along * np.sin(middles[:, 2:])
    clear = gaps_at(around, poses.reshape(-1, 3)) >= motion.margin
    free = clear.reshape(poses.shape[:2])
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
    counts, no_anchor = [len(at_goal), int(free.sum()), len(free_goal)], np.full(len(free_goal), -1)
    lines = Lines(
        np.vstack([at_goal, poses[free], free_goal]),
        np.concatenate([ahead, index[:, 2:][free], no_anchor]),
        np.concatenate([behind, index[:, :-2][free], no_anchor]),
        np.repeat([join, REACH * stride, join], counts),
        np.repeat([math.pi, HEADING_RANGE, math.pi], counts),
        len(at_goal),
    )
    lines.reach[: len(at_goal)] = np.maximum(join, reach + BESIDE)
    return lines, seeds

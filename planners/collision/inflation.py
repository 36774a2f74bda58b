"""Inflation of obstacles: the region in which the centre of a disc may be.

Its boundary consists of segments offset by the radius and of arcs around convex corners, each where
no other segment is nearer than the radius. A circumscribed polygon replaces each arc, so the region
is never too large; where two pieces would cross, their arcs get shorter sides.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from planners.collision.boundary import build_space_arrays
from planners.collision.offset_intervals import Pieces, exposed_pieces
from planners.collision.orient2d import orient2d
from planners.collision.polygon_tests import SpaceArrays
from wheelchair_gym.compiled.kernel import kernel

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

ARC = math.pi / 8  # rad: at most this much of an arc per side of its polygon
# Radii grow by this share: far below what any map knows, far above rounding. On a raster many
# circles of one radius meet in one point or just touch; of a radius like this, no three ever do.
SHIFT = 7.310585e-7
JOIN = 1e-9  # m: two ends of edge are one point if nearer than this
FINEST = 10  # times that the sides of an arc are halved where it would cross another


@kernel
def _offset_polygons(
    pieces: Pieces, follows: Index, segments: Array, radii: Array, halvings: Index
) -> tuple[Array, Index, Index]:
    """Corners (v, 2) of the polygons that the pieces form, each one's successor and its piece.

    Where a segment passes into the arc round its end there is no corner.
    """
    count, last = 0, np.empty(len(follows), np.int64)
    sides = np.zeros(len(follows), np.int64)
    for k in range(len(follows)):
        last[follows[k]] = k
        if pieces.source[k] < 0:
            span = pieces.high[k] - pieces.low[k]
            sides[k] = math.ceil(span / ARC) << halvings[k]
        count += sides[k] + 1
    corners, owner = np.empty((count, 2)), np.empty(count, np.int64)
    next_one, done = np.empty(count, np.int64), np.zeros(len(follows), np.bool_)
    count = 0
    for begin in range(len(follows)):
        k, first = begin, count
        while not done[k]:
            done[k] = True
            if not (pieces.whole[k, 0] and pieces.whole[last[k], 1]):
                corners[count] = pieces.ends[k, :2]
                owner[count] = k
                count += 1
            if sides[k] > 0:
                source = -1 - pieces.source[k]
                step = (pieces.high[k] - pieces.low[k]) / sides[k]
                reach = radii[source] / math.cos(0.5 * step)
                for i in range(sides[k]):
                    angle = pieces.low[k] + (i + 0.5) * step
                    corners[count, 0] = segments[source, 0] + reach * math.cos(angle)
                    corners[count, 1] = segments[source, 1] + reach * math.sin(angle)
                    owner[count] = k
                    count += 1
            k = follows[k]
        for i in range(first, count):
            next_one[i] = i + 1 if i + 1 < count else first
    return corners[:count], next_one[:count], owner[:count]


@kernel
def _self_intersections(arrays: SpaceArrays, follows: Index) -> Mask:
    """Which segments meet another that is not their neighbour; segment k begins at corner k."""
    segments, meets = arrays.segments, np.zeros(len(follows), np.bool_)
    for bucket in range(len(arrays.first) - 1):
        near = arrays.members[arrays.first[bucket] : arrays.first[bucket + 1]]
        for m in range(len(near)):
            ax, ay, bx, by = segments[near[m]]
            for o in range(m):
                i, j = near[m], near[o]
                if follows[i] == j or follows[j] == i:
                    continue
                cx, cy, dx, dy = segments[j]
                if max(cx, dx) < min(ax, bx) or min(cx, dx) > max(ax, bx):
                    continue
                if max(cy, dy) < min(ay, by) or min(cy, dy) > max(ay, by):
                    continue
                a, b = orient2d(cx, cy, dx, dy, ax, ay), orient2d(cx, cy, dx, dy, bx, by)
                c, d = orient2d(ax, ay, bx, by, cx, cy), orient2d(ax, ay, bx, by, dx, dy)
                apart = (a > 0.0 and b > 0.0) or (a < 0.0 and b < 0.0)
                apart = apart or (c > 0.0 and d > 0.0) or (c < 0.0 and d < 0.0)
                if not apart:
                    meets[i] = meets[j] = True
    return meets


def _offset_boundary(arrays: SpaceArrays, radii: Array, bounds: Array) -> Array | None:
    """Segments round what is left where each segment moves out by its own radius, or None."""
    pieces, good = exposed_pieces(arrays, radii)
    if not good or not len(pieces.source):
        return np.empty((0, 4)) if good else None
    if (pieces.high - pieces.low < JOIN).any():  # what just touches, but for rounding
        return None
    far, follows = cKDTree(pieces.ends[:, :2]).query(pieces.ends[:, 2:])
    if (far > JOIN).any() or len(np.unique(follows)) < len(follows):
        return None
    halvings = np.zeros(len(follows), dtype=np.int64)
    for _ in range(FINEST):
        corners, after, owner = _offset_polygons(pieces, follows, arrays.segments, radii, halvings)
        edges = np.hstack([corners, corners[after]])
        meets = _self_intersections(build_space_arrays(edges, edges[:, :2], bounds), after)
        if not meets.any():
            return edges
        finer = np.unique(owner[np.concatenate([np.flatnonzero(meets), after[meets]])])
        finer = finer[pieces.source[finer] < 0]
        if not len(finer):
            return None
        halvings[finer] += 1
    return None


def inflated_boundary(arrays: SpaceArrays, radius: float) -> Array:
    """Segments (n, 4) [m] round where a disc's centre may be; what it may not enter on their left.

    No point of what they leave is nearer than the radius to anything, and no point that keeps
    radius / cos(ARC / 2) is lost.

    Args:
        arrays: of what is free; its borders move in by exactly the radius, if that can be.
        radius: of the disc [m], above 0.

    Raises:
        ValueError: pieces do not fit together, as where segments lie nearer to each other than
            rounding can tell.
    """
    segments, bounds = arrays.segments, arrays.bounds
    x, y = segments[:, ::2], segments[:, 1::2]
    border = np.zeros(len(segments), dtype=np.bool_)
    for line, at in ((x, bounds[0]), (y, bounds[1]), (x, bounds[2]), (y, bounds[3])):
        border |= (line == at).all(axis=1)
    for shift in (0.0, SHIFT):
        radii = radius * np.where(border, 1.0 + shift, 1.0 + SHIFT)
        edges = _offset_boundary(arrays, radii, bounds + radius * np.array([1.0, 1.0, -1.0, -1.0]))
        if edges is not None:
            return edges
    raise ValueError(f"pieces of edge at {radius} m do not fit together")

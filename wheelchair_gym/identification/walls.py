"""Straight walls that scans show, and which beam of which scan hit which wall.

A wall is a line n . p = d, whose normal n = (cos a, sin a) points to the side it is seen from, and
an interval along the line.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.geometry.planar import wrap
from wheelchair_gym.sensors.settings import LaserSettings

_GROUP = 8  # beams whose ranges are averaged before a scan is split into lines
_SPREAD = 0.15  # m: greatest difference of the ranges of a group
_SPLIT = 0.06  # m: greatest distance of a point from its line
_MIN_POINTS, _MIN_LENGTH = 5, 0.5  # groups and m of a line
_MAX_TURN, _MAX_DISTANCE, _MAX_GAP = 0.12, 0.12, 0.6  # rad, m, m: of lines of one wall
_SAME, _JOINT = 0.08, 0.3  # m across, and along: of two walls that are one
_MIN_LINES = 4  # of a wall
_MARGIN = 0.10  # m at the ends of a wall, where beams hit corners
_EVERY = 10  # one of this many beams is used
MIN_COSINE = 0.3  # of the angle of incidence: flatter beams are not used


class Walls(NamedTuple):
    """Walls in one frame."""

    lines: Array  # (n, 2) rad, m: angle of the normal, and distance d
    spans: Array  # (n, 2) m: from, to, along (-sin a, cos a)


class Hits(NamedTuple):
    """Beams that hit walls, n of them."""

    scan: NDArray[np.int64]  # number of the scan
    angle: Array  # rad, of the beam in the scanner's frame
    range: Array  # m
    wall: NDArray[np.int64]  # number of the wall


def place_points(poses: Array, scan: NDArray[np.int64], angle: Array, ranges: Array) -> Array:
    """Points (n, 2) [m] that beams of scans at poses (m, 3) of the scanner hit."""
    x, y, yaw = poses[scan].T
    return np.stack([x + ranges * np.cos(yaw + angle), y + ranges * np.sin(yaw + angle)], axis=1)


def split_scan(laser: LaserSettings, ranges: Floats) -> list[Array]:
    """Lines (n, 2) [m] of averaged points in the scanner's frame, of one scan (beams,)."""
    n = laser.beams // _GROUP
    grouped = ranges[: n * _GROUP].reshape(n, _GROUP).astype(np.float64)
    angles = laser.angles[: n * _GROUP].reshape(n, _GROUP).mean(axis=1)
    with np.errstate(invalid="ignore"):
        spread = grouped.max(axis=1) - grouped.min(axis=1)
        valid = np.isfinite(spread) & (spread < _SPREAD + 0.1 * grouped[:, 0])
    mean = np.where(valid, grouped.mean(axis=1, where=np.isfinite(grouped) | ~valid[:, None]), 0.0)
    points = np.stack([mean * np.cos(angles), mean * np.sin(angles)], axis=1)
    found: list[Array] = []
    start = 0
    for k in range(1, n + 1):
        joined = k < n and valid[k] and valid[k - 1]
        joined = joined and abs(mean[k] - mean[k - 1]) < _SPREAD + 0.15 * mean[k]
        if not joined:
            _split(points[start:k], found)
            start = k
    return found


def _split(points: Array, found: list[Array]) -> None:
    """Add the straight parts of a run of points to those found (iterative end-point fit)."""
    if len(points) < _MIN_POINTS:
        return
    along = points[-1] - points[0]
    length = float(np.hypot(*along))
    if length < _MIN_LENGTH:
        return
    off = np.abs((points - points[0]) @ np.array([-along[1], along[0]])) / length
    farthest = int(np.argmax(off))
    if off[farthest] <= _SPLIT:
        found.append(points)
        return
    _split(points[: farthest + 1], found)
    _split(points[farthest:], found)


def _joined(
    line: Any, span: Any, angle: float, ends: Array, across: float, gap: float
) -> tuple[float, float] | None:
    """Span of a wall with a line of that angle and those ends (2, 2) [m]; None if it is another."""
    c, s = np.cos(line[0]), np.sin(line[0])
    low, high = sorted((ends @ (-s, c)).tolist())
    near = low < span[1] + gap and high > span[0] - gap
    off = float(np.abs(ends @ (c, s) - line[1]).max())
    if abs(wrap(angle - line[0])) < _MAX_TURN and off < across and near:
        return min(low, span[0]), max(high, span[1])
    return None


def find_walls(laser: LaserSettings, ranges: Floats, poses: Array) -> Walls:
    """Walls that scans (n, beams) at poses (n, 3) of the scanner show."""
    lines: list[tuple[float, ...]] = []  # angle, d, from, to
    for scan, (x, y, yaw) in zip(ranges, poses, strict=True):
        turn = np.array([(np.cos(yaw), -np.sin(yaw)), (np.sin(yaw), np.cos(yaw))])
        for part in split_scan(laser, scan):
            points = part @ turn.T + (x, y)
            middle = points.mean(axis=0)
            along = np.linalg.svd(points - middle)[2][0]
            normal = np.array([-along[1], along[0]])
            normal *= np.sign(normal @ ((x, y) - middle)) or 1.0
            span = sorted((points[[0, -1]] @ (-normal[1], normal[0])).tolist())
            lines.append((float(np.arctan2(normal[1], normal[0])), float(normal @ middle), *span))
    found = np.array(lines).reshape(-1, 4)
    return merge_walls(Walls(found[:, :2], found[:, 2:]), _MAX_DISTANCE, _MAX_GAP, _MIN_LINES)


def merge_walls(
    walls: Walls, across: float = _SAME, gap: float = _JOINT, min_lines: int = 1
) -> Walls:
    """Merge walls that continue each other; drop those of fewer than `min_lines` lines.

    Rough poses show a wall twice.
    """
    spans, members = walls.spans.copy(), dict[int, int]()
    for k in np.argsort(spans[:, 0] - spans[:, 1]).tolist():
        angle, d = walls.lines[k]
        along = np.array([-np.sin(angle), np.cos(angle)])
        ends = d * np.array([np.cos(angle), np.sin(angle)]) + walls.spans[k][:, None] * along
        for other in members:
            if span := _joined(walls.lines[other], spans[other], angle, ends, across, gap):
                spans[other] = span
                members[other] += 1
                break
        else:
            members[k] = 1
    kept = [k for k, count in members.items() if count >= min_lines]
    return Walls(walls.lines[kept], spans[kept])


def find_hits(
    laser: LaserSettings, ranges: Floats, poses: Array, walls: Walls, gate: float, offset: float
) -> Hits:
    """Beams of scans (n, beams) at poses (n, 3) of the scanner that hit walls, within a gate [m].

    `offset` [m] is subtracted from the ranges where points are placed; the hits hold raw ranges.
    """
    beams = np.arange(_EVERY // 2, laser.beams, _EVERY)
    picked = ranges[:, beams].astype(np.float64)
    scan, beam = np.nonzero(np.isfinite(picked) & (picked < laser.reach - 0.1))
    angle, value = laser.angles[beams][beam], picked[scan, beam]
    points = place_points(poses, scan, angle, value - offset)
    normals = np.stack([np.cos(walls.lines[:, 0]), np.sin(walls.lines[:, 0])], axis=1)
    tangents = np.stack([-normals[:, 1], normals[:, 0]], axis=1)
    off = np.abs(points @ normals.T - walls.lines[:, 1])  # (points, walls)
    along = points @ tangents.T
    seen = poses[scan, :2] @ normals.T > walls.lines[:, 1]
    inside = (along > walls.spans[:, 0] + _MARGIN) & (along < walls.spans[:, 1] - _MARGIN)
    yaw = poses[scan, 2] + angle
    steep = np.abs(np.cos(yaw[:, None] - walls.lines[:, 0])) > MIN_COSINE
    off = np.where(inside & seen & steep, off, np.inf)
    wall = np.argmin(off, axis=1)
    near = off[np.arange(len(off)), wall] < gate
    return Hits(scan[near], angle[near], value[near], wall[near])

"""A planned path as a chain of poses to follow, with the way along it."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from agents.control.rollout import TURN_LENGTH, match

Array = NDArray[np.float64]

SPACING = 0.05  # m (or m of turning) between two reference poses
SMOOTHING = 0.25  # m: half of the stretch over which corners of a plain polyline are rounded


def _resampled(path: Array, spacing: float) -> Array:
    """A polyline (n, 2) with points at most `spacing` apart, its own vertices kept."""
    parts = [path[:1]]
    for a, b in pairwise(path):
        count = max(1, math.ceil(float(np.hypot(*(b - a))) / spacing))
        parts.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(parts)


def poses_of(path: Array, heading: float) -> Array:
    """The poses (m, 3) of a path (n, 2), corners a little rounded, beginning with a pivot.

    Args:
        path: (n, 2) [m].
        heading: the chair's own yaw at the start [rad].
    """
    points = _resampled(path, SPACING)
    wide = round(SMOOTHING / SPACING)
    if len(points) > 2 * wide + 1:
        padded = np.concatenate(
            [
                2 * points[0] - points[wide:0:-1],
                points,
                2 * points[-1] - points[-2 : -wide - 2 : -1],
            ]
        )
        window = np.ones(2 * wide + 1) / (2 * wide + 1)
        points = np.column_stack([np.convolve(padded[:, k], window, "valid") for k in (0, 1)])
    steps = np.gradient(points, axis=0)
    yaw = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    turn = math.remainder(yaw[0] - heading, 2 * math.pi)
    count = math.ceil(abs(turn) * TURN_LENGTH / SPACING)
    yaw += heading + turn - yaw[0]
    pivot = np.column_stack(
        [np.repeat(points[:1], count, axis=0), heading + turn * np.arange(count) / max(1, count)]
    )
    return np.concatenate([pivot, np.column_stack([points, yaw])])


class Reference:
    """Poses (n, 3), the way s [m] along them, and how far along the chair has come."""

    def __init__(self, path: Array, pose: Array) -> None:
        if len(path) < 2:
            path = np.concatenate([path[:, :2], path[:, :2] + 1e-6])
        poses = path if path.shape[1] == 3 else poses_of(path, float(pose[2]))
        turns = np.remainder(np.diff(poses[:, 2]) + math.pi, 2 * math.pi) - math.pi
        ways = np.hypot(*np.diff(poses[:, :2], axis=0).T)
        s = np.concatenate([[0.0], np.cumsum(ways + TURN_LENGTH * np.abs(turns))])
        self.rows = np.column_stack([poses, s])  # (n, 4)
        self.at = 0

    def advance(self, pose: Array) -> float:
        """Move along to where the pose is; the distance [m] between pose and reference."""
        first = int(np.searchsorted(self.rows[:, 3], self.way - 0.2))
        self.at, off = match(pose[0], pose[1], pose[2], self.rows, first, self.way + 0.4)
        return float(off)

    @property
    def way(self) -> float:
        """How far along the chair has come [m]."""
        return float(self.rows[self.at, 3])

    @property
    def left(self) -> float:
        """How far it is to the end [m]."""
        return float(self.rows[-1, 3]) - self.way

    @property
    def ended(self) -> bool:
        """Whether the chair has come to the end."""
        return self.left < 0.1

    def ahead(self, pose: Array, far: float = 2.5) -> Array:
        """The reference poses (m, 4) of the next `far` metres, in the chair's frame."""
        ends = np.searchsorted(self.rows[:, 3], [self.way - 0.1, self.way + far])
        part = self.rows[min(ends[0], self.at) : ends[1] + 1].copy()
        c, s = math.cos(pose[2]), math.sin(pose[2])
        part[:, :2] = (part[:, :2] - pose[:2]) @ np.array([(c, -s), (s, c)])
        part[:, 2] -= pose[2]
        return part

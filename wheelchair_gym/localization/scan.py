"""One sweep of a laser as points in the chair's frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.config import InputError
from wheelchair_gym.geometry import to_world
from wheelchair_gym.sensors.settings import LaserSettings

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Scan(NamedTuple):
    """What one sweep says, in the chair's frame."""

    ends: Array  # (n, 2) m: where beams end
    hits: Mask  # (n,) at an echo; others met nothing so far
    origin: Array  # (2,) m: where beams begin
    angle_step: float  # rad between two beams

    @property
    def echoes(self) -> Array:
        """Where something was met (m, 2) [m]."""
        return self.ends[self.hits]


def beam_angles(laser: LaserSettings) -> Array:
    """Angles (beams,) [rad] of a laser's beams in the chair's frame."""
    return laser.yaw + laser.angles


def read_scan(laser: LaserSettings, ranges: ArrayLike, clear: float) -> Scan:
    """Beams of a sweep as points; those that are invalid (NaN) or too near (-inf) are left out.

    One without echo between others that have one tells nothing, either: echoes get lost.

    Args:
        laser: where it sits and looks.
        ranges: (beams,) [m]; without echo +inf, as is anything beyond the laser's reach.
        clear: up to where a beam without echo tells that nothing is there [m].

    Raises:
        InputError: there are more or fewer ranges than beams.
    """
    r = np.asarray(ranges, dtype=np.float64)
    if r.shape != (laser.beams,):
        raise InputError(f"a scan has shape {r.shape}; expected ({laser.beams},)")
    valid = r >= laser.range_min  # neither NaN nor -inf
    silent = np.pad(r > laser.reach, 1, mode="edge")
    valid &= ~silent[1:-1] | (silent[:-2] & silent[2:])
    r, angles = r[valid], beam_angles(laser)[valid]
    hits = r <= laser.reach
    r = np.where(hits, r, min(clear, laser.reach))
    origin = np.array([laser.x, laser.y])
    ends = origin + np.stack([r * np.cos(angles), r * np.sin(angles)], axis=-1)  # (n, 2)
    return Scan(ends, hits, origin, laser.fov / (laser.beams - 1))


def scan_radius(scan: Scan) -> float:
    """Distance [m] from the chair's origin to the farthest point of a scan."""
    points = np.vstack([scan.origin, scan.ends])
    return float(np.hypot(points[:, 0], points[:, 1]).max())


def echoes_in_world(scan: Scan, pose: ArrayLike) -> Array:
    """Where a scan's beams met something (m, 2) [m], in the world."""
    return to_world(scan.echoes, pose)

"""Side clearances: how far the chair's outline is from what a scan shows, and could move aside."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry import rectangle_point_gap, world_to_body
from wheelchair_gym.kinematics import arc_step, corner_speed
from wheelchair_gym.sensors.laser import median3

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

CLEARANCE_MAX = 0.5  # m: larger clearances are observed as this
NEAR = 0.2  # m from the outline, from which on proximity_speed counts
BEYOND = 0.05  # m before and behind the outline that count as beside it


@cache
def fan_poses() -> Floats:
    """Poses that a chair may take next (4 k,): on arcs of two lengths, and where it pivots.

    x and y [m], cosine and sine of the heading, of each.
    """
    arcs = [(0.5, turn) for turn in (-0.8, -0.4, 0.0, 0.4, 0.8)]
    arcs += [(1.1, turn) for turn in (-1.0, -0.5, 0.0, 0.5, 1.0)]
    arcs += [(0.0, turn) for turn in (-1.0, -0.5, 0.5, 1.0)]
    x, y, yaw = np.array([arc_step(0.0, 0.0, 0.0, way, turn, 1.0) for way, turn in arcs]).T
    return np.stack([x, y, np.cos(yaw), np.sin(yaw)], -1).astype(np.float32).ravel()


@borrowing_kernel
def proximity_speed(
    scan: Floats, directions: Array, mount: Array, outline: Array, twist: Array
) -> float:
    """Squared speed [m2/s2] of the outline's fastest corner, less the farther off all is.

    All of it counts where the scan shows something at the outline, none where nothing is `NEAR`.
    Beams are filtered as by `side_clearance`.
    """
    ahead, aside = max(outline[0], outline[1]), outline[2]
    near = math.hypot(mount[0], mount[1]) + math.hypot(ahead, aside) + NEAR
    least = NEAR
    for i in range(1, scan.shape[0] - 1, 2):
        r = median3(scan[i - 1], scan[i], scan[i + 1])
        if 0.0 < r < near:
            x, y = mount[0] + r * directions[i, 0], mount[1] + r * directions[i, 1]
            least = min(least, rectangle_point_gap(x, y, outline))
    return (1.0 - least / NEAR) * corner_speed(twist[0], twist[1], ahead, aside) ** 2


@borrowing_kernel
def side_clearance(
    scan: Floats, directions: Array, mount: Array, outline: Array, poses: Floats, out: Floats
) -> None:
    """Clearances (2 + 2 k,) [m] left and right of the outline, where it stands and at poses ahead.

    Of each two beams the median of three neighbours counts, so that neither a lost echo nor the
    noise of one beam makes a clearance small. What lies within the outline makes it negative.
    """
    count, side = poses.shape[0] // 4, outline[2]
    low, high = -outline[1] - BEYOND, outline[0] + BEYOND
    far = 0.0  # m: to the farthest pose
    for k in range(count):
        far = max(far, math.hypot(poses[4 * k], poses[4 * k + 1]))
    near = far + math.hypot(mount[0], mount[1]) + math.hypot(max(high, -low), side + CLEARANCE_MAX)
    for k in range(out.shape[0]):
        out[k] = CLEARANCE_MAX
    for i in range(1, scan.shape[0] - 1, 2):
        r = median3(scan[i - 1], scan[i], scan[i + 1])
        if not 0.0 < r < near:  # too near is -inf, no echo is inf; NaN is neither
            continue
        x, y = mount[0] + r * directions[i, 0], mount[1] + r * directions[i, 1]
        for k in range(count + 1):
            along, aside = x, y
            if k > 0:
                at = 4 * (k - 1)
                dx, dy = x - poses[at], y - poses[at + 1]
                cosine, sine = poses[at + 2], poses[at + 3]
                along, aside = world_to_body(cosine, sine, dx, dy)
            if low <= along <= high:
                place = 2 * k + (0 if aside >= 0.0 else 1)
                out[place] = min(out[place], np.float32(abs(aside) - side))

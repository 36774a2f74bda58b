"""Gaps: how far the chair's outline is from what a scan shows, and could move aside."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.geometry import Footprint
from wheelchair_gym.kernel import borrowing_kernel, kernel
from wheelchair_gym.sensing.settings import LaserSettings

Floats = NDArray[np.float32]

GAP_REACH = 0.5  # m: wider gaps are told as this
NEAR = 0.2  # m from the outline, from which on haste counts
BEYOND = 0.05  # m before and behind the outline that count as beside it
FRAME = np.dtype(
    [
        ("x", "f8"),  # m: of the laser, from the drive axle's centre
        ("y", "f8"),
        ("front", "f8"),  # m
        ("rear", "f8"),
        ("half_width", "f8"),
    ],
    align=True,
)


def frame_of(footprint: Footprint, laser: LaserSettings) -> NDArray[np.void]:
    """The outline, and where its laser stands (1,), a record of FRAME."""
    frame = np.zeros(1, FRAME)
    frame[0] = laser.x, laser.y, footprint.front, footprint.rear, footprint.half_width
    return frame


def directions_of(laser: LaserSettings) -> NDArray[np.float64]:
    """Of each beam in the chair's frame (beams, 2): cosine and sine."""
    angles = laser.yaw + np.linspace(-laser.fov / 2, laser.fov / 2, laser.beams)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


@kernel
def _middle(a: float, b: float, c: float) -> float:
    """The median; of what is lost or too near (infinite) it is so only where two are."""
    return max(min(a, b), min(max(a, b), c))


@borrowing_kernel
def haste(scan: Floats, directions: NDArray[np.float64], frame: Any, v: float, w: float) -> float:
    """Squared speed [m2/s2] of the outline's fastest corner, less the farther off all is.

    All of it counts where the scan shows something at the outline, none where nothing is `NEAR`.
    Beams are looked at as by `gaps`.

    Args:
        scan: (beams,) as the laser reports it [m].
        directions: see `directions_of`.
        frame: record of FRAME.
        v: speed [m/s].
        w: turn [rad/s].
    """
    reach = max(frame.front, frame.rear)
    near, least = 2.0 * reach + NEAR, NEAR
    for i in range(1, scan.shape[0] - 1, 2):
        r = _middle(scan[i - 1], scan[i], scan[i + 1])
        if not 0.0 < r < near:
            continue
        x, y = frame.x + r * directions[i, 0], frame.y + r * directions[i, 1]
        dx = max(x - frame.front, -frame.rear - x, 0.0)
        dy = max(abs(y) - frame.half_width, 0.0)
        if dx < least and dy < least:
            least = min(least, math.hypot(dx, dy))
    speed = math.hypot(abs(v) + abs(w) * frame.half_width, abs(w) * reach)
    return (1.0 - least / NEAR) * speed * speed


@borrowing_kernel
def gaps(
    scan: Floats, directions: NDArray[np.float64], frame: Any, poses: Floats, out: Floats
) -> None:
    """Gaps to the left and to the right of the outline, where it stands and at poses ahead.

    Of each two beams the median of three neighbours counts, so that neither a lost echo nor the
    noise of one beam makes a gap narrow. What lies within the outline makes its gap negative.

    Args:
        scan: (beams,) as the laser reports it [m].
        directions: see `directions_of`.
        frame: record of FRAME.
        poses: (4 k,) x and y [m], cosine and sine of the heading, of each, in the chair's frame.
        out: (2 + 2 k,) [m], `-half_width` to `GAP_REACH`.
    """
    count, side = poses.shape[0] // 4, frame.half_width
    low, high, near = -frame.rear - BEYOND, frame.front + BEYOND, frame.front + frame.rear
    for k in range(count):
        near = max(near, abs(poses[4 * k]) + abs(poses[4 * k + 1]) + frame.front + frame.rear)
    for k in range(out.shape[0]):
        out[k] = GAP_REACH
    for i in range(1, scan.shape[0] - 1, 2):
        r = _middle(scan[i - 1], scan[i], scan[i + 1])
        if not 0.0 < r < near:  # too near is -inf, no echo is inf; NaN is neither
            continue
        x, y = frame.x + r * directions[i, 0], frame.y + r * directions[i, 1]
        for k in range(count + 1):
            along, aside = x, y
            if k > 0:
                at = 4 * (k - 1)
                dx, dy = x - poses[at], y - poses[at + 1]
                cosine, sine = poses[at + 2], poses[at + 3]
                along, aside = cosine * dx + sine * dy, cosine * dy - sine * dx
            if low <= along <= high:
                place = 2 * k + (0 if aside >= 0.0 else 1)
                out[place] = min(out[place], np.float32(abs(aside) - side))

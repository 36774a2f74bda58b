"""The laser: exact ranges on segments and discs, then noise, then what a scanner reports.

Each segment is rasterised onto its own interval of beams. In the sensor's frame, along the line
through a and b with e = b - a and c = a x e, the inverse range is linear in the beam's direction:
1/r = (e_y/c) cos - (e_x/c) sin. So a scan takes no division and no trigonometry per beam.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.kernel import kernel
from wheelchair_gym.sensing.noise import LASER, LASER_BIAS, bits, hash32, normal
from wheelchair_gym.sensing.settings import LaserSettings

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

# Odd polynomial of the arc tangent on [0, 1] (Abramowitz and Stegun 4.4.49), highest power first.
_ARC = (
    0.0218612286,
    -0.0559098861,
    0.0964200441,
    -0.1390853351,
    0.1994653599,
    -0.3332985605,
    0.9999993329,
)
_EDGE = 2e-6  # rad: beams this near to a segment's end count as hits, so that joints have no gap
_MEAN = np.float32(2.0 * 65535.0)
_PER_COUNT = np.float32(1.0 / math.sqrt(4.0 * (65536.0**2 - 1.0) / 12.0))


class LaserArrays(NamedTuple):
    """What kernels need to know of a laser."""

    cosine: Floats  # (beams,) of each beam's angle in the sensor's frame
    sine: Floats  # (beams,)
    first: float  # rad: angle of beam 0
    per_angle: float  # beams per rad
    mount: Array  # (3,) m, m, rad in the chair's frame
    reach: float  # m
    nearest: float  # m
    sigma: float  # m
    no_echo: float
    bias: float  # m

    @classmethod
    def of(cls, laser: LaserSettings, noise: bool) -> LaserArrays:
        """Arrays of settings; without noise all errors are zero."""
        angles = np.linspace(-laser.fov / 2, laser.fov / 2, laser.beams)
        share = 1.0 if noise else 0.0
        return cls(
            np.cos(angles).astype(np.float32),
            np.sin(angles).astype(np.float32),
            -laser.fov / 2,
            (laser.beams - 1) / laser.fov,
            np.array([laser.x, laser.y, laser.yaw]),
            laser.reach,
            laser.nearest,
            laser.sigma * share,
            laser.no_echo * share,
            laser.bias * share,
        )


@kernel
def bearing(y: float, x: float) -> float:
    """The angle of (x, y) [rad] to 1e-7: a polynomial, several times as fast as atan2."""
    ax, ay = abs(x), abs(y)
    far, near = (ax, ay) if ax > ay else (ay, ax)
    a = near / (far if far > 0.0 else 1.0)
    s = a * a
    r = -0.0040540580
    for c in _ARC:
        r = r * s + c
    r *= a
    r = 0.5 * math.pi - r if ay > ax else r
    r = math.pi - r if x < 0.0 else r
    return -r if y < 0.0 else r


@kernel
def _span(out: Floats, a: float, b: float, cosine: Floats, sine: Floats, i0: int, i1: int) -> None:
    """Nearest of what beams i0..i1 saw and the line whose inverse range is a cos + b sin."""
    af, bf = np.float32(a), np.float32(b)
    # Unsigned, so that no index can wrap round: only then is the loop vectorised.
    for i in range(np.uint64(i0), np.uint64(max(i0, i1))):
        inverse = af * cosine[i] + bf * sine[i]
        out[i] = inverse if inverse > out[i] else out[i]


@kernel
def exact_scan(
    laser: LaserArrays, x: float, y: float, yaw: float, walls: Array, discs: Array, out: Floats
) -> None:
    """Exact ranges of one scan.

    Args:
        laser: the sensor.
        x: pose of the sensor in the world [m], then y [m] and yaw [rad].
        y: see x.
        yaw: see x.
        walls: segments (n, 4) [m].
        discs: (m, 3) [m].
        out: (beams,) ranges [m], at most the reach.
    """
    beams = out.shape[0]
    nothing = np.float32(1.0 / laser.reach)
    for i in range(beams):
        out[i] = nothing
    c, s = math.cos(yaw), math.sin(yaw)
    square = laser.reach * laser.reach
    for k in range(walls.shape[0]):
        x0, y0 = walls[k, 0] - x, walls[k, 1] - y
        x1, y1 = walls[k, 2] - x, walls[k, 3] - y
        ex, ey = x1 - x0, y1 - y0
        length = ex * ex + ey * ey
        t = -(x0 * ex + y0 * ey)
        t = 0.0 if t < 0.0 else (t / length if t < length else 1.0)
        qx, qy = x0 + t * ex, y0 + t * ey
        if not qx * qx + qy * qy < square:
            continue
        ax, ay = c * x0 + s * y0, c * y0 - s * x0
        bx, by = c * x1 + s * y1, c * y1 - s * x1
        cross = ax * by - ay * bx
        if abs(cross) < 1e-12:  # seen edge-on
            continue
        inverse = 1.0 / cross
        a, b = (by - ay) * inverse, (ax - bx) * inverse
        low, high = bearing(ay, ax), bearing(by, bx)
        if cross < 0.0:
            low, high = high, low
        i0 = max(0, math.ceil((low - _EDGE - laser.first) * laser.per_angle))
        i1 = min(beams - 1, math.floor((high + _EDGE - laser.first) * laser.per_angle)) + 1
        if high < low:  # across the seam behind the sensor
            _span(out, a, b, laser.cosine, laser.sine, i0, beams)
            i0 = 0
        _span(out, a, b, laser.cosine, laser.sine, i0, i1)
    for k in range(discs.shape[0]):
        x0, y0, radius = discs[k, 0] - x, discs[k, 1] - y, discs[k, 2]
        far = x0 * x0 + y0 * y0
        rest = far - radius * radius
        if rest > square + 2.0 * laser.reach * radius:
            continue
        if rest <= 0.0:
            for i in range(beams):
                out[i] = np.float32(np.inf)
            continue
        ax, ay = c * x0 + s * y0, c * y0 - s * x0
        middle, half = math.atan2(ay, ax), math.asin(radius / math.sqrt(far))
        for turn in range(-1, 2):
            low = middle - half + 2.0 * math.pi * turn - laser.first
            i0 = max(0, math.ceil(low * laser.per_angle))
            i1 = min(beams - 1, math.floor((low + 2.0 * half) * laser.per_angle)) + 1
            for i in range(i0, i1):
                along = ax * laser.cosine[i] + ay * laser.sine[i]
                inside = along * along - rest
                # The near root of r^2 - 2 along r + rest = 0, as its inverse.
                hit = np.float32((along + math.sqrt(inside if inside > 0.0 else 0.0)) / rest)
                out[i] = hit if hit > out[i] else out[i]
    for i in range(beams):
        out[i] = np.float32(1.0) / out[i]


@kernel
def report(laser: LaserArrays, key: np.uint64, step: int, out: Floats) -> None:
    """Turn exact ranges (beams,) into what the scanner reports, in place.

    Bias of the episode, noise, lost echoes; no echo within reach is +inf, too near is -inf.
    """
    seed = bits(key, step, LASER, 0)
    low, high = np.uint32(seed), np.uint32(seed >> np.uint64(32))
    bias = np.float32(laser.bias * normal(key, 0, LASER_BIAS, 0))
    scale = np.float32(laser.sigma) * _PER_COUNT
    lost = np.uint32(laser.no_echo * 65535.0)
    reach, nearest = np.float32(laser.reach), np.float32(laser.nearest)
    half, none = np.uint32(0xFFFF), np.float32(np.inf)
    for i in range(out.shape[0]):
        first = hash32(np.uint32(low + np.uint32(i) * np.uint32(0x9E3779B9)))
        second = hash32(np.uint32(first ^ high))
        third = hash32(np.uint32(second + low))
        total = (first & half) + (first >> np.uint32(16)) + (second & half)
        total = total + (second >> np.uint32(16))
        exact = out[i]
        noisy = exact + bias + (np.float32(total) - _MEAN) * scale
        noisy = -none if noisy < nearest else noisy
        gone = exact >= reach or noisy > reach or np.uint32(third & half) < lost
        out[i] = none if gone else noisy


@kernel
def scan(
    laser: LaserArrays,
    pose: Array,
    walls: Array,
    discs: Array,
    key: np.uint64,
    step: int,
    out: Floats,
) -> None:
    """One scan (beams,) [m] of a chair at a pose (3,) [m, m, rad], as its laser reports it."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x = pose[0] + c * laser.mount[0] - s * laser.mount[1]
    y = pose[1] + s * laser.mount[0] + c * laser.mount[1]
    exact_scan(laser, x, y, pose[2] + laser.mount[2], walls, discs, out)
    report(laser, key, step, out)

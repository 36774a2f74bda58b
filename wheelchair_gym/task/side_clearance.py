"""Side clearances: how far the chair's outline is from what a scan shows, and could move aside."""

import math
from functools import cache

import numpy as np

from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.compiled.address import doubles_at, floats_at, on_stack
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.compiled.simd import bits_of_double, double_of_bits
from wheelchair_gym.geometry.kinematics import arc_step, corner_speed
from wheelchair_gym.geometry.outline import offsets_from_rectangle, rectangle_point_gap
from wheelchair_gym.geometry.planar import world_to_body
from wheelchair_gym.sensors.laser import median3, shown_range

CLEARANCE_MAX = 0.5  # m: larger clearances are observed as this
NEAR = 0.2  # m from the outline, at which `proximity_speed` begins to count
_NONE = np.float32(np.inf)
_MORE = 1.0 + 1e-9  # beyond rounding
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
def _find_points(scan: Floats, directions: Array, mount: Array, xs: Array, ys: Array) -> None:
    """Find the points [m] that a scan shows, in the chair's frame: of each two beams, (beams / 2,).

    The median of three neighbouring beams counts. What is too near (-inf) is at the laser; the
    place is not finite where there is no echo (+inf) or none that is valid (NaN).
    """
    n = xs.shape[0]
    ranges = floats_at(on_stack(4 * n), n)
    for j in range(np.uint64(n)):
        ranges[j] = shown_range(median3(scan[2 * j], scan[2 * j + 1], scan[2 * j + 2]))
    mount_x, mount_y = mount[0], mount[1]
    for j in range(np.uint64(n)):
        r, i = ranges[j], 2 * j + np.uint64(1)
        x, y = mount_x + r * directions[i, 0], mount_y + r * directions[i, 1]
        xs[j], ys[j] = x if r < _NONE else math.inf, y if r < _NONE else math.inf


@borrowing_kernel
def proximity_speed(
    scan: Floats, directions: Array, mount: Array, outline: Array, twist: Array
) -> float:
    """Compute the squared speed [m2/s2] of the outline's fastest corner, times a weight.

    The weight is 1 where the scan shows something at the outline, and falls linearly to 0 at
    `NEAR`. Beams are filtered as by `side_clearance`.
    """
    ahead, aside = max(outline[0], outline[1]), outline[2]
    n = max(0, scan.shape[0] - 1) // 2
    xs, ys = doubles_at(on_stack(8 * n), n), doubles_at(on_stack(8 * n), n)
    squares = doubles_at(on_stack(8 * n), n)
    _find_points(scan, directions, mount, xs, ys)
    front, back, half = outline[0], -outline[1], outline[2]
    nearest = bits_of_double(NEAR * NEAR)
    for j in range(np.uint64(n)):
        dx, dy = offsets_from_rectangle(xs[j], ys[j], front, back, half)
        squares[j] = square = dx * dx + dy * dy
        bits = bits_of_double(square)
        nearest = bits if bits < nearest else nearest
    minimum, limit = NEAR, _MORE * double_of_bits(nearest)
    for j in range(n):
        if squares[j] <= limit:
            minimum = min(minimum, rectangle_point_gap(xs[j], ys[j], outline))
    return (1.0 - minimum / NEAR) * corner_speed(twist[0], twist[1], ahead, aside) ** 2


@borrowing_kernel
def _min_asides(
    xs: Array, ys: Array, low: float, high: float, x: float, y: float, c: float, s: float
) -> tuple[float, float]:
    """How near [m] to the axis of a pose points are, left and right of it, between low and high.

    `c` and `s` are cosine and sine of the pose's heading; +inf where there is no point.
    """
    none = bits_of_double(math.inf)
    left = right = none
    for j in range(np.uint64(xs.shape[0])):
        along, aside = world_to_body(c, s, xs[j] - x, ys[j] - y)
        size = bits_of_double(abs(aside))
        size = size if (low <= along) & (along <= high) else none
        on_left, on_right = size if aside >= 0.0 else none, none if aside >= 0.0 else size
        left = on_left if on_left < left else left
        right = on_right if on_right < right else right
    return double_of_bits(left), double_of_bits(right)


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
    n = max(0, scan.shape[0] - 1) // 2
    xs, ys = doubles_at(on_stack(8 * n), n), doubles_at(on_stack(8 * n), n)
    _find_points(scan, directions, mount, xs, ys)
    for k in range(count + 1):
        x, y, c, s = 0.0, 0.0, 1.0, 0.0
        if k > 0:
            at = 4 * (k - 1)
            x, y = float(poses[at]), float(poses[at + 1])
            c, s = float(poses[at + 2]), float(poses[at + 3])
        left, right = _min_asides(xs, ys, low, high, x, y, c, s)
        out[2 * k] = min(np.float32(CLEARANCE_MAX), np.float32(left - side))
        out[2 * k + 1] = min(np.float32(CLEARANCE_MAX), np.float32(right - side))

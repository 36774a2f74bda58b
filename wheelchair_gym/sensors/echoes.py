"""Geometry of echoes: ends of segments as a sensor sees them, round things, and what hides them.

It holds an arc tangent that vectorises.
"""

import math
from typing import Any

import numpy as np

from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.geometry.planar import body_to_world, world_to_body

_F = np.float32
_ZERO, _TINY = _F(0.0), _F(1e-30)
_MARGIN = 1e-6  # m: more than rounding
_GAP = 1e-4  # m: a sensor so near a surface touches it
_QUARTER, _HALF = _F(0.5 * math.pi), _F(math.pi)
# Odd polynomial of the arc tangent on [0, 1] (Abramowitz and Stegun 4.4.49), lowest power first.
_A1, _A3, _A5, _A7 = _F(0.9999993329), _F(-0.3332985605), _F(0.1994653599), _F(-0.1390853351)
_A9, _A11, _A13, _A15 = _F(0.0964200441), _F(-0.0559098861), _F(0.0218612286), _F(-0.0040540580)


@inlined
def atan2_f32(y: np.float32, x: np.float32) -> np.float32:
    """The angle of (x, y) [rad] to 3e-7: a polynomial, so that it vectorises."""
    ax, ay = abs(x), abs(y)
    far = ax if ax > ay else ay
    near = ay if ax > ay else ax
    a = near / (far if far > _TINY else _TINY)
    s = a * a
    r = ((_A15 * s + _A13) * s + _A11) * s + _A9
    r = (((r * s + _A7) * s + _A5) * s + _A3) * s + _A1
    r = r * a
    r = _QUARTER - r if ay > ax else r
    r = _HALF - r if x < _ZERO else r
    return -r if y < _ZERO else r


@borrowing_kernel
def relative_endpoints(walls: Array, x: float, y: float, ends: Floats) -> None:
    """Ends of the segments (n, 4) [m], seen from (x, y): ends (2 n, 2), flat."""
    flat = walls.reshape(walls.size)
    for k in range(np.uint64(2 * walls.shape[0])):
        ends[2 * k] = _F(flat[2 * k] - x)
        ends[2 * k + 1] = _F(flat[2 * k + 1] - y)


@inlined
def occludes(
    qx: float, qy: float, ax: float, ay: float, bx: float, by: float, x: float, y: float
) -> bool:
    """Whether the segment a-b stands between (x, y) and the point (x + qx, y + qy)."""
    ex, ey = bx - ax, by - ay
    cross = qx * ey - qy * ex
    if cross == 0.0:
        return False
    t = ((ax - x) * ey - (ay - y) * ex) / cross
    u = ((ax - x) * qy - (ay - y) * qx) / cross
    return 0.0 < t < 1.0 - 1e-9 and 0.0 <= u <= 1.0


@borrowing_kernel
def occluded_by_discs(qx: float, qy: float, discs: Array, x: float, y: float) -> bool:
    """Whether a disc stands between (x, y) and the point (x + qx, y + qy)."""
    for k in range(discs.shape[0]):
        x0, y0, radius = discs[k, 0] - x, discs[k, 1] - y, discs[k, 2]
        square = qx * qx + qy * qy
        along = x0 * qx + y0 * qy
        inside = along * along - square * (x0 * x0 + y0 * y0 - radius * radius)
        if inside > 0.0:
            t = (along - math.sqrt(inside)) / square
            if 0.0 < t < 1.0 - 1e-9:
                return True
    return False


@borrowing_kernel
def reach_of_mount(x: float, y: float, dx: float, dy: float, walls: Array, discs: Array) -> float:
    """Return the share of the way from a point of the chair to a mount that ends at a surface.

    It is 1 where nothing is between them. Contact leaves a sensor at the chair's edge on a surface,
    or a little behind it, from where it would see through the wall.
    """
    # Nearly always nothing is near that way: boxes round both show it, in loops that vectorise.
    left, right = min(x, x + dx) - 2.0 * _GAP, max(x, x + dx) + 2.0 * _GAP
    low, high = min(y, y + dy) - 2.0 * _GAP, max(y, y + dy) + 2.0 * _GAP
    ends, rounds, near = walls.reshape(walls.size), discs.reshape(discs.size), 0
    for k in range(np.uint64(walls.shape[0])):
        ax, ay, bx, by = ends[4 * k], ends[4 * k + 1], ends[4 * k + 2], ends[4 * k + 3]
        apart = (ax < left) & (bx < left) | (ax > right) & (bx > right)
        near += not (apart | (ay < low) & (by < low) | (ay > high) & (by > high))
    for k in range(np.uint64(discs.shape[0])):
        ax, ay, r = rounds[3 * k], rounds[3 * k + 1], rounds[3 * k + 2]
        near += (ax + r > left) & (ax - r < right) & (ay + r > low) & (ay - r < high)
    length = math.hypot(dx, dy)
    if near == 0 or length == 0.0:
        return 1.0
    gap = _GAP / length
    reached = end = 1.0 + gap
    for k in range(walls.shape[0]):
        ax, ay = walls[k, 0] - x, walls[k, 1] - y
        ex, ey = walls[k, 2] - walls[k, 0], walls[k, 3] - walls[k, 1]
        cross = dx * ey - dy * ex
        t, u = ax * ey - ay * ex, ax * dy - ay * dx
        side = 1.0 if cross > 0.0 else -1.0
        size = abs(cross)
        hit = (side * t >= 0.0) & (side * t < reached * size) & (0.0 <= side * u <= size)
        reached = side * t / size if hit else reached
    for k in range(discs.shape[0]):
        ax, ay, radius = discs[k, 0] - x, discs[k, 1] - y, discs[k, 2]
        along, beside = (ax * dx + ay * dy) / length, (ax * dy - ay * dx) / length
        if abs(beside) < radius and along > 0.0:
            t = max(0.0, along - math.sqrt(radius * radius - beside * beside)) / length
            reached = min(reached, t)
    return max(0.0, reached - gap) if reached < end else 1.0


@inlined
def is_echo_lost(incidence: float, ranger: Any, draw: float) -> bool:
    """Return True if a ranger (of RANGER) loses an echo at this incidence.

    It never does below `loss_from`, and always above `loss_at`.
    """
    return bool(draw < (incidence - ranger.loss_from) / (ranger.loss_at - ranger.loss_from))


@borrowing_kernel
def echo_of_discs(
    x: float, y: float, c: float, s: float, ranger: Any, draw: float, walls: Array, discs: Array
) -> float:
    """Compute the distance [m] of the first echo of a disc that no wall hides; +inf if none."""
    slope, reach, best = ranger.slope, ranger.reach, math.inf
    half, edge = math.atan(slope), math.sqrt(1.0 + slope * slope)
    for k in range(discs.shape[0]):
        x0, y0, radius = discs[k, 0] - x, discs[k, 1] - y, discs[k, 2]
        ahead, left = world_to_body(c, s, x0, y0)
        if abs(left) - slope * ahead > edge * radius + _MARGIN:  # beside the cone or behind it
            continue
        far = math.sqrt(x0 * x0 + y0 * y0)
        if far - radius >= min(best, reach):
            continue
        if far <= radius:
            return 0.0
        bearing = math.atan2(left, ahead)
        direction = min(half, max(-half, bearing))
        aside = abs(bearing - direction)
        off = far * math.sin(aside)
        if aside >= 0.5 * math.pi or off > radius:
            continue
        distance = far * math.cos(aside) - math.sqrt(radius * radius - off * off)
        silent = is_echo_lost(math.asin(off / radius), ranger, draw)
        if silent or distance >= min(best, reach):
            continue
        ahead, left = distance * math.cos(direction), distance * math.sin(direction)
        qx, qy = body_to_world(c, s, ahead, left)
        hidden = occluded_by_discs(qx, qy, discs, x, y)
        for j in range(walls.shape[0]):
            if hidden:
                break
            hidden = occludes(qx, qy, walls[j, 0], walls[j, 1], walls[j, 2], walls[j, 3], x, y)
        if not hidden:
            best = distance
    return best

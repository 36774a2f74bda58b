"""The footprint, and its distances and overlaps."""

import math

import numpy as np
from numpy.typing import ArrayLike

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined, kernel
from wheelchair_gym.compiled.simd import bits_of_double, double_of_bits
from wheelchair_gym.geometry.planar import point_segment_distance, world_to_body


@settings
class Footprint:
    """The chair's outline: a rectangle; the origin of its frame is the drive axle's centre."""

    front: float = setting(
        default=0.70, unit="m", low=0.01, source="1.00 m in all; powered chairs: 0.81 to 1.02 m"
    )
    """Distance from the drive axle to the front edge."""
    rear: float = setting(default=0.30, unit="m", low=0.01)
    """Distance from the drive axle to the rear edge."""
    half_width: float = setting(
        default=0.31, unit="m", low=0.01, source="powered chairs are 0.61 to 0.65 m wide"
    )
    """Half of the width."""

    @property
    def corners(self) -> Array:
        """Corners (4, 2) [m] in the chair's frame, counter-clockwise from rear right."""
        f, r, h = self.front, self.rear, self.half_width
        return np.array([(-r, -h), (f, -h), (f, h), (-r, h)])

    @property
    def reach(self) -> float:
        """Distance from the axle's centre to the farthest corner [m]."""
        return math.hypot(max(self.front, self.rear), self.half_width)

    @property
    def array(self) -> Array:
        """(front, rear, half width) [m], as kernels take it."""
        return np.array([self.front, self.rear, self.half_width])


@inlined
def offsets_from_rectangle(
    px: float, py: float, front: float, back: float, half: float
) -> tuple[float, float]:
    """Distances [m] of a point beyond a rectangle from x = back to front, ahead and aside; or 0."""
    dx = px - front if px - front > back - px else back - px
    dy = abs(py) - half
    return dx if dx > 0.0 else 0.0, dy if dy > 0.0 else 0.0


@kernel
def rectangle_point_gap(px: float, py: float, footprint: Array) -> float:
    """Distance [m] from a point in the footprint's own frame to the footprint; 0 inside."""
    dx, dy = offsets_from_rectangle(px, py, footprint[0], -footprint[1], footprint[2])
    return math.hypot(dx, dy)


@kernel
def outline_segment_gap(footprint: Array, px: float, py: float, qx: float, qy: float) -> float:
    """Distance [m] of a segment p-q in a footprint's own frame from it; 0 where they overlap."""
    front, back, half = footprint[0], -footprint[1], footprint[2]
    # Liang and Barsky: the part of the segment inside the rectangle is t0..t1.
    t0, t1 = 0.0, 1.0
    ex, ey = qx - px, qy - py
    overlap = True
    for k in range(4):
        if k == 0:
            step, space = -ex, px - back
        elif k == 1:
            step, space = ex, front - px
        elif k == 2:
            step, space = -ey, py + half
        else:
            step, space = ey, half - py
        if step == 0.0:
            if space < 0.0:
                overlap = False
        elif step < 0.0:
            t0 = max(t0, space / step)
        else:
            t1 = min(t1, space / step)
    if overlap and t0 <= t1:
        return 0.0
    # Apart: the nearest pair has an end of the segment, or a corner of the rectangle.
    gap = min(rectangle_point_gap(px, py, footprint), rectangle_point_gap(qx, qy, footprint))
    for k in range(4):
        corner_x = front if k < 2 else back
        corner_y = half if k % 2 == 0 else -half
        gap = min(gap, point_segment_distance(corner_x, corner_y, px, py, qx, qy))
    return gap


@kernel
def rectangle_segment_gap(
    x: float, y: float, yaw: float, footprint: Array, ax: float, ay: float, bx: float, by: float
) -> float:
    """Distance [m] between a footprint (3,) at a pose and the segment a-b; 0 where they overlap."""
    c, s = math.cos(yaw), math.sin(yaw)
    px, py = world_to_body(c, s, ax - x, ay - y)
    qx, qy = world_to_body(c, s, bx - x, by - y)
    return outline_segment_gap(footprint, px, py, qx, qy)


@kernel
def footprint_clearance(
    x: float, y: float, yaw: float, footprint: Array, walls: Array, discs: Array, reach: float
) -> float:
    """Distance [m] from a footprint (3,) at a pose to the nearest wall or disc, at most `reach`.

    Walls are segments (n, 4) [m], discs (m, 3) [m]: x, y, radius.
    """
    gap = reach
    outer = math.hypot(max(footprint[0], footprint[1]), footprint[2])
    for k in range(walls.shape[0]):
        ax, ay, bx, by = walls[k, 0], walls[k, 1], walls[k, 2], walls[k, 3]
        ex, ey = bx - ax, by - ay
        along = (x - ax) * ex + (y - ay) * ey
        square = ex * ex + ey * ey
        t = 0.0 if along <= 0.0 else (along / square if along < square else 1.0)
        dx, dy, far = ax + t * ex - x, ay + t * ey - y, gap + outer
        if dx * dx + dy * dy > far * far:  # farther from the axle than any that would count
            continue
        gap = min(gap, rectangle_segment_gap(x, y, yaw, footprint, ax, ay, bx, by))
    c, s = math.cos(yaw), math.sin(yaw)
    for k in range(discs.shape[0]):
        dx, dy, radius = discs[k, 0] - x, discs[k, 1] - y, discs[k, 2]
        far = gap + outer + radius
        if dx * dx + dy * dy > far * far:
            continue
        px, py = world_to_body(c, s, dx, dy)
        distance = rectangle_point_gap(px, py, footprint)
        gap = min(gap, max(0.0, distance - radius))
    return gap


def best_clearance_heading(
    place: ArrayLike, outline: Footprint, walls: Array, discs: Array
) -> tuple[float, float]:
    """The heading [rad] with the largest clearance of an outline at a place (2,), and that [m].

    Walls are segments (n, 4) [m], discs (m, 3) [m]: x, y, radius.
    """
    x, y = np.asarray(place, dtype=np.float64)[:2]
    yaws = np.radians(np.arange(0.0, 360.0, 5.0))
    gaps = [footprint_clearance(x, y, yaw, outline.array, walls, discs, 2.0) for yaw in yaws]
    best = int(np.argmax(gaps))
    return float(yaws[best]), float(gaps[best])


@kernel
def clearance_to_points(
    x: float, y: float, yaw: float, footprint: Array, points: Array, interest: float
) -> float:
    """Distance [m] from a footprint at a pose to the nearest of points, at most `interest`.

    Points (k, 3) hold x, y and a lower bound of the distance from the origin, in rising order.
    """
    c, s = math.cos(yaw), math.sin(yaw)
    middle = 0.5 * (footprint[0] - footprint[1])
    half_length, half_width = 0.5 * (footprint[0] + footprint[1]), footprint[2]
    mx, my = x + c * middle, y + s * middle
    reach = math.hypot(x, y) + interest
    reach += math.hypot(max(footprint[0], footprint[1]), half_width)
    best = interest * interest
    for k in range(points.shape[0]):
        if points[k, 2] > reach:
            break
        px, py = world_to_body(c, s, points[k, 0] - mx, points[k, 1] - my)
        dx, dy = max(abs(px) - half_length, 0.0), max(abs(py) - half_width, 0.0)
        best = min(best, dx * dx + dy * dy)
    return math.sqrt(best)


@kernel
def signed_clearance(px: float, py: float, footprint: Array) -> float:
    """Distance [m] from a point in the footprint's own frame to its edge; below 0 inside."""
    dx = max(px - footprint[0], -footprint[1] - px)
    dy = abs(py) - footprint[2]
    if dx > 0.0 and dy > 0.0:
        return math.sqrt(dx * dx + dy * dy)
    return float(max(dx, dy))


@borrowing_kernel
def signed_gap(
    points: Array, count: int, footprint: Array, x: float, y: float, yaw: float
) -> float:
    """Distance [m] of a footprint at a pose to the nearest of `count` points (n, 2); < 0 inside.

    Infinite without points. The same as the least `signed_clearance`, found in vectors.
    """
    c, s = math.cos(yaw), math.sin(yaw)
    front, rear, half = footprint[0], -footprint[1], footprint[2]
    nearest = bits_of_double(math.inf)
    for k in range(np.uint64(count)):
        px, py = world_to_body(c, s, points[k, 0] - x, points[k, 1] - y)
        dx, dy = offsets_from_rectangle(px, py, front, rear, half)
        bits = bits_of_double(dx * dx + dy * dy)
        nearest = bits if bits < nearest else nearest
    square = double_of_bits(nearest)
    if square > 0.0:
        return math.sqrt(square)
    minimum = math.inf
    for k in range(count):
        px, py = world_to_body(c, s, points[k, 0] - x, points[k, 1] - y)
        minimum = min(minimum, signed_clearance(px, py, footprint))
    return minimum


@kernel
def required_clearance(
    margin: float, headway: float, speed: float, turn: float, lever: float, creep: float
) -> float:
    """Clearance [m] required around a footprint: `margin`, and more with its speed."""
    return margin + headway * max(0.0, speed + 0.5 * lever * turn - creep)

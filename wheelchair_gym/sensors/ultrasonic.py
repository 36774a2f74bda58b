"""Ultrasonic rangers: the first echo in a cone, exact on segments and discs, then its errors.

Every surface answers from its nearest point inside the cone, if that point is in sight and its
echo is not lost: smooth walls send the sound away when it arrives at a slant, edges scatter it.

The nearest point of all is in sight, since whatever hid it would be nearer. So segments are ranked
by distance in vectors of float32, and only the few at the front are looked at exactly, in order,
until one is heard.
"""

import math
from typing import Any

import numpy as np

from wheelchair_gym.base.arrays import Array, Floats, Rows
from wheelchair_gym.compiled.address import read_record, rows_of
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.compiled.random import ULTRASONIC, normal, uniform
from wheelchair_gym.geometry.planar import body_to_world, point_to_world, world_to_body
from wheelchair_gym.sensors.echoes import (
    echo_of_discs,
    is_echo_lost,
    occluded_by_discs,
    occludes,
    reach_of_mount,
    relative_endpoints,
)
from wheelchair_gym.sensors.settings import UltrasonicSettings

_DRAWS = 4  # numbers a firing uses
_MARGIN = 1e-4  # m, and share of the cone: beyond what float32 errs by
_F = np.float32
_ZERO, _ONE, _TINY, _NONE = _F(0.0), _F(1.0), _F(1e-30), _F(np.inf)


# rad, by the model: incidence from which echoes are lost at random, and from which all are.
LOSS = {
    "narrow": (math.radians(15.0), math.radians(25.0)),
    "wide": (math.radians(80.0), math.radians(90.0)),
}
# One ranger; its standard deviation is drawn for each episode.
RANGER = read_record("RANGER", globals())[0]
rangers_at = rows_of(RANGER)


def ranger_rows(rangers: UltrasonicSettings, noise: bool) -> Rows:
    """Return the mounted rangers (n,) of RANGER; without noise no echo is lost or added."""
    never = 2.0 * math.pi  # an incidence that no echo reaches
    rows = np.zeros(len(rangers.mounted), RANGER)
    for k, (at, m) in enumerate(zip(rangers.mounted, rangers.models, strict=True)):
        errors = (m.ghost_share, *LOSS[at.model]) if noise else (0.0, never, 2.0 * never)
        slope = math.tan(m.field_of_view / 2)
        rows[k] = k, (at.x, at.y, at.yaw), slope, m.reach, m.range_min, *errors
    return rows


@borrowing_kernel
def _rank(
    n: int, ends: Floats, c: np.float32, s: np.float32, slope: np.float32, out: Floats
) -> None:
    """Squared distance [m2] of each of n segments clipped to a cone; +inf if it lies outside."""
    for k in range(np.uint64(n)):
        x0, y0, x1, y1 = ends[4 * k], ends[4 * k + 1], ends[4 * k + 2], ends[4 * k + 3]
        ax, ay, bx, by = c * x0 + s * y0, c * y0 - s * x0, c * x1 + s * y1, c * y1 - s * x1
        left_a, left_b = slope * ax - ay, slope * bx - by
        right_a, right_b = slope * ax + ay, slope * bx + by
        left, right = left_a / (left_a - left_b), right_a / (right_a - right_b)
        u0, u1 = left if left_a < _ZERO else _ZERO, left if left_b < _ZERO else _ONE
        v0, v1 = right if right_a < _ZERO else _ZERO, right if right_b < _ZERO else _ONE
        t0, t1 = u0 if u0 > v0 else v0, u1 if u1 < v1 else v1
        ex, ey = bx - ax, by - ay
        length = ex * ex + ey * ey
        t = -(ax * ex + ay * ey) / (length if length > _TINY else _TINY)
        t = t if t > t0 else t0
        t = t if t < t1 else t1
        qx, qy = ax + t * ex, ay + t * ey
        off = (left_a < _ZERO) & (left_b < _ZERO) | (right_a < _ZERO) & (right_b < _ZERO)
        out[k] = _NONE if off | (t0 > t1) else qx * qx + qy * qy


@borrowing_kernel
def _keep_near(n: int, limit: np.float32, square: Floats, names: Floats) -> np.int64:
    """Move the squared distances below a limit to the front, and name their segments."""
    kept = np.uint64(0)
    for k in range(np.uint64(n)):
        value = square[k]
        square[kept], names[kept] = value, _F(k)
        kept += np.uint64(value < limit)
    return np.int64(kept)


@borrowing_kernel
def _nearest_of_wall(
    ax: float, ay: float, bx: float, by: float, slope: float
) -> tuple[float, float, float, float]:
    """The nearest point of a segment a-b in a cone about +x: x, y, its distance, and the incidence.

    The distance is +inf if no part lies in the cone. The incidence is 0 where the segment's end or
    the foot of the perpendicular answers.
    """
    t0, t1 = 0.0, 1.0
    for side in range(2):
        sign = 1.0 if side == 0 else -1.0
        at_a, at_b = slope * ax - sign * ay, slope * bx - sign * by
        if at_a < 0.0 and at_b < 0.0:
            t1 = -1.0
        elif at_a < 0.0:
            t0 = max(t0, at_a / (at_a - at_b))
        elif at_b < 0.0:
            t1 = min(t1, at_a / (at_a - at_b))
    if t0 > t1:
        return 0.0, 0.0, math.inf, 0.0
    ex, ey = bx - ax, by - ay
    foot = -(ax * ex + ay * ey) / (ex * ex + ey * ey)
    t = min(t1, max(t0, foot))
    qx, qy = ax + t * ex, ay + t * ey
    distance = math.sqrt(qx * qx + qy * qy)
    incidence = 0.0
    if 0.0 < t < 1.0 and t != foot and distance > 0.0:
        off = abs(ax * ey - ay * ex) / math.sqrt(ex * ex + ey * ey)
        incidence = math.acos(min(1.0, off / distance))
    return qx, qy, distance, incidence


@borrowing_kernel
def first_echo(
    x: float, y: float, yaw: float, ranger: Any, draw: float, walls: Array, discs: Array,
    workspace: Floats,
) -> float:  # fmt: skip
    """Compute the distance [m] of a ranger's first echo at (x, y, yaw); +inf if none in reach."""
    c, s = math.cos(yaw), math.sin(yaw)
    slope, reach, best = ranger.slope, ranger.reach, math.inf
    if discs.shape[0] > 0:
        best = echo_of_discs(x, y, c, s, ranger, draw, walls, discs)
    n, width = walls.shape[0], workspace.shape[1]
    rows = workspace.reshape(workspace.size)
    ends, square, names = rows[: 4 * width], rows[4 * width : 5 * width], rows[5 * width :]
    relative_endpoints(walls, x, y, ends)
    _rank(n, ends, _F(c), _F(s), _F(slope + _MARGIN * (1.0 + slope * slope)), square)
    near = _keep_near(n, _F((reach + _MARGIN) * (reach + _MARGIN)), square, names)
    visited = False
    while True:
        within = min(best, reach) + _MARGIN
        minimum, first = _F(within * within), -1
        for j in range(near):
            if _ZERO <= square[j] < minimum:
                minimum, first = square[j], j
        if first < 0:
            return best
        k = int(names[first])
        x0, y0, x1, y1 = walls[k, 0] - x, walls[k, 1] - y, walls[k, 2] - x, walls[k, 3] - y
        ax, ay = world_to_body(c, s, x0, y0)
        bx, by = world_to_body(c, s, x1, y1)
        ahead, left, distance, incidence = _nearest_of_wall(ax, ay, bx, by, slope)
        if distance < min(best, reach) and not is_echo_lost(incidence, ranger, draw):
            qx, qy = body_to_world(c, s, ahead, left)
            hidden = occluded_by_discs(qx, qy, discs, x, y)
            for j in range(near if visited else 0):
                # Only what is nearer can hide it, and that was visited before.
                if square[j] < _ZERO and not hidden:
                    i = int(names[j])
                    hidden = occludes(
                        qx, qy, walls[i, 0], walls[i, 1], walls[i, 2], walls[i, 3], x, y
                    )
            if not hidden:
                best = distance
        square[first], visited = -_ONE, True


@borrowing_kernel
def sense_ultrasonic(
    ranger: Any, sigma: float, pose: Array, walls: Array, discs: Array, key: np.uint64, tick: int,
    workspace: Floats,
) -> float:  # fmt: skip
    """Compute what a ranger reports [m] when it fires from a chair at a pose (3,) [m, m, rad].

    Its noise has a standard deviation `sigma` [m].
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    mount, reach, draw = ranger.mount, ranger.reach, _DRAWS * ranger.number
    x, y = point_to_world(c, s, pose[0], pose[1], mount[0], mount[1])
    share = reach_of_mount(pose[0], pose[1], x - pose[0], y - pose[1], walls, discs)
    if share < 1.0:
        x, y = pose[0] + share * (x - pose[0]), pose[1] + share * (y - pose[1])
    loss = uniform(key, tick, ULTRASONIC, draw)
    distance = first_echo(x, y, pose[2] + mount[2], ranger, loss, walls, discs, workspace)
    distance += sigma * normal(key, tick, ULTRASONIC, draw + 1)
    if uniform(key, tick, ULTRASONIC, draw + 2) < ranger.ghosts:
        distance = min(distance, reach * uniform(key, tick, ULTRASONIC, draw + 3))
    return math.inf if distance > reach else float(max(distance, ranger.blind))

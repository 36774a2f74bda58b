"""Ultrasonic rangers: the first echo in a cone, exact on segments and discs, then its errors.

Every surface answers from its nearest point inside the cone, if that point is in sight and its
echo is not lost: smooth walls send the sound away when it arrives at a slant, edges scatter it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.kernel import kernel
from wheelchair_gym.sensing.noise import ULTRASONIC, normal, uniform
from wheelchair_gym.sensing.settings import UltrasonicSettings

Array = NDArray[np.float64]

_DRAWS = 4  # numbers a firing uses


class UltrasonicArrays(NamedTuple):
    """What kernels need to know of the rangers; a row each."""

    mount: Array  # (n, 3) m, m, rad in the chair's frame
    half: Array  # (n,) rad: half of the cone
    reach: Array  # (n,) m
    blind: Array  # (n,) m
    sigma: Array  # (n,) m
    ghosts: Array  # (n,)
    loss_from: Array  # (n,) rad
    loss_at: Array  # (n,) rad
    order: NDArray[np.int64]  # (n,) ranger that fires k-th

    @classmethod
    def of(cls, rangers: UltrasonicSettings, noise: bool) -> UltrasonicArrays:
        """Arrays of settings; without noise no echo is lost, added or shifted."""
        share = 1.0 if noise else 0.0
        models = [rangers.narrow if m.model == "narrow" else rangers.wide for m in rangers.mounted]
        never = 2.0 * math.pi  # an incidence that no echo reaches
        return cls(
            np.array([(m.x, m.y, m.yaw) for m in rangers.mounted]),
            np.array([m.cone / 2 for m in models]),
            np.array([m.reach for m in models]),
            np.array([m.blind for m in models]),
            np.array([m.sigma * share for m in models]),
            np.array([m.ghosts * share for m in models]),
            np.array([m.loss_from if noise else never for m in models]),
            np.array([m.loss_at if noise else 2 * never for m in models]),
            np.array(rangers.order, dtype=np.int64),
        )


@kernel
def _in_sight(qx: float, qy: float, walls: Array, discs: Array, x: float, y: float) -> bool:
    """Whether nothing stands between (x, y) and the point (x + qx, y + qy)."""
    for k in range(walls.shape[0]):
        x0, y0 = walls[k, 0] - x, walls[k, 1] - y
        ex, ey = walls[k, 2] - walls[k, 0], walls[k, 3] - walls[k, 1]
        cross = qx * ey - qy * ex
        if cross == 0.0:
            continue
        t = (x0 * ey - y0 * ex) / cross
        u = (x0 * qy - y0 * qx) / cross
        if 0.0 < t < 1.0 - 1e-9 and 0.0 <= u <= 1.0:
            return False
    for k in range(discs.shape[0]):
        x0, y0, radius = discs[k, 0] - x, discs[k, 1] - y, discs[k, 2]
        square = qx * qx + qy * qy
        along = x0 * qx + y0 * qy
        inside = along * along - square * (x0 * x0 + y0 * y0 - radius * radius)
        if inside > 0.0:
            t = (along - math.sqrt(inside)) / square
            if 0.0 < t < 1.0 - 1e-9:
                return False
    return True


@kernel
def _lost(incidence: float, start: float, end: float, draw: float) -> bool:
    """Whether an echo at this incidence is lost: never below start, always above end."""
    return draw < (incidence - start) / (end - start)


@kernel
def first_echo(
    x: float,
    y: float,
    yaw: float,
    half: float,
    reach: float,
    loss_from: float,
    loss_at: float,
    draw: float,
    walls: Array,
    discs: Array,
) -> float:
    """Distance [m] of the first echo of one ranger at (x, y, yaw); +inf if none within reach.

    Args:
        x: pose of the ranger in the world [m], then y [m] and yaw [rad].
        y: see x.
        yaw: see x.
        half: half of the cone's opening [rad], below pi / 2.
        reach: [m].
        loss_from: incidence at which echoes begin to be lost [rad].
        loss_at: incidence beyond which all are lost [rad].
        draw: in [0, 1): decides, for all surfaces of this firing, what is lost.
        walls: segments (n, 4) [m].
        discs: (m, 3) [m].
    """
    c, s = math.cos(yaw), math.sin(yaw)
    slope = math.tan(half)
    best = reach
    found = False
    for k in range(walls.shape[0]):
        x0, y0 = walls[k, 0] - x, walls[k, 1] - y
        x1, y1 = walls[k, 2] - x, walls[k, 3] - y
        if min(x0, x1) > best or max(x0, x1) < -best or min(y0, y1) > best or max(y0, y1) < -best:
            continue
        ax, ay = c * x0 + s * y0, c * y0 - s * x0
        bx, by = c * x1 + s * y1, c * y1 - s * x1
        # The part t0..t1 between the cone's sides: slope * x - y >= 0 and slope * x + y >= 0.
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
            continue
        ex, ey = bx - ax, by - ay
        foot = -(ax * ex + ay * ey) / (ex * ex + ey * ey)
        t = min(t1, max(t0, foot))
        qx, qy = ax + t * ex, ay + t * ey
        distance = math.hypot(qx, qy)
        if distance >= best:
            continue
        if 0.0 < t < 1.0 and t != foot:
            off = abs(ax * ey - ay * ex) / math.hypot(ex, ey)
            incidence = math.acos(min(1.0, off / distance)) if distance > 0.0 else 0.0
            if _lost(incidence, loss_from, loss_at, draw):
                continue
        if _in_sight(c * qx - s * qy, s * qx + c * qy, walls, discs, x, y):
            best, found = distance, True
    for k in range(discs.shape[0]):
        x0, y0, radius = discs[k, 0] - x, discs[k, 1] - y, discs[k, 2]
        far = math.hypot(x0, y0)
        if far - radius >= best:
            continue
        if far <= radius:
            return 0.0
        bearing = math.atan2(c * y0 - s * x0, c * x0 + s * y0)
        direction = min(half, max(-half, bearing))
        aside = abs(bearing - direction)
        off = far * math.sin(aside)
        if aside >= 0.5 * math.pi or off > radius:
            continue
        distance = far * math.cos(aside) - math.sqrt(radius * radius - off * off)
        if distance >= best or _lost(math.asin(off / radius), loss_from, loss_at, draw):
            continue
        qx, qy = distance * math.cos(yaw + direction), distance * math.sin(yaw + direction)
        if _in_sight(qx, qy, walls, discs, x, y):
            best, found = distance, True
    return best if found else math.inf


@kernel
def fire(
    rangers: UltrasonicArrays,
    which: int,
    pose: Array,
    walls: Array,
    discs: Array,
    key: np.uint64,
    tick: int,
) -> float:
    """What one ranger reports [m] when it fires from a chair at a pose (3,) [m, m, rad].

    Args:
        rangers: all of them.
        which: the one that fires.
        pose: of the chair.
        walls: segments (n, 4) [m].
        discs: (m, 3) [m].
        key: of the episode.
        tick: of the firing, which its random draws depend on.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    mx, my = rangers.mount[which, 0], rangers.mount[which, 1]
    reach, blind = rangers.reach[which], rangers.blind[which]
    draw = _DRAWS * which
    distance = first_echo(
        pose[0] + c * mx - s * my,
        pose[1] + s * mx + c * my,
        pose[2] + rangers.mount[which, 2],
        rangers.half[which],
        reach,
        rangers.loss_from[which],
        rangers.loss_at[which],
        uniform(key, tick, ULTRASONIC, draw),
        walls,
        discs,
    )
    distance += rangers.sigma[which] * normal(key, tick, ULTRASONIC, draw + 1)
    if uniform(key, tick, ULTRASONIC, draw + 2) < rangers.ghosts[which]:
        distance = min(distance, reach * uniform(key, tick, ULTRASONIC, draw + 3))
    return math.inf if distance > reach else float(max(distance, blind))

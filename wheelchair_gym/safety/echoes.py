"""What the shield heard: echoes of what the laser does not see."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.kinematics import arc_step
from wheelchair_gym.safety.state import ARC

Floats = NDArray[np.float32]

_SPACING = 0.04  # m between the points of an echo's arc
_SLACK = 0.04  # m: points of the laser stand for arcs as long (`memory`)
_ECHO = 2.5  # m: echoes from farther off do not matter yet
_AGREE = 0.15  # m: laser and ultrasonic err together by less
_ASIDE = math.radians(4.0)  # cones have soft edges
_FIRING = 5e-3  # s: stamps of two firings differ by more


@borrowing_kernel
def _explained(g: Any, s: Any, k: int, x: float, y: float, yaw: float, r: float) -> bool:
    """Whether a point inside ranger k's cone, as near as its echo, is what answered."""
    half = g.ranger_half[k] + _ASIDE
    c, sn = math.cos(yaw), math.sin(yaw)
    slope = math.tan(half)
    for i in range(s.n_points):
        dx, dy = s.points[i, 0] - x, s.points[i, 1] - y
        ahead, left = c * dx + sn * dy, c * dy - sn * dx
        inside = ahead > 0.0 and abs(left) <= slope * ahead + _SLACK
        if inside and dx * dx + dy * dy <= (r + _AGREE) * (r + _AGREE):
            return True
    return False


@borrowing_kernel
def update_echoes(g: Any, s: Any, ultrasonic: Floats, age: Floats) -> None:
    """Take in echoes: one that no laser point explains, and that is heard twice, is an obstacle.

    It may stand anywhere on its arc. Twice, since a ghost is heard once.
    """
    for k in range(age.shape[0]):
        old = float(age[k])
        if not old <= g.stale_ultrasonic:
            s.n_arc[k], s.doubtful[k] = 0, math.nan
            continue
        fired = s.stamp - old
        if abs(fired - s.fired[k]) < _FIRING:
            continue
        since, s.fired[k] = fired - s.fired[k], fired
        r = float(ultrasonic[k])
        if not (0.0 <= r <= min(g.ranger_reach[k], _ECHO)):
            s.n_arc[k], s.doubtful[k] = 0, math.nan
            continue
        # Where the chair was when it fired: it has driven on as its wheels say.
        way, turn = s.told[3] * old, s.told[4] * old
        if not math.isfinite(way + turn):
            way, turn = 0.0, 0.0
        bx, by, byaw = arc_step(s.pose[0], s.pose[1], s.pose[2], -way, -turn, 1.0)
        c, sn = math.cos(byaw), math.sin(byaw)
        mx, my = g.ranger_mount[k, 0], g.ranger_mount[k, 1]
        x, y = bx + c * mx - sn * my, by + sn * mx + c * my
        yaw = byaw + g.ranger_mount[k, 2]
        if _explained(g, s, k, x, y, yaw, r):
            s.n_arc[k], s.doubtful[k] = 0, math.nan
            continue
        moved = abs(s.told[3]) * since if math.isfinite(s.told[3]) else 0.0
        again = abs(s.doubtful[k] - r) <= _AGREE + moved
        s.doubtful[k] = r
        s.n_arc[k] = 0
        if again:
            half = g.ranger_half[k]
            n = min(ARC, 2 + int(2.0 * half * r / _SPACING))
            for i in range(n):
                angle = yaw - half + 2.0 * half * i / (n - 1)
                s.arc[k, i, 0], s.arc[k, i, 1] = x + r * math.cos(angle), y + r * math.sin(angle)
            s.n_arc[k] = n

"""Corrects dead reckoning by the static surroundings: a scan is matched to a remembered one.

Where stamps of scans and encoders differ by a tenth of a second, or a wheel slips, everything
static seems to move while the chair drives. The correction is the one of least squares over the
distances from each point to the line through its two neighbours of the remembered scan, with the
motion by dead reckoning as a prior (point to line: Chen and Medioni 1992).
"""

import math
from typing import Any

import numpy as np

from wheelchair_gym.compiled.address import floats_at
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.geometry.planar import body_to_world, point_to_world, world_to_body
from wheelchair_gym.sensors.echoes import atan2_f32

_F = np.float32
_ITERATIONS = 4
_GATE = 0.30  # m: points farther from the line are of something else; halved in each iteration
_MIN_GATE = 0.10  # m
_SLANT = 3.0  # m of range per m between sectors, of neighbours on one surface
_SIGMA = 0.10  # m: of one distance; neighbours err alike, so that this is more than a scanner's
# Deviations of dead reckoning since the previous scan: m per m, rad per rad turned, rad per m.
_TRAVEL, _TURN, _BEND = 0.15, 0.15, 0.05
_MIN_MOTION = 1e-4  # m, rad: less is no motion; also the minimum error of dead reckoning
_SHARE = 0.2  # of all sectors that must fit, and half of those that can be compared


@inlined
def _sector_point(g: Any, frame: Any, k: int) -> tuple[float, float]:
    """The nearest hit of a sector in the laser's frame."""
    b = min(k * g.group + g.group // 2, g.beams - 1)
    r = float(frame.range[k])
    return r * floats_at(g.cosine, g.beams)[b], r * floats_at(g.sine, g.beams)[b]


@borrowing_kernel
def _solve(h: Any, b: Any) -> tuple[float, float, float]:
    """The solution of three equations with a symmetric matrix: xx, xy, xt, yy, yt, tt."""
    xx, xy, xt, yy, yt, tt = h
    a0, a1, a2 = yy * tt - yt * yt, xt * yt - xy * tt, xy * yt - xt * yy
    scale = 1.0 / (xx * a0 + xy * a1 + xt * a2)
    return (
        scale * (a0 * b[0] + a1 * b[1] + a2 * b[2]),
        scale * (a1 * b[0] + (xx * tt - xt * xt) * b[1] + (xy * xt - xx * yt) * b[2]),
        scale * (a2 * b[0] + (xy * xt - xx * yt) * b[1] + (xx * yy - xy * xy) * b[2]),
    )


@borrowing_kernel
def align(g: Any, s: Any, now: Any, dt: float) -> None:
    """Correct the pose of a tracker and the place of a scan that has been taken there.

    g, s: records of CONSTANTS and TRACKER; now: the scan, a FRAME; dt: s since the previous scan.
    """
    v, w = abs(s.twist[0]), abs(s.twist[1])
    sigma_xy, sigma_yaw = _MIN_MOTION + _TRAVEL * v * dt, _MIN_MOTION + (_TURN * w + _BEND * v) * dt
    if s.n_frames == 0 or v * dt + w * dt <= _MIN_MOTION:
        return
    old, weight = s.frames[s.newest], 1.0 / (_SIGMA * _SIGMA)
    x0, y0 = world_to_body(old.c, old.s, now.x - old.x, now.y - old.y)
    c, sn = world_to_body(old.c, old.s, now.c, now.s)
    yaw0 = math.atan2(sn, c)
    x, y, yaw, gate = x0, y0, yaw0, _GATE
    nearby = _SLANT * g.group / g.per_angle
    for _ in range(_ITERATIONS):
        c, sn = math.cos(yaw), math.sin(yaw)
        xx, tt = 1.0 / (sigma_xy * sigma_xy), 1.0 / (sigma_yaw * sigma_yaw)
        yy, xy, xt, yt = xx, 0.0, 0.0, 0.0
        bx, by, bt = xx * (x0 - x), yy * (y0 - y), tt * (yaw0 - yaw)
        fits, compared = 0, 0
        for k in range(g.sectors):
            if not g.nearest <= now.range[k] < g.reach:
                continue
            px, py = _sector_point(g, now, k)
            px, py = body_to_world(c, sn, px, py)  # from the laser, in the remembered frame
            beam = (float(atan2_f32(_F(y + py), _F(x + px))) - g.first) * g.per_angle
            j = math.floor((beam - g.group // 2) / g.group)
            if not 0 <= j < g.sectors - 1:
                continue
            low, high = float(old.range[j]), float(old.range[j + 1])
            if not (g.nearest <= low < g.reach and abs(high - low) < nearby * low):
                continue
            compared += 1
            ax, ay = _sector_point(g, old, j)
            ex, ey = _sector_point(g, old, j + 1)
            ex, ey = ex - ax, ey - ay
            length = math.sqrt(ex * ex + ey * ey)
            nx, ny = -ey / length, ex / length
            off = nx * (x + px - ax) + ny * (y + py - ay)
            if abs(off) > gate:
                continue
            fits += 1
            nt = ny * px - nx * py
            xx, xy, xt = xx + weight * nx * nx, xy + weight * nx * ny, xt + weight * nx * nt
            yy, yt, tt = yy + weight * ny * ny, yt + weight * ny * nt, tt + weight * nt * nt
            bx, by, bt = bx - weight * nx * off, by - weight * ny * off, bt - weight * nt * off
        if fits < _SHARE * g.sectors or 2 * fits < compared:
            return
        dx, dy, turned = _solve((xx, xy, xt, yy, yt, tt), (bx, by, bt))
        x, y, yaw, gate = x + dx, y + dy, yaw + turned, max(0.5 * gate, _MIN_GATE)
    now.x, now.y = point_to_world(old.c, old.s, old.x, old.y, x, y)
    now.c, now.s = body_to_world(old.c, old.s, math.cos(yaw), math.sin(yaw))
    s.pose[2] += yaw - yaw0
    c, sn = math.cos(s.pose[2]), math.sin(s.pose[2])
    back_x, back_y = body_to_world(c, sn, g.mount[0], g.mount[1])
    s.pose[0], s.pose[1] = now.x - back_x, now.y - back_y

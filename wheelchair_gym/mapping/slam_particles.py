"""Particles of a SLAM: each moves, matches, is weighed and maps, in one compiled loop."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.geometry import wrap
from wheelchair_gym.kernel import borrowing_kernel, kernel
from wheelchair_gym.mapping.descent import Six, backward, cholesky, misfit, quadratic, refine
from wheelchair_gym.mapping.rays import Odds, add_scan
from wheelchair_gym.mapping.search import search
from wheelchair_gym.sensing.noise import SLAM, normal

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Index = NDArray[np.uint32]
Marks = NDArray[np.int32]
Mask = NDArray[np.bool_]

_NODE = math.sqrt(3.0)  # nodes of the third-degree cubature in three dimensions, in deviations


class Moved(NamedTuple):
    """What the wheels say since the last scan used, and how they err [cells, rad]."""

    x: float
    y: float
    yaw: float
    along: float  # variance
    turn: float  # variance


class Matcher(NamedTuple):
    """What `MatchSettings` say, in cells."""

    spread: float
    iterations: int
    window: int
    turns: int
    step: float
    doubt: float


@borrowing_kernel
def _propose(
    field: Floats, points: Array, prior: Array, told: Six, spread: float, best: Array,
    information: Six, cost: float, key: np.uint64, step: int, particle: int, draw: bool,
) -> float:  # fmt: skip
    """Fit a Gaussian to the posterior about its mode, and draw the pose from it.

    `best` becomes the pose: drawn, or the mean. The result is the logarithm of the weight
    (Grisetti et al. 2007, equations 16 to 20).
    """
    c = cholesky(information)
    x, y, yaw = best[0], best[1], best[2]
    total = 0.0
    m0, m1, m2, xx, yy, tt = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(6):
        side = _NODE if k % 2 == 0 else -_NODE
        u, v, w = side * (k // 2 == 0), side * (k // 2 == 1), side * (k // 2 == 2)
        dx, dy, dt = backward(c, u, v, w)
        px, py, pt = x + dx, y + dy, yaw + dt
        here = 0.5 * misfit(field, points, px, py, pt) / (spread * spread)
        here += 0.5 * quadratic(told, px - prior[0], py - prior[1], pt - prior[2])
        share = math.exp(cost - here + 0.5 * _NODE * _NODE) / 6.0
        total += share
        m0 += share * u
        m1 += share * v
        m2 += share * w
        xx += share * u * u
        yy += share * v * v
        tt += share * w * w
    m0, m1, m2 = m0 / total, m1 / total, m2 / total
    if draw:
        g = cholesky((
            xx / total - m0 * m0 + 1e-9, -m0 * m1, -m0 * m2,
            yy / total - m1 * m1 + 1e-9, -m1 * m2, tt / total - m2 * m2 + 1e-9,
        ))  # fmt: skip
        a = normal(key, step, SLAM, 3 * particle)
        b = normal(key, step, SLAM, 3 * particle + 1)
        d = normal(key, step, SLAM, 3 * particle + 2)
        m0 += g[0] * a
        m1 += g[1] * a + g[2] * b
        m2 += g[3] * a + g[4] * b + g[5] * d
    dx, dy, dt = backward(c, m0, m1, m2)
    best[0], best[1], best[2] = x + dx, y + dy, wrap(yaw + dt)
    return math.log(total) - cost - math.log(c[0] * c[2] * c[5])


@kernel
def advance(
    odds: Floats, field: Floats, surface: Floats, struck: Marks, wide: Floats, path: Index,
    mark: int, poses: Array, weights: Array, moved: Moved, points: Array, ends: Array, hits: Mask,
    how: Matcher, law: Odds, smear: Floats, key: np.uint64, step: int, learn: bool,
) -> None:  # fmt: skip
    """Move, match, weigh and map every particle.

    Args:
        odds: log-odds (particles, rows, cols).
        field: likewise.
        surface: (particles, rows, cols, 5).
        struck: scratch (rows, cols).
        wide: scratch (rows, cols).
        path: scratch of `add_scan`.
        mark: number of the first particle's scan.
        poses: (particles, 3) x, y [cells], yaw; replaced.
        weights: (particles,) logarithms; added to.
        moved: what the odometry says.
        points: (m, 2) [cells] to match.
        ends: (n + 1, 2) [cells] to map.
        hits: (n,).
        how: settings of the matcher.
        law: of the map.
        smear: of the field.
        key: of the run.
        step: number of this update.
        learn: add the scan to the maps.
    """
    prior, best, other = np.empty(3), np.empty(3), np.empty(3)
    count = len(poses)
    for i in range(count):
        yaw = poses[i, 2]
        c, s = math.cos(yaw), math.sin(yaw)
        prior[0] = poses[i, 0] + c * moved.x - s * moved.y
        prior[1] = poses[i, 1] + s * moved.x + c * moved.y
        prior[2] = yaw + moved.yaw
        told = (1.0 / moved.along, 0.0, 0.0, 1.0 / moved.along, 0.0, 1.0 / moved.turn)
        if len(points) == 0:
            poses[i] = prior
        else:
            cost, found = refine(
                field[i], points, prior, prior, told, how.spread, how.iterations, best
            )
            apart = misfit(field[i], points, best[0], best[1], best[2])
            if apart > how.doubt * len(points):
                search(field[i], points, prior, told, how.spread, how.window, how.turns, how.step,
                       wide, other)  # fmt: skip
                else_, also = refine(
                    field[i], points, other, prior, told, how.spread, how.iterations, other
                )
                if else_ < cost:
                    cost, found = else_, also
                    best[:] = other
            weights[i] += _propose(field[i], points, prior, told, how.spread, best, found, cost,
                                   key, step, i, count > 1)  # fmt: skip
            poses[i] = best
        if learn:
            add_scan(odds[i], field[i], surface[i], struck, mark + i, ends, hits, poses[i], law,
                     smear, path)  # fmt: skip

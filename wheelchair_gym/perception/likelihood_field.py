"""The likelihood field: how well a scan fits a map, and where on the map it fits best.

The gap to the nearest surface is positive outside of occupied cells and negative inside, so that
between the centres of cells it falls to 0 on the surface itself, not half a cell before it
(Thrun, Burgard and Fox 2005, section 6.4, on a signed distance).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.compiled.random import uniform
from wheelchair_gym.geometry.planar import world_to_body, wrap
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.maps.distance import bilinear, distance_to_occupied

OUTLIER_SHARE = 0.1  # of beams that hit what the map does not show: design choice


class LikelihoodField(NamedTuple):
    """Gaps to the surfaces of a map, where its cells lie, and the model of a beam."""

    gap: NDArray[np.float32]  # (rows, cols) m from each cell's centre, negative where solid
    origin: Array  # (3,) m, m, rad: lower left corner of cell (0, 0)
    resolution: float  # m
    sigma: float  # m: standard deviation of the gap at a beam's end


def make_likelihood_field(grid: OccupancyGrid, sigma: float) -> LikelihoodField:
    """The field of a map; gaps beyond ten standard deviations [m] are cut off."""
    maximum = 10.0 * sigma
    solid, cells = grid.solid(), maximum / grid.resolution + 1.0
    outside, inside = distance_to_occupied(solid, cells), distance_to_occupied(~solid, cells)
    gap = np.clip((outside - inside) * np.float32(grid.resolution), -maximum, maximum)
    origin = np.array(grid.origin)
    return LikelihoodField(gap.astype(np.float32), origin, grid.resolution, sigma)


@inlined
def _gap(field: LikelihoodField, u: float, v: float) -> float:
    """Gap at a place [cells from the centre of cell (0, 0)], between those of four cells."""
    col, row = int(u), int(v)
    return bilinear(field.gap, row, col, u - col, v - row)


@inlined
def _in_cells(
    field: LikelihoodField, x: float, y: float, yaw: float
) -> tuple[float, float, float, float]:
    """Return a pose's place (u, v) [cells], cosine and sine of its yaw times cells per metre."""
    origin, scale = field.origin, 1.0 / field.resolution
    c, s = math.cos(origin[2]), math.sin(origin[2])
    u, v = world_to_body(c, s, x - origin[0], y - origin[1])
    turn = yaw - origin[2]
    return u * scale - 0.5, v * scale - 0.5, math.cos(turn) * scale, math.sin(turn) * scale


@borrowing_kernel
def log_likelihood(field: LikelihoodField, x: float, y: float, yaw: float, ends: Array) -> float:
    """Mean logarithm of the likelihood of beams whose ends (n, 2) [m] are seen from a pose.

    The likelihood of a gap g is 1 / (1 + g^2 / 4 sigma^2)^2: a bell like exp(-g^2 / 2 sigma^2),
    with longer tails, which attract from farther away, and faster to compute.
    """
    rows, cols = field.gap.shape
    u0, v0, c, s = _in_cells(field, x, y, yaw)
    sharp, share = 0.25 / (field.sigma * field.sigma), 1.0 - OUTLIER_SHARE
    max_u, max_v = cols - 1.0, rows - 1.0
    total, product = 0.0, 1.0  # of sixteen is well within a double, and a logarithm is slow
    for k in range(ends.shape[0]):
        u, v = u0 + c * ends[k, 0] - s * ends[k, 1], v0 + s * ends[k, 0] + c * ends[k, 1]
        value = OUTLIER_SHARE
        if 0.0 <= u < max_u and 0.0 <= v < max_v:
            gap = _gap(field, u, v)
            near = 1.0 / (1.0 + sharp * gap * gap)
            value += share * near * near
        product *= value
        if k % 16 == 15:
            total, product = total + math.log(product), 1.0
    mean: float = (total + math.log(product)) / max(1, ends.shape[0])
    return mean


@borrowing_kernel
def find_informative_beams(
    field: LikelihoodField,
    x: float,
    y: float,
    yaw: float,
    mount: Array,
    ends: Array,
    informative: NDArray[np.bool_],
) -> None:
    """Return the beams informative about a pose: those that end at a surface or behind one.

    A beam that ends in the open may have hit a person (Fox, Burgard and Thrun 1999, section 4:
    filters for what a map does not show).
    """
    rows, cols = field.gap.shape
    u0, v0, c, s = _in_cells(field, x, y, yaw)
    max_u, max_v = cols - 1.0, rows - 1.0
    u1, v1 = u0 + c * mount[0] - s * mount[1], v0 + s * mount[0] + c * mount[1]
    for k in range(ends.shape[0]):
        u, v = u0 + c * ends[k, 0] - s * ends[k, 1], v0 + s * ends[k, 0] + c * ends[k, 1]
        inside = 0.0 <= u < max_u and 0.0 <= v < max_v
        informative[k] = inside and _gap(field, u, v) < 3.0 * field.sigma
        length, step = math.hypot(u - u1, v - v1), 0.0  # cells
        while step < length and not informative[k]:
            a, b = u1 + (u - u1) * step / length, v1 + (v - v1) * step / length
            gap = field.resolution
            if 0.0 <= a < max_u and 0.0 <= b < max_v:
                gap = _gap(field, a, b)
            informative[k] = gap < 0.0
            step += max(0.5, gap / field.resolution)


GLOBAL = 7  # channel of a localizer's key


@borrowing_kernel
def _draw_pose(
    field: LikelihoodField, free: NDArray[np.int64], key: np.uint64, step: int, k: int, pose: Array
) -> None:
    """A pose (3,) in one of the free cells (m,), with any heading."""
    cols = field.gap.shape[1]
    c, s = math.cos(field.origin[2]), math.sin(field.origin[2])
    cell = free[int(uniform(key, step, GLOBAL, 4 * k) * len(free))]
    u = (cell % cols + uniform(key, step, GLOBAL, 4 * k + 1)) * field.resolution
    v = (cell // cols + uniform(key, step, GLOBAL, 4 * k + 2)) * field.resolution
    pose[0], pose[1] = field.origin[0] + c * u - s * v, field.origin[1] + s * u + c * v
    pose[2] = (2.0 * uniform(key, step, GLOBAL, 4 * k + 3) - 1.0) * math.pi


@borrowing_kernel
def hill_climb(field: LikelihoodField, ends: Array, turn: float, pose: Array) -> float:
    """Move a pose (3,) to the best fit of a scan nearby; returns its mean log-likelihood.

    One coordinate after the other, in steps of two standard deviations or `turn` [rad] that are
    halved where none helps (pattern search, Hooke and Jeeves 1961).
    """
    best, move = log_likelihood(field, pose[0], pose[1], pose[2], ends), 2.0 * field.sigma
    for _ in range(40):
        better = False
        for k in range(3):
            for sign in (-1.0, 1.0):
                before = pose[k]
                pose[k] = before + sign * (turn if k == 2 else move)
                value = log_likelihood(field, pose[0], pose[1], pose[2], ends)
                if value > best:
                    best, better = value, True
                    break
                pose[k] = before
        if not better:
            move, turn = 0.5 * move, 0.5 * turn
            if move < 0.01:
                break
    pose[2] = wrap(pose[2])
    return best


@borrowing_kernel
def global_localization(
    field: LikelihoodField,
    free: NDArray[np.int64],
    ends: Array,
    few: Array,
    tries: int,
    turn: float,
    key: np.uint64,
    step: int,
    found: Array,
    fits: Array,
) -> None:
    """The best of many random poses for a scan, each refined by hill climbing.

    `few` of the beams, with a wider bell, choose the poses. `found` and `fits` have one row more
    than there are results, for the pose that is tried.
    """
    sigma = 3.0 * field.sigma
    wide = LikelihoodField(field.gap, field.origin, field.resolution, sigma)
    fits[:] = -np.inf
    for k in range(tries):
        pose = found[0]
        _draw_pose(field, free, key, step, k, pose)
        fits[0] = log_likelihood(wide, pose[0], pose[1], pose[2], few)
        j = 0  # rows rise by fit: the new one goes to its place, the worst becomes row 0
        while j + 1 < len(fits) and fits[j] > fits[j + 1]:
            fits[j], fits[j + 1] = fits[j + 1], fits[j]
            for i in range(3):
                found[j, i], found[j + 1, i] = found[j + 1, i], found[j, i]
            j += 1
    for k in range(1, len(fits)):
        if fits[k] > -np.inf:
            fits[k] = hill_climb(field, ends, turn, found[k])

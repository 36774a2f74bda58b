"""Where on a map a scan may have been taken, without any idea beforehand; as a kernel."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry import wrap
from wheelchair_gym.localization.likelihood_field import LikelihoodField, log_likelihood
from wheelchair_gym.random import uniform

Array = NDArray[np.float64]

GLOBAL = 7  # channel of a localiser's own key


@borrowing_kernel
def _draw(
    field: LikelihoodField, free: NDArray[np.int64], key: np.uint64, step: int, k: int, pose: Array
) -> None:
    """A pose (3,) anywhere in cells that are free (m,), any heading."""
    cols = field.gap.shape[1]
    c, s = math.cos(field.origin[2]), math.sin(field.origin[2])
    cell = free[int(uniform(key, step, GLOBAL, 4 * k) * len(free))]
    u = (cell % cols + uniform(key, step, GLOBAL, 4 * k + 1)) * field.resolution
    v = (cell // cols + uniform(key, step, GLOBAL, 4 * k + 2)) * field.resolution
    pose[0], pose[1] = field.origin[0] + c * u - s * v, field.origin[1] + s * u + c * v
    pose[2] = (2.0 * uniform(key, step, GLOBAL, 4 * k + 3) - 1.0) * math.pi


@borrowing_kernel
def hill_climb(
    field: LikelihoodField,
    ends: Array,
    sigma: float,
    astray: float,
    way: float,
    turn: float,
    pose: Array,
) -> float:
    """Move a pose (3,) to where a scan fits best nearby; the logarithm of its likelihood there.

    One coordinate after the other, in steps [m, rad] that are halved where none helps (pattern
    search, Hooke and Jeeves 1961).
    """
    best = log_likelihood(field, pose[0], pose[1], pose[2], ends, sigma, astray)
    for _ in range(40):
        better = False
        for k in range(3):
            for sign in (-1.0, 1.0):
                before = pose[k]
                pose[k] = before + sign * (turn if k == 2 else way)
                value = log_likelihood(field, pose[0], pose[1], pose[2], ends, sigma, astray)
                if value > best:
                    best, better = value, True
                    break
                pose[k] = before
        if not better:
            way, turn = 0.5 * way, 0.5 * turn
            if way < 0.01:
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
    sigma: float,
    astray: float,
    way: float,
    turn: float,
    key: np.uint64,
    step: int,
    found: Array,
    worth: Array,
) -> None:
    """The best of many places where a scan may have been taken, each climbed to its summit.

    Args:
        field: of the map.
        free: cells (m,) in which the chair may be.
        ends: of beams (n, 2) [m] in the chair's frame.
        few: of some of them, for a first look.
        tries: places looked at first.
        sigma: see `log_likelihood`; a first look is three times as lenient.
        astray: see `log_likelihood`.
        way: first step of a climb [m].
        turn: the same [rad].
        key: of the draws.
        step: see key.
        found: (k + 1, 3) written: the k best poses, best last; the first row is overwritten.
        worth: (k + 1,) written: the logarithms of their likelihoods.
    """
    for k in range(worth.shape[0]):
        worth[k] = -np.inf
    for k in range(tries):
        pose = found[0]  # room for the next one: the worst of all goes
        _draw(field, free, key, step, k, pose)
        worth[0] = log_likelihood(field, pose[0], pose[1], pose[2], few, 3.0 * sigma, astray)
        _sink(found, worth)
    for k in range(1, worth.shape[0]):
        if worth[k] > -np.inf:
            worth[k] = hill_climb(field, ends, sigma, astray, way, turn, found[k])


@borrowing_kernel
def _sink(found: Array, worth: Array) -> None:
    """Bring row 0 to its place among the others, which rise by worth."""
    k = 0
    while k + 1 < worth.shape[0] and worth[k] > worth[k + 1]:
        worth[k], worth[k + 1] = worth[k + 1], worth[k]
        for j in range(3):
            found[k, j], found[k + 1, j] = found[k + 1, j], found[k, j]
        k += 1

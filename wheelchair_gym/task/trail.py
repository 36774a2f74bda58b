"""The trail: where a chair was, so that who sees no map can tell where it has been."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.task.observations import tell_place
from wheelchair_gym.task.records import CRUMBS

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

APART = 0.25  # m between crumbs


@borrowing_kernel
def begin_trail(own: Any, pose: Array) -> None:
    """Begin a trail, in a record of PROGRESS, at a pose (3,) [m, m, rad]."""
    own.n_crumbs = 1
    own.crumbs[0, 0], own.crumbs[0, 1] = pose[0], pose[1]


@borrowing_kernel
def lengthen_trail(own: Any, pose: Array) -> None:
    """Drop crumbs from the last one on towards a pose (3,), as far as they go; the oldest are lost.

    How far it is counts, not how long the way was: a pose that trembles leaves no trail.
    """
    for _ in range(CRUMBS):  # however far a pose jumps, and if it is no number
        last, at = (own.n_crumbs - 1) % CRUMBS, own.n_crumbs % CRUMBS
        dx, dy = pose[0] - own.crumbs[last, 0], pose[1] - own.crumbs[last, 1]
        share = APART / max(math.hypot(dx, dy), 1e-9)
        if not share <= 1.0:
            break
        own.crumbs[at, 0] = own.crumbs[last, 0] + share * dx
        own.crumbs[at, 1] = own.crumbs[last, 1] + share * dy
        own.n_crumbs += 1


@borrowing_kernel
def look_back(own: Any, pose: Array, ways: Array, out: Floats) -> None:
    """Where the chair was so many metres of way ago, in its frame now; at first, where it began.

    Args:
        own: record of PROGRESS.
        pose: (3,) [m, m, rad].
        ways: (k,) [m].
        out: (2 k,) x and y of each [m].
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for k in range(ways.shape[0]):
        at = max(own.n_crumbs - 1 - round(ways[k] / APART), 0) % CRUMBS
        dx, dy = own.crumbs[at, 0] - pose[0], own.crumbs[at, 1] - pose[1]
        tell_place(c, s, dx, dy, out[2 * k : 2 * k + 2])

"""What a follower is, and what all that roll out have in common."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from agents.control.local_map import Surroundings
from agents.control.motion import Motion
from agents.control.reference import Reference
from agents.control.rollout import Near

Array = NDArray[np.float64]

SLOW = 0.5  # below this share of the margin
CREEP = 0.1  # m/s: the chair goes no faster than walking-stick speed


class Follower(Protocol):
    """Drives along one reference; made anew for every path."""

    def twist(self, around: Surroundings, reference: Reference, chair: Motion) -> Array | None:
        """The next target twist (2,) [m/s, rad/s], or None where nothing safe leads on."""
        ...


def widest(
    around: Surroundings,
    chair: Motion,
    margin: float,
    pick: Callable[[float, bool], Array | None],
) -> Array | None:
    """The twist picked at the widest margin that leads on; else one at rest; None: none is safe.

    Args:
        around: what is round the chair.
        chair: how it moves.
        margin: asked for [m].
        pick: a twist (2,) for a margin [m], and whether to creep; None where none is safe.
    """
    rest = None
    for less in around.margins(chair.footprint, margin):
        twist = pick(less, less < SLOW * margin)
        if twist is None:
            continue
        if abs(twist[0]) > 0.02 or abs(twist[1]) > 0.02 or len(around.movers):
            return twist
        rest = twist if rest is None else rest
    return rest


def near_of(around: Surroundings, reference: Reference) -> Near:
    """What kernels need to know of what is round the chair."""
    return Near(around.points, around.movers, reference.ahead(around.pose))


def allowed(candidates: Array, around: Surroundings, slow: bool) -> Array:
    """Commands (c, k, 3) without those that back where nobody has seen, or hurry where it is tight.

    Args:
        candidates: the commands.
        around: tells whether the chair is blind behind.
        slow: an obstacle is very near.
    """
    v = candidates[:, 0, 0]
    good = np.ones(len(v), bool)
    if around.blind:
        good &= v >= 0.0
    if slow:
        good &= np.abs(v) <= CREEP
    return candidates[good]

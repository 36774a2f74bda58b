"""What a follower is, and the objective of named terms that all who roll out share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from agents.control.local_map import Surroundings
from agents.control.reference import Reference
from agents.control.rollout import Motion, Near, Weights
from wheelchair_gym.config import setting, settings


@settings
class Objective:
    """What a roll-out is worth; every term counts in metres of way."""

    horizon: float = setting(default=1.5, unit="s", low=0.3, source="tuned on training floor plans")
    foresight: float = setting(
        default=4.0, unit="s", low=0.3, source="of movers: a chair at rest leaves its place in 3"
    )
    wish: float = setting(default=0.20, unit="m", low=0.01, source="half the play in a 1.0 m door")
    room: float = setting(
        default=0.45, unit="m", low=0.01, source="from what moves: personal space begins there"
    )
    progress: float = setting(default=1.0, low=0.0, source="m per m along the path: the unit")
    clearance: float = setting(
        default=0.8,
        low=0.0,
        source="m per m in touch; less than progress, or nothing tight is entered",
    )
    path: float = setting(default=1.5, low=0.0, source="m per m beside the path; tuned")
    comfort: float = setting(
        default=0.05, unit="s", low=0.0, source="of a change of the twist, against wobble; tuned"
    )
    reverse: float = setting(default=0.5, low=0.0, source="m per m in reverse; tuned")
    struck: float = setting(
        default=6.0, unit="m", low=0.0, source="of being where a mover comes; tuned"
    )

    @property
    def weights(self) -> Weights:
        """The objective as kernels take it."""
        return Weights(
            self.horizon, self.foresight, self.wish, self.room, self.progress, self.clearance,
            self.path, self.comfort, self.reverse, self.struck,
        )  # fmt: skip


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

"""Out of where no follower finds a way on: backing out, and turning in place to look round."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agents.control.follower import near_of
from agents.control.local_map import Surroundings
from agents.control.motion import Motion
from agents.control.reference import Reference
from agents.control.rollout import stops_clear
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.kinematics import corner_speed

Array = NDArray[np.float64]

BACK = 0.15  # m/s in reverse: nothing looks back
CRAWL = 0.04  # m/s of any part in reverse where there are people: so slow it harms nobody it hits
SAME = 1.0  # m: so near the last place it backs out farther, up to
FARTHEST = 4  # times as far
TURNS = (0.0, 0.3, -0.3, 0.7, -0.7)  # rad/s, in order of preference
MARGIN = 0.05  # m and
HOLD = 0.4  # s: what a way back must leave, as `Window` asks of a way ahead


class Retreats:
    """Where the chair backed out last, and how often: each time farther than did not help."""

    def __init__(self) -> None:
        self._place, self._count = np.full(2, np.inf), 0

    def begin(self, place: Array) -> int:
        """How many times as far as usual to back out of a place (2,) [m]."""
        near = math.dist(place, self._place) < SAME
        self._count = min(self._count + 1, FARTHEST) if near else 1
        self._place = place.copy()
        return self._count


def crawled(twist: Array, outline: Footprint) -> Array:
    """A twist (2,) in reverse, slowed so that no rear corner moves faster than a crawl."""
    speed = corner_speed(twist[0], twist[1], outline.rear, outline.half_width)
    slowed: Array = twist * min(1.0, CRAWL / speed)
    return slowed


def back_out(around: Surroundings, reference: Reference, chair: Motion) -> Array | None:
    """The straightest slow twist (2,) back that leaves room to stop; None where there is none."""
    if around.blind:
        return None
    near, back = near_of(around, reference), -min(BACK, chair.limits.backward)
    for margin in around.margins(chair.footprint, MARGIN):
        for turn in TURNS:
            for v, w in ((back, turn), (0.0, turn)):
                if (v or w) and stops_clear(v, w, chair.body, near, HOLD, margin):
                    return np.array([v, w])
    return None


def turn(around: Surroundings, reference: Reference, chair: Motion, rate: float) -> Array | None:
    """The twist (2,) that turns in place at a rate [rad/s], if it leaves room to stop."""
    near = near_of(around, reference)
    for margin in around.margins(chair.footprint, MARGIN):
        if stops_clear(0.0, rate, chair.body, near, HOLD, margin):
            return np.array([0.0, rate])
    return None

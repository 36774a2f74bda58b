"""Out of where no follower finds a way on: backing out, and turning in place to look round."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.followers.follower import near_of
from agents.motion import Motion
from agents.reference import Reference
from agents.rollout import stops_clear
from agents.surroundings import Surroundings

Array = NDArray[np.float64]

BACK = 0.15  # m/s in reverse: nothing looks back
TURNS = (0.0, 0.3, -0.3, 0.7, -0.7)  # rad/s, in order of preference
MARGIN = 0.05  # m and
HOLD = 0.4  # s: what a way back must leave, as `Window` asks of a way ahead


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

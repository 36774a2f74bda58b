"""What a step was worth, and whether it ended the episode: pure functions of readings."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import kernel
from wheelchair_gym.geometry import wrap

Array = NDArray[np.float64]

TERMS = ("progress", "time", "arrived", "bumped", "timeout", "change", "withheld", "haste")


class Verdict(NamedTuple):
    """Named reward terms, weighted; the reward is their sum."""

    terms: tuple[float, ...]  # (8,) in the order of TERMS
    reward: float
    arrived: bool  # by the chair's own estimate
    terminated: bool  # arrived or bumped
    truncated: bool  # out of time, and neither of the two
    valid_beams: int  # of the reading's scan
    geodesic: float  # m, from the episode's start


@kernel
def reached(
    pose: Array, goal: Array, tolerance: float, heading: bool, heading_tolerance: float
) -> bool:
    """Whether a pose (3,) counts as being at a goal (3,)."""
    if math.hypot(goal[0] - pose[0], goal[1] - pose[1]) > tolerance:
        return False
    return not heading or abs(wrap(goal[2] - pose[2])) <= heading_tolerance


@kernel
def weigh(
    weights: Array,
    progress: float,
    period: float,
    arrived: bool,
    bumped: bool,
    timeout: bool,
    action: Array,
    previous: Array,
    withheld: float,
    haste: float,
    out: Array,
) -> None:
    """The reward terms of one step.

    Args:
        weights: (8,) in the order of TERMS.
        progress: way to go that was covered [m].
        period: control period [s].
        arrived: at the goal, by the chair's own estimate.
        bumped: a bumper strip is pressed.
        timeout: the time limit is reached, and neither of the two.
        action: (2,) in [-1, 1].
        previous: the action before.
        withheld: of the twist that was asked for by a shield, in full speeds.
        haste: squared speed near what the scan shows [m2/s2].
        out: (8,) weighted terms.
    """
    change = (action[0] - previous[0]) ** 2 + (action[1] - previous[1]) ** 2
    out[0] = weights[0] * progress
    out[1] = weights[1] * period
    out[2] = weights[2] * arrived
    out[3] = weights[3] * bumped
    out[4] = weights[4] * timeout
    out[5] = weights[5] * change
    out[6] = weights[6] * withheld
    out[7] = weights[7] * haste * period

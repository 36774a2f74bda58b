"""Hidden chairs that `wheelchair fit` must identify: a Latin hypercube, drawn before the fit was.

Only this program reads what is hidden; the fit sees logs alone.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from scipy.stats import qmc

SEED: Final = 66_2411  # of the hypercube
CHAIRS: Final = 24
# Hidden quantities and their bounds; rows of `chair.randomization`, but for the first.
HIDDEN: Final[dict[str, tuple[float, float]]] = {
    "delay": (0.0, 0.09),  # s: of the scans' stamps
    "laser.sigma": (0.008, 0.025),
    "laser.x_error": (-0.05, 0.05),
    "laser.y_error": (-0.05, 0.05),
    "laser.yaw_error": (-math.radians(3.0), math.radians(3.0)),
    "laser.offset_error": (-0.04, 0.04),
    "odometry.scale_error": (-0.01, 0.01),
    "odometry.diameter_error": (-0.02, 0.02),
    "odometry.track_error": (-0.03, 0.03),
    "body.mass": (90.0, 220.0),
    "motor.gain": (0.8, 1.2),
}
SLOPES: Final = {2: 1.0, 7: 1.5, 13: 2.0, 19: 3.0}  # deg, of these chairs' floors
WEAK_BATTERIES: Final = {4: 0.1, 9: 0.15, 15: 0.2, 22: 0.25}  # charge of these chairs


def hidden_chair(number: int) -> dict[str, float]:
    """What is hidden of one of the chairs, by the names of HIDDEN, `slope` [rad] and `charge`."""
    draws = qmc.LatinHypercube(len(HIDDEN), seed=SEED).random(CHAIRS)[number]
    found: dict[str, Any] = {
        name: float(low + share * (high - low))
        for share, (name, (low, high)) in zip(draws, HIDDEN.items(), strict=True)
    }
    found["slope"] = math.radians(SLOPES.get(number, 0.0))
    found["downhill"] = float(np.random.default_rng(SEED + number).uniform(-math.pi, math.pi))
    found["charge"] = WEAK_BATTERIES.get(number, 0.9)
    return found

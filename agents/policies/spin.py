"""Looking round: a slow turn in place, to see what the laser has never looked at."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agents.control.backup import turn
from agents.control.local_map import Surroundings
from agents.control.motion import Motion
from agents.control.reference import Reference
from wheelchair_gym.geometry import to_frame

Array = NDArray[np.float64]

RATE = 0.2  # rad/s: the rear corners enter what was not seen slower than 0.1 m/s
ROUND = 2.0 * math.pi  # rad
ELSEWHERE = 0.5  # m: from here on the chair may look round again


class LookRound:
    """Begins where a chair has not looked round yet; goes on until that is done."""

    def __init__(self) -> None:
        self._rate = 0.0  # rad/s
        self._turned = 0.0  # rad
        self._place = np.full(2, np.inf)  # m: where it was done last

    @property
    def on(self) -> bool:
        """Whether the chair is at it."""
        return self._rate != 0.0

    @property
    def done(self) -> bool:
        """Whether it has turned all round."""
        return self._turned > ROUND

    def begin(self, pose: Array, goal: Array) -> None:
        """Begin towards a goal (2 or 3,), unless it was done here."""
        if np.hypot(*(pose[:2] - self._place)) > ELSEWHERE:
            self._rate = math.copysign(RATE, to_frame(goal[:2], pose)[1])
            self._place, self._turned = pose[:2].copy(), 0.0

    def end(self) -> None:
        """It has seen enough."""
        self._rate = 0.0

    def twist(
        self, around: Surroundings, reference: Reference, chair: Motion, period: float
    ) -> Array | None:
        """The next twist (2,), the other way round where this one is closed; None ends it."""
        self._turned += RATE * period
        for rate in (self._rate, -self._rate):
            twist = turn(around, reference, chair, rate)
            if twist is not None:
                self._rate = rate
                return twist
        self.end()
        return None

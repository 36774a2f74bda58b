"""How the chair moves now: what it was told, as its ramps will have carried it out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.control.rollout import Body
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.kinematics import Limits, approach

Array = NDArray[np.float64]


class Motion:
    """Speed and turn with their slopes, which no encoder tells; and what bounds them.

    Attributes:
        state: speed, its slope, turn, its slope (4,).
        last: the target twist commanded last (2,).
    """

    def __init__(self, limits: Limits, outline: Footprint, period: float) -> None:
        self.limits = limits
        self.outline = outline
        self.array = limits.array
        self.footprint = outline.array
        self.period = period
        self.state: Array = np.zeros(4)
        self.last: Array = np.zeros(2)

    @property
    def body(self) -> Body:
        """The chair as kernels take it."""
        return Body(self.state, self.last, self.array, self.footprint)

    def measured(self, twist: Array) -> None:
        """Believe the encoders where the ramps must be wrong: a bump, a slip, a shield."""
        for k, far in ((0, 0.10), (1, 0.20)):
            if abs(self.state[2 * k] - twist[k]) > far:
                self.state[2 * k], self.state[2 * k + 1] = twist[k], 0.0

    def command(self, twist: Array) -> None:
        """Note what is commanded for the next period."""
        a, s = self.array, self.state
        s[:2] = approach(s[0], s[1], twist[0], a[3], a[4], a[7], self.period)
        s[2:] = approach(s[2], s[3], twist[1], a[6], a[6], a[8], self.period)
        self.last = np.array(twist)

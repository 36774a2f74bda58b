"""Telling: the state that a driver is in, in words for people, as the task's note."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.control.follower import CREEP

Array = NDArray[np.float64]

CLOSE = 2.0  # m from the outline, within which what moves explains why the chair stands


class Telling:
    """Says what a chair is about.

    Attributes:
        state: the last that was said.
    """

    def __init__(self, task: Any) -> None:
        self._task = task
        self._shown = 0.0  # s for which the state is shown still
        self.state = "follows"

    def tick(self, period: float) -> None:
        """Time goes by [s]."""
        self._shown -= period

    def say(self, state: str, more: str = "", shown: float | None = None) -> None:
        """Name a state; while it is shown [s], following its path is not worth a word."""
        self.state = state
        self._task.note = ": ".join(filter(None, (state, more)))
        self._shown = self._shown if shown is None else shown

    def follow(self, twist: Array | None, movers: Array, more: str) -> None:
        """Name the state that a follower's twist (2,) means, among movers (m, 5)."""
        gap = np.hypot(movers[:, 0], movers[:, 1]).min(initial=np.inf)
        near = gap < CLOSE + self._task.footprint.reach
        v = 0.0 if twist is None else twist[0]
        if near and v < 0.0:
            self.say("gives way")
        elif near and v < CREEP:
            self.say("halts")
        elif twist is None:
            self.say("waits")
        elif self._shown <= 0.0:
            self.say("follows", more)

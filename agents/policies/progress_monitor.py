"""How far along its path a chair has come, and what its state is called for people."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.control.follower import CREEP
from wheelchair_gym.geometry import Footprint

GAIN = 0.1  # m of way that count as headway
HURRY = 0.4  # share of the patience at the path's end, where the goal is near but not reached
BOLD = 1.0  # m of way once there was no headway on which room costs nothing; margins stay
COURTESY = 0.5  # share at which time counts as lost while the chair halts for what moves


class Headway:
    """What a chair has patience for.

    Attributes:
        tries: plans made since there was headway.
        bold: m of way on which room costs nothing.
    """

    def __init__(self, patience: float) -> None:
        self._patience = patience  # s
        self.tries, self.bold = 0, 0.0
        self.begin()

    def begin(self) -> None:
        """A new path begins."""
        self._best = self._since = 0.0  # m of way, s without more

    def wait(self) -> None:
        """What was just tried is given its time."""
        self._since = 0.0

    def come(self, way: float) -> bool:
        """Take in how far the chair has come [m]; whether that is headway."""
        if way <= self._best + GAIN:
            return False
        self.bold = max(0.0, self.bold - (way - self._best))
        self._best, self._since, self.tries = way, 0.0, 0
        return True

    def lose(self, period: float, halting: bool) -> None:
        """Time [s] goes by; less is lost while the chair halts for what moves."""
        self._since += period * (COURTESY if halting else 1.0)

    def stalled(self, ended: bool) -> bool:
        """Whether patience is at its end, which is sooner where the path has ended."""
        return self._since > (HURRY if ended else 1.0) * self._patience

    def dare(self) -> None:
        """Something else is tried, boldly."""
        self.tries += 1
        self._since, self.bold = 0.0, BOLD


Array = NDArray[np.float64]

CLOSE = 2.0  # m from the outline, within which what moves explains why the chair stands


class Telling:
    """Says what a chair is about.

    Attributes:
        state: the last that was said.
        status: the same, and why: a line for people.
    """

    def __init__(self, outline: Footprint) -> None:
        self._outline = outline
        self._shown = 0.0  # s for which the state is shown still
        self.state, self.status = "follows", ""

    def tick(self, period: float) -> None:
        """Time goes by [s]."""
        self._shown -= period

    def say(self, state: str, more: str = "", shown: float | None = None) -> None:
        """Name a state; while it is shown [s], following its path is not worth a word."""
        self.state = state
        self.status = ": ".join(filter(None, (state, more)))
        self._shown = self._shown if shown is None else shown

    def follow(self, twist: Array | None, movers: Array, more: str) -> None:
        """Name the state that a follower's twist (2,) means, among movers (m, 5)."""
        gap = np.hypot(movers[:, 0], movers[:, 1]).min(initial=np.inf)
        near = gap < CLOSE + self._outline.reach
        v = 0.0 if twist is None else twist[0]
        if near and v < 0.0:
            self.say("gives way")
        elif near and v < CREEP:
            self.say("halts")
        elif twist is None:
            self.say("waits")
        elif self._shown <= 0.0:
            self.say("follows", more)

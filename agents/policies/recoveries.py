"""When a chair gives up following its path, and its recoveries.

`ProgressMonitor` tells when. The chair then backs up or turns in place (`back_up`), makes room for
what blocks its path (`place_aside`), turns slowly to see what the laser has never seen (`Spin`),
or plans around temporary obstacles (`DetourPolicy`).
"""

from __future__ import annotations

import math

import numpy as np

from agents.control.followers import CREEP, HOLD, Situation
from agents.control.local_map import TemporaryObstacles
from agents.control.rollout import ReferencePath, stops_clear
from wheelchair_gym.arrays import Array
from wheelchair_gym.geometry import Footprint, to_frame
from wheelchair_gym.kinematics import corner_speed
from wheelchair_gym.maps import OccupancyGrid

PROGRESS = 0.1  # m of way that count as progress
END_SHARE = 0.4  # of the patience at the path's end, where the goal is near but not reached
BOLD = 1.0  # m of way after a stall on which clearance costs nothing; margins stay
HALT_SHARE = 0.5  # of time that counts while the chair halts for actors
BLOCKED_SHARE = 2.0  # of time that counts while a manoeuvre cannot be driven as planned
TURNING_SHARE = 0.25  # the same of a chair that turns in place: 3 rad at 0.19 rad/s take 16 s


class ProgressMonitor:
    """Measures the progress along a path, and tells when there has been none for too long.

    Attributes:
        tries: plans made since there was progress.
        bold: m of way on which clearance costs nothing.
    """

    def __init__(self, patience: float) -> None:
        self._patience = patience  # s
        self.tries, self.bold = 0, 0.0
        self.begin()

    def begin(self) -> None:
        """A new path begins."""
        self._best = self.stalled_time = 0.0  # m of way, s without progress

    def update(self, way: float) -> bool:
        """Whether the way [m] along the path is progress."""
        if way <= self._best + PROGRESS:
            return False
        self.bold = max(0.0, self.bold - (way - self._best))
        self._best, self.stalled_time, self.tries = way, 0.0, 0
        return True

    def stalled(self, ended: bool) -> bool:
        """Whether there is no progress for too long, which is sooner where the path has ended."""
        return self.stalled_time > (END_SHARE if ended else 1.0) * self._patience

    def retry(self) -> None:
        """Something else is tried, boldly."""
        self.tries += 1
        self.stalled_time, self.bold = 0.0, BOLD


ACTOR_RANGE = 2.0  # m from the outline, within which an actor explains why the chair stands


class StatusReport:
    """Names the chair's state for people.

    Attributes:
        state: the last one.
        status: the same, and why: a line of text.
        held: s for which the state is kept while the chair only follows.
    """

    def __init__(self, footprint: Footprint) -> None:
        self._footprint = footprint
        self.held = 0.0
        self.state, self.status = "follows", ""

    def set(self, state: str, reason: str = "", held: float | None = None) -> None:
        """Set the state, to be kept for a while [s] or as long as the last one."""
        self.state = state
        self.status = ": ".join(filter(None, (state, reason)))
        self.held = self.held if held is None else held

    def follow(self, twist: Array | None, actors: Array, reason: str) -> None:
        """Set the state that a follower's twist (2,) means, among actors (m, 5)."""
        gap = np.hypot(actors[:, 0], actors[:, 1]).min(initial=np.inf)
        near = gap < ACTOR_RANGE + self._footprint.reach
        v = 0.0 if twist is None else twist[0]
        if near and v < 0.0:
            self.set("gives way")
        elif near and v < CREEP:
            self.set("halts")
        elif twist is None:
            self.set("waits")
        elif self.held <= 0.0:
            self.set("follows", reason)


SPIN_RATE = 0.2  # rad/s: the rear corners enter unknown space slower than 0.1 m/s
SPIN_DISTANCE = 0.5  # m from the last spin, from which on the chair may spin again


class Spin:
    """A slow turn in place, once around at most, at a place where there was none yet."""

    def __init__(self) -> None:
        self._rate = 0.0  # rad/s
        self._turned = 0.0  # rad
        self._reversed = False  # it was blocked on one side already
        self._place = np.full(2, np.inf)  # m: of the last one

    @property
    def on(self) -> bool:
        """Whether the chair is spinning."""
        return self._rate != 0.0

    @property
    def done(self) -> bool:
        """Whether it has turned once around."""
        return self._turned > 2.0 * math.pi

    def begin(self, pose: Array, goal: Array) -> None:
        """Begin towards a goal (2 or 3,), unless there was a spin here."""
        if np.hypot(*(pose[:2] - self._place)) > SPIN_DISTANCE:
            self._rate = math.copysign(SPIN_RATE, to_frame(goal[:2], pose)[1])
            self._place, self._turned, self._reversed = pose[:2].copy(), 0.0, False

    def end(self) -> None:
        """Stop: enough was seen."""
        self._rate = 0.0

    def twist(self, now: Situation) -> Array | None:
        """The next twist (2,); once, the other way around where one is blocked; None ends it."""
        self._turned += SPIN_RATE * now.chair.period
        twist = first_clear([(0.0, self._rate)], now)
        if twist is None and not self._reversed:
            self._rate, self._reversed = -self._rate, True
            twist = first_clear([(0.0, self._rate)], now)
        if twist is None:
            self.end()
        return twist


BACK = 0.15  # m/s in reverse: no sensor looks back
CRAWL = 0.04  # m/s of any part in reverse among people: harmless to whom it hits
SAME_PLACE = 1.0  # m: so near the last place it backs up farther, up to
FARTHEST = 4  # times as far
TURNS = (0.0, 0.3, -0.3, 0.7, -0.7)  # rad/s, in order of preference
MARGIN = 0.05  # m that a way back must leave, as `Window` asks of a way ahead


class BackUp:
    """Where the chair backed up last, and how often: each time farther than did not help."""

    def __init__(self) -> None:
        self._place, self._count = np.full(2, np.inf), 0

    def begin(self, place: Array) -> int:
        """How many times as far as usual to back up from a place (2,) [m]."""
        near = math.dist(place, self._place) < SAME_PLACE
        self._count = min(self._count + 1, FARTHEST) if near else 1
        self._place = place.copy()
        return self._count


def crawled(twist: Array, footprint: Footprint) -> Array:
    """A twist (2,) in reverse, slowed so that no rear corner moves faster than a crawl."""
    speed = corner_speed(twist[0], twist[1], footprint.rear, footprint.half_width)
    slowed: Array = twist * min(1.0, CRAWL / speed)
    return slowed


def first_clear(twists: list[tuple[float, float]], now: Situation) -> Array | None:
    """The first twist (2,) from which the chair can stop clear, at the widest margin; or None."""
    view = now.view
    for margin in now.local_map.margins(MARGIN):
        for v, w in twists:
            if stops_clear(v, w, now.chair.body, view, HOLD, margin):
                return np.array([v, w])
    return None


def back_up(now: Situation) -> Array | None:
    """The straightest slow twist (2,) back that leaves space to stop; None where there is none."""
    if now.local_map.blind:
        return None
    back = -min(BACK, now.chair.limits.backward)
    twists = [(v, turn) for turn in TURNS for v in (back, 0.0) if v or turn]
    return first_clear(twists, now)


ROOM = 2.0  # m from what blocks the path: a leaf's length, the chair's front and a margin
ASIDE = 3.0  # m: no place farther away is looked at
BREADTH = 0.45  # m of clearance there
GAINED = 0.3  # m that a place must be farther from what blocks than the chair is
EVERY = 3  # cells between two places


def place_aside(grid: OccupancyGrid, place: Array, blocking: Array) -> Array | None:
    """The place (2,) near the chair's that leaves most room to what blocks its path (n, 2) [m].

    A leaf that the chair holds can then swing, and whoever stands before it can pass. None where no
    place leaves more than the chair does now.
    """
    cells = np.argwhere(grid.traversable(BREADTH)[::EVERY, ::EVERY]) * EVERY
    places: Array = np.concatenate([place[None, :2], grid.to_world(cells)])
    way = np.hypot(*(places - place[:2]).T)
    places, way = places[way < ASIDE], way[way < ASIDE]
    gaps = np.hypot(*(places[:, None] - blocking).T).min(axis=0)
    best = int(np.argmax(np.minimum(gaps, ROOM) - 0.2 * way))
    return places[best] if gaps[best] > gaps[0] + GAINED else None


AHEAD = 3.0  # m of the path on which temporary obstacles count
RETRY_TIME = 3.0  # s until a plan that found no way is tried again
DETOUR = 2.0  # m by which a detour may be longer at once, and
STROLL = 0.5  # m/s more the longer the chair waits: it waits as long as the detour would cost
TOLERATED = 0.06  # m: obstacles are drawn as whole cells, and hits err


class DetourPolicy:
    """Decides between a detour around temporary obstacles and waiting.

    Attributes:
        taken: the path leads around temporary obstacles.
        waited: s that the chair has waited rather than take a long detour.
        pause: s until a detour is planned again.
        failed: plans since one that led round them.
    """

    def __init__(self) -> None:
        self.taken = False
        self.waited = self.pause = 0.0
        self.failed = 0
        self._checked = 0.0  # s since the path was last checked

    def wait(self) -> float:
        """Take no detour for a time [s], which is returned."""
        self.pause = RETRY_TIME
        return RETRY_TIME

    @property
    def allowance(self) -> float:
        """By how much [m] a way round may be longer, by now."""
        return DETOUR + STROLL * self.waited

    def too_long(self, detour: ReferencePath, blocked: ReferencePath) -> bool:
        """Whether a detour is so long that the chair waits; then it has waited longer."""
        long = detour.left > blocked.left + self.allowance
        self.waited += RETRY_TIME * long
        return long

    def due(self, period: float, every: float) -> bool:
        """Whether it is time to check the path for temporary obstacles."""
        self._checked += period
        if self._checked < every or self.pause > 0.0:
            return False
        self._checked = 0.0
        return True


def is_blocked(
    temporary: TemporaryObstacles, reference: ReferencePath, clearance: float, ahead: float = AHEAD
) -> bool:
    """Whether a temporary obstacle is on the next metres of the path."""
    rows = reference.rows[reference.at :]
    return temporary.blocks(rows[rows[:, 3] < reference.way + ahead], clearance - TOLERATED)

"""Progress of a chair along its path, and its recoveries.

`ProgressMonitor` tells when there was none for too long. The chair then backs up or turns in place
(`BackUp`), makes room for what blocks its path (`place_aside`), turns slowly to see what the laser
has never seen (`Spin`), or plans around temporary obstacles (`DetourPolicy`).
"""

import math

import numpy as np

from agents.control.followers import CREEP, Situation
from agents.control.rollout import ReferencePath
from planners.problem import Plan, Status
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import to_frame
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
        tries: recoveries begun since there was progress.
        bold: m of way on which clearance costs nothing.
        left_before: m that were left of the path when a new one was tried; infinite if none was.
    """

    def __init__(self, patience: float) -> None:
        self._patience = patience  # s
        self.tries, self.bold, self.left_before = 0, 0.0, math.inf
        self.begin()

    def begin(self) -> None:
        """A new path begins."""
        self._best = self.stalled_time = 0.0  # m of way, s without progress

    def update(self, path: ReferencePath, period: float, halts: bool) -> bool:
        """Update from a control period [s] on a path; return True if there was progress."""
        progress = path.way > self._best + PROGRESS
        if progress:
            self.bold = max(0.0, self.bold - (path.way - self._best))
            self._best, self.stalled_time, self.tries = path.way, 0.0, 0
        share = BLOCKED_SHARE if path.blocked else TURNING_SHARE if path.turning else 1.0
        self.stalled_time += period * (HALT_SHARE if halts else share)
        return progress

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

    def explain(self, plan: Plan) -> None:
        """Tell why the chair follows a plan that is not the best, or leads nowhere."""
        plain = plan.status is Status.SOLVED and not plan.note
        self._reason = "" if plain else f"{plan.status.name} {plan.note}".strip()

    def follow(self, twist: Array | None, actors: Array) -> None:
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
            self.set("follows", self._reason)


MARGIN = 0.05  # m that a manoeuvre must leave, as `Window` asks of a way ahead
SPIN_RATE = 0.2  # rad/s: the rear corners enter unknown space slower than 0.1 m/s
SPIN_DISTANCE = 0.5  # m from the last spin, from which on the chair may spin again


class Spin:
    """A slow turn in place, once around at most, at a place where there was none yet."""

    def __init__(self) -> None:
        self._rate = 0.0  # rad/s
        self.turned = 0.0  # rad
        self._reversed = False  # it was blocked on one side already
        self._place = np.full(2, np.inf)  # m: of the last one

    def is_new(self, pose: Array) -> bool:
        """Whether there was no turn here yet."""
        return bool(np.hypot(*(pose[:2] - self._place)) > SPIN_DISTANCE)

    def begin(self, pose: Array, goal: Array) -> None:
        """Begin towards a goal (2 or 3,)."""
        self._rate = math.copysign(SPIN_RATE, to_frame(goal[:2], pose)[1])
        self._place, self.turned, self._reversed = pose[:2].copy(), 0.0, False

    def twist(self, now: Situation) -> Array | None:
        """The next twist (2,); once, the other way around where one is blocked; None: both are."""
        self.turned += min(SPIN_RATE, now.chair.limits.turn) * now.chair.period
        twist = now.first_clear([(0.0, self._rate)], MARGIN)
        if twist is None and not self._reversed:
            self._rate, self._reversed = -self._rate, True
            twist = now.first_clear([(0.0, self._rate)], MARGIN)
        return twist


BACK = 0.15  # m/s in reverse: no sensor looks back
SAME_PLACE = 1.0  # m: so near the last place it backs up farther, up to
FARTHEST = 4  # times as far
TURNS = (0.0, 0.3, -0.3, 0.7, -0.7)  # rad/s, in order of preference


class BackUp:
    """Slow driving back, and turns where that is blocked: each time farther than did not help.

    Attributes:
        left: s to go on.
    """

    def __init__(self, duration: float) -> None:
        self._duration, self.left = duration, 0.0  # s
        self._place, self._count = np.full(2, np.inf), 0  # of the last one

    def begin(self, place: Array, crawls: bool) -> None:
        """Begin at a place (2,) [m]; a chair that crawls backs up as far as at first."""
        near = math.dist(place, self._place) < SAME_PLACE
        self._count = min(self._count + 1, FARTHEST) if near else 1
        self._place, self.left = place.copy(), self._duration * (1 if crawls else self._count)

    def twist(self, now: Situation) -> Array | None:
        """The straightest slow twist (2,) that leaves space to stop; None where there is none."""
        if now.local_map.blind:
            return None
        back = -min(BACK, now.chair.limits.backward)
        twists = ((v, turn) for turn in TURNS for v in (back, 0.0) if v or turn)
        return now.first_clear(twists, MARGIN)


ROOM = 2.0  # m from what blocks the path: a leaf's length, the chair's front and a margin
ASIDE = 3.0  # m: no place farther away is looked at
BREADTH = 0.45  # m of clearance there
GAINED = 0.3  # m that a place must be farther from what blocks than the chair is
EVERY = 3  # cells between two places


def place_aside(grid: OccupancyGrid, place: Array, blocking: Array) -> Array | None:
    """The place (2,) near the chair's that leaves most room to what blocks its path (n, 2) [m].

    A leaf that the chair holds can then swing, and a person in front of it can pass. None where no
    place leaves more than the chair does now.
    """
    cells = np.argwhere(grid.traversable(BREADTH)[::EVERY, ::EVERY]) * EVERY
    places: Array = np.concatenate([place[None, :2], grid.to_world(cells)])
    way = np.hypot(*(places - place[:2]).T)
    places, way = places[way < ASIDE], way[way < ASIDE]
    gaps = np.hypot(*(places[:, None] - blocking).T).min(axis=0)
    best = int(np.argmax(np.minimum(gaps, ROOM) - 0.2 * way))
    return places[best] if gaps[best] > gaps[0] + GAINED else None


RETRY_TIME = 3.0  # s until a plan that found no way is tried again
DETOUR = 2.0  # m that a detour may be longer at once, and
STROLL = 0.5  # m/s more the longer the chair waits: it waits as long as the detour would cost


class DetourPolicy:
    """Decides between a detour around temporary obstacles and waiting.

    Attributes:
        taken: the last plan leads around temporary obstacles.
        waited: s that the chair has waited rather than take a long detour.
        pause: s until a detour is planned again.
        failed: plans since one that led round them.
        unchecked: s since the path was last checked.
    """

    def __init__(self) -> None:
        self.taken, self.failed = False, 0
        self.waited = self.pause = self.unchecked = 0.0

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
        """Whether it is time to check the path again."""
        self.unchecked += period
        if self.unchecked < every or self.pause > 0.0:
            return False
        self.unchecked = 0.0
        return True

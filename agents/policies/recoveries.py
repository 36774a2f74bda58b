"""What a chair does where its path does not lead on.

It backs out or turns in place (`back_out`, `turn`), turns slowly to see what the laser has never
looked at, plans a way round temporary obstacles, or plans anew with less clearance.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agents.control.follower import near_of
from agents.control.local_map import Surroundings
from agents.control.reference import Reference
from agents.control.rollout import Motion, stops_clear
from agents.control.temporary_obstacles import Standing
from agents.evaluation.metrics import backing
from planners import Planner
from planners.collision.space import Space
from planners.problem import Plan, Problem, Status
from wheelchair_gym.geometry import Footprint, to_frame
from wheelchair_gym.kinematics import corner_speed
from wheelchair_gym.maps import FREE, UNKNOWN, OccupancyGrid, bottleneck

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


AHEAD = 3.0  # m of the path on which temporary obstacles count
AGAIN = 3.0  # s until a plan is tried again that led round nothing
DETOUR = 2.0  # m by which a way round may be longer at once, and
STROLL = 0.5  # m/s more the longer it waits: it waits as long as the way round would cost
TOLERATED = 0.06  # m: cells are drawn whole, and hits err


class Detours:
    """What a chair remembers of ways round.

    Attributes:
        taken: the path leads round what is temporary.
    """

    def __init__(self) -> None:
        self.taken = False
        self._looked = 0.0  # s since the last look at what stands on the way
        self._held = 0.0  # s that the chair has waited rather than go a long way round
        self._waited = 0.0  # s until a plan is tried again that led round nothing

    def end_wait(self) -> None:
        """The chair goes on: what it waited for is past."""
        self._held = 0.0

    def wait(self) -> float:
        """No way round is taken for now; for so long [s]."""
        self._waited = AGAIN
        return AGAIN

    def tick(self, period: float) -> None:
        """Time goes by [s]."""
        self._waited -= period

    def too_long(self, way_round: Reference, barred: Reference) -> bool:
        """Whether a way round is so long that the chair rather waits; then it has waited more."""
        long = way_round.left > barred.left + DETOUR + STROLL * self._held
        self._held += AGAIN * long
        return long

    def due(self, period: float, every: float) -> bool:
        """Whether it is time to look at what stands on the way."""
        self._looked += period
        if self._looked < every or self._waited > 0.0:
            return False
        self._looked = 0.0
        return True


def barred(standing: Standing, reference: Reference, clearance: float) -> bool:
    """Whether a temporary obstacle stands on the next metres of the way."""
    rows = reference.rows[reference.at :]
    ahead = rows[rows[:, 3] < reference.way + AHEAD]
    return standing.on_way(ahead, clearance - TOLERATED)


FINER = 0.04  # m: a plan that finds no way is tried again with this much less clearance,
BACKS = 0.3  # m: and once more if it leads so far in reverse, where nothing looks


def widest_plan(
    planner: Planner,
    known: OccupancyGrid,
    start: Array,
    goal: Array,
    clearance: float,
    least: float,
    rng: np.random.Generator,
) -> tuple[Plan, float]:
    """Plan in a map at the widest clearance that leads to the goal.

    Args:
        planner: makes the plans.
        known: the map; what is unknown is taken for free.
        start: pose (3,) [m, m, rad].
        goal: (2 or 3,) [m, m, rad].
        clearance: to begin with [m].
        least: to end with [m].
        rng: the planner's.

    Returns:
        The plan, the last one tried if none leads there, and its clearance [m].
    """
    space = Space.from_grid(known)
    free = np.where(known.cells == UNKNOWN, FREE, known.cells)
    taken = OccupancyGrid(free, known.resolution, known.origin)
    most = bottleneck(taken, start[:2], goal[:2]) + 0.5 * known.resolution
    while clearance > most and clearance - FINER >= least:
        clearance -= FINER  # what no disc passes is not worth a search
    best = math.inf  # m in reverse
    while True:
        plan = planner.plan(Problem(space, start, goal, clearance), rng)
        found, backs = plan.status is Status.SOLVED, backing(plan.path)
        second = best < math.inf
        if not second or (found and backs < best - BACKS):
            chosen = plan, clearance
        clearance -= FINER
        if second or (found and backs < BACKS) or clearance < least:
            return chosen
        best = backs if found else best  # once more: with less clearance it may lead ahead

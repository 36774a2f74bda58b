"""Bug algorithms: straight to the goal, and around obstacles, exactly along their boundary.

Touching is allowed, so the walk of a bug is a free path. A bug that goes all the way around an
obstacle and finds no point to leave it proves that there is no path.
"""

import math
from abc import abstractmethod
from typing import Literal, NamedTuple

import numpy as np

from planners.collision.boundary import (
    blocking_segments,
    boundary_loop,
    fraction_along,
    last_corner_on_line,
    leads_into_solid,
    line_intersection,
    segment_links,
)
from planners.collision.polygon_tests import Index, SpaceArrays, edge_free, orient2d
from planners.problem import Plan, PlannerBase, Problem, Status, answer
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.compiled.kernel import kernel
from wheelchair_gym.geometry.planar import path_length, without_repeats

# m: distances that rounding may move a point off a slanted side.
NUDGES = (0.0, *(10.0**k for k in range(-16, -5)))
CLOSE = 1e-9  # of a path: segments met at one point within rounding


class Hit(NamedTuple):
    """The point where a straight path to the goal meets an obstacle."""

    origin: Array  # (2,) m: where the way began
    base: Array  # (2,) m: a point on it, from where the rest of it is straight to the last digit
    point: Array  # (2,) m
    segment: int
    part: float  # of the way


class Solids(NamedTuple):
    """The boundary of obstacles, and its order."""

    arrays: SpaceArrays
    following: Index
    preceding: Index


class RoundingError(ArithmeticError):
    """Rounding hides on which side of a boundary a point lies."""


def _hit(solids: Solids, origin: Array, goal: Array) -> Hit | None:
    """Return the end of the straight path to the goal; None if that is the goal."""
    arrays, way = solids.arrays, goal - origin
    if edge_free(arrays, *origin, *goal):
        return None
    found, parts = blocking_segments(arrays, *origin, *goal)
    first = parts.min()
    # A way along a slanted side leaves it by a digit, unless it goes by a corner exactly on it.
    corner = last_corner_on_line(arrays, origin[0], origin[1], goal[0], goal[1], first)
    bases = [origin, *([arrays.segments[corner, :2]] if corner >= 0 else [])]
    for k in found[parts <= first + CLOSE]:
        for base in bases:
            for nudge in NUDGES:
                part = max(0.0, first - nudge / math.hypot(*way))
                point = origin + part * way
                if base is not origin and fraction_along(*origin, *goal, *base) >= part:
                    point = base
                ends = (base, arrays.segments[k, :2], arrays.segments[k, 2:])
                if all(edge_free(arrays, *point, *end) for end in ends):
                    return Hit(origin, base, point, int(k), part)
    raise RoundingError


def _reached(solids: Solids, corners: Array, to: Array, goal: Array) -> Array:
    """Return a walk over corners (n, 2) to a point, moved off the boundary as far as needed."""
    for nudge in NUDGES:
        point = to + min(1.0, nudge / max(math.hypot(*(goal - to)), nudge, 1e-300)) * (goal - to)
        if edge_free(solids.arrays, *corners[-1], *point):
            return np.vstack([corners, point])
    raise RoundingError


@kernel
def _way_off(
    arrays: SpaceArrays, loop: Index, forward: bool, origin: Array, goal: Array, part: float
) -> tuple[int, float, float]:
    """Return where a walk along segments `loop` (n,) leaves for the goal (2,) on the line to it.

    There, the rest of the line is shorter, and free at first. `forward`: each segment is walked
    from its beginning; `part` is the fraction of the line before the hit. Returns the number of
    corners passed before, -1 if the walk never meets such a point, and the point [m].
    """
    ox, oy, gx, gy = origin[0], origin[1], goal[0], goal[1]
    segments, n = arrays.segments, loop.shape[0]
    for m in range(n):
        k = loop[m]
        cx, cy, dx, dy = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
        c, d = orient2d(ox, oy, gx, gy, cx, cy), orient2d(ox, oy, gx, gy, dx, dy)
        if m > 0 and ((c > 0.0 and d < 0.0) or (c < 0.0 and d > 0.0)):
            if orient2d(cx, cy, dx, dy, gx, gy) == 0.0:
                return m, gx, gy
            x, y = line_intersection(segments, k, ox, oy, gx, gy)
            at = fraction_along(ox, oy, gx, gy, x, y)
            if part < at <= 1.0 and not leads_into_solid(arrays, k, False, gx, gy):
                return m, x, y
        after = loop[(m + 1) % n] if forward else k
        x, y = segments[after, 0], segments[after, 1]
        if orient2d(ox, oy, gx, gy, x, y) == 0.0:
            at = fraction_along(ox, oy, gx, gy, x, y)
            if part < at <= 1.0 and not leads_into_solid(arrays, after, True, gx, gy):
                return m + 1, x, y
    return -1, 0.0, 0.0


class Bug(PlannerBase):
    """A planner that walks straight to the goal, and along the boundary of obstacles."""

    @abstractmethod
    def detour(self, solids: Solids, hit: Hit, goal: Array) -> Array | None:
        """Return the points walked (n, 2) [m], the hit point first; None: nothing leads on."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return the walk to the goal, circuits included; the generator is not used."""
        solids = Solids(problem.free.arrays, *segment_links(problem.free.arrays))
        goal = np.array(problem.goal[:2], dtype=np.float64)
        path, hits = [np.array([problem.start[:2]], dtype=np.float64)], 0
        failure, note = Status.EXHAUSTED, "too narrow for the precision of coordinates"
        walk = np.empty((0, 2))
        try:
            # Each detour ends nearer to the goal, and no two begin in one place.
            while hits <= len(solids.following):
                hit = _hit(solids, path[-1][-1], goal)
                if hit is None:
                    walk = without_repeats(np.vstack([*path, goal]))
                    break
                hits += 1
                walked = self.detour(solids, hit, goal)
                if walked is None:
                    failure, note = Status.NO_PATH, "no path leads from this obstacle to the goal"
                    break
                path += [hit.base[None], walked]
                if clock() >= end:
                    note = "out of time"
                    break
        except RoundingError:
            pass
        return answer(walk, {"hits": hits}, note, failure)


@settings
class Bug1(Bug):
    """Bug1 (Lumelsky and Stepanov 1987): once around each obstacle, then on from its nearest point.

    Complete: it proves that there is no path. It walks at most 1.5 times around each obstacle.
    """

    def detour(self, solids: Solids, hit: Hit, goal: Array) -> Array | None:
        """Walk all the way around, then to the point nearest to the goal."""
        segments = solids.arrays.segments
        loop = boundary_loop(hit.segment, solids.following)
        here, along = segments[loop, :2], segments[loop, 2:] - segments[loop, :2]
        part = np.clip(((goal - here) * along).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
        nearest = here + part[:, None] * along
        m = int(np.hypot(*(goal - nearest).T).argmin())
        leave, corner = nearest[m], part[m] in (0.0, 1.0)
        if part[m] == 1.0:
            m = (m + 1) % len(loop)
        if corner:
            leave = segments[loop[m], :2]
        elif orient2d(*segments[loop[m]], *goal) == 0.0:
            leave = goal
        if leads_into_solid(solids.arrays, loop[m], bool(corner), *goal):
            return None
        ends = segments[loop, 2:]
        ahead = np.vstack([hit.point, ends[:m]])
        back = np.vstack([hit.point, ends[m:][::-1]]) if m > 0 else ahead
        walks = [np.vstack([corners, leave]) for corners in (ahead, back)]
        shorter = ahead if path_length(walks[0]) <= path_length(walks[1]) else back
        return np.vstack([hit.point, ends, _reached(solids, shorter, leave, goal)])


@settings
class Bug2(Bug):
    """Bug2 (Lumelsky and Stepanov 1987): around each obstacle until the straight line goes on.

    Complete: it proves that there is no path.
    """

    turn: Literal["left", "right"] = setting(default="left", source="Lumelsky and Stepanov 1987")
    """Side to which the robot turns at an obstacle."""

    def detour(self, solids: Solids, hit: Hit, goal: Array) -> Array | None:
        """Walk along the boundary until the line to the goal is met nearer to it."""
        forward = self.turn == "right"  # the obstacle is then on the left hand
        loop = boundary_loop(hit.segment, solids.following if forward else solids.preceding)
        passed, x, y = _way_off(solids.arrays, loop, forward, hit.origin, goal, hit.part)
        if passed < 0:
            return None
        ends = solids.arrays.segments[loop[:passed]][:, [2, 3] if forward else [0, 1]]
        return _reached(solids, np.vstack([hit.point, ends]), np.array([x, y]), goal)

"""Whether a problem's start and goal are places where a path can begin and end."""

from __future__ import annotations

from planners.exact import point_free
from planners.types import Problem, Status


def endpoint_status(problem: Problem) -> Status | None:
    """What is wrong with a problem's ends, if anything is."""
    bounds, arrays = problem.space.arrays.bounds, problem.free.arrays
    for end, outside, occupied in (
        (problem.start, Status.START_OUTSIDE, Status.START_OCCUPIED),
        (problem.goal, Status.GOAL_OUTSIDE, Status.GOAL_OCCUPIED),
    ):
        x, y = float(end[0]), float(end[1])
        if not (bounds[0] <= x <= bounds[2] and bounds[1] <= y <= bounds[3]):
            return outside
        if not point_free(arrays, x, y):
            return occupied
    return None

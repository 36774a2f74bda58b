"""The values that make one planner of the growing loop, its state, and the room it works in."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.collision.polygon_tests import SpaceArrays, way_free
from planners.trees.tree import NONE
from wheelchair_gym.compiled.kernel import borrowing_kernel

Array = NDArray[np.float64]

# Neighbours looked at round one new node; the shrinking radius keeps their number near 3 log n.
_NEIGHBOURS = 256
# Costs must fall by more than this to rewire [m]: rounding alone may not make a loop.
GAIN = 1e-9


class Growth(NamedTuple):
    """The values that make one planner of the loop; by default a plain RRT."""

    step: float  # m, longest edge towards a sample
    reach: float  # m, from where the straight edge to the goal is tried
    limit: int  # nodes of a tree
    reserve: int = 16  # nodes that one iteration may add, but for the way from the goal's tree
    goal_bias: float = 0.0  # part of the samples laid on the goal until it is reached
    stop_at_first: bool = True  # end with the first path
    both_ways: bool = False  # a second tree grows from the goal until they meet (RRT-Connect)
    rewiring: bool = False  # choose the best parent and rewire (RRT*)
    radius: float = 0.0  # m, of the search for neighbours; 0 for the shrinking rule
    gamma: float = 0.0  # of the shrinking rule gamma sqrt(area log n / n)
    climbing: bool = False  # an ancestor is the better parent as long as it sees the new node
    recycling: bool = False  # at the limit a childless node makes room (RRT*FN)
    shortening: bool = False  # the best path's own vertices are joined where they see each other
    informed: bool = False  # only what can shorten the best path is sampled and kept
    beacon_share: float = 0.0  # part of the samples near the best path's vertices (RRT*-Smart)
    beacon_radius: float = 0.0  # m, how near
    beacon_finest: float = 1.0  # the radius is drawn from [finest, 1] of that, by its logarithm
    corner_share: float = 0.0  # part of the samples near corners of what is solid
    corner_radius: float = 0.0  # m, how near
    in_strip: bool = False  # samples between start and goal in x, more where blocked
    widening: float = 0.0  # m, on each side of the strip for each blocked extension
    whales: bool = False  # steer by whales (the local variant)


RUN = np.dtype(
    [
        ("iteration", np.int64),  # samples drawn
        ("first", np.int64),  # the iteration that reached the goal; NONE if none did
        ("tests", np.int64),  # edges tested
        ("blocked", np.int64),  # extensions that were not free,
        ("cuts", np.int64),  # and those of them that end in a free point
        ("goal", np.int64),  # the goal's node in the tree of the start; NONE before it is reached
        ("beacon", np.int64),  # place in the chain of the vertex sampled round; NONE if none
        ("length", np.float64),  # m, of the best path when it was last shortened
        ("area", np.float64),  # m2, of where samples fall
        ("margin", np.float64),  # m, on each side of the strip
        ("backward", np.bool_),  # the next sample is for the tree of the goal
        ("done", np.bool_),  # nothing more can be gained
    ]
)


class Room(NamedTuple):
    """The state of a run and room that the loop works in."""

    run: NDArray[Any]  # (1,) RUN
    found: NDArray[np.int32]  # neighbours of the new node,
    distances: Array  # m, their distances,
    through: Array  # m, and what the new node costs through each
    chain: NDArray[np.int32]  # the best path's nodes, the goal first
    stack: NDArray[np.int32]  # nodes whose children's costs are still to follow


def new_run(bounds: Array) -> NDArray[Any]:
    """The state (1,) of a run that begins on a map with bounds (4,) [m]."""
    run = np.zeros(1, RUN)
    run["first"] = run["goal"] = run["beacon"] = NONE
    run["length"] = np.inf
    run["area"] = (bounds[2] - bounds[0]) * (bounds[3] - bounds[1])
    return run


def new_room(run: NDArray[Any], capacity: int) -> Room:
    """Room to grow trees of at most so many nodes, round the state of a run."""
    return Room(
        run,
        np.empty(_NEIGHBOURS, np.int32),
        np.empty(_NEIGHBOURS),
        np.empty(_NEIGHBOURS),
        np.empty(capacity, np.int32),
        np.empty(capacity, np.int32),
    )


@borrowing_kernel
def passes(space: SpaceArrays, run: Any, ax: float, ay: float, bx: float, by: float) -> bool:
    """Whether the edge from a point a known to be free to b [m] is free; counted."""
    run.tests += 1
    return way_free(space, ax, ay, bx, by)

"""Laws of lattice search, of exact search and of shortcuts."""

import itertools
import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import Space, Status, make_planner
from planners.judge import faults
from planners.refine import shortcut, way_cost
from tests.planners.test_planners import on

ROOMS = [(4, 0, 4.5, 4), (4, 5.2, 4.5, 10)]  # a wall with a door, 1.2 m wide


def cost(path, problem, weight, comfort):
    arrays = problem.free.arrays
    edges = itertools.pairwise(path)
    return sum(way_cost(arrays, *a, *b, weight, comfort) for a, b in edges)


def brute_force(problem):
    """The optimum by Dijkstra over the complete visibility graph of all corners."""
    free = problem.free.free
    corners = shapely.get_coordinates(free)
    nodes = np.unique(np.vstack([problem.start, problem.goal, corners]), axis=0)
    ends = (problem.start, problem.goal)
    start, goal = (int(np.flatnonzero((nodes == end).all(axis=1))[0]) for end in ends)
    lines = [[shapely.LineString([a, b]) for b in nodes] for a in nodes]
    visible = np.array([[free.covers(line) for line in row] for row in lines])
    lengths = np.where(visible, np.hypot(*(nodes[:, None] - nodes[None]).T), np.inf)
    best = np.full(len(nodes), np.inf)
    best[start] = 0.0
    for _ in nodes:
        best = np.minimum(best, (best[:, None] + lengths).min(axis=0))
    return best[goal]


RECTANGLE = st.tuples(st.integers(0, 8), st.integers(0, 8), st.integers(1, 4), st.integers(1, 4))


@settings(max_examples=25, deadline=None)
@given(st.lists(RECTANGLE, min_size=1, max_size=5))
def test_visibility_equals_brute_force(rectangles):
    problem = on([(x, y, x + w, y + h) for x, y, w, h in rectangles], (0.5, 0.5), (9.5, 9.25))
    plan = make_planner("visibility").plan(problem, np.random.default_rng(0))
    if plan.status in (Status.START_OCCUPIED, Status.GOAL_OCCUPIED):
        return
    expected = brute_force(problem)
    assert plan.length == pytest.approx(expected, abs=1e-9)
    assert (plan.status == Status.SOLVED) == math.isfinite(expected)
    if plan.status == Status.SOLVED:
        assert not faults(plan.path, problem.space.solid, problem.space.bounds)


@pytest.mark.parametrize("connectivity", [4, 8])
def test_lattice_paths_cost_what_the_lattice_says(connectivity):
    planner = make_planner({"name": "a_star", "connectivity": connectivity, "shortcut": False})
    problem = on([(4, 0, 5, 9)], (1, 1), (8, 1))  # round an end: no direct way
    plan = planner.plan(problem, np.random.default_rng(0))
    diagonal = math.sqrt(2)
    expected = {4: 3 + 8 + 1 + 8 + 3, 8: (3 * diagonal + 5) + 1 + (3 * diagonal + 5)}
    assert plan.length == pytest.approx(expected[connectivity], abs=0.25)
    assert not faults(plan.path, problem.space.solid, problem.space.bounds)


def test_a_finer_lattice_finds_a_narrow_door():
    problem = on([(4, 0, 4.5, 4.02), (4, 4.08, 4.5, 10)])
    coarse = {"name": "a_star", "resolution": 0.4}
    rng = np.random.default_rng(0)
    assert make_planner({**coarse, "refinements": 0}).plan(problem, rng).status == Status.EXHAUSTED
    plan = make_planner({**coarse, "refinements": 4}).plan(problem, rng)
    assert plan.status == Status.SOLVED
    assert plan.counters["halvings"] > 0


def test_weight_keeps_to_the_middle_of_a_door():
    problem = on(ROOMS, (1, 1), (9, 1), clearance=0.1)
    rng = np.random.default_rng(0)
    heights = {}
    for weight in (0.0, 20.0):
        settings = {"name": "a_star", "weight": weight, "comfort": 0.5}
        path = make_planner(settings).plan(problem, rng).path
        dense = np.concatenate([np.linspace(a, b, 200) for a, b in itertools.pairwise(path)])
        inside = dense[(dense[:, 0] > 4.0) & (dense[:, 0] < 4.5)]
        heights[weight] = np.abs(inside[:, 1] - 4.6).max()
    assert heights[20.0] < 0.2 < heights[0.0]


@pytest.mark.parametrize("weight", [0.0, 5.0])
def test_shortcuts_never_cost_more(weight):
    problem = on(ROOMS, (1, 1), (9, 1))
    spec = {"name": "a_star", "shortcut": False, "weight": weight}
    path = make_planner(spec).plan(problem, np.random.default_rng(0)).path
    short = shortcut(path, problem.free, weight, 0.5)
    assert cost(short, problem, weight, 0.5) <= cost(path, problem, weight, 0.5) * 1.01
    assert not faults(short, problem.space.solid, problem.space.bounds)
    np.testing.assert_array_equal(short[[0, -1]], path[[0, -1]])


def test_a_shortcut_of_a_straight_way_is_its_ends():
    path = np.stack([np.linspace(0, 5, 50), np.linspace(1, 4, 50)], axis=1)
    space = Space.from_rectangles([], (0, 0, 10, 10))
    np.testing.assert_array_equal(shortcut(path, space), path[[0, -1]])

"""Laws of lattice search, of exact search and of shortcuts."""

import dataclasses
import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from planners import Problem, Space, Status, make_planner
from planners.collision.boundary import NONE, boundary
from planners.collision.solids import union
from planners.collision.triangulation import mesh
from planners.graphs.visibility import optima
from planners.judge import Judge
from planners.smoothing.shortcut import edge_cost, shortcut
from tests.planners.oracle import shortest_line
from tests.planners.test_planners import on, plan
from tests.planners.test_space import BOUNDS, FINE, LATTICE, SQUARES, raster, solids
from wheelchair_gym.maps import OCCUPIED, OccupancyGrid

ROOMS = [(4, 0, 4.5, 4), (4, 5.2, 4.5, 10)]  # a wall with a door, 1.2 m wide


def cost(path, problem, weight, comfort):
    arrays = problem.free.arrays
    edges = itertools.pairwise(path)
    return sum(edge_cost(arrays, *a, *b, weight, comfort) for a, b in edges)


RECTANGLE = st.tuples(st.integers(0, 8), st.integers(0, 8), st.integers(1, 4), st.integers(1, 4))


@settings(max_examples=25, deadline=None)
@given(st.lists(RECTANGLE, min_size=1, max_size=7), st.sampled_from([0.3, 0.5, 0.9]))
def test_grids_are_complete_at_their_resolution(rectangles, resolution):
    """A path that keeps step / sqrt(2) from everything solid is enough for each of them."""
    problem = on([(x, y, x + w, y + h) for x, y, w, h in rectangles], (1.0, 1.0), (9.0, 8.75))
    room = dataclasses.replace(problem, clearance=resolution / math.sqrt(2) * 1.001)
    if make_planner("visibility").plan(room, np.random.default_rng(0)).status != Status.SOLVED:
        return
    searches = [{"name": name} for name in ("a_star", "bfs", "dfs", "dijkstra")]
    for search in (*searches, {"name": "a_star", "connectivity": 4}):
        coarse = {**search, "resolution": resolution, "refinements": 0}
        assert plan(coarse, problem).status == Status.SOLVED


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32), st.integers(3, 7), st.floats(0.1, 0.5))
def test_visibility_finds_the_optimum_of_the_oracle(seed, side, share):
    """Also where cells touch at corners only, through which a point may pass."""
    cells = (np.random.default_rng(seed).random((side, side)) < share).astype(np.int8)
    space = Space.from_grid(OccupancyGrid(OCCUPIED * cells, 1.0))
    problem = Problem(space, np.array([0.5, 0.25]), np.array([side - 0.5, side - 0.5]))
    plan = make_planner("visibility").plan(problem, np.random.default_rng(0))
    if plan.status in (Status.START_OCCUPIED, Status.GOAL_OCCUPIED):
        return
    optimum = shortest_line(shapely.box(*space.bounds), space.solid, problem.start, problem.goal)
    assert plan.length == pytest.approx(optimum, abs=1e-7)
    if plan.status == Status.SOLVED:
        assert not Judge(space.solid, space.bounds).faults(plan.path)
    else:
        assert plan.status == Status.NO_PATH


@pytest.mark.parametrize("radius", [0.2, 0.5, 1.0])
def test_the_optimum_with_a_clearance_lies_within_its_bounds(radius):
    problem = on([(4, 0, 6, 5)], (1, 2), (9, 2), clearance=radius)
    far = math.hypot(3, 3)  # to the corner, which the path rounds on an arc
    turn = math.radians(45) + math.asin(radius / far)
    exact = 2 * (math.sqrt(far**2 - radius**2) + radius * turn) + 2
    found = optima(problem)
    assert found.touching == pytest.approx(2 * far + 2, abs=1e-9)
    assert found.lower_bound <= exact <= found.constrained <= exact * 1.01
    assert found.constrained / found.lower_bound < 1.02


def test_a_search_that_outlasts_its_deadline_is_exhausted():
    cells = (np.random.default_rng(3).random((200, 200)) < 0.2).astype(np.int8)
    cells[:3, :3] = cells[-3:, -3:] = 0
    cells[-20, :] = 1  # shut: all of the map must be seen to prove it
    space = Space.from_grid(OccupancyGrid(OCCUPIED * cells, 1.0))
    problem = Problem(space, np.array([1.0, 1.0]), np.array([199.0, 199.0]))
    planner, rng = make_planner("visibility"), np.random.default_rng(0)
    assert planner.plan(problem, rng).status == Status.NO_PATH
    plan = planner.plan(problem, rng, deadline=0.0)
    assert (plan.status, len(plan.path)) == (Status.EXHAUSTED, 0)
    assert planner.plan(problem, rng, deadline=60.0).status == Status.NO_PATH


@pytest.mark.parametrize("connectivity", [4, 8])
def test_lattice_paths_cost_what_the_lattice_says(connectivity):
    problem = on([(4, 0, 5, 9)], (1, 1), (8, 1))  # round an end: no direct way
    found = plan({"name": "a_star", "connectivity": connectivity, "shortcut": False}, problem)
    diagonal = math.sqrt(2)
    expected = {4: 3 + 8 + 1 + 8 + 3, 8: (3 * diagonal + 5) + 1 + (3 * diagonal + 5)}
    assert found.length == pytest.approx(expected[connectivity], abs=0.25)
    assert not Judge.of(problem).faults(found.path)


def test_orders_of_one_search_keep_what_each_promises():
    """Dijkstra finds A*'s cost with more nodes, and breadth no more edges."""
    problem = on([(2, 3, 6, 5), (5, 6, 8, 7.5), (4, 0, 5, 2)])
    names = "a_star", "dijkstra", "bfs", "dfs"
    plans = {name: plan({"name": name, "shortcut": False}, problem) for name in names}
    a_star = plans["a_star"]
    # The first and the last edge are of any length: the sums differ by as much.
    assert plans["dijkstra"].length == pytest.approx(a_star.length, abs=0.2)
    assert plans["dijkstra"].counters["nodes"] > a_star.counters["nodes"]
    assert all(len(plans["bfs"].path) <= len(plans[k].path) for k in ("a_star", "dijkstra", "dfs"))


def test_prm_falls_with_points_to_the_optimum(monkeypatch):
    problem = on([(2, 3, 6, 5), (5, 6, 8, 7.5)])
    best = make_planner("visibility").plan(problem, np.random.default_rng(0)).length
    lengths, planner = [], make_planner("prm")
    for first in (50, 500, 5000):
        monkeypatch.setattr("planners.graphs.roadmap.INITIAL_SAMPLES", first)
        plans = [planner.plan(problem, np.random.default_rng(seed)) for seed in range(5)]
        lengths.append(np.mean([plan.length for plan in plans]))
    assert lengths[0] > lengths[1] > lengths[2] >= best
    assert lengths[2] < 1.01 * best


def off_the_door_s_middle(path):
    """How far [m] a path through the door of `ROOMS` leaves its middle."""
    dense = np.concatenate([np.linspace(a, b, 200) for a, b in itertools.pairwise(path)])
    inside = dense[(dense[:, 0] > 4.0) & (dense[:, 0] < 4.5)]
    return np.abs(inside[:, 1] - 4.6).max()


def test_voronoi_keeps_to_the_middle_of_a_door():
    problem = on(ROOMS, (1, 1), (9, 1))
    path = make_planner("voronoi").plan(problem, np.random.default_rng(0)).path
    assert off_the_door_s_middle(path) < 0.05


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
        settings = {"name": "a_star", "obstacle_weight": weight, "desired_clearance": 0.5}
        heights[weight] = off_the_door_s_middle(make_planner(settings).plan(problem, rng).path)
    assert heights[20.0] < 0.2 < heights[0.0]


@pytest.mark.parametrize("weight", [0.0, 5.0])
def test_shortcuts_never_cost_more(weight):
    problem = on(ROOMS, (1, 1), (9, 1))
    spec = {"name": "a_star", "shortcut": False, "obstacle_weight": weight}
    path = make_planner(spec).plan(problem, np.random.default_rng(0)).path
    short = shortcut(path, problem.free, weight, 0.5)
    assert cost(short, problem, weight, 0.5) <= cost(path, problem, weight, 0.5) * 1.01
    assert not Judge.of(problem).faults(short)
    np.testing.assert_array_equal(short[[0, -1]], path[[0, -1]])


def test_a_shortcut_of_a_straight_way_is_its_ends():
    path = np.stack([np.linspace(0, 5, 50), np.linspace(1, 4, 50)], axis=1)
    space = Space.from_rectangles([], (0, 0, 10, 10))
    np.testing.assert_array_equal(shortcut(path, space), path[[0, -1]])


def assert_fills(space):
    """The triangles cover what is free, once, and know each other."""
    parts, free = space.mesh, space.free
    a, b, c = parts.points[parts.corners].transpose(1, 0, 2)
    areas = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    # Exactly: of a triangle as flat as a rounding error the float may be 0.
    flat = parts.points[parts.corners[areas <= 1e-9]]
    for triangle in flat:
        (x0, y0), (x1, y1), (x2, y2) = ((Fraction(x), Fraction(y)) for x, y in triangle.tolist())
        assert (x1 - x0) * (y2 - y0) > (y1 - y0) * (x2 - x0)
    assert areas.sum() == pytest.approx(shapely.area(free), rel=1e-9, abs=1e-12)
    inside = shapely.points((a + b + c) / 3.0)
    assert (shapely.distance(inside, free) < 1e-9).all()
    assert (parts.across == NONE).sum() == len(space.arrays.segments)
    for t, k in np.argwhere(parts.across != NONE):
        other, side = divmod(parts.across[t, k], 3)
        assert parts.across[other, side] == 3 * t + k
        mine = parts.corners[t, [k, (k + 1) % 3]]
        assert (parts.corners[other, [(side + 1) % 3, side]] == mine).all()


@settings(max_examples=80, deadline=None)
@given(st.one_of(solids(LATTICE), solids(FINE)))
@example([[(2.0, 0.0), (3.0, 0.0), (3.0, 3.0), (2.0, 3.0)], [(0.0, 0.0), (-1.0, 1.0), (8.0, 7.0)]])
def test_triangles_fill_what_is_free(polygons):
    assert_fills(Space(union(polygons), BOUNDS))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 12), st.floats(0.1, 0.9))
def test_triangles_fill_what_is_free_of_any_raster(seed, side, share):
    cells = np.random.default_rng(seed).random((side, side + 1)) < share
    assert_fills(Space.from_grid(raster(cells)))


def test_loops_that_cross_or_stay_open_are_refused():
    segments = Space(union(SQUARES), BOUNDS).arrays.segments
    with pytest.raises(ValueError, match="loops"):
        mesh(boundary(segments[:-1]))
    with pytest.raises(ValueError, match="loops"):
        mesh(boundary(segments[:, [2, 3, 0, 1]]))

"""Trees: paths are free and end on the goal, RRT* converges, whales do what they are for."""

import json
from dataclasses import replace

import numpy as np
import pytest
import shapely

from planners import PLANNERS
from planners.space import Space
from planners.swarm.woa import WhaleSettings
from planners.trees.rrt import RrtStar, RrtStarWoaGlobal, RrtStarWoaLocal
from planners.trees.tree import NONE, insert, nearest, new_tree, within
from planners.types import Problem, Status

TREES = [name for name in PLANNERS if name.startswith("rrt")]
RECTANGLES = np.array([(4.0, 0.0, 5.0, 7.0), (7.0, 3.0, 8.0, 10.0), (1.0, 4.0, 3.0, 5.0)])
# Round the upper left wall's corner, then round the lower right one's, exactly.
SHORTEST = (
    np.hypot(3, 6) + 1.0 + np.hypot(2, 4) + 1.0 + np.hypot(1, 6)
)  # (1, 1) (4, 7) (5, 7) (7, 3) (8, 3) (9, 9)


@pytest.fixture(scope="module")
def problem():
    space = Space.from_rectangles(RECTANGLES, (0.0, 0.0, 10.0, 10.0))
    return Problem(space, np.array([1.0, 1.0]), np.array([9.0, 9.0]))


@pytest.fixture(scope="module")
def problems(shared):
    cases = json.loads((shared / "problems" / "planning.json").read_text())
    for case in cases:
        bounds = (0.0, 0.0, case["size"], case["size"])
        space = Space.from_rectangles(case["rects"], bounds)
        ends = np.array(case["start"]), np.array(case["goal"])
        case["problem"] = Problem(space, *ends, name=case["name"])
    return {case["name"]: case for case in cases}


def assert_free(problem, path):
    """By shapely alone: what of the path lies inside a rectangle is shorter than rounding."""
    np.testing.assert_array_equal(path[0], problem.start[:2])
    np.testing.assert_array_equal(path[-1], problem.goal[:2])
    line = shapely.LineString(path)
    solid = problem.space.solid
    assert shapely.intersection(line, shapely.buffer(solid, -1e-9)).length < 1e-9
    assert shapely.box(*problem.space.bounds).covers(line)
    assert (np.hypot(*np.diff(path, axis=0).T) > 0).all()


@pytest.mark.parametrize("name", TREES)
def test_paths_are_free_and_repeat(name, problem):
    for seed in range(3):
        plan = PLANNERS[name]().plan(problem, np.random.default_rng(seed))
        assert plan.status == Status.SOLVED
        assert_free(problem, plan.path)
        assert plan.length >= SHORTEST - 1e-9
        same = PLANNERS[name]().plan(problem, np.random.default_rng(seed))
        np.testing.assert_array_equal(plan.path, same.path)
        np.testing.assert_array_equal(plan.tree, same.tree)
        assert plan.counters == same.counters


@pytest.mark.parametrize("name", TREES)
def test_clearance_is_kept(name, problem):
    wide = replace(problem, clearance=0.4)
    plan = PLANNERS[name]().plan(wide, np.random.default_rng(0))
    assert plan.status == Status.SOLVED
    assert shapely.LineString(plan.path).distance(problem.space.solid) >= 0.4 - 1e-9


@pytest.mark.parametrize("name", TREES)
def test_what_cannot_be_planned_has_a_name(name, problem):
    planner, rng = PLANNERS[name](), np.random.default_rng(0)
    inside, outside = np.array([4.5, 3.0]), np.array([11.0, 3.0])
    cases = {
        Status.START_OCCUPIED: replace(problem, start=inside),
        Status.GOAL_OCCUPIED: replace(problem, goal=inside),
        Status.START_OUTSIDE: replace(problem, start=outside),
        Status.GOAL_OUTSIDE: replace(problem, goal=outside),
    }
    for status, case in cases.items():
        plan = planner.plan(case, rng)
        assert plan.status == status
        assert len(plan.path) == 0


@pytest.mark.parametrize("name", TREES)
def test_a_tree_that_runs_out_says_so(name):
    space = Space.from_rectangles([(4.0, 0.0, 5.0, 10.0)], (0.0, 0.0, 10.0, 10.0))
    problem = Problem(space, np.array([1.0, 1.0]), np.array([9.0, 9.0]))
    small = RrtStar(iterations=300, return_on_first_path=True)
    planner = PLANNERS[name]()
    nested = hasattr(planner, "tree")
    planner = replace(planner, tree=small) if nested else replace(planner, iterations=300)
    plan = planner.plan(problem, np.random.default_rng(0))
    assert plan.status == Status.EXHAUSTED
    assert plan.length == np.inf


def test_a_start_that_is_the_goal_is_a_path(problem):
    for name in TREES:
        plan = PLANNERS[name]().plan(replace(problem, goal=problem.start), np.random.default_rng(0))
        assert plan.status == Status.SOLVED
        assert plan.length == 0.0


def test_rrt_star_falls_with_samples_to_the_optimum(problem):
    lengths = [
        np.mean(
            [
                RrtStar(iterations=n).plan(problem, np.random.default_rng(seed)).length
                for seed in range(3)
            ]
        )
        for n in (300, 1_000, 5_000, 30_000)
    ]
    assert (np.diff(lengths) < 0).all()
    assert lengths[-1] <= 1.005 * SHORTEST


@pytest.mark.parametrize("name", ["clutter50_s7", "maze29_s4_d1.0"])
def test_rrt_star_ends_within_two_percent(name, problems):
    case = problems[name]
    plan = RrtStar(iterations=30_000).plan(case["problem"], np.random.default_rng(0))
    assert_free(case["problem"], plan.path)
    assert case["optimum"] * (1 - 1e-9) <= plan.length <= 1.02 * case["optimum"]


def test_costs_follow_rewiring(problem):
    """The tree's edges, walked from the root, give a path no longer than was promised."""
    plan = RrtStar(iterations=3_000).plan(problem, np.random.default_rng(1))
    assert len(plan.tree) == plan.counters["nodes"] - 1
    lines = shapely.linestrings(plan.tree.reshape(-1, 2, 2))
    solid = shapely.buffer(problem.space.solid, -1e-9)
    assert not shapely.intersects(lines, solid).any()
    parents = {tuple(edge[2:]): tuple(edge[:2]) for edge in plan.tree}
    node = tuple(plan.path[-2])
    for point in plan.path[-3::-1]:
        node = parents[node]
        assert node == tuple(point)


@pytest.mark.parametrize("settings", [RrtStarWoaGlobal(), RrtStarWoaGlobal.thesis()])
def test_global_variant_never_lengthens_its_tree_path(settings, problem):
    gains = []
    for seed in range(8):
        plan = settings.plan(problem, np.random.default_rng(seed))
        tree = settings.tree.plan(problem, np.random.default_rng(seed))
        assert_free(problem, plan.path)
        gains.append(1 - plan.length / tree.length)
    assert min(gains) >= 0
    if settings.whales.iterations > 10:
        assert np.mean(gains) > 0.005


def test_local_variant_needs_fewer_nodes():
    """On an open map whales lead to the goal, and a tree that follows samples fills the map."""
    space = Space.from_rectangles(np.empty((0, 4)), (0.0, 0.0, 30.0, 30.0))
    problem = Problem(space, np.array([2.0, 2.0]), np.array([28.0, 28.0]))
    tree = RrtStar.thesis()
    whales = WhaleSettings(population=30)
    nodes = {"local": [], "tree": []}
    for seed in range(5):
        rngs = np.random.default_rng(seed), np.random.default_rng(seed)
        local = RrtStarWoaLocal(tree=tree, whales=whales).plan(problem, rngs[0])
        assert_free(problem, local.path)
        nodes["local"].append(local.counters["nodes"])
        nodes["tree"].append(tree.plan(problem, rngs[1]).counters["nodes"])
    assert np.mean(nodes["local"]) < 0.8 * np.mean(nodes["tree"])


def test_neighbours_are_those_of_brute_force():
    rng = np.random.default_rng(4)
    points = np.vstack([rng.uniform(0, 30, (700, 2)), rng.normal(5, 0.1, (300, 2))])
    tree = new_tree(np.array([0.0, 0.0, 30.0, 12.0]), len(points))
    points[:, 1] *= 0.4
    found, distances = np.empty(2000, np.int32), np.empty(2000)
    for i, (x, y) in enumerate(points):
        assert insert(tree, x, y, NONE if i == 0 else 0, 1.0) == i
        if i % 50 == 0:
            query = rng.uniform(-1, 31, 2) * (1, 0.4)
            gaps = np.hypot(*(points[: i + 1] - query).T)
            assert gaps[nearest(tree, *query)] == gaps.min()
            n = within(tree, *query, 3.0, found, distances)
            assert sorted(found[:n]) == list(np.flatnonzero(gaps <= 3.0))

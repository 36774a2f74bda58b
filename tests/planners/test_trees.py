"""Trees: paths are free and end on the goal, RRT* converges, whales do what they are for."""

import numpy as np
import pytest
import shapely

from planners import PLANNERS
from planners.problems import read_problems
from planners.space import Space
from planners.trees.rrt import RrtStar
from planners.trees.tree import NONE, insert, nearest, new_tree, within
from planners.trees.whales import RrtStarWoaGlobal, RrtStarWoaLocal
from planners.types import Problem, Status
from tests.planners.judge import faults

TREES = [name for name, planner in PLANNERS.items() if ".trees." in planner.__module__]
RECTANGLES = np.array([(4.0, 0.0, 5.0, 7.0), (7.0, 3.0, 8.0, 10.0), (1.0, 4.0, 3.0, 5.0)])
# Over the first wall, under the second: (1, 1) (4, 7) (5, 7) (7, 3) (8, 3) (9, 9), but for the
# block in the way, (3, 4).
SHORTEST = np.hypot(2, 3) + np.hypot(1, 3) + 1.0 + np.hypot(2, 4) + 1.0 + np.hypot(1, 6)


@pytest.fixture(scope="module")
def problem():
    space = Space.from_rectangles(RECTANGLES, (0.0, 0.0, 10.0, 10.0))
    return Problem(space, np.array([1.0, 1.0]), np.array([9.0, 9.0]))


@pytest.fixture(scope="module")
def stored(shared):
    cases = read_problems(shared / "problems" / "planning.json")
    return {problem.name: (problem, optimum) for problem, optimum in cases}


def assert_free(problem, path):
    space = problem.space
    np.testing.assert_array_equal(path[[0, -1]], [problem.start, problem.goal])
    assert not faults(path, space.solid, space.bounds)
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
    assert lengths[-1] <= 1.01 * SHORTEST


@pytest.mark.parametrize("name", ["clutter50_s7", "maze29_s4_d1.0"])
def test_rrt_star_ends_within_two_percent(name, stored):
    problem, optimum = stored[name]
    plan = RrtStar(iterations=30_000).plan(problem, np.random.default_rng(0))
    assert_free(problem, plan.path)
    assert optimum * (1 - 1e-9) <= plan.length <= 1.02 * optimum


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


def test_local_variant_needs_fewer_nodes_for_a_shorter_path():
    """On an open map whales lead to the goal, and a tree that follows samples fills the map."""
    space = Space.from_rectangles(np.empty((0, 4)), (0.0, 0.0, 30.0, 30.0))
    problem = Problem(space, np.array([2.0, 2.0]), np.array([28.0, 28.0]))
    found = []
    for seed in range(8):
        local = RrtStarWoaLocal(tree=RrtStar.thesis()).plan(problem, np.random.default_rng(seed))
        tree = RrtStar.thesis().plan(problem, np.random.default_rng(seed))
        assert_free(problem, local.path)
        nodes = local.counters["nodes"], tree.counters["nodes"]
        found.append((*nodes, local.length, tree.length))
    local_nodes, tree_nodes, local_length, tree_length = np.mean(found, axis=0)
    assert local_nodes < 0.9 * tree_nodes
    assert local_length < tree_length


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

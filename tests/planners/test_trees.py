"""Trees: paths are free and end on the goal, RRT* converges, variants do what they are for.

RRT*-WOA over poses: exact outline, repeatability, deadlines, rounds that never harm.
"""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from planners import PLANNERS, Status, make_planner
from planners.collision.space import Space
from planners.judge import Judge, plan_faults, sweep_faults
from planners.problem import Problem
from planners.rrt_star_woa.poses import GUIDE, Se2RrtStarWoa
from planners.trees import rrt_star
from planners.trees import tree as trees
from tests.benchmarks.lattice import seconds
from tests.planners.footprints import path_gaps, read, stretches_of
from tests.planners.test_planners import on
from wheelchair_gym.base.settings import dump

RECTANGLES = [(4.0, 0.0, 5.0, 7.0), (7.0, 3.0, 8.0, 10.0), (1.0, 4.0, 3.0, 5.0)]
# Over the first wall, under the second: (1, 1) (4, 7) (5, 7) (7, 3) (8, 3) (9, 9), except for
# the block in the way, (3, 4).
SHORTEST = np.hypot(2, 3) + np.hypot(1, 3) + 1.0 + np.hypot(2, 4) + 1.0 + np.hypot(1, 6)


problem = pytest.fixture(lambda: on(RECTANGLES), scope="module", name="problem")


def assert_free(problem, path):
    np.testing.assert_array_equal(path[[0, -1]], [problem.start, problem.goal])
    assert not Judge.of(problem).faults(path)
    assert (np.hypot(*np.diff(path, axis=0).T) > 0).all()


def plans(planner, problem, seeds=6):
    return [planner.plan(problem, np.random.default_rng(seed)) for seed in range(seeds)]


def mean_length(planner, problem, seeds=6):
    return np.mean([plan.length for plan in plans(planner, problem, seeds)])


def test_rrt_star_falls_with_samples_to_the_optimum(problem):
    lengths = [
        mean_length(rrt_star.RrtStar(iterations=n), problem, 3) for n in (300, 1_000, 5_000, 30_000)
    ]
    assert (np.diff(lengths) < 0).all()
    assert lengths[-1] <= 1.01 * SHORTEST


def test_costs_follow_rewiring(problem):
    """The tree's edges, walked from the root, give a path no longer than was promised."""
    plan = rrt_star.RrtStar(iterations=3_000).plan(problem, np.random.default_rng(1))
    assert len(plan.tree) == plan.counters["nodes"] - 1
    lines = shapely.linestrings(plan.tree.reshape(-1, 2, 2))
    solid = shapely.buffer(problem.space.solid, -1e-9)
    assert not shapely.intersects(lines, solid).any()
    parents = {tuple(edge[2:]): tuple(edge[:2]) for edge in plan.tree}
    node = tuple(plan.path[-2])
    for point in plan.path[-3::-1]:
        node = parents[node]
        assert node == tuple(point)


def test_neighbours_are_those_of_brute_force_through_removal():
    """On a map that is no square, points in a heap among them, while it grows and after."""
    rng = np.random.default_rng(6)
    points = np.vstack([rng.uniform(0, 30, (300, 2)), rng.normal(5, 0.1, (100, 2))]) * (1, 0.4)
    rng.shuffle(points)
    tree = trees.new_tree(np.array([0.0, 0.0, 30.0, 12.0]), 400)
    found, distances = np.empty(400, np.int32), np.empty(400)

    def check(count):
        for query in rng.uniform(-1, 31, (10, 2)) * (1, 0.4):
            gaps = np.hypot(*(points[:count] - query).T)
            assert gaps[trees.nearest(tree, *query)] == gaps.min()
            n = trees.nodes_within(tree, *query, 3.0, found, distances)
            assert sorted(found[:n]) == list(np.flatnonzero(gaps <= 3.0))

    for i, (x, y) in enumerate(points):
        assert trees.insert(tree, x, y, trees.NONE if i == 0 else 0, 1.0) == i
        if i % 50 == 0:
            check(i + 1)
    for i in rng.permutation(np.arange(1, 400))[:150]:
        points[i] = rng.uniform(0, 12, 2)
        trees.remove_node(tree, i)
        trees.place_node(tree, i, *points[i], 0, 1.0)
    check(400)


def test_rrt_connect_solves_every_problem(stored):
    planner = PLANNERS["rrt_connect"]()
    for problem, _ in stored.values():
        for plan in plans(planner, problem, 20):
            assert plan.status == Status.SOLVED


@pytest.mark.parametrize("name", ["rrt_connect", "informed_rrt_star"])
def test_the_straight_line_needs_no_sample(name, stored):
    problem, optimum = stored["open"]
    plan = PLANNERS[name]().plan(problem, np.random.default_rng(0))
    assert plan.counters["iterations"] == 0
    assert plan.length == pytest.approx(optimum)


@pytest.mark.parametrize("name", ["clutter", "slabs", "rooms"])
@pytest.mark.parametrize("share", [0.0, 0.5])
def test_informed_rrt_star_falls_to_the_optimum(name, share, stored):
    problem, optimum = stored[name]
    lengths = []
    for iterations in (1_500, 3_000, 6_000):
        planner = rrt_star.InformedRrtStar(iterations=iterations, corner_share=share)
        plan = planner.plan(problem, np.random.default_rng(0))
        if plan.status == Status.SOLVED:
            lengths.append(plan.length)
    assert (np.diff(lengths) <= 1e-9).all()  # one run, further on
    assert lengths[-1] <= optimum * (1.001 if share else 1.015)


def test_informed_samples_stay_where_they_can_help(stored, monkeypatch):
    problem, _ = stored["clutter"]
    monkeypatch.setattr("planners.trees.rrt_star.MAX_NODES", 500)
    before, after = (
        rrt_star.InformedRrtStar(iterations=n).plan(problem, np.random.default_rng(0))
        for n in (200, 5_000)
    )
    assert after.counters["nodes"] <= 2 * 500 + 30  # though it went on long after the tree was full
    assert after.length < before.length
    new = after.tree[len(before.tree) :, 2:]
    ends = (problem.start, problem.goal)
    assert (sum(np.hypot(*(new - end).T) for end in ends) <= before.length).mean() > 0.95


def test_fixed_nodes_are_kept_and_paths_fall_all_the_same(stored):
    problem, _ = stored["clutter"]
    few = rrt_star.RrtStar(nodes=400)
    for plan in plans(rrt_star.RrtStarFn(tree=few), problem):
        assert plan.counters["nodes"] <= few.nodes + 1  # and the goal
        assert plan.counters["iterations"] == few.iterations
    assert mean_length(rrt_star.RrtStarFn(tree=few), problem) < 0.99 * mean_length(few, problem)


def test_smart_trees_are_ahead_of_plain_ones(stored):
    problem, optimum = stored["clutter"]
    plain = rrt_star.RrtStar(iterations=2_000)
    smart = mean_length(rrt_star.RrtStarSmart(tree=plain), problem)
    assert smart - optimum < 0.7 * (mean_length(plain, problem) - optimum)


def test_smart_paths_join_vertices_that_see_each_other(stored):
    problem, _ = stored["clutter"]
    tree = rrt_star.RrtStar(return_on_first_path=True, step=1.5, search_radius=1.6)
    solid = shapely.buffer(problem.space.solid, -1e-9)
    pairs = zip(plans(tree, problem), plans(rrt_star.RrtStarSmart(tree=tree), problem), strict=True)
    for plain, smart in pairs:
        assert smart.length < plain.length
        assert {tuple(point) for point in smart.path} <= {tuple(point) for point in plain.path}
        skipping = np.hstack([smart.path[:-2], smart.path[2:]]).reshape(-1, 2, 2)
        assert shapely.intersects(shapely.linestrings(skipping), solid).all()


def test_limited_trees_stay_in_their_strip(monkeypatch):
    """Between the start and the goal in x, wider by a step for each edge that was blocked."""
    space = Space.from_rectangles([(14.0, 3.0, 16.0, 20.0)], (0.0, 0.0, 30.0, 20.0))
    problem = Problem(space, np.array([10.0, 18.0]), np.array([20.0, 18.0]))
    tree = rrt_star.RrtStar(return_on_first_path=True, step=2.0, goal_reach=2.0)
    monkeypatch.setattr("planners.trees.rrt_star.WIDENING", 0.01)
    for plan in plans(rrt_star.RrtStarLimited(tree=tree), problem):
        assert_free(problem, plan.path)
        margin = 0.01 * plan.counters["blocked"]
        assert plan.tree[:, 0].min() >= 10.0 - margin
        assert plan.tree[:, 0].max() <= 20.0 + margin
        assert 0 <= plan.counters["walls_cut"] <= plan.counters["blocked"]
    assert plan.counters["blocked"] > 0
    thin = Space.from_rectangles([(14.9, 3.0, 15.0, 20.0)], (0.0, 0.0, 30.0, 20.0))
    across = Problem(thin, problem.start, problem.goal)
    assert all(plan.counters["walls_cut"] > 0 for plan in plans(rrt_star.RrtStarLimited(), across))


def turns(path):
    """Changes of direction [rad] at the inner points of a path (n, 2)."""
    steps = np.diff(path, axis=0)
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    return np.abs((np.diff(headings) + np.pi) % (2 * np.pi) - np.pi)


def test_splines_have_no_corners_where_the_path_of_the_tree_has(problem, monkeypatch):
    """The finer the polyline, the less it turns at each point: by the root of the tolerance."""
    for seed in range(3):
        path = rrt_star.SplineRrtStar().tree.plan(problem, np.random.default_rng(seed)).path
        made = []
        for tolerance in (1e-4, 1e-7, 1e-9):
            monkeypatch.setattr("planners.trees.rrt_star.TOLERANCE", tolerance)
            made.append(rrt_star.SplineRrtStar().plan(problem, np.random.default_rng(seed)))
        coarse, fine, finest = made
        assert turns(path).max() > 0.5
        assert fine.counters["straight_legs"] == 0
        assert turns(finest.path).max() < 0.15 * turns(fine.path).max()
        assert_free(problem, coarse.path)
        curve = shapely.LineString(fine.path)
        assert shapely.distance(curve, shapely.points(path)).max() == 0.0
        middles = shapely.points((coarse.path[1:] + coarse.path[:-1]) / 2)
        assert shapely.distance(curve, middles).max() < 1.01e-4


CASES = {case.problem.name: case for case in read()}
# Feasible ones that random samples find in a moment; the others need a pose to a few millimetres.
QUICK = sorted(
    name
    for name, case in CASES.items()
    if case.verdict.feasible
    and name.split("_")[0] in ("side", "door", "corridor", "dead", "beside", "midwheel")
    and not name.endswith(("_2", "_5"))
)
NAME = "se2_rrt_star_woa"
ROOM = "door_ahead_20"
OFF = {"local_share": 0.0}


def plan(name, seed=0, deadline=None, **settings):
    problem, footprint, _ = CASES[name]
    planner = make_planner({"name": NAME, "footprint": dump(footprint), **settings})
    return planner.plan(problem, np.random.default_rng(seed), deadline)


@pytest.mark.parametrize("name", QUICK)
def test_problems_are_solved_and_the_outline_touches_nothing(name):
    problem, footprint, verdict = CASES[name]
    answer = plan(name)
    assert answer.status is Status.SOLVED
    assert not plan_faults(answer, problem, footprint)
    assert answer.length >= verdict.lower - 1e-9


def test_the_margin_is_kept_where_one_is_asked_for():
    problem, footprint, _ = CASES[ROOM]
    wide = replace(problem, clearance=footprint.half_width + 0.05)
    answer = make_planner(NAME).plan(wide, np.random.default_rng(0))
    assert answer.status is Status.SOLVED
    space = problem.space
    assert not sweep_faults(answer.path, footprint.corners, space.solid, space.bounds, 0.05)
    assert path_gaps(answer.path, problem.space, footprint).min() >= 0.05 - 1e-9


@pytest.mark.parametrize("share", ["tree", "shortcut", "local"])
def test_each_kind_of_round_alone_makes_better_paths_and_never_worse_ones(share, monkeypatch):
    for kind in ("tree", "shortcut"):
        place = f"planners.rrt_star_woa.poses.{kind.upper()}_SHARE"
        monkeypatch.setattr(place, float(kind == share))
    only = {"obstacle_weight": 0.0, "local_share": float(share == "local")}
    plans = [plan(ROOM, improvement=more, **only) for more in (0, 60, 400)]
    times = [seconds(found.path, Se2RrtStarWoa()) for found in plans]
    assert times[0] >= times[1] >= times[2] - 1e-9
    assert times[2] < times[0]


def test_whales_make_no_evaluations_without_a_share():
    answer = plan(ROOM, **OFF)
    assert answer.status is Status.SOLVED
    assert answer.counters["local_evaluations"] == 0
    assert plan(ROOM).counters["local_evaluations"] > 0


@pytest.mark.parametrize("deadline", [1e-9, 0.01, 0.05])
def test_the_iterations_of_a_plan_under_a_deadline_replay_it(deadline):
    late = plan(ROOM, deadline=deadline, iterations=10**6, improvement=10**6)
    count = late.counters["iterations"]
    if not count or late.counters["guide_iterations"] < GUIDE.iterations:
        return
    again = plan(ROOM, iterations=count, improvement=10**6)
    np.testing.assert_array_equal(late.path, again.path)
    assert late.counters == again.counters


def test_a_chair_that_cannot_go_back_does_not():
    answer = plan(ROOM, limits={"backward": 0.0})
    assert answer.status is Status.SOLVED
    assert min(way for way, _ in stretches_of(answer.path)) > -1e-9

"""Replanning: what still holds of an old plan is kept, and that pays."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from planners import Plan, Problem, Space, Status, make_planner
from planners.judge import faults
from planners.problem_files import read_problems
from planners.trees.replan import remainder, replan
from planners.trees.settings import InformedRrtStar
from wheelchair_gym.geometry import path_length

SETTINGS = InformedRrtStar(iterations=2_000)


def along(path, length):
    """The point of a path (n, 2) at a length [m] from its start."""
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    return np.array([np.interp(length, lengths, path[:, axis]) for axis in range(2)])


@pytest.fixture(scope="module", params=["clutter50_s7", "maze29_s4_d1.0", "slabs30_s1"])
def drives(request, shared):
    """Plans, and what has become of their problems when a part has been driven.

    A box has appeared: on the old path, or, in every third case, elsewhere.
    """
    stored = {p.name: p for p, _ in read_problems(shared / "problems" / "planning.json")}
    problem, cases = stored[request.param], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        plan = SETTINGS.plan(problem, rng)
        pose = along(plan.path, plan.length * rng.uniform(0.1, 0.4))
        centre, half = along(plan.path, plan.length * rng.uniform(0.5, 0.8)), rng.uniform(0.1, 0.6)
        if seed % 3 == 0:
            centre = rng.uniform(5.0, 25.0, 2)
        box = shapely.box(*(centre - half), *(centre + half))
        if min(shapely.distance(box, shapely.points([pose, problem.goal]))) < 0.1:
            continue
        space = Space(shapely.union(problem.space.solid, box), problem.space.bounds)
        cases.append((plan, Problem(space, pose, problem.goal)))
    assert len(cases) > 6
    return cases


def assert_valid(plan, problem):
    assert plan.status == Status.SOLVED
    np.testing.assert_array_equal(plan.path[[0, -1]], [problem.start, problem.goal])
    assert not faults(plan.path, problem.space.solid, problem.space.bounds)


def test_a_new_plan_is_valid_and_never_worse_than_an_old_one_that_holds(drives):
    held = 0
    for old, problem in drives:
        plan = replan(
            problem, old, np.random.default_rng(0), planner=InformedRrtStar(iterations=50)
        )
        if plan.status == Status.EXHAUSTED:
            continue
        assert_valid(plan, problem)
        rest = remainder(problem, old.path)
        if not faults(rest, problem.space.solid, problem.space.bounds):
            assert plan.length <= path_length(rest) + 1e-9
            held += 1
    assert held > 0


def test_what_is_kept_spares_work_and_is_shorter(drives):
    """Against a plan from nothing of as many samples: to the first path, and in the end."""
    found = []
    for old, problem in drives:
        kept = replan(problem, old, np.random.default_rng(1), planner=SETTINGS)
        anew = SETTINGS.plan(problem, np.random.default_rng(1))
        first = [plan.counters.get("first_path_iterations", 2_000) for plan in (kept, anew)]
        # As good as from nothing, after a tenth of the samples and with fewer edges tested.
        short = replan(
            problem, old, np.random.default_rng(1), planner=InformedRrtStar(iterations=200)
        )
        tests = short.counters["edges_tested"], anew.counters["edges_tested"]
        found.append((*first, kept.length, anew.length, *tests))
    kept_first, new_first, kept_length, new_length, kept_tests, new_tests = np.mean(found, axis=0)
    assert kept_first < 0.5 * new_first
    assert kept_length <= 1.001 * new_length
    assert kept_tests < 0.6 * new_tests


def test_an_old_plan_of_any_planner_serves(drives):
    _, problem = drives[0]
    for name in ("visibility", "rrt_connect", "rrt_star_woa_global"):
        plan = make_planner(name).plan(problem, np.random.default_rng(0))
        again = replan(problem, plan, np.random.default_rng(0), planner=SETTINGS)
        assert_valid(again, problem)
        assert again.length <= plan.length + 1e-9


def test_where_nothing_holds_it_plans_from_nothing(drives):
    _, problem = drives[0]
    anew = SETTINGS.plan(problem, np.random.default_rng(3))
    elsewhere = Plan(Status.SOLVED, np.array([[1.0, 1.0], [2.0, 2.0]]))
    for previous in (Plan(Status.EXHAUSTED), elsewhere):
        plan = replan(problem, previous, np.random.default_rng(3), planner=SETTINGS)
        np.testing.assert_array_equal(plan.path, anew.path)
        assert plan.counters["kept"] == 0


def test_replanning_repeats_and_its_iterations_replay_a_deadline(drives):
    for old, problem in drives[:3]:
        plan = replan(problem, old, np.random.default_rng(4), deadline=2e-3)
        settings = InformedRrtStar(iterations=plan.counters["iterations"])
        again = replan(problem, old, np.random.default_rng(4), planner=settings)
        np.testing.assert_array_equal(plan.path, again.path)
        np.testing.assert_array_equal(plan.tree, again.tree)

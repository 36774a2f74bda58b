"""Refinement: what comes out is a valid path, better by the refiner's own measure, or unchanged."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from planners import Plan, Status, make_planner
from planners.judge import faults
from planners.problem_files import read_problems
from planners.registries import REFINERS
from planners.smoothing.shortcut import path_cost
from tests.planners.test_planners import on
from wheelchair_gym.config import dump, load

BLOCKS = [(2, 3, 6, 5), (5, 6, 8, 7.5), (0, 7, 3, 8)]
CURVES = ["pchip", "spline"]


def refined(name, plan, problem, **settings):
    return REFINERS[name](**settings).refine(plan, problem, np.random.default_rng(0))


def assert_valid(plan, given, problem):
    space = problem.space
    assert plan.status == Status.SOLVED
    np.testing.assert_array_equal(plan.path[[0, -1]], given.path[[0, -1]])
    assert not faults(plan.path, space.solid, space.bounds, problem.clearance)
    if plan.note:
        assert plan.note.startswith("not refined: ")
        np.testing.assert_array_equal(plan.path, given.path)


def crowding(path, problem):
    return path_cost(problem.free.arrays, np.ascontiguousarray(path), 10.0, 0.5)


def turns(path):
    """Turning angles [rad] at the inner points."""
    angles = np.unwrap(np.arctan2(*np.diff(path, axis=0).T[::-1]))
    return np.abs(np.diff(angles))


@pytest.mark.parametrize("name", REFINERS)
@pytest.mark.parametrize("planner", ["rrt_connect", "visibility"])
def test_refined_plans_are_valid_and_better_by_their_own_measure(name, planner, shared):
    stored = [problem for problem, _ in read_problems(shared / "problems" / "planning.json")]
    changed = 0
    for problem in [*stored[2:8:2], on(BLOCKS, clearance=0.4)]:
        given = make_planner(planner).plan(problem, np.random.default_rng(1))
        plan = refined(name, given, problem)
        assert_valid(plan, given, problem)
        changed += not plan.note
        if name in {"shortcut", "woa"}:
            assert plan.length <= given.length + 1e-9
        if name == "clearance" and not plan.note:
            assert crowding(plan.path, problem) < crowding(given.path, problem)
    assert changed > 0 or planner == "visibility"
    if name in CURVES:
        assert changed == 4


@pytest.mark.parametrize("name", REFINERS)
def test_what_cannot_be_refined_stays_as_it_is_and_says_why(name):
    problem = on(BLOCKS)
    failed = Plan(Status.EXHAUSTED)
    assert refined(name, failed, problem).status == Status.EXHAUSTED
    assert refined(name, failed, problem).note
    for bad in ([(1, 1), (9, 9)], [(1, 1), (np.nan, 3), (9, 9)], [(1.0, 1.0)], np.empty((0, 2))):
        plan = refined(name, np.array(bad, dtype=float), problem)
        np.testing.assert_array_equal(plan.path, np.array(bad))
        assert "not free" in plan.note
    straight = np.array([(1.0, 1.0), (9.0, 1.0)])
    plan = refined(name, straight, on([]))
    np.testing.assert_array_equal(plan.path, straight)
    assert plan.note.startswith("not refined: ")


@pytest.mark.parametrize("name", REFINERS)
def test_headings_are_dropped_and_settings_load(name):
    path = np.array([(1, 1, 0.1), (1, 5, 0.1), (1, 9, 0.2), (9, 9, 0.3), (9.0, 1.0, 0.4)])
    plan = refined(name, path, on([(4, 0, 5, 7)]))
    assert not plan.note
    assert plan.path.shape[1] == 2
    assert load(REFINERS[name], dump(REFINERS[name]()), name) == REFINERS[name]()


@pytest.mark.parametrize("name", CURVES)
def test_curves_are_smooth_and_near_their_polyline(name):
    path = np.array([(1, 1), (5, 1), (5, 5), (9.0, 9.0)])
    curves = {t: refined(name, path, on([]), tolerance=t).path for t in (1e-2, 1e-5)}
    assert turns(curves[1e-5]).max() < 0.05 < turns(path).min()
    fine = curves[1e-5]
    for point in curves[1e-2][1:-1]:
        a, b = fine[:-1], fine[1:]
        t = np.clip(((point - a) * (b - a)).sum(1) / ((b - a) ** 2).sum(1), 0, 1)
        assert np.hypot(*(a + t[:, None] * (b - a) - point).T).min() < 1e-4  # on the same curve


@pytest.mark.parametrize("name", CURVES)
def test_a_curve_gets_knots_until_it_is_free(name):
    """Over a wall, 2 cm below another: the first curve is not free."""
    problem = on([(4, 0, 5, 7), (0, 7.02, 10, 10)], (1, 1), (9, 1))
    given = make_planner("visibility").plan(problem, np.random.default_rng(0))
    assert "no smooth curve" in refined(name, given, problem, rounds=0).note
    plan = refined(name, given, problem)
    assert not plan.note
    assert_valid(plan, given, problem)


def test_clearance_moves_to_the_middle_of_a_door():
    problem = on([(4, 0, 4.5, 4), (4, 5.2, 4.5, 10)], (1, 1), (9, 1))
    given = make_planner("visibility").plan(problem, np.random.default_rng(0))
    path = refined("clearance", given, problem, desired_clearance=0.6).path
    dense = np.concatenate([np.linspace(a, b, 50) for a, b in itertools.pairwise(path)])
    inside = dense[(dense[:, 0] > 4.0) & (dense[:, 0] < 4.5)]
    assert np.abs(inside[:, 1] - 4.6).max() < 0.25
    assert np.abs(given.path[:, 1] - 4.0).min() < 1e-9

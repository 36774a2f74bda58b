"""Costs of paths: each objective beside its formula."""

import numpy as np
import pytest

from planners.judge import Judge
from planners.registries import OBJECTIVES
from planners.swarm.path_cost import evaluate, new_workspace, push_out_of_discs
from planners.swarm.planner import SwarmPlanner
from tests.planners.swarm_worlds import among_blocks, among_discs, nearest
from wheelchair_gym.geometry.planar import path_length
from wheelchair_gym.scenes.published import CHAOTIC_PSO_DISCS


def terms(objective, position, problem, **settings):
    """Cost of an objective, the plain one, and the line, of way points (n, 2)."""
    way_points = np.asarray(position, dtype=float)
    planner = SwarmPlanner(
        objective=objective, way_points=len(way_points), scatter="uniform", first=None, **settings
    )
    start = planner.start(problem, None, np.random.default_rng(0))
    room = new_workspace(start.path_problem)
    worth = OBJECTIVES.make(objective).path_cost
    cost, plain = evaluate(start.path_problem, worth, way_points.ravel(), np.inf, np.inf, room)
    return cost, plain, room.line


def test_costs_are_their_formulas():
    problem = among_blocks()
    free, hit = [(1.0, 6.5), (4.0, 7.2)], [(4.0, 4.0), (6.0, 5.5)]
    path = np.vstack([(1, 1), free, (9, 9)])
    length = path_length(path)
    legs = np.diff(path, axis=0)
    assert terms("length_free", free, problem)[0] == pytest.approx(10 * length)
    through = path_length(np.vstack([(1, 1), hit, (9, 9)]))
    cost, plain, _ = terms({"name": "length_free", "collision_free_weight": 7.0}, hit, problem)
    assert cost == pytest.approx(10 * through + 7.0 * 3)
    assert plain == np.inf
    headings = np.arctan2(legs[:, 1], legs[:, 0])
    turning = abs(np.diff(headings)).mean()
    assert terms("smooth", free, problem)[:2] == pytest.approx((turning + length,) * 2)
    faithful = {"name": "smooth", "faithful": True}
    A, B = (np.hypot(*v.T) for v in (legs[:-1], path[2:] - path[:-2]))
    printed = ((A**2 + B**2) / (2 * A * B)).sum() / 3
    assert terms(faithful, free, problem)[0] == pytest.approx(printed + length)
    assert terms(faithful, [(1.0, 6.0), (4.0, 4.0)], problem)[0] > 100
    root = np.sqrt((legs**2).sum())
    assert terms("way_points", free, problem)[0] == pytest.approx(root * np.sqrt(3))
    faithful = {"name": "way_points", "faithful": True}
    assert terms(faithful, hit, problem)[0] == pytest.approx(
        np.sqrt((np.diff(np.vstack([(1, 1), hit, (9, 9)]), axis=0) ** 2).sum())
    )


def test_violation_is_the_mean_over_the_curve():
    problem, spec = among_discs(), {"name": "violation", "faithful": True}
    for seed in range(10):
        way_points = np.random.default_rng(seed).uniform(0, 10, (3, 2))
        cost, _, line = terms(spec, way_points, problem, curve="spline", pieces=50)
        deep = sum(
            np.maximum(1.2 - np.hypot(*(line - (x, y)).T) / r, 0).mean()
            for x, y, r in CHAOTIC_PSO_DISCS
        )
        assert cost == pytest.approx(path_length(line) * (1 + 100 * deep))
        exact, valid, line = terms("violation", way_points, problem, curve="spline", pieces=50)
        fine = nearest(line) >= 1.2 and not Judge.of(problem).faults(line)
        assert (valid < np.inf) == fine
        assert (exact == pytest.approx(valid)) == fine


def test_way_points_leave_discs_as_printed():
    problem = among_discs()
    start = SwarmPlanner(way_points=2, first="line", scatter="uniform").start(
        problem, None, np.random.default_rng(0)
    )
    worth = OBJECTIVES.make({"name": "way_points", "faithful": True}).path_cost
    position, held = np.array([9.3, 4.4, 5.0, 5.0]), np.zeros(4, np.bool_)
    assert push_out_of_discs(start.path_problem, worth._replace(slack=0.0), position, held) == 1
    np.testing.assert_allclose(position, [9.6, 4.8, 5.0, 5.0])
    np.testing.assert_array_equal(held, [False, False, True, True])

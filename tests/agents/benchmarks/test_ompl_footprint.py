"""OMPL's planners for the chair's outline: their paths by our judge, and OMPL that is missing."""

from dataclasses import replace

import numpy as np
import pytest

from agents.peers import installed, ompl_footprint
from agents.peers.ompl_footprint import OmplFootprint
from planners import Status
from planners.judge import sweep_faults
from tests.planners.footprints import read
from wheelchair_gym.errors import InputError

CASES = {case.problem.name: case for case in read()}


@pytest.mark.long
@pytest.mark.parametrize("algorithm", ["RRTConnect", "BITstar"])
def test_paths_are_free_and_end_on_the_goal(algorithm):
    if not installed("ompl"):
        pytest.skip("ompl is not installed")
    problem, footprint, _ = CASES["door_ahead_20"]
    for deadline in (None, 2.0):
        planner = OmplFootprint(algorithm=algorithm, footprint=footprint)
        plan = planner.plan(problem, np.random.default_rng(0), deadline)
        assert plan.status is Status.SOLVED
        solid, bounds = problem.space.solid, problem.space.bounds
        assert not sweep_faults(plan.path, footprint.corners, solid, bounds)
        np.testing.assert_allclose(plan.path[0], problem.start, atol=1e-9)
        np.testing.assert_allclose(plan.path[-1, :2], problem.goal[:2], atol=1e-9)


def test_without_ompl_one_line_names_the_extra(monkeypatch):
    monkeypatch.setattr(ompl_footprint, "MODULES", ("ompl_that_is_missing.base",))
    problem, footprint, _ = CASES["door_ahead_20"]
    with pytest.raises(InputError, match=r"pip install 'wheelchair_gym\[peers\]'"):
        OmplFootprint(footprint=footprint).plan(problem, np.random.default_rng(0))


def test_what_is_not_a_problem_is_refused_before_the_search():
    problem, footprint, _ = CASES["door_ahead_20"]
    planner = OmplFootprint(footprint=footprint)
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="start is"):
        planner.plan(replace(problem, start=np.array([np.nan, 0.0])), rng)
    outside = replace(problem, goal=np.array([-100.0, 0.0]))
    assert planner.plan(outside, rng).status is Status.GOAL_OUTSIDE

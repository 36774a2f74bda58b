"""Laws of RRT*-WOA over poses: exact outline, repeatability, deadlines, rounds that never harm."""

import numpy as np
import pytest

from planners import Status, make_planner
from planners.judge import plan_faults, sweep_faults
from planners.rrt_star_woa.poses import GUIDE, Se2RrtStarWoa
from tests.benchmarks.lattice import seconds
from tests.planners.footprints import path_gaps, read, stretches_of
from wheelchair_gym.base.settings import dump

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
    wide = problem.__class__(
        problem.space, problem.start, problem.goal, footprint.half_width + 0.05
    )
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

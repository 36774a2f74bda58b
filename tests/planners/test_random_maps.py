"""Any map, any ends: every planner answers with a valid path or with a named status."""

import inspect

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from planners import PLANNERS, Problem, Space, Status, make_planner
from planners.collision.solids import union
from planners.judge import TOLERANCE
from tests.planners.test_planners import BOX, COMPLETE, GIVEN_UP, PROVE, assert_valid, on, quick
from tests.planners.test_space import solids
from wheelchair_gym.base.settings import InputError

SIZE = 8
WITH_DEADLINE = [
    name for name, cls in PLANNERS.items() if "deadline" in inspect.signature(cls.plan).parameters
]


@st.composite
def problems(draw):
    """Up to eight rectangles and triangles that overlap, touch or leave the map; ends anywhere."""
    whole = st.integers(-1, SIZE + 1).map(float)
    any_ = st.floats(-1.0, SIZE + 1.0, width=32).map(float)
    coordinate = draw(st.sampled_from([whole, any_]))
    side = coordinate.map(lambda value: 0.5 + abs(value) / 2)
    polygons = draw(solids(coordinate, side, most=8, flat=1e-3))
    start, goal = (np.array([draw(coordinate), draw(coordinate)]) for _ in range(2))
    space = Space(union(polygons), (0.0, 0.0, SIZE, SIZE))
    return Problem(space, start, goal, draw(st.sampled_from([0.0, 0.0, 0.3])))


def assert_answered(name, problem):
    """A plan that is a valid path or a named status, and no claim that the exact planner denies."""
    plan = quick(name).plan(problem, np.random.default_rng(0))
    best = make_planner("visibility").plan(problem, np.random.default_rng(0))
    assert isinstance(plan.status, Status)
    larger = "lattice" in name or "se2" in name  # an outline may not fit where a point does
    if plan.status == Status.SOLVED:
        assert_valid(plan, problem)
        # Obstacles grown for a point shut a gap exactly as wide as the clearance; no outline grows.
        assert plan.length >= best.length - TOLERANCE or (larger and best.status == Status.NO_PATH)
    else:
        assert len(plan.path) == 0
        assert plan.status == best.status or plan.status in GIVEN_UP or larger
        if name in PROVE:
            assert plan.status == best.status


@pytest.mark.parametrize("examples", [8, pytest.param(300, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", PLANNERS)
def test_random_maps_are_answered(name, examples):
    @settings(
        max_examples=examples, deadline=None, derandomize=examples == 8,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(problems())
    def check(problem):
        assert_answered(name, problem)

    check()


CELL = [(0, 0, 8, 10), (8, 1, 10, 10)]  # leaves one corner of the map
DEGENERATE = {
    "one free cell, and the start is the goal": on(CELL, (9, 0.5), (9, 0.5)),
    "one free cell": on(CELL, (8.2, 0.5), (9.9, 0.9)),
    "all is solid": on([(0, 0, 10, 10)]),
    "nothing is solid, and the map is a point": on([], (0, 0), (0, 0), size=0.0),
    "a map of one cell": on([], (0, 0), (0.05, 0.05), size=0.05),
    "ends at corners of the map": on([(3, 3, 7, 7)], (0, 0), (10, 10)),
    "ends at corners of what is solid": on([(3, 3, 7, 7)], (3, 3), (7, 7)),
    "ends on sides": on([(3, 3, 7, 7)], (3, 5), (5, 7)),
    "the start in a pocket": on(BOX, (9, 9), (1, 1)),
    "the goal in a pocket that opens in a point": on([(5, 5, 6, 9), (6, 4, 9, 5), (9, 5, 10, 10),
                                                      (5, 9, 9, 10)], (1, 1), (7, 7)),
    "a way through a point": on([(0, 0, 5, 5), (5, 5, 10, 10)], (2, 8), (8, 2)),
    "nothing passes along the border": on([(4, 0, 5, 10)]),
    "a spiral": on([(2, 2, 8, 2.5), (7.5, 2, 8, 8), (2, 7.5, 8, 8), (2, 4, 2.5, 8), (2, 4, 6, 4.5)],
                   (5, 6), (5, 1)),
    "as narrow as the clearance": on([(4, 0, 5, 4), (4, 5, 5, 10)], (1, 4.5), (9, 4.5), 0.5),
}  # fmt: skip


@pytest.mark.parametrize("name", PLANNERS)
@pytest.mark.parametrize("what", DEGENERATE)
def test_degenerate_maps_are_answered(name, what):
    assert_answered(name, DEGENERATE[what])


@pytest.mark.parametrize("name", sorted(COMPLETE))
def test_a_spiral_is_left(name):
    problem = DEGENERATE["a spiral"]
    assert_valid(make_planner(name).plan(problem, np.random.default_rng(0)), problem)


@pytest.mark.parametrize("name", WITH_DEADLINE)
@pytest.mark.parametrize("wrong", [-1.0, np.nan])
def test_a_deadline_that_is_no_time_is_an_input_error(name, wrong):
    with pytest.raises(InputError, match="deadline"):
        make_planner(name).plan(on([(2, 3, 6, 5)]), np.random.default_rng(0), deadline=wrong)

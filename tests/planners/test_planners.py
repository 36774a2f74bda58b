"""Laws of every planner, judged by geometry that is not theirs."""

import dataclasses
import json

import numpy as np
import pytest

from planners import PLANNERS, Problem, Space, Status, make_planner
from planners.judge import TOLERANCE, Judge
from planners.problem_files import read_problems
from tests.conftest import put
from tests.copies import COPIERS, differences
from tests.planners.make_problems import FILE, problems
from wheelchair_gym.base.settings import InputError

# Planners that prove it where there is no path, and those that always find one on these maps.
PROVE = {"bug1", "bug2", "cell_decomposition", "visibility"}
COMPLETE = PROVE | {"a_star", "bfs", "dfs", "dijkstra", "voronoi"}
GIVEN_UP = {Status.EXHAUSTED, Status.STUCK}  # what may be said without a proof
WAYS = [(1.0, 1.0), (9.0, 9.0)]
GOOD = {"name": "a", "size": 5.0, "rects": [[1, 1, 2, 2]], "start": [0.5, 0.5], "goal": [4, 4]}
BOX = [(6, 6, 6.5, 10), (6, 6, 10, 6.5)]  # closes a corner of the map round (9, 9)


def quick(name, iterations=300):
    """A planner that gives up early, as far as it has a setting for that."""
    fields = {field.name for field in dataclasses.fields(PLANNERS[name])}
    limits = {"iterations": iterations, "refinements": 1}
    return make_planner({"name": name, **{k: v for k, v in limits.items() if k in fields}})


def on(rectangles, start=WAYS[0], goal=WAYS[1], clearance=0.0, size=10.0):
    space = Space.from_rectangles(rectangles, (0.0, 0.0, size, size))
    return Problem(space, np.array(start), np.array(goal), clearance)


def plan(spec, problem):
    return make_planner(spec).plan(problem, np.random.default_rng(0))


def assert_valid(plan, problem):
    assert plan.status == Status.SOLVED
    np.testing.assert_allclose(plan.path[0, :2], problem.start[:2], atol=1e-9)
    np.testing.assert_allclose(plan.path[-1, :2], problem.goal[:2], atol=1e-9)
    assert not Judge.of(problem).faults(plan.path[:, :2])


@pytest.mark.parametrize("name", PLANNERS)
def test_paths_are_valid_and_never_shorter_than_the_optimum(name, stored):
    for problem, optimum in stored.values():
        plan = make_planner(name).plan(problem, np.random.default_rng(1))
        if plan.status != Status.SOLVED:  # a sampler may run out; it may not claim a proof
            assert plan.status in GIVEN_UP
            assert name not in COMPLETE, problem.name
            continue
        assert_valid(plan, problem)
        assert plan.length >= optimum - TOLERANCE


@pytest.mark.parametrize("file", [FILE, "shared"], ids=["ours", "shared"])
def test_visibility_finds_every_stored_optimum(file, request):
    if file == "shared":
        file = request.getfixturevalue("shared") / "problems" / "planning.json"
    for problem, optimum in read_problems(file):
        plan = make_planner("visibility").plan(problem, np.random.default_rng(0))
        assert plan.length == pytest.approx(optimum, abs=TOLERANCE), problem.name


def test_a_file_reads_back(tmp_path):
    (problem, optimum), (_, none) = read_problems(
        put(tmp_path / "problems.json", [{**GOOD, "optimum": 5.1}, {**GOOD, "optimum": None}])
    )
    assert (problem.name, optimum, none) == ("a", 5.1, None)
    assert problem.space.bounds == (0, 0, 5, 5)
    assert problem.space.solid.area == 1.0
    np.testing.assert_array_equal(problem.goal, (4, 4))


def test_the_problems_are_what_their_generator_writes():
    for ours, drawn in zip(json.loads(FILE.read_text()), problems(), strict=True):
        assert ours["optimum"] == pytest.approx(drawn.pop("optimum"), abs=TOLERANCE)
        assert {key: ours[key] for key in drawn} == drawn


@pytest.mark.parametrize("name", PLANNERS)
def test_paths_keep_the_clearance_and_the_optimum_bounds_them(name):
    problem = on([(2, 3, 6, 5), (5, 6, 8, 7.5), (0, 7, 3, 8)], clearance=0.4)
    best = make_planner("visibility").plan(problem, np.random.default_rng(0))
    plan = make_planner(name).plan(problem, np.random.default_rng(3))
    if plan.status != Status.STUCK:
        assert_valid(plan, problem)
    assert plan.length >= best.length - TOLERANCE


@pytest.mark.parametrize("name", PLANNERS)
@pytest.mark.parametrize(
    ("problem", "status"),
    [
        (on([(0.5, 0.5, 2, 2)]), Status.START_OCCUPIED),
        (on([(8, 8, 9.5, 9.5)]), Status.GOAL_OCCUPIED),
        (on([], start=(0.2, 5), clearance=0.3), Status.START_OCCUPIED),
        (on([(1.2, 0, 2, 3)], clearance=0.3), Status.START_OCCUPIED),
        (on([], start=(-0.1, 5)), Status.START_OUTSIDE),
        (on([], goal=(5, 10.1)), Status.GOAL_OUTSIDE),
        (on([], clearance=6.0), Status.START_OCCUPIED),
    ],
)
def test_bad_ends_have_names(name, problem, status):
    plan = quick(name).plan(problem, np.random.default_rng(0))
    assert plan.status == status
    assert len(plan.path) == 0
    assert plan.length == np.inf


@pytest.mark.parametrize("name", PLANNERS)
def test_a_closed_box_has_no_path(name):
    plan = quick(name).plan(on(BOX), np.random.default_rng(0))
    proven = name in PROVE or "lattice" in name  # which proves it where it can
    assert plan.status in ({Status.NO_PATH} if proven else GIVEN_UP)
    assert len(plan.path) == 0


@pytest.mark.parametrize("name", PLANNERS)
def test_a_goal_that_is_the_start_is_reached(name):
    problem = on([(3, 3, 4, 4)], goal=WAYS[0])
    plan = quick(name).plan(problem, np.random.default_rng(0))
    assert_valid(plan, problem)
    assert plan.length == 0.0


@pytest.mark.parametrize("name", PLANNERS)
def test_a_planner_and_its_copies_plan_the_same_with_the_same_generator(name):
    problem, planner = on([(2, 3, 6, 5), (5, 6, 8, 7.5)]), make_planner(name)
    found = []
    for one in (planner, planner, *(copied(planner) for copied in COPIERS)):
        plan = one.plan(problem, np.random.default_rng(5))
        counters = {key: count for key, count in plan.counters.items() if key[-2:] != "_s"}
        found.append((plan.status, plan.path, plan.tree, counters))
    for other in found[1:]:
        assert not list(differences(found[0], other))


@pytest.mark.parametrize("name", PLANNERS)
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_ends_that_are_no_numbers_are_input_errors(name, bad):
    for ends, what in (({"start": (bad, 1.0)}, "start"), ({"goal": (1.0, bad)}, "goal")):
        with pytest.raises(InputError, match=what):
            quick(name).plan(on([], **ends), np.random.default_rng(0))
    with pytest.raises(InputError, match="clearance"):
        quick(name).plan(on([], clearance=np.nan), np.random.default_rng(0))


def test_a_planner_is_made_once():
    planner = make_planner({"name": "a_star", "resolution": 0.2})
    assert make_planner(planner) is planner
    assert planner.resolution == 0.2

"""Laws of the lattice of manoeuvres: exact outline, drivable moves, bounds, honest statuses."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import Problem, Space, Status, make_planner
from planners.collision.footprint import MIN_GAP
from planners.judge import plan_faults, sweep_faults
from planners.lattice.flood import is_cut_off
from planners.lattice.lattice import Lattice
from tests.benchmarks.lattice import seconds
from tests.conftest import long_but
from tests.planners.footprints import path_gaps, read, stretches_of
from wheelchair_gym.base.settings import dump
from wheelchair_gym.geometry.kinematics import arc_step
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import to_world

BOUNDS = (0.0, 0.0, 6.0, 5.0)
DOOR = 1.0  # m
CORRIDOR = 1.2  # m
FACTOR = 1.4  # of the length that the oracle found, at most: the lattice wants time and room
HARD = {"three_point_turn", "l_turn_66", "l_turn_84"}  # seconds
CASES = {case.problem.name: case for case in read()}


def plan(start, goal, door=DOOR, **settings):
    """A plan among a corridor along the bottom, and a room above it behind a wall with a door."""
    low, high = CORRIDOR, CORRIDOR + 0.12
    walls = [(0.0, low, 3.0, high), (3.0 + door, low, 6.0, high)]
    space = Space.from_rectangles(walls, BOUNDS)
    problem = Problem(space, np.array(start), np.array(goal), 0.36)
    planner = make_planner({"name": "lattice", **settings})
    return planner.plan(problem, np.random.default_rng(0)), problem


@pytest.mark.parametrize("name", long_but(CASES, set(CASES) - HARD))
def test_problems_are_solved_within_the_oracles_bounds(name):
    problem, footprint, verdict = CASES[name]
    planner = make_planner({"name": "lattice", "footprint": dump(footprint)})
    answer = planner.plan(problem, np.random.default_rng(0))
    if not verdict.feasible:
        assert verdict.feasible is None or answer.status is not Status.SOLVED
        return
    assert answer.status is Status.SOLVED
    assert not plan_faults(answer, problem, footprint)
    assert verdict.lower <= answer.length <= FACTOR * verdict.upper


@pytest.mark.parametrize(
    ("start", "goal"),
    [
        ((0.6, 0.6, 0.0), (3.5, 4.0)),  # through the door, out of the corridor
        ((3.5, 4.0, -1.5), (0.6, 0.6)),  # and back
        ((5.2, 0.6, 3.1416), (1.0, 3.0)),
        ((1.0, 3.0, 0.0), (1.0, 2.2)),  # within the room
        ((0.6, 0.6, 0.0), (5.0, 4.0, 2.0)),  # to a heading
        ((3.5, 4.0, -1.5), (3.5, 4.0, 1.5)),  # where it stands, to another heading
    ],
)
def test_the_outline_keeps_its_margin_all_the_way(start, goal):
    answer, problem = plan(start, goal)
    assert answer.status is Status.SOLVED
    assert not plan_faults(answer, problem, Footprint())
    corners, space = Footprint().corners, problem.space
    assert not sweep_faults(answer.path, corners, space.solid, space.bounds, 0.36 - 0.31)


@pytest.mark.parametrize(
    ("start", "goal", "door", "settings", "status"),
    [
        ((0.6, 0.6, math.pi), (3.5, 4.0), DOOR, {}, Status.START_OCCUPIED),  # its front is
        ((0.6, 0.6, 0.0), (1.0, 1.65), DOOR, {}, Status.GOAL_OCCUPIED),  # by any outline
        ((0.6, 0.6, 0.0), (1.0, 4.5, 1.5), DOOR, {}, Status.GOAL_OCCUPIED),  # at that heading
        ((0.6, 0.6, 0.0), (3.5, 4.0), 0.5, {}, Status.NO_PATH),
        ((0.6, 0.6, 0.0), (3.5, 4.0), DOOR, {"iterations": 3}, Status.EXHAUSTED),
    ],
)
def test_failures_have_their_names(start, goal, door, settings, status):
    answer, _ = plan(start, goal, door=door, **settings)
    assert answer.status is status
    assert len(answer.path) == 0


def test_a_chair_that_cannot_go_back_does_not(monkeypatch):
    limits = {"backward": 0.0}
    answer, _ = plan((0.6, 0.6, 0.0), (3.5, 4.0), limits=limits)
    assert answer.status is Status.SOLVED
    assert min(way for way, _ in stretches_of(answer.path)) > -1e-9
    case = CASES["dead_end"]  # out of it there is only the way back
    monkeypatch.setattr("planners.lattice.lattice.REFINEMENTS", 0)
    planner = make_planner({"name": "lattice", "limits": limits})
    assert planner.plan(case.problem, np.random.default_rng(0)).status is Status.EXHAUSTED


@pytest.mark.parametrize("spacing", [0.05, 0.035, 0.02])
def test_the_flood_never_shuts_a_way_that_there_is(spacing):
    for name, (problem, footprint, verdict) in CASES.items():
        motion = Lattice().motion_cost(footprint, Lattice().limits, MIN_GAP)
        goal = np.asarray(problem.goal, dtype=np.float64)
        if verdict.feasible:
            ends = problem.start, goal
            assert not is_cut_off(problem.space, motion, *ends, spacing, math.inf), name


def bend(clearance):
    """A bend in which a disc as wide as the chair turns, but not the chair; and the disc's plan."""
    walls = [(0.0, 0.84, 3.16, 4.0), (4.0, 0.0, 4.84, 4.0)]
    space = Space.from_rectangles(walls, (0.0, 0.0, 4.84, 4.0))
    problem = Problem(space, np.array([0.6, 0.42, 0.0]), np.array([3.58, 3.0]), clearance)
    answer = make_planner("lattice").plan(problem, np.random.default_rng(0))
    return answer, make_planner("visibility").plan(problem, np.random.default_rng(0))


def test_the_flood_proves_what_a_disc_does_not():
    answer, disc = bend(0.40)
    assert (disc.status, answer.status) == (Status.SOLVED, Status.NO_PATH)
    assert "flood" in answer.note
    assert answer.counters["iterations"] < 20_000


def test_a_complete_search_says_so():
    answer, _ = bend(0.31)
    assert (answer.status, "resolution" in answer.note) == (Status.EXHAUSTED, True)
    answer, _ = plan((0.6, 0.6, 0.0), (3.5, 4.0), iterations=3)
    assert (answer.status, answer.note) == (Status.EXHAUSTED, "")


def test_more_time_makes_better_paths():
    costs = [
        seconds(plan((0.6, 0.6, 0.0), (5.0, 4.0, 2.0), improvement=more)[0].path, Lattice())
        for more in (0, 1000, 30_000)
    ]
    assert costs[0] > costs[1] > costs[2]


LENGTH = st.floats(0.05, 1.0)


@settings(max_examples=150, deadline=None)
@given(
    st.lists(st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5)), min_size=3, max_size=3),
    st.floats(-1.0, 1.0), st.floats(-3.1, 3.1), st.tuples(LENGTH, LENGTH, LENGTH),
)  # fmt: skip
def test_the_gap_of_a_stretch_is_that_of_all_its_poses(corners, way, turn, outline):
    triangle = shapely.Polygon(corners)
    if triangle.area < 1e-3:
        return
    footprint = Footprint(*outline)
    times = np.linspace(0.0, 1.0, 300)
    poses = np.array([arc_step(0.0, 0.0, 0.0, way, turn, t) for t in times])
    chair = shapely.polygons([to_world(footprint.corners, pose) for pose in poses])
    gaps = shapely.distance(chair, triangle)
    if gaps[0] == 0.0:
        return
    space = Space(triangle, (-5.0, -5.0, 5.0, 5.0))
    gap = path_gaps(poses[[0, -1]], space, footprint)[0]
    between = (abs(way) + abs(turn) * footprint.reach) / len(times)
    minimum = min(float(gaps.min()), 1.0)
    assert minimum - between - 2e-6 <= gap <= minimum + 2e-6  # less turn than 1e-6 counts as none

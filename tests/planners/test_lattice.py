"""Laws of the lattice of manoeuvres: exact outline, drivable moves, honest statuses."""

import numpy as np
import pytest

from planners import Problem, Space, Status, make_planner
from wheelchair_gym.geometry import Footprint, footprint_clearance, wrap_angle

BOUNDS = (0.0, 0.0, 6.0, 5.0)
DOOR = 1.0  # m
CORRIDOR = 1.2  # m
NONE = np.empty((0, 3))


def storey(door=DOOR):
    """A corridor along the bottom, and a room above it behind a wall with a door."""
    low, high = CORRIDOR, CORRIDOR + 0.12
    walls = [(0.0, low, 3.0, high), (3.0 + door, low, 6.0, high)]
    return [np.array([(a, b), (c, b), (c, d), (a, d)]) for a, b, c, d in walls]


def plan(start, goal, clearance=0.36, door=DOOR, **settings):
    problem = Problem(
        Space.from_polygons(storey(door), BOUNDS), np.array(start), np.array(goal), clearance
    )
    planner = make_planner({"name": "lattice", **settings})
    return planner.plan(problem, np.random.default_rng(0)), problem


def clearances(path, problem):
    segments = problem.space.arrays.segments
    outline = Footprint().array
    return [footprint_clearance(*pose, outline, segments, NONE, 1.0) for pose in path]


@pytest.mark.parametrize(
    ("start", "goal"),
    [
        ((0.6, 0.6, 0.0), (3.5, 4.0)),  # through the door, out of the corridor
        ((3.5, 4.0, -1.5), (0.6, 0.6)),  # and back
        ((5.2, 0.6, 3.1416), (1.0, 3.0)),
        ((1.0, 3.0, 0.0), (1.0, 2.2)),  # within the room
    ],
)
def test_the_outline_keeps_its_margin_all_the_way(start, goal):
    answer, problem = plan(start, goal)
    assert answer.status is Status.SOLVED
    np.testing.assert_allclose(answer.path[0], start)
    np.testing.assert_allclose(answer.path[-1, :2], goal)
    # The field is read every 10 cm of the outline and every 5 cm of the map.
    assert min(clearances(answer.path, problem)) > 0.36 - 0.31 - 0.02


def test_moves_can_be_driven():
    answer, _ = plan((0.6, 0.6, 0.0), (3.5, 4.0))
    steps = np.diff(answer.path[:-1], axis=0)  # the last step is onto the goal itself
    turns = wrap_angle(steps[:, 2])
    middle = answer.path[:-2, 2] + 0.5 * turns
    sideways = np.sin(middle) * steps[:, 0] - np.cos(middle) * steps[:, 1]
    assert np.abs(sideways).max() < 1e-9
    assert np.abs(turns).max() < 0.1
    assert np.hypot(*(answer.path[-1] - answer.path[-2])[:2]) <= 0.06


def test_a_disc_finds_no_way_where_the_outline_does():
    start, goal = (0.6, 0.6, 0.0), (3.5, 4.0)
    assert plan(start, goal, clearance=0.33)[0].status is Status.SOLVED
    problem = Problem(
        Space.from_polygons(storey(), BOUNDS), np.array(start), np.array(goal),
        Footprint().reach,
    )  # fmt: skip
    assert make_planner("visibility").plan(problem, np.random.default_rng(0)).path.size == 0


@pytest.mark.parametrize(
    ("start", "goal", "door", "settings", "status"),
    [
        ((-1.0, 0.6, 0.0), (3.5, 4.0), DOOR, {}, Status.START_OUTSIDE),
        ((0.6, 0.6, 0.0), (3.5, 9.0), DOOR, {}, Status.GOAL_OUTSIDE),
        ((1.0, 1.25, 0.0), (3.5, 4.0), DOOR, {}, Status.START_OCCUPIED),
        ((0.6, 0.6, 0.0), (1.0, 1.25), DOOR, {}, Status.GOAL_OCCUPIED),
        ((0.6, 0.6, 0.0), (3.5, 4.0), 0.5, {}, Status.EXHAUSTED),
        ((0.6, 0.6, 0.0), (3.5, 4.0), DOOR, {"nodes": 100}, Status.EXHAUSTED),
    ],
)
def test_failures_have_their_names(start, goal, door, settings, status):
    answer, _ = plan(start, goal, door=door, **settings)
    assert answer.status is status
    assert len(answer.path) == 0


def test_the_same_problem_has_the_same_plan():
    first, second = (plan((0.6, 0.6, 0.0), (3.5, 4.0))[0] for _ in range(2))
    np.testing.assert_array_equal(first.path, second.path)
    assert first.counters == second.counters

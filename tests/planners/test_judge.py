"""The judge, and the oracle of poses, against what can be worked out by hand."""

import math

import numpy as np
import pytest
import shapely

from planners.judge import Judge, sweep_faults
from tests.planners.footprints import judged
from tests.planners.oracle import Oracle
from tests.planners.pose_grid import STEP, WIDEST, grid_headings
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import polygon_edges, to_world

BLOCK = shapely.box(4, 4, 6, 6)
BOUNDS = (0, 0, 10, 10)


@pytest.mark.parametrize(
    ("path", "clearance", "valid"),
    [
        ([(1, 4), (9, 4)], 0.0, True),  # along a side
        ([(2, 6), (6, 2)], 0.0, True),  # past a corner, touching it
        ([(1, 5), (9, 5)], 0.0, False),
        ([(3, 3), (7, 7)], 0.0, False),  # through two corners, along the diagonal
        ([(1, 1), (11, 1)], 0.0, False),
        ([(3, 3), (3, 7)], 0.9, True),
        ([(3, 3), (3, 7)], 1.1, False),
        ([(0.5, 1), (0.5, 9)], 1.0, False),  # too near the border
        ([(1, 1), (1, 1), (2, 1)], 0.0, True),  # standing still is no fault
        ([(5, 5), (5, 5)], 0.0, False),  # but not inside
        ([(1, 1), (np.nan, 1), (2, 1)], 0.0, False),
    ],
)
def test_judge_knows_good_from_bad(path, clearance, valid):
    path = np.array(path, dtype=float)
    assert (not Judge(BLOCK, BOUNDS, clearance).faults(path)) == valid


CHAIR = Footprint()
TURN = CHAIR.reach  # m: a front corner's way from the axle


@pytest.mark.parametrize(
    ("path", "block", "valid"),
    [
        ([(0, 0, 0), (3, 0, 0)], (1, 0.311, 2, 1), True),  # past, 1 mm beside
        ([(0, 0, 0), (3, 0, 0)], (1, 0.309, 2, 1), False),
        ([(0, 0, 0), (0, 0, 1.5)], (TURN + 0.001, -1, 3, 1), True),  # outside the corner's circle
        ([(0, 0, 0), (0, 0, -1.5)], (-0.1, -3, 0.1, -TURN + 0.001), False),  # just inside
        ([(0, 0, 0), (0, 0, 0.01)], (-0.01, 0.31 + 2e-4, 0.01, 1), True),  # where it turns about
        ([(0, 0, 0), (0, 0.1, 0)], (5, 5, 6, 6), False),  # sideways
        ([(0, 0, 0), (9.5, 0, 0)], (5, 5, 6, 6), False),  # out of the map
    ],
)
def test_judge_knows_what_an_outline_sweeps(path, block, valid):
    found = sweep_faults(path, CHAIR.corners, shapely.box(*block), (-10, -10, 10, 10))
    assert (not found) == valid


BOX = (0.0, 0.0, 2.7, 2.4)
WEDGE = [(0.9, 0.0), (1.5, 0.0), (1.3, 0.5)]
DISC = (0.3, 2.2, 0.25)


def test_headings_are_whole_steps_all_round():
    steps, headings = grid_headings()
    gaps = np.diff(np.append(headings, headings[0] + 2 * math.pi))
    assert gaps.min() > 0.0
    assert gaps.max() <= WIDEST
    ways = np.stack([np.cos(headings), np.sin(headings)], axis=1)
    np.testing.assert_allclose(ways * np.hypot(*steps.T)[:, None], steps, atol=1e-9)
    assert np.hypot(*steps.T).max() * STEP < 1.0  # a straight way sweeps what its two ends cover


def test_poses_and_pivots_agree_with_shapely():
    solid = shapely.union(shapely.Polygon(WEDGE), shapely.Point(DISC[:2]).buffer(DISC[2], 256))
    oracle = Oracle(polygon_edges(WEDGE), [DISC], solid, BOX)
    poses, pivots = oracle.free
    corners, world = Footprint().corners, shapely.box(*BOX).buffer(1e-9)
    rng = np.random.default_rng(0)
    for _ in range(500):
        h, i, j = (int(rng.integers(size)) for size in oracle.shape)
        x, y = oracle.frame[0] + j * STEP, oracle.frame[1] + i * STEP
        after = oracle.headings[(h + 1) % len(oracle.headings)]
        yaws = oracle.headings[h] + np.linspace(0, (after - oracle.headings[h]) % math.tau, 30)
        chair = shapely.polygons([to_world(corners, (x, y, yaw)) for yaw in yaws])
        free = (shapely.area(chair & solid) < 1e-9) & shapely.covers(world, chair)
        assert poses[h, i, j] == free[0]
        assert pivots[h, i, j] == free.all()


@pytest.mark.parametrize(("door", "feasible"), [(0.70, True), (0.50, False)])
def test_a_door_is_passed_if_it_is_wide_enough(door, feasible):
    """From a corridor of 1.2 m along the bottom to a room above it; the door is round x = 1.5."""
    walls = [(0.0, 1.2, 1.5 - door / 2, 1.3), (1.5 + door / 2, 1.2, 3.0, 1.3)]
    verdict = judged((3.0, 2.7), walls, (0.45, 0.6, 0.0), (1.5, 1.8), Footprint())
    assert verdict.feasible is feasible
    assert (verdict.upper < math.inf) == feasible
    if feasible:
        assert 1.05 < verdict.lower <= verdict.upper
        assert verdict.upper < 1.1 * verdict.lower


def test_lengths_in_the_open_are_those_of_straight_ways():
    oracle = Oracle(np.empty((0, 4)), [], shapely.Point(), (0.0, 0.0, 3.0, 3.0), anchor=(0.9, 0.9))
    verdict = oracle.judge((0.9, 0.9, 0.0), (1.8, 2.1, 0.0))
    assert verdict.upper == pytest.approx(1.5, abs=1e-5)  # heading (3, 4) is one of the grid's
    assert verdict.lower == pytest.approx(1.5, abs=1e-5)

"""The oracle itself, against shapely and against what can be worked out by hand."""

import math

import numpy as np
import pytest
import shapely

from tests.planners.footprints import judged
from tests.planners.oracle import Oracle
from tests.planners.pose_grid import STEP, WIDEST, grid_headings
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import polygon_edges

BOX = (0.0, 0.0, 2.7, 2.4)
WEDGE = [(0.9, 0.0), (1.5, 0.0), (1.3, 0.5)]
DISC = (0.3, 2.2, 0.25)


def storey(door):
    """A corridor of 1.2 m along the bottom, and a room above it behind a door round x = 1.5."""
    return [(0.0, 1.2, 1.5 - door / 2, 1.3), (1.5 + door / 2, 1.2, 3.0, 1.3)]


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

    def covered(x, y, yaw):
        c, s = np.cos(yaw), np.sin(yaw)
        turned = corners @ np.moveaxis(np.array([(c, s), (-s, c)]), -1, 0) + (x, y)
        return shapely.polygons(turned)

    for _ in range(500):
        h, i, j = (int(rng.integers(size)) for size in oracle.shape)
        x, y = oracle.frame[0] + j * STEP, oracle.frame[1] + i * STEP
        after = oracle.headings[(h + 1) % len(oracle.headings)]
        yaws = oracle.headings[h] + np.linspace(0, (after - oracle.headings[h]) % math.tau, 30)
        chair = covered(x, y, yaws)
        free = (shapely.area(chair & solid) < 1e-9) & shapely.covers(world, chair)
        assert poses[h, i, j] == free[0]
        assert pivots[h, i, j] == free.all()


@pytest.mark.parametrize(("door", "feasible"), [(0.70, True), (0.50, False)])
def test_a_door_is_passed_if_it_is_wide_enough(door, feasible):
    verdict = judged((3.0, 2.7), storey(door), (0.45, 0.6, 0.0), (1.5, 1.8), Footprint())
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

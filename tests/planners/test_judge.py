import numpy as np
import pytest
import shapely

from planners.judge import Judge, sweep_faults
from wheelchair_gym.geometry.outline import Footprint

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

import numpy as np
import pytest
import shapely

from tests.planners.judge import faults

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
    ],
)
def test_judge_knows_good_from_bad(path, clearance, valid):
    path = np.array(path, dtype=float)
    assert (not faults(path, BLOCK, BOUNDS, clearance)) == valid

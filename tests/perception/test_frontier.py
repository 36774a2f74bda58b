"""Frontiers: where a chair can stand at the edge of what it knows."""

import numpy as np
import pytest

from wheelchair_gym.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, geodesic
from wheelchair_gym.perception.occupancy import find_frontiers


@pytest.fixture
def cells():
    """A hall of 8 m x 4 m whose east end is unknown, and a closed room beside it."""
    cells = np.full((100, 100), UNKNOWN, np.int8)
    cells[20:60, 10:80] = FREE
    cells[19, 9:81] = cells[60, 9:81] = cells[19:61, 9] = OCCUPIED
    cells[64:80, 10:60] = FREE
    cells[63, 9:61] = cells[80, 9:61] = cells[63:81, 9] = cells[63:81, 60] = OCCUPIED
    return cells


def test_the_only_frontier_is_the_open_end(cells):
    grid = OccupancyGrid(cells, 0.1)
    pose = np.array([2.0, 4.0, 0.3])
    (found,) = find_frontiers(grid, pose, 0.35)
    assert found.place[0] == pytest.approx(7.95)
    assert abs(found.place[1] - 4.0) < 0.06
    assert found.path_length == pytest.approx(geodesic(grid, pose[:2], 0.35).at(found.place))
    # Cells beside the walls are no place for the disc.
    assert found.length == pytest.approx(4.0 - 2 * 0.3)


def test_nothing_is_left_where_all_is_known_or_out_of_reach(cells):
    cells[19:61, 80] = OCCUPIED
    cells[64:80, 60] = FREE  # the room opens to the unknown, and no way leads there
    grid = OccupancyGrid(cells, 0.1)
    assert find_frontiers(grid, (2.0, 4.0), 0.35) == []
    assert len(find_frontiers(grid, (2.0, 7.2), 0.35)) == 1


def test_gaps_between_beams_are_no_frontiers(cells):
    cells[19:61, 80] = OCCUPIED
    cells[40, 40:43] = UNKNOWN
    grid = OccupancyGrid(cells, 0.1)
    assert find_frontiers(grid, (2.0, 4.0), 0.35, min_length=1.0) == []
    (gap,) = find_frontiers(grid, (2.0, 4.0), 0.35, min_length=0.2)
    assert gap.beyond == pytest.approx(0.03)


def test_what_lies_beyond_a_frontier_is_measured(cells):
    """A hall whose east end is unknown up to the map's edge, or up to a wall."""
    (found,) = find_frontiers(OccupancyGrid(cells, 0.1), (2.0, 4.0), 0.35)
    assert found.beyond == np.inf
    cells[19:61, 95] = cells[19, 80:96] = cells[60, 80:96] = OCCUPIED
    (found,) = find_frontiers(OccupancyGrid(cells, 0.1), (2.0, 4.0), 0.35)
    assert found.beyond == pytest.approx(40 * 15 * 0.01)

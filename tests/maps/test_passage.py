"""Tightness of a place, compared with gaps and corners whose limits are known exactly."""

import math

import numpy as np
import pytest

from tests.conftest import long_but
from wheelchair_gym import maps
from wheelchair_gym.geometry.outline import Footprint, best_clearance_heading
from wheelchair_gym.scenes.arena import Doorway

OUTLINE = Footprint()
BOX = np.array([(0, 0, 6, 0), (6, 0, 6, 4), (6, 4, 0, 4), (0, 4, 0, 0)], dtype=float)


@pytest.mark.parametrize("wide", [6, 9, 20])
def test_the_bottleneck_is_half_the_narrowest_gap(wide):
    cells = np.full((60, 100), maps.FREE)
    cells[:, 50:52] = maps.OCCUPIED
    cells[20 : 20 + wide, 50:52] = maps.FREE
    grid = maps.OccupancyGrid(cells, 0.05)
    half = wide / 2 * 0.05
    found = maps.bottleneck(grid, (1.0, 1.5), (4.0, 1.5))
    assert half - 0.026 <= found <= half + 1e-6
    cells[:, 50:52] = maps.OCCUPIED
    assert maps.bottleneck(maps.OccupancyGrid(cells, 0.05), (1.0, 1.5), (4.0, 1.5)) == -math.inf


@pytest.mark.parametrize("gap", long_but((0.56, 0.66, 0.70, 0.76, 0.82, 1.2), (0.56, 0.70, 0.82)))
@pytest.mark.parametrize("round_", [False, True])
def test_between_posts_an_outline_may_grow_by_half_the_play(gap, round_):
    low, high = 2.0 - 0.5 * gap, 2.0 + 0.5 * gap
    walls = np.vstack([BOX, [(3, 0, 3, low - 0.2), (3, high + 0.2, 3, 4)]])
    posts = np.array([(3, low - 0.15, 0.15), (3, high + 0.15, 0.15)])
    if not round_:
        walls = np.vstack([BOX, [(3, 0, 3, low), (3, high, 3, 4)]])
        posts = np.empty((0, 3))
    found = maps.footprint_margin(walls, posts, (1.0, 2.0, 0.0), (5.0, 2.0), OUTLINE)
    exact = min(0.10, 0.5 * gap - OUTLINE.half_width)
    assert exact - 0.0201 <= found <= exact + 0.0101


@pytest.mark.parametrize(
    ("door", "corridor"),
    long_but([(0.85, 0.9), (0.8, 1.05), (0.9, 1.0), (0.7, 0.8)], [(0.85, 0.9), (0.7, 0.8)]),
)
def test_turns_count(door, corridor):
    scene = Doorway(door_width=door, corridor_width=corridor)
    small = Footprint(0.2, 0.2, 0.2)  # the scene refuses a chair that does not get round its corner
    world = scene.sample(np.random.default_rng(0), small)
    assert scene.margin() < 0.5 * min(door, corridor) - OUTLINE.half_width
    found = maps.footprint_margin(world.walls, world.discs, world.start, world.goal, OUTLINE)
    assert scene.margin() - 0.0201 <= found <= scene.margin() + 0.0101


def test_where_no_way_leads_the_least_is_said():
    walls = np.vstack([BOX, [(3, 0, 3, 4)]])
    discs = np.empty((0, 3))
    assert maps.footprint_margin(walls, discs, (1.0, 2.0, 0.0), (5.0, 2.0), OUTLINE) == -0.05
    assert maps.footprint_margin(walls, discs, (1.0, 2.0, 0.0), (2.0, 2.0), OUTLINE) == 0.10


@pytest.mark.parametrize(("place", "yaw"), [((0.45, 2.0), 0.0), ((5.55, 2.0), math.pi)])
def test_in_a_lane_the_roomiest_heading_is_along_it_with_the_back_to_the_wall(place, yaw):
    lane = np.vstack([BOX, [(0, 1.5, 6, 1.5), (0, 2.5, 6, 2.5)]])
    discs = np.empty((0, 3))
    found, room = best_clearance_heading(place, OUTLINE, lane, discs)
    assert found == pytest.approx(yaw)
    assert room == pytest.approx(0.45 - OUTLINE.rear)
    assert best_clearance_heading((0.1, 2.0), OUTLINE, lane, discs)[1] <= 0.0


@pytest.mark.parametrize("side", [1, 4, 5])
def test_open_floor_is_made_of_free_squares(side):
    cells = np.where(np.random.default_rng(3).random((40, 50)) < 0.06, maps.OCCUPIED, maps.FREE)
    cells[:, 44:] = maps.UNKNOWN
    expected = np.zeros(cells.shape, bool)
    for row in range(41 - side):
        for column in range(51 - side):
            square = np.s_[row : row + side, column : column + side]
            expected[square] |= (cells[square] == maps.FREE).all()
    grid = maps.OccupancyGrid(cells.astype(np.int8), 0.05)
    assert 0.1 < expected.mean() < 0.9
    assert (maps.open_floor(grid, 0.05 * side) == expected).all()
    assert (maps.open_floor(grid, 0.01) == (grid.cells == maps.FREE)).all()  # at least a cell

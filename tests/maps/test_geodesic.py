"""Shortest ways: against exact ones, near walls, and from nowhere."""

import itertools
import math

import numpy as np
import pytest
import shapely
from scipy import ndimage

from tests.planners.oracle import lengths_from_first
from wheelchair_gym.geometry.planar import path_length
from wheelchair_gym.maps import FREE, OCCUPIED, OccupancyGrid, geodesic
from wheelchair_gym.maps.geodesic import nearest_bend


def boxes(seed: int, side: int = 40, count: int = 9, resolution: float = 0.1) -> OccupancyGrid:
    rng = np.random.default_rng(seed)
    cells = np.full((side, side), OCCUPIED)
    cells[1:-1, 1:-1] = FREE
    for _ in range(count):
        row, col = rng.integers(1, side - 4, 2)
        cells[row : row + rng.integers(1, 4), col : col + rng.integers(3, 14)] = OCCUPIED
    return OccupancyGrid(cells, resolution)


def exact_lengths(free: np.ndarray, goal: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Shortest ways among squares, bending at cell centres, from a visibility graph [cells].

    A shortest way bends only beside an outer corner of what is blocked.
    """
    padded = np.pad(free, 1)  # off the grid is blocked
    corner = [
        (x + side_x + 0.5 - 1, y + side_y + 0.5 - 1)
        for y in range(free.shape[0] + 1)
        for x in range(free.shape[1] + 1)
        for side_y, side_x in ((0, 0), (0, 1), (1, 0), (1, 1))
        if padded[y : y + 2, x : x + 2].sum() == 3 and not padded[y + 1 - side_y, x + 1 - side_x]
    ]
    nodes = np.vstack([goal, starts, np.array(corner, dtype=float).reshape(-1, 2)])
    rows, cols = np.nonzero(free)
    squares = shapely.union_all(shapely.box(cols, rows, cols + 1, rows + 1))
    room = squares.buffer(1e-6, join_style="mitre")
    return lengths_from_first(room, nodes)[1 : 1 + len(starts)]


@pytest.mark.parametrize("seed", range(3))
def test_lengths_are_within_one_percent_of_the_shortest(seed):
    grid = boxes(seed)
    free = grid.traversable(0.12)
    rng = np.random.default_rng(seed)
    cells = np.argwhere(free)
    picked = cells[rng.permutation(len(cells))[:25]]
    goal, starts = picked[0], picked[1:]
    ways = geodesic(grid, grid.to_world(goal), 0.12)
    exact = exact_lengths(free, goal[::-1] + 0.5, starts[:, ::-1] + 0.5) * grid.resolution
    found = ways.at(grid.to_world(starts))
    assert (np.isinf(found) == np.isinf(exact)).all()
    reached = np.isfinite(exact)
    # Cutting a corner by less than half a cell may save as much.
    assert (found <= exact * 1.01 + 1e-6)[reached].all()
    assert (found >= exact - 0.5 * grid.resolution)[reached].all()


def test_the_way_round_a_disc_is_tangents_and_an_arc():
    size, resolution, big, radius = 10.0, 0.05, 2.0, 0.36
    centres = (np.indices((200, 200)) + 0.5) * resolution
    cells = np.where(np.hypot(centres[0] - 5, centres[1] - 5) < big, OCCUPIED, FREE)
    start, goal = np.array([0.6, 5.0]), np.array([9.4, 5.0])
    reach, far = big + radius, size / 2 - 0.6
    angle = math.pi - 2 * math.acos(reach / far)
    exact = 2 * math.sqrt(far**2 - reach**2) + reach * angle
    ways = geodesic(OccupancyGrid(cells, resolution), goal, radius)
    assert float(ways.at(start)) == pytest.approx(exact, rel=0.01)
    assert path_length(ways.path(start)) == pytest.approx(exact, rel=0.01)


@pytest.mark.parametrize("seed", range(6))
def test_ways_keep_their_radius_and_their_length(seed):
    radius = 0.25
    grid = boxes(seed, side=80, count=10)
    cells = np.argwhere(grid.traversable(radius))
    rng = np.random.default_rng(seed)
    goal, *starts = grid.to_world(cells[rng.integers(len(cells), size=12)])
    ways = geodesic(grid, goal, radius)
    gap = grid.distance()
    for start in starts:
        way = ways.path(start)
        if len(way) == 0:
            assert np.isinf(ways.at(start))
            continue
        assert way[0] == pytest.approx(start)
        assert way[-1] == pytest.approx(goal)
        dense = shapely.segmentize(shapely.LineString(way), 0.01)
        row, col = grid.to_cell(shapely.get_coordinates(dense)).T
        assert (gap[row, col] >= radius - grid.resolution).all()
        assert path_length(way) == pytest.approx(float(ways.at(start)), abs=0.02)


def corridor() -> OccupancyGrid:
    cells = np.full((40, 100), OCCUPIED)
    cells[10:30, 5:95] = FREE
    return OccupancyGrid(cells, 0.05)


def test_a_point_too_near_a_wall_has_a_way_and_one_beyond_it_has_none():
    grid = corridor()
    ways = geodesic(grid, (4.0, 1.0), 0.36)
    beside = np.array([(1.0, y) for y in np.linspace(0.5, 1.5, 41)])
    assert np.isfinite(ways.at(beside)).all()
    assert all(len(ways.path(point)) for point in beside)
    assert (ways.at(beside) < 3.6).all()
    assert np.isinf(ways.at([(1.0, 0.02), (-9.0, 0.0), (2.0, 90.0)])).all()
    assert len(ways.path((1.0, 0.02))) == 0
    # Off the centres of cells lengths change smoothly.
    line = np.stack([np.linspace(0.7, 3.9, 641), np.full(641, 1.013)], axis=1)
    assert np.diff(ways.at(line)) == pytest.approx(-0.005, abs=0.002)


def test_a_goal_too_near_a_wall_is_reached_from_the_nearest_cell():
    ways = geodesic(corridor(), (4.0, 0.6), 0.36)
    assert float(ways.at((1.0, 1.0))) == pytest.approx(3.0 + 0.26, abs=0.03)


def test_no_cell_beyond_the_map_is_read_from_its_rim():
    grid = OccupancyGrid(np.full((40, 40), FREE), 0.05)
    bends = geodesic(grid, (1.0, 1.0), 0.0)._bends.view(np.recarray)
    for at in itertools.product((-0.5, 39.5), (-0.5, 39.5)):  # the interpreter checks indices
        assert nearest_bend.py_func(grid.traversable(0.0), bends, *at) == 0


@pytest.mark.parametrize("goal", [(0.1, 0.1), (-4.0, 1.0)])
def test_a_goal_that_is_not_free_has_no_ways(goal):
    ways = geodesic(corridor(), goal, 0.36)
    assert np.isinf(ways.field).all()
    assert np.isinf(ways.at((1.0, 1.0)))
    assert ways.path((1.0, 1.0)).shape == (0, 2)


@pytest.mark.parametrize("share", [0.03, 0.15, 0.3])
def test_every_cell_that_hangs_together_with_the_goal_has_a_way_and_no_other(share):
    for seed in range(60):
        rng = np.random.default_rng(seed)
        grid = OccupancyGrid(np.where(rng.random((24, 31)) < share, OCCUPIED, FREE), 1.0)
        free = np.argwhere(grid.cells == FREE)
        goal = free[rng.integers(len(free))]
        ways = geodesic(grid, grid.to_world(goal) + rng.uniform(-0.4, 0.4, 2), 0.1)
        region, _ = ndimage.label(grid.cells == FREE)
        assert (np.isfinite(ways.field) == (region == region[tuple(goal)])).all()


def test_beside_reachable_ground_the_way_is_that_of_the_nearest_cell_and_the_gap():
    ways = geodesic(boxes(3), (2.0, 2.0), 0.25)
    reached = np.isfinite(ways.field)
    gaps = ndimage.distance_transform_edt(~reached)
    near = gaps <= 0.25 / 0.1 + 1.5
    assert (np.isfinite(ways.extended) == near).all()
    cells = np.argwhere(reached)
    for row, col in np.argwhere(near & ~reached):
        away = np.hypot(*(cells - (row, col)).T)
        nearest = cells[away < gaps[row, col] + 1e-6]  # of several, any may be meant
        own = ways.extended[row, col] - 0.1 * gaps[row, col]
        assert np.abs(ways.field[tuple(nearest.T)] - own).min() < 1e-5
    assert (ways.extended == ways.field)[reached].all()


def test_a_grid_remembers_the_last_ways_and_no_more():
    grid = boxes(1)
    first = geodesic(grid, (2.0, 2.0), 0.1)
    assert geodesic(grid, (2.0, 2.0), 0.1).extended is first.extended
    other = geodesic(grid, (2.0, 2.0), 0.2)
    assert (other.extended != first.extended).any()
    assert len(grid.geodesic_cache) == 1
    assert first.extended.dtype == np.float32
    assert first.extended.flags.c_contiguous

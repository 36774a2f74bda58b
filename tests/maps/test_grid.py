"""Cells, walls and distances of a grid."""

import numpy as np
import pytest
import shapely

from tests.sim.worlds import wall_gaps
from wheelchair_gym.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid


def random_grid(seed: int, share: float = 0.5, origin=(0.0, 0.0, 0.0), side=14) -> OccupancyGrid:
    rng = np.random.default_rng(seed)
    shape = rng.integers(1, side, 2)
    return OccupancyGrid(np.where(rng.random(shape) < share, OCCUPIED, FREE), 0.25, origin)


@pytest.mark.parametrize("yaw", [0.0, 0.7])
@pytest.mark.parametrize("seed", range(12))
def test_parity_of_walls_is_what_is_solid(seed, yaw):
    grid = random_grid(seed, [0.2, 0.5, 0.8][seed % 3], (3.0, -2.0, yaw))
    cells = np.argwhere(np.ones(grid.shape, dtype=bool))
    centres = grid.to_world(cells)
    rays = shapely.linestrings(np.stack([centres, centres + np.array([100.0, 0.0])], axis=1))
    walls = shapely.linestrings(grid.walls().reshape(-1, 2, 2))
    solid = shapely.intersects(rays[:, None], walls).sum(axis=1) % 2
    assert (solid == grid.solid().ravel()).all()


@pytest.mark.parametrize("seed", range(12))
def test_walls_are_all_boundary_edges_and_no_more(seed):
    grid = random_grid(seed, 0.5)
    walls = grid.walls()
    assert grid.n_walls == len(walls)
    padded = np.pad(grid.solid().astype(int), 1)
    edges = sum(np.abs(np.diff(padded, axis=axis)).sum() for axis in (0, 1))
    length = np.hypot(walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1])
    assert length.sum() == pytest.approx(edges * grid.resolution)
    # Loops close: as many segments begin at a corner as end there.
    begins, ends = (np.rint(walls[:, k : k + 2] / grid.resolution) for k in (0, 2))
    assert sorted(map(tuple, begins)) == sorted(map(tuple, ends))


@pytest.mark.parametrize("seed", range(6))
def test_walls_run_as_far_as_they_can_and_keep_solid_on_the_left(seed):
    grid = random_grid(seed, 0.4)
    walls = grid.walls()
    along = walls[:, 2:] - walls[:, :2]
    unit = along / np.abs(along).sum(axis=1, keepdims=True)
    ends = {(*np.rint(w[:2] / 0.25), *u) for w, u in zip(walls, unit, strict=True)}
    for wall, way in zip(walls, unit, strict=True):
        assert (*np.rint(wall[2:] / 0.25), *way) not in ends  # no segment carries straight on
        left = (wall[:2] + wall[2:]) / 2 + 0.01 * np.array([-way[1], way[0]]) + 0.003 * way
        row, col = grid.to_cell(left)
        assert grid.cells[row, col] == OCCUPIED


def test_an_empty_grid_has_no_walls_and_no_end_of_room():
    grid = OccupancyGrid(np.zeros((4, 5)), 0.1)
    assert grid.walls().shape == (0, 4)
    assert np.isinf(grid.distance()).all()


@pytest.mark.parametrize(("share", "side"), [(0.1, 14), (0.003, 100)])
@pytest.mark.parametrize("seed", range(8))
def test_distance_is_exact_to_the_nearest_square(seed, share, side):
    grid = random_grid(seed, share, side=side)
    if not grid.solid().any():
        pytest.skip("this seed draws nothing solid")
    exact = wall_gaps(grid.to_world(np.moveaxis(np.indices(grid.shape), 0, -1)), grid.walls())
    assert grid.distance() == pytest.approx(np.where(grid.solid(), 0.0, exact), abs=1e-6)


def test_unknown_is_solid_only_if_asked_and_never_traversable():
    cells = np.array([[FREE, UNKNOWN, 50, OCCUPIED]])
    grid = OccupancyGrid(cells, 1.0)
    assert grid.solid().tolist() == [[False, False, False, True]]
    assert grid.solid(unknown_is_solid=True).tolist() == [[False, True, True, True]]
    assert grid.traversable(0.0).tolist() == [[True, False, False, False]]


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
def test_cells_and_points_are_inverse(yaw):
    grid = OccupancyGrid(np.zeros((7, 9)), 0.05, (-3.0, 2.0, yaw))
    cells = np.argwhere(grid.cells == FREE)
    assert (grid.to_cell(grid.to_world(cells)) == cells).all()
    assert grid.inside(grid.to_world(cells)).all()
    assert not grid.inside(grid.to_world([(-1, 0), (0, 9), (7, 3)])).any()
    x0, y0, x1, y1 = grid.bounds
    assert (grid.to_world(cells) > (x0, y0)).all()
    assert (grid.to_world(cells) < (x1, y1)).all()
    if yaw == 0.0:
        assert grid.bounds == pytest.approx((-3.0, 2.0, -2.55, 2.35))


def test_the_extent_of_a_turned_grid_is_not_its_bounding_box():
    straight, turned = (
        OccupancyGrid(np.zeros((4, 5)), 0.5, (1.0, 2.0, yaw)).extent for yaw in (0.0, 0.7)
    )
    assert straight == "1 to 3.5 and 2 to 4 m"
    assert turned == "2.5 m x 2 m from the corner (1, 2), turned by 0.7 rad"

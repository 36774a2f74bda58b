"""Maps of others: MovingAI's text maps, HouseExpo's outlines; wrong ones are told."""

import numpy as np
import pytest

from tests.conftest import put
from wheelchair_gym import maps
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.geometry.planar import polygon_edges, to_world
from wheelchair_gym.scenes import make_scene

OCTILE = "type octile\nheight 3\nwidth 4\nmap\n.G@O\nSSTW\n....\n"
VERTS = [[0, 0], [8, 0], [8, 4], [5, 4], [4, 6], [0, 6], [0, 0]]
HOUSE = {"verts": VERTS, "bbox": {"min": [0.0, 0.0], "max": [8.0, 6.0]}, "room_num": 1, "id": "abc"}


def test_an_octile_map_is_what_its_letters_say(tmp_path):
    grid = maps.read_moving_ai_map(put(tmp_path / "yard.map", OCTILE), resolution=0.5)
    expected = [[0, 0, 0, 0], [0, 0, 1, 1], [0, 0, 1, 1]]  # lowest row first
    assert (grid.cells == np.where(expected, maps.OCCUPIED, maps.FREE)).all()
    assert grid.bounds == (0.0, 0.0, 2.0, 1.5)


def test_a_house_is_free_inside_its_outline_only(tmp_path):
    path = put(tmp_path / "house.json", HOUSE)
    house, ground = maps.read_house(path), maps.read_any_map(path)
    assert len(house.outline) == 6  # the corner repeated at the end is one
    grid = ground.grid
    free = grid.cells == maps.FREE
    assert free.sum() * grid.resolution**2 == pytest.approx(41.0, abs=0.1)
    centres = grid.to_world(np.argwhere(free))
    for corner in ((0.5, 0.5), (0.5, -0.5), (-0.5, 0.5), (-0.5, -0.5)):  # whole cells are inside
        x, y = (centres + np.array(corner) * grid.resolution).T
        assert ((x >= -1e-9) & (x <= 8 + 1e-9) & (y >= -1e-9) & (y <= 6 + 1e-9)).all()
        assert ((y <= 4 + 1e-9) | (y - 4 <= 2 * (5 - x) + 1e-9)).all()
    episode = make_scene({"name": "map_file", "path": str(path)}).sample(np.random.default_rng(0))
    assert free[tuple(grid.to_cell(episode.start[:2]))]


def winding(points, walls):
    """Return winding numbers of closed loops of walls (n, 4) around points (k, 2)."""
    x, y = points.T[:, :, None]
    ax, ay, bx, by = walls.T
    left = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
    return ((ay <= y) & (by > y) & (left > 0)).sum(1) - ((ay > y) & (by <= y) & (left < 0)).sum(1)


@pytest.mark.parametrize("seed", range(8))
def test_solid_polygons_that_overlap_are_united(tmp_path, seed):
    """A point in any polygon, of either orientation, or off the bounds is solid."""
    rng = np.random.default_rng(seed)
    polygons = []
    for _ in range(rng.integers(1, 12)):
        size, turn = rng.uniform(0.3, 6.0, 2), rng.choice([0.0, rng.uniform(0, 6)])
        box = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * size / 2
        polygons.append(to_world(box, (*rng.integers(0, 9, 2), turn))[:: rng.choice([-1, 1])])
    top = rng.uniform((7.9, 5.9), (8.0, 6.0))
    room = {"bounds": [0, 0, *top], "polygons": [polygon.tolist() for polygon in polygons]}
    found = maps.read_any_map(put(tmp_path / "room.json", room))
    points = rng.uniform(-0.1, top + 0.1, (2000, 2))
    solid = ((points < 0) | (points > top)).any(axis=1)
    for polygon in polygons:
        solid |= winding(points, polygon_edges(polygon)) != 0
    np.testing.assert_array_equal(winding(points, found.walls), solid)
    cells = found.grid.cells[tuple(found.grid.to_cell(points).T)]
    assert (cells[solid] == maps.OCCUPIED).all()
    centres = found.grid.to_world(np.argwhere(found.grid.cells == maps.OCCUPIED))
    near = winding(centres, found.walls) == 1
    for dx, dy in ((0.5, 0.5), (-0.5, 0.5), (0.5, -0.5), (-0.5, -0.5)):
        near |= winding(centres + 0.05 * np.array([dx, dy]), found.walls) == 1
    assert near.mean() > 0.99  # a corner of a polygon may lie within a cell


def test_a_map_with_too_many_walls_is_refused_where_it_is_driven_on(tmp_path):
    """Specks cost memory and time by their number; `read_grid` still reads the cells."""
    cells = np.full((350, 350), maps.FREE)
    cells[::2, ::2] = maps.OCCUPIED  # 30,625 specks
    maps.write_map(maps.OccupancyGrid(cells, 0.05), tmp_path / "specks.yaml")
    assert maps.read_grid(tmp_path / "specks.yaml").n_walls == 4 * 175**2
    with pytest.raises(InputError, match=r"specks\.yaml: 122,500 walls; expected at most 100,000"):
        maps.read_any_map(tmp_path / "specks.yaml")

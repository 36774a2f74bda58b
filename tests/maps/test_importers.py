"""Maps of others: MovingAI's text maps, HouseExpo's outlines; wrong ones are told."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from wheelchair_gym.config import InputError
from wheelchair_gym.maps import (
    FREE,
    OCCUPIED,
    read_any_map,
    read_house,
    read_moving_ai_map,
)
from wheelchair_gym.scenes import make_scene

OCTILE = "type octile\nheight 3\nwidth 4\nmap\n.G@O\nSSTW\n....\n"
VERTS = [[0, 0], [8, 0], [8, 4], [5, 4], [4, 6], [0, 6], [0, 0]]
HOUSE = {
    "verts": VERTS,
    "bbox": {"min": [0.0, 0.0], "max": [8.0, 6.0]},
    "room_num": 1,
    "id": "abc",
}


def put(folder, name, content):
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_an_octile_map_is_what_its_letters_say(tmp_path):
    grid = read_moving_ai_map(put(tmp_path, "yard.map", OCTILE), resolution=0.5)
    expected = [[0, 0, 0, 0], [0, 0, 1, 1], [0, 0, 1, 1]]  # lowest row first
    assert (grid.cells == np.where(expected, OCCUPIED, FREE)).all()
    assert grid.bounds == (0.0, 0.0, 2.0, 1.5)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("", "line 1 is ''; expected 'type octile'"),
        (OCTILE.replace("octile", "tile"), "line 1 is 'type tile'"),
        (OCTILE.replace("height 3", "height many"), "line 2 is 'height many'; expected 'height N'"),
        (OCTILE.replace("width 4", "width 0"), "line 3 is 'width 0'"),
        (OCTILE.replace("width 4", "width 99999999999"), "expected at most"),
        (OCTILE.replace("map\n", "cells\n"), "line 4 is 'cells'; expected 'map'"),
        (OCTILE + "....\n", "has 4 rows; expected height 3"),
        (OCTILE.replace("SSTW", "SST"), "line 6 has 3 cells; expected width 4"),
        (OCTILE.replace("SSTW", "SS?W"), "line 6, column 3 is '?'"),
        (OCTILE.replace("SSTW", "SSéW"), "line 6, column 3 is 'é'"),
    ],
)
def test_wrong_octile_maps_are_one_line(tmp_path, content, says):
    with pytest.raises(InputError, match=re.escape(f"bad.map: {says}") if says[0] != "e" else says):
        read_moving_ai_map(put(tmp_path, "bad.map", content))


def test_a_house_is_free_inside_its_outline_only(tmp_path):
    path = put(tmp_path, "house.json", HOUSE)
    house, ground = read_house(path), read_any_map(path)
    assert len(house.outline) == 6  # the corner repeated at the end is one
    grid = ground.grid
    free = grid.cells == FREE
    assert free.sum() * grid.resolution**2 == pytest.approx(41.0, abs=0.1)
    centres = grid.to_world(np.argwhere(free))
    for corner in ((0.5, 0.5), (0.5, -0.5), (-0.5, 0.5), (-0.5, -0.5)):  # whole cells are inside
        x, y = (centres + np.array(corner) * grid.resolution).T
        assert ((x >= -1e-9) & (x <= 8 + 1e-9) & (y >= -1e-9) & (y <= 6 + 1e-9)).all()
        assert ((y <= 4 + 1e-9) | (y - 4 <= 2 * (5 - x) + 1e-9)).all()
    episode = make_scene({"name": "map_file", "path": str(path)}).sample(np.random.default_rng(0))
    assert free[tuple(grid.to_cell(episode.start[:2]))]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"verts": None}, "verts is None"),
        ({"verts": [[0, 0], [1, "x"]]}, "verts[1] is"),
        ({"verts": [[0, 0], [1, 0], [0, 0]]}, "verts has 2 corners"),
        ({"verts": [[0, 0], [1, 0], [2, 0]], "bbox": None}, "verts enclose nothing"),
        ({"verts": [[0, 0], [9e4, 0], [2, 7]]}, "verts span 90000 m"),
        ({"verts": [[0, 0], [9e9, 0], [2, 7]]}, "verts[1] is [9000000000.0, 0]"),
        ({"bbox": [0, 0, 8, 6]}, "bbox is [0, 0, 8, 6]; expected min and max"),
        ({"bbox": {"min": [0, 0], "max": [800, 600]}}, "bbox is [[0.0, 0.0], [800.0, 600.0]]"),
    ],
)
def test_wrong_houses_are_one_line(tmp_path, change, says):
    with pytest.raises(InputError, match=re.escape(f"bad.json: {says}")):
        read_house(put(tmp_path, "bad.json", HOUSE | change))


def test_maps_of_no_known_kind_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"hall\.svg: not a known kind"):
        read_any_map(put(tmp_path, "hall.svg", "<svg/>"))
    with pytest.raises(InputError, match=r"list\.json: verts is missing"):
        read_any_map(put(tmp_path, "list.json", []))

"""Unknown cells of a given map are blocked, or free where one asks for it, wherever it is used."""

import gymnasium as gym
import numpy as np
import pytest

from tests.conftest import json_of, refusal
from wheelchair_gym.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, write_map
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.types import Episode

ENDS = {"start": (1.0, 1.0, 0.0), "goal": (5.0, 1.0, 0.0)}
ENDS_OF = ("--start", "1,1,0", "--goal", "5,1,0")


@pytest.fixture(scope="module")
def maps(tmp_path_factory):
    """A room with unknown ground in its middle, and the same room with it occupied, and free."""
    folder = tmp_path_factory.mktemp("maps")
    cells = np.full((40, 60), FREE)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    cells[:25, 25:35] = np.where(np.random.default_rng(0).random((25, 10)) < 0.9, UNKNOWN, FREE)
    grids = {}
    for name, value in (("unknown", UNKNOWN), ("blocked", OCCUPIED), ("free", FREE)):
        grids[name] = OccupancyGrid(np.where(cells == UNKNOWN, value, cells), 0.1)
        write_map(grids[name], folder / f"{name}.yaml")
    return folder, grids


@pytest.mark.parametrize("asked", ["blocked", "free"])
def test_a_map_with_unknown_cells_is_the_map_that_they_make(maps, asked, capsys):
    folder, grids = maps
    option = ["--unknown", "free"] if asked == "free" else []

    def planned(name, *more):
        words = ["plan", "--map", str(folder / f"{name}.yaml"), "--planner", "visibility"]
        return json_of([*words, *ENDS_OF, *more], capsys)["path"]

    assert planned("unknown", *option) == planned(asked)

    def world(name, **more):
        scene = {"name": "map_file", "path": str(folder / f"{name}.yaml"), **ENDS, **more}
        return make_scene(scene).sample(np.random.default_rng(0))

    found = world("unknown", **({"unknown_is_solid": False} if option else {}))
    np.testing.assert_array_equal(found.map.cells, grids[asked].cells)
    np.testing.assert_array_equal(found.walls, world(asked).walls)


def test_a_given_map_has_its_unknown_cells_blocked_for_policies(maps):
    """Also where a real chair needs them unknown to find its place."""
    _, grids = maps
    env = gym.make("wheelchair_gym/Navigation-v1").unwrapped
    grid = grids["unknown"]
    ends = (np.array(ENDS[name]) for name in ("start", "goal"))
    env.reset(seed=0, options={"episode": Episode(grid, *ends, grid.walls())})
    np.testing.assert_array_equal(env.mission.map.cells, grids["blocked"].cells)
    assert env.episode.map is grid


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ("", "--goal 2.55,1.05: unknown"), ("--pose mcl --unknown blocked", "2.55,1.05: unknown"),
        ("--unknown free", "expected hardware"), ("--pose slam", "expected hardware"),
    ],
)  # fmt: skip
def test_a_real_chair_refuses_a_goal_on_unknown_ground(maps, options, says, capsys):
    folder, grids = maps
    assert grids["unknown"].cells[10, 25] == UNKNOWN
    words = f"deploy --config configs/hardware.json --map {folder}/unknown.yaml --start 1,1,0"
    words += f" --goal 2.55,1.05 --chair ros://nobody:1 --dry-run {options}"
    assert says in refusal(words.split(), capsys)

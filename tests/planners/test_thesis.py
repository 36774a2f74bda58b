"""The thesis's settings file makes the thesis's planners; each error in it is named."""

import json
from dataclasses import replace

import pytest

from planners import PLANNERS, make_planner
from planners.rrt_star_woa import thesis
from planners.rrt_star_woa.woa import WhaleSettings
from tests.conftest import put
from wheelchair_gym.base.settings import InputError

FIGURE = json.dumps(dict(thesis.FIGURE_3_1.values), indent=2)[:-2] + ",\n}\n"


@pytest.fixture
def figure(tmp_path):
    return put(tmp_path / "figure.json", FIGURE)


@pytest.mark.parametrize("name", thesis.PLANNERS_OF_FILE)
def test_the_figure_makes_the_thesis_planners(figure, name):
    """Its samples are never the goal, and its leader is the latest."""
    tree = PLANNERS["rrt_star"](
        step=1.0, search_radius=1.5, goal_bias=0.0, goal_reach=1.0, return_on_first_path=True
    )
    whales = WhaleSettings(a=4.0, leader="latest")
    weight = {"collision_free_weight": 1.0} if name == thesis.GLOBAL else {}
    swarm = {"tree": tree, "whales": whales, **weight}
    expected = tree if name == "rrt_star" else PLANNERS[name](**swarm)
    for file in (thesis.read_thesis(figure), thesis.FIGURE_3_1):
        assert make_planner(file.planner(name)) == expected


def test_the_figure_names_every_key_its_map_and_no_planner_of_others(figure):
    file = thesis.read_thesis(figure)
    assert file.values == thesis.FIGURE_3_1.values
    keys = "Obstacles_Dilation", "Epsilon", "Map_Name"
    assert [file.value(f"MapProcessor_{key}") for key in keys] == [0, 0.02, "5"]
    assert file.without_effect("rrt_star_woa_global") == (
        f"{figure}: without effect: TestMode: the thesis does not say what it does"
    )
    assert "PathOptimizer_Shortness_Weight, PathOptimizer_Collision_Free_Weight: not of the" in (
        file.without_effect("rrt_star_woa_local")
    )
    assert "ReturnOnFirstPath, PathPlanner_Iterations" in file.without_effect("a_star")
    assert "MapProcessor_Map_Name: --problems has" in file.without_effect("rrt_star", True)
    with pytest.raises(InputError, match="'a_star' is none of the thesis's"):
        file.planner("a_star")


def test_keys_that_are_missing_keep_our_defaults(tmp_path):
    path = put(tmp_path / "short.json", {"PathPlanner_Step_Size": 2})
    planner = make_planner(thesis.read_thesis(path).planner())
    assert planner.tree.step == 2.0
    assert planner.tree.goal_bias == 0.0
    assert planner.whales == replace(PLANNERS["rrt_star_woa_global"]().whales, leader="latest")
    assert thesis.is_thesis({"TestMode": True})
    assert not thesis.is_thesis({"rrt": {}})


def test_commas_within_text_stay():
    assert thesis.without_trailing_commas('{"a,}": [1, 2, ], "b": ",]",\n}') == (
        '{"a,}": [1, 2 ], "b": ",]"\n}'
    )

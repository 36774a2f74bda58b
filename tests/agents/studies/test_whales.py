"""Whales as they are drawn: those of the plan itself, in the colours of what they cross or see."""

import numpy as np
import pytest
import shapely

from agents.studies.experiments import problem_of
from agents.studies.plan_pictures import paths_of_whales, points_of_whales
from planners import make_planner
from wheelchair_gym.rendering import palette

TREE = {"step": 1.0, "search_radius": 1.5, "goal_reach": 1.0, "return_on_first_path": True}
# By whether a whale sees the node and the goal: the thesis, below figure 2.6.
COLOURS = {
    (False, False): ("sees neither", palette.VERMILION),
    (True, False): ("sees the node", palette.BLUE),
    (False, True): ("sees the goal", palette.ORANGE),
    (True, True): ("sees both", palette.GREEN),
}


def crosses(problem, line):
    """Return True if a line (n, 2) enters solid cells or leaves the map; it may touch both."""
    solid, box = problem.space.solid, shapely.box(*problem.space.bounds)
    way = shapely.LineString(line)
    return shapely.intersection(way, solid.buffer(-1e-9)).length > 1e-7 or not box.covers(way)


@pytest.mark.parametrize("leader", ["best", "latest"])
@pytest.mark.parametrize("number", [1, 4])
@pytest.mark.parametrize("weight", [1.0, 1e4])
def test_the_last_whales_have_the_path_of_the_plan(number, leader, weight):
    problem = problem_of({"name": f"thesis_{number}"})
    swarm = {"population": 12, "iterations": 15, "a": 4.0, "leader": leader}
    planner = make_planner({"name": "rrt_star_woa_global", "tree": TREE, "whales": swarm,
                            "collision_free_weight": weight})  # fmt: skip
    for seed in range(3):
        plan, rng = planner.plan(problem, np.random.default_rng(seed)), np.random.default_rng(seed)
        raw = planner.tree.plan(problem, rng)
        swarms = [*paths_of_whales(planner, problem, raw.path, rng)]
        assert len(swarms) == 16
        np.testing.assert_array_equal(swarms[0][0][2], raw.path)  # the first whale is not shifted
        np.testing.assert_array_equal(swarms[-1][-1][2], plan.path)
        for words, _, whale in swarms[7][:-1]:
            assert (words == "blocked path") == crosses(problem, whale)


@pytest.mark.parametrize("seed", range(4))
def test_whales_around_a_sample_have_the_colour_of_what_they_see(seed):
    problem, rng = problem_of({"name": "thesis_4"}), np.random.default_rng(seed)
    planner = make_planner({"name": "rrt_star_woa_local", "width_bound": 2.0, "height_bound": 1.0,
                            "whales": {"population": 20, "iterations": 6}})  # fmt: skip
    node, sample = problem.start[:2], rng.uniform((6.0, 4.0), (12.0, 12.0))
    minimum = np.inf
    for *whales, (_, _, best) in points_of_whales(planner, problem, node, sample, rng):
        costs = []
        for words, colour, ((x, y),) in whales:
            sees = tuple(not crosses(problem, [(x, y), end]) for end in (node, problem.goal[:2]))
            assert (words, colour) == COLOURS[sees]
            assert np.all(np.abs((x, y) - sample) <= (2.0 + 1e-9, 1.0 + 1e-9))
            way = np.hypot(*((x, y) - sample)) + np.hypot(*((x, y) - problem.goal[:2]))
            costs.append(way + 1000.0 * (not sees[0]) + 10.0 * (not sees[1]))
        if min(costs) < minimum:
            minimum, leader = min(costs), whales[int(np.argmin(costs))][2]
        np.testing.assert_allclose(best, leader)  # the best of all populations so far

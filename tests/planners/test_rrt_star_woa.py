"""The thesis's planners: local steering needs fewer nodes, and shortened paths are free."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from agents.studies.read_studies import STUDIES
from planners import Problem, Space, make_planner
from planners.rrt_star_woa.path_shortening import RrtStarWoaGlobal
from planners.rrt_star_woa.thesis import FIGURE_3_1, GLOBAL
from tests.planners.test_trees import assert_free, walled

LATEST, LOCAL, TREE = (
    make_planner(FIGURE_3_1.planner(name)) for name in (GLOBAL, "rrt_star_woa_local", "rrt_star")
)
BEST = replace(LATEST, whales=replace(LATEST.whales, leader="best"))
PROBLEM = walled()


@pytest.mark.parametrize("planner", [LATEST, LOCAL, TREE])
def test_studies_compare_the_planners_of_the_figure(planner):
    rows = {row.label: row for row in STUDIES["t1-3.1"].rows}
    row = {LATEST: "global", LOCAL: "local", TREE: "rrt_star"}[planner]
    assert all(make_planner(job["planner"]) == planner for job in rows[row].jobs.values())


def test_the_latest_leader_may_be_longer_than_the_tree_path():
    """The thesis overwrites the leader: the result is the best of the last population, free."""
    gains = []
    for seed in range(12):
        plan, kept, tree = (
            planner.plan(PROBLEM, np.random.default_rng(seed)) for planner in (LATEST, BEST, TREE)
        )
        assert_free(PROBLEM, plan.path)
        assert len(plan.path) == len(tree.path)
        assert kept.length <= tree.length
        gains.append(1 - plan.length / tree.length)
    assert min(gains) < 0 < max(gains)


@pytest.mark.parametrize("settings", [RrtStarWoaGlobal(), BEST])
def test_global_variant_never_lengthens_its_tree_path(settings):
    gains = []
    for seed in range(8):
        plan = settings.plan(PROBLEM, np.random.default_rng(seed))
        tree = settings.tree.plan(PROBLEM, np.random.default_rng(seed))
        assert_free(PROBLEM, plan.path)
        gains.append(1 - plan.length / tree.length)
    assert min(gains) >= 0
    if settings.whales.iterations > 10:
        assert np.mean(gains) > 0.005


def test_local_variant_needs_fewer_nodes_for_a_shorter_path():
    """On an open map whales lead to the goal, and a tree that follows samples fills the map.

    With equal weights the sum of both distances is the same along the line to the goal.
    """
    space = Space.from_rectangles(np.empty((0, 4)), (0.0, 0.0, 30.0, 30.0))
    problem = Problem(space, np.array([2.0, 2.0]), np.array([28.0, 28.0]))
    found = []
    for seed in range(8):
        local, tree = (
            planner.plan(problem, np.random.default_rng(seed))
            for planner in (replace(LOCAL, whales=BEST.whales, goal_weight=2.0), TREE)
        )
        assert_free(problem, local.path)
        nodes = local.counters["nodes"], tree.counters["nodes"]
        found.append((*nodes, local.length, tree.length))
    local_nodes, tree_nodes, local_length, tree_length = np.mean(found, axis=0)
    assert local_nodes < 0.9 * tree_nodes
    assert local_length < tree_length

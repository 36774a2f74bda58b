"""Whales: their equations one by one, their loop, and the thesis's planners made of them."""

from dataclasses import replace

import numpy as np
import pytest

from agents.studies.runner import STUDIES
from planners import make_planner
from planners.rrt_star_woa.path_shortening import RrtStarWoaGlobal
from planners.rrt_star_woa.thesis import FIGURE_3_1, GLOBAL
from planners.rrt_star_woa.woa import WhaleParameters, move, new_whales, tell
from tests.planners.test_planners import on
from tests.planners.test_trees import RECTANGLES, assert_free
from wheelchair_gym.compiled.random import next_uniform, stream

# Written for compiled integers, which wrap without a word.
pytestmark = pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")
D = 4
WIDE = np.full(D, 1e9)
LEADER = np.arange(1.0, D + 1)
LATEST, LOCAL, TREE = (
    make_planner(FIGURE_3_1.planner(name)) for name in (GLOBAL, "rrt_star_woa_local", "rrt_star")
)
BEST = replace(LATEST, whales=replace(LATEST.whales, leader="best"))
PROBLEM = on(RECTANGLES)


def moved(population, best, a, mu, lam, seed=0):
    """A population moved once, and the numbers that were drawn for the first whale."""
    rng, again = np.random.default_rng(seed), np.random.default_rng(seed)
    after = population.copy()
    whales = new_whales(after, WhaleParameters(1, 1, a, 1.0, mu, lam), -WIDE, WIDE)
    whales.leader[:] = best
    move(whales, 0.0, stream(rng))
    state = stream(again)
    return after, [next_uniform(state) for _ in range(2 + D + 1)]


@pytest.fixture
def population():
    return np.random.default_rng(5).normal(size=(6, D))


def test_without_spirals_and_search_whales_encircle_the_best(population):
    after, draws = moved(population, LEADER, a=2.0, mu=1.0, lam=np.inf)
    A = 2 * 2.0 * draws[0] - 2.0
    C = 2 * np.array(draws[2 : 2 + D])
    np.testing.assert_allclose(after[0], LEADER - A * abs(C * LEADER - population[0]))


def test_at_lambda_0_whales_search_and_the_best_means_nothing(population):
    after, draws = moved(population, LEADER, a=2.0, mu=1.0, lam=0.0)
    other, _ = moved(population, np.full(D, -7.0), a=2.0, mu=1.0, lam=0.0)
    np.testing.assert_array_equal(after, other)
    A = 2 * 2.0 * draws[0] - 2.0
    C = 2 * np.array(draws[3 : 3 + D])
    towards = population[int(draws[2] * len(population))]
    np.testing.assert_allclose(after[0], towards - A * abs(C * towards - population[0]))


def test_at_mu_0_whales_follow_the_spiral(population):
    after, draws = moved(population, LEADER, a=2.0, mu=0.0, lam=1.0)
    phase = 2 * draws[2] - 1
    swirl = np.exp(phase) * np.cos(2 * np.pi * phase)
    np.testing.assert_allclose(after[0], abs(LEADER - population[0]) * swirl + LEADER)


def test_whales_gather_at_the_best_once_a_is_zero(population):
    after, _ = moved(population, LEADER, a=0.0, mu=1.0, lam=1.0)
    np.testing.assert_array_equal(after, np.tile(LEADER, (len(population), 1)))


@pytest.mark.parametrize("latest", [False, True])
def test_the_leader_is_the_best_whale_of_all_or_of_the_latest_population(population, latest):
    """The loop by ask and tell; costs are recorded beside it."""
    state, costs, tried = stream(np.random.default_rng(2)), [], []
    parameters = WhaleParameters(len(population), 7, 4.0, 1.0, 0.5, 1.0, latest)
    whales = new_whales(population, parameters, -WIDE, WIDE)
    for t in range(parameters.iterations + 1):
        costs.append(((population - 1.0) ** 2).sum(axis=1))
        tried.append(population.copy())
        for i, cost in enumerate(costs[-1]):
            tell(whales, i, cost)
        known = np.concatenate(costs[-1:] if latest else costs)
        assert whales.leader_cost[0] == known.min()
        told = np.concatenate(tried[-1:] if latest else tried)
        np.testing.assert_array_equal(whales.leader, told[known.argmin()])
        if t < parameters.iterations:
            move(whales, t / parameters.iterations, state)
    assert (np.diff(np.min(costs, axis=1)) > 0).any()  # or both would be the same


def test_streams_are_uniform_and_repeat():
    state, again = (stream(np.random.default_rng(1)) for _ in range(2))
    draws = np.array([next_uniform(state) for _ in range(4000)])
    assert draws[0] == next_uniform(again)
    counts = np.histogram(draws, bins=10, range=(0, 1))[0]
    assert ((counts - 400) ** 2 / 400).sum() < 30  # chi square, 9 degrees: p = 0.0004
    assert abs(np.corrcoef(draws[:-1], draws[1:])[0, 1]) < 0.06


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
    problem = on([], (2.0, 2.0), (28.0, 28.0), size=30.0)
    both, found = (replace(LOCAL, whales=BEST.whales, goal_weight=2.0), TREE), []
    for seed in range(8):
        local, tree = (planner.plan(problem, np.random.default_rng(seed)) for planner in both)
        assert_free(problem, local.path)
        nodes = local.counters["nodes"], tree.counters["nodes"]
        found.append((*nodes, local.length, tree.length))
    local_nodes, tree_nodes, local_length, tree_length = np.mean(found, axis=0)
    assert local_nodes < 0.9 * tree_nodes
    assert local_length < tree_length

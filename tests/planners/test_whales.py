"""Whales: their equations one by one, and minima of simple functions."""

from __future__ import annotations

import numpy as np
import pytest

from planners.rrt_star_woa.woa import WhaleParameters, move, move_whales, new_whales, tell
from wheelchair_gym.random import next_uniform, stream

# Written for compiled integers, which wrap without a word.
pytestmark = pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")
D = 4
WIDE = np.full(D, 1e9)
TWICE = np.full(D, 2.0)


def moved(population, best, a, mu, lam, seed=0):
    """A population moved once, and the numbers that were drawn for the first whale."""
    rng, again = np.random.default_rng(seed), np.random.default_rng(seed)
    after = population.copy()
    moves = WhaleParameters(1, 1, a, 1.0, mu, lam)
    move_whales(after, best, moves, 0.0, TWICE, -WIDE, WIDE, stream(rng))
    state = stream(again)
    return after, [next_uniform(state) for _ in range(2 + D + 1)]


@pytest.fixture
def population():
    return np.random.default_rng(5).normal(size=(6, D))


def test_without_spirals_and_search_whales_encircle_the_best(population):
    best = np.arange(1.0, D + 1)
    after, draws = moved(population, best, a=2.0, mu=1.0, lam=np.inf)
    A = 2 * 2.0 * draws[0] - 2.0
    C = 2 * np.array(draws[2 : 2 + D])
    np.testing.assert_allclose(after[0], best - A * abs(C * best - population[0]))


def test_at_lambda_0_whales_search_and_the_best_means_nothing(population):
    after, draws = moved(population, np.arange(1.0, D + 1), a=2.0, mu=1.0, lam=0.0)
    other, _ = moved(population, np.full(D, -7.0), a=2.0, mu=1.0, lam=0.0)
    np.testing.assert_array_equal(after, other)
    A = 2 * 2.0 * draws[0] - 2.0
    C = 2 * np.array(draws[3 : 3 + D])
    towards = population[int(draws[2] * len(population))]
    np.testing.assert_allclose(after[0], towards - A * abs(C * towards - population[0]))


def test_at_mu_0_whales_follow_the_spiral(population):
    best = np.arange(1.0, D + 1)
    after, draws = moved(population, best, a=2.0, mu=0.0, lam=1.0)
    phase = 2 * draws[2] - 1
    swirl = np.exp(phase) * np.cos(2 * np.pi * phase)
    np.testing.assert_allclose(after[0], abs(best - population[0]) * swirl + best)


def test_whales_gather_at_the_best_once_a_is_zero(population):
    best = np.arange(1.0, D + 1)
    after, _ = moved(population, best, a=0.0, mu=1.0, lam=1.0)
    np.testing.assert_array_equal(after, np.tile(best, (len(population), 1)))


def test_positions_stay_within_bounds(population):
    low, high = np.full(D, -0.1), np.full(D, 0.2)
    for seed in range(20):
        state = stream(np.random.default_rng(seed))
        moves = WhaleParameters(1, 1, 4.0, 1.0, 0.5, 1.0)
        move_whales(population, population[0].copy(), moves, 0.0, TWICE, low, high, state)
        assert (population >= low).all()
        assert (population <= high).all()


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

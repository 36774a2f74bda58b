"""Laws of every optimiser, of curves, of what paths are worth, and of planners made of swarms."""

import itertools
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PchipInterpolator

from planners import OPTIMIZERS, Status, make_planner
from planners.judge import Judge
from planners.registries import OBJECTIVES
from planners.smoothing.curves import CURVES, curve
from planners.swarm import optimizers
from planners.swarm.path_cost import evaluate, new_workspace, push_out_of_discs
from planners.swarm.planner import RrtWoa, SwarmPlanner
from planners.swarm.search import new_search, run, sample_along
from tests.planners.swarm_worlds import among_blocks, among_discs, nearest
from tests.planners.test_planners import assert_valid, on
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.compiled.kernel import kernel
from wheelchair_gym.compiled.random import stream
from wheelchair_gym.geometry.planar import path_length
from wheelchair_gym.scenes.published import CHAOTIC_PSO_DISCS

D = 4
CENTRE = np.array([1.0, -2.0, 0.5, 3.0])


def bowl(positions):
    return ((positions - CENTRE) ** 2).sum(axis=1)


@kernel
def store_and_move(swarm, moves, progress, state):
    for i in range(swarm.positions.shape[0]):
        j = optimizers.competitor(swarm, i)
        if swarm.costs[i] < swarm.personal_best_costs[j]:
            optimizers.store(swarm, i, j)
        else:
            swarm.trials[j] += 1
    optimizers.move_swarm(swarm, moves, progress, state)


@pytest.mark.parametrize("name", OPTIMIZERS)
def test_optimisers_find_the_minimum_of_a_bowl_within_bounds(name):
    moves, rng = OPTIMIZERS.make(name).parameters, np.random.default_rng(3)
    swarm = optimizers.new_swarm(rng.uniform(-5, 5, (30, D)), -5.0, 5.0)
    begun, minimum, state = bowl(swarm.positions).min(), np.inf, stream(rng)
    for t in range(200):
        swarm.costs[:] = bowl(swarm.positions)
        minimum = min(minimum, swarm.costs.min())
        store_and_move(swarm, moves, t / 200, state)
        assert bowl(swarm.best[None])[0] == minimum
        assert (abs(swarm.positions) <= 5.0).all()
        assert swarm.best_cost == minimum
    assert minimum < 0.02 * begun


@pytest.mark.parametrize("name", sorted(set(OPTIMIZERS) - {"woa_modified"}))
def test_the_compiled_loop_is_ask_and_tell(name):
    """Costs cut short change nothing; modified whales look at the map, which ask and tell lacks."""
    planner = SwarmPlanner(population=12, way_points=3, first="line", optimizer=name)
    start = planner.start(among_blocks(), None, np.random.default_rng(2))
    worth, moves = OBJECTIVES.make("length_free").path_cost, OPTIMIZERS.make(name).parameters
    search, asked = new_search(start, worth, moves), optimizers.new_swarm(*start[1:])
    run(search, 15, 20, stream(np.random.default_rng(4)))
    state, room = stream(np.random.default_rng(4)), new_workspace(start.path_problem)
    for t in range(16):
        for i, position in enumerate(asked.positions):
            asked.costs[i] = evaluate(start.path_problem, worth, position, np.inf, np.inf, room)[0]
        store_and_move(asked, moves, t / 20, state)
    np.testing.assert_array_equal(search.swarm.best, asked.best)
    assert search.swarm.best_cost == asked.best_cost


def test_inertia_follows_its_equations():
    swarm = optimizers.new_swarm(np.zeros((4, D)), -1.0, 1.0)
    flight = OPTIMIZERS.make("pso_chaotic").parameters
    inertia, beta = partial(optimizers.next_inertia, swarm), 0.3
    for k in range(5):
        beta = 4.0 * beta * (1.0 - beta)
        assert inertia(flight, k / 10) == pytest.approx((0.9 - 0.6 * k / 10) * beta)
        swarm.record["move_count"] += 1
    assert inertia(OPTIMIZERS.make("pso").parameters, 0.0) == pytest.approx(0.98**5)
    flight = OPTIMIZERS.make("pso_variable").parameters
    for p in (0.0, 0.5, 1.0):
        assert inertia(flight, p) == pytest.approx(0.9 * (0.4 / 0.9) ** p)
    flight = OPTIMIZERS.make("pso_adaptive").parameters
    swarm.record["previous_best_cost"], swarm.best_cost[:] = 8.0, 6.0
    assert inertia(flight, 0.2) == pytest.approx(1.3 * 0.75 - 0.9 * 0.2)
    assert inertia(flight, 0.2) == pytest.approx(1.3 - 0.9 * 0.2)


def test_wolves_gather_between_their_leaders_once_a_is_zero():
    swarm = optimizers.new_swarm(np.random.default_rng(0).normal(size=(9, D)), -9.0, 9.0)
    swarm.personal_best_costs[:] = np.random.default_rng(1).permutation(9)
    optimizers.move_wolves(swarm, 0.0, False, stream(np.random.default_rng(0)))
    middle = swarm.personal_best[np.argsort(swarm.personal_best_costs)[:3]].mean(axis=0)
    np.testing.assert_allclose(swarm.positions, np.tile(middle, (9, 1)))


def test_listed_wolves_follow_the_three_best_current_ones_which_stay():
    swarm = optimizers.new_swarm(np.random.default_rng(0).normal(size=(9, D)), -9.0, 9.0)
    swarm.costs[:] = np.random.default_rng(1).permutation(9)
    swarm.personal_best[:] = 5.0  # what they remember does not count
    before, order = swarm.positions.copy(), np.argsort(swarm.costs)
    optimizers.move_wolves(swarm, 0.0, True, stream(np.random.default_rng(0)))
    np.testing.assert_array_equal(swarm.positions[order[:3]], before[order[:3]])
    middle = before[order[:3]].mean(axis=0)
    np.testing.assert_allclose(swarm.positions[order[3:]], np.tile(middle, (6, 1)))


@pytest.mark.parametrize("objective", OBJECTIVES)
@pytest.mark.parametrize("curve", CURVES)
def test_every_objective_and_curve_gives_valid_paths(objective, curve):
    planner = SwarmPlanner(objective=objective, curve=curve, iterations=30)
    for problem, seed in itertools.product((among_blocks(), among_discs()), range(2)):
        plan = planner.plan(problem, np.random.default_rng(seed))
        assert_valid(plan, problem)
        np.testing.assert_array_equal(plan.path[[0, -1]], [problem.start, problem.goal])


@pytest.mark.parametrize("name", [*OPTIMIZERS])
def test_hybrids_never_lengthen_their_first_path(name):
    for seed in range(3):
        planner = SwarmPlanner(optimizer=name, iterations=20)
        plan = planner.plan(among_blocks(), np.random.default_rng(seed))
        first = make_planner("rrt_connect").plan(among_blocks(), np.random.default_rng(seed))
        assert plan.length <= first.length + 1e-9


def test_without_a_first_path_a_swarm_may_fail_and_says_so():
    planner = SwarmPlanner(first=None, scatter="uniform", way_points=3)
    plan = planner.plan(on([(4.0, 0.0, 5.0, 10.0)]), np.random.default_rng(0))
    assert plan.status == Status.EXHAUSTED
    assert len(plan.path) == 0
    assert_valid(planner.plan(among_blocks(), np.random.default_rng(0)), among_blocks())


@pytest.mark.parametrize("curve", ["polyline", "pchip", "spline"])
def test_chaotic_particles_keep_the_papers_clearance(curve):
    planner = SwarmPlanner(
        optimizer="pso_chaotic",
        objective="violation",
        curve=curve,
        chordal=False,
        pieces=100,
        way_points=3,
        population=20,
        first="line",
    )
    for seed in range(3):
        plan = planner.plan(among_discs(), np.random.default_rng(seed))
        assert nearest(plan.path) >= 1.2 - 1e-9
        assert 11.4039 - 1e-4 <= plan.length <= 1.01 * 11.412


def test_the_first_population_is_that_of_the_paper():
    planner = RrtWoa().swarm
    path = np.array([(1.0, 1.0), (1.0, 6.0), (4.0, 8.5), (9.0, 9.0)])
    start = planner.start(among_blocks(), path, np.random.default_rng(0))
    n = len(start.path_problem.anchors)
    assert (start.path_problem.anchors == 0).all()
    first = start.population[0].reshape(n, 2)
    assert {tuple(p) for p in path[1:-1]} <= {tuple(p) for p in first}
    way = path_length(path)
    for position in start.population[1:]:
        points = np.vstack([path[0], position.reshape(n, 2), path[-1]])
        assert path_length(points) <= way + 1e-9  # on the path, in order
    drawn = sample_along(path, 5, 100, np.random.default_rng(1))
    assert len(np.unique(drawn, axis=0)) == 5
    same = planner.start(among_blocks(), path, np.random.default_rng(0))
    np.testing.assert_array_equal(start.population, same.population)


def test_modified_whales_smooth_the_tree_path():
    gains = []
    for seed in range(5):
        plan = RrtWoa().plan(among_blocks(), np.random.default_rng(seed))
        assert not Judge.of(among_blocks()).faults(plan.path)
        tree = RrtWoa().tree.plan(among_blocks(), np.random.default_rng(seed))
        gains.append(1 - plan.length / tree.length)
    assert np.mean(gains) > 0.0


def test_an_optimizer_may_be_settings():
    planner = SwarmPlanner(optimizer=OPTIMIZERS.make({"name": "pso", "neighbours": 2}))
    assert planner.optimizer["neighbours"] == 2


def test_any_optimiser_of_mealpy_takes_part():
    problem = among_blocks()
    planner = SwarmPlanner(optimizer="mealpy", iterations=5, population=10, way_points=3)
    try:
        import mealpy  # noqa: F401
    except ImportError:
        with pytest.raises(InputError, match=r"mealpy needs: pip install .*peers"):
            planner.plan(problem, np.random.default_rng(0))
        return
    for name in ("OriginalWOA", "OriginalGWO"):
        planner = replace(planner, optimizer={"name": "mealpy", "algorithm": name})
        assert_valid(planner.plan(problem, np.random.default_rng(0)), problem)
    planner = replace(planner, optimizer={"name": "mealpy", "algorithm": "Ghosts"})
    with pytest.raises(InputError, match="mealpy: Ghosts"):
        planner.plan(problem, np.random.default_rng(0))


# ---- costs of paths: each objective beside its formula


def terms(objective, position, problem, **settings):
    """Cost of an objective, the plain one, and the line, of way points (n, 2)."""
    way_points = np.asarray(position, dtype=float)
    planner = SwarmPlanner(
        objective=objective, way_points=len(way_points), scatter="uniform", first=None, **settings
    )
    start = planner.start(problem, None, np.random.default_rng(0))
    room = new_workspace(start.path_problem)
    worth = OBJECTIVES.make(objective).path_cost
    cost, plain = evaluate(start.path_problem, worth, way_points.ravel(), np.inf, np.inf, room)
    return cost, plain, room.line


def test_costs_are_their_formulas():
    problem = among_blocks()
    free, hit = [(1.0, 6.5), (4.0, 7.2)], [(4.0, 4.0), (6.0, 5.5)]
    path = np.vstack([(1, 1), free, (9, 9)])
    length = path_length(path)
    legs = np.diff(path, axis=0)
    assert terms("length_free", free, problem)[0] == pytest.approx(10 * length)
    through = path_length(np.vstack([(1, 1), hit, (9, 9)]))
    cost, plain, _ = terms({"name": "length_free", "collision_free_weight": 7.0}, hit, problem)
    assert cost == pytest.approx(10 * through + 7.0 * 3)
    assert plain == np.inf
    headings = np.arctan2(legs[:, 1], legs[:, 0])
    turning = abs(np.diff(headings)).mean()
    assert terms("smooth", free, problem)[:2] == pytest.approx((turning + length,) * 2)
    faithful = {"name": "smooth", "faithful": True}
    A, B = (np.hypot(*v.T) for v in (legs[:-1], path[2:] - path[:-2]))
    printed = ((A**2 + B**2) / (2 * A * B)).sum() / 3
    assert terms(faithful, free, problem)[0] == pytest.approx(printed + length)
    assert terms(faithful, [(1.0, 6.0), (4.0, 4.0)], problem)[0] > 100
    root = np.sqrt((legs**2).sum())
    assert terms("way_points", free, problem)[0] == pytest.approx(root * np.sqrt(3))
    faithful = {"name": "way_points", "faithful": True}
    assert terms(faithful, hit, problem)[0] == pytest.approx(
        np.sqrt((np.diff(np.vstack([(1, 1), hit, (9, 9)]), axis=0) ** 2).sum())
    )


def test_violation_is_the_mean_over_the_curve():
    problem, spec = among_discs(), {"name": "violation", "faithful": True}
    for seed in range(10):
        way_points = np.random.default_rng(seed).uniform(0, 10, (3, 2))
        cost, _, line = terms(spec, way_points, problem, curve="spline", pieces=50)
        deep = sum(
            np.maximum(1.2 - np.hypot(*(line - (x, y)).T) / r, 0).mean()
            for x, y, r in CHAOTIC_PSO_DISCS
        )
        assert cost == pytest.approx(path_length(line) * (1 + 100 * deep))
        exact, valid, line = terms("violation", way_points, problem, curve="spline", pieces=50)
        fine = nearest(line) >= 1.2 and not Judge.of(problem).faults(line)
        assert (valid < np.inf) == fine
        assert (exact == pytest.approx(valid)) == fine


def test_way_points_leave_discs_as_printed():
    problem = among_discs()
    start = SwarmPlanner(way_points=2, first="line", scatter="uniform").start(
        problem, None, np.random.default_rng(0)
    )
    worth = OBJECTIVES.make({"name": "way_points", "faithful": True}).path_cost
    position, held = np.array([9.3, 4.4, 5.0, 5.0]), np.zeros(4, np.bool_)
    assert push_out_of_discs(start.path_problem, worth._replace(slack=0.0), position, held) == 1
    np.testing.assert_allclose(position, [9.6, 4.8, 5.0, 5.0])
    np.testing.assert_array_equal(held, [False, False, True, True])


# ---- curves through points, beside those of scipy


ORACLES = {"pchip": PchipInterpolator, "spline": CubicSpline}


@pytest.mark.parametrize("name", ORACLES)
@pytest.mark.parametrize("chordal", [False, True])
@pytest.mark.parametrize("n", [2, 3, 4, 5, 15])
def test_curves_are_those_of_scipy(name, chordal, n):
    for seed in range(20):
        points = np.random.default_rng(seed).uniform(0, 10, (n, 2)).round(seed % 3)
        points[1:] += np.arange(1, n)[:, None] * 1e-3  # apart
        gaps = np.hypot(*np.diff(points, axis=0).T) if chordal else np.ones(n - 1)
        knots = np.concatenate([[0.0], np.cumsum(gaps)])
        at = np.concatenate([knots[:-1, None] + gaps[:, None] * np.arange(7) / 7]).ravel()
        expected = ORACLES[name](knots, points)(np.append(at, knots[-1]))
        np.testing.assert_allclose(curve(points, name, 7, chordal), expected, atol=1e-9)


@pytest.mark.parametrize("name", CURVES)
def test_curves_pass_through_their_points_even_where_these_coincide(name):
    points = np.array([(0.0, 0.0), (1.0, 2.0), (1.0, 2.0), (4.0, 2.0), (5.0, 0.0)])
    for chordal in (False, True):
        line = curve(points, name, 10, chordal)
        assert np.isfinite(line).all()
        np.testing.assert_array_equal(line[::10], points)

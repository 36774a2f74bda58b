"""Laws of every optimiser, of what paths are worth, and of planners made of swarms."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from planners import OPTIMIZERS, Problem, Space, Status, make_planner
from planners.judge import Judge
from planners.registries import OBJECTIVES
from planners.smoothing.curves import CURVES
from planners.swarm import optimizers
from planners.swarm.path_cost import evaluate, new_workspace
from planners.swarm.planner import RrtWoa, SwarmPlanner
from planners.swarm.search import new_search, run, sample_along
from tests.planners.swarm_worlds import among_blocks, among_discs, nearest
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.compiled.kernel import kernel
from wheelchair_gym.compiled.random import stream
from wheelchair_gym.geometry.planar import path_length

D = 4
CENTRE = np.array([1.0, -2.0, 0.5, 3.0])


def bowl(positions):
    return ((positions - CENTRE) ** 2).sum(axis=1)


@kernel
def store_and_move(swarm, moves, progress, state):
    """Store the positions that are better than remembered ones, and move the swarm."""
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
    beta = 0.3
    for k in range(5):
        beta = 4.0 * beta * (1.0 - beta)
        assert optimizers.next_inertia(swarm, flight, k / 10) == pytest.approx(
            (0.9 - 0.6 * k / 10) * beta
        )
        swarm.record["move_count"] += 1
    assert optimizers.next_inertia(swarm, OPTIMIZERS.make("pso").parameters, 0.0) == pytest.approx(
        0.98**5
    )
    flight = OPTIMIZERS.make("pso_variable").parameters
    for p in (0.0, 0.5, 1.0):
        assert optimizers.next_inertia(swarm, flight, p) == pytest.approx(0.9 * (0.4 / 0.9) ** p)
    flight = OPTIMIZERS.make("pso_adaptive").parameters
    swarm.record["previous_best_cost"], swarm.best_cost[:] = 8.0, 6.0
    assert optimizers.next_inertia(swarm, flight, 0.2) == pytest.approx(1.3 * 0.75 - 0.9 * 0.2)
    assert optimizers.next_inertia(swarm, flight, 0.2) == pytest.approx(1.3 - 0.9 * 0.2)


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
        assert plan.status == Status.SOLVED
        assert not Judge.of(problem).faults(plan.path)
        np.testing.assert_array_equal(plan.path[[0, -1]], [problem.start, problem.goal])


@pytest.mark.parametrize("name", [*OPTIMIZERS])
def test_hybrids_never_lengthen_their_first_path(name):
    for seed in range(3):
        planner = SwarmPlanner(optimizer=name, iterations=20)
        plan = planner.plan(among_blocks(), np.random.default_rng(seed))
        first = make_planner("rrt_connect").plan(among_blocks(), np.random.default_rng(seed))
        assert plan.length <= first.length + 1e-9


def test_without_a_first_path_a_swarm_may_fail_and_says_so():
    shut = Space.from_rectangles([(4.0, 0.0, 5.0, 10.0)], (0.0, 0.0, 10.0, 10.0))
    problem = Problem(shut, np.array([1.0, 1.0]), np.array([9.0, 9.0]))
    planner = SwarmPlanner(first=None, scatter="uniform", way_points=3)
    plan = planner.plan(problem, np.random.default_rng(0))
    assert plan.status == Status.EXHAUSTED
    assert len(plan.path) == 0
    plan = planner.plan(among_blocks(), np.random.default_rng(0))
    assert plan.status == Status.SOLVED
    assert not Judge.of(among_blocks()).faults(plan.path)


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
        plan = planner.plan(problem, np.random.default_rng(0))
        assert plan.status == Status.SOLVED
        assert not Judge.of(problem).faults(plan.path)
    with pytest.raises(InputError, match="mealpy: Ghosts"):
        replace(planner, optimizer={"name": "mealpy", "algorithm": "Ghosts"}).plan(
            problem, np.random.default_rng(0)
        )

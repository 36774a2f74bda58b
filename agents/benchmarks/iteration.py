"""The time of an iteration of our swarm and of other packages' with one objective."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from time import process_time
from typing import Any

import numpy as np

from agents.benchmarks.cases import Case
from agents.peers import PEERS
from agents.peers.swarms import FIRST, WEIGHTS, Cost, PathSwarm, scatter, subdivide
from planners import make_planner
from planners.swarm.search import shorten_path
from planners.swarm.woa import WhaleSettings
from wheelchair_gym.random import stream

POPULATION, WAY_POINTS = 10, 20
ITERATIONS, REPEATS = 100, 5

Row = dict[str, Any]


def _microseconds(run: Callable[[int], object]) -> float:
    """CPU time of one iteration: a long run less a run of a single iteration."""
    run(2)
    times = []
    for _ in range(REPEATS):
        spent = []
        for count in (1, ITERATIONS + 1):
            begun = process_time()
            run(count)
            spent.append(process_time() - begun)
        times.append(1e6 * (spent[1] - spent[0]) / ITERATIONS)
    return statistics.median(times)


def iteration_rows(cases: Sequence[Case], peers: Sequence[str]) -> list[Row]:
    """Microseconds of an iteration of ours and of each peer, on the first path with a corner.

    Population 10, 20 way points, objective `length_free` (thesis, section 2.8), median of five.
    Ours skips tests of edges that cannot change the result; the others call the same compiled cost.
    """
    for case in cases:
        problem = case.problem
        first = make_planner(FIRST).plan(problem, np.random.default_rng(0))
        if len(first.path) > 2:
            break
    else:
        return []
    path = subdivide(first.path, WAY_POINTS)
    arrays = problem.free.arrays
    start = scatter(path, POPULATION, np.random.default_rng(0))

    def ours(count: int) -> object:
        return shorten_path(
            arrays,
            path,
            WhaleSettings(population=POPULATION, iterations=count).parameters,
            WEIGHTS.shortness_weight,
            WEIGHTS.collision_free_weight,
            WEIGHTS.width_bound,
            WEIGHTS.height_bound,
            stream(np.random.default_rng(0)),
        )

    def of(swarm: PathSwarm) -> Callable[[int], object]:
        return lambda count: swarm.search(Cost(problem, path), start, count, 0)

    runs: dict[str, Callable[[int], object]] = {"whales (ours)": ours}
    for name in peers:
        if isinstance(PEERS[name].settings, PathSwarm):
            runs[name] = of(PEERS[name].settings)
    facts = {"problem": case.name, "population": POPULATION, "way_points": len(path) - 2}
    return [{"swarm": name, "us": _microseconds(run), **facts} for name, run in runs.items()]

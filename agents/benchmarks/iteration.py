"""The time of an iteration of our swarm and of other packages' with one objective."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from dataclasses import replace
from time import process_time
from typing import Any

import numpy as np

from agents.benchmarks.cases import Case
from agents.peers import PEERS
from planners import make_planner
from planners.swarm.planner import SwarmPlanner

OURS = SwarmPlanner(optimizer="woa", population=10, way_points=20)
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
        first = make_planner(OURS.first).plan(problem, np.random.default_rng(0))
        if len(first.path) > 2:
            break
    else:
        return []
    start = OURS.start(problem, first.path, np.random.default_rng(0))

    def run(planner: SwarmPlanner) -> Callable[[int], object]:
        return lambda count: replace(planner, iterations=count, cycle=count).search(
            start, np.random.default_rng(0)
        )

    swarms = {name: PEERS[name].settings for name in peers}
    runs = {"whales (ours)": run(OURS)} | {
        name: run(swarm) for name, swarm in swarms.items() if isinstance(swarm, SwarmPlanner)
    }
    way_points = len(start.path_problem.anchors)
    facts = {"problem": case.name, "population": OURS.population, "way_points": way_points}
    return [{"swarm": name, "us": _microseconds(one), **facts} for name, one in runs.items()]

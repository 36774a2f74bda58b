"""RRT-Connect as a planner."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from planners.draws import stream
from planners.trees.bidirectional import connect
from planners.trees.tree import NONE, branch, edges, new_tree
from planners.types import Plan, Problem, Status, trivial
from wheelchair_gym.config import setting, settings


@settings
class RrtConnect:
    """Two trees that reach for each other (Kuffner and LaValle 2000): quick, not short."""

    iterations: int = setting(default=20_000, source="mazes take some hundreds", low=1)
    nodes: int = setting(default=20_000, source="of each tree", low=2)
    step: float = setting(default=4.0, unit="m", source="rooms and doors of buildings", low=1e-3)

    def plan(self, problem: Problem, rng: np.random.Generator) -> Plan:
        """Answer a problem with the first path found."""
        began = perf_counter()
        answer = trivial(problem)
        if answer is not None:
            return answer
        arrays = problem.free.arrays
        start, goal = (np.array(end[:2], dtype=np.float64) for end in (problem.start, problem.goal))
        ahead, back = new_tree(arrays.bounds, self.nodes), new_tree(arrays.bounds, self.nodes)
        met, met_back, iterations = connect(
            arrays, ahead, back, start, goal, self.iterations, self.step, stream(rng)
        )
        trees = [tree.nodes[: tree.grid["count"][0]] for tree in (ahead, back)]
        path = np.empty((0, 2))
        if met != NONE:
            path = np.vstack([branch(trees[0], met), branch(trees[1], met_back)[-2::-1]])
        return Plan(
            Status.EXHAUSTED if met == NONE else Status.SOLVED,
            path,
            np.vstack([edges(nodes) for nodes in trees]),
            {"nodes": sum(map(len, trees)), "iterations": iterations},
            {"time_s": perf_counter() - began},
        )

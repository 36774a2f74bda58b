"""Plans on a drawn map, with figures and the growth of trees and swarms."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np

from agents.evaluation.metrics import path_figures
from agents.studies.plan_pictures import growth
from planners import Plan, Problem, Space, make_planner
from planners.judge import plan_faults
from planners.problem import checked_plan
from planners.registries import FIRST_PLANNERS, OBJECTIVES, SWARM_OPTIMIZERS
from planners.swarm.peers import Mealpy
from planners.swarm.planner import SwarmPlanner
from planners.swarm.search import new_search, run
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.random import stream
from wheelchair_gym.geometry.planar import path_length
from wheelchair_gym.maps import OccupancyGrid

FRAMES: Final = 24  # of a growth
_MAX_EDGES: Final = 4000  # of a tree that are sent; of larger ones, every second, third ...
_INVALID: Final = "invalid"  # a status that only the independent judge gives


def problem_of(
    grid: OccupancyGrid, start: list[float], goal: list[float], clearance: float
) -> Problem:
    """The problem of a map."""
    return Problem(Space.from_grid(grid), np.array(start), np.array(goal), clearance, "drawn")


def answer(name: str, problem: Problem, seed: int, deadline: float) -> tuple[Plan, dict[str, Any]]:
    """A planner's plan, and what a person is shown of it.

    Args:
        name: of the planner.
        problem: what is asked.
        seed: of its random numbers.
        deadline: [s].
    """
    planner = make_planner(name)
    plan = checked_plan(planner, planner.plan(problem, np.random.default_rng(seed), deadline))
    row: dict[str, Any] = {
        "planner": name, "status": str(plan.status), "note": plan.note, "path": plan.path[:, :2],
        "time_ms": 1e3 * plan.timings.get("time_s", 0.0), "nodes": plan.counters.get("nodes"),
        "length": None, "clearance_min": None, "clearance_mean": None,
        "grows": bool(len(plan.tree)) or _swarm_of(planner) is not None,
    }  # fmt: skip
    if len(plan.path):
        figures = path_figures(plan.path, problem)
        row |= {key: figures[f"{key}_m"] for key in ("length", "clearance_min", "clearance_mean")}
        faults = plan_faults(plan, problem, getattr(planner, "footprint", None))
        if faults:
            row["status"], row["note"] = _INVALID, faults[0]
    return plan, row


def frames_of(name: str, problem: Problem, plan: Plan, seed: int) -> Iterator[dict[str, Any]]:
    """A planner's way to its plan: iterations, edges of the tree, members of the swarm, path.

    Args:
        name: of the planner.
        problem: what was asked.
        plan: its answer.
        seed: of its random numbers.
    """
    planner = make_planner(name)
    swarm = _swarm_of(planner)
    if swarm is not None:
        yield from _swarm_frames(swarm, problem, plan, seed)
        return
    for part in growth(problem, planner, plan, seed, FRAMES):
        step = max(1, -(-len(part.tree) // _MAX_EDGES))
        yield {
            "iterations": part.counters.get("iterations", 0), "tree": _short(part.tree[::step]),
            "swarm": [], "path": _short(part.path[:, :2]), "length": part.length,
        }  # fmt: skip


def _swarm_of(planner: Any) -> SwarmPlanner | None:
    """The planner whose swarm moves whole paths, where its members can be followed."""
    swarm = getattr(planner, "swarm", planner)
    if not isinstance(swarm, SwarmPlanner):
        return None
    return None if isinstance(SWARM_OPTIMIZERS.make(swarm.optimizer), Mealpy) else swarm


def _swarm_frames(
    planner: SwarmPlanner, problem: Problem, plan: Plan, seed: int
) -> Iterator[dict[str, Any]]:
    made = plan.counters.get("iterations", planner.iterations)
    for k in np.unique(np.linspace(0, made, FRAMES).round().astype(int)).tolist():
        rng, path, tree = np.random.default_rng(seed), None, np.empty((0, 4))
        if planner.first not in (None, "line"):
            maker: Any = FIRST_PLANNERS.make(planner.first)
            if "first_iterations" in plan.counters:
                maker = replace(maker, iterations=plan.counters["first_iterations"])
            first = maker.plan(problem, rng)
            if not len(first.path):
                return
            path, tree = first.path[:, :2], first.tree
        begun = planner.start(problem, path, rng)
        moves: Any = SWARM_OPTIMIZERS.make(planner.optimizer)
        cost: Any = OBJECTIVES.make(planner.objective)
        search = new_search(begun, cost.path_cost, moves.parameters)
        found = run(search, k, planner.cycle, stream(rng))
        positions = search.swarm.positions
        places = begun.path_problem.anchors + positions.reshape(len(positions), -1, 2)
        ends = np.array(problem.start[:2]), np.array(problem.goal[:2])
        line = found.line if len(found.line) else found.best
        yield {
            "iterations": k, "tree": _short(tree[:_MAX_EDGES]), "path": _short(line),
            "swarm": [_short(np.vstack([ends[0], each, ends[1]])) for each in places],
            "length": path_length(line),
        }  # fmt: skip


def _short(rows: Array) -> list[list[float]]:
    """Rows of numbers [m] to the centimetre."""
    shortened: list[list[float]] = np.round(rows, 2).tolist()
    return shortened

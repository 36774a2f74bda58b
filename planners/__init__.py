"""Planners: free space (`Space`), a question in it (`Problem`), and its solvers (`PLANNERS`).

A planner is its settings; `plan(problem, rng)` returns a `Plan`.
"""

from planners.collision.space import Space
from planners.problem import Plan, Planner, Problem, Status
from planners.registries import OPTIMIZERS, PLANNERS, make_planner

__all__ = [
    "OPTIMIZERS",
    "PLANNERS",
    "Plan",
    "Planner",
    "Problem",
    "Space",
    "Status",
    "make_planner",
]

"""Simulators and planners of other packages in the same worlds (extra `peers`).

A peer is a planner of ours with an optimizer of another package, or a settings object whose
`prepare(case)` returns an object for one map, untimed, with `plan(problem, rng, deadline)` as our
planners have it.
"""

from __future__ import annotations

import importlib.util
from typing import Any, Final, NamedTuple

from agents.benchmarks.ompl import Ompl
from planners.swarm.planner import SwarmPlanner


class Peer(NamedTuple):
    """A planner of another package."""

    package: str
    settings: Any


def _mealpy(algorithm: str) -> SwarmPlanner:
    """A swarm on the way points of a free path: from random starts no swarm finds one in clutter.

    Each run of 100 iterations starts around the best path so far.
    """
    optimizer = {"name": "mealpy", "algorithm": algorithm}
    return SwarmPlanner(optimizer=optimizer, population=10, way_points=20)


PEERS: Final[dict[str, Peer]] = {
    "ompl_rrt_connect": Peer("ompl", Ompl("RRTConnect")),
    "ompl_informed_rrt_star": Peer("ompl", Ompl("InformedRRTstar")),
    "ompl_bit_star": Peer("ompl", Ompl("BITstar")),
    "mealpy_woa": Peer("mealpy", _mealpy("OriginalWOA")),
    "mealpy_pso": Peer("mealpy", _mealpy("OriginalPSO")),
}


def installed(package: str) -> bool:
    """Whether a package can be imported."""
    return importlib.util.find_spec(package) is not None


def prepare(settings: Any, case: Any) -> Any:
    """The planner of a peer's settings for the map of a case."""
    return settings.prepare(case) if hasattr(settings, "prepare") else settings

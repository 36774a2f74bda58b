"""Planners: what is free, what is asked, and who answers.

`PLANNERS` names them; a planner is its settings, and `plan(problem, rng)` answers with a `Plan`.
`OPTIMIZERS` names how swarms move.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from planners.collision.space import Space
from planners.graphs.cell_decomposition import CellDecomposition
from planners.graphs.geometric import Geometric
from planners.graphs.grid import AStar, Bfs, Dfs, Dijkstra, ThetaStar
from planners.graphs.roadmap import Prm
from planners.graphs.visibility import Visibility
from planners.graphs.voronoi import Voronoi
from planners.lattice.disc_then_lattice import DiscThenLattice
from planners.lattice.lattice import Lattice
from planners.problem import Plan, Planner, Problem, Status
from planners.reactive.bug import Bug1, Bug2
from planners.reactive.potential_field import PotentialField
from planners.swarm.optimizers import OPTIMIZERS, make_optimizer
from planners.swarm.planner import SwarmPlanner
from planners.swarm.rrt_woa import RrtWoa
from planners.trees.spline import SplineRrtStar
from planners.trees.variants import (
    InformedRrtStar,
    Rrt,
    RrtConnect,
    RrtStar,
    RrtStarFn,
    RrtStarLimited,
    RrtStarSmart,
    RrtStarWoaGlobal,
    RrtStarWoaLocal,
)
from wheelchair_gym.config import InputError, load

__all__ = [
    "OPTIMIZERS",
    "PLANNERS",
    "Plan",
    "Planner",
    "Problem",
    "Space",
    "Status",
    "make_optimizer",
    "make_planner",
]

PLANNERS: Final[dict[str, type]] = {
    "a_star": AStar,
    "bfs": Bfs,
    "bug1": Bug1,
    "bug2": Bug2,
    "cell_decomposition": CellDecomposition,
    "dfs": Dfs,
    "dijkstra": Dijkstra,
    "disc_then_lattice": DiscThenLattice,
    "geometric": Geometric,
    "informed_rrt_star": InformedRrtStar,
    "lattice": Lattice,
    "potential_field": PotentialField,
    "prm": Prm,
    "rrt": Rrt,
    "rrt_connect": RrtConnect,
    "rrt_star": RrtStar,
    "rrt_star_fn": RrtStarFn,
    "rrt_star_limited": RrtStarLimited,
    "rrt_star_smart": RrtStarSmart,
    "rrt_star_woa_global": RrtStarWoaGlobal,
    "rrt_star_woa_local": RrtStarWoaLocal,
    "rrt_woa": RrtWoa,
    "spline_rrt_star": SplineRrtStar,
    "swarm": SwarmPlanner,
    "theta_star": ThetaStar,
    "visibility": Visibility,
    "voronoi": Voronoi,
}


def make_planner(spec: str | Mapping[str, Any] | Planner) -> Planner:
    """A planner by name, or by a mapping with its name and settings; a planner is itself.

    Raises:
        InputError: the name is unknown, or a setting is not one of the planner's.
    """
    if not isinstance(spec, str | Mapping):
        if type(spec) in PLANNERS.values():
            return spec
        raise InputError(f"planner is {spec!r}; expected a name or an object with a name")
    values = {"name": spec} if isinstance(spec, str) else dict(spec)
    name = values.pop("name", None)
    if not isinstance(name, str) or name not in PLANNERS:
        raise InputError(f"planner {name!r} is unknown; there are {', '.join(sorted(PLANNERS))}")
    planner: Planner = load(PLANNERS[name], values, f"planner {name}")
    return planner

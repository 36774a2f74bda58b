"""Planners: what is free, what is asked, and who answers.

`PLANNERS` names them; a planner is its settings, and `plan(problem, rng)` answers with a `Plan`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from planners.graphs.a_star import AStar
from planners.graphs.disc_then_lattice import DiscThenLattice
from planners.graphs.lattice import Lattice
from planners.graphs.visibility import Visibility
from planners.space import Space
from planners.trees.connect import RrtConnect
from planners.trees.rrt import Rrt, RrtStar, RrtStarWoaGlobal, RrtStarWoaLocal
from planners.types import Plan, Planner, Problem, Status
from wheelchair_gym.config import InputError, load

__all__ = ["PLANNERS", "Plan", "Planner", "Problem", "Space", "Status", "make_planner"]

PLANNERS: Final[dict[str, type]] = {
    "a_star": AStar,
    "disc_then_lattice": DiscThenLattice,
    "lattice": Lattice,
    "rrt": Rrt,
    "rrt_connect": RrtConnect,
    "rrt_star": RrtStar,
    "rrt_star_woa_global": RrtStarWoaGlobal,
    "rrt_star_woa_local": RrtStarWoaLocal,
    "visibility": Visibility,
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
    if name not in PLANNERS:
        raise InputError(f"planner {name!r} is unknown; there are {', '.join(sorted(PLANNERS))}")
    planner: Planner = load(PLANNERS[name], values, f"planner {name}")
    return planner

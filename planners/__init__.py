"""Planners: one algorithm family a folder; PLANNERS names their settings classes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from planners.graphs.lattice import Lattice
from planners.trees.connect import RrtConnect
from planners.trees.rrt import Rrt, RrtStar, RrtStarWoaGlobal, RrtStarWoaLocal
from planners.types import Planner
from wheelchair_gym.config import InputError, load

PLANNERS: dict[str, type] = {
    "lattice": Lattice,
    "rrt": Rrt,
    "rrt_connect": RrtConnect,
    "rrt_star": RrtStar,
    "rrt_star_woa_global": RrtStarWoaGlobal,
    "rrt_star_woa_local": RrtStarWoaLocal,
}


def make_planner(spec: str | Mapping[str, Any] | Planner) -> Planner:
    """A planner from a name, from `{"name": name, **settings}`, or as it is.

    Raises:
        InputError: the name is unknown or a setting is wrong.
    """
    if isinstance(spec, str):
        spec = {"name": spec}
    if not isinstance(spec, Mapping):
        return spec
    values = dict(spec)
    name = values.pop("name", None)
    if name not in PLANNERS:
        raise InputError(f"planner {name!r} is unknown; known: {', '.join(sorted(PLANNERS))}")
    planner: Planner = load(PLANNERS[name], values, f"planner {name}")
    return planner

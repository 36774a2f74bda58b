"""The names of all planners, swarm optimizers, objectives and refiners, and where each is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from planners.problem import Planner
from wheelchair_gym.migration import migrated
from wheelchair_gym.registry import Registry

_GRIDS = ("a_star:AStar", "bfs:Bfs", "dfs:Dfs", "dijkstra:Dijkstra", "theta_star:ThetaStar")
_TREES = (
    "informed_rrt_star:InformedRrtStar",
    "rrt:Rrt",
    "rrt_connect:RrtConnect",
    "rrt_star:RrtStar",
    "rrt_star_fn:RrtStarFn",
    "rrt_star_limited:RrtStarLimited",
    "rrt_star_smart:RrtStarSmart",
    "rrt_star_woa_global:RrtStarWoaGlobal",
    "rrt_star_woa_local:RrtStarWoaLocal",
    "rrt_woa:RrtWoa",
)


def _in_module(module: str, *entries: str) -> dict[str, str]:
    """Places of entries `name:class` of one module."""
    return {entry.split(":")[0]: f"{module}:{entry.split(':')[1]}" for entry in entries}


PLANNERS: Final = Registry(
    "planner",
    {
        "bug1": "planners.reactive.bug:Bug1",
        "bug2": "planners.reactive.bug:Bug2",
        "cell_decomposition": "planners.graphs.cell_decomposition:CellDecomposition",
        "disc_then_lattice": "planners.lattice.lattice:DiscThenLattice",
        "geometric": "planners.graphs.geometric:Geometric",
        "lattice": "planners.lattice.lattice:Lattice",
        "potential_field": "planners.reactive.potential_field:PotentialField",
        "prm": "planners.graphs.roadmap:Prm",
        "spline_rrt_star": "planners.trees.spline:SplineRrtStar",
        "swarm": "planners.swarm.planner:SwarmPlanner",
        "visibility": "planners.graphs.visibility:Visibility",
        "voronoi": "planners.graphs.voronoi:Voronoi",
        **_in_module("planners.graphs.grid", *_GRIDS),
        **_in_module("planners.trees.variants", *_TREES),
    },
)

FIRST_PLANNERS: Final = Registry(
    "first", {name: PLANNERS.places[name] for name in ("a_star", "rrt", "rrt_connect", "rrt_star")}
)

OPTIMIZERS: Final = Registry(
    "optimizer",
    _in_module(
        "planners.swarm.optimizers",
        "abc:Abc",
        "de:De",
        "firefly:Firefly",
        "ga:Ga",
        "gwo:Gwo",
        "pso:Pso",
        "pso_adaptive:PsoAdaptive",
        "pso_chaotic:PsoChaotic",
        "pso_gwo:PsoGwo",
        "pso_variable:PsoVariable",
        "woa:Woa",
        "woa_modified:WoaModified",
    ),
)

# What moves the swarms of the planner `swarm`.
SWARM_OPTIMIZERS: Final = Registry(
    "optimizer", {**OPTIMIZERS.places, "mealpy": "planners.swarm.peers:Mealpy"}
)

OBJECTIVES: Final = Registry(
    "objective",
    _in_module(
        "planners.swarm.objectives",
        "length_free:LengthFree",
        "smooth:Smooth",
        "violation:Violation",
        "way_points:WayPoints",
    ),
)

REFINERS: Final = Registry(
    "refiner",
    _in_module(
        "planners.refine",
        "clearance:Clearance",
        "pchip:Pchip",
        "shortcut:Shortcut",
        "spline:Spline",
        "woa:Woa",
    ),
)


def make_planner(spec: str | Mapping[str, Any] | Planner) -> Planner:
    """A planner by name, or by a mapping with its name and settings; a planner is itself.

    Raises:
        InputError: the name is unknown, or a setting is not one of the planner's.
    """
    if isinstance(spec, Mapping):
        spec = migrated(spec, "planner")
    planner: Planner = PLANNERS.make(spec)
    return planner


def make_optimizer(spec: Any) -> Any:
    """A swarm optimizer by name, or by a mapping with its name and settings.

    Raises:
        InputError: the name is unknown, or a setting is not one of the optimizer's.
    """
    return OPTIMIZERS.make(spec)


def make_objective(spec: Any) -> Any:
    """An objective of swarms by name, or by a mapping with its name and settings.

    Raises:
        InputError: the name is unknown, or a setting is not one of the objective's.
    """
    return OBJECTIVES.make(spec)

"""The names of all planners, swarm optimizers and objectives, and where each is."""

from collections.abc import Mapping
from typing import Any, Final

from planners.problem import Planner
from wheelchair_gym.base.registry import Registry, in_module

PLANNERS: Final = Registry(
    "planner",
    {
        "cell_decomposition": "planners.graphs.cell_decomposition:CellDecomposition",
        **in_module("planners.graphs.geometric", "Geometric GeometricThenLimited"),
        "potential_field": "planners.reactive.potential_field:PotentialField",
        "rrt_star_woa_global": "planners.rrt_star_woa.path_shortening:RrtStarWoaGlobal",
        "rrt_star_woa_local": "planners.rrt_star_woa.local_steering:RrtStarWoaLocal",
        "rrt_woa": "planners.swarm.planner:RrtWoa",
        "se2_rrt_star_woa": "planners.rrt_star_woa.poses:Se2RrtStarWoa",
        "swarm": "planners.swarm.planner:SwarmPlanner",
        "visibility": "planners.graphs.visibility:Visibility",
        "lattice": "planners.lattice.lattice:Lattice",
        **in_module("planners.reactive.bug", "Bug1 Bug2"),
        **in_module("planners.graphs.roadmap", "Prm Voronoi"),
        **in_module("planners.graphs.grid", "AStar Bfs Dfs Dijkstra"),
        **in_module("planners.trees.rrt", "Rrt RrtConnect"),
        **in_module("planners.trees.rrt_star", "RrtStar RrtStarFn RrtStarLimited"),
        **in_module("planners.trees.rrt_star", "InformedRrtStar RrtStarSmart SplineRrtStar"),
    },
    group="wheelchair_gym.planners",
    needs=("plan",),
)
FIRST_PLANNERS: Final = Registry(
    "first", {name: PLANNERS.places[name] for name in ("a_star", "rrt", "rrt_connect", "rrt_star")}
)
OPTIMIZERS: Final = Registry(
    "optimizer",
    in_module(
        "planners.swarm.optimizers",
        "Abc Firefly Gwo Pso PsoAdaptive PsoChaotic PsoGwo PsoVariable Woa WoaModified",
    ),
)
# What moves the swarms of the planner `swarm`.
SWARM_OPTIMIZERS: Final = Registry(
    "optimizer", {**OPTIMIZERS.places, **in_module("planners.swarm.peers", "Mealpy")}
)
OBJECTIVES: Final = Registry(
    "objective", in_module("planners.swarm.path_cost", "LengthFree Smooth Violation WayPoints")
)


def make_planner(spec: str | Mapping[str, Any] | Planner) -> Planner:
    """Return a planner by name, or by a mapping with its name and settings; or a planner itself.

    Raises:
        InputError: the name is unknown, or a setting is not one of the planner's.
    """
    planner: Planner = PLANNERS.make(spec)
    return planner

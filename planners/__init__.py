"""Planners by name: each is the class of its settings."""

from planners.trees.connect import RrtConnect
from planners.trees.rrt import Rrt, RrtStar, RrtStarWoaGlobal, RrtStarWoaLocal
from planners.types import Planner

PLANNERS: dict[str, type[Planner]] = {
    "rrt": Rrt,
    "rrt_star": RrtStar,
    "rrt_star_woa_local": RrtStarWoaLocal,
    "rrt_star_woa_global": RrtStarWoaGlobal,
    "rrt_connect": RrtConnect,
}

"""Variants of RRT* from the literature, as settings: informed, smart, fixed nodes, limited."""

from __future__ import annotations

import math

import numpy as np

from planners.trees.rrt import LEAST_GAMMA, RrtStar
from planners.trees.search import search
from planners.trees.values import Growth
from planners.types import Plan, Problem
from wheelchair_gym.config import setting, settings


@settings
class InformedRrtStar:
    """Informed RRT* (Gammell, Srinivasa and Barfoot 2014), made quick: a labelled hybrid.

    The first path is RRT-Connect's (Kuffner and LaValle 2000). From then on samples fall where they
    can shorten it: in the ellipse round start and goal, a share of them near its vertices
    (RRT*-Smart, Nasir et al. 2013) and near corners of what is solid (Amato et al. 1998), at every
    scale. Ancestors serve as parents (Q-RRT*, Jeong et
    al. 2019), the path's own vertices are joined where they see each other, nodes that cannot
    help are left out, and childless ones give way when the tree is full. It ends early where the
    path is the straight line.
    """

    iterations: int = setting(default=10_000, source="as rrt_star; about 60 ms", low=1)
    nodes: int = setting(default=100_000, source="of each tree; memory for 20 MB", low=2)
    step: float = setting(default=4.0, unit="m", source="rooms and doors of buildings", low=1e-3)
    radius_factor: float = setting(default=1.0, source="the least that converges", low=0.1)
    beacon_share: float = setting(default=0.3, source="measured", low=0.0, high=1.0)
    beacon_radius: float = setting(default=4.0, unit="m", source="as the step", low=0.0)
    beacon_finest: float = setting(default=1e-5, source="of the radius", low=1e-12, high=1.0)

    corner_share: float = setting(default=0.5, source="measured", low=0.0, high=1.0)
    corner_radius: float = setting(
        default=1.0, unit="m", source="about the width of doors", low=0.0
    )

    @property
    def growth(self) -> Growth:
        """The values of the loop."""
        return Growth(
            self.step,
            math.inf,
            self.nodes,
            stop_at_first=False,
            both_ways=True,
            rewiring=True,
            gamma=self.radius_factor * LEAST_GAMMA,
            climbing=True,
            recycling=True,
            shortening=True,
            informed=True,
            beacon_share=self.beacon_share,
            beacon_radius=self.beacon_radius,
            beacon_finest=self.beacon_finest,
            corner_share=self.corner_share,
            corner_radius=self.corner_radius,
        )

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Answer a problem with the best path of all samples."""
        return search(problem, rng, deadline, self.growth, self.iterations)


@settings
class RrtStarSmart:
    """RRT*-Smart (Nasir et al. 2013): path optimisation and intelligent sampling.

    Once there is a path, its vertices that see each other are joined, by the triangle inequality;
    those that stay are beacons, round which a share of the samples falls.
    """

    tree: RrtStar = setting(default=RrtStar())
    beacon_share: float = setting(
        default=0.5, source="every second sample, of the paper's biasing ratio", low=0.0, high=1.0
    )
    beacon_radius: float = setting(
        default=1.0, unit="m", source="about the width of doors", low=1e-6
    )

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Answer a problem with the best path of all samples, or with the first."""
        growth = self.tree.growth._replace(
            shortening=True, beacon_share=self.beacon_share, beacon_radius=self.beacon_radius
        )
        return search(problem, rng, deadline, growth, self.tree.iterations)


@settings
class RrtStarFn:
    """RRT*FN (Adiyatov and Varol 2013): RRT* in a fixed number of nodes.

    At that number a childless node, drawn at random but never the goal, makes room for each new
    one, so that memory is bounded and paths still fall.
    """

    tree: RrtStar = setting(default=RrtStar(nodes=1_000))

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Answer a problem with the best path of all samples, or with the first."""
        growth = self.tree.growth._replace(recycling=True)
        return search(problem, rng, deadline, growth, self.tree.iterations)


@settings
class RrtStarLimited:
    """Limited tree expansion (a thesis of 2024, section 3.2): RRT* between start and goal in x.

    Samples fall between the x of the start and of the goal, whatever their y; each extension that
    is blocked widens the strip by a step, and the first path ends it. The source tests the end
    point of an edge only, so that edges may cross walls; here edges are exact, and the counter
    `walls_cut` says how many of the `blocked` ones that test would have let through.
    """

    tree: RrtStar = setting(default=RrtStar(return_on_first_path=True))
    widening: float = setting(
        default=0.1, unit="m", source="on each side, for each blocked edge; not given", low=0.0
    )

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Answer a problem with the first path, or the best of all samples, as `tree` says."""
        growth = self.tree.growth._replace(in_strip=True, widening=self.widening)
        return search(problem, rng, deadline, growth, self.tree.iterations)

"""The tree planners as settings.

RRT, RRT-Connect and RRT*; and variants of RRT* from the literature (informed, smart, fixed nodes,
limited, spline). `planners.rrt_star_woa` has the variants of the thesis.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from planners.problem import Plan, PlannerBase, Problem, Status, with_settings
from planners.smoothing.curves import hermite_path
from planners.trees.sampling import TreeOptions
from planners.trees.tree_search import search
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.config import setting, settings

_ROOMS = "design choice: rooms and doors of buildings"
_MEASURED = "measured with the planner benchmark"
# Karaman and Frazzoli 2011, d = 2: 2 sqrt((1 + 1/d) area / pi) is gamma's minimum.
MIN_GAMMA = 2.0 * math.sqrt(1.5 / math.pi)


class TreePlanner(PlannerBase):
    """A planner that is one tree search."""

    fixed = TreeOptions()  # the options that are no settings

    @property
    def options(self) -> TreeOptions:
        """The options of the search."""
        return with_settings(self.fixed, self)

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return the best path of all samples, or the first path, as the options say."""
        return search(problem, rng, end, self.options)


@settings
class CornerSampling:
    """Samples near the corners of obstacles, where doors are (Amato et al. 1998)."""

    corner_share: float = setting(default=0.5, low=0.0, high=1.0, source=_MEASURED)
    """Share of the samples near the corners of obstacles."""


@settings
class Rrt(TreePlanner):
    """A rapidly exploring random tree (LaValle 1998); it ends with its first path."""

    iterations: int = setting(
        default=20_000, low=1, source="design choice: enough for doors of 1 m on maps of 50 m"
    )
    """Largest number of samples."""
    step: float = setting(default=2.0, unit="m", low=1e-3, source=_ROOMS)
    """Longest edge towards a sample."""
    goal_bias: float = setting(default=0.05, low=0.0, high=1.0, source="LaValle and Kuffner 2001")
    """Share of the samples that are the goal."""
    goal_reach: float = setting(default=2.0, unit="m", low=0.0, source="design choice: as the step")
    """Distance from which a node is connected to the goal."""


@settings
class RrtConnect(CornerSampling, TreePlanner):
    """Two trees that reach for each other (Kuffner and LaValle 2000): quick, not short.

    It tries the straight line first.
    """

    fixed = TreeOptions(bidirectional=True)

    iterations: int = setting(
        default=100_000, low=1, source="design choice: mazes take some thousands"
    )
    """Largest number of samples."""
    step: float = setting(default=4.0, unit="m", low=1e-3, source=_ROOMS)
    """Longest edge towards a sample."""


@settings
class RrtStar(TreePlanner):
    """RRT* (Karaman and Frazzoli 2011): the best parent is chosen, and neighbours are rewired.

    Neighbours lie within `search_radius`, or, where that is null, within the radius
    gamma sqrt(log n / n) that shrinks as the tree of n nodes fills the map; gamma is 1.2 times the
    minimum that makes the paths converge to the shortest, as measured with the benchmark.
    """

    fixed = TreeOptions(rewiring=True, gamma=1.2 * MIN_GAMMA)

    iterations: int = setting(default=10_000, low=1, source="thesis, figure 3.1")
    """Number of samples."""
    nodes: int = setting(default=100_000, low=2, source="design choice")
    """Largest number of nodes of a tree."""
    step: float = setting(default=4.0, unit="m", low=1e-3, source=_ROOMS)
    """Longest edge towards a sample."""
    search_radius: float | None = setting(default=None, unit="m", low=1e-3)
    """Radius of the neighbourhood; null for the shrinking radius."""
    goal_bias: float = setting(default=0.05, low=0.0, high=1.0, source="LaValle and Kuffner 2001")
    """Share of the samples that are the goal."""
    goal_reach: float = setting(default=4.0, unit="m", low=0.0, source="design choice: as the step")
    """Distance from which a node is connected to the goal."""
    return_on_first_path: bool = setting(default=False, source="more samples, shorter paths")
    """Whether the search stops at the first path."""


@settings
class InformedRrtStar(CornerSampling, TreePlanner):
    """Informed RRT* (Gammell, Srinivasa and Barfoot 2014), made quick: a labelled hybrid.

    The first path is RRT-Connect's (Kuffner and LaValle 2000). Then samples fall where they can
    shorten it: in the ellipse around start and goal, a share of them near its vertices (RRT*-Smart,
    Nasir et al. 2013) and near corners of obstacles (Amato et al. 1998), at every scale. Ancestors
    serve as parents (Q-RRT*, Jeong et al. 2019); vertices of the path that see each other are
    joined; nodes that cannot help are left out; when the tree is full, new nodes replace leaves.
    The search ends early where the path is the straight line.
    """

    fixed = TreeOptions(
        return_on_first_path=False,
        bidirectional=True,
        rewiring=True,
        gamma=MIN_GAMMA,
        replace_leaves=True,
        shortcut_path=True,
        informed=True,
        beacon_share=0.3,  # measured with the planner benchmark
        beacon_radius=4.0,  # m: as the step
        beacon_min_scale=1e-5,
    )

    iterations: int = setting(default=10_000, low=1, source="design choice: as rrt_star")
    """Largest number of samples."""
    nodes: int = setting(default=100_000, low=2, source="design choice")
    """Largest number of nodes of a tree."""
    step: float = setting(default=4.0, unit="m", low=1e-3, source=_ROOMS)
    """Longest edge towards a sample."""


@settings
class RrtStarSmart(TreePlanner):
    """RRT*-Smart (Nasir et al. 2013): path optimisation and intelligent sampling.

    Once there is a path, its vertices that see each other are joined, by the triangle inequality;
    the remaining vertices are beacons, around which a share of the samples falls.
    """

    tree: RrtStar = setting(default=RrtStar(), source="design choice")
    """The tree search."""

    @property
    def options(self) -> TreeOptions:
        """The options of the search."""
        # Half of the samples (Nasir et al. 2013: biasing ratio 2) within about a door's width.
        return self.tree.options._replace(shortcut_path=True, beacon_share=0.5, beacon_radius=1.0)


@settings
class RrtStarFn(TreePlanner):
    """RRT*FN (Adiyatov and Varol 2013): RRT* in a fixed number of nodes.

    A full tree replaces a random leaf other than the goal by each new node, so that memory is
    bounded and paths still improve.
    """

    tree: RrtStar = setting(default=RrtStar(nodes=1_000), source="design choice")
    """The tree search."""

    @property
    def options(self) -> TreeOptions:
        """The options of the search."""
        return self.tree.options._replace(replace_leaves=True)


@settings
class RrtStarLimited(TreePlanner):
    """Limited tree expansion (a thesis of 2024, section 3.2): RRT* between start and goal in x.

    Samples fall between the x of the start and of the goal, with any y; each blocked extension
    widens the strip, and the first path ends the search. The source tests only the end point of an
    edge, so that edges may cross walls; here edges are exact, and the counter `walls_cut` is the
    number of `blocked` edges that the source's test would accept.
    """

    tree: RrtStar = setting(
        default=RrtStar(return_on_first_path=True), source="thesis, section 3.2"
    )
    """The tree search."""
    widening: float = setting(
        default=0.1, unit="m", low=0.0, source="design choice; the thesis gives no value"
    )
    """Widening of the strip on each side by each blocked edge."""

    @property
    def options(self) -> TreeOptions:
        """The options of the search."""
        return self.tree.options._replace(in_strip=True, widening=self.widening)


@settings
class SplineRrtStar(PlannerBase):
    """Spline-RRT*: an RRT* path that is executed as a spline (Yu et al. 2018, with other splines).

    Each edge of the tree's path becomes a cubic Hermite curve whose direction at a vertex bisects
    the edges there, so that the direction is continuous. A curve that is not free gets shorter
    tangents, which draw it towards the edge; `straight_legs` counts the edges that stay straight.
    The path is the curve's polyline, within `tolerance`; each of its edges is tested exactly.
    """

    tree: InformedRrtStar = setting(
        default=InformedRrtStar(iterations=2_000), source="design choice"
    )
    """The tree search."""
    tolerance: float = setting(
        default=1e-3, unit="m", low=1e-9, source="design choice: below the noise of sensors"
    )
    """Largest distance of the polyline from the curve."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return a smooth free path; the deadline is that of the tree."""
        began = clock()
        plan = self.tree.solve(problem, rng, end)
        if plan.status != Status.SOLVED or plan.length == 0.0:
            return plan
        tree_s = clock() - began
        path, straight = hermite_path(problem.free.arrays, plan.path, self.tolerance)
        counters = {**plan.counters, "straight_legs": straight}
        return replace(plan, path=path, counters=counters, timings={"tree_s": tree_s})

"""RRT* (Karaman and Frazzoli 2011, algorithm 6), its variants, and informed RRT*.

From top to bottom: RRT*, also in a fixed number of nodes and in a strip; RRT*-Smart (Nasir et al.
2013) and informed RRT* (Gammell, Srinivasa and Barfoot 2014), which shortcut the best path and
sample near its vertices, the beacons; and spline-RRT*, which executes its path as a spline.
Informed RRT* is made quick by steps of other planners.
"""

import math
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planners.collision.polygon_tests import point_free
from planners.problem import Plan, PlannerBase, Problem, Status, with_settings
from planners.smoothing.curves import hermite_path
from planners.trees.rrt import (
    CORNER_RADIUS,
    MAX_DRAWS,
    MIN_GAIN,
    CornerSampling,
    GoalBias,
    LongEdges,
    TreeOptions,
    TreeSearch,
    connect_goal,
    edge_is_free,
    extend,
    extend_both,
    free_slot,
    is_goal_drawn,
    is_useful,
    next_iteration,
    sample,
    sample_between,
    sample_near_corner,
    solve,
)
from planners.trees.tree import (
    NONE,
    Tree,
    change_parent,
    nearest,
    nodes_within,
    place_node,
    write_ancestors,
)
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.compiled.kernel import absorbed_kernel, as_int, borrowing_kernel
from wheelchair_gym.compiled.random import Stream, next_in_disc, next_uniform

# Karaman and Frazzoli 2011, d = 2: 2 sqrt((1 + 1/d) area / pi) is gamma's minimum.
MIN_GAMMA = 2.0 * math.sqrt(1.5 / math.pi)


@absorbed_kernel
def find_neighbours(search: TreeSearch, x: float, y: float, after: int) -> int:
    """Write the neighbours of a point to `found`, and return their number: Near.

    The node `after`, if it is not NONE, is one more neighbour if there is space.
    """
    options, run, found, distances = search.options, search.run[0], search.found, search.distances
    radius = options.search_radius
    if radius == 0.0:
        count = search.tree.grid[0].count + 1
        radius = options.gamma * math.sqrt(run.sample_area * math.log(count) / count)
    n = nodes_within(search.tree, x, y, radius, found, distances)
    if after != NONE and n < len(found):
        node = search.tree.nodes[after]
        found[n], distances[n] = after, math.hypot(node.x - x, node.y - y)
        n += 1
    return n


@absorbed_kernel
def choose_parent(
    search: TreeSearch, x: float, y: float, n: int, parent: int, edge: float
) -> tuple[int, float]:
    """Return the cheapest parent of a point among n neighbours, and the edge's length.

    Neighbours are tried in order of cost, so that few edges are tested. `parent` sees the point.
    """
    nodes, found, through = search.tree.nodes, search.found, search.through
    for k in range(n):
        through[k] = nodes[found[k]].cost + search.distances[k]
    while True:
        minimum, choice = nodes[parent].cost + edge, NONE
        for k in range(n):
            if through[k] < minimum:
                minimum, choice = through[k], k
        if choice == NONE:
            return parent, edge
        through[choice] = np.inf
        j = found[choice]
        if edge_is_free(search, nodes[j].x, nodes[j].y, x, y):
            return as_int(j), search.distances[choice]


@absorbed_kernel
def rewire(search: TreeSearch, new: int, n: int) -> None:
    """Make a node the parent of those of its n neighbours that it makes cheaper: Rewire."""
    nodes, found, distances = search.tree.nodes, search.found, search.distances
    x, y, cost = nodes[new].x, nodes[new].y, nodes[new].cost
    for k in range(n):
        j = found[k]
        if cost + distances[k] < nodes[j].cost - MIN_GAIN and edge_is_free(
            search, x, y, nodes[j].x, nodes[j].y
        ):
            change_parent(search.tree, as_int(j), as_int(new), distances[k], search.below)


@absorbed_kernel
def insert_and_rewire(
    search: TreeSearch, parent: int, near: int, x: float, y: float, edge: float, n: int,
    state: Stream,
) -> None:  # fmt: skip
    """Add a point below its parent, and rewire its n neighbours: lines 8 and 13 to 16."""
    new = free_slot(search, search.tree, parent, near, state)
    if new != NONE:
        place_node(search.tree, new, x, y, parent, edge)
        rewire(search, new, n)
        connect_goal(search, new)


@absorbed_kernel
def add_node(
    search: TreeSearch, near: int, x: float, y: float, edge: float, state: Stream, after: int = NONE
) -> None:
    """Add a point that a node sees below its best parent, and rewire: lines 7 to 16.

    `after` is one more neighbour; see `find_neighbours`.
    """
    n = find_neighbours(search, x, y, after)  # line 7
    parent, edge = choose_parent(search, x, y, n, near, edge)  # lines 9 to 12
    insert_and_rewire(search, parent, near, x, y, edge, n, state)


@borrowing_kernel
def grow(search: TreeSearch, until: int, state: Stream) -> None:
    """Grow a tree to iteration `until`, or to an earlier end."""
    tree = search.tree
    while next_iteration(search, until):
        x, y = sample(search, state)  # line 3: SampleFree
        near = nearest(tree, x, y)  # line 4: Nearest
        x, y, edge, free = extend(search, tree, near, x, y, search.options.step)  # lines 5, 6
        if free:
            add_node(search, near, x, y, edge, state)


@settings
class RrtStar(GoalBias, LongEdges, PlannerBase):
    """RRT* (Karaman and Frazzoli 2011): the best parent is chosen, and neighbours are rewired.

    Neighbours lie within `search_radius`, or, where that is null, within the radius
    gamma sqrt(log n / n) that shrinks as the tree of n nodes fills the map; gamma is 1.2 times the
    minimum that makes the paths converge to the shortest, as measured with the benchmark.
    """

    iterations: int = setting(default=10_000, low=1, source="thesis, figure 3.1")
    """Number of samples."""
    nodes: int = setting(default=100_000, low=2, high=10_000_000)
    """Largest number of nodes of a tree."""
    search_radius: float | None = setting(default=None, unit="m", low=1e-3)
    """Radius of the neighbourhood; null for the shrinking radius."""
    goal_reach: float = setting(default=4.0, unit="m", low=0.0, source="as the step")
    """Distance from which a node is connected to the goal."""
    return_on_first_path: bool = setting(default=False, source="more samples, shorter paths")
    """Whether the search stops at the first path."""

    @property
    def options(self) -> TreeOptions:
        """The numbers of the search."""
        return with_settings(TreeOptions(gamma=1.2 * MIN_GAMMA), self)

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return the best path of all samples, or the first path."""
        return solve(problem, rng, end, self.options, grow)


@settings
class RrtStarFn(PlannerBase):
    """RRT*FN (Adiyatov and Varol 2013): RRT* in a fixed number of nodes.

    A full tree replaces a random leaf other than the goal by each new node, so that memory is
    bounded and paths still improve.
    """

    tree: RrtStar = setting(default=RrtStar(nodes=1_000))
    """The tree search."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return the best path of all samples, or the first path."""
        options = self.tree.options._replace(replaces_leaves=True)
        return solve(problem, rng, end, options, grow)


STRIP = np.dtype(
    [
        ("margin", np.float64),  # m, on each side of the strip
        ("blocked", np.int64),  # blocked extensions
        ("walls_cut", np.int64),  # blocked extensions that end in a free point
    ]
)


@absorbed_kernel
def sample_strip(search: TreeSearch, margin: float, state: Stream) -> tuple[float, float]:
    """Draw the goal or a point of the strip until there is a path; then a point anywhere [m]."""
    start, goal, bounds = search.start, search.goal, search.space.bounds
    low, high = bounds[0], bounds[2]
    if search.run[0].first_path == NONE:
        if is_goal_drawn(search, state):
            return goal[0], goal[1]
        low = max(low, min(start[0], goal[0]) - margin)
        high = min(high, max(start[0], goal[0]) + margin)
    return sample_between(search, low, high, math.inf, state)


@borrowing_kernel
def grow_in_strip(
    search: TreeSearch, until: int, state: Stream, strip: NDArray[Any], widening: float
) -> None:
    """Grow a tree to iteration `until`, or to an earlier end.

    The strip (1,) STRIP widens by `widening` [m] with each blocked edge.
    """
    tree, blocked = search.tree, strip[0]
    while next_iteration(search, until):
        x, y = sample_strip(search, blocked.margin, state)
        near = nearest(tree, x, y)
        x, y, edge, free = extend(search, tree, near, x, y, search.options.step)
        if free:
            add_node(search, near, x, y, edge, state)
        elif edge > MIN_GAIN:
            blocked.blocked += 1
            blocked.walls_cut += point_free(search.space, x, y)
            blocked.margin += widening


WIDENING = 0.1  # m: of the strip on each side by each blocked edge; the thesis gives no value


@settings
class RrtStarLimited(PlannerBase):
    """Limited tree expansion (a thesis of 2024, section 3.2): RRT* between start and goal in x.

    Samples fall between the x of the start and of the goal, with any y; each blocked extension
    widens the strip, and the first path ends the search. The source tests only the end point of an
    edge, so that edges may cross walls; here edges are exact, and the counter `walls_cut` is the
    number of `blocked` edges that the source's test would accept.
    """

    tree: RrtStar = setting(default=RrtStar(return_on_first_path=True), source="its section 3.2")
    """The tree search."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return the first path, or the best of all samples, as `tree` says."""
        strip = np.zeros(1, STRIP)
        loop = partial(grow_in_strip, strip=strip, widening=WIDENING)
        plan = solve(problem, rng, end, self.tree.options, loop)
        counts = {name: int(strip[name][0]) for name in ("blocked", "walls_cut")}
        return replace(plan, counters={**plan.counters, **counts})


SMART_SHARE = 0.5  # of the samples, near beacons (Nasir et al. 2013: biasing ratio 2)
SMART_RADIUS = 1.0  # m, of these samples: about a door's width
SHORTCUT_PERIOD = 64  # iterations between two shortcuts of an improving best path
# A path up to this factor longer than the straight line is straight within rounding.
_STRAIGHT = 1.0 + 1e-12


@absorbed_kernel
def best_ancestor(
    search: TreeSearch, x: float, y: float, parent: int, edge: float
) -> tuple[int, float]:
    """Return the farthest ancestor before one that does not see a point, and the edge's length.

    By the triangle inequality each ancestor is a better parent than its child (Jeong et al. 2019).
    """
    nodes = search.tree.nodes
    while nodes[parent].parent != NONE:
        above = as_int(nodes[parent].parent)
        if not edge_is_free(search, nodes[above].x, nodes[above].y, x, y):
            break
        parent = above
        edge = math.hypot(x - nodes[parent].x, y - nodes[parent].y)
    return parent, edge


@borrowing_kernel
def shortcut_path(search: TreeSearch) -> None:
    """Join vertices of the best path where that shortens it; edges are tested exactly."""
    tree, chain, found = search.tree, search.chain, search.found
    nodes = tree.nodes
    n = write_ancestors(nodes, search.run[0].goal, chain)
    for k in range(n - 3, -1, -1):
        i = chain[k]
        x, y = nodes[i].x, nodes[i].y
        count = min(n - k - 2, len(found))
        for m in range(count):  # ancestors of the parent, as many as fit
            j = chain[k + 2 + m]
            found[m] = j
            search.distances[m] = math.hypot(nodes[j].x - x, nodes[j].y - y)
        before = as_int(nodes[i].parent)
        parent, edge = choose_parent(search, x, y, count, before, nodes[i].edge)
        parent, edge = best_ancestor(search, x, y, parent, edge)  # drops collinear points
        if parent != before:
            change_parent(tree, as_int(i), as_int(parent), edge, search.below)


@borrowing_kernel
def update_best_path(search: TreeSearch) -> bool:
    """Shortcut the best path when that is due; return whether it has become shorter.

    It is due with the first path, and then after some iterations if its cost fell.
    """
    start, goal, run, nodes = search.start, search.goal, search.run[0], search.tree.nodes
    due = run.first_path == run.iteration or run.iteration % SHORTCUT_PERIOD == 0
    if run.first_path == NONE or not due or nodes[run.goal].cost >= run.path_length - MIN_GAIN:
        return False
    shortcut_path(search)
    run.path_length = nodes[run.goal].cost
    run.done |= run.path_length <= math.hypot(goal[0] - start[0], goal[1] - start[1]) * _STRAIGHT
    return True


@absorbed_kernel
def draw_beacon(search: TreeSearch, state: Stream) -> int:
    """Draw an inner vertex of the best path, an index of `chain`; NONE if there is none."""
    n = write_ancestors(search.tree.nodes, search.run[0].goal, search.chain)
    return 1 + int(next_uniform(state) * (n - 2)) if n > 2 else NONE


@absorbed_kernel
def extend_near(
    search: TreeSearch, beacon: int, x: float, y: float
) -> tuple[int, int, float, float, float, bool]:
    """Extend the nearest node to a sample, or the vertex before its beacon to the sample itself.

    Return the node extended, the vertex after the beacon or NONE, and the values of `extend`.
    """
    chain, near, after, step = search.chain, NONE, NONE, search.options.step
    if beacon != NONE:  # the path continues to the next vertex
        near, after, step = as_int(chain[beacon + 1]), as_int(chain[beacon - 1]), math.inf
    else:
        near = as_int(nearest(search.tree, x, y))
    x, y, edge, free = extend(search, search.tree, near, x, y, step)
    return near, after, x, y, edge, free


@absorbed_kernel
def sample_smart(search: TreeSearch, state: Stream) -> tuple[float, float, int]:
    """Draw a point [m] near a beacon or as RRT* does, and the beacon or NONE."""
    if search.run[0].first_path != NONE and next_uniform(state) < SMART_SHARE:
        beacon = draw_beacon(search, state)
        if beacon != NONE:
            u, v = next_in_disc(state)
            at = search.tree.nodes[search.chain[beacon]]
            return at.x + SMART_RADIUS * u, at.y + SMART_RADIUS * v, beacon
    x, y = sample(search, state)
    return x, y, NONE


@borrowing_kernel
def grow_smart(search: TreeSearch, until: int, state: Stream) -> None:
    """Grow a tree to iteration `until`, or to an earlier end: algorithm 1, RRT* with beacons."""
    while next_iteration(search, until):
        x, y, beacon = sample_smart(search, state)
        near, after, x, y, edge, free = extend_near(search, beacon, x, y)
        if free:
            add_node(search, near, x, y, edge, state, after)
        update_best_path(search)  # line 12: PathOptimization


@settings
class RrtStarSmart(PlannerBase):
    """RRT*-Smart (Nasir et al. 2013): path optimisation and intelligent sampling.

    Once there is a path, its vertices that see each other are joined, by the triangle inequality;
    the remaining vertices are beacons, around which a share of the samples falls.
    """

    tree: RrtStar = setting(default=RrtStar())
    """The tree search."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return the best path of all samples, or the first path."""
        return solve(problem, rng, end, self.tree.options, grow_smart)


BEACON_SHARE = 0.3  # of the samples: measured with the planner benchmark
BEACON_RADIUS = 4.0  # m: as the step
MIN_SCALE = 1e-5  # radii are scaled by a log-uniform draw in [this, 1], for gains at every scale
_BEACON_DRAWS = 10  # largest number of draws near a beacon, where about half are useful


@absorbed_kernel
def sample_beacon(search: TreeSearch, beacon: int, state: Stream) -> tuple[float, float]:
    """Draw a point [m] near a vertex of the best path that shortens the path there."""
    nodes, chain = search.tree.nodes, search.chain
    b, a, c = nodes[chain[beacon]], nodes[chain[beacon + 1]], nodes[chain[beacon - 1]]
    before = math.hypot(a.x - b.x, a.y - b.y) + math.hypot(c.x - b.x, c.y - b.y)
    radius = BEACON_RADIUS * MIN_SCALE ** next_uniform(state)
    x, y = b.x, b.y
    for _ in range(_BEACON_DRAWS):
        u, v = next_in_disc(state)
        x, y = b.x + radius * u, b.y + radius * v
        if math.hypot(a.x - x, a.y - y) + math.hypot(c.x - x, c.y - y) < before:
            break
    return x, y


@borrowing_kernel
def sample_ellipse(search: TreeSearch, longest: float, state: Stream) -> tuple[float, float]:
    """Draw a useful point uniform in the ellipse of the paths up to a length [m].

    The length exceeds the distance from start to goal (Gammell et al. 2014).
    """
    start, goal = search.start, search.goal
    ux, uy = goal[0] - start[0], goal[1] - start[1]
    apart = math.hypot(ux, uy)
    across = 0.5 * math.sqrt(max(longest * longest - apart * apart, 0.0))
    x, y = goal[0], goal[1]
    for _ in range(MAX_DRAWS):
        u, v = next_in_disc(state)
        u, v = 0.5 * longest * u / apart, across * v / apart
        x, y = 0.5 * (start[0] + goal[0]), 0.5 * (start[1] + goal[1])
        x, y = x + u * ux - v * uy, y + u * uy + v * ux
        if is_useful(search, x, y, longest):
            break
    return x, y


@absorbed_kernel
def sample_informed(search: TreeSearch, state: Stream) -> tuple[float, float, int]:
    """Draw a point [m] that can shorten the best path, and the vertex near which it is, or NONE.

    It is near an obstacle's corner, near a beacon, or uniform in the ellipse. In an ellipse larger
    than the map, rejection sampling draws points of the map.
    """
    run, bounds, corner_share = search.run[0], search.space.bounds, search.options.corner_share
    longest = search.tree.nodes[run.goal].cost
    if corner_share > 0.0 and next_uniform(state) < corner_share:
        radius = CORNER_RADIUS * MIN_SCALE ** next_uniform(state)
        x, y = sample_near_corner(search, radius, longest, state)
        return x, y, NONE
    if next_uniform(state) < BEACON_SHARE:
        beacon = draw_beacon(search, state)
        if beacon != NONE:
            x, y = sample_beacon(search, beacon, state)
            return x, y, beacon
    if run.sample_area < (bounds[2] - bounds[0]) * (bounds[3] - bounds[1]):
        x, y = sample_ellipse(search, longest, state)
    else:
        x, y = sample_between(search, bounds[0], bounds[2], longest, state)
    return x, y, NONE


@absorbed_kernel
def refine(search: TreeSearch, state: Stream) -> None:
    """Extend the tree to a sample, if that can shorten the best path, and rewire."""
    nodes, goal = search.tree.nodes, search.goal
    x, y, beacon = sample_informed(search, state)
    near, after, x, y, edge, free = extend_near(search, beacon, x, y)
    if not free:
        return
    n = find_neighbours(search, x, y, after)
    parent, edge = choose_parent(search, x, y, n, near, edge)
    parent, edge = best_ancestor(search, x, y, parent, edge)
    minimum = nodes[parent].cost + edge + math.hypot(goal[0] - x, goal[1] - y)
    if minimum < nodes[search.run[0].goal].cost - MIN_GAIN:
        insert_and_rewire(search, parent, near, x, y, edge, n, state)


@borrowing_kernel
def grow_informed(search: TreeSearch, until: int, state: Stream, goal_tree: Tree) -> None:
    """Grow two trees until they meet, then one, to iteration `until` or to a straight path."""
    start, goal, run = search.start, search.goal, search.run[0]
    apart = math.hypot(goal[0] - start[0], goal[1] - start[1])
    while next_iteration(search, until):
        if run.first_path == NONE:
            extend_both(search, goal_tree, state)
        else:
            refine(search, state)
        if update_best_path(search):  # then the ellipse of useful points has become smaller
            across = math.sqrt(max(run.path_length * run.path_length - apart * apart, 0.0))
            run.sample_area = min(run.sample_area, 0.25 * math.pi * run.path_length * across)


MAX_NODES = 100_000  # of each tree of informed RRT*


@settings
class InformedRrtStar(CornerSampling, LongEdges, PlannerBase):
    """Informed RRT* (Gammell, Srinivasa and Barfoot 2014), made quick: a labelled hybrid.

    The first path is RRT-Connect's (Kuffner and LaValle 2000). Then samples fall where they can
    shorten it: in the ellipse around start and goal, a share of them near its vertices (RRT*-Smart,
    Nasir et al. 2013) and near corners of obstacles (Amato et al. 1998), at every scale. Ancestors
    serve as parents (Q-RRT*, Jeong et al. 2019); vertices of the path that see each other are
    joined; nodes that cannot help are left out; when the tree is full, new nodes replace leaves.
    The search ends early where the path is the straight line.
    """

    iterations: int = setting(default=10_000, low=1, source="as rrt_star")
    """Largest number of samples."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return the best path of all samples."""
        options = TreeOptions(
            nodes=MAX_NODES, gamma=MIN_GAMMA, return_on_first_path=False, replaces_leaves=True
        )
        options = with_settings(options, self)
        return solve(problem, rng, end, options, grow_informed, both=True)


TOLERANCE = 1e-3  # m: largest distance of the polyline from the curve, below the noise of sensors


@settings
class SplineRrtStar(PlannerBase):
    """Spline-RRT*: an RRT* path that is executed as a spline (Yu et al. 2018, with other splines).

    Each edge of the tree's path becomes a cubic Hermite curve whose direction at a vertex bisects
    the edges there, so that the direction is continuous. A curve that is not free gets shorter
    tangents, which draw it towards the edge; `straight_legs` counts the edges that stay straight.
    The path is the curve's polyline, within `TOLERANCE`; each of its edges is tested exactly.
    """

    tree: InformedRrtStar = setting(default=InformedRrtStar(iterations=2_000))
    """The tree search."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return a smooth free path; the deadline is that of the tree."""
        began = clock()
        plan = self.tree.solve(problem, rng, end)
        if plan.status != Status.SOLVED or plan.length == 0.0:
            return plan
        tree_s = clock() - began
        path, straight = hermite_path(problem.free.arrays, plan.path, TOLERANCE)
        counters = {**plan.counters, "straight_legs": straight}
        return replace(plan, path=path, counters=counters, timings={"tree_s": tree_s})

"""The exact optimum for a point: best-first search through triangles, by cones of sight.

A shortest path bends only at convex corners, and only round them. A corner, once the shortest path
to it is found, expands past itself through the triangles: by cones whose sides are sight lines
past other corners, the cone with the least bound first (after Polyanya: Cui, Harabor and
Grastien 2017). Whether a corner lies in a cone is an exact sign, so what is found is the optimum.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from planners.collision.boundary import NONE, Corners, orientation
from planners.collision.inflation import ARC, SHIFT
from planners.collision.polygon_tests import Index
from planners.collision.triangulation import Mesh
from planners.graphs.heap import Heap, enlarged, new_heap, nodes_to, pop, push
from planners.problem import Plan, PlannerBase, Problem, Status, answer
from wheelchair_gym.base.arrays import Array, Mask
from wheelchair_gym.base.settings import settings
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.compiled.kernel import absorbed_kernel, borrowing_kernel, kernel

SLACK = 1e-12  # of an edge: a cone may see this part more, for rounding


@absorbed_kernel
def side_of_bound(points: Array, root: int, bound: int, x: int) -> float:
    """Return the side of a cone's bound on which a point lies: a line from the root.

    A bound below 0 goes on from point -1 - bound through the root.
    """
    if bound < 0:
        return orientation(points, -1 - bound, root, x)
    return orientation(points, root, bound, x)


@absorbed_kernel
def _cross(points: Array, root: int, bound: int, x: int) -> float:
    """Return the side of a cone's bound in plain double precision."""
    ux, uy = points[root, 0], points[root, 1]
    if bound < 0:
        bx, by = ux - points[-1 - bound, 0], uy - points[-1 - bound, 1]
    else:
        bx, by = points[bound, 0] - ux, points[bound, 1] - uy
    return float(bx * (points[x, 1] - uy) - by * (points[x, 0] - ux))


@absorbed_kernel
def length_bound(points: Array, root: int, a: int, b: int, right: int, left: int) -> float:
    """Return a lower bound [m] of paths from a root to the goal through a cone's part of an edge.

    Seen from the root, a is the edge's right end.
    """
    ux, uy, ax, ay = points[root, 0], points[root, 1], points[a, 0], points[a, 1]
    ex, ey = points[b, 0] - ax, points[b, 1] - ay
    gx, gy = points[-1, 0], points[-1, 1]
    low, high = 0.0, 1.0
    if right != a:
        c, d = _cross(points, root, right, a), _cross(points, root, right, b)
        if c < 0.0 and d > c:
            low = min(max(-c / (d - c) - SLACK, 0.0), 1.0)
    if left != b:
        c, d = _cross(points, root, left, a), _cross(points, root, left, b)
        if d > 0.0 and d > c:
            high = min(max(-c / (d - c) + SLACK, 0.0), 1.0)
    if high < low:
        low, high = 0.0, 1.0
    # A goal on the root's side of the edge is mirrored: beyond it, just as far from each point.
    over_root, over_goal = ex * (uy - ay) - ey * (ux - ax), ex * (gy - ay) - ey * (gx - ax)
    if over_root * over_goal > 0.0:
        shift = 2.0 * over_goal / (ex * ex + ey * ey)
        gx, gy, over_goal = gx + shift * ey, gy - shift * ex, -over_goal
    gap = over_root - over_goal
    t = 0.5 * (low + high)
    if gap != 0.0:  # where the straight way meets the edge's line
        px = ux + over_root / gap * (gx - ux) - ax
        py = uy + over_root / gap * (gy - uy) - ay
        t = (px * ex + py * ey) / (ex * ex + ey * ey)
    if low <= t <= high:
        return math.hypot(gx - ux, gy - uy)
    t = low if t < low else high
    x, y = ax + t * ex, ay + t * ey
    return math.hypot(x - ux, y - uy) + math.hypot(gx - x, gy - y)


@absorbed_kernel
def passes(points: Array, u: int, v: int, before: int, after: int) -> bool:
    """Return whether the line through u and v has both sides of a corner there on one side."""
    p, d = orientation(points, u, v, before), orientation(points, u, v, after)
    return not ((p < 0.0 and d > 0.0) or (p > 0.0 and d < 0.0))


class _Search(NamedTuple):
    """The state of a search. Corner n (point m) is the start, corner n + 1 (m + 1) the goal."""

    points: Array  # (m + 2, 2) m
    mesh: Mesh
    corners: Corners
    cost: Array  # (n + 2,) m: the shortest way found from the start
    parent: Index  # (n + 2,) corner before it on that way, or NONE
    there: Mask  # (t,) triangles that hold the goal


class _Queue(NamedTuple):
    """The open list: corners, as -1 - corner, and cones, by the lower bound on their path."""

    heap: Heap  # by bounds [m]
    cones: Index  # (capacity, 4) root; 3 * triangle + side it enters by; right and left bound
    made: Index  # (1,) number of cones


@absorbed_kernel
def _place(search: _Search, corner: int) -> int:
    """Return the point at which a corner, the start or the goal lies."""
    n = search.corners.place.shape[0]
    if corner < n:
        return int(search.corners.place[corner])
    return int(search.points.shape[0] - 2 + corner - n)


@absorbed_kernel
def _relax(search: _Search, queue: _Queue, root: int, x: int) -> None:
    """Offer a root as the corner before each corner at a point that it sees."""
    points, corners, n = search.points, search.corners, search.corners.place.shape[0]
    u, last = _place(search, root), points.shape[0] - 1
    goal = x == last
    far = math.hypot(points[x, 0] - points[u, 0], points[x, 1] - points[u, 1])
    if far == 0.0 and not goal:
        return
    cost = search.cost[root] + far
    ahead = math.hypot(points[last, 0] - points[x, 0], points[last, 1] - points[x, 1])
    for k in range(0 if goal else corners.first[x], 1 if goal else corners.first[x + 1]):
        v = n + 1 if goal else corners.members[k]
        if cost >= search.cost[v]:
            continue
        if goal or passes(points, u, x, corners.before[v], corners.after[v]):
            search.cost[v], search.parent[v] = cost, root
            push(queue.heap, cost + ahead, -1 - v)


@absorbed_kernel
def _push_cone(
    search: _Search, queue: _Queue, root: int, code: int, a: int, b: int, right: int, left: int
) -> None:
    """Push a cone that leaves a triangle by its side `code`, whose right end is a."""
    enters = search.mesh.across[code // 3, code % 3]
    if enters == NONE:
        return
    u, k = _place(search, root), queue.made[0]
    cone = queue.cones[k]
    cone[0], cone[1], cone[2], cone[3] = root, enters, right, left
    key = search.cost[root] + length_bound(search.points, u, a, b, right, left)
    push(queue.heap, key, k)
    queue.made[0] += 1


@absorbed_kernel
def _expand_cone(search: _Search, queue: _Queue, cone: Index) -> None:
    """Expand a cone through the triangle that it enters."""
    points, mesh, goal = search.points, search.mesh, search.points.shape[0] - 1
    root, right, left = cone[0], cone[2], cone[3]
    u, t, i = _place(search, root), cone[1] // 3, cone[1] % 3
    j, k = (i + 1) % 3, (i + 2) % 3
    b, a, x = mesh.corners[t, i], mesh.corners[t, j], mesh.corners[t, k]
    from_right, from_left = side_of_bound(points, u, right, x), side_of_bound(points, u, left, x)
    if from_right >= 0.0 and from_left <= 0.0:
        _relax(search, queue, root, x)
    if (
        search.there[t]
        and side_of_bound(points, u, right, goal) >= 0.0
        and side_of_bound(points, u, left, goal) <= 0.0
    ):
        _relax(search, queue, root, goal)
    if from_right > 0.0:
        _push_cone(search, queue, root, 3 * t + j, a, x, right, x if from_left < 0.0 else left)
    if from_left < 0.0:
        _push_cone(search, queue, root, 3 * t + k, x, b, x if from_right > 0.0 else right, left)


@borrowing_kernel
def _expand_start(search: _Search, queue: _Queue, t: int) -> None:
    """Expand the start, in a triangle, to all sides."""
    points, n, m = search.points, search.corners.place.shape[0], search.points.shape[0] - 2
    triangle = search.mesh.corners[t]
    if search.there[t]:
        _relax(search, queue, n, m + 1)
    for i in range(3):
        a, b = triangle[i], triangle[(i + 1) % 3]
        _relax(search, queue, n, a)
        if orientation(points, a, b, m) > 0.0:
            _push_cone(search, queue, n, 3 * t + i, a, b, a, b)


@absorbed_kernel
def _expand_corner(search: _Search, queue: _Queue, root: int, code: int) -> None:
    """Expand a corner of a triangle past itself: the path bends around it and is taut.

    The obstacle lies to the left (hand: 1) or right of the path. So the corner sees from straight
    ahead to that hand, until the line of sight runs along the next side of the obstacle.
    """
    points, corners, goal = search.points, search.corners, search.points.shape[0] - 1
    u, came = corners.place[root], _place(search, search.parent[root])
    before, last, hand = corners.before[root], corners.after[root], 1.0
    if orientation(points, came, u, before) < 0.0 or orientation(points, came, u, last) < 0.0:
        before, last, hand = last, before, -1.0
    t, i = code // 3, code % 3
    j = (i + 1) % 3
    right, left = search.mesh.corners[t, j], search.mesh.corners[t, (i + 2) % 3]
    for x in (right, left, goal):
        if (x != goal or search.there[t]) and (
            hand * orientation(points, came, u, x) >= 0.0 and passes(points, u, x, before, last)
        ):
            _relax(search, queue, root, x)
    near, far = (right, left) if hand > 0.0 else (left, right)
    if hand * orientation(points, came, u, far) <= 0.0:
        return
    first = near
    if hand * orientation(points, came, u, near) < 0.0:
        if hand * orientation(points, came, u, last) <= 0.0:
            return
        first = -1 - came
    elif hand * orientation(points, u, last, near) >= 0.0:
        return
    end = last if hand * orientation(points, u, last, far) > 0.0 else far
    if hand < 0.0:
        first, end = end, first
    _push_cone(search, queue, root, 3 * t + j, right, left, first, end)


@kernel
def _containing(mesh: Mesh, points: Array, p: int) -> Mask:
    """Return which triangles (t,) contain a point; their borders belong to them."""
    x, y, boxes = points[p, 0], points[p, 1], mesh.boxes
    inside: Mask = (boxes[0] <= x) & (x <= boxes[1]) & (boxes[2] <= y) & (y <= boxes[3])
    for t in np.flatnonzero(inside):
        a, b, c = mesh.corners[t, 0], mesh.corners[t, 1], mesh.corners[t, 2]
        inside[t] = (
            orientation(points, a, b, p) >= 0.0
            and orientation(points, b, c, p) >= 0.0
            and orientation(points, c, a, p) >= 0.0
        )
    return inside


@borrowing_kernel
def _advance(search: _Search, queue: _Queue, closed: Mask, spare: int, maximum: int) -> int:
    """Expand the smallest bound while capacity lasts; return the number of corners settled.

    It makes about `maximum` cones.
    """
    n, settled = search.corners.place.shape[0], 0
    first, around, waiting = search.mesh.first, search.mesh.around, queue.heap.size
    capacity = queue.cones.shape[0] - spare
    maximum = min(maximum, capacity)
    while 0 < waiting[0] <= capacity and queue.made[0] <= maximum and not closed[n + 1]:
        item = pop(queue.heap)
        root = -1 - item
        if item >= 0:
            _expand_cone(search, queue, queue.cones[item])
        elif not closed[root]:
            closed[root] = True
            settled += 1
            if root < n:
                u = search.corners.place[root]
                for k in range(first[u], first[u + 1]):
                    _expand_corner(search, queue, root, around[k])
    return settled


@kernel
def shortest(
    mesh: Mesh, corners: Corners, start: Array, goal: Array, maximum: int
) -> tuple[Array, bool, int, int]:
    """Return the shortest path (k, 2) [m] from a start to a goal (2,), both free, or an empty one.

    It gives up after `maximum` cones. Also returns whether the answer is proven, and the numbers of
    corners settled and of cones made.
    """
    n, m = corners.place.shape[0], mesh.points.shape[0]
    points = np.empty((m + 2, 2))
    points[:m], points[m], points[m + 1] = mesh.points, start, goal
    cost, parent = np.full(n + 2, math.inf), np.full(n + 2, NONE, np.int64)
    closed, there = np.zeros(n + 2, np.bool_), _containing(mesh, points, m + 1)
    search = _Search(points, mesh, corners, cost, parent, there)
    spare = n + 3 * len(there) + 8  # one step adds no more
    capacity = 2 * spare
    made = np.zeros(1, np.int64)
    queue = _Queue(new_heap(capacity), np.empty((capacity, 4), np.int64), made)
    cost[n], closed[n] = 0.0, True
    for t in np.flatnonzero(_containing(mesh, points, m)):
        _expand_start(search, queue, int(t))
    settled = 1
    while True:
        settled += _advance(search, queue, closed, spare, maximum)
        if queue.heap.size[0] == 0 or closed[n + 1] or made[0] > maximum:
            break
        old, capacity = queue, 2 * capacity
        queue = _Queue(enlarged(old.heap, capacity), np.empty((capacity, 4), np.int64), made)
        queue.cones[: len(old.cones)] = old.cones
    chosen = nodes_to(parent, n + 1) if closed[n + 1] else parent[:0]
    path = np.empty((len(chosen), 2))
    for k in range(len(chosen)):
        path[k] = points[_place(search, chosen[k])]
    proven = closed[n + 1] or queue.heap.size[0] == 0
    return path, proven, settled, made[0]


ALL = 2**62  # cones: no limit
FIRST = 20_000  # cones before the clock is looked at: some 20 ms
MORE = 4  # times as many next


@settings
class Visibility(PlannerBase):
    """Shortest paths, exactly; it proves it where there is none.

    With a clearance the optimum is that among obstacles whose grown corners are polygons; see
    `optima` for how near that is.
    """

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Find the shortest path; the generator is not used.

        A search with a deadline [s] starts again with more cones while there is time, and then ends
        `exhausted`. What a map needs once (arrays, triangles) ignores the deadline.
        """
        mesh, corners = problem.free.mesh, problem.free.corners
        start, goal = (np.array(p[:2], dtype=np.float64) for p in (problem.start, problem.goal))
        maximum = ALL if end == math.inf else FIRST
        while True:
            path, proven, settled, cones = shortest(mesh, corners, start, goal, maximum)
            if proven or clock() >= end:
                break
            maximum *= MORE
        failure = Status.NO_PATH if proven else Status.EXHAUSTED
        counters = {"nodes": settled, "corners": len(corners.place), "cones": cones}
        return answer(path, counters, failure=failure)


class Optima(NamedTuple):
    """Lengths [m] of the shortest paths of a problem; infinite where there is none."""

    touching: float  # of a point, which may touch obstacles
    lower_bound: float  # the optimum with the clearance is no shorter
    constrained: float  # of a path that keeps the clearance


def optima(problem: Problem) -> Optima:
    """Return the optimum at the problem's clearance, within bounds, and that of a touching point.

    A grown corner is a polygon whose sides touch the arc, so the path found keeps the clearance
    and is no shorter than the optimum. Obstacles grown less, so that their polygons lie inside
    those arcs, give a lower bound. Ends that are not free there give infinity.
    """
    inner = problem.clearance * math.cos(0.5 * ARC) / (1.0 + SHIFT) ** 2
    rng = np.random.default_rng(0)
    touching, minimum, constrained = (
        Visibility().plan(replace(problem, clearance=clearance), rng).length
        for clearance in (0.0, inner, problem.clearance)
    )
    return Optima(touching, minimum, constrained)

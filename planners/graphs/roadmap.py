"""Roadmaps: points and the straight edges that may join them, each tested only when its turn comes.

The probabilistic roadmap (`Prm`) draws random free points; `Voronoi` has points along the medial
axis, as far from obstacles as possible. Cells use the same search (lazy A*: Bohlin and Kavraki
2000): an edge that no short path needs is never tested.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import QhullError, cKDTree
from scipy.spatial import Voronoi as Diagram

from planners.collision.polygon_tests import SpaceArrays, edge_free, point_free
from planners.graphs.heap import Heap, new_heap, nodes_to, pop, push
from planners.problem import Plan, PlannerBase, Problem, answer
from planners.smoothing.shortcut import subdivided
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.compiled.random import Stream, next_uniform, stream
from wheelchair_gym.geometry.planar import without_repeats

Pairs = NDArray[np.int64]

CHUNK = 20_000  # edges tested between two looks at the clock: some 10 ms
START, GOAL = 0, 1  # the first two nodes
REFINEMENTS = 4  # times that the spacing of boundary samples is halved where no path is found
INITIAL_SAMPLES = 500  # of the first roadmap
# Connection radius, in multiples of the least that converges (Karaman and Frazzoli 2011: above 1).
RADIUS_FACTOR = 1.1


class Roadmap(NamedTuple):
    """Nodes and their neighbours, as kernels take them."""

    nodes: Array  # (n, 2) m: start, goal, the others
    first: Pairs  # (n + 1,): where each node's neighbours begin
    neighbours: Pairs  # indices of nodes


class Search(NamedTuple):
    """A search under way; arrays only, so that it may stop and go on."""

    cost: Array  # (n,) m
    parent: Pairs  # (n,), -1: not reached
    heap: Heap  # of edges, source * n + end
    tested: Pairs  # (1,): number of edges


@borrowing_kernel
def search_roadmap(arrays: SpaceArrays, roadmap: Roadmap, search: Search, budget: int) -> bool:
    """Test up to `budget` edges; return whether the goal is reached or nothing is left to test."""
    nodes, first, neighbours = roadmap
    cost, parent, heap, tested = search
    n = nodes.shape[0]
    for _ in range(budget):
        if heap.size[0] == 0:
            return True
        item = pop(heap)
        t, u = item // n, item % n
        if parent[u] >= 0:
            continue
        tx, ty, ux, uy = nodes[t, 0], nodes[t, 1], nodes[u, 0], nodes[u, 1]
        tested[0] += 1
        if not edge_free(arrays, tx, ty, ux, uy):
            continue
        parent[u] = t
        cost[u] = cost[t] + math.hypot(ux - tx, uy - ty)
        if u == GOAL:
            return True
        for k in range(first[u], first[u + 1]):
            v = neighbours[k]
            if parent[v] < 0:
                far = math.hypot(nodes[v, 0] - ux, nodes[v, 1] - uy)
                left = math.hypot(nodes[v, 0] - nodes[GOAL, 0], nodes[v, 1] - nodes[GOAL, 1])
                push(heap, cost[u] + far + left, u * n + v)
    return False


def shortest(
    arrays: SpaceArrays, nodes: Array, pairs: Pairs, end: float
) -> tuple[Array, int, bool]:
    """Return the shortest free path (k, 2) [m] over a roadmap from its first node to its second.

    Pairs (m, 2) of nodes (n, 2) [m] may be joined by a straight edge, in both directions. The path
    is empty where there is none. Also returns the number of edges tested, and whether the search
    was over before `clock` showed `end` [s].
    """
    n = len(nodes)
    both = np.concatenate([pairs, pairs[:, ::-1]])
    order = np.argsort(both[:, 0], kind="stable")
    first = np.concatenate([[0], np.cumsum(np.bincount(both[:, 0], minlength=n))])
    roadmap = Roadmap(np.ascontiguousarray(nodes), first, both[order, 1].copy())
    heap = new_heap(len(both) + 1)
    search = Search(np.zeros(n), np.full(n, -1, dtype=np.int64), heap, np.zeros(1, np.int64))
    heap.keys[0], heap.items[0], heap.size[0] = 0.0, START, 1  # from the start to itself
    over, in_time = False, True
    while not over and in_time:
        over = search_roadmap(arrays, roadmap, search, CHUNK)
        in_time = over or clock() < end
    path = np.empty((0, 2))
    if search.parent[GOAL] >= 0:
        path = without_repeats(nodes[nodes_to(search.parent, GOAL)])
    return path, int(search.tested[0]), in_time


@kernel
def _free_samples(arrays: SpaceArrays, count: int, state: Stream) -> Array:
    """Draw points, uniform on the map, and return the free ones (k, 2) [m]."""
    bounds = arrays.bounds
    found = np.empty((count, 2))
    k = 0
    for _ in range(count):
        x = bounds[0] + next_uniform(state) * (bounds[2] - bounds[0])
        y = bounds[1] + next_uniform(state) * (bounds[3] - bounds[1])
        if point_free(arrays, x, y):
            found[k, 0], found[k, 1] = x, y
            k += 1
    return found[:k].copy()


@settings
class Prm(PlannerBase):
    """A roadmap over random points (Kavraki et al. 1996), joined within the radius of PRM*.

    The radius gamma sqrt(log n / n) shrinks as n nodes fill the map; gamma is 1.1 times the least
    value for which the paths converge to the shortest (Karaman and Frazzoli 2011). Where
    the points do not join start and goal, there will be twice as many.
    """

    iterations: int = setting(default=40_000, low=1, source="enough for doors of 1 m")
    """Largest number of samples."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Answer with the shortest way over the first roadmap that joins start and goal.

        A roadmap proves nothing, so failure is `exhausted`.
        """
        arrays, state = problem.free.arrays, stream(rng)
        minimum = 2.0 * math.sqrt(1.5 * problem.free.free.area / math.pi)  # d = 2
        nodes = np.array([problem.start[:2], problem.goal[:2]], dtype=np.float64)
        drawn, tested = 0, 0
        path, pairs = np.empty((0, 2)), np.empty((0, 2), dtype=np.int64)
        while drawn < self.iterations and not len(path):
            more = min(max(drawn, INITIAL_SAMPLES), self.iterations - drawn)
            grown = np.vstack([nodes, _free_samples(arrays, more, state)])
            radius = RADIUS_FACTOR * minimum * math.sqrt(math.log(len(grown)) / len(grown))
            pairs = cKDTree(grown).query_pairs(radius, output_type="ndarray").astype(np.int64)
            # The first search ends, and one cut short does not count: a repetition is the same.
            path, edges, is_over = shortest(arrays, grown, pairs, end if drawn else math.inf)
            if is_over:
                nodes, drawn, tested = grown, drawn + more, tested + edges
            if clock() >= end:
                break
        counters = {"nodes": len(nodes), "iterations": drawn, "edges_tested": tested}
        tree = np.hstack([nodes[pairs[:, 0]], nodes[pairs[:, 1]]]) if len(path) else None
        return answer(path, counters, f"{drawn} points do not join start and goal", tree=tree)


MAX_SAMPLES = 200_000  # of the boundary: some seconds
SPACING = 0.4  # m: distance of the boundary samples at first, half the width of a door


def _axis(samples: Array, ends: Array) -> tuple[Array, Pairs]:
    """Return nodes (n, 2), the ends, then the diagram's vertices; and pairs of them to join."""
    diagram = Diagram(samples)
    ridges = np.array(diagram.ridge_vertices, dtype=np.int64)
    pairs = [ridges[(ridges >= 0).all(axis=1)] + 2]
    # An end lies in the cell of the sample nearest to it, from where a straight way leads to the
    # cell's vertices: a cell is convex, and no other wall cuts it.
    _, nearest = cKDTree(samples).query(ends)
    for end, sample in enumerate(nearest):
        cell = np.array(diagram.regions[diagram.point_region[sample]], dtype=np.int64)
        cell = cell[cell >= 0] + 2
        pairs.append(np.stack([np.full(len(cell), end), cell], axis=1))
    return np.vstack([ends, diagram.vertices]), np.concatenate(pairs)


@settings
class Voronoi(PlannerBase):
    """The shortest path along the medial axis, from the Voronoi diagram of boundary samples.

    Aurenhammer 1991; O'Dunlaing and Yap 1985. A passage is found once samples lie about as close as
    it is wide; where none is found, they lie twice as close.
    """

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Find a path; samples prove nothing, so failure is `exhausted`. No use of `rng`."""
        arrays = problem.free.arrays
        ends = np.array([problem.start[:2], problem.goal[:2]], dtype=np.float64)
        path, tested, halvings, note = np.empty((0, 2)), 0, 0, "no way along the finest axis"
        count = 0
        for halvings in range(REFINEMENTS + 1):
            samples = np.unique(subdivided(arrays.segments, SPACING / 2**halvings, 2), axis=0)
            if len(samples) > MAX_SAMPLES:
                note = f"the boundary has more than {MAX_SAMPLES:,} samples"
                break
            try:
                nodes, pairs = _axis(samples, ends)
            except QhullError:  # a map too thin for the precision of coordinates
                note = "the boundary is too thin for a diagram"
                break
            path, more, _ = shortest(arrays, nodes, pairs, end)
            tested, count = tested + more, len(nodes)
            if len(path):
                break
            if clock() >= end:
                note = "out of time"
                break
        return answer(path, {"nodes": count, "halvings": halvings, "edges_tested": tested}, note)

"""State lattice: A* over x, y and yaw with the exact rectangle of a differential drive.

The disc around a wheelchair fits through no ordinary door, but its rectangle does. Moves are short
arcs forward and backward, and pivots. They cost their duration at the chair's limits, and more near
obstacles; the area that each sweeps is tested exactly. Poses in line with narrow passages, and the
goal, are reached exactly.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from planners.collision.footprint import (
    TESTED_LENGTH,
    FootprintPlanner,
    Sweeps,
    start_and_goal,
    surroundings,
    sweep,
    sweeps,
)
from planners.collision.nearby import Nearby, nearby
from planners.collision.space import Space
from planners.graphs.heap import enlarged, new_heap
from planners.lattice.flood import is_cut_off
from planners.lattice.heuristic import Field, distance_field, new_guide
from planners.lattice.narrow_passages import make_lines, narrow_places
from planners.lattice.pose_search import (
    COUNTS,
    NODE,
    Grid,
    Search,
    Tree,
    estimate,
    expand,
    reopen,
    trace_path,
)
from planners.problem import Plan, Problem, Status
from planners.steering import poses_along
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.maps.driving_cost import MotionCost

CHUNK = 128  # expansions between two readings of the clock
NARROW = 0.15  # m beyond the half width on each side: wider passages need no exact poses
FIRST_ROUND = 1000  # poses expanded at each resolution before the next one's turn
FLOOD_SPACING = 0.05 / math.sqrt(2.0)  # m: of the grid points of the first flood
DISC_NOTE = "no way even for a disc as wide as the outline"
FLOOD_NOTE = "no way for the outline: a flood through its poses does not reach the goal"
LATTICE_NOTE = "no way at the resolution of the lattice"
REFINEMENTS = 1  # times that moves and cells are halved if no path is found soon
INITIAL_NODES = 4096  # initial capacity of a tree
MOVE_LENGTH = 0.2  # m: a fifth of the chair
PIVOT_ANGLE = 0.2  # rad: as the turn of an arc
CURVATURES = (0.8, 1.6)  # 1/m, to both sides: a wide turn, and one in a corridor of 1.2 m
HEADINGS = 32  # cells of the heading: 11 deg is below the turn of every move
CELL_SIZE = 0.10  # m, of a position: half a move
CURVATURE_WEIGHT = 0.03  # s m: cost of a change of curvature, against oscillation
# Factor of the heuristic: higher is faster and worse. It grows until there is a path. This and the
# next two are tuned on training seeds.
HEURISTIC_WEIGHT = 3.0
STOP_RATIO = 0.8  # the first path is good enough when none can cost less than this share of it
HEADING_WEIGHT = 0.5  # share of the time to turn to the path ahead that the heuristic counts
GOAL_CONNECTION_DISTANCE = 1.5  # m, from which exact connections to the goal are tried


class MapData(NamedTuple):
    """Data of a map and an outline, reused by all problems on the map."""

    near: Nearby
    gaps: Field
    narrows: Array  # (n, 3)


_MAP_DATA: WeakKeyDictionary[Space, dict[tuple[float, ...], MapData]] = WeakKeyDictionary()


def prepare_map(space: Space, footprint: Footprint, desired_clearance: float) -> MapData:
    """Return the data of a map, computed once: nearby segments, distances, narrow passages."""
    radius = min(footprint.front, footprint.rear, footprint.half_width)
    key = (*footprint.array, desired_clearance)
    prepared = _MAP_DATA.setdefault(space, {})
    if key not in prepared:
        near = nearby(space, footprint.reach + max(MOVE_LENGTH, TESTED_LENGTH) + desired_clearance)
        gaps = distance_field(space, radius + desired_clearance)
        places = narrow_places(near, gaps, footprint.half_width, footprint.half_width + NARROW)
        prepared[key] = MapData(near, gaps, places)
    return prepared[key]


@settings
class Lattice(FootprintPlanner):
    """A path (n, 3) with headings for the chair's rectangle; it may drive backwards.

    The lattice and finer ones take turns, each turn longer than the last and with a heuristic that
    weighs more. Failure is `no_path` where it is proven: no disc as wide as the outline gets there,
    or a flood through cells of poses does not. Else it is `exhausted`; the note says whether the
    lattices have been searched completely. A first path is improved for `improvement` poses (ARA*:
    Likhachev et al. 2003). As many as `iterations`, and a deadline, make an anytime planner.
    """

    improvement: int = setting(default=1000, low=0, source="tuned on training seeds")
    """Poses expanded after the first path, while the factor falls to 1, to find better paths."""
    iterations: int = setting(default=100_000, low=0, source="50 MB of memory")
    """Largest number of expanded poses."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Search without random numbers; the counted iterations are expanded poses."""
        start, goal = start_and_goal(problem)
        map_data = prepare_map(problem.space, self.footprint, self.desired_clearance)
        status, motion = self.fit(problem, map_data.near, CURVATURE_WEIGHT)
        if status is not None:
            return Plan(status)
        begin = partial(self._begin, map_data, motion, start, goal)
        searches, left, status, note = [begin(0)], self.iterations, Status.EXHAUSTED, ""
        level, maximum, weight, spacing = 0, FIRST_ROUND, HEURISTIC_WEIGHT, FLOOD_SPACING
        if not estimate(searches[0].search, *start) < math.inf:
            return Plan(Status.NO_PATH, note=DISC_NOTE)
        while status is Status.EXHAUSTED and left > 0 and clock() < end:
            for level in range(REFINEMENTS + 1):
                if level == len(searches):
                    searches.append(begin(level))
                left -= searches[level].advance(weight, maximum, left, end)
                if searches[level].solved:
                    left -= searches[level].improve(min(left, self.improvement), end)
                    status = Status.SOLVED
                    break
            else:
                flood = left > 0 and maximum > FIRST_ROUND
                if flood and is_cut_off(problem.space, motion, start, goal, spacing, end):
                    status, note = Status.NO_PATH, FLOOD_NOTE
                elif all(one.over for one in searches):
                    note = LATTICE_NOTE
                    break
            maximum, weight, spacing = 4 * maximum, 2.0 * weight, spacing / math.sqrt(2.0)
        return Plan(
            status,
            searches[level].path if status is Status.SOLVED else np.empty((0, 3)),
            counters={
                "iterations": self.iterations - left,
                "nodes": sum(int(one.counts["nodes"]) for one in searches),
                "halvings": level,
            },
            note=note,
        )

    def moves(self, level: int) -> Sweeps:
        """Return all moves, halved `level` times."""
        part = 0.5**level
        way, pivot = MOVE_LENGTH * part, PIVOT_ANGLE * part
        turns = [0.0, *(sign * bend * way for bend in CURVATURES for sign in (1, -1))]
        ahead = [(way, turn) for turn in turns]
        every = [*ahead, (0.0, pivot), (0.0, -pivot)]
        if self.limits.backward > 0.0:
            every += [(-way, turn) for turn in turns[:1] + turns[-2:]]
        moves = sweeps(len(every))
        for m, (distance, angle) in enumerate(every):
            sweep(moves, m, distance, angle, self.footprint.array)
        return moves

    def _begin(
        self, map_data: MapData, motion: MotionCost, start: Array, goal: Array, level: int
    ) -> PoseSearch:
        """Return the search at a resolution, with the start alone in its tree and open list."""
        around, part = surroundings(map_data.near, motion), 0.5**level
        box, join = around.near.box, GOAL_CONNECTION_DISTANCE
        low = box[:2].copy()
        lines, seeds = make_lines(around, map_data.narrows, goal, MOVE_LENGTH * part, join)
        moves = self.moves(level)
        hull = np.concatenate([moves.box[:, :2].min(axis=0), moves.box[:, 2:].max(axis=0)])
        cell, headings = CELL_SIZE * part, HEADINGS * 2**level
        columns, rows = (int(n) + 1 for n in (box[2:] - low) / cell)
        grid = Grid(
            low, cell, columns, headings, moves, hull, HEURISTIC_WEIGHT, STOP_RATIO,
            HEADING_WEIGHT / self.limits.turn,
        )  # fmt: skip
        nodes, anchors = np.zeros(INITIAL_NODES, NODE), len(lines.poses)
        nodes["x"][0], nodes["y"][0], nodes["yaw"][0] = start
        nodes["parent"], nodes["anchor"] = -1, -1
        heap = new_heap(len(nodes))
        heap.keys[0], heap.items[0], heap.size[0] = 0.0, 0, 1
        tree = Tree(
            nodes, heap, np.zeros(rows * columns * headings, np.float32), np.full(anchors, -1.0),
            np.full(anchors + 1, np.inf), np.array([(1, 0, -1)], COUNTS),
        )  # fmt: skip
        guide = new_guide(seeds, map_data.gaps, low, motion)
        return PoseSearch(Search(around, guide, lines, grid, tree))


@dataclass
class PoseSearch:
    """A search at one resolution, as far as it has come."""

    search: Search
    over: bool = False  # nothing is left to expand, or the path is good enough

    @property
    def counts(self) -> Any:
        """The tree's counts."""
        return self.search.tree.counts[0]

    @property
    def solved(self) -> bool:
        """Whether there is a path to the goal."""
        return bool(self.counts["goal"] >= 0)

    @property
    def path(self) -> Array:
        """The best path (n, 3) so far."""
        return poses_along(trace_path(self.search.tree, int(self.counts["goal"])), 0.0)

    def advance(self, weight: float, maximum: int, left: int, end: float) -> int:
        """Expand poses until they are `maximum` in all, or `left`, or `clock` shows `end`.

        Returns:
            The number of poses expanded.
        """
        before = int(self.counts["expanded"])
        if weight != self.search.grid.heuristic_weight and not self.over:
            self._reopen(weight, self.search.grid.stop_ratio)
        maximum = min(maximum, before + left)
        while not self.over and self.counts["expanded"] < maximum and clock() < end:
            until = min(maximum, int(self.counts["expanded"]) + CHUNK)
            self.over = expand(self.search, until)
            if not self.over and self.counts["expanded"] < until:
                tree = self.search.tree
                nodes = np.concatenate([tree.nodes, np.empty_like(tree.nodes)])
                tree = tree._replace(nodes=nodes, heap=enlarged(tree.heap, len(nodes)))
                self.search = self.search._replace(tree=tree)
        return int(self.counts["expanded"]) - before

    def improve(self, left: int, end: float) -> int:
        """Search better paths with a falling weight; return the number of poses expanded."""
        before, weight = left, self.search.grid.heuristic_weight
        while left > 0 and weight > 1.0 and clock() < end:
            weight, self.over = max(1.0, 0.5 * weight), False
            self._reopen(weight, 1.0)
            left -= self.advance(weight, sys.maxsize, left, end)
        return before - left

    def _reopen(self, weight: float, stop_ratio: float) -> None:
        """Order the open list by another weight of the heuristic."""
        grid = self.search.grid._replace(heuristic_weight=weight, stop_ratio=stop_ratio)
        self.search = self.search._replace(grid=grid)
        reopen(self.search)

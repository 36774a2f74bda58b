"""A lattice of manoeuvres: A* over x, y and yaw with the exact outline of a differential drive.

The disc round a wheelchair passes no ordinary door; its rectangle does. Moves are short arcs ahead
and back and pivots, in seconds at the chair's limits, dearer near walls; what each sweeps is tested
exactly. Poses in line with narrow places, and the goal, are reached exactly.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from planners.collision.footprint import Sweeps, sweep, sweeps
from planners.collision.nearby import Nearby, nearby
from planners.collision.polygon_tests import clearance
from planners.collision.space import Space
from planners.lattice.heuristic import Field, gaps_of, guide_to
from planners.lattice.narrow_passages import gaps_at, lines_of, narrow_places
from planners.lattice.pose_search import (
    COUNT,
    EXPANDED,
    GOAL,
    PIECE,
    Grid,
    Manner,
    Tree,
    grow,
    traced,
)
from planners.problem import Plan, Problem, Status, begin, check
from wheelchair_gym.config import setting, settings
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.kinematics import Limits

Array = NDArray[np.float64]

CHUNK = 256  # expansions between two looks at the clock
TOUCH = 2e-6  # m: the outline keeps at least this gap, more than rounding and tiny turns are
NARROW = 0.15  # m beyond the half width on each side: wider places are passed without lines
YAWS = 360  # headings tried of a goal that has none
LEAVE = 0.98  # of the gap at a start that is nearer to a wall than the margin, to be kept
ROOM = 4096  # nodes of a tree at first
POINTS = 0.05  # m, and rad of a pivot times 2: between poses of the path


class Ground(NamedTuple):
    """What depends on map and outline alone."""

    near: Nearby
    gaps: Field
    narrows: Array  # (n, 3)


_GROUNDS: WeakKeyDictionary[Space, dict[tuple[float, ...], Ground]] = WeakKeyDictionary()


def ground_of(space: Space, footprint: Footprint, reach: float, wish: float) -> Ground:
    """What a search needs of a map, made once: what lies near, distances, narrow places."""
    radius = min(footprint.front, footprint.rear, footprint.half_width)
    key = (*footprint.array, reach, wish)
    grounds = _GROUNDS.setdefault(space, {})
    if key not in grounds:
        near = nearby(space, footprint.reach + reach + wish)
        gaps = gaps_of(space, radius + wish)
        places = narrow_places(near, gaps, footprint.half_width, footprint.half_width + NARROW)
        grounds[key] = Ground(near, gaps, places)
    return grounds[key]


@settings
class Lattice:
    """Manoeuvres for the chair's own outline; the path (n, 3) has headings, and may back up.

    The outline keeps the problem's clearance less half its width. The start's heading is 0 where it
    has none; the goal's counts where it has one. Failure is `exhausted`: a lattice proves nothing.
    """

    footprint: Footprint = Footprint()
    limits: Limits = Limits()
    stride: float = setting(
        default=0.2, unit="m", source="a fifth of the chair", low=0.02, high=1.0
    )
    pivot: float = setting(default=0.2, unit="rad", source="as an arc's turn", low=0.02, high=1.5)
    bends: tuple[float, ...] = setting(
        default=(0.8, 1.6),
        unit="1/m",
        source="a wide turn, and one in a corridor of 1.2 m",
        low=0.0,
    )
    headings: int = setting(default=32, source="11 deg, below every move's turn", low=8, high=360)
    cell: float = setting(default=0.10, unit="m", source="half a move", low=0.02)
    refinements: int = setting(
        default=1, source="times moves and cells are halved where nothing is found", low=0, high=4
    )
    wish: float = setting(
        default=0.25, unit="m", source="play beside the chair in a 1.1 m door", low=0.01
    )
    dear: float = setting(default=3.0, source="tuned on training floor plans", low=0.0)
    lateral: float = setting(
        default=0.35, unit="m/s2", source="comfort, as a follower's in curves", low=0.01
    )
    spin: float = setting(
        default=0.6,
        source="of the turn limit: what followers turn in place with",
        low=0.05,
        high=1.0,
    )
    back: float = setting(
        default=2.0, source="times a way back is dearer: nothing looks back", low=1.0
    )
    steer: float = setting(
        default=0.03, unit="s m", source="of a change of curvature; against wobble", low=0.0
    )
    greed: float = setting(
        default=1.6, source="more is faster and less good; tuned", low=1.0, high=10.0
    )
    content: float = setting(
        default=0.8,
        source="share of a way's cost that none hopes to undercut; tuned",
        low=0.1,
        high=1.0,
    )
    askew: float = setting(
        default=0.5, source="of the time to turn to the way ahead, in what is left; tuned", low=0.0
    )
    join: float = setting(
        default=1.5, unit="m", source="how far from the goal it is led to exactly", low=0.1
    )
    iterations: int = setting(default=200_000, source="poses expanded: some 200 MB", low=0)

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """See `Planner.plan`; nothing is drawn. The iterations counted are poses expanded."""
        begun, end = begin(deadline)
        # Points may come as near as they like; what is no number stays none.
        status = check(replace(problem, clearance=0.0 * problem.clearance))
        if status is not None:
            return Plan(status)
        start, goal = np.zeros(3), np.array(problem.goal, dtype=np.float64)
        start[: len(problem.start)] = problem.start
        ground = ground_of(problem.space, self.footprint, self.reach, self.wish)
        manner = self.manner(max(TOUCH, problem.clearance - self.footprint.half_width))
        status, manner = self._ends(problem, ground, manner, start, goal)
        if status is not None:
            return Plan(status)
        iterations, nodes, path, level = 0, 0, np.empty((0, 3)), 0
        for level in range(self.refinements + 1):
            most = self.iterations - iterations
            path, expanded, made, over = self._search(ground, manner, start, goal, level, most, end)
            iterations, nodes = iterations + expanded, nodes + made
            if len(path) or not over:
                break
        return Plan(
            Status.SOLVED if len(path) else Status.EXHAUSTED,
            path,
            counters={"iterations": iterations, "nodes": nodes, "halvings": level},
            timings={"time_s": time.perf_counter() - begun},
        )

    @property
    def reach(self) -> float:
        """How far [m] from its pose a move, or a piece of a longer stretch, leads."""
        return max(self.stride, PIECE)

    def manner(self, margin: float) -> Manner:
        """How the chair drives at a margin [m]."""
        limits = self.limits
        # Going to full speed costs half the time it takes; so does stopping, which is quicker.
        switch = 0.5 * limits.forward / limits.acceleration
        return Manner(
            self.footprint.array, margin, self.wish, self.dear, limits.forward,
            limits.backward / self.back, limits.turn, self.spin * limits.turn, self.lateral,
            switch, self.steer,
        )  # fmt: skip

    def moves(self, level: int) -> Sweeps:
        """All moves, halved so many times."""
        part = 0.5**level
        way, pivot = self.stride * part, self.pivot * part
        turns = [0.0, *(sign * bend * way for bend in self.bends for sign in (1, -1))]
        ahead = [(way, turn) for turn in turns]
        sharpest = turns[:1] + turns[-2:] if self.bends else turns
        back = [(-way, turn) for turn in sharpest] if self.limits.backward > 0.0 else []
        every = [*ahead, (0.0, pivot), (0.0, -pivot), *back]
        moves = sweeps(len(every))
        for m, (distance, angle) in enumerate(every):
            sweep(moves, m, distance, angle, self.footprint.array)
        return moves

    def _ends(
        self, problem: Problem, ground: Ground, manner: Manner, start: Array, goal: Array
    ) -> tuple[Status | None, Manner]:
        """Why the outline cannot stand at an end, if so; and the manner, its margin as it can."""
        near, room = ground.near, sweeps(1)
        if clearance(problem.space.arrays, *start[:2]) < manner.margin:
            return Status.START_OCCUPIED, manner  # of its axle alone
        gap = float(gaps_at(near, manner._replace(margin=TOUCH), start[None], room)[0])
        if gap < TOUCH:
            return Status.START_OCCUPIED, manner
        if gap < manner.margin:  # it may leave at the gap that it has
            manner = manner._replace(margin=LEAVE * gap)
        poses, smaller = goal[None], manner
        if len(goal) == 2:  # of headings; where not even a smaller outline fits, none between does
            yaws = np.arange(YAWS) * (2.0 * math.pi / YAWS)
            poses = np.column_stack([np.tile(goal, (YAWS, 1)), yaws])
            less = 2.0 * self.footprint.reach * math.sin(0.5 * math.pi / YAWS)
            smaller = manner._replace(outline=manner.outline - less)
        if (gaps_at(near, smaller, poses, room) < manner.margin).all():
            return Status.GOAL_OCCUPIED, manner
        return None, manner

    def _search(
        self,
        ground: Ground,
        manner: Manner,
        start: Array,
        goal: Array,
        level: int,
        most: int,
        end: float,
    ) -> tuple[Array, int, int, bool]:
        """The path (n, 3) or none, poses expanded, nodes made, and whether all was searched."""
        near, part = ground.near, 0.5**level
        radius = min(self.footprint.front, self.footprint.rear, self.footprint.half_width)
        low = near.box[:2].copy()
        lines, seeds = lines_of(near, manner, ground.narrows, goal, self.stride * part, self.join)
        guide = guide_to(seeds, ground.gaps, low, radius, self.wish, self.dear, self.limits.forward)
        moves = self.moves(level)
        hull = np.concatenate([moves.box[:, :2].min(axis=0), moves.box[:, 2:].max(axis=0)])
        cell, headings = self.cell * part, self.headings * 2**level
        columns, rows = (int(n) + 1 for n in (near.box[2:] - low) / cell)
        grid = Grid(
            low, cell, columns, headings, moves, hull, self.greed, self.content,
            self.askew / self.limits.turn,
        )  # fmt: skip
        slots = np.zeros(rows * columns * headings, np.float32)
        tree = _rooted(start, slots, len(lines.poses))
        aim = np.array([goal[0], goal[1], self.join])
        room, seen, out = sweeps(1), np.empty_like(near.segments), np.empty((3, 2))
        over = False
        most_made = len(moves.way) + 3 * (len(lines.poses) + 1)  # of one expansion
        while not over and tree.state[EXPANDED] < most:
            if time.perf_counter() >= end:
                break
            if tree.state[COUNT] + most_made > len(tree.cost):
                tree = _roomier(tree, most_made)
            until = min(most, int(tree.state[EXPANDED]) + CHUNK)
            over = grow(near, manner, guide, lines, grid, aim, tree, until, room, seen, out)
        node = int(tree.state[GOAL])
        path = traced(tree, node, POINTS) if node >= 0 else np.empty((0, 3))
        return path, int(tree.state[EXPANDED]), int(tree.state[COUNT]), over


def _rooted(start: Array, slots: NDArray[np.float32], anchors: int) -> Tree:
    """A tree of the start alone, open."""
    pose, numbers, none = np.empty((ROOM, 3)), np.zeros((4, ROOM)), np.full((2, ROOM), -1)
    pose[0] = start
    return Tree(
        pose, numbers[0], none[0], numbers[1], numbers[2], none[1], numbers[3],
        np.zeros(ROOM, np.int64), slots, np.full(anchors, -1.0), np.full(anchors + 1, np.inf),
        np.array([1, 1, 0, -1]),
    )  # fmt: skip


def _roomier(tree: Tree, more: int) -> Tree:
    """The tree with room for twice as many nodes, and so many more."""
    room, need = len(tree.cost), 2 * len(tree.cost) + more
    arrays = {}
    for name in ("pose", "cost", "parent", "way", "turn", "anchor", "keys", "items"):
        old = getattr(tree, name)
        arrays[name] = np.empty((need, *old.shape[1:]), old.dtype)
        arrays[name][:room] = old
    return tree._replace(**arrays)

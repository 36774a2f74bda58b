"""A lattice of manoeuvres: A* over x, y and yaw with the exact outline of a differential drive.

The disc round a wheelchair passes no ordinary door; its rectangle does. Moves are short arcs ahead
and back and pivots; costs are seconds, dearer near walls. States share a cell of position and
heading but keep their own continuous pose (hybrid A*: Dolgov et al. 2010).
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.exact import SpaceArrays, clearance
from planners.graphs.heap import pop, push
from planners.types import Plan, Problem, Status, trivial
from wheelchair_gym.config import setting, settings
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.kernel import kernel
from wheelchair_gym.kinematics import arc_step

Array = NDArray[np.float64]

FIELD = 0.05  # m: spacing of the field of distances
SAMPLE = 0.10  # m: spacing of points along the outline at which the field is read
MOVES = np.array(
    [  # curvature [1/m], way [m], turn [rad] (pivots only), time [s]
        (0.0, 0.2, 0.0, 0.29), (0.8, 0.2, 0.0, 0.34), (-0.8, 0.2, 0.0, 0.34),
        (1.6, 0.2, 0.0, 0.48), (-1.6, 0.2, 0.0, 0.48),
        (0.0, 0.0, 0.2, 0.35), (0.0, 0.0, -0.2, 0.35),
        (0.0, -0.2, 0.0, 1.3), (1.6, -0.2, 0.0, 1.4), (-1.6, -0.2, 0.0, 1.4),
    ]
)  # fmt: skip
TOP = 0.7  # m/s: no move is faster, so the way left over this bounds the time left


class Search(NamedTuple):
    """What a search is given, apart from start and goal."""

    field: Array  # (rows, columns) m: distance to what is solid, at the corners of cells
    origin: Array  # (2,) m
    left: Array  # (rows, columns) m: way left for the axle's centre; inf where there is none
    outline: Array  # (k, 2) m: points on the outline
    headings: int  # sectors of yaw that are told apart
    cell: float  # m: squares of position that are told apart
    margin: float  # m: least reading of the field on the outline
    wish: float  # m: reading beyond which more is worth nothing
    dear: float  # how many times dearer a move is at no clearance
    switch: float  # s: stopping and starting the other way
    nodes: int  # most states to make
    greed: float  # multiple of the time left that is believed
    near: float  # m: from where the goal is taken without a move


@kernel
def fill_field(arrays: SpaceArrays, origin: Array, field: Array) -> None:
    """Read the exact distances of a space at the corners of a grid."""
    for i in range(field.shape[0]):
        for j in range(field.shape[1]):
            x, y = origin[0] + j * FIELD, origin[1] + i * FIELD
            field[i, j] = clearance(arrays, x, y)


@kernel
def _read(field: Array, origin: Array, x: float, y: float) -> float:
    """Distance [m] at a point, interpolated; 0 off the field."""
    u, v = (x - origin[0]) / FIELD, (y - origin[1]) / FIELD
    j, i = math.floor(u), math.floor(v)
    if i < 0 or j < 0 or i >= field.shape[0] - 1 or j >= field.shape[1] - 1:
        return 0.0
    a, b = u - j, v - i
    low = (1.0 - a) * field[i, j] + a * field[i, j + 1]
    high = (1.0 - a) * field[i + 1, j] + a * field[i + 1, j + 1]
    reading: float = (1.0 - b) * low + b * high
    return reading


@kernel
def _least(search: Search, x: float, y: float, yaw: float, enough: float) -> float:
    """Least reading [m] on the outline at a pose, at most `enough`."""
    c, s = math.cos(yaw), math.sin(yaw)
    least = enough
    for k in range(search.outline.shape[0]):
        px, py = search.outline[k, 0], search.outline[k, 1]
        reading = _read(search.field, search.origin, x + c * px - s * py, y + s * px + c * py)
        if reading < least:
            least = reading
            if least < search.margin:
                break
    return least


@kernel
def ways_left(field: Array, radius: float, row: int, column: int, left: Array) -> None:
    """Fill `left` with the way [m] over grid corners from a goal, for a disc of a radius."""
    left[:] = np.inf
    rows, columns = field.shape
    heap = np.empty(8 * rows * columns, np.int64)
    keys = np.empty(8 * rows * columns)
    left[row, column] = 0.0
    push(keys, heap, 0, 0.0, row * columns + column)
    size = 1
    while size > 0:
        key = keys[0]
        item = pop(keys, heap, size)
        size -= 1
        i, j = item // columns, item % columns
        if key > left[i, j]:
            continue
        for di in range(-1, 2):
            for dj in range(-1, 2):
                r, c = i + di, j + dj
                if 0 <= r < rows and 0 <= c < columns and field[r, c] >= radius:
                    way = key + FIELD * math.hypot(di, dj)
                    if way < left[r, c] - 1e-12:
                        left[r, c] = way
                        push(keys, heap, size, way, r * columns + c)
                        size += 1


@kernel
def search_lattice(
    search: Search, moves: Array, start: Array, goal: Array
) -> tuple[int, int, Array, NDArray[np.int64], NDArray[np.int64]]:
    """Search from a pose to a point.

    Returns:
        The node at the goal (-1: none), the number of nodes, their poses (n, 3), parents (n,) and
        the moves (n,) that led to them.
    """
    field, origin = search.field, search.origin
    most = search.nodes
    pose = np.empty((most, 3))
    cost = np.empty(most)
    parent = np.full(most, -1)
    move = np.full(most, -1)
    columns = int(field.shape[1] * FIELD / search.cell) + 2
    rows = int(field.shape[0] * FIELD / search.cell) + 2
    best = np.full(rows * columns * search.headings, np.inf)
    heap = np.empty(most, np.int64)
    keys = np.empty(most)
    pose[0] = start
    cost[0] = 0.0
    push(keys, heap, 0, 0.0, 0)
    count, size = 1, 1
    while size > 0:
        node = pop(keys, heap, size)
        size -= 1
        x, y, yaw = pose[node, 0], pose[node, 1], pose[node, 2]
        if math.hypot(x - goal[0], y - goal[1]) <= search.near and (
            _least(search, goal[0], goal[1], yaw, search.wish) >= search.margin
        ):
            return node, count, pose, parent, move
        for m in range(moves.shape[0]):
            curvature, way, turn, seconds = moves[m, 0], moves[m, 1], moves[m, 2], moves[m, 3]
            ax, ay, ayaw = arc_step(x, y, yaw, way, way * curvature + turn, 1.0)
            i = int((ay - origin[1]) / search.cell)
            j = int((ax - origin[0]) / search.cell)
            if i < 0 or j < 0 or i >= rows or j >= columns:
                continue
            sector = math.floor(ayaw / (2.0 * math.pi) * search.headings + 0.5)
            slot = (i * columns + j) * search.headings + sector % search.headings
            before = move[node]
            if before >= 0 and (
                moves[before, 1] * way < 0.0 or (moves[before, 1] == 0.0) != (way == 0.0)
            ):
                seconds += search.switch
            if before >= 0:
                seconds += 0.03 * abs(moves[before, 0] - curvature)
            if cost[node] + seconds >= best[slot]:
                continue
            hi = min(field.shape[0] - 1, max(0, int((ay - origin[1]) / FIELD + 0.5)))
            hj = min(field.shape[1] - 1, max(0, int((ax - origin[0]) / FIELD + 0.5)))
            if not search.left[hi, hj] < np.inf:
                continue
            mx, my, myaw = arc_step(x, y, yaw, way, way * curvature + turn, 0.5)
            gap = _least(search, ax, ay, ayaw, search.wish)
            if gap < search.margin:
                continue
            gap = min(gap, _least(search, mx, my, myaw, search.wish))
            if gap < search.margin:
                continue
            short = (search.wish - gap) / search.wish
            total = cost[node] + seconds * (1.0 + search.dear * short * short)
            if total >= best[slot]:
                continue
            if count >= most or size >= most:
                return -1, count, pose, parent, move
            best[slot] = total
            pose[count, 0], pose[count, 1], pose[count, 2] = ax, ay, ayaw
            cost[count], parent[count], move[count] = total, node, m
            push(keys, heap, size, total + search.greed * search.left[hi, hj] / TOP, count)
            size += 1
            count += 1
    return -1, count, pose, parent, move


def outline_points(footprint: Footprint) -> Array:
    """Points (k, 2) on the outline, corners first, at most `SAMPLE` apart."""
    corners = footprint.corners
    parts = [corners]
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        count = math.ceil(float(np.hypot(*(b - a))) / SAMPLE)
        parts.append(a + (b - a) * (np.arange(1, count) / count)[:, None])
    return np.concatenate(parts)


@settings
class Lattice:
    """Manoeuvres for the chair's own outline; the path (n, 3) has headings, and may back up.

    The outline keeps the problem's clearance less half its width. The start's heading counts where
    it has one; the goal's does not.
    """

    footprint: Footprint = Footprint()
    headings: int = setting(default=32, source="11 deg, below every move's turn", low=8, high=360)
    cell: float = setting(default=0.10, unit="m", source="half a move", low=0.02)
    wish: float = setting(default=0.25, unit="m", source="play beside the chair in a 1.1 m door")
    dear: float = setting(default=3.0, source="tuned on training floor plans", low=0.0)
    switch: float = setting(default=0.8, unit="s", source="to stop and start again", low=0.0)
    greed: float = setting(default=1.3, source="more is faster and less good", low=1.0, high=10.0)
    nodes: int = setting(default=600_000, source="40 MB", low=10)
    near: float = setting(default=0.06, unit="m", source="a fraction of any tolerance", low=0.01)

    def plan(self, problem: Problem, rng: np.random.Generator) -> Plan:
        """See `Planner.plan`; nothing is drawn."""
        begun = time.perf_counter()
        # Points may come as near as they like; what is no number stays none.
        plan = trivial(replace(problem, clearance=0.0 * problem.clearance))
        if plan is not None:
            return plan
        arrays = problem.space.arrays
        margin = max(0.0, problem.clearance - self.footprint.half_width)
        start = np.zeros(3)
        start[: len(problem.start)] = problem.start
        goal = np.asarray(problem.goal, dtype=np.float64)[:2]
        low, high = arrays.bounds[:2], arrays.bounds[2:]
        # What no outline could do: its axle's centre alone is nearer than the margin.
        for end, status in ((start, Status.START_OCCUPIED), (goal, Status.GOAL_OCCUPIED)):
            if clearance(arrays, end[0], end[1]) < margin:
                return Plan(status)
        columns, rows = (np.ceil((high - low) / FIELD) + 1).astype(int)
        field, left = np.empty((rows, columns)), np.empty((rows, columns))
        fill_field(arrays, low, field)
        row, column = np.round((goal - low) / FIELD).astype(int)[::-1]
        ways_left(field, self.footprint.half_width - FIELD, row, column, left)
        search = Search(
            field, low, left, outline_points(self.footprint), self.headings, self.cell,
            math.hypot(margin, 0.5 * SAMPLE), self.wish, self.dear, self.switch, self.nodes,
            self.greed, self.near,
        )  # fmt: skip
        bare = search._replace(margin=0.0)  # no early end: the least reading itself
        least = float(_least(bare, start[0], start[1], start[2], self.wish))
        if least <= 0.0:
            return Plan(Status.START_OCCUPIED)
        # A start nearer to a wall than the margin may leave, at the clearance that it has.
        if least < search.margin:
            search = search._replace(margin=0.98 * least)
        node, count, pose, parent, move = search_lattice(search, MOVES, start, goal)
        spent = {"time_s": time.perf_counter() - begun}
        if node < 0:
            return Plan(Status.EXHAUSTED, counters={"nodes": int(count)}, timings=spent)
        path = [np.array([[*goal, pose[node, 2]]])]
        while parent[node] >= 0:
            curvature, way, turn, _ = MOVES[move[node]]
            x, y, yaw = pose[parent[node]]
            path.append(
                np.array(
                    [
                        arc_step(x, y, yaw, way, way * curvature + turn, t)
                        for t in (1, 0.75, 0.5, 0.25)
                    ]
                )
            )
            node = parent[node]
        path.append(start[None])
        spent = {"time_s": time.perf_counter() - begun}
        return Plan(
            Status.SOLVED, np.concatenate(path)[::-1].copy(), counters={"nodes": int(count)},
            timings=spent,
        )  # fmt: skip

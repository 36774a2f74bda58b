"""Exact cell decomposition: from cell to cell through the windows between them.

Vertical lines through all corners cut free space into cells. A cell lies between two boundary
segments, its floor and its ceiling, and between two vertical lines; it is convex. A window is where
two cells meet on such a line, even in one point.
"""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from planners.collision.polygon_tests import SpaceArrays, orient2d
from planners.graphs.roadmap import Pairs, shortest
from planners.problem import Plan, PlannerBase, Problem, Status, answer
from planners.smoothing.shortcut import shortcut
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.kernel import absorbed_kernel, borrowing_kernel, kernel

SLACK = 1e-9  # m: rounding may close windows; edges through them are tested exactly


@borrowing_kernel
def _rightward(segments: Array, k: int) -> tuple[float, float, float, float]:
    """Return a segment from its left end to its right end."""
    ax, ay, bx, by = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
    return (ax, ay, bx, by) if ax < bx else (bx, by, ax, ay)


@borrowing_kernel
def _height(segments: Array, k: int, x: float) -> float:
    """Return the height at which a segment crosses a vertical line [m]; exact at its ends."""
    ax, ay, bx, by = _rightward(segments, k)
    if x <= ax:
        return ay
    return by if x >= bx else ay + (x - ax) / (bx - ax) * (by - ay)


@borrowing_kernel
def _above(segments: Array, k: int, other: int) -> bool:
    """Return whether a segment that begins on the sweep line lies above one that crosses it."""
    ax, ay, bx, by = _rightward(segments, k)
    cx, cy, dx, dy = _rightward(segments, other)
    at = orient2d(cx, cy, dx, dy, ax, ay)
    if at != 0.0:
        return at > 0.0
    return (
        orient2d(cx, cy, dx, dy, bx, by) > 0.0
        if bx <= dx
        else orient2d(ax, ay, bx, by, dx, dy) < 0.0
    )


@borrowing_kernel
def _free_between(segments: Array, low: int, high: int) -> bool:
    """Return whether the space between two neighbouring segments on the line is free."""
    return bool(segments[low, 0] > segments[low, 2] and segments[high, 0] < segments[high, 2])


@absorbed_kernel
def _insert(segments: Array, active: Pairs, count: int, k: int) -> None:
    """Insert a segment that begins on the sweep line among `count` others, upwards."""
    low, high = 0, count
    while low < high:
        middle = (low + high) // 2
        if _above(segments, k, active[middle]):
            low = middle + 1
        else:
            high = middle
    for m in range(count, low, -1):
        active[m] = active[m - 1]
    active[low] = k


@kernel
def decompose(segments: Array, lines: Array, begin: Pairs) -> tuple[Pairs, Array, Pairs, Array]:
    """Sweep a line from left to right over the boundary (n, 4) [m], the solid on its left.

    Args:
        segments: the boundary.
        lines: x of all corners, ascending, once each [m].
        begin: segments that are not vertical, by their left ends.

    Returns:
        Floor and ceiling of each cell (c, 2), the lines (c, 2) [m] that bound it, the cells (w, 2)
        on either side of each window, and its x, low and high (w, 3) [m].
    """
    n, many = segments.shape[0], begin.shape[0]
    walls, spans = np.empty((n + 1, 2), dtype=np.int64), np.empty((n + 1, 2))
    sides, windows = np.empty((2 * n + 1, 2), dtype=np.int64), np.empty((2 * n + 1, 3))
    active = np.empty(many, dtype=np.int64)  # the segments that pass the line, upwards
    cell_on = np.full(n, -1, dtype=np.int64)  # the open cell over each floor
    kept = np.full(n, -1, dtype=np.int64)  # the last line at which a floor kept its cell
    before, meeting = np.empty(many, dtype=np.int64), np.empty(2 * many, dtype=np.int64)
    passing = opened_before = cells = found = next_begin = 0
    for event in range(lines.shape[0]):
        x = lines[event]
        left = 0  # segments that do not end here
        for m in range(passing):
            if _rightward(segments, active[m])[2] != x:
                active[left] = active[m]
                left += 1
        passing = left
        while next_begin < many and _rightward(segments, begin[next_begin])[0] == x:
            _insert(segments, active, passing, begin[next_begin])
            passing, next_begin = passing + 1, next_begin + 1
        # Cells that go on, that end here, and that begin here, upwards.
        opened = ending = 0
        for m in range(passing - 1):
            f, c = active[m], active[m + 1]
            on = cell_on[f]
            if on >= 0 and walls[on, 1] == c and _free_between(segments, f, c):
                kept[f] = event
        for m in range(opened_before):
            f = before[m]
            if kept[f] != event:
                spans[cell_on[f], 1] = x
                meeting[ending] = cell_on[f]
                ending += 1
                cell_on[f] = -1
        count = ending
        for m in range(passing - 1):
            f, c = active[m], active[m + 1]
            if _free_between(segments, f, c):
                before[opened] = f
                opened += 1
                if kept[f] != event:
                    if cells == walls.shape[0]:
                        walls = np.concatenate((walls, walls))
                        spans = np.concatenate((spans, spans))
                    walls[cells, 0], walls[cells, 1] = f, c
                    spans[cells, 0] = spans[cells, 1] = x
                    cell_on[f] = meeting[count] = cells
                    cells, count = cells + 1, count + 1
        opened_before = opened
        for p in range(count):
            for q in range(p + 1, count):
                a, b = meeting[p], meeting[q]
                top = _height(segments, walls[a, 1], x)
                low = max(_height(segments, walls[a, 0], x), _height(segments, walls[b, 0], x))
                high = min(top, _height(segments, walls[b, 1], x))
                if low <= high + SLACK:
                    if found == sides.shape[0]:
                        sides = np.concatenate((sides, sides))
                        windows = np.concatenate((windows, windows))
                    sides[found, 0], sides[found, 1] = a, b
                    windows[found, 0], windows[found, 1], windows[found, 2] = x, low, max(low, high)
                    found += 1
                elif q >= ending and low > top + SLACK:
                    break  # cells that begin here come from low to high
    return walls[:cells], spans[:cells], sides[:found], windows[:found]


@kernel
def cells_at(arrays: SpaceArrays, walls: Pairs, spans: Array, x: float, y: float) -> Pairs:
    """Return the cells that hold a point [m]; several where they meet."""
    found = np.empty(walls.shape[0], dtype=np.int64)
    count = 0
    for cell in range(walls.shape[0]):
        if spans[cell, 0] <= x <= spans[cell, 1]:
            ax, ay, bx, by = _rightward(arrays.segments, walls[cell, 0])
            cx, cy, dx, dy = _rightward(arrays.segments, walls[cell, 1])
            if orient2d(ax, ay, bx, by, x, y) >= 0.0 and orient2d(cx, cy, dx, dy, x, y) <= 0.0:
                found[count] = cell
                count += 1
    return found[:count]


def pairs_in_cells(sides: Pairs, start_in: Pairs, goal_in: Pairs, per: int) -> Pairs:
    """Return the pairs of nodes (k, 2) in one cell: start, goal, then `per` of each window."""
    of_windows = 2 + np.arange(per * len(sides)).reshape(-1, 1, per)  # (windows, 1, per)
    nodes = np.concatenate([
        np.full(len(start_in), 0), np.full(len(goal_in), 1),
        np.repeat(of_windows, 2, axis=1).ravel(),
    ])  # fmt: skip
    cell = np.concatenate([start_in, goal_in, np.repeat(sides.ravel(), per)])
    order = np.argsort(cell, kind="stable")
    place = np.arange(len(order))
    after = np.searchsorted(cell[order], cell[order], side="right") - place - 1  # in the same cell
    p = np.repeat(place, after)
    q = p + 1 + np.arange(len(p)) - np.repeat(np.cumsum(after) - after, after)
    pairs = nodes[order][np.stack([p, q], axis=1)]
    different: Pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    return different


WINDOW_NODES = 3  # middle, low and high end: paths bend at corners, which are ends of windows


@settings
class CellDecomposition(PlannerBase):
    """Vertical cell decomposition (Chazelle 1987; Latombe 1991): complete and quick.

    It proves that there is no path. The path is the shortest through the middles and the ends of
    the windows between cells, straightened.
    """

    shortcut: bool = setting(default=True, source="straighten the path, which is never longer then")
    """Whether the path is straightened."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Find a path, within a deadline [s] if there is one; the generator is not used."""
        arrays, segments = problem.free.arrays, problem.free.arrays.segments
        ends = np.array([problem.start[:2], problem.goal[:2]], dtype=np.float64)
        across = np.flatnonzero(segments[:, 0] != segments[:, 2])
        begin = across[np.argsort(segments[across][:, [0, 2]].min(axis=1), kind="stable")]
        walls, spans, sides, windows = decompose(segments, np.unique(segments[:, [0, 2]]), begin)
        cells = len(walls)
        start_in, goal_in = (cells_at(arrays, walls, spans, *point) for point in ends)
        x, low, high = windows.T
        corners = np.stack([x, 0.5 * (low + high), x, low, x, high], axis=1).reshape(-1, 2)
        pairs = pairs_in_cells(sides, start_in, goal_in, WINDOW_NODES)
        path, tested, in_time = shortest(arrays, np.vstack([ends, corners]), pairs, end)
        failure, note = Status.EXHAUSTED, "out of time"
        if len(path):
            path = shortcut(path, problem.free) if self.shortcut else path
        elif in_time:
            links = coo_array((np.ones(len(sides)), sides.T), shape=(cells, cells))
            _, part = connected_components(links, directed=False)
            note = "too narrow for the precision of coordinates"
            if not np.isin(part[start_in], part[goal_in]).any():
                failure, note = Status.NO_PATH, "start and goal lie in separate parts of free space"
        counters = {"cells": cells, "windows": len(sides), "edges_tested": tested}
        return answer(path, counters, note, failure)

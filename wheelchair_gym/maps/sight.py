"""Lengths of shortest ways over free cells, from what each of their bends sees.

A shortest way bends only at gates: free cells beside an outer corner of what is blocked. So the
goal lights all that it sees; then gate after gate, the nearest to the goal first, lights what lies
in the shadow of its corner (Dijkstra's search of the visibility graph, whose edges nobody lists).
Light falls row by row through the runs of free cells, as in Anya (Harabor et al. 2016), and ends
where it brings nothing shorter.

Coordinates are in cells from the centre of cell (0, 0): x along columns, y along rows.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.kernel import borrowing_kernel, kernel

Field = NDArray[np.float32]
Index = NDArray[np.int32]
Mask = NDArray[np.bool_]

_HALF = 0.501  # of a cell and a touch: a line may graze corners
_GAIN = 0.01  # cells; a gate waits again only for a way shorter by this
# A line passes corners half a cell nearer than gates stand, so right behind a gate others may do
# better than the gate, and yet not farther on: light that comes late by no more than the slack goes
# on, and all light does over its first rows. (20,000 mazes: one cell was left dark.)
_SLACK = 0.8  # cells
_NEAR = 6.0  # rows


class Ground(NamedTuple):
    """Free cells row by row, as runs, and the gates among them."""

    run: Index  # (rows + 1,): the first run of each row
    first: Index  # (runs,): its first column
    last: Index
    gate: Index  # (rows + 1,): the first gate of each row
    row: Index  # (gates,)
    col: Index
    east: Index  # (gates,): 1 or -1; the blocked corner lies in this column beside it ...
    north: Index  # ... and in this row


class Queue(NamedTuple):
    """Gates that wait, as a heap with the shortest way on top."""

    heap: Index  # (gates,)
    place: Index  # (gates,): of each in the heap, -1 if it is not there
    way: Field  # (gates,): the shortest so far
    root: Index  # (gates,): the bend that lit it
    size: Index  # (1,)


class Bends(NamedTuple):
    """Where ways bend; the first is the goal."""

    x: Field
    y: Field
    way: Field  # from there to the goal
    next: Index  # the bend after it


class Light(NamedTuple):
    """Wedges that have still to fall into the next row."""

    row: Index
    low: NDArray[np.float64]  # slopes: columns per row
    high: NDArray[np.float64]
    first: Index  # the run that it comes from
    last: Index


class Beam(NamedTuple):
    """What a bend sees on one side of its row, and how much of that is news."""

    north: int  # 1 towards higher rows, -1 towards lower ones
    low: float  # slopes between which it shines [columns per row]
    high: float
    shadow: int  # 1: news only east of an edge; -1: only west of it; 0: everywhere
    edge: float  # where the edge crosses the bend's own row
    drift: float  # its slope


@kernel
def _ground(free: Mask) -> Ground:
    """The runs of a map's free cells, and its gates."""
    rows, cols = free.shape
    count = 0
    for row in range(rows):
        count += int(free[row, 0])
        for col in range(1, cols):
            count += int(free[row, col] and not free[row, col - 1])
    run, gate = np.zeros(rows + 1, np.int32), np.zeros(rows + 1, np.int32)
    first, last = np.empty(count, np.int32), np.empty(count, np.int32)
    k = 0
    for row in range(rows):
        run[row] = k
        col = 0
        while col < cols:
            while col < cols and not free[row, col]:
                col += 1
            if col < cols:
                first[k] = col
                while col < cols and free[row, col]:
                    col += 1
                last[k] = col - 1
                k += 1
    run[rows] = k
    at_row, at_col = np.empty(4 * count, np.int32), np.empty(4 * count, np.int32)
    east, north = np.empty(4 * count, np.int32), np.empty(4 * count, np.int32)
    m = 0
    for row in range(rows):
        gate[row] = m
        for side in (-1, 1):
            beside = row + side
            if beside < 0 or beside >= rows:
                continue
            for k in range(run[beside], run[beside + 1]):
                for way in (-1, 1):
                    col = last[k] if way > 0 else first[k]
                    if 0 <= col + way < cols and free[row, col] and free[row, col + way]:
                        at_row[m], at_col[m], east[m], north[m] = row, col, way, side
                        m += 1
    gate[rows] = m
    return Ground(run, first, last, gate, at_row[:m], at_col[:m], east[:m], north[:m])


@borrowing_kernel
def _enqueue(queue: Queue, gate: int, way: float, root: int) -> None:
    """Let a gate wait, or move it up, for a shorter way."""
    queue.way[gate] = way
    queue.root[gate] = root
    k = queue.place[gate]
    if k < 0:
        k = queue.size[0]
        queue.size[0] += 1
    while k > 0:
        above = queue.heap[(k - 1) // 2]
        if queue.way[above] <= way:
            break
        queue.heap[k] = above
        queue.place[above] = k
        k = (k - 1) // 2
    queue.heap[k] = gate
    queue.place[gate] = k


@borrowing_kernel
def _dequeue(queue: Queue) -> int:
    """The gate with the shortest way."""
    top = queue.heap[0]
    queue.place[top] = -1
    queue.size[0] -= 1
    count = queue.size[0]
    if count > 0:
        moved = queue.heap[count]
        k = 0
        while 2 * k + 1 < count:
            below = 2 * k + 1
            other = min(below + 1, count - 1)
            if queue.way[queue.heap[other]] < queue.way[queue.heap[below]]:
                below = other
            if queue.way[queue.heap[below]] >= queue.way[moved]:
                break
            queue.heap[k] = queue.heap[below]
            queue.place[queue.heap[k]] = k
            k = below
        queue.heap[k] = moved
        queue.place[moved] = k
    return int(top)


@borrowing_kernel
def _light(
    ground: Ground, queue: Queue, bends: Bends, root: int, length: Field, row: int, a: int, b: int
) -> tuple[int, int]:
    """Light the columns a to b of a row; the first and last where that is not too late."""
    line = length[row]
    x, way = bends.x[root], bends.way[root]
    rise = np.float32(row) - bends.y[root]
    square = rise * rise
    while a <= b:
        dx = np.float32(a) - x
        if way + math.sqrt(square + dx * dx) < line[a] + np.float32(_SLACK):
            break
        a += 1
    if a > b:
        return a, b
    while True:
        dx = np.float32(b) - x
        if way + math.sqrt(square + dx * dx) < line[b] + np.float32(_SLACK):
            break
        b -= 1
    for col in range(a, b + 1):
        dx = np.float32(np.int32(col)) - x
        here = way + np.sqrt(square + dx * dx)
        if here < line[col]:
            line[col] = here
    for k in range(ground.gate[row], ground.gate[row + 1]):
        col = ground.col[k]
        if a <= col <= b:
            dx = np.float32(col) - x
            here = way + np.sqrt(square + dx * dx)
            if here <= line[col] and here < queue.way[k] - np.float32(_GAIN):
                _enqueue(queue, k, here, root)
    return a, b


@borrowing_kernel
def _run_at(ground: Ground, row: int, col: int) -> int:
    """The run that holds a free cell."""
    k = ground.run[row]
    while ground.last[k] < col:
        k += 1
    return int(k)


@borrowing_kernel
def _shine(
    ground: Ground, queue: Queue, bends: Bends, root: int, length: Field, light: Light, beam: Beam
) -> bool:
    """Let a bend shine on one side of its row; whether that lit anything.

    Within a row's strip of height 1 a line stays in its run if it enters and leaves within it.
    """
    x, y, north = float(bends.x[root]), float(bends.y[root]), beam.north
    row = math.floor(y + 0.5)
    k = _run_at(ground, row, math.floor(x + 0.5))
    near = max(0.5 + north * (row - y), 1e-3)  # to the edge of its own row
    light.row[0] = row + north
    light.low[0] = max(beam.low, (ground.first[k] - _HALF - x) / near)
    light.high[0] = min(beam.high, (ground.last[k] + _HALF - x) / near)
    light.first[0], light.last[0] = ground.first[k], ground.last[k]
    count, lit = 1, False
    while count > 0:
        count -= 1
        row, low, high = int(light.row[count]), light.low[count], light.high[count]
        first, last = light.first[count], light.last[count]
        if row < 0 or row >= length.shape[0]:
            continue
        middle = north * (row - y)
        enter, leave = max(middle - 0.5, 1e-3), middle + 0.5
        west, east, edge = x + low * enter, x + high * enter, beam.edge + beam.drift * middle
        for k in range(ground.run[row], ground.run[row + 1]):
            a, b = ground.first[k], ground.last[k]
            if b + _HALF < west:
                continue
            if a - _HALF > east:
                break
            if a > last or b < first:  # they touch at a corner only
                continue
            left = max(low, (a - _HALF - x) / enter)
            right = min(high, (b + _HALF - x) / enter)
            begin = max(a, math.ceil(x + left * middle - 1e-6))
            end = min(b, math.floor(x + right * middle + 1e-6))
            if beam.shadow > 0:
                begin = max(begin, math.floor(edge))
            elif beam.shadow < 0:
                end = min(end, math.ceil(edge))
            if begin <= end:
                one, other = _light(ground, queue, bends, root, length, row, begin, end)
                if one <= other:
                    lit = True
                    if one > begin:
                        left = max(left, (one - 2 - x) / middle)
                    if other < end:
                        right = min(right, (other + 2 - x) / middle)
                elif middle > _NEAR:
                    continue
            left = max(left, (a - _HALF - x) / leave)
            right = min(right, (b + _HALF - x) / leave)
            if left <= right:
                light.row[count] = row + north
                light.low[count], light.high[count] = left, right
                light.first[count], light.last[count] = a, b
                count += 1
    return lit


@kernel
def spread(free: Mask, goal_x: float, goal_y: float, row: int, col: int) -> tuple[Field, Bends]:
    """Lengths (rows, cols) [cells] of the shortest ways to the goal, and where they bend.

    Args:
        free: cells (rows, cols) that may be entered.
        goal_x: the goal, in the free cell (row, col) or beside it.
        goal_y: see goal_x.
        row: the free cell by which the goal is entered.
        col: see row.
    """
    length = np.full(free.shape, np.inf, np.float32)
    ground = _ground(free)
    gates, runs = len(ground.col), len(ground.first)
    queue = Queue(
        np.empty(gates, np.int32),
        np.full(gates, -1, np.int32),
        np.full(gates, np.inf, np.float32),
        np.zeros(gates, np.int32),
        np.zeros(1, np.int32),
    )
    bends = Bends(
        np.empty(gates + 1, np.float32),
        np.empty(gates + 1, np.float32),
        np.empty(gates + 1, np.float32),
        np.empty(gates + 1, np.int32),
    )
    light = Light(  # each wedge but one has its own run, or comes from a gap between two
        np.empty(runs + 2, np.int32),
        np.empty(runs + 2),
        np.empty(runs + 2),
        np.empty(runs + 2, np.int32),
        np.empty(runs + 2, np.int32),
    )
    turns = np.zeros(gates + 1, np.int8)  # 1 to the left, -1 to the right, 0 at the goal
    bends.x[0], bends.y[0], bends.way[0], bends.next[0] = goal_x, goal_y, 0.0, -1
    if math.floor(goal_x + 0.5) != col or math.floor(goal_y + 0.5) != row:
        bends.x[0], bends.y[0] = col, row
        bends.way[0] = math.hypot(col - goal_x, row - goal_y)
    k = _run_at(ground, row, col)
    _light(ground, queue, bends, 0, length, row, ground.first[k], ground.last[k])
    for north in (-1, 1):
        beam = Beam(north, -np.inf, np.inf, 0, 0.0, 0.0)
        _shine(ground, queue, bends, 0, length, light, beam)
    count = 1
    while queue.size[0] > 0:
        gate = _dequeue(queue)
        root = queue.root[gate]
        row, col = int(ground.row[gate]), int(ground.col[gate])
        east, up = ground.east[gate], ground.north[gate]
        # Up to the edge, the line from its own root by the corner, others have lit the ground. A
        # root that turned the other way lit nothing beyond the gate itself.
        x, y = float(bends.x[root]), float(bends.y[root])
        turn = 1 if (col - x) * up > (row - y) * east else -1
        past = 0.0 if turns[root] == -turn else 1.0
        ex, ey = col + past * _HALF * east - x, row + past * 0.5 * up - y
        if ex * up == ey * east:  # straight at the corner: nothing to turn round
            continue
        bends.x[count], bends.y[count] = col, row
        bends.way[count], bends.next[count] = queue.way[gate], root
        turns[count] = turn
        edge = col + past * (_HALF * east - 0.5 * up * ex / ey)
        # It shines from along the edge round to the corner: perhaps over its row, on this side.
        side = 1 if ex + east * abs(ey) > 0.0 else -1
        lit = False
        if ey * up < 0.0:
            k = _run_at(ground, row, col)
            begin, end = int(ground.first[k]), int(ground.last[k])
            if side > 0:
                begin = max(begin, math.floor(edge))
            else:
                end = min(end, math.ceil(edge))
            one, other = _light(ground, queue, bends, count, length, row, begin, end)
            lit = one <= other
        for north in (-1, 1):
            ahead, beside = ey * north > 0.0, up * north > 0
            if not (ahead or beside):
                continue
            straight, corner, shadow = side * np.inf, side * np.inf, 0
            if beside:
                corner = float(east)
            if ahead:
                straight = ex / abs(ey)
                shadow = 1 if corner > straight else -1
            low, high = min(straight, corner), max(straight, corner)
            beam = Beam(north, low, high, shadow, edge, straight if ahead else 0.0)
            if _shine(ground, queue, bends, count, length, light, beam):
                lit = True
        if lit:
            count += 1
    few = Bends(
        bends.x[:count].copy(),
        bends.y[:count].copy(),
        bends.way[:count].copy(),
        bends.next[:count].copy(),
    )
    return length, few


@kernel
def nearest_bend(free: Mask, bends: Bends, x: float, y: float) -> int:
    """The bend by which the way from a point is the shortest, of those that it sees; or -1."""
    best, least = -1, math.inf
    for k in range(len(bends.x)):
        dx, dy = bends.x[k] - x, bends.y[k] - y
        far = math.hypot(dx, dy)
        if bends.way[k] + far >= least:
            continue
        steps = int(5.0 * far) + 1
        clear = True
        for i in range(steps + 1):
            px, py = x + dx * i / steps, y + dy * i / steps
            clear = False  # corners may be grazed
            for dr in (-0.05, 0.05):
                for dc in (-0.05, 0.05):
                    clear |= free[math.floor(py + dr + 0.5), math.floor(px + dc + 0.5)]
            if not clear:
                break
        if clear:
            best, least = k, bends.way[k] + far
    return best

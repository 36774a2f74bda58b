"""Shortest paths round obstacles to a goal, for guidance, solvability and SPL.

A shortest path bends only at gates: free cells beside an outer corner of blocked cells. The cells
visible from the goal have straight paths. Then gate after gate, the nearest to the goal first,
gives paths to the cells that are hidden behind its corner: Dijkstra's search of the visibility
graph, without a list of its edges. Visibility spreads row by row through the runs of free cells, as
in Anya (Harabor et al. 2016), and ends where no path becomes shorter.

Coordinates in kernels are in cells from the centre of cell (0, 0): x along columns, y along rows.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.base.arrays import Array, Mask
from wheelchair_gym.compiled.address import read_record
from wheelchair_gym.compiled.kernel import as_int, borrowing_kernel, kernel
from wheelchair_gym.maps.distance import extend_field, rows_equal
from wheelchair_gym.maps.grid import OccupancyGrid

Index = NDArray[np.int32]
Records = NDArray[np.void]

RUN = np.dtype([("first", np.int32), ("last", np.int32)])  # columns
GATE = read_record("GATE", globals())[0]


class Terrain(NamedTuple):
    """Free cells row by row, as runs, and the gates among them."""

    run: Index  # (rows + 1,): the first run of each row
    runs: Records
    gate: Index  # (rows + 1,): the first gate of each row
    gates: Records


@kernel
def terrain_of(free: Mask) -> Terrain:
    """Find the runs of a map's free cells, and its gates."""
    rows, cols = free.shape
    cells = free.view(np.int8)
    run, gate = np.zeros(rows + 1, np.int32), np.zeros(rows + 1, np.int32)
    same = np.zeros(rows, np.bool_)  # rows equal to the one below
    runs = np.empty(rows * ((cols + 1) // 2), RUN)  # the greatest number possible
    k = 0
    for row in range(rows):
        run[row] = k
        same[row] = row > 0 and rows_equal(cells[row], cells[row - 1])
        if same[row]:
            for other in range(run[row - 1], run[row]):
                runs[k].first, runs[k].last = runs[other].first, runs[other].last
                k += 1
            continue
        col = 0
        while col < cols:
            while col < cols and not free[row, col]:
                col += 1
            if col < cols:
                runs[k].first = col
                while col < cols and free[row, col]:
                    col += 1
                runs[k].last = col - 1
                k += 1
    run[rows] = k
    gates = np.empty(4 * k, GATE)
    m = 0
    for row in range(rows):
        gate[row] = m
        for side in (-1, 1):
            beside = row + side
            if beside < 0 or beside >= rows or same[max(row, beside)]:
                continue
            for k in range(run[beside], run[beside + 1]):
                for way in (-1, 1):
                    col = runs[k].last if way > 0 else runs[k].first
                    if 0 <= col + way < cols and free[row, col] and free[row, col + way]:
                        gates[m].row, gates[m].col = row, col
                        gates[m].east, gates[m].north = way, side
                        gates[m].way, gates[m].place = np.inf, 0
                        m += 1
    gate[rows] = m
    return Terrain(run, runs[: run[rows]], gate, gates[:m])


@borrowing_kernel
def enqueue(gates: Records, queue: Index, gate: int) -> None:
    """Add a gate to the queue (a heap; queue[0] is its length), or move it up there."""
    way, k = gates[gate].way, gates[gate].place
    if k == 0:
        queue[0] += 1
        k = queue[0]
    while k > 1:
        above = queue[k // 2]
        if gates[above].way <= way:
            break
        queue[k] = above
        gates[above].place = k
        k //= 2
    queue[k] = gate
    gates[gate].place = k


@borrowing_kernel
def dequeue(gates: Records, queue: Index) -> int:
    """Take the gate with the shortest path."""
    top, count = queue[1], queue[0] - 1
    gates[top].place = 0
    queue[0] = count
    if count > 0:
        moved = queue[count + 1]
        k = 1
        while 2 * k <= count:
            below, other = 2 * k, min(2 * k + 1, count)
            if gates[queue[other]].way < gates[queue[below]].way:
                below = other
            if gates[queue[below]].way >= gates[moved].way:
                break
            queue[k] = queue[below]
            gates[queue[k]].place = k
            k = below
        queue[k] = moved
        gates[moved].place = k
    return int(top)


@borrowing_kernel
def run_at(terrain: Terrain, row: int, col: int) -> int:
    """Return the run that holds a free cell."""
    k = terrain.run[row]
    while terrain.runs[k].last < col:
        k += 1
    return int(k)


Field = NDArray[np.float32]

_HALF = 0.501  # of a cell and a touch: a line may graze corners
_GAIN = 0.01  # cells; a gate is queued again only for a path shorter by this
_CUT = 0.1  # cells that bending behind a corner, not before it, must gain
# A line passes corners half a cell nearer than gates stand, so right behind a gate other paths may
# be shorter, but not farther on: a sweep goes on over its first rows, and while its paths are
# longer by no more than the slack. (In 20,000 mazes one cell was not reached.)
_SLACK = 0.8  # cells
_NEAR = 6.0  # rows


_BEND = read_record("_BEND", globals())[0]
_WEDGE = read_record("_WEDGE", globals())[0]


class Sector(NamedTuple):
    """The part of the map that is visible from a bend on one side of its row."""

    north: int  # 1 towards higher rows, -1 towards lower ones
    low: float  # slopes that bound it [columns per row]
    high: float
    shadow: int  # 1: only east of an edge; -1: only west of it; 0: everywhere
    edge: float  # where the edge crosses the bend's own row
    drift: float  # its slope


@borrowing_kernel
def _relax(
    terrain: Terrain,
    queue: Index,
    bends: Records,
    root: int,
    length: Field,
    row: int,
    a: int,
    b: int,
) -> tuple[int, int]:
    """Shorten paths from columns a to b of a row; returns the first and last within the slack."""
    line = length[row]
    x, way = bends[root].x, bends[root].way
    rise = np.float32(row) - bends[root].y
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
    part, begin = line[a : b + 1], np.float32(a) - x
    for k in range(len(part)):
        dx = np.float32(np.int32(k)) + begin
        here = way + math.sqrt(square + dx * dx)
        part[k] = here if here < part[k] else part[k]
    for k in range(terrain.gate[row], terrain.gate[row + 1]):
        gate = terrain.gates[k]
        if a <= gate.col <= b:
            dx = np.float32(gate.col) - x
            here = way + math.sqrt(square + dx * dx)
            if here < line[gate.col] + np.float32(_GAIN) and here < gate.way - np.float32(_GAIN):
                gate.way, gate.root = here, root
                enqueue(terrain.gates, queue, k)
    return a, b


@borrowing_kernel
def _sweep(
    terrain: Terrain,
    queue: Index,
    bends: Records,
    root: int,
    length: Field,
    wedges: Records,
    sector: Sector,
) -> bool:
    """Sweep the cells visible from a bend on one side of its row; whether any path got shorter.

    Within a row's strip of height 1 a line stays in its run if it enters and leaves within it.
    """
    x, y, north = float(bends[root].x), float(bends[root].y), sector.north
    row = math.floor(y + 0.5)
    run = terrain.runs[run_at(terrain, row, math.floor(x + 0.5))]
    near = max(0.5 + north * (row - y), 1e-3)  # to the edge of its own row
    wedges[0].row, wedges[0].first, wedges[0].last = row + north, run.first, run.last
    wedges[0].low = max(sector.low, (run.first - _HALF - x) / near)
    wedges[0].high = min(sector.high, (run.last + _HALF - x) / near)
    count, improved = 1, False
    while count > 0:
        count -= 1
        row, first, last = as_int(wedges[count].row), wedges[count].first, wedges[count].last
        low, high = wedges[count].low, wedges[count].high
        if row < 0 or row >= length.shape[0]:
            continue
        middle = north * (row - y)
        enter, leave = max(middle - 0.5, 1e-3), middle + 0.5
        west, east, edge = x + low * enter, x + high * enter, sector.edge + sector.drift * middle
        for k in range(terrain.run[row], terrain.run[row + 1]):
            a, b = as_int(terrain.runs[k].first), as_int(terrain.runs[k].last)
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
            if sector.shadow > 0:
                begin = max(begin, math.floor(edge))
            elif sector.shadow < 0:
                end = min(end, math.ceil(edge))
            if begin <= end:
                one, other = _relax(terrain, queue, bends, root, length, row, begin, end)
                improved = improved or one <= other
                if middle > _NEAR:
                    if one > other:
                        continue
                    if one > begin:
                        left = max(left, (one - 2 - x) / middle)
                    if other < end:
                        right = min(right, (other + 2 - x) / middle)
            left = max(left, (a - _HALF - x) / leave)
            right = min(right, (b + _HALF - x) / leave)
            if left <= right:
                wedges[count].row, wedges[count].first, wedges[count].last = row + north, a, b
                wedges[count].low, wedges[count].high = left, right
                count += 1
    return improved


@kernel
def spread(free: Mask, goal_x: float, goal_y: float, row: int, col: int) -> tuple[Field, Records]:
    """Compute lengths (rows, cols) [cells] of the shortest paths to the goal, and their bends."""
    length = np.full(free.shape, np.inf, np.float32)
    terrain = terrain_of(free)
    gates, runs = terrain.gates, terrain.runs
    queue = np.zeros(len(gates) + 1, np.int32)
    bends = np.empty(len(gates) + 1, _BEND)
    # Each wedge on the stack has its own run, or comes from a gap between two.
    wedges = np.empty(len(runs) + 2, _WEDGE)
    bends[0].x, bends[0].y, bends[0].way = goal_x, goal_y, 0.0
    bends[0].next, bends[0].turn = -1, 0
    if math.floor(goal_x + 0.5) != col or math.floor(goal_y + 0.5) != row:
        bends[0].x, bends[0].y = col, row
        bends[0].way = math.hypot(col - goal_x, row - goal_y)
    k = run_at(terrain, row, col)
    first, last = as_int(runs[k].first), as_int(runs[k].last)
    count = as_int(0)
    _relax(terrain, queue, bends, count, length, row, first, last)
    for north in (-1, 1):
        sector = Sector(north, -np.inf, np.inf, 0, 0.0, 0.0)
        _sweep(terrain, queue, bends, count, length, wedges, sector)
    count += 1
    while queue[0] > 0:
        gate = gates[dequeue(gates, queue)]
        row, col = as_int(gate.row), as_int(gate.col)
        east, up = as_int(gate.east), as_int(gate.north)
        # Up to the edge, the line from its root by the corner, the root's own paths are as short. A
        # root that turned the other way has no paths beyond the gate itself.
        root = bends[gate.root]
        x, y = float(root.x), float(root.y)
        turn = 1 if (col - x) * up > (row - y) * east else -1
        past = 0.0 if root.turn == -turn else 1.0
        ex, ey = col + past * _HALF * east - x, row + past * 0.5 * up - y
        if ex * up == ey * east:  # straight at the corner: no bend
            continue
        edge = col + past * (_HALF * east - 0.5 * up * ex / ey)
        corner_slope, way = float(east), gate.way
        # The path bends one cell on, behind the corner, if that is shorter from its root.
        upright = turn != east * up
        if (ey * up if upright else ex * east) > 0.0:
            r, c = (row + up, col) if upright else (row, col + east)
            seen = np.float32(root.way + math.hypot(c - x, r - y))
            if seen < way + 1.0 - _CUT and abs(length[r, c] - seen) < _GAIN:
                row, col, way = r, c, seen
                if upright:
                    edge += ex / abs(ey)
                    corner_slope = east * np.inf
        bends[count].x, bends[count].y, bends[count].way = col, row, way
        bends[count].next, bends[count].turn = gate.root, turn
        # It sees from along the edge round to the corner: perhaps over its row, on this side.
        side = 1 if ex + east * abs(ey) > 0.0 else -1
        improved = False
        if ey * up < 0.0:
            k = run_at(terrain, row, col)
            begin, end = as_int(runs[k].first), as_int(runs[k].last)
            if side > 0:
                begin = max(begin, math.floor(edge))
            else:
                end = min(end, math.ceil(edge))
            one, other = _relax(terrain, queue, bends, count, length, row, begin, end)
            improved = one <= other
        for north in (-1, 1):
            ahead, beside = ey * north > 0.0, up * north > 0
            if not (ahead or beside):
                continue
            straight, corner, shadow = side * np.inf, side * np.inf, 0
            if beside:
                corner = corner_slope
            if ahead:
                straight = ex / abs(ey)
                shadow = 1 if corner > straight else -1
            low, high = min(straight, corner), max(straight, corner)
            sector = Sector(north, low, high, shadow, edge, straight if ahead else 0.0)
            if _sweep(terrain, queue, bends, count, length, wedges, sector):
                improved = True
        if improved:
            count += 1
    return length, bends[:count].copy()


@kernel
def nearest_bend(free: Mask, bends: Records, x: float, y: float) -> int:
    """Return the visible bend with the shortest path from a point; or -1."""
    best, minimum = -1, math.inf
    top, right = free.shape[0] - 1, free.shape[1] - 1
    for k in range(len(bends)):
        dx, dy = bends[k].x - x, bends[k].y - y
        far = math.hypot(dx, dy)
        if bends[k].way + far >= minimum:
            continue
        steps = int(5.0 * far) + 1
        clear = True
        for i in range(steps + 1):
            px, py = x + dx * i / steps, y + dy * i / steps
            clear = False  # corners may be grazed, and the map's rim
            for dr in (-0.05, 0.05):
                for dc in (-0.05, 0.05):
                    row, col = math.floor(py + dr + 0.5), math.floor(px + dc + 0.5)
                    clear |= free[min(max(row, 0), top), min(max(col, 0), right)]
            if not clear:
                break
        if clear:
            best, minimum = k, bends[k].way + far
    return best


_MARGIN = 1.5  # cells beyond the radius in which a point still counts as beside reachable ground


@kernel
def interpolate(field: Field, x: float, y: float) -> float:
    """Interpolate a field at a point [cells from the lower-left corner] over finite cells."""
    rows, cols = field.shape
    if not (-1.0 <= x <= cols + 1.0 and -1.0 <= y <= rows + 1.0):
        return math.inf
    x = min(max(x - 0.5, 0.0), cols - 1.0)
    y = min(max(y - 0.5, 0.0), rows - 1.0)
    col, row = min(int(x), max(cols - 2, 0)), min(int(y), max(rows - 2, 0))
    total, weights = 0.0, 0.0
    for r in range(row, min(row + 2, rows)):
        for c in range(col, min(col + 2, cols)):
            weight = (1.0 - abs(x - c)) * (1.0 - abs(y - r))
            if weight > 0.0 and field[r, c] < math.inf:
                total += weight * field[r, c]
                weights += weight
    return total / weights if weights > 0.0 else math.inf


@kernel
def _interpolated(field: Field, points: Array) -> Array:
    out = np.empty(points.shape[0])
    for k in range(points.shape[0]):
        out[k] = interpolate(field, points[k, 0], points[k, 1])
    return out


@dataclass(frozen=True, eq=False)
class Geodesic:
    """Shortest paths of a disc to one goal: lengths everywhere, and the path from any start.

    It keeps one field and the bends of all paths.
    """

    grid: OccupancyGrid
    goal: Array  # (2,) m
    radius: float  # m
    extended: Field  # (rows, cols) m; it extends a radius and more into cells near obstacles
    _bends: Records

    @property
    def field(self) -> Field:
        """Lengths (rows, cols) [m] that end where the disc does not fit; infinite beyond."""
        length, _ = _lengths(self.grid, self.goal, self.radius)
        return length * np.float32(self.grid.resolution)

    def at(self, points: ArrayLike) -> Array:
        """Return the length of the shortest path [m] from points (..., 2) [m].

        A point slightly too near an obstacle counts from the nearest reachable cell; far from
        reachable ground the length is infinite.
        """
        lattice = self.grid.to_lattice(points)
        return _interpolated(self.extended, lattice.reshape(-1, 2)).reshape(lattice.shape[:-1])

    def path(self, start: ArrayLike) -> Array:
        """Return the shortest path (n, 2) [m] from a start (2,) [m]; empty if there is none."""
        place = np.asarray(start, dtype=np.float64)[:2]
        if not (self.grid.inside(place) and np.isfinite(self.at(place))):
            return np.empty((0, 2))
        free = self.grid.traversable(self.radius)
        goal = self.grid.to_lattice(self.goal) - 0.5
        way = [self.grid.to_lattice(place) - 0.5]  # (x, y) from the centre of cell (0, 0)
        bend = -1
        for x, y in _entries(
            free, float(way[0][0]), float(way[0][1]), _band(self.grid, self.radius) + 1.0
        ):
            bend = nearest_bend(free, self._bends, x, y)
            if bend >= 0:
                way.append(np.array([x, y]))
                break
        while bend >= 0:
            x, y, _, bend, _ = self._bends[bend].item()
            way.append(np.array([x, y]))
        way[-1:] = [goal] if np.allclose(way[-1], goal, atol=1e-3) else [way[-1], goal]
        steps = [np.inf, *np.hypot(*np.diff(way, axis=0).T)]
        return self.grid.from_lattice(np.array(way)[np.array(steps) > 0.0] + 0.5)


def geodesic(grid: OccupancyGrid, goal: ArrayLike, radius: float) -> Geodesic:
    """Find the shortest paths of a disc that keeps `radius` from everything occupied.

    Paths bend at cell centres: they are at most 1 % longer than the shortest, except some short
    ones (6 of 1,726 measured), up to 0.6 cells longer. The grid caches the last result: a task
    reuses that of the scene which checked its path.

    Args:
        grid: the map; unknown cells are not entered.
        goal: (2,) [m]; if it lies too near an obstacle, paths end at the nearest that does not.
        radius: of the disc [m].
    """
    target = np.array(goal, dtype=np.float64)[:2]
    key = (float(target[0]), float(target[1]), float(radius))
    if key not in grid.geodesic_cache:
        length, bends = _lengths(grid, target, radius)
        extended = extend_field(length, _band(grid, radius))
        extended *= np.float32(grid.resolution)
        grid.geodesic_cache.clear()
        grid.geodesic_cache[key] = extended, bends
    return Geodesic(grid, target, radius, *grid.geodesic_cache[key])


def _band(grid: OccupancyGrid, radius: float) -> float:
    """Distance [cells] from reachable ground up to which paths are extended."""
    return radius / grid.resolution + _MARGIN


def _lengths(grid: OccupancyGrid, goal: Array, radius: float) -> tuple[Field, Records]:
    """Compute lengths (rows, cols) [cells] over free cells, and where paths bend."""
    free = grid.traversable(radius)
    x, y = np.clip(grid.to_lattice(goal) - 0.5, 0.0, (free.shape[1] - 1.0, free.shape[0] - 1.0))
    if grid.inside(goal):
        for col, row in _entries(free, x, y, _band(grid, radius)):
            return spread(free, float(x), float(y), math.floor(row + 0.5), math.floor(col + 0.5))
    return np.full(free.shape, np.inf, np.float32), np.empty(0, _BEND)


def _entries(free: Mask, x: float, y: float, band: float) -> list[tuple[float, float]]:
    """Return the entries to free ground from a point [cell centres]: there, or cells within `band`.

    The nearest cell is the first.
    """
    row, col = math.floor(y + 0.5), math.floor(x + 0.5)
    if 0 <= row < free.shape[0] and 0 <= col < free.shape[1] and free[row, col]:
        return [(x, y)]
    r0, c0 = max(0, math.floor(y - band)), max(0, math.floor(x - band))
    window = free[r0 : max(0, math.ceil(y + band) + 1), c0 : max(0, math.ceil(x + band) + 1)]
    rows, cols = np.nonzero(window)
    gaps = np.hypot(rows + r0 - y, cols + c0 - x)
    order = np.argsort(gaps, kind="stable")
    return [(float(cols[k] + c0), float(rows[k] + r0)) for k in order if gaps[k] <= band]

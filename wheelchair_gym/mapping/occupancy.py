"""Log-odds occupancy mapping: exact rays, cell by cell, and a field of what is near walls.

A map grows where a scan leaves it. Several layers may share one frame, one for each particle of a
SLAM. Beside its log-odds each layer keeps a field to match scans with: 1 in occupied cells, falling
off around them (Olson 2009); it follows every cell that turns occupied or free, and nothing else.
Kernels work in cells from the lower-left corner of cell (0, 0).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.geometry import to_world
from wheelchair_gym.kernel import borrowing_kernel, kernel
from wheelchair_gym.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from wheelchair_gym.sensing.settings import LaserSettings

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Index = NDArray[np.uint32]
Marks = NDArray[np.int32]
Mask = NDArray[np.bool_]
Box = tuple[int, int, int, int]  # rows from, to, columns from, to

_CHUNK = 64  # cells that a side grows by at least, so that it grows seldom
_MOST = 400_000_000  # cells of all layers: 3.2 GB; a pose that asks for more has lost its way


@settings
class MappingSettings:
    """How beams become a map."""

    resolution: float = setting(
        default=0.04, unit="m", source="gmapping's 0.05 errs a quarter more", low=0.005, high=1.0
    )
    hit: float = setting(
        default=0.7, source="p(occupied | echo), Hornung et al. 2013", low=0.51, high=0.99
    )
    miss: float = setting(
        default=0.4, source="p(occupied | passed), Hornung et al. 2013", low=0.01, high=0.49
    )
    least: float = setting(default=0.12, source="clamp, Hornung et al. 2013", low=1e-4, high=0.49)
    most: float = setting(default=0.97, source="clamp, Hornung et al. 2013", low=0.51, high=0.9999)
    occupied: float = setting(
        default=0.65, source="from this a cell is occupied: map_server", low=0.51, high=0.99
    )
    free: float = setting(
        default=0.41,
        source="up to this a cell is free: one beam is enough, as in gmapping",
        low=0.01,
        high=0.49,
    )
    clear: float = setting(
        default=3.0, unit="m", low=0.0, high=100.0,
        source="a beam without echo frees so far; black or slanted walls give none, either",
    )  # fmt: skip
    smear: float = setting(
        default=0.03, unit="m", low=0.001, high=1.0,
        source="standard deviation of the field round a wall: twice a scanner's; wider ones pull "
        "matches towards walls already mapped",
    )  # fmt: skip

    def __post_init__(self) -> None:
        if self.free <= self.least:
            raise InputError("MappingSettings.free must lie above least, or no cell is ever free")
        if self.occupied >= self.most:
            raise InputError("MappingSettings.occupied must lie below most")

    @property
    def odds(self) -> Odds:
        """The log-odds that kernels take."""
        return Odds(*map(_log_odds, (self.hit, self.miss, self.least, self.most, self.occupied)))

    @property
    def weights(self) -> Floats:
        """The field (2 r + 1, 2 r + 1) round one occupied cell, cut at three deviations."""
        sigma = self.smear / self.resolution
        reach = max(1, math.ceil(2.5 * sigma))
        steps = np.arange(-reach, reach + 1) ** 2
        field: Floats = np.exp(-0.5 * (steps[:, None] + steps) / sigma**2).astype(np.float32)
        return field


class Odds(NamedTuple):
    """Log-odds of `MappingSettings`."""

    hit: float
    miss: float
    least: float
    most: float
    occupied: float


class Scan(NamedTuple):
    """What one sweep says, in the chair's frame."""

    ends: Array  # (n, 2) m: where beams end
    hits: Mask  # (n,) at an echo; others met nothing so far
    origin: Array  # (2,) m: where beams begin

    @property
    def echoes(self) -> Array:
        """Where something was met (m, 2) [m]."""
        return self.ends[self.hits]


def _log_odds(p: float) -> float:
    return math.log(p / (1.0 - p))


def bearings(laser: LaserSettings) -> Array:
    """Angles (beams,) [rad] of a laser's beams in the chair's frame."""
    half = 0.5 * laser.fov
    return laser.yaw + np.linspace(-half, half, laser.beams)


def read_scan(laser: LaserSettings, ranges: ArrayLike, clear: float) -> Scan:
    """Beams of a sweep as points; those that are invalid (NaN) or too near (-inf) are left out.

    Args:
        laser: where it sits and looks.
        ranges: (beams,) [m]; without echo +inf, as is anything beyond the laser's reach.
        clear: up to where a beam without echo tells that nothing is there [m].

    Raises:
        InputError: there are more or fewer ranges than beams.
    """
    r = np.asarray(ranges, dtype=np.float64)
    if r.shape != (laser.beams,):
        raise InputError(f"a scan has shape {r.shape}; expected ({laser.beams},)")
    valid = r >= laser.nearest  # neither NaN nor -inf
    r, angles = r[valid], bearings(laser)[valid]
    hits = r <= laser.reach
    r = np.where(hits, r, min(clear, laser.reach))
    origin = np.array([laser.x, laser.y])
    ends = origin + np.stack([r * np.cos(angles), r * np.sin(angles)], axis=-1)  # (n, 2)
    return Scan(ends, hits, origin)


@borrowing_kernel
def cells_passed(x0: float, y0: float, x1: float, y1: float, cols: int, path: Index) -> int:
    """Cells that a segment passes, in order, its ends' cells included (Amanatides and Woo 1987).

    Args:
        x0: the segment's ends [cells].
        y0: see x0.
        x1: see x0.
        y1: see x0.
        cols: columns of the grid; all of the segment lies on it.
        path: (rows + cols,) or more, to be filled with row * cols + col.

    Returns:
        How many there are.
    """
    row, col = math.floor(y0), math.floor(x0)
    rise, run = math.floor(y1) - row, math.floor(x1) - col
    up, right = 1 if rise > 0 else -1, 1 if run > 0 else -1
    rise, run = abs(rise), abs(run)
    # Crossings are counted beforehand, and each is worked out from the start: nothing adds up, and
    # the last cell is reached whatever the rounding.
    per_y = up / (y1 - y0) if rise > 0 else 0.0
    per_x = right / (x1 - x0) if run > 0 else 0.0
    gap_y = row + 1 - y0 if up > 0 else y0 - row
    gap_x = col + 1 - x0 if right > 0 else x0 - col
    t_y = gap_y * per_y if rise > 0 else math.inf
    t_x = gap_x * per_x if run > 0 else math.inf
    cell, climb = row * cols + col, up * cols
    path[0] = cell
    count = rise + run + 1
    for k in range(1, count):
        if t_x < t_y:
            cell += right
            run -= 1
            gap_x += 1.0
            t_x = gap_x * per_x if run > 0 else math.inf
        else:
            cell += climb
            rise -= 1
            gap_y += 1.0
            t_y = gap_y * per_y if rise > 0 else math.inf
        path[k] = cell
    return count


@borrowing_kernel
def _lay(
    field: Floats, row: int, col: int, weights: Floats, box: tuple[int, int, int, int]
) -> None:
    """Raise the field round an occupied cell, within a box of rows and columns."""
    reach = weights.shape[0] // 2
    for r in range(max(row - reach, box[0]), min(row + reach + 1, box[1])):
        for c in range(max(col - reach, box[2]), min(col + reach + 1, box[3])):
            value = weights[r - row + reach, c - col + reach]
            if value > field[r, c]:
                field[r, c] = value


@borrowing_kernel
def _lift(odds: Floats, field: Floats, row: int, col: int, weights: Floats, limit: float) -> None:
    """Make the field anew round a cell that is no longer occupied."""
    rows, cols = odds.shape
    reach = weights.shape[0] // 2
    box = (max(row - reach, 0), min(row + reach + 1, rows),
           max(col - reach, 0), min(col + reach + 1, cols))  # fmt: skip
    for r in range(box[0], box[1]):
        for c in range(box[2], box[3]):
            field[r, c] = 0.0
    for r in range(max(box[0] - reach, 0), min(box[1] + reach, rows)):
        for c in range(max(box[2] - reach, 0), min(box[3] + reach, cols)):
            if odds[r, c] >= limit:
                _lay(field, r, c, weights, box)


@kernel
def add_scan(
    odds: Floats,
    field: Floats,
    struck: Marks,
    mark: int,
    points: Array,
    hits: Mask,
    pose: Array,
    law: Odds,
    weights: Floats,
    path: Index,
) -> None:
    """Add a scan to a map: cells passed are freer, cells hit are more occupied, both clamped.

    A cell hit by one beam is not freed by another of the same scan: those that graze a wall would
    rub it out. All of `points` must lie on the map.

    Args:
        odds: log-odds (rows, cols).
        field: (rows, cols), kept in step.
        struck: scratch (rows, cols): number of the last scan that hit a cell.
        mark: number of this scan, never used before.
        points: (n + 1, 2) [cells], in the chair's frame: where beams begin, then where they end.
        hits: (n,) whether a beam ends at an echo.
        pose: x, y [cells], yaw [rad].
        law: log-odds.
        weights: of the field.
        path: scratch (rows + cols,).
    """
    rows, cols = odds.shape
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x0 = pose[0] + c * points[0, 0] - s * points[0, 1]
    y0 = pose[1] + s * points[0, 0] + c * points[0, 1]
    n = len(hits)
    flat, marks = odds.reshape(-1), struck.reshape(-1)
    least = np.float32(law.least)
    for k in range(n):
        if hits[k]:
            px, py = points[k + 1, 0], points[k + 1, 1]
            col = math.floor(pose[0] + c * px - s * py)
            row = math.floor(pose[1] + s * px + c * py)
            struck[row, col] = mark
            before = odds[row, col]
            odds[row, col] = min(before + law.hit, law.most)
            if before < law.occupied <= odds[row, col]:
                _lay(field, row, col, weights, (0, rows, 0, cols))
    for k in range(n):
        px, py = points[k + 1, 0], points[k + 1, 1]
        qx, qy = pose[0] + c * px - s * py, pose[1] + s * px + c * py
        for j in range(cells_passed(x0, y0, qx, qy, cols, path)):
            cell = path[j]  # unsigned: no test whether it counts from the end
            before = flat[cell]
            if before <= least or marks[cell] == mark:
                continue
            flat[cell] = max(before + law.miss, law.least)
            if before >= law.occupied > flat[cell]:
                _lift(odds, field, int(cell) // cols, int(cell) % cols, weights, law.occupied)


class OccupancyMap:
    """A map that grows, in one layer or several.

    Args:
        settings: how beams become a map.
        layers: how many maps share the frame.
    """

    def __init__(self, settings: MappingSettings | None = None, layers: int = 1) -> None:
        self.settings = settings = settings or MappingSettings()
        self.law, self.weights = settings.odds, settings.weights
        self.corner = np.zeros(2)  # m: the lower-left corner of cell (0, 0)
        self._mark = 0
        self._shape(np.zeros((layers, 0, 0), np.float32), np.zeros((layers, 0, 0), np.float32))

    def _shape(self, odds: Floats, field: Floats) -> None:
        self.odds, self.field = odds, field  # (layers, rows, cols)
        self.struck = np.zeros(odds.shape[1:], np.int32)
        self.wide = np.empty(odds.shape[1:], np.float32)  # scratch of the matcher
        self.path = np.empty(sum(odds.shape[1:]) + 2, np.uint32)

    def make_room(self, centres: ArrayLike, reach: float) -> None:
        """Grow so that all within `reach` [m] of the points (n, 2 or 3) [m] lies on the map.

        Raises:
            InputError: the map would be larger than memory should hold.
        """
        step = self.settings.resolution
        places = np.atleast_2d(np.asarray(centres, dtype=np.float64))[:, :2]
        margin = reach + 2.0 * step  # rounding, and a neighbour to interpolate with
        if self.odds.shape[1] == 0:
            self.corner = np.floor((places.min(axis=0) - margin) / step) * step
        low = np.floor((places.min(axis=0) - margin - self.corner) / step).astype(np.int64)
        high = np.ceil((places.max(axis=0) + margin - self.corner) / step).astype(np.int64)
        layers, rows, cols = self.odds.shape
        before = np.where(low < 0, np.maximum(-low, _CHUNK), 0)  # cols, rows
        after = high - (cols, rows)
        after = np.where(after > 0, np.maximum(after, _CHUNK), 0)
        if not (before.any() or after.any()):
            return
        grown = before + after + (cols, rows)
        if layers * int(grown[0]) * int(grown[1]) > _MOST:
            raise InputError(
                f"the map would have {layers} x {grown[1]} x {grown[0]} cells of {step} m; "
                f"expected at most {_MOST} in all"
            )
        pad = ((0, 0), (before[1], after[1]), (before[0], after[0]))
        self.corner = self.corner - before * step
        self._shape(np.pad(self.odds, pad), np.pad(self.field, pad))
        self._mark = 0

    def next_marks(self, count: int) -> int:
        """Numbers for so many scans: the first of them."""
        self._mark += count
        return self._mark - count + 1

    def lattice(self, poses: ArrayLike) -> Array:
        """Poses (..., 3) [m, m, rad] with x and y in cells."""
        placed = np.array(poses, dtype=np.float64)
        placed[..., :2] = (placed[..., :2] - self.corner) / self.settings.resolution
        return placed

    def world(self, poses: ArrayLike) -> Array:
        """The inverse of `lattice`."""
        placed = np.array(poses, dtype=np.float64)
        placed[..., :2] = placed[..., :2] * self.settings.resolution + self.corner
        return placed

    def points(self, scan: Scan) -> Array:
        """A scan's origin and ends (n + 1, 2) [cells], in the chair's frame."""
        return np.vstack([scan.origin, scan.ends]) / self.settings.resolution

    def integrate(self, scan: Scan, pose: ArrayLike, layer: int = 0) -> None:
        """Add a scan taken at a pose (3,) [m, m, rad].

        Raises:
            InputError: the pose is not three finite numbers.
        """
        place = np.asarray(pose, dtype=np.float64)
        if place.shape != (3,) or not np.isfinite(place).all():
            raise InputError(f"pose is {pose!r}; expected three finite numbers")
        self.make_room(place, reach_of(scan))
        add_scan(
            self.odds[layer], self.field[layer], self.struck, self.next_marks(1),
            self.points(scan), scan.hits, self.lattice(place), self.law, self.weights, self.path,
        )  # fmt: skip

    def keep(self, parents: ArrayLike) -> None:
        """Make each layer a copy of the one named for it (layers,)."""
        chosen = np.asarray(parents, dtype=np.int64)
        if np.array_equal(chosen[chosen], chosen):  # no copy's source is overwritten
            for layer in np.flatnonzero(chosen != np.arange(len(chosen))):
                self.odds[layer] = self.odds[chosen[layer]]
                self.field[layer] = self.field[chosen[layer]]
        else:
            self.odds, self.field = self.odds[chosen], self.field[chosen]

    def to_grid(self, layer: int = 0) -> OccupancyGrid:
        """The map of a layer: free, occupied or unknown by the settings' thresholds.

        Raises:
            InputError: nothing was added so far.
        """
        odds = self.odds[layer]
        if odds.size == 0:
            raise InputError("the map is empty: no scan was added to it")
        cells = np.full(odds.shape, UNKNOWN, np.int8)
        cells[odds <= _log_odds(self.settings.free)] = FREE
        cells[odds >= self.law.occupied] = OCCUPIED
        x, y = self.corner.tolist()
        return OccupancyGrid(cells, self.settings.resolution, (x, y, 0.0))


def reach_of(scan: Scan) -> float:
    """Distance [m] from the chair's origin to the farthest point of a scan."""
    points = np.vstack([scan.origin, scan.ends])
    return float(np.hypot(points[:, 0], points[:, 1]).max())


def placed(scan: Scan, pose: ArrayLike) -> Array:
    """Where a scan's beams met something (m, 2) [m], in the world."""
    return to_world(scan.echoes, pose)

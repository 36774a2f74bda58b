"""Log-odds occupancy mapping: exact rays, cell by cell, and a field of closeness to walls.

A map grows where a scan leaves it. Several layers may share one frame, one for each particle of a
SLAM. Beside its log-odds each layer keeps a field to match scans with: 1 at the surface in each
occupied cell, falling off around it (Olson 2009). The surface is the mean of the cell's hits, as in
gmapping: cells behind a wall that noise alone hits are never freed, and with their centres for
surfaces a wall would move away from whoever looks at it, and take the chair along.
Kernels work in cells from the lower-left corner of cell (0, 0).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined, kernel
from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.localization.scan import Scan, scan_radius
from wheelchair_gym.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Index = NDArray[np.uint32]
Marks = NDArray[np.int32]
Mask = NDArray[np.bool_]
Bytes = NDArray[np.uint8]


PARTS = 8  # of a cell's side: how finely the field knows where in its cell a surface is
_MOST_HITS = 128  # of which a cell keeps the mean; older ones count less and less from then on
HITS, PART = 0, 1  # of a tally: hits on a cell, and in which of its parts the field has them


class LogOdds(NamedTuple):
    """Log-odds of `MappingSettings`."""

    hit: float
    miss: float
    least: float
    most: float
    occupied: float


@borrowing_kernel
def cells_passed(x0: float, y0: float, x1: float, y1: float, cols: int, path: Index) -> int:
    """Cells that a segment passes, in order, its ends' cells included (Amanatides and Woo 1987).

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


@inlined
def part_of(x: float, y: float) -> int:
    """Which of its PARTS x PARTS parts a place in a cell lies in, from 0 to 1 each way."""
    u, v = min(int(PARTS * x), PARTS - 1), min(int(PARTS * y), PARTS - 1)
    return PARTS * v + u


@borrowing_kernel
def _lay(
    field: Floats,
    tally: Bytes,
    row: int,
    col: int,
    weights: Floats,
    box: tuple[int, int, int, int],
) -> None:
    """Raise the field round an occupied cell, within a box of rows and columns."""
    around = weights[tally[row, col, PART]]
    reach = around.shape[0] // 2
    for r in range(max(row - reach, box[0]), min(row + reach + 1, box[1])):
        for c in range(max(col - reach, box[2]), min(col + reach + 1, box[3])):
            value = around[r - row + reach, c - col + reach]
            if value > field[r, c]:
                field[r, c] = value


@borrowing_kernel
def _renew(
    odds: Floats,
    field: Floats,
    tally: Bytes,
    row: int,
    col: int,
    weights: Floats,
    limit: float,
) -> None:
    """Recompute the field round a cell that is no longer occupied, or whose surface moved."""
    rows, cols = odds.shape
    reach = weights.shape[1] // 2
    box = (max(row - reach, 0), min(row + reach + 1, rows),
           max(col - reach, 0), min(col + reach + 1, cols))  # fmt: skip
    for r in range(box[0], box[1]):
        for c in range(box[2], box[3]):
            field[r, c] = 0.0
    for r in range(max(box[0] - reach, 0), min(box[1] + reach, rows)):
        for c in range(max(box[2] - reach, 0), min(box[3] + reach, cols)):
            if odds[r, c] >= limit:
                _lay(field, tally, r, c, weights, box)


@kernel
def add_scan(
    odds: Floats,
    field: Floats,
    mean: Floats,
    tally: Bytes,
    struck: Marks,
    mark: int,
    points: Array,
    hits: Mask,
    pose: Array,
    law: LogOdds,
    weights: Floats,
    path: Index,
) -> None:
    """Add a scan to a map: cells passed are freer, cells hit are more occupied, both clamped.

    A cell hit by one beam is not freed by another of the same scan: those that graze a wall would
    rub it out. All of `points` must lie on the map.
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
            x, y = pose[0] + c * px - s * py, pose[1] + s * px + c * py
            col, row = math.floor(x), math.floor(y)
            struck[row, col] = mark
            before = odds[row, col]
            odds[row, col] = min(before + law.hit, law.most)
            own, told = mean[row, col], min(tally[row, col, HITS] + 1, _MOST_HITS)
            tally[row, col, HITS] = told
            own[0] += (x - col - own[0]) / told
            own[1] += (y - row - own[1]) / told
            part = part_of(own[0], own[1])
            if before < law.occupied <= odds[row, col]:
                tally[row, col, PART] = part
                _lay(field, tally, row, col, weights, (0, rows, 0, cols))
            elif (
                before >= law.occupied and told & (told - 1) == 0 and part != tally[row, col, PART]
            ):
                # Seldom, at powers of two: a mean of few hits wanders, and each move costs.
                tally[row, col, PART] = part
                _renew(odds, field, tally, row, col, weights, law.occupied)
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
                row, col = int(cell) // cols, int(cell) % cols
                tally[row, col, HITS] = 0
                _renew(odds, field, tally, row, col, weights, law.occupied)


_CHUNK = 160  # cells that a side grows by at least, so that it grows seldom
_ARRAYS: tuple[tuple[tuple[int, ...], type], ...] = (
    ((), np.float32), ((), np.float32), ((2,), np.float32), ((2,), np.uint8),
)  # fmt: skip
_MOST = 400_000_000  # cells of all layers: 3.2 GB; a pose that asks for more has lost its way


@settings
class MappingSettings:
    """How beams become a map."""

    resolution: float = setting(
        default=0.04,
        unit="m",
        low=0.005,
        high=1.0,
        source="measured: gmapping's 0.05 errs a quarter more",
    )
    """Side of a cell."""
    p_hit: float = setting(default=0.7, low=0.51, high=0.99, source="Hornung et al. 2013")
    """Probability that a cell with an echo is occupied."""
    p_miss: float = setting(default=0.4, low=0.01, high=0.49, source="Hornung et al. 2013")
    """Probability that a cell that a beam passed is occupied."""
    p_min: float = setting(default=0.12, low=1e-4, high=0.49, source="Hornung et al. 2013")
    """Least probability that a cell can reach."""
    p_max: float = setting(default=0.97, low=0.51, high=0.9999, source="Hornung et al. 2013")
    """Greatest probability that a cell can reach."""
    occupied_threshold: float = setting(default=0.65, low=0.51, high=0.99, source="map_server")
    """Probability from which a cell is occupied on the map."""
    free_threshold: float = setting(
        default=0.41, low=0.01, high=0.49, source="gmapping: one beam is enough"
    )
    """Probability up to which a cell is free on the map."""
    free_range: float = setting(
        default=3.0,
        unit="m",
        low=0.0,
        high=100.0,
        source="black and slanted walls give no echo, either",
    )
    """Range up to which a beam without echo frees cells."""
    surface_sigma: float = setting(
        default=0.02,
        unit="m",
        low=0.001,
        high=1.0,
        source="measured: a scanner's noise and a little; wider fields bias matches towards "
        "mapped walls",
    )
    """Standard deviation of the field round a wall."""

    def __post_init__(self) -> None:
        if self.free_threshold <= self.p_min:
            raise InputError(
                "MappingSettings.free_threshold must lie above p_min, or no cell is ever free"
            )
        if self.occupied_threshold >= self.p_max:
            raise InputError("MappingSettings.occupied_threshold must lie below p_max")

    @property
    def odds(self) -> LogOdds:
        """The log-odds that kernels take."""
        return LogOdds(
            *map(
                _log_odds,
                (self.p_hit, self.p_miss, self.p_min, self.p_max, self.occupied_threshold),
            )
        )

    @property
    def weights(self) -> Floats:
        """The field (PARTS * PARTS, n, n) round an occupied cell, by the part with its surface."""
        sigma = self.surface_sigma / self.resolution
        reach = max(1, math.ceil(2.5 * sigma))
        off = (np.arange(PARTS) + 0.5) / PARTS - 0.5
        along = np.exp(-0.5 * ((np.arange(-reach, reach + 1) - off[:, None]) / sigma) ** 2)
        field: Floats = np.einsum("ar,bc->abrc", along, along).astype(np.float32)
        return field.reshape(PARTS * PARTS, *field.shape[2:])


def _log_odds(p: float) -> float:
    return math.log(p / (1.0 - p))


class OccupancyMap:
    """A map that grows, in one layer or several.

    Args:
        settings: how beams become a map.
        layers: how many maps share the frame.
    """

    def __init__(self, settings: MappingSettings | None = None, layers: int = 1) -> None:
        self.settings = settings = settings or MappingSettings()
        self.log_odds, self.weights = settings.odds, settings.weights
        self.corner = np.zeros(2)  # m: the lower-left corner of cell (0, 0)
        self._mark = 0
        self._used = np.zeros((2, 2), dtype=np.int64)  # cols, rows: from, to; all else is zero
        self._take([np.zeros((layers, 0, 0, *part), kind) for part, kind in _ARRAYS])

    def _take(self, parts: list[NDArray[Any]]) -> None:
        """Arrays (layers, rows, cols, ...): log-odds, the field, and see `add_scan`."""
        self.odds, self.field, self.mean, self.tally = parts
        odds = self.odds
        self.last_hit = np.zeros(odds.shape[1:], np.int32)
        self.pooled = np.empty(odds.shape[1:], np.float32)  # scratch of the matcher
        self.path = np.empty(sum(odds.shape[1:]) + 2, np.uint32)

    @property
    def _all(self) -> list[NDArray[Any]]:
        return [self.odds, self.field, self.mean, self.tally]

    def grow_to(self, centres: ArrayLike, reach: float) -> None:
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
        (x0, y0), (x1, y1) = used = self._used
        self._used = np.stack([np.minimum(used[0], low), np.maximum(used[1], high)])
        layers, rows, cols = self.odds.shape
        least = np.maximum(_CHUNK, np.array([cols, rows]) // 3)
        before = np.where(low < 0, np.maximum(-low, least), 0)  # cols, rows
        after = high - (cols, rows)
        after = np.where(after > 0, np.maximum(after, least), 0)
        if not (before.any() or after.any()):
            return
        grown = before + after + (cols, rows)
        if layers * int(grown[0]) * int(grown[1]) > _MOST:
            raise InputError(
                f"the map would have {layers} x {grown[1]} x {grown[0]} cells of {step} m; "
                f"expected at most {_MOST} in all"
            )
        self.corner = self.corner - before * step
        self._used += before
        x, y = before
        parts = []
        for old in self._all:  # what was never written costs neither time nor memory
            part = np.zeros((layers, grown[1], grown[0], *old.shape[3:]), old.dtype)
            part[:, y + y0 : y + y1, x + x0 : x + x1] = old[:, y0:y1, x0:x1]
            parts.append(part)
        self._take(parts)
        self._mark = 0

    def next_marks(self, count: int) -> int:
        """Reserve `count` scan numbers; returns the first."""
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
        self.grow_to(place, scan_radius(scan))
        add_scan(
            self.odds[layer], self.field[layer], self.mean[layer], self.tally[layer],
            self.last_hit, self.next_marks(1), self.points(scan), scan.hits, self.lattice(place),
            self.log_odds, self.weights, self.path,
        )  # fmt: skip

    def copy_layers(self, parents: ArrayLike) -> None:
        """Make each layer a copy of the one named for it (layers,)."""
        chosen = np.asarray(parents, dtype=np.int64)
        if np.array_equal(chosen[chosen], chosen):  # no copy's source is overwritten
            (x0, y0), (x1, y1) = self._used
            for layer in np.flatnonzero(chosen != np.arange(len(chosen))):
                for part in self._all:
                    part[layer, y0:y1, x0:x1] = part[chosen[layer], y0:y1, x0:x1]
        else:
            self._take([part[chosen] for part in self._all])

    def to_grid(self, layer: int = 0) -> OccupancyGrid:
        """The map of a layer: free, occupied or unknown by the settings' thresholds.

        Raises:
            InputError: nothing was added so far.
        """
        odds = self.odds[layer]
        if odds.size == 0:
            raise InputError("the map is empty: no scan was added to it")
        cells = np.full(odds.shape, UNKNOWN, np.int8)
        cells[odds <= _log_odds(self.settings.free_threshold)] = FREE
        cells[odds >= self.log_odds.occupied] = OCCUPIED
        x, y = self.corner.tolist()
        return OccupancyGrid(cells, self.settings.resolution, (x, y, 0.0))

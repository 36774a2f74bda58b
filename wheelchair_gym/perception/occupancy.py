"""Log-odds occupancy mapping: exact rays, cell by cell, and a field to match scans with.

A map grows where a scan leaves it. Several layers may share one frame, one for each particle of a
SLAM. Beside its log-odds each layer keeps a field: 1 at the surface in each occupied cell, falling
off around it (Olson 2009). The surface is the mean of the cell's hits, as in gmapping: cells behind
a wall that only noise hits are never freed, and with their centres as surfaces a wall would move
away from the chair that looks at it, and take the chair's pose along.

Kernels work in cells from the lower-left corner of cell (0, 0). At the end: frontiers, where the
known part of a map ends, and the wall that a scan shows ahead.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from wheelchair_gym.base.arrays import Array, Floats, Mask
from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, geodesic
from wheelchair_gym.sensors.settings import LaserSettings

Index = NDArray[np.uint32]
Marks = NDArray[np.int32]
Records = NDArray[np.void]


class Scan(NamedTuple):
    """One sweep of a laser as points in the chair's frame."""

    ends: Array  # (n, 2) m: where beams end
    hits: Mask  # (n,) at an echo; others met nothing so far
    origin: Array  # (2,) m: where beams begin
    angle_step: float  # rad between two beams

    @property
    def echoes(self) -> Array:
        """Points at which beams met something (m, 2) [m]."""
        return self.ends[self.hits]

    @property
    def points(self) -> Array:
        """The origin, then the ends (n + 1, 2) [m]."""
        return np.vstack([self.origin, self.ends])

    @property
    def radius(self) -> float:
        """Distance [m] from the chair's origin to the farthest point."""
        return float(np.hypot(*self.points.T).max())


# m up to which a beam without echo frees cells: black and slanted walls give no echo, either
_FREE_RANGE = 3.0


def read_scan(laser: LaserSettings, ranges: ArrayLike) -> Scan:
    """Beams of a sweep as points; those that are invalid (NaN) or too near (-inf) are left out.

    A beam without echo beside one with an echo is left out, too: echoes get lost.

    Args:
        laser: its mount and its beams.
        ranges: (beams,) [m]; without echo +inf, as is anything beyond the laser's reach.

    Raises:
        InputError: there are more or fewer ranges than beams.
    """
    r = np.asarray(ranges, dtype=np.float64)
    if r.shape != (laser.beams,):
        raise InputError(f"a scan has shape {r.shape}; expected ({laser.beams},)")
    valid = r >= laser.range_min  # neither NaN nor -inf
    silent = np.pad(r > laser.reach, 1, mode="edge")
    valid &= ~silent[1:-1] | (silent[:-2] & silent[2:])
    r, angles = r[valid], (laser.yaw + laser.angles)[valid]
    hits = r <= laser.reach
    r = np.where(hits, r, min(_FREE_RANGE, laser.reach))
    origin = np.array([laser.x, laser.y])
    ends = origin + np.stack([r * np.cos(angles), r * np.sin(angles)], axis=-1)  # (n, 2)
    return Scan(ends, hits, origin, laser.fov / (laser.beams - 1))


PARTS = 8  # of a cell's side: how finely the field knows where in its cell a surface is
_MAX_HITS = 128  # of which a cell keeps the mean; older ones count less and less from then on
SURFACE = np.dtype(
    [
        ("x", np.float32),  # mean of the hits, from the cell's corner
        ("y", np.float32),
        ("hits", np.uint8),
        ("part", np.uint8),  # of the cell, in which the field has the surface
    ]
)


class Layers(NamedTuple):
    """Maps of one frame, each (layers, rows, cols)."""

    odds: Floats  # log-odds
    field: Floats
    surface: Records  # SURFACE


class Workspace(NamedTuple):
    """Buffers that the layers share."""

    last_hit: Marks  # (rows, cols): the last scan with a hit in the cell
    pooled: Floats  # (rows, cols): of the matcher
    path: Index  # cells of one beam


class SensorModel(NamedTuple):
    """Constants of mapping for kernels: log-odds, and the field around a surface."""

    hit: float
    miss: float
    minimum: float
    maximum: float
    occupied: float
    weights: Floats  # (PARTS * PARTS, n, n), by the part of the cell with the surface


@borrowing_kernel
def cells_passed(x0: float, y0: float, x1: float, y1: float, cols: int, path: Index) -> int:
    """Write the cells that a segment passes, its ends' included; returns how many.

    Source: Amanatides and Woo 1987.
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
def _raise_field(
    layers: Layers, i: int, row: int, col: int, weights: Floats, box: tuple[int, int, int, int]
) -> None:
    """Raise the field round an occupied cell, within a box of rows and columns."""
    field = layers.field[i]
    around = weights[layers.surface[i, row, col].part]
    reach = around.shape[0] // 2
    for r in range(max(row - reach, box[0]), min(row + reach + 1, box[1])):
        for c in range(max(col - reach, box[2]), min(col + reach + 1, box[3])):
            value = around[r - row + reach, c - col + reach]
            if value > field[r, c]:
                field[r, c] = value


@borrowing_kernel
def _renew_field(layers: Layers, i: int, row: int, col: int, weights: Floats, limit: float) -> None:
    """Recompute the field round a cell that is no longer occupied, or whose surface moved."""
    odds, field = layers.odds[i], layers.field[i]
    rows, cols = odds.shape
    reach = weights.shape[1] // 2
    r0, r1 = max(row - reach, 0), min(row + reach + 1, rows)
    c0, c1 = max(col - reach, 0), min(col + reach + 1, cols)
    for r in range(r0, r1):
        for c in range(c0, c1):
            field[r, c] = 0.0
    for r in range(max(r0 - reach, 0), min(r1 + reach, rows)):
        for c in range(max(c0 - reach, 0), min(c1 + reach, cols)):
            if odds[r, c] >= limit:
                _raise_field(layers, i, r, c, weights, (r0, r1, c0, c1))


@kernel
def add_scan(
    layers: Layers,
    i: int,
    workspace: Workspace,
    mark: int,
    points: Array,
    hits: Mask,
    pose: Array,
    model: SensorModel,
) -> None:
    """Add a scan to a layer: cells passed are freer, cells hit are more occupied, both clamped.

    A cell hit by one beam is not freed by another of the same scan: those that graze a wall would
    rub it out. All of `points` must lie on the map.
    """
    odds, surface = layers.odds[i], layers.surface[i]
    rows, cols = odds.shape
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x0 = pose[0] + c * points[0, 0] - s * points[0, 1]
    y0 = pose[1] + s * points[0, 0] + c * points[0, 1]
    flat, marks = odds.reshape(-1), workspace.last_hit.reshape(-1)
    weights, path = model.weights, workspace.path
    minimum = np.float32(model.minimum)
    for k in range(len(hits)):
        if hits[k]:
            px, py = points[k + 1, 0], points[k + 1, 1]
            x, y = pose[0] + c * px - s * py, pose[1] + s * px + c * py
            col, row = math.floor(x), math.floor(y)
            workspace.last_hit[row, col] = mark
            before = odds[row, col]
            odds[row, col] = min(before + model.hit, model.maximum)
            here = surface[row, col]
            count = min(here.hits + 1, _MAX_HITS)
            here.hits = count
            here.x += (x - col - here.x) / count
            here.y += (y - row - here.y) / count
            u, v = min(int(PARTS * here.x), PARTS - 1), min(int(PARTS * here.y), PARTS - 1)
            part = PARTS * v + u
            if before < model.occupied <= odds[row, col]:
                here.part = part
                _raise_field(layers, i, row, col, weights, (0, rows, 0, cols))
            elif before >= model.occupied and count & (count - 1) == 0 and part != here.part:
                # Seldom, at powers of two: a mean of few hits wanders, and each move costs time.
                here.part = part
                _renew_field(layers, i, row, col, weights, model.occupied)
    for k in range(len(hits)):
        px, py = points[k + 1, 0], points[k + 1, 1]
        qx, qy = pose[0] + c * px - s * py, pose[1] + s * px + c * py
        for j in range(cells_passed(x0, y0, qx, qy, cols, path)):
            cell = path[j]  # unsigned: no test whether it counts from the end
            before = flat[cell]
            if before <= minimum or marks[cell] == mark:
                continue
            flat[cell] = max(before + model.miss, model.minimum)
            if before >= model.occupied > flat[cell]:
                row, col = int(cell) // cols, int(cell) % cols
                surface[row, col].hits = 0
                _renew_field(layers, i, row, col, weights, model.occupied)


_CHUNK = 160  # cells that a side grows by at least, so that it grows seldom
_MAXIMUM = 400_000_000  # cells of all layers: 7.2 GB; a pose that asks for more is wrong


# Of a cell to be occupied (Hornung et al. 2013): with an echo, passed by a beam, and the bounds.
_P_HIT, _P_MISS, P_MIN, P_MAX = 0.7, 0.4, 0.12, 0.97
_OCCUPIED = 0.65  # probability from which a cell is occupied on the map: map_server
_FREE = 0.41  # and up to which it is free: one beam is enough, as for gmapping
# Standard deviation of the field round a wall [m]: measured, a scanner's noise and a little; wider
# fields bias matches towards mapped walls.
_SURFACE_SIGMA = 0.02


@settings
class MappingSettings:
    """Settings of maps made of beams."""

    resolution: float = setting(
        default=0.04, unit="m", low=0.005, high=1.0, source="gmapping's 0.05 errs a quarter more"
    )
    """Side of a cell."""
    reserve: float = setting(
        default=0.0, unit="m", low=0.0, high=100.0, source="a real chair's loop must not wait"
    )
    """Distance around the start for which SLAM has memory at once; to grow takes up to 0.2 s."""

    @property
    def sensor_model(self) -> SensorModel:
        """The log-odds and the field round an occupied cell, as kernels take them."""
        probabilities = _P_HIT, _P_MISS, P_MIN, P_MAX, _OCCUPIED
        hit, miss, minimum, maximum, occupied = map(_log_odds, probabilities)
        sigma = _SURFACE_SIGMA / self.resolution
        reach = max(1, math.ceil(2.5 * sigma))
        off = (np.arange(PARTS) + 0.5) / PARTS - 0.5
        along = np.exp(-0.5 * ((np.arange(-reach, reach + 1) - off[:, None]) / sigma) ** 2)
        field: Floats = np.einsum("ar,bc->abrc", along, along).astype(np.float32)
        field = field.reshape(PARTS * PARTS, *field.shape[2:])
        return SensorModel(hit, miss, minimum, maximum, occupied, field)


def _raw(array: NDArray[Any]) -> NDArray[np.void]:
    """The same memory without fields: numpy copies records with fields fifty times slower."""
    return array.view(f"V{array.itemsize}")


def _log_odds(p: float) -> float:
    return math.log(p / (1.0 - p))


class OccupancyMap:
    """A map that grows, in one layer or several.

    Args:
        settings: how beams become a map.
        layers: how many maps share the frame.
    """

    def __init__(self, settings: MappingSettings | None = None, layers: int = 1) -> None:
        self.settings = settings or MappingSettings()
        self.model = self.settings.sensor_model
        self.corner = np.zeros(2)  # m: the lower-left corner of cell (0, 0)
        self._used = np.zeros((2, 2), dtype=np.int64)  # cols, rows: from, to; all else is zero
        kinds = np.float32, np.float32, SURFACE
        self._replace(Layers._make(np.zeros((layers, 0, 0), kind) for kind in kinds))

    def _replace(self, layers: Layers) -> None:
        self.layers = layers
        shape = layers.odds.shape[1:]
        path = np.empty(sum(shape) + 2, np.uint32)
        self.workspace = Workspace(np.zeros(shape, np.int32), np.empty(shape, np.float32), path)
        self._mark = 0

    def grow_to(self, centres: ArrayLike, reach: float) -> None:
        """Grow so that all within `reach` [m] of the points (n, 2 or 3) [m] lies on the map.

        Raises:
            InputError: the map would be larger than memory should hold.
        """
        step = self.settings.resolution
        places = np.atleast_2d(np.asarray(centres, dtype=np.float64))[:, :2]
        margin = reach + 2.0 * step  # rounding, and a neighbour to interpolate with
        layers, rows, cols = self.layers.odds.shape
        if rows == 0:
            self.corner = np.floor((places.min(axis=0) - margin) / step) * step
        low = np.floor((places.min(axis=0) - margin - self.corner) / step).astype(np.int64)
        high = np.ceil((places.max(axis=0) + margin - self.corner) / step).astype(np.int64)
        (x0, y0), (x1, y1) = used = self._used
        minimum = np.maximum(_CHUNK, np.array([cols, rows]) // 3)
        before = np.where(low < 0, np.maximum(-low, minimum), 0)  # cols, rows
        after = high - (cols, rows)
        after = np.where(after > 0, np.maximum(after, minimum), 0)
        width, height = (before + after + (cols, rows)).tolist()
        if layers * width * height > _MAXIMUM:
            raise InputError(
                f"the map would have {layers} x {height} x {width} cells of {step} m; "
                f"expected at most {_MAXIMUM} in all"
            )
        self._used = np.stack([np.minimum(used[0], low), np.maximum(used[1], high)]) + before
        if not (before.any() or after.any()):
            return
        self.corner = self.corner - before * step
        x, y = before
        grown = []
        for old in self.layers:  # what was never written costs neither time nor memory
            new = np.zeros((layers, height, width), old.dtype)
            _raw(new)[:, y + y0 : y + y1, x + x0 : x + x1] = _raw(old)[:, y0:y1, x0:x1]
            grown.append(new)
        self._replace(Layers._make(grown))

    def reserve(self, centre: ArrayLike) -> None:
        """Reserve map memory within `MappingSettings.reserve` of a point (2 or 3,) [m] at once.

        What is never written costs neither time nor memory.
        """
        if self.settings.reserve > 0.0:
            self.grow_to(centre, self.settings.reserve)
            self._used = np.stack([self._used.sum(axis=0) // 2] * 2)

    def next_marks(self, count: int) -> int:
        """Reserve `count` scan numbers; returns the first."""
        self._mark += count
        return self._mark - count + 1

    def to_lattice(self, poses: ArrayLike) -> Array:
        """Poses (..., 3) [m, m, rad] with x and y in cells."""
        placed = np.array(poses, dtype=np.float64)
        placed[..., :2] = (placed[..., :2] - self.corner) / self.settings.resolution
        return placed

    def from_lattice(self, poses: ArrayLike) -> Array:
        """The inverse of `to_lattice`."""
        placed = np.array(poses, dtype=np.float64)
        placed[..., :2] = placed[..., :2] * self.settings.resolution + self.corner
        return placed

    def integrate(self, scan: Scan, pose: ArrayLike) -> None:
        """Add a scan taken at a pose (3,) [m, m, rad] to the first layer.

        Raises:
            InputError: the pose is not three finite numbers.
        """
        place = np.asarray(pose, dtype=np.float64)
        if place.shape != (3,) or not np.isfinite(place).all():
            raise InputError(f"pose is {pose!r}; expected three finite numbers")
        self.grow_to(place, scan.radius)
        points, place = scan.points / self.settings.resolution, self.to_lattice(place)
        mark = self.next_marks(1)
        add_scan(self.layers, 0, self.workspace, mark, points, scan.hits, place, self.model)

    def copy_layers(self, parents: NDArray[np.int64]) -> None:
        """Make each layer a copy of the one named for it (layers,), which names itself."""
        (x0, y0), (x1, y1) = self._used
        for layer in np.flatnonzero(parents != np.arange(len(parents))):
            for part in map(_raw, self.layers):
                part[layer, y0:y1, x0:x1] = part[parents[layer], y0:y1, x0:x1]

    def to_grid(self, layer: int = 0) -> OccupancyGrid:
        """The map of a layer: free, occupied or unknown by two thresholds.

        Raises:
            InputError: nothing was added so far.
        """
        odds = self.layers.odds[layer]
        if odds.size == 0:
            raise InputError("the map is empty: no scan was added to it")
        corner = self.corner
        if self.settings.reserve > 0.0:  # a map of what was seen, not of all the memory
            (x0, y0), (x1, y1) = self._used
            odds, corner = odds[y0:y1, x0:x1], corner + self._used[0] * self.settings.resolution
        cells = np.full(odds.shape, UNKNOWN, np.int8)
        cells[odds <= _log_odds(_FREE)] = FREE
        cells[odds >= self.model.occupied] = OCCUPIED
        x, y = corner.tolist()
        return OccupancyGrid(cells, self.settings.resolution, (x, y, 0.0))


_MIDDLE = slice(1, -1)
_SIDES = (  # of the cells of a padded map
    (slice(None, -2), _MIDDLE), (slice(2, None), _MIDDLE),
    (_MIDDLE, slice(None, -2)), (_MIDDLE, slice(2, None)),
)  # fmt: skip


class Frontier(NamedTuple):
    """A stretch of free cells beside unknown ones (Yamauchi 1997)."""

    place: Array  # (2,) m: its cell with the shortest path
    path_length: float  # m to there
    length: float  # m, about: its cells
    beyond: float  # m2 of unknown space beside it; infinite where that reaches the map's edge


def find_frontiers(
    grid: OccupancyGrid, pose: ArrayLike, radius: float, min_length: float = 0.4
) -> list[Frontier]:
    """The frontiers on which a disc can stand and which it can reach, the nearest first.

    Args:
        grid: the map so far.
        pose: of the chair (2 or 3,) [m, m, rad].
        radius: of the disc [m].
        min_length: shorter ones are left out, as gaps between beams [m].
    """
    unknown = np.pad(grid.cells == UNKNOWN, 1, constant_values=True)
    beside = np.logical_or.reduce([unknown[side] for side in _SIDES])
    edge = grid.traversable(radius) & beside
    labels, count = ndimage.label(edge, np.ones((3, 3)))
    if count == 0:
        return []
    of = labels[edge] - 1
    places = grid.to_world(np.argwhere(edge))
    paths = geodesic(grid, np.asarray(pose, dtype=np.float64)[:2], radius).at(places)
    lengths = np.bincount(of, minlength=count) * grid.resolution
    regions, _ = ndimage.label(unknown)
    areas = np.bincount(regions.ravel()) * grid.resolution**2
    areas[0], areas[regions[0, 0]] = 0.0, np.inf  # what is known; all that the padding touches
    around = np.max([areas[regions[side][edge]] for side in _SIDES], axis=0)  # (cells,)
    beyond = ndimage.maximum(around, of, np.arange(count))
    order = np.lexsort((paths, of))
    nearest = order[np.searchsorted(of[order], np.arange(count))]  # cell of each frontier
    found = [
        Frontier(places[k], float(paths[k]), float(lengths[of[k]]), float(beyond[of[k]]))
        for k in nearest
        if np.isfinite(paths[k]) and lengths[of[k]] >= min_length
    ]
    return sorted(found, key=lambda frontier: frontier.path_length)


_FAN = math.radians(12.0)  # to each side of ahead, in which the wall is looked for
_FLAT = 0.02  # m: root mean square distance of echoes from a wall; the laser's noise is 15 mm
_SHARE = 0.7  # least share of echoes on the wall
_TURNED = math.radians(25.0)  # greatest angle between heading and wall normal


class Wall(NamedTuple):
    """A wall ahead, in the chair's frame."""

    distance: float  # m, of the axle's centre from it
    bearing: float  # rad, of its foot


def wall_ahead(laser: LaserSettings, ranges: ArrayLike) -> Wall:
    """The wall that a scan (beams,) [m] shows straight ahead.

    Raises:
        ValueError: its echoes do not lie on one.
    """
    echoes = read_scan(laser, ranges).echoes
    aside = np.arctan2(echoes[:, 1] - laser.y, echoes[:, 0] - laser.x)
    return fit_wall(echoes[np.abs(aside) <= _FAN])


def fit_wall(echoes: Array) -> Wall:
    """The wall that echoes (n, 2) [m] ahead lie on.

    Raises:
        ValueError: they do not lie on one.
    """
    if len(echoes) < 20:
        raise ValueError("the laser sees no wall ahead: face a flat one")
    x, y = echoes.T
    near = np.abs(x - np.median(x)) < 1.0
    if near.sum() < 2:
        raise ValueError("the laser finds no flat wall ahead: face one")
    for _ in range(8):
        slope, start = np.polyfit(y[near], x[near], 1)
        off = np.abs(x - start - slope * y) / math.hypot(1.0, slope)
        near = off < max(3.0 * _FLAT, 2.0 * float(np.median(off)))
        near = near & (off < 3.0 * _FLAT) if (off < 3.0 * _FLAT).sum() >= 20 else near
    rms = float(np.sqrt(np.mean(off[near] ** 2)))
    if near.mean() < _SHARE or rms > _FLAT:
        raise ValueError("the laser finds no flat wall ahead: face one")
    bearing = -math.atan(slope)
    if abs(bearing) > _TURNED:
        raise ValueError(
            f"the wall ahead is turned by {math.degrees(bearing):.0f} deg; expected to face it "
            f"within {math.degrees(_TURNED):.0f} deg"
        )
    return Wall(float(start) * math.cos(bearing), bearing)

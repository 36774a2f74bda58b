"""The map around the chair, from its own readings, and assumptions about what it has not seen.

The laser sees 270 degrees from the front: what slips out of its view is remembered while the chair
drives by. Wheel counts carry that memory, and they steady a pose estimate whose error wanders. What
further scanners hit is added; `wheelchair_gym.perception` tracks actors by the first one alone.

What a given map explains is static. Of the rest, what is tracked and moves, or has just moved, is
an actor (people, pushed things); all else is a temporary obstacle (T1 3.2.2), and so is the leaf of
a door. Without a given map, all that does not move is static. Nothing here knows the truth.
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agents.control.rollout import stopping_distance
from planners.smoothing.shortcut import subdivided
from wheelchair_gym.base.arrays import Array, Mask
from wheelchair_gym.geometry.kinematics import Limits, odometric_step
from wheelchair_gym.geometry.outline import Footprint, clearance_to_points
from wheelchair_gym.geometry.planar import to_frame, to_world, wrap_angle
from wheelchair_gym.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, open_floor
from wheelchair_gym.maps.distance import within_distance
from wheelchair_gym.perception.track_state import DOOR
from wheelchair_gym.perception.tracker import Tracker
from wheelchair_gym.safety import Shield, ShieldSettings
from wheelchair_gym.sensors.settings import LaserSettings
from wheelchair_gym.types import Mission, Reading

REACH = 2.4  # m: a chair with default limits sweeps less than this before it can rest
VOXEL = 0.04  # m: hits within one voxel become their mean, which also averages noise
CLOSE = 1.3  # m: beyond, voxels are twice as large
MEMORY = 15.0  # s for which a hit is remembered out of sight
BESIDE_ACTOR = 0.15  # m: hits so near the disc of what moves are of it
PAUSE = 3.0  # s after which what has moved counts as standing
LIVELY = 3.0  # s for which the hits of somebody who stands are remembered out of sight
SETTLE = 3.0  # s over which the pose estimate corrects the wheel counts, so that it never jumps


def sampled_walls(walls: Array) -> Array:
    """Points (k, 2) [m] along walls (n, 4), ends included, at most 5 cm apart."""
    return np.concatenate([subdivided(walls, 0.05), walls[:, 2:]])


def voxel_means(points: Array, size: float) -> Array:
    """One mean (k, 2) for each voxel [m] that holds any of the points (n, 2)."""
    cells = np.floor(points / size).astype(np.int64)
    _, index, counts = np.unique(
        cells[:, 0] * 100_003 + cells[:, 1], return_inverse=True, return_counts=True
    )
    sums = [np.bincount(index, points[:, axis]) / counts for axis in (0, 1)]
    return np.stack(sums, axis=-1)


def bearings(points: Array, laser: LaserSettings) -> Array:
    """Angles (n,) [rad] in [-pi, pi) off the laser's axis to points (n, 2) of the chair's frame."""
    bearing = np.arctan2(points[:, 1] - laser.y, points[:, 0] - laser.x) - laser.yaw
    return wrap_angle(bearing)


def near_discs(points: Array, actors: Array) -> Mask:
    """Return which points (n, 2) are of actors (m, 5 or more), as `LocalMap.actors`."""
    off = points[:, None] - actors[None, :, :2]  # (n, m, 2)
    near = np.hypot(off[..., 0], off[..., 1]) < actors[:, 4] + BESIDE_ACTOR
    return np.asarray(near.any(axis=1))


def _moved(pose: Array, way: float, turn: float) -> Array:
    x, y, yaw = pose
    return np.array(odometric_step(x, y, yaw, way, turn))


class LocalMap:
    """The chair's pose and the obstacles near it, updated by every reading.

    Attributes:
        outline: of the chair (3,), `Footprint.array`.
        pose: (3,) [m, m, rad] in the map's frame.
        hits: obstacles (k, 2) [m] in the chair's frame that the scanners saw, now or lately.
        points: hits, and obstacles that only the map knows of, (k, 3): x, y, distance from the
            axle's centre [m], the nearest first.
        actors: what moves (m, 8): x, y [m], vx, vy [m/s], radius [m] in the chair's frame, and the
            variance of place, its covariance with speed, and the variance of speed, the same along
            each axis; its hits are not among the others.
        temporary: temporary obstacles, in the map's frame.
        looks_back: a sensor sees the space behind the chair.
        blind: the space behind the chair is unknown, so that it must not reverse.
    """

    def __init__(self, mission: Mission) -> None:
        reading = mission.reading
        grid = mission.map_at(reading)
        self.blind, self.looks_back = False, mission.sensors.looks_back
        self._laser = mission.sensors.laser
        self.outline = mission.footprint.array
        # m: faster chairs, and those that brake less, sweep more than `REACH`.
        more = stopping_distance(mission.limits) - stopping_distance(Limits())
        self._reach = REACH + max(0.0, more)
        self.set_walls(grid)
        self._tracker = Tracker(laser=self._laser)
        # A map that the chair draws shows actors as well: nothing would stand out against it.
        self._known = None if mission.map is None else grid
        self.temporary = TemporaryObstacles(grid, self._laser)
        self._beams = self._laser.directions
        self._more = list(zip(mission.sensors.lasers, mission.sensors.slices, strict=True))[1:]
        self._odometry = np.zeros(3)  # dead reckoning, the frame of the memory
        self._memory = np.empty((0, 3))  # x, y, stamp until which it is remembered
        self._standing = np.empty((0, 5))  # what may go on any moment, as `actors`
        self._stamp = reading.stamp
        self.pose: Array = np.array(reading.pose, dtype=np.float64)
        self.hits: Array = np.empty((0, 2))
        self.points: Array = np.empty((0, 3))
        self.actors: Array = np.empty((0, 8))
        # Also where nothing filters commands: then a shield's defaults say what is too fast.
        shield = dataclasses.replace(mission.shield or ShieldSettings(), tracks=False)
        self._shield = Shield(shield, mission.chair, mission.sensors, mission.period)
        self._sense(reading)

    def set_walls(self, grid: OccupancyGrid) -> None:
        """Use the walls of a map for what the laser does not see."""
        self._walls = sampled_walls(grid.walls())
        self._near_walls, self._near = self._walls, np.full(2, np.inf)  # those near a point

    def margins(self, margin: float) -> tuple[float, float, float]:
        """Margins [m] to ask for, one after another where nothing leads on.

        The last is nearly what is left: an outline already nearer may leave, not come nearer.
        """
        less = 0.6 * margin
        gap = float(clearance_to_points(0.0, 0.0, 0.0, self.outline, self.points, margin))
        return margin, less, min(less, 0.95 * gap)

    def limit_for_unseen_space(self, twists: Array, motion: Array) -> Array:
        """Twists (n, 2) slowed where the chair has not looked; see the method of `Shield`."""
        return self._shield.limit_for_unseen_space(twists, motion)

    def update(self, reading: Reading) -> None:
        """Update everything from the next reading."""
        period = reading.stamp - self._stamp
        if period <= 0.0:
            return
        self._stamp = reading.stamp
        way, turn = float(reading.twist[0]) * period, float(reading.twist[1]) * period
        self._odometry = _moved(self._odometry, way, turn)
        pose = _moved(self.pose, way, turn)
        off = np.asarray(reading.pose, dtype=np.float64) - pose
        off[2] = math.remainder(off[2], 2 * math.pi)
        self.pose = pose + off * min(1.0, period / SETTLE)
        self._sense(reading)

    def _sense(self, reading: Reading) -> None:
        self._shield.update(reading)
        laser = self._laser
        ranges = np.asarray(reading.laser[: laser.beams], dtype=np.float64)
        ranges = np.where(ranges < laser.range_min, laser.range_min, ranges)  # or nearer
        near = ranges < max(DRAWN_RANGE, self._reach + laser.x)  # false for NaN
        seen = self._beams[near] * ranges[near, None] + (laser.x, laser.y)
        static = ranges[near] < self._reach + laser.x
        self._track(reading)
        moving = near_discs(seen, self.actors)
        if self._known is not None:
            unmapped = ~self.temporary.explains(seen, ranges[near], self.pose)
            moving &= unmapped
            self.temporary.update(
                seen[unmapped & ~moving], self._standing, ranges, self.pose, reading.stamp
            )
        static &= ~moving
        seen = seen[static]
        if self._more:
            seen = np.concatenate([seen, *(self._more_hits(reading, *one) for one in self._more)])
        close = np.all(np.abs(seen) < CLOSE, axis=1)
        seen = np.concatenate(
            [voxel_means(seen[close], VOXEL), voxel_means(seen[~close], 2 * VOXEL)]
        )
        recent = self._memory[self._memory[:, 2] > reading.stamp]
        old = to_frame(recent[:, :2], self._odometry)
        within = np.all(np.abs(old) < self._reach, axis=1)
        hidden = (np.abs(bearings(old, laser)) > 0.5 * laser.fov) & within
        for other, _ in self._more:
            hidden &= (np.abs(bearings(old, other)) > 0.5 * other.fov) | (
                np.hypot(old[:, 0] - other.x, old[:, 1] - other.y) > other.reach
            )
        last = np.where(near_discs(seen, self._standing), LIVELY, MEMORY)
        stamped = np.column_stack([seen, reading.stamp + last])
        kept = np.column_stack([old, recent[:, 2]])[hidden]
        local = np.concatenate([stamped, kept])  # (k, 3)
        self.hits = local[:, :2]
        self._memory = np.column_stack([to_world(self.hits, self._odometry), local[:, 2]])
        mapped = to_frame(self._walls_near(), self.pose)
        # Where the laser looks it knows better than a map seen from an uncertain pose.
        mapped = mapped[np.abs(bearings(mapped, laser)) > 0.5 * laser.fov]
        points = np.concatenate([self.hits, mapped])
        front, rear, half = self.outline
        x, y = points[:, 0], points[:, 1]
        under = (x < front) & (x > -rear) & (np.abs(y) < half)
        points = points[~under]  # the chair stands there: nothing else does
        far = np.hypot(points[:, 0], points[:, 1])
        nearest = np.argsort(far)
        self.points = np.column_stack([points, far])[nearest]

    def _track(self, reading: Reading) -> None:
        """Update the actors: what is seen to move, or has moved within `PAUSE`, and is no leaf."""
        scan = reading.laser[: self._laser.beams]
        tracks = self._tracker.update(scan, self.pose, reading.twist, reading.stamp, self._known)
        place = to_frame(tracks.place, self.pose)
        velocity = to_frame(tracks.velocity, (0.0, 0.0, self.pose[2]))
        spread = tracks.covariance.reshape(-1, 4)[:, [0, 1, 3]]
        rows = np.column_stack([place, velocity, tracks.radius, spread])
        moves, lively = tracks.still < PAUSE, tracks.confirmed & (tracks.kind != DOOR)
        self.actors, self._standing = rows[lively & moves], rows[lively & ~moves]

    def _more_hits(self, reading: Reading, laser: LaserSettings, at: slice) -> Array:
        """Return hits (k, 2) [m] of a further scanner, except on actors that the first tracks."""
        ranges = np.asarray(reading.laser[at], dtype=np.float64)
        ranges = np.where(np.isneginf(ranges), laser.range_min, ranges)
        origin = np.array([laser.x, laser.y])
        near = ranges < self._reach + math.hypot(laser.x, laser.y)  # false for NaN
        hits: Array = origin + laser.directions[near] * ranges[near, None]
        return hits[~near_discs(hits, self.actors)]

    def _walls_near(self) -> Array:
        """Points of mapped walls within reach; selected anew every half metre of way."""
        if np.abs(self.pose[:2] - self._near).max() > 0.5:
            self._near = self.pose[:2].copy()
            near = (np.abs(self._walls - self._near) < self._reach + 0.5).all(axis=1)
            self._near_walls = self._walls[near]
        return self._near_walls


DRAWN_RANGE = 4.0  # m: beyond, a heading error moves a hit by more than a cell
TEMPORARY_MEMORY = 20.0  # s for which an unobserved temporary obstacle is remembered
MIN_AGE = 1.0  # s for which an obstacle must have been seen before it counts: others pass
THROUGH = 0.25  # m that a beam must reach farther to show that a place is empty now
EXPLAINED = 0.15  # m from a mapped wall, and
SPREADING = 0.03  # m more per metre of range, for the heading's error: the map explains a hit


class TemporaryObstacles:
    """Static hits that no mapped wall explains, by cells of the map, until they are seen gone."""

    def __init__(self, grid: OccupancyGrid, laser: LaserSettings) -> None:
        self._grid, self._far, self._laser = grid, grid.distance(), laser
        self._cells = np.empty((0, 2), np.int64)  # row, col
        # When each was seen first and last [s], and for how long it is remembered [s].
        self._times = np.empty((0, 3))

    def explains(self, hits: Array, ranges: Array, pose: Array) -> Mask:
        """Mask of hits (n, 2) at ranges (n,) [m]: explained by a mapped wall, or off the map."""
        cells = self._grid.to_cell(to_world(hits, pose))
        explained = np.ones(len(hits), bool)
        on = ((cells >= 0) & (cells < self._grid.shape)).all(axis=1)
        explained[on] = self._far[tuple(cells[on].T)] <= EXPLAINED + SPREADING * ranges[on]
        return explained

    def update(
        self, hits: Array, standing: Array, ranges: Array, pose: Array, stamp: float
    ) -> None:
        """Update from a scan.

        Args:
            hits: static hits that are not on the map (n, 2) [m] in the chair's frame.
            standing: who stands and may go on (m, 5 or more), as `LocalMap.actors`.
            ranges: the whole scan (beams,) [m], no echo infinite.
            pose: of the chair (3,).
            stamp: [s].
        """
        self._forget(ranges, pose, stamp)
        near = hits[np.hypot(hits[:, 0], hits[:, 1]) < DRAWN_RANGE]
        cells = self._grid.to_cell(to_world(near, pose))
        cells = cells[((cells >= 0) & (cells < self._grid.shape)).all(axis=1)]
        columns = self._grid.shape[1]
        now = np.unique(cells[:, 0] * columns + cells[:, 1])
        before = self._cells[:, 0] * columns + self._cells[:, 1]
        self._times[np.isin(before, now), 1] = stamp
        fresh = now[~np.isin(now, before)]
        self._cells = np.concatenate([self._cells, np.stack(np.divmod(fresh, columns), axis=-1)])
        begun = np.tile((stamp, stamp, TEMPORARY_MEMORY), (len(fresh), 1))
        self._times = np.concatenate([self._times, begun])
        at = to_frame(self._grid.to_world(self._cells), pose)
        brief = near_discs(at, standing)
        seen = self._times[:, 1] == stamp
        self._times[seen, 2] = np.where(brief[seen], LIVELY, TEMPORARY_MEMORY)

    def _forget(self, ranges: Array, pose: Array, stamp: float) -> None:
        """Drop what is long out of sight, and what a beam has gone through."""
        if not len(self._cells):
            return
        at, laser = to_frame(self._grid.to_world(self._cells), pose), self._laser
        bearing = bearings(at, laser)
        beam = np.round((bearing / laser.fov + 0.5) * (len(ranges) - 1)).astype(np.int64)
        inside = (beam >= 0) & (beam < len(ranges))
        reached = np.where(inside, ranges[np.clip(beam, 0, len(ranges) - 1)], 0.0)
        distance = np.hypot(at[:, 0] - laser.x, at[:, 1] - laser.y)
        gone = np.nan_to_num(reached, nan=0.0, posinf=np.inf) > distance + THROUGH
        kept = ~gone & (stamp - self._times[:, 1] < self._times[:, 2])
        self._cells, self._times = self._cells[kept], self._times[kept]

    @property
    def points(self) -> Array:
        """Centres (n, 2) [m] of the cells where something has stood for a while."""
        age = self._times[:, 1] - self._times[:, 0]
        return self._grid.to_world(self._cells[age > MIN_AGE])

    def painted(self) -> OccupancyGrid:
        """The map with all of this in it."""
        cells = self._grid.cells.copy()
        cells[self._cells[:, 0], self._cells[:, 1]] = OCCUPIED
        return OccupancyGrid(cells, self._grid.resolution, self._grid.origin)

    def blocks(self, way: Array, clearance: float) -> bool:
        """Whether any of it is nearer to a way (n, 2 or more) [m] than a clearance [m]."""
        points = self.points
        if not len(points) or not len(way):
            return False
        return bool(np.hypot(*(way[:, None, :2] - points).T).min() < clearance)


MAP_MARGIN = 5.0  # m: policies extend a map by this, so that paths may lead through the unknown
BLIND = 1.5  # m: an unseen obstacle nearer than this may be hit before it is seen
BESIDE = 0.10  # m round the chair, where the space is taken to be free
BEHIND = 0.25  # m: stopping distance in reverse at 0.2 m/s
SPACING = 0.025  # m between the points under the outline, and the smallest move that is stamped
RESERVE = 128  # extra cells of the rasters of `FloorMemory` when they grow
# m: a square this wide must be all free to count as open floor; smaller free patches may be an
# error in where a wall lies
FLOOR = 0.2
MIN_TURN = 0.05  # rad: smallest turn that is stamped
JITTER = 2.0  # cells by which a wall may seem nearer when it is seen again


def assumed_maps(grid: OccupancyGrid, pose: Array, footprint: Footprint) -> list[OccupancyGrid]:
    """Return three maps to plan in; each is tried if the one before leads nowhere.

    1. Unknown space within `BLIND` is solid, except where the chair stands: it sees nothing behind
       it, so it drives forward before it turns.
    2. The same, but the circle in which the chair turns on the spot is free.
    3. The map as it is.

    Other unknown space stays unknown: planners take it for free (the free-space assumption: Koenig
    and Likhachev 2005), and the laser sees it before the chair is there. Callers rely on the order:
    `Surroundings.blocks_now` takes the second, `Search` treats the last differently.

    Args:
        grid: what was seen so far.
        pose: of the chair (3,) [m, m, rad].
        footprint: of the chair.
    """
    low, high = footprint.corners[0] - BESIDE, footprint.corners[2] + BESIDE
    turning = math.hypot(footprint.rear, footprint.half_width) + BESIDE
    stands = _fill(grid, pose, FREE, lambda at: ((at > low) & (at < high)).all(axis=-1))
    turns = _fill(grid, pose, FREE, _within(turning))
    return [_fill(each, pose, OCCUPIED, _within(BLIND)) for each in (stands, turns)] + [grid]


def with_free_footprint(grid: OccupancyGrid, pose: Array, footprint: Footprint) -> OccupancyGrid:
    """Return a map in which unknown space under and beside the chair is free: paths begin there."""
    return _fill(grid, pose, FREE, _within(footprint.reach + BESIDE))


def _within(radius: float) -> Callable[[Array], NDArray[np.bool_]]:
    """Return which points (..., 2) [m] in the chair's frame lie near its axle's centre."""
    return lambda at: np.hypot(at[..., 0], at[..., 1]) < radius


def _fill(
    grid: OccupancyGrid, pose: Array, value: int, chosen: Callable[[Array], NDArray[np.bool_]]
) -> OccupancyGrid:
    """Return a map with a value in chosen unknown cells within `BLIND` of a pose.

    `chosen` tells which points (..., 2) [m] in the chair's frame are chosen.
    """
    cells, reach = grid.cells.copy(), math.ceil(BLIND / grid.resolution)
    middle = grid.to_cell(pose[:2])
    begin, end = np.maximum(middle - reach, 0), np.maximum(middle + reach + 1, 0)
    part = cells[begin[0] : end[0], begin[1] : end[1]]
    at = grid.to_world(begin + np.moveaxis(np.indices(part.shape), 0, -1))
    part[chosen(to_frame(at, pose)) & (part == UNKNOWN)] = value
    return OccupancyGrid(cells, grid.resolution, grid.origin)


class FloorMemory:
    """Memory of floor that the newest map lacks, for a chair that draws its map itself.

    Floor on which the chair has stood is free, even if the laser never saw it. Floor that was open
    may be open again: a door opens, a person goes on.

    Args:
        footprint: of the chair.
    """

    def __init__(self, footprint: Footprint) -> None:
        low, high = footprint.corners[0], footprint.corners[2]
        sides = [np.arange(a, b, SPACING) for a, b in zip(low, high, strict=True)]
        self._under = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
        self._stood = np.zeros((0, 0), np.bool_)  # raster of cells on which the chair has stood
        self._open = np.zeros((0, 0), np.bool_)  # raster of cells that have been open floor
        self._first = np.zeros(2, np.int64)  # row and column of their first cell, from (0, 0)
        self._pose = np.full(3, np.inf)  # where cells were last added
        self._grid: OccupancyGrid | None = None  # the last map given
        self._freed_grid: OccupancyGrid | None = None  # the map returned for it

    def with_stood_cells_free(self, grid: OccupancyGrid, pose: Array) -> OccupancyGrid:
        """Return a map in which unknown cells where the chair stands (pose (3,)) or stood are free.

        The cells of all maps given must be those of one endless grid about (0, 0), as SLAM's are.
        """
        distance, turn = np.hypot(*(pose[:2] - self._pose[:2])), abs(pose[2] - self._pose[2])
        moved = distance > SPACING or turn > MIN_TURN
        if moved:
            at = np.floor(to_world(self._under, pose) / grid.resolution).astype(np.int64)[:, ::-1]
            self._grow_to_hold(at.min(axis=0), at.max(axis=0) + 1)
            self._stood[tuple((at - self._first).T)] = True
            self._pose = pose.copy()
        if grid is not self._grid:
            begin = _first_cell(grid)
            self._grow_to_hold(begin, begin + grid.shape)
            row, column = begin - self._first
            part = self._open[row : row + grid.shape[0], column : column + grid.shape[1]]
            part |= open_floor(grid, FLOOR)
        if moved or grid is not self._grid or self._freed_grid is None:
            self._freed_grid = self._freed(grid, self._stood, UNKNOWN)
            self._grid = grid
        return self._freed_grid

    def reopened(self, grid: OccupancyGrid) -> OccupancyGrid:
        """Return the map with occupied cells freed where floor was open; itself if none are."""
        return self._freed(grid, self._open, OCCUPIED)

    def forget_open(self) -> None:
        """Forget all floor that was open."""
        self._open[:] = False

    def _freed(self, grid: OccupancyGrid, where: NDArray[np.bool_], old: int) -> OccupancyGrid:
        """Return the map with the cells freed that have an old value and are set in a raster."""
        first = self._first - _first_cell(grid)  # in the map's rows and columns
        begin = np.maximum(first, 0)
        end = np.minimum(first + where.shape, grid.shape)
        if (begin >= end).any():
            return grid
        (row, column), (last_row, last_column) = begin - first, end - first
        part = np.s_[begin[0] : end[0], begin[1] : end[1]]
        chosen = where[row:last_row, column:last_column] & (grid.cells[part] == old)
        if not chosen.any():
            return grid
        cells = grid.cells.copy()
        cells[part][chosen] = FREE
        return OccupancyGrid(cells, grid.resolution, grid.origin)

    def _grow_to_hold(self, begin: NDArray[np.int64], end: NDArray[np.int64]) -> None:
        """Grow the rasters until they hold the cells from begin to end."""
        if not self._stood.size:
            self._first = begin
        last = self._first + self._stood.shape
        before = np.where(begin < self._first, self._first - begin + RESERVE, 0)
        after = np.where(end > last, end - last + RESERVE, 0)
        if before.any() or after.any():
            around = np.stack([before, after], axis=-1)
            self._stood, self._open = np.pad(self._stood, around), np.pad(self._open, around)
            self._first = self._first - before


def _first_cell(grid: OccupancyGrid) -> NDArray[np.int64]:
    """Row and column (2,) of a map's first cell, counted from (0, 0) [m]."""
    left, bottom = np.round(np.array(grid.origin[:2]) / grid.resolution).astype(np.int64)
    return np.array([bottom, left])


def blind_behind(grid: OccupancyGrid, pose: Array, footprint: Footprint) -> bool:
    """Return True if a strip of length `BEHIND` behind the chair has a cell that was never seen.

    Cells behind a wall do not count: nothing comes through, and the chair does not drive there.
    """
    x = -footprint.rear - np.linspace(0.0, BEHIND, 8)
    y = np.linspace(-footprint.half_width, footprint.half_width, 15)
    there = cells_at(grid, to_world(np.stack(np.meshgrid(x, y), axis=-1), pose))  # (15, 8)
    open_so_far = np.logical_and.accumulate(there != OCCUPIED, axis=1)
    return bool(((there == UNKNOWN) & open_so_far).any())


def cells_at(grid: OccupancyGrid, points: Array) -> NDArray[np.int8]:
    """Return a grid's cells (...) at points (..., 2) [m]; unknown outside the grid."""
    cells = grid.to_cell(points)
    on = ((cells >= 0) & (cells < grid.shape)).all(axis=-1)
    found = np.full(on.shape, UNKNOWN, np.int8)
    found[on] = grid.cells[tuple(cells[on].T)]
    return found


def walls_block(grid: OccupancyGrid, path: ArrayLike, clearance: float) -> bool:
    """Return True if a wall is nearer to a path (n, 2 or 3) [m] than its planned clearance."""
    cells = grid.to_cell(np.asarray(path, dtype=np.float64)[:, :2])
    cells = cells[((cells >= 0) & (cells < grid.shape)).all(axis=1)]
    close = within_distance(grid.solid().view(np.int8), clearance / grid.resolution - JITTER)
    return bool((close[cells[:, 0], cells[:, 1]] != 0).any())

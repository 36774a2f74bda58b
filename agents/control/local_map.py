"""The map around the chair: its pose, obstacles near it, and what moves, from its own readings.

The laser sees 270 degrees from the front: what slips out of its view is remembered while the chair
drives by. Wheel counts carry that memory, and they steady a pose estimate whose error wanders. What
further scanners hit is added; actors are tracked by the first one alone.

What the given map explains is static. The rest falls into clusters, which are tracked from scan to
scan in the frame of dead reckoning: those that move are dynamic (people, pushed things), the others
are temporary obstacles (T1 3.2.2). Nothing here knows the truth.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.geometry import clearance_to_points, to_frame, to_world
from wheelchair_gym.kinematics import odometric_step
from wheelchair_gym.maps import OCCUPIED, OccupancyGrid
from wheelchair_gym.safety import Shield
from wheelchair_gym.sensors.settings import LaserSettings
from wheelchair_gym.types import Mission, Reading

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

REACH = 2.4  # m: a chair at 0.8 m/s sweeps less than this before it can rest
VOXEL = 0.04  # m: hits within one voxel become their mean, which also averages noise
CLOSE = 1.3  # m: beyond, voxels are twice as large
MEMORY = 15.0  # s for which a hit is remembered out of sight
BESIDE_ACTOR = 0.15  # m: hits so near the disc of what moves are of it
SETTLE = 3.0  # s over which the pose estimate corrects the wheel counts, so that it never jumps


def sampled_walls(walls: Array, spacing: float = 0.05) -> Array:
    """Points (k, 2) [m] along walls (n, 4), ends included, at most `spacing` apart."""
    begin, step = walls[:, :2], walls[:, 2:] - walls[:, :2]
    counts = np.maximum(1, np.ceil(np.hypot(*step.T) / spacing)).astype(np.int64)  # of intervals
    wall = np.repeat(np.arange(len(walls)), counts + 1)  # which wall each point belongs to
    first = np.cumsum(counts + 1) - (counts + 1)
    share = (np.arange(len(wall)) - first[wall]) / counts[wall]
    points: Array = begin[wall] + share[:, None] * step[wall]
    return points


def voxel_means(points: Array, size: float) -> Array:
    """One mean (k, 2) for each voxel [m] that holds any of the points (n, 2)."""
    if not len(points):
        return points
    cells = np.floor(points / size).astype(np.int64)
    _, index, counts = np.unique(
        cells[:, 0] * 100_003 + cells[:, 1], return_inverse=True, return_counts=True
    )
    sums = [np.bincount(index, points[:, axis]) / counts for axis in (0, 1)]
    return np.stack(sums, axis=-1)


def bearings(points: Array, laser: LaserSettings) -> Array:
    """Angles (n,) [rad] in [-pi, pi) off the laser's axis to points (n, 2) of the chair's frame."""
    bearing = np.arctan2(points[:, 1] - laser.y, points[:, 0] - laser.x) - laser.yaw
    wrapped: Array = np.remainder(bearing + math.pi, 2 * math.pi) - math.pi
    return wrapped


def _moved(pose: Array, way: float, turn: float) -> Array:
    x, y, yaw = pose
    return np.array(odometric_step(x, y, yaw, way, turn))


class LocalMap:
    """The chair's pose and the obstacles near it, updated by every reading.

    Attributes:
        pose: (3,) [m, m, rad] in the map's frame.
        hits: obstacles (k, 2) [m] in the chair's frame that the scanners saw, now or lately.
        points: hits, and obstacles that only the map knows of, (k, 3): x, y, distance from the
            axle's centre [m], the nearest first.
        actors: what moves (m, 5): x, y [m], vx, vy [m/s], radius [m] in the chair's frame; its hits
            are not among the others.
        temporary: temporary obstacles, in the map's frame.
        blind: the space behind the chair is unknown, so that it must not reverse.
    """

    def __init__(self, mission: Mission) -> None:
        reading = mission.reading
        grid = mission.map_at(reading)
        self.blind = False
        self._laser = mission.sensors.laser
        self._outline = mission.footprint.array
        self.set_walls(grid)
        # A map that the chair draws shows actors as well: nothing would stand out against it.
        self._tracks = None if mission.map is None else Tracks(grid, self._laser)
        self.temporary = TemporaryObstacles(grid)
        self._beams = self._laser.directions
        self._more = list(zip(mission.sensors.lasers, mission.sensors.slices, strict=True))[1:]
        self._odometry = np.zeros(3)  # dead reckoning, the frame of the memory
        self._memory = np.empty((0, 3))  # x, y, stamp
        self._stamp = reading.stamp
        self.pose: Array = np.array(reading.pose, dtype=np.float64)
        self.hits: Array = np.empty((0, 2))
        self.points: Array = np.empty((0, 3))
        self.actors: Array = np.empty((0, 5))
        # Also where nothing filters commands: then a shield's defaults say what is too fast.
        self._shield = Shield(mission.shield, mission.chair, mission.sensors, mission.period)
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
        gap = float(clearance_to_points(0.0, 0.0, 0.0, self._outline, self.points, margin))
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
        near = np.isfinite(ranges) & (ranges < TRACKING_RANGE) & (ranges > laser.range_min)
        seen = self._beams[near] * ranges[near, None] + (laser.x, laser.y)
        static = ranges[near] < REACH + laser.x
        if self._tracks is not None:
            origin = np.array([laser.x, laser.y])
            self._tracks.update(seen, origin, self.pose, self._odometry, reading.stamp)
            self.actors = self._tracks.actors(self._odometry)
            moving, unmapped = self._tracks.dynamic, self._tracks.unmapped
            self.temporary.update(seen[unmapped & ~moving], ranges, laser, self.pose, reading.stamp)
            static &= ~moving
        seen = seen[static]
        if self._more:
            seen = np.concatenate([seen, *(self._more_hits(reading, *one) for one in self._more)])
        close = np.all(np.abs(seen) < CLOSE, axis=1)
        seen = np.concatenate(
            [voxel_means(seen[close], VOXEL), voxel_means(seen[~close], 2 * VOXEL)]
        )
        recent = self._memory[self._memory[:, 2] > reading.stamp - MEMORY]
        old = to_frame(recent[:, :2], self._odometry)
        within = np.all(np.abs(old) < REACH, axis=1)
        hidden = (np.abs(bearings(old, laser)) > 0.5 * laser.fov) & within
        for other, _ in self._more:
            hidden &= (np.abs(bearings(old, other)) > 0.5 * other.fov) | (
                np.hypot(old[:, 0] - other.x, old[:, 1] - other.y) > other.reach
            )
        stamped = np.column_stack([seen, np.full(len(seen), reading.stamp)])
        kept = np.column_stack([old, recent[:, 2]])[hidden]
        local = np.concatenate([stamped, kept])  # (k, 3)
        self.hits = local[:, :2]
        self._memory = np.column_stack([to_world(self.hits, self._odometry), local[:, 2]])
        mapped = to_frame(self._walls_near(), self.pose)
        # Where the laser looks it knows better than a map seen from an uncertain pose.
        mapped = mapped[np.abs(bearings(mapped, laser)) > 0.5 * laser.fov]
        points = np.concatenate([self.hits, mapped])
        front, rear, half = self._outline
        x, y = points[:, 0], points[:, 1]
        under = (x < front) & (x > -rear) & (np.abs(y) < half)
        points = points[~under]  # the chair stands there: nothing else does
        far = np.hypot(points[:, 0], points[:, 1])
        nearest = np.argsort(far)
        self.points = np.column_stack([points, far])[nearest]

    def _more_hits(self, reading: Reading, laser: LaserSettings, at: slice) -> Array:
        """What a further scanner hits (k, 2) [m], without what the first one knows to move."""
        ranges = np.asarray(reading.laser[at], dtype=np.float64)
        ranges = np.where(np.isneginf(ranges), laser.range_min, ranges)
        origin = np.array([laser.x, laser.y])
        near = ranges < REACH + math.hypot(laser.x, laser.y)  # false for NaN
        hits: Array = origin + laser.directions[near] * ranges[near, None]
        for x, y, _, _, radius in self.actors:
            hits = hits[np.hypot(hits[:, 0] - x, hits[:, 1] - y) > radius + BESIDE_ACTOR]
        return hits

    def _walls_near(self) -> Array:
        """Points of mapped walls within reach; selected anew every half metre of way."""
        if np.abs(self.pose[:2] - self._near).max() > 0.5:
            self._near = self.pose[:2].copy()
            near = (np.abs(self._walls - self._near) < REACH + 0.5).all(axis=1)
            self._near_walls = self._walls[near]
        return self._near_walls


DRAWN_RANGE = 4.0  # m: beyond, a heading error moves a hit by more than a cell
TEMPORARY_MEMORY = 20.0  # s for which an unobserved temporary obstacle is remembered
MIN_AGE = 1.0  # s for which an obstacle must have been seen before it counts: others pass
THROUGH = 0.25  # m that a beam must reach farther to show that a place is empty now


class TemporaryObstacles:
    """Static hits that no mapped wall explains, by cells of the map, until they are seen gone."""

    def __init__(self, grid: OccupancyGrid) -> None:
        self._grid = grid
        self._cells = np.empty((0, 2), np.int64)  # row, col
        self._first_seen, self._last_seen = np.empty(0), np.empty(0)  # stamps [s]

    def update(
        self, hits: Array, ranges: Array, laser: LaserSettings, pose: Array, stamp: float
    ) -> None:
        """Update from a scan.

        Args:
            hits: static hits that are not on the map (n, 2) [m] in the chair's frame.
            ranges: the whole scan (beams,) [m], no echo infinite.
            laser: its settings.
            pose: of the chair (3,).
            stamp: [s].
        """
        self._forget(ranges, laser, pose, stamp)
        near = hits[np.hypot(hits[:, 0], hits[:, 1]) < DRAWN_RANGE]
        cells = self._grid.to_cell(to_world(near, pose))
        cells = cells[((cells >= 0) & (cells < self._grid.shape)).all(axis=1)]
        columns = self._grid.shape[1]
        now = np.unique(cells[:, 0] * columns + cells[:, 1])
        before = self._cells[:, 0] * columns + self._cells[:, 1]
        self._last_seen[np.isin(before, now)] = stamp
        fresh = now[~np.isin(now, before)]
        self._cells = np.concatenate([self._cells, np.stack(np.divmod(fresh, columns), axis=-1)])
        self._first_seen = np.append(self._first_seen, np.full(len(fresh), stamp))
        self._last_seen = np.append(self._last_seen, np.full(len(fresh), stamp))

    def _forget(self, ranges: Array, laser: LaserSettings, pose: Array, stamp: float) -> None:
        """Drop what is long out of sight, and what a beam has gone through."""
        if not len(self._cells):
            return
        at = to_frame(self._grid.to_world(self._cells), pose)
        bearing = bearings(at, laser)
        beam = np.round((bearing / laser.fov + 0.5) * (len(ranges) - 1)).astype(np.int64)
        inside = (beam >= 0) & (beam < len(ranges))
        reached = np.where(inside, ranges[np.clip(beam, 0, len(ranges) - 1)], 0.0)
        distance = np.hypot(at[:, 0] - laser.x, at[:, 1] - laser.y)
        gone = np.nan_to_num(reached, nan=0.0, posinf=np.inf) > distance + THROUGH
        kept = ~gone & (stamp - self._last_seen < TEMPORARY_MEMORY)
        self._cells, self._first_seen = self._cells[kept], self._first_seen[kept]
        self._last_seen = self._last_seen[kept]

    @property
    def points(self) -> Array:
        """Centres (n, 2) [m] of the cells where something has stood for a while."""
        return self._grid.to_world(self._cells[self._last_seen - self._first_seen > MIN_AGE])

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


TRACKING_RANGE = 8.0  # m: someone at 1.5 m/s needs 5 s from there
EXPLAINED = 0.15  # m from a mapped wall, and
SPREADING = 0.03  # m more per metre of range, for the heading's error: the map explains a hit
CLUSTER_GAP = 0.20  # m between neighbours of one cluster, at least
MIN_HITS = 4  # of a cluster
MAX_WIDTH = 0.9  # m: shoulders and swinging arms; what is wider is a wall, a door leaf, a group
GATE = 0.45  # m between a track's prediction and the cluster that continues it
NOISE = 0.04  # m: of a cluster's centre, seen from another side a moment later
ACCELERATION = 3.0  # m/s2: process noise; how people change their speed where they turn back
LOST = 1.0  # s: a track that is not seen for so long where the laser looks is dropped
OUT_OF_VIEW = 8.0  # s: and so long where it does not look; meanwhile its speed decays
DECAY = 1.0  # 1/s: of that speed
TRACK_AGE = 0.4  # s after which a track may be called moving
MOVING_SPEED = 0.25  # m/s: it moves; a slow walk is 0.4
COVERED = 0.20  # m from where it was first seen, or stood last
STANDING_SPEED = 0.15  # m/s: it does not move
PAUSE = 3.0  # s: so long after, an actor that has moved may go on


class Track:
    """One thing that the map does not explain.

    Attributes:
        at: (4,) x, y [m], vx, vy [m/s] in the frame of dead reckoning.
        radius: [m].
        moved: stamp when it last moved [s]; -inf: never.
    """

    def __init__(self, place: Array, radius: float, stamp: float) -> None:
        self.at = np.array([*place, 0.0, 0.0])
        self.radius = radius
        self.first_seen = self.seen = stamp
        self.moved = -math.inf
        self._anchor = np.array(place)
        # Variances of place and speed, and their covariance: the same along x and y.
        self._p = np.array([NOISE**2, 0.0, 1.0])

    def predict(self, dt: float) -> None:
        """Move on by a time [s] at constant speed."""
        self.at[:2] += self.at[2:] * dt
        a, b, c = self._p
        q = ACCELERATION * ACCELERATION * dt
        self._p = np.array(
            [a + 2 * dt * b + dt * dt * c + q * dt**3 / 3, b + dt * c + q * dt**2 / 2, c + q * dt]
        )

    def correct(self, place: Array, radius: float, stamp: float) -> None:
        """Update from the cluster that continues the track (Kalman 1960)."""
        a, b, c = self._p
        gain_place, gain_speed = a / (a + NOISE**2), b / (a + NOISE**2)
        off = place - self.at[:2]
        self.at[:2] += gain_place * off
        self.at[2:] += gain_speed * off
        self._p = np.array([(1 - gain_place) * a, (1 - gain_place) * b, c - gain_speed * b])
        self.radius += 0.2 * (radius - self.radius)
        self.seen = stamp
        speed = math.hypot(self.at[2], self.at[3])
        covered = math.hypot(*(self.at[:2] - self._anchor))
        if speed > MOVING_SPEED and covered > COVERED and stamp - self.first_seen > TRACK_AGE:
            self.moved = stamp
        if speed < STANDING_SPEED and stamp - self.moved > 0.5:
            self._anchor += 0.2 * (self.at[:2] - self._anchor)

    def dynamic(self, stamp: float) -> bool:
        """Whether it moves, or may go on any moment."""
        return stamp - self.moved < PAUSE


class Tracks:
    """All that the map does not explain.

    Attributes:
        dynamic: hits of the last scan (n,) that belong to actors.
        unmapped: hits of the last scan (n,) that the map does not explain.
    """

    def __init__(self, grid: OccupancyGrid, laser: LaserSettings) -> None:
        self._all: list[Track] = []
        self._stamp = -math.inf
        self._grid, self._far = grid, grid.distance()
        self._yaw, self._fov = laser.yaw, laser.fov

    def actors(self, odometry: Array) -> Array:
        """Actors (m, 5): x, y [m], vx, vy [m/s], radius [m] in the chair's frame.

        `odometry` is the chair's pose by dead reckoning (3,).
        """
        some = [track for track in self._all if track.dynamic(self._stamp)]
        rows = np.empty((len(some), 5))
        if some:
            at = np.array([track.at for track in some])
            c, s = math.cos(odometry[2]), math.sin(odometry[2])
            rows[:, :2] = to_frame(at[:, :2], odometry)
            rows[:, 2:4] = at[:, 2:] @ np.array([(c, -s), (s, c)])
            rows[:, 4] = [track.radius for track in some]
        return rows

    def update(
        self, hits: Array, origin: Array, pose: Array, odometry: Array, stamp: float
    ) -> None:
        """Update from a scan.

        Args:
            hits: (n, 2) [m] in the chair's frame, in the order of beams.
            origin: the laser's place there (2,).
            pose: of the chair in the map (3,).
            odometry: by dead reckoning (3,).
            stamp: [s].
        """
        dt, self._stamp = min(LOST, stamp - self._stamp), stamp
        far = np.hypot(*(hits - origin).T)
        self.unmapped = self._unmapped(hits, far, pose)
        self.dynamic = np.zeros(len(hits), bool)
        for track in self._all:
            track.predict(dt)
        found = self._clusters(hits, far)
        discs = [_fit_disc(hits[a:b] - origin, far[a:b]) for a, b in found]
        places = [to_world((place + origin)[None], odometry)[0] for place, _ in discs]
        pairs = sorted(
            (gap, k, number)
            for k, place in enumerate(places)
            for number, gap in enumerate(math.hypot(*(t.at[:2] - place)) for t in self._all)
            if gap < GATE
        )
        continued: dict[int, int] = {}  # which track each cluster continues, the nearest first
        for _, k, number in pairs:
            if k not in continued and number not in continued.values():
                continued[k] = number
        for k, (first, last) in enumerate(found):
            radius = discs[k][1]
            if k in continued:
                track = self._all[continued[k]]
                track.correct(places[k], radius, stamp)
                self.dynamic[first:last] = self.unmapped[first:last] & track.dynamic(stamp)
            else:
                self._all.append(Track(places[k], radius, stamp))
        self._all = [track for track in self._all if self._kept(track, origin, odometry, dt)]

    def _kept(self, track: Track, origin: Array, odometry: Array, dt: float) -> bool:
        """Whether a track is kept; its speed decays where the laser does not look."""
        unseen = self._stamp - track.seen
        if unseen == 0.0:
            return True
        at = to_frame(track.at[None, :2], odometry)[0] - origin
        if abs(math.remainder(math.atan2(at[1], at[0]) - self._yaw, math.tau)) < 0.5 * self._fov:
            return unseen < LOST
        track.at[2:] *= math.exp(-DECAY * dt)
        if track.dynamic(track.seen):
            track.moved = max(track.moved, self._stamp - 0.5 * PAUSE)
        return unseen < OUT_OF_VIEW

    def _unmapped(self, hits: Array, far: Array, pose: Array) -> Mask:
        """Which hits (n, 2) no mapped wall explains."""
        cells = self._grid.to_cell(to_world(hits, pose))
        on = ((cells >= 0) & (cells < self._grid.shape)).all(axis=1)
        unmapped = np.zeros(len(hits), bool)
        inside = cells[on]
        off = self._far[inside[:, 0], inside[:, 1]]
        unmapped[on] = off > EXPLAINED + SPREADING * far[on]
        return unmapped & (far < TRACKING_RANGE)

    def _clusters(self, hits: Array, far: Array) -> list[tuple[int, int]]:
        """Runs of unmapped hits that are small enough to be tracked: first, one past the last."""
        index = np.flatnonzero(self.unmapped)
        if len(index) < MIN_HITS:
            return []
        gap = np.hypot(*(hits[index[1:]] - hits[index[:-1]]).T)
        cut = np.flatnonzero(gap > np.maximum(CLUSTER_GAP, 0.05 * far[index[1:]])) + 1
        found = []
        for run in np.split(index, cut):
            width = math.hypot(*(hits[run[-1]] - hits[run[0]]))
            in_view = run[0] > 0 and run[-1] < len(hits) - 1  # not cut off by the laser's view
            if in_view and len(run) >= MIN_HITS and width < MAX_WIDTH:
                found.append((int(run[0]), int(run[-1]) + 1))
        return found


def _fit_disc(hits: Array, far: Array) -> tuple[Array, float]:
    """Centre (2,) and radius [m] of the disc whose near side a cluster (n, 2) shows.

    A disc of radius R at a distance d from the origin fills the angle 2 asin(R / d), and its
    nearest point is d - R away.
    """
    angles = np.unwrap(np.arctan2(hits[:, 1], hits[:, 0]))
    low, high = angles.min(), angles.max()
    sine = math.sin(min(0.5 * (high - low), 1.2))
    near = float(np.quantile(far, 0.1))
    radius = min(max(near * sine / max(1e-3, 1.0 - sine), 0.05), 0.5 * MAX_WIDTH)
    middle = 0.5 * (low + high)
    return (near + radius) * np.array([math.cos(middle), math.sin(middle)]), radius

"""Where the chair is and what stands round it, from what the chair itself can know.

The laser sees 270 degrees from the front: what slips out of its view is remembered while the chair
drives by. Wheel counts carry that memory, and they steady a pose estimate whose error wanders.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agents.control.temporary_obstacles import Standing
from agents.control.tracks import REACH as SEEN_FROM
from agents.control.tracks import Tracks
from wheelchair_gym.geometry import clearance_to_points, to_frame, to_world
from wheelchair_gym.kinematics import odometric_step
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.safety import Shield
from wheelchair_gym.types import Mission, Reading

Array = NDArray[np.float64]

REACH = 2.4  # m: a chair at 0.8 m/s sweeps less than this before it can rest
VOXEL = 0.04  # m: hits within one voxel become their mean, which also averages noise
CLOSE = 1.3  # m: beyond, voxels are twice as large
MEMORY = 15.0  # s for which a hit is remembered out of sight
SETTLE = 3.0  # s over which the pose estimate corrects the wheel counts; so that its jumps are none


def sampled_walls(walls: Array, spacing: float = 0.05) -> Array:
    """Points (k, 2) [m] along walls (n, 4), ends included, at most `spacing` apart."""
    begin, step = walls[:, :2], walls[:, 2:] - walls[:, :2]
    counts = np.maximum(1, np.ceil(np.hypot(*step.T) / spacing)).astype(np.int64)  # of legs
    of = np.repeat(np.arange(len(walls)), counts + 1)  # which wall each point is of
    first = np.cumsum(counts + 1) - (counts + 1)
    share = (np.arange(len(of)) - first[of]) / counts[of]
    points: Array = begin[of] + share[:, None] * step[of]
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


def _moved(pose: Array, way: float, turn: float) -> Array:
    x, y, yaw = pose
    return np.array(odometric_step(x, y, yaw, way, turn))


class Surroundings:
    """The chair's pose and the obstacles near it, brought up to date by every reading.

    Attributes:
        pose: (3,) [m, m, rad] in the map's frame.
        hits: obstacles (k, 2) [m] in the chair's frame that the laser saw, now or lately.
        points: hits, and obstacles that only the map knows of, (k, 3): x, y, distance from the
            axle's centre [m], the nearest first.
        movers: what moves (m, 5): x, y [m], vx, vy [m/s], radius [m] in the chair's frame; its hits
            are not among the others.
        standing: temporary obstacles, in the map's frame.
        blind: nobody has seen what is behind the chair, so that it must not back.
    """

    def __init__(self, mission: Mission) -> None:
        reading = mission.reading
        known = mission.map_at(reading)
        self.blind = False
        self._laser = mission.sensors.laser
        self._outline = mission.footprint.array
        self.chart(known)
        # A map that the chair draws shows what moves as well: nothing would stand out against it.
        self._tracks = None if mission.map is None else Tracks(known, self._laser)
        self.standing = Standing(known)
        self._beams = self._laser.directions
        self._counted = np.zeros(3)  # dead reckoning, the frame of the memory
        self._memory = np.empty((0, 3))  # x, y, stamp
        self._stamp = reading.stamp
        self.pose: Array = np.array(reading.pose, dtype=np.float64)
        self.hits: Array = np.empty((0, 2))
        self.points: Array = np.empty((0, 3))
        self.movers: Array = np.empty((0, 5))
        # Also where nothing filters commands: then a shield's defaults say what is too fast.
        self._sight = Shield(mission.shield, mission.chair, mission.sensors, mission.period)
        self._look(reading)

    def chart(self, known: OccupancyGrid) -> None:
        """Take the walls of a map for what the laser does not see."""
        self._walls = sampled_walls(known.walls())
        self._near_walls, self._near = self._walls, np.full(2, np.inf)  # those near a point

    def margins(self, footprint: Array, margin: float) -> tuple[float, float, float]:
        """Margins [m] to ask for, one after another where nothing leads on.

        The last is nearly what is left: an outline already nearer may leave, not come nearer.
        """
        less = 0.6 * margin
        gap = float(clearance_to_points(0.0, 0.0, 0.0, footprint, self.points, margin))
        return margin, less, min(less, 0.95 * gap)

    def update(self, reading: Reading) -> None:
        """Take in the next reading."""
        period = reading.stamp - self._stamp
        if period <= 0.0:
            return
        self._stamp = reading.stamp
        way, turn = float(reading.twist[0]) * period, float(reading.twist[1]) * period
        self._counted = _moved(self._counted, way, turn)
        pose = _moved(self.pose, way, turn)
        off = np.asarray(reading.pose, dtype=np.float64) - pose
        off[2] = math.remainder(off[2], 2 * math.pi)
        self.pose = pose + off * min(1.0, period / SETTLE)
        self._look(reading)

    def unhurried(self, twists: Array, motion: Array) -> Array:
        """See `Shield.unhurried`: how fast the chair may go where nobody has looked."""
        return self._sight.limit_for_unseen_space(twists, motion)

    def _look(self, reading: Reading) -> None:
        self._sight.update(reading)
        laser = self._laser
        ranges = np.asarray(reading.laser, dtype=np.float64)
        near = np.isfinite(ranges) & (ranges < SEEN_FROM) & (ranges > laser.range_min)
        seen = self._beams[near] * ranges[near, None] + (laser.x, laser.y)
        stands = ranges[near] < REACH + laser.x
        if self._tracks is not None:
            eye = np.array([laser.x, laser.y])
            self._tracks.update(seen, eye, self.pose, self._counted, reading.stamp)
            self.movers = self._tracks.movers(self._counted)
            moving, strange = self._tracks.dynamic, self._tracks.strange
            self.standing.update(seen[strange & ~moving], ranges, laser, self.pose, reading.stamp)
            stands &= ~moving
        seen = seen[stands]
        close = np.all(np.abs(seen) < CLOSE, axis=1)
        seen = np.concatenate(
            [voxel_means(seen[close], VOXEL), voxel_means(seen[~close], 2 * VOXEL)]
        )
        recent = self._memory[self._memory[:, 2] > reading.stamp - MEMORY]
        old = to_frame(recent[:, :2], self._counted)
        hidden = (np.abs(self._bearing(old)) > 0.5 * laser.fov) & self._within(old)
        stamped = np.column_stack([seen, np.full(len(seen), reading.stamp)])
        kept = np.column_stack([old, recent[:, 2]])[hidden]
        local = np.concatenate([stamped, kept])  # (k, 3)
        self.hits = local[:, :2]
        self._memory = np.column_stack([to_world(self.hits, self._counted), local[:, 2]])
        mapped = to_frame(self._walls_near(), self.pose)
        # Where the laser looks it knows better than a map seen from an uncertain pose.
        mapped = mapped[np.abs(self._bearing(mapped)) > 0.5 * laser.fov]
        points = np.concatenate([self.hits, mapped])
        points = points[~self._under(points)]  # the chair stands there: nothing else does
        far = np.hypot(points[:, 0], points[:, 1])
        nearest = np.argsort(far)
        self.points = np.column_stack([points, far])[nearest]

    def _walls_near(self) -> Array:
        """Points of mapped walls within reach; looked for anew every half metre of way."""
        if np.abs(self.pose[:2] - self._near).max() > 0.5:
            self._near = self.pose[:2].copy()
            self._near_walls = self._walls[
                (np.abs(self._walls - self._near) < REACH + 0.5).all(axis=1)
            ]
        return self._near_walls

    def _bearing(self, points: Array) -> Array:
        laser = self._laser
        bearing = np.arctan2(points[:, 1] - laser.y, points[:, 0] - laser.x) - laser.yaw
        wrapped: Array = np.remainder(bearing + math.pi, 2 * math.pi) - math.pi
        return wrapped

    def _under(self, points: Array) -> NDArray[np.bool_]:
        front, rear, half = self._outline
        x, y = points[:, 0], points[:, 1]
        under: NDArray[np.bool_] = (x < front) & (x > -rear) & (np.abs(y) < half)
        return under

    def _within(self, points: Array) -> NDArray[np.bool_]:
        near: NDArray[np.bool_] = np.all(np.abs(points) < REACH, axis=1)
        return near

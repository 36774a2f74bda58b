"""What stands and what moves, told apart from scans: against the map, and over time.

What the map explains is static. The rest falls into clusters, which are tracked from scan to scan
in the frame of dead reckoning: those that get on are dynamic (people, things that are pushed), the
others temporary (T1 3.2.2). Nothing here knows the truth.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.geometry import to_frame, to_world
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.sensors.settings import LaserSettings

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

REACH = 8.0  # m: someone at 1.5 m/s needs 5 s from there
EXPLAINED = 0.15  # m from a mapped wall, and
SPREADING = 0.03  # m more per metre of range, for the heading's error: the map explains a hit
GAP = 0.20  # m between neighbours of one cluster, at least
FEWEST = 4  # hits of a cluster
WIDEST = 0.9  # m: shoulders and swinging arms; what is wider is a wall, a leaf, a group
GATE = 0.45  # m between where a track is foreseen and the cluster that carries it on
NOISE = 0.04  # m: of a cluster's centre, seen from another side a moment later
SWAY = 3.0  # m/s2: how people change their speed where they turn back
LOST = 1.0  # s: unseen for so long where the laser looks, a track is given up
BESIDE = 8.0  # s: and where it does not look; meanwhile it is taken to come to rest there
CALM = 1.0  # 1/s: how soon
AGE = 0.4  # s after which a track may be called moving
GETS_ON = 0.25  # m/s: it moves; a slow walk is 0.4
COVERED = 0.20  # m from where it was first seen, or stood last
STANDS = 0.15  # m/s: it does not
PAUSE = 3.0  # s: so long after, who has moved may go on


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
        self.begun = self.seen = stamp
        self.moved = -math.inf
        self._anchor = np.array(place)
        # Variances of place and speed, and their covariance: the same along x and y.
        self._p = np.array([NOISE**2, 0.0, 1.0])

    def foresee(self, dt: float) -> None:
        """Move on by a time [s] at constant speed."""
        self.at[:2] += self.at[2:] * dt
        a, b, c = self._p
        q = SWAY * SWAY * dt
        self._p = np.array(
            [a + 2 * dt * b + dt * dt * c + q * dt**3 / 3, b + dt * c + q * dt**2 / 2, c + q * dt]
        )

    def correct(self, place: Array, radius: float, stamp: float) -> None:
        """Take in the cluster that carries the track on (Kalman 1960)."""
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
        if speed > GETS_ON and covered > COVERED and stamp - self.begun > AGE:
            self.moved = stamp
        if speed < STANDS and stamp - self.moved > 0.5:
            self._anchor += 0.2 * (self.at[:2] - self._anchor)

    def dynamic(self, stamp: float) -> bool:
        """Whether it moves, or may go on any moment."""
        return stamp - self.moved < PAUSE


class Tracks:
    """All that the map does not explain.

    Attributes:
        dynamic: hits of the last scan (n,) that belong to what moves.
        strange: hits of the last scan (n,) that the map does not explain.
    """

    def __init__(self, known: OccupancyGrid, laser: LaserSettings) -> None:
        self._all: list[Track] = []
        self._stamp = -math.inf
        self._grid, self._far = known, known.distance()
        self._yaw, self._fov = laser.yaw, laser.fov

    def movers(self, counted: Array) -> Array:
        """What moves (m, 5): x, y [m], vx, vy [m/s], radius [m] in the chair's own frame.

        Args:
            counted: the chair's pose by dead reckoning (3,).
        """
        some = [track for track in self._all if track.dynamic(self._stamp)]
        rows = np.empty((len(some), 5))
        if some:
            at = np.array([track.at for track in some])
            c, s = math.cos(counted[2]), math.sin(counted[2])
            rows[:, :2] = to_frame(at[:, :2], counted)
            rows[:, 2:4] = at[:, 2:] @ np.array([(c, -s), (s, c)])
            rows[:, 4] = [track.radius for track in some]
        return rows

    def update(self, hits: Array, eye: Array, pose: Array, counted: Array, stamp: float) -> None:
        """Take in a scan.

        Args:
            hits: (n, 2) [m] in the chair's frame, in the order of beams.
            eye: the laser's place there (2,).
            pose: of the chair in the map (3,).
            counted: by dead reckoning (3,).
            stamp: [s].
        """
        dt, self._stamp = min(LOST, stamp - self._stamp), stamp
        far = np.hypot(*(hits - eye).T)
        self.strange = self._unexplained(hits, far, pose)
        self.dynamic = np.zeros(len(hits), bool)
        for track in self._all:
            track.foresee(dt)
        found = self._clusters(hits, far)
        centres = [_round_one(hits[a:b] - eye, far[a:b]) for a, b in found]
        places = [to_world((place + eye)[None], counted)[0] for place, _ in centres]
        pairs = sorted(
            (gap, k, number)
            for k, place in enumerate(places)
            for number, gap in enumerate(math.hypot(*(t.at[:2] - place)) for t in self._all)
            if gap < GATE
        )
        of: dict[int, int] = {}  # which track each cluster carries on, the nearest first
        for _, k, number in pairs:
            if k not in of and number not in of.values():
                of[k] = number
        for k, (first, last) in enumerate(found):
            radius = centres[k][1]
            if k in of:
                own = self._all[of[k]]
                own.correct(places[k], radius, stamp)
                self.dynamic[first:last] = self.strange[first:last] & own.dynamic(stamp)
            else:
                self._all.append(Track(places[k], radius, stamp))
        self._all = [track for track in self._all if self._kept(track, eye, counted, dt)]

    def _kept(self, track: Track, eye: Array, counted: Array, dt: float) -> bool:
        """Whether a track is kept; where the laser does not look, it comes to rest by and by."""
        unseen = self._stamp - track.seen
        if unseen == 0.0:
            return True
        at = to_frame(track.at[None, :2], counted)[0] - eye
        if abs(math.remainder(math.atan2(at[1], at[0]) - self._yaw, math.tau)) < 0.5 * self._fov:
            return unseen < LOST
        track.at[2:] *= math.exp(-CALM * dt)
        if track.dynamic(track.seen):
            track.moved = max(track.moved, self._stamp - 0.5 * PAUSE)
        return unseen < BESIDE

    def _unexplained(self, hits: Array, far: Array, pose: Array) -> Mask:
        """Which hits (n, 2) no mapped wall explains."""
        cells = self._grid.to_cell(to_world(hits, pose))
        on = ((cells >= 0) & (cells < self._grid.shape)).all(axis=1)
        strange = np.zeros(len(hits), bool)
        inside = cells[on]
        off = self._far[inside[:, 0], inside[:, 1]]
        strange[on] = off > EXPLAINED + SPREADING * far[on]
        return strange & (far < REACH)

    def _clusters(self, hits: Array, far: Array) -> list[tuple[int, int]]:
        """Runs of strange hits that are small enough to be tracked: first, one past the last."""
        index = np.flatnonzero(self.strange)
        if len(index) < FEWEST:
            return []
        gap = np.hypot(*(hits[index[1:]] - hits[index[:-1]]).T)
        cut = np.flatnonzero(gap > np.maximum(GAP, 0.05 * far[index[1:]])) + 1
        found = []
        for run in np.split(index, cut):
            wide = math.hypot(*(hits[run[-1]] - hits[run[0]]))
            whole = run[0] > 0 and run[-1] < len(hits) - 1  # not cut off by the laser's view
            if whole and len(run) >= FEWEST and wide < WIDEST:
                found.append((int(run[0]), int(run[-1]) + 1))
        return found


def _round_one(hits: Array, far: Array) -> tuple[Array, float]:
    """Centre (2,) and radius [m] of the disc that shows in a cluster (n, 2) seen from the origin.

    A disc of radius R at a distance d fills the angle 2 asin(R / d), and its nearest point is
    d - R away.
    """
    bearings = np.unwrap(np.arctan2(hits[:, 1], hits[:, 0]))
    low, high = bearings.min(), bearings.max()
    sine = math.sin(min(0.5 * (high - low), 1.2))
    near = float(np.quantile(far, 0.1))
    radius = min(max(near * sine / max(1e-3, 1.0 - sine), 0.05), 0.5 * WIDEST)
    middle = 0.5 * (low + high)
    return (near + radius) * np.array([math.cos(middle), math.sin(middle)]), radius

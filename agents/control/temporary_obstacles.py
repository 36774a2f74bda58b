"""Temporary obstacles: what stands where the map shows nothing, until it is seen to be gone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.geometry import to_frame, to_world
from wheelchair_gym.maps import OCCUPIED, OccupancyGrid
from wheelchair_gym.sensors.settings import LaserSettings

Array = NDArray[np.float64]

FAR = 4.0  # m: beyond, a heading error moves a hit by more than a cell
MEMORY = 20.0  # s for which what went out of sight is taken to stand there still
STOOD = 1.0  # s for which something stands before it counts: others pass
THROUGH = 0.25  # m that a beam reaches farther: the place is empty now


class Standing:
    """Hits that no mapped wall explains and that do not move, by cells of the map."""

    def __init__(self, known: OccupancyGrid) -> None:
        self._grid = known
        self._cells = np.empty((0, 2), np.int64)  # row, col
        self._begun = np.empty(0)  # stamps when each was first seen [s], and last
        self._seen = np.empty(0)

    def update(
        self, hits: Array, ranges: Array, laser: LaserSettings, pose: Array, stamp: float
    ) -> None:
        """Take in a scan.

        Args:
            hits: what stands and is not on the map (n, 2) [m] in the chair's frame.
            ranges: the whole scan (beams,) [m], no echo infinite.
            laser: its settings.
            pose: of the chair (3,).
            stamp: [s].
        """
        self._forget(ranges, laser, pose, stamp)
        near = hits[np.hypot(hits[:, 0], hits[:, 1]) < FAR]
        cells = np.unique(self._grid.to_cell(to_world(near, pose)), axis=0)
        cells = cells[((cells >= 0) & (cells < self._grid.shape)).all(axis=1)]
        columns = self._grid.shape[1]
        known, now = (at[:, 0] * columns + at[:, 1] for at in (self._cells, cells))
        again = np.isin(known, now)
        self._seen[again] = stamp
        fresh = cells[~np.isin(now, known)]
        self._cells = np.concatenate([self._cells, fresh])
        self._begun = np.append(self._begun, np.full(len(fresh), stamp))
        self._seen = np.append(self._seen, np.full(len(fresh), stamp))

    def _forget(self, ranges: Array, laser: LaserSettings, pose: Array, stamp: float) -> None:
        """Drop what is long out of sight, and what a beam has gone through."""
        if not len(self._cells):
            return
        at = to_frame(self._grid.to_world(self._cells), pose) - (laser.x, laser.y)
        bearing = np.arctan2(at[:, 1], at[:, 0]) - laser.yaw
        bearing = np.remainder(bearing + np.pi, 2 * np.pi) - np.pi
        beam = np.round((bearing / laser.fov + 0.5) * (len(ranges) - 1)).astype(np.int64)
        inside = (beam >= 0) & (beam < len(ranges))
        reached = np.where(inside, ranges[np.clip(beam, 0, len(ranges) - 1)], 0.0)
        gone = np.nan_to_num(reached, nan=0.0, posinf=np.inf) > np.hypot(*at.T) + THROUGH
        kept = ~gone & (stamp - self._seen < MEMORY)
        self._cells, self._begun = self._cells[kept], self._begun[kept]
        self._seen = self._seen[kept]

    @property
    def stood(self) -> Array:
        """Centres (n, 2) [m] of the cells where something has stood for a while."""
        return self._grid.to_world(self._cells[self._seen - self._begun > STOOD])

    def painted(self) -> OccupancyGrid:
        """The map with all of this in it."""
        cells = self._grid.cells.copy()
        cells[self._cells[:, 0], self._cells[:, 1]] = OCCUPIED
        return OccupancyGrid(cells, self._grid.resolution, self._grid.origin)

    def on_way(self, way: Array, clearance: float) -> bool:
        """Whether any of it stands nearer to a way (n, 2 or more) [m] than a clearance [m]."""
        stood = self.stood
        if not len(stood) or not len(way):
            return False
        return bool(np.hypot(*(way[:, None, :2] - stood).T).min() < clearance)

"""Monte Carlo localisation: where a chair is on a known map, from its odometry and its laser.

Thrun, Burgard and Fox (2005), chapter 8: a likelihood field; the number of particles by the bins
that they fill (Fox 2001); new particles anywhere while scans fit worse than they used to, so that
a chair that was carried away is found again (augmented MCL).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.mapping.anywhere import look_anywhere
from wheelchair_gym.mapping.field import log_likelihood, surface_field, tell
from wheelchair_gym.mapping.particles import (
    Drift,
    advance,
    centre,
    count_bins,
    level,
    new_particles,
    redraw,
    scatter,
    weigh,
)
from wheelchair_gym.maps import FREE, OccupancyGrid
from wheelchair_gym.sensing.noise import LOCALISE, bits
from wheelchair_gym.sensing.settings import LaserSettings
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]

_QUANTILE = 2.326  # of the normal distribution: the number of particles suffices in 99 of 100


@settings
class Localisation:
    """Settings of Monte Carlo localisation."""

    beams: int = setting(default=60, source="of a scan, evenly; neighbours tell the same", low=4)
    sigma: float = setting(
        default=0.06, unit="m", source="laser's noise and a map of 5 cm cells", low=0.001
    )
    astray: float = setting(
        default=0.1, source="share of beams that meet what no map shows", low=1e-6, high=0.9
    )
    trust: float = setting(
        default=12.0, source="beams that err independently, of those looked at", low=0.1
    )
    least: int = setting(default=300, source="particles", low=10, high=16_000)
    most: int = setting(default=5000, source="particles", low=10, high=16_000)
    error: float = setting(
        default=0.05, source="Fox 2001: of the distribution, with probability 0.99", low=1e-3
    )
    bin_side: float = setting(default=0.25, unit="m", source="bins that are counted", low=0.01)
    bin_sector: float = setting(default=math.radians(10.0), unit="rad", source="same", low=0.01)
    way_by_way: float = setting(default=0.03, unit="m/m", source="deviation of odometry", low=0.0)
    way_by_turn: float = setting(default=0.01, unit="m/rad", source="same", low=0.0)
    turn_by_way: float = setting(default=0.04, unit="rad/m", source="same", low=0.0)
    turn_by_turn: float = setting(default=0.05, unit="rad/rad", source="same", low=0.0)
    aside: float = setting(default=0.03, unit="m/m", source="slide sideways", low=0.0)
    start_position: float = setting(
        default=0.05, unit="m", source="deviation of where an episode starts", low=0.0
    )
    start_heading: float = setting(default=math.radians(2.0), unit="rad", source="same", low=0.0)
    update_way: float = setting(
        default=0.01, unit="m", source="no scan is weighed before: standing tells nothing", low=0.0
    )
    update_turn: float = setting(default=0.01, unit="rad", source="same", low=0.0)
    forget_fast: float = setting(
        default=0.2, source="per scan: how well scans fit now", low=0.0, high=1.0
    )
    forget_slow: float = setting(
        default=0.005, source="per scan: how well they used to fit", low=0.0, high=1.0
    )
    alarm: float = setting(
        default=0.7, source="of the usual fit: below, particles are placed anywhere", low=0.0
    )
    calm: float = setting(
        default=0.9, source="of the usual fit: a lost chair looks on until it is reached", low=0.0
    )
    usual: float = setting(
        default=0.9, source="how well scans fit at first, as far as is known", low=0.0, high=1.0
    )
    told: int = setting(
        default=8, source="beams at a surface or behind one; fewer tell nothing of the fit", low=1
    )
    tries: int = setting(
        default=2000, source="places that a lost chair looks at, per scan", low=1, high=16_000
    )
    candidates: int = setting(default=10, source="of these, which are looked into", low=1)
    reach: float = setting(
        default=1.0, unit="m", source="particles whose mean is the answer lie within", low=0.01
    )

    def __post_init__(self) -> None:
        if self.most < self.least:
            raise InputError(f"Localisation.most is {self.most}; expected {self.least} or more")
        if self.tries < self.candidates:
            raise InputError(
                f"Localisation.tries is {self.tries}; expected {self.candidates} or more"
            )
        if self.calm < self.alarm:
            raise InputError(f"Localisation.calm is {self.calm}; expected {self.alarm} or more")


class Localiser:
    """Where a chair is on a map.

    Attributes:
        pose: the best guess (3,) [m, m, rad].
        count: particles at present.
        fit: likelihood of a beam there that met what the map shows, or went through it, 0 to 1.
        lost: scans fit worse than they used to, and not well again since; particles are placed
            anywhere.
        map: the one it looks at.
    """

    chart = None  # it draws none

    def __init__(self, settings: Localisation, laser: LaserSettings) -> None:
        self.settings, s = settings, settings
        self.pose = np.zeros(3)
        self.count, self.fit, self.lost = 0, 0.0, False
        self._particles = new_particles(s.most)
        self._drift = Drift(s.way_by_way, s.way_by_turn, s.turn_by_way, s.turn_by_turn, s.aside)
        self._mount = np.array([laser.x, laser.y])
        self._rays = laser.directions  # (beams, 2)
        self._reach = laser.reach
        self.map: OccupancyGrid | None = None

    @property
    def poses(self) -> Array:
        """The particles' poses (count, 3) [m, m, rad]."""
        return np.array(self._particles.poses[: self.count])

    def begin(self, episode: Episode, key: int) -> None:
        """Start on an episode's map, near where it says that the chair stands."""
        self.start(episode.map, episode.start, key)

    def start(self, map_: OccupancyGrid, pose: Array | None, key: int) -> Array:
        """Start on a map near a pose (3,), or anywhere for None; returns the pose.

        Raises:
            ValueError: nothing on the map is free.
        """
        if map_ is not self.map:
            self._field = surface_field(map_, 10.0 * self.settings.sigma)
            self._free = np.flatnonzero(map_.cells.ravel() == FREE)
            self.map = map_
        if len(self._free) == 0:
            raise ValueError("the map has no free cell")
        s, own = self.settings, self._particles
        self._key = np.uint64(bits(np.uint64(key % 2**64), 0, LOCALISE, 0))
        self._step = 0
        self._slow, self.fit = s.usual, 0.0
        self.lost = pose is None
        self._fast = 0.0 if self.lost else s.usual
        self._moved = np.array([np.inf, np.inf])  # so that the first scan counts
        if pose is None:  # some place: the first scan tells that it is wrong
            cell = self._free[len(self._free) // 2]
            pose = np.array([*map_.to_world(divmod(int(cell), map_.shape[1])), 0.0])
        self.count, self.pose = s.least, np.array(pose, dtype=np.float64)
        position, heading = s.start_position, s.start_heading
        scatter(own.poses, 0, self.count, self.pose, position, heading, self._key, 0)
        level(own, self.count)
        return self.pose

    def update(self, increment: Array, ranges: NDArray[np.float32]) -> Array:
        """Move on and look.

        Args:
            increment: (3,) [m, m, rad] what the odometry says was driven since the last update, in
                the chair's frame then.
            ranges: (beams,) [m] as in `Reading.laser`.

        Returns:
            The pose (3,) [m, m, rad].
        """
        s, own = self.settings, self._particles
        x, y, turn = increment.tolist()
        way = x * math.cos(0.5 * turn) + y * math.sin(0.5 * turn)
        self._step += 1
        advance(own.poses, self.count, way, turn, self._drift, self._key, self._step)
        self._moved += abs(way), abs(turn)
        moved = (self._moved >= (s.update_way, s.update_turn)).any()
        ends = self._ends(ranges)
        if len(ends) and (moved or self.lost):
            self._moved[:] = 0.0
            self._weigh(ends)
        _, about = count_bins(own, self.count, s.bin_side, s.bin_sector)
        self.pose = np.empty(3)
        centre(own, self.count, about, s.reach, 3.0 * s.bin_sector, self.pose)
        if len(ends):
            self._judge(ends)
        return self.pose

    def _weigh(self, ends: Array) -> None:
        """Weigh particles by a scan; draw them anew when few of them count, or none is right."""
        s, own = self.settings, self._particles
        effective = weigh(own, self.count, self._field, ends, s.sigma, s.astray, s.trust)
        if effective >= 0.5 * self.count and not self.lost:
            return
        bins, _ = count_bins(own, self.count, s.bin_side, s.bin_sector)
        count = min(s.most, max(s.least, _enough(bins, s.error)))
        redraw(own, self.count, count, self._key, self._step)
        self.count = min(s.most, count + s.least) if self.lost else count
        if self.lost:
            self._look_anywhere(ends, count)
        level(own, self.count)

    def _look_anywhere(self, ends: Array, kept: int) -> None:
        """Give the particles after the first ones to places anywhere that the scan fits."""
        s, own = self.settings, self._particles
        few = np.ascontiguousarray(ends[:: max(1, len(ends) // 20)])
        found, worth = np.empty((s.candidates + 1, 3)), np.empty(s.candidates + 1)
        look_anywhere(
            self._field, self._free, ends, few, s.tries, s.sigma, s.astray, 2.0 * s.sigma,
            s.bin_sector / 2.0, self._key, self._step, found, worth,
        )  # fmt: skip
        shares = np.linspace(kept, self.count, s.candidates + 1).astype(int)
        position, heading = s.start_position, s.start_heading
        for begin, end, pose in zip(shares[:-1], shares[1:], found[1:], strict=True):
            scatter(own.poses, begin, end, pose, position, heading, self._key, self._step)

    def _judge(self, ends: Array) -> None:
        """How well a scan fits where the chair is said to be, and whether that is too bad.

        Beams that people may have stopped tell nothing: a crowd is no sign of being lost.
        """
        s, (x, y, yaw) = self.settings, self.pose
        telling = np.empty(len(ends), dtype=np.bool_)
        tell(self._field, x, y, yaw, self._mount, ends, 3.0 * s.sigma, telling)
        told = ends[telling]
        if len(told) < s.told:
            return
        self.fit = math.exp(log_likelihood(self._field, x, y, yaw, told, s.sigma, s.astray))
        self._slow += s.forget_slow * (self.fit - self._slow)
        self._fast += s.forget_fast * (self.fit - self._fast)
        self.lost = self._fast < (s.calm if self.lost else s.alarm) * self._slow

    def _ends(self, ranges: NDArray[np.float32]) -> Array:
        """Ends (k, 2) [m] in the chair's frame of beams that met something, evenly chosen."""
        known = np.flatnonzero((ranges > 0.0) & (ranges < self._reach))  # neither NaN nor infinite
        evenly = np.linspace(0, len(known) - 1, min(len(known), self.settings.beams))
        chosen = known[evenly.astype(int)]
        ends: Array = self._mount + ranges[chosen, None] * self._rays[chosen]
        return ends


def _enough(bins: int, error: float) -> int:
    """Particles for bins to be filled as they should be, within an error (Fox 2001, eq. 7)."""
    if bins < 2:
        return 0
    k = bins - 1
    part = 2.0 / (9.0 * k)
    return math.ceil(k / (2.0 * error) * (1.0 - part + math.sqrt(part) * _QUANTILE) ** 3)

"""Pure pursuit: steering for a point ahead on the path (Coulter 1992, regulated)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agents.control.follower import CREEP, SLOW, Follower, near_of
from agents.control.local_map import Surroundings
from agents.control.reference import Reference
from agents.control.rollout import Motion, stops_clear
from wheelchair_gym.config import setting, settings

Array = NDArray[np.float64]


@settings
class PurePursuit:
    """Regulated pure pursuit: slower in curves, near walls and near the goal."""

    lookahead: float = setting(default=0.45, unit="m", low=0.05, source="least; about half a chair")
    lookahead_time: float = setting(default=0.7, unit="s", low=0.0, source="further when faster")
    lateral: float = setting(
        default=0.35, unit="m/s2", low=0.01, source="sideways acceleration in curves"
    )
    pivot: float = setting(
        default=0.9, unit="rad", low=0.1, high=3.1, source="turn in place above this error"
    )
    margin: float = setting(default=0.05, unit="m", low=0.0, source="laser sigma 15 mm, 3 sigma")
    slowest: float = setting(default=0.1, unit="m/s", low=0.01, source="walking-stick speed")

    def make(self) -> Follower:
        """A follower at rest."""
        return PurePursuitFollower(self)


class PurePursuitFollower:
    """Steers for a point ahead on the path."""

    def __init__(self, own: PurePursuit) -> None:
        self.own = own
        self._pivoting = False

    def twist(self, around: Surroundings, reference: Reference, chair: Motion) -> Array | None:
        """See `Follower.twist`."""
        own, limits = self.own, chair.limits
        rows = reference.ahead(around.pose, 4.0)
        far = np.hypot(rows[:, 0], rows[:, 1])
        ahead = own.lookahead + own.lookahead_time * max(0.0, chair.state[0])
        nearest = int(np.argmin(far))
        beyond = nearest + np.flatnonzero(far[nearest:] > ahead)
        x, y = rows[beyond[0] if len(beyond) else -1, :2]
        error = math.atan2(y, x)
        self._pivoting = abs(error) > (0.3 if self._pivoting else own.pivot)
        if self._pivoting:
            w = math.copysign(0.6 * limits.turn, error)
            return self._first_clear(0.0, w, around, reference, chair)
        curvature = 2.0 * y / max(x * x + y * y, 0.01)
        left = float(far[nearest] + rows[-1, 3] - rows[nearest, 3])
        v = min(limits.forward, math.sqrt(2.0 * 0.5 * limits.deceleration * left))
        v = min(v, math.sqrt(own.lateral / max(abs(curvature), 1e-6)))
        v = max(own.slowest, min(v, 0.9 * limits.turn / max(abs(curvature), 1e-6)))
        return self._first_clear(v, v * curvature, around, reference, chair)

    def _first_clear(
        self, v: float, w: float, around: Surroundings, reference: Reference, chair: Motion
    ) -> Array | None:
        """The twist, or the same arc at the first slower pace that leaves room to stop."""
        near = near_of(around, reference)
        for margin in around.margins(chair.footprint, self.own.margin):
            for share in (1.0, 0.7, 0.45, 0.25, 0.12):
                if margin < SLOW * self.own.margin and abs(share * v) > CREEP:
                    continue
                if stops_clear(share * v, share * w, chair.body, near, 0.4, margin):
                    return np.array([share * v, share * w])
        return None

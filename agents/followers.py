"""Followers: from a path and what stands round the chair to the next twist."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from agents.controls_follower import ControlsFollower
from agents.motion import Motion
from agents.reference import Reference
from agents.rollout import Weights, choose, stops_clear
from agents.surroundings import Surroundings
from wheelchair_gym.config import InputError, load, setting, settings
from wheelchair_gym.kinematics import Limits

Array = NDArray[np.float64]


SLOW = 0.5  # below this share of the margin
CREEP = 0.1  # m/s: the chair goes no faster than walking-stick speed


class Follower(Protocol):
    """Drives along one reference; made anew for every path."""

    def twist(self, around: Surroundings, reference: Reference, chair: Motion) -> Array | None:
        """The next target twist (2,) [m/s, rad/s], or None where nothing safe leads on."""
        ...


@settings
class Window:
    """A dynamic window: the best of a fan of twists, each rolled out with the exact footprint."""

    hold: float = setting(default=0.4, unit="s", source="four periods at 10 Hz", low=0.1)
    horizon: float = setting(default=1.5, unit="s", source="tuned on training floor plans", low=0.3)
    margin: float = setting(default=0.05, unit="m", source="laser sigma 15 mm, 3 sigma", low=0.0)
    wish: float = setting(default=0.20, unit="m", source="half the play in a 1.0 m door", low=0.01)
    clearance: float = setting(default=1.0, unit="m", source="tuned", low=0.0)
    error: float = setting(default=1.5, source="m per m beside the reference; tuned", low=0.0)
    change: float = setting(default=0.05, unit="s", source="against wobble; tuned", low=0.0)
    reverse: float = setting(default=0.5, source="m per m in reverse; tuned", low=0.0)
    backward: float = setting(default=0.2, unit="m/s", source="nothing looks back", low=0.0)

    def make(self) -> Follower:
        """A follower at rest."""
        return WindowFollower(self)


class WindowFollower:
    """Chooses among a fan of twists by roll-out."""

    def __init__(self, own: Window) -> None:
        self.own = own
        self._fan: Array | None = None

    def _candidates(self, limits: Limits) -> Array:
        if self._fan is None:
            back = min(self.own.backward, limits.backward)
            v = np.concatenate(
                [[-back, -0.5 * back, 0.0], limits.forward * np.array([0.12, 0.25, 0.45, 0.7, 1.0])]
            )
            share = np.array([0.0, 0.06, 0.14, 0.25, 0.4, 0.6, 0.8, 1.0])
            w = limits.turn * np.concatenate([-share[:0:-1], share])
            self._fan = np.array([(a, b) for a in v for b in w])
        return self._fan

    def twist(self, around: Surroundings, reference: Reference, chair: Motion) -> Array | None:
        """See `Follower.twist`."""
        own = self.own
        points = around.points
        rows = reference.ahead(around.pose)
        for margin in around.margins(chair.footprint, own.margin):
            weights = Weights(
                own.hold, own.horizon, margin, own.wish, own.clearance, own.error,
                own.change, own.reverse,
            )  # fmt: skip
            fan = self._candidates(chair.limits)
            if around.blind:
                fan = fan[fan[:, 0] >= 0.0]
            if margin < SLOW * own.margin:
                fan = fan[np.abs(fan[:, 0]) <= CREEP]
            best = choose(
                fan, chair.state, chair.last, chair.array, chair.footprint, points, rows, weights
            )
            if best >= 0:
                return np.array(fan[best])
        return None


@settings
class PurePursuit:
    """Regulated pure pursuit: slower in curves, near walls and near the goal."""

    lookahead: float = setting(default=0.45, unit="m", source="least; about half a chair", low=0.05)
    lookahead_time: float = setting(default=0.7, unit="s", source="further when faster", low=0.0)
    lateral: float = setting(
        default=0.35, unit="m/s2", source="sideways acceleration in curves", low=0.01
    )
    pivot: float = setting(
        default=0.9, unit="rad", source="turn in place above this error", low=0.1, high=3.1
    )
    margin: float = setting(default=0.05, unit="m", source="laser sigma 15 mm, 3 sigma", low=0.0)
    slowest: float = setting(default=0.1, unit="m/s", source="walking-stick speed", low=0.01)

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
            return self._first_clear(0.0, math.copysign(0.6 * limits.turn, error), around, chair)
        curvature = 2.0 * y / max(x * x + y * y, 0.01)
        left = float(far[nearest] + rows[-1, 3] - rows[nearest, 3])
        v = min(limits.forward, math.sqrt(2.0 * 0.5 * limits.deceleration * left))
        v = min(v, math.sqrt(own.lateral / max(abs(curvature), 1e-6)))
        v = max(own.slowest, min(v, 0.9 * limits.turn / max(abs(curvature), 1e-6)))
        return self._first_clear(v, v * curvature, around, chair)

    def _first_clear(self, v: float, w: float, around: Surroundings, chair: Motion) -> Array | None:
        """The twist, or the same arc at the first slower pace that leaves room to stop."""
        points = around.points
        for margin in around.margins(chair.footprint, self.own.margin):
            for share in (1.0, 0.7, 0.45, 0.25, 0.12):
                if margin < SLOW * self.own.margin and abs(share * v) > CREEP:
                    continue
                if stops_clear(
                    share * v, share * w, chair.state, chair.array, chair.footprint, points,
                    0.4, margin,
                ):  # fmt: skip
                    return np.array([share * v, share * w])
        return None


FOLLOWERS: dict[str, type] = {
    "controls": ControlsFollower,
    "pure_pursuit": PurePursuit,
    "window": Window,
}


def make_follower(spec: Mapping[str, Any]) -> Any:
    """Settings of a follower from `{"name": name, **settings}`.

    Raises:
        InputError: the name is unknown or a setting is wrong.
    """
    values = dict(spec)
    name = values.pop("name", "window")
    if name not in FOLLOWERS:
        raise InputError(f"follower {name!r} is unknown; known: {', '.join(sorted(FOLLOWERS))}")
    return load(FOLLOWERS[name], values, f"follower {name}")

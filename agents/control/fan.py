"""Followers that choose among a fan of twists, each rolled out with the exact footprint."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.control.follower import Follower, Objective, allowed, near_of, widest
from agents.control.local_map import Surroundings
from agents.control.reference import Reference
from agents.control.rollout import Motion, cheapest, costs_of
from wheelchair_gym.config import setting, settings
from wheelchair_gym.kinematics import Limits

Array = NDArray[np.float64]

PACES = np.array([0.12, 0.25, 0.45, 0.7, 1.0])  # shares of the speed limit
TURNS = np.array([0.06, 0.14, 0.25, 0.4, 0.6, 0.8, 1.0])  # shares of the limit of turning


@settings
class Window:
    """The best of a fan over all twists that the chair may be asked for.

    What the chair cannot reach at once it approaches by its ramps, in the roll-out as on the
    floor: so a fast turn is a candidate from rest, too, which it is not to the classic window.
    """

    hold: float = setting(default=0.4, unit="s", low=0.1, source="four periods at 10 Hz")
    margin: float = setting(default=0.05, unit="m", low=0.0, source="laser sigma 15 mm, 3 sigma")
    backward: float = setting(default=0.2, unit="m/s", low=0.0, source="nothing looks back")
    objective: Objective = Objective()

    def fan(self, chair: Motion) -> Array:
        """Twists (c, 2) to choose among [m/s, rad/s]."""
        return whole_fan(chair.limits, self.backward)

    def make(self) -> Follower:
        """A follower at rest."""
        return FanFollower(self)


@settings
class DynamicWindow:
    """The classic dynamic window approach (Fox, Burgard and Thrun 1997).

    Its candidates are a grid over the twists that the chair reaches within a short time; of these
    it takes the best that it can still stop from. Objective and outline are those of the others.
    """

    hold: float = setting(default=0.4, unit="s", low=0.1, source="four periods at 10 Hz")
    margin: float = setting(default=0.05, unit="m", low=0.0, source="laser sigma 15 mm, 3 sigma")
    backward: float = setting(default=0.2, unit="m/s", low=0.0, source="nothing looks back")
    reach: float = setting(
        default=0.5, unit="s", low=0.05, source="the window: what is reached so soon"
    )
    speeds: int = setting(default=7, low=2, high=50, source="of the grid")
    turns: int = setting(default=15, low=3, high=99, source="of the grid")
    objective: Objective = Objective()

    def fan(self, chair: Motion) -> Array:
        """Twists (c, 2) to choose among [m/s, rad/s]."""
        limits, (v, _, w, _) = chair.limits, chair.state
        back = min(self.backward, limits.backward)
        low = max(-back, v - limits.deceleration * self.reach)
        high = max(low, min(limits.forward, v + limits.acceleration * self.reach))
        wide = limits.turn_acceleration * self.reach
        left, right = max(-limits.turn, w - wide), min(limits.turn, w + wide)
        v_grid = np.append(np.linspace(low, high, self.speeds), np.clip(0.0, low, high))
        w_grid = np.append(np.linspace(left, right, self.turns), np.clip(0.0, left, right))
        return np.stack(np.meshgrid(v_grid, w_grid, indexing="ij"), axis=-1).reshape(-1, 2)

    def make(self) -> Follower:
        """A follower at rest."""
        return FanFollower(self)


def whole_fan(limits: Limits, backward: float) -> Array:
    """A fan (c, 2) over all twists within limits, finer where they are slow."""
    back = min(backward, limits.backward)
    v = np.concatenate([[-back, -0.5 * back, 0.0], limits.forward * PACES])
    w = limits.turn * np.concatenate([-TURNS[::-1], [0.0], TURNS])
    return np.stack(np.meshgrid(v, w, indexing="ij"), axis=-1).reshape(-1, 2)


class FanFollower:
    """Chooses among a fan of twists by roll-out."""

    def __init__(self, own: Window | DynamicWindow) -> None:
        self.own = own

    def twist(self, around: Surroundings, reference: Reference, chair: Motion) -> Array | None:
        """See `Follower.twist`."""
        own, near, weights = self.own, near_of(around, reference), self.own.objective.weights
        twists = around.unhurried(own.fan(chair), chair.state)
        lasting = np.full(len(twists), own.objective.horizon)
        fan = np.column_stack([twists, lasting])[:, None]  # (c, 1, 3)

        def pick(margin: float, slow: bool) -> Array | None:
            some = allowed(fan, around, slow)
            costs = costs_of(some, chair.body, near, margin, weights)
            best = cheapest(some[:, 0], costs, chair.body, near, own.hold, margin)
            return np.array(some[best, 0, :2]) if best >= 0 else None

        return widest(around, chair, own.margin, pick)

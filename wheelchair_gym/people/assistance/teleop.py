"""The stick itself, with or without the shield behind it, and nav2's assisted teleop.

Source of the teleop: nav2_behaviors, AssistedTeleop (main, August 2026): the twist is projected in
steps; a collision at the first of them gives rest, one at time t scales all components by t over
the whole time, so that the arc is kept. It never steers.
"""

from __future__ import annotations

from typing import Any

from wheelchair_gym.base.settings import settings
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.people.assistance.arcs import free_share
from wheelchair_gym.people.assistance.freedom import Freedom, Twist


@settings
class Shielded:
    """The stick is the twist, behind the shield."""

    freedom: Freedom = Freedom(backward=2.0)


@settings
class Direct(Shielded):
    """The stick is the twist; nothing is filtered."""

    shielded = False


TIME, _STEP = 1.0, 0.1  # s that the twist is projected, and between its poses: nav2 AssistedTeleop


@settings
class Teleop:
    """Scales the stick's twist by the time to a collision; keeps its arc."""

    freedom: Freedom = Freedom(turn=0.0)


@borrowing_kernel
def slowed(p: Any, a: Any, v: float, w: float, time: float) -> Twist:
    """Scale a twist by the share of a time [s] for which a row's outline can follow it."""
    points = a.points[: a.n_points]
    share = free_share(points, p.outline[:], v, w, time, _STEP, a.margin)
    return share * v, share * w

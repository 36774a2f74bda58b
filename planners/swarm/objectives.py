"""What a swarm of paths is asked for, as settings: `OBJECTIVES` names the sources' cost functions.

Each stands with exact edge tests; `faithful` keeps its source's own tests, sound or not.
"""

from __future__ import annotations

from planners.collision.solids import DISC_SIDES
from planners.swarm import path_cost as terms
from planners.swarm.path_cost import PathCost
from wheelchair_gym.config import setting, settings

_FAITHFUL = "exact tests; true: the source's own"
_PLAIN = PathCost(
    length_measure=terms.LENGTH,
    weight=1.0,
    turning=terms.NO_TURNING,
    violation_range=0.0,
    points_only=False,
    violation=0.0,
    collision_test=terms.EDGES,
    blocked_factor=0.0,
    blocked_edge_cost=0.0,
    push=terms.NO_PUSH,
    slack=0.0,
)
_EACH = "an edge inside weighs more than all lengths on a map"


def length_free(shortness: float, collision_free: float) -> PathCost:
    """The thesis's cost: its weights of length [1/m] and of edges that are not free."""
    return _PLAIN._replace(weight=shortness, blocked_edge_cost=collision_free)


@settings
class LengthFree:
    """Shortness and freedom from collisions, weighed: the thesis, section 2.8."""

    shortness_weight: float = setting(
        default=10.0, unit="1/m", low=0.0, source="thesis, figure 3.1"
    )
    """Cost of length."""
    collision_free_weight: float = setting(default=1e4, low=0.0, source=_EACH + "; thesis: 1")
    """Cost of each blocked edge."""

    @property
    def path_cost(self) -> PathCost:
        """The terms as kernels take them."""
        return length_free(self.shortness_weight, self.collision_free_weight)


@settings
class Smooth:
    """Smoothness, length and validity: P1 (8), f1 + f2 (1 + f3).

    f1 is the mean absolute turning angle [rad] of the way points, f2 the length [m] of the curve,
    f3 the penalty where any of its edges is blocked. Faithful: f1 is (5) with (3) as printed,
    smallest where the path turns in a way of its own, and only way points are tested.
    """

    penalty: float = setting(default=100.0, low=0.0, source="'considerable' in P1 (7)")
    """Cost factor of a path with a blocked edge."""
    faithful: bool = setting(default=False, source=_FAITHFUL)
    """Whether the source's own tests are used in place of exact ones."""

    @property
    def path_cost(self) -> PathCost:
        """The terms as kernels take them."""
        return _PLAIN._replace(
            turning=terms.PRINTED_TURNING if self.faithful else terms.MEAN_TURNING,
            collision_test=terms.WAY_POINTS if self.faithful else terms.EDGES,
            blocked_factor=self.penalty,
        )


@settings
class Violation:
    """Length of the curve, times one and the violation of round obstacles: P2 (18)-(21).

    The violation is the mean over the curve of max(reach - D / R, 0), D from the curve's pieces,
    and blocked edges cost, too. Faithful: D from sampled points, and nothing else is tested.
    """

    penalty: float = setting(default=100.0, low=0.0, source="Yarpiz, whose program P2 follows")
    """Cost factor of the mean violation."""
    violation_range: float = setting(default=1.2, low=0.0, source="P2 (20)")
    """Radii from a centre up to which a disc is violated."""
    blocked_cost: float = setting(default=100.0, unit="m", low=0.0, source=_EACH)
    """Cost of each blocked edge."""
    faithful: bool = setting(default=False, source=_FAITHFUL)
    """Whether the source's own tests are used in place of exact ones."""

    @property
    def path_cost(self) -> PathCost:
        """The terms as kernels take them."""
        return _PLAIN._replace(
            violation_range=self.violation_range,
            points_only=self.faithful,
            violation=self.penalty,
            collision_test=terms.NOTHING if self.faithful else terms.EDGES,
            blocked_edge_cost=0.0 if self.faithful else self.blocked_cost,
        )


@settings
class WayPoints:
    """R1's loss, the root of the sum of squared legs.

    Ours counts it in metres, so that it is the length where all legs are as long, and adds P2's
    violation along the exact segments. Faithful: as printed, and nothing but way points is looked
    at: where one falls into a disc (d^2 <= r^2 + slack) it is pushed out and drawn again.
    """

    penalty: float = setting(default=100.0, low=0.0, source="design choice: as P2")
    """Cost factor of the mean violation."""
    violation_range: float = setting(
        default=1.0 + 5.0 / DISC_SIDES**2,
        low=0.0,
        source="pi^2 / 2 n^2: the corners of the polygon of a disc",
    )
    """Radii from a centre up to which a disc is violated."""
    blocked_cost: float = setting(default=100.0, unit="m", low=0.0, source=_EACH)
    """Cost of each blocked edge."""
    slack: float = setting(default=1.0, unit="m^2", low=0.0, source="R1, section 5.3")
    """Square that is added to that of a radius."""
    faithful: bool = setting(default=False, source=_FAITHFUL)
    """Whether the source's own tests are used in place of exact ones."""

    @property
    def path_cost(self) -> PathCost:
        """The terms as kernels take them."""
        if self.faithful:
            return _PLAIN._replace(
                length_measure=terms.PRINTED_ENERGY,
                collision_test=terms.NOTHING,
                push=terms.DOUBLED,
                slack=self.slack,
            )
        return _PLAIN._replace(
            length_measure=terms.ENERGY,
            violation_range=self.violation_range,
            violation=self.penalty,
            blocked_edge_cost=self.blocked_cost,
        )

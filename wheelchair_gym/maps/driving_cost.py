"""The cost of driving: time at the speed that the chair takes, and more near obstacles.

The planner `lattice` and the cost-to-go of the outline share it.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry.kinematics import Limits
from wheelchair_gym.geometry.outline import Footprint

STILL = 1e-9  # m, rad: less is no motion
LATERAL_ACCELERATION = 0.35  # m/s2: maximum in curves, for comfort


class MotionCost(NamedTuple):
    """The chair's motion and its costs."""

    outline: NDArray[np.float64]  # (3,) m: front, rear, half width
    margin: float  # m: least clearance
    desired_clearance: float  # m: a larger clearance costs no less
    obstacle_weight: float  # extra cost factor of a move without clearance
    forward: float  # m/s
    backward: float  # m/s: reverse motion costs as if it were so slow
    turn: float  # rad/s
    pivot_speed: float  # rad/s of a pivot
    switch_time: float  # s: to stop and start in another direction
    curvature_weight: float  # s per 1/m of a change of curvature


@settings
class DrivingCost:
    """Terms of the cost of driving."""

    desired_clearance: float = setting(
        default=0.25, unit="m", low=0.01, source="clearance beside the chair in a door of 1.1 m"
    )
    """Clearance beyond which more brings no lower cost."""
    obstacle_weight: float = setting(default=3.0, low=0.0, source="tuned on training seeds")
    """Additional cost of a move without clearance, as a multiple of its time."""
    pivot_speed_ratio: float = setting(
        default=0.6, low=0.05, high=1.0, source="speed of the followers turning in place"
    )
    """Turn rate of pivots as a share of the limit."""
    reverse_factor: float = setting(default=2.0, low=1.0, source="no sensor looks back")
    """Cost of reversing as a multiple of its time."""

    def motion_cost(
        self, footprint: Footprint, limits: Limits, margin: float, curvature_weight: float = 0.0
    ) -> MotionCost:
        """The cost as kernels take it, for an outline that keeps a margin [m]."""
        # Accelerating to full speed costs half its duration; so does stopping.
        switch = 0.5 * limits.forward / limits.acceleration
        return MotionCost(
            footprint.array, margin, self.desired_clearance, self.obstacle_weight,
            limits.forward, limits.backward / self.reverse_factor, limits.turn,
            self.pivot_speed_ratio * limits.turn, switch, curvature_weight,
        )  # fmt: skip


@borrowing_kernel
def duration(motion: MotionCost, way: float, turn: float) -> float:
    """Time [s] that a stretch (a way [m] while turning [rad]) takes at the speed it allows."""
    if abs(way) < STILL:
        return abs(turn) / motion.pivot_speed
    bend = abs(turn / way)
    speed = motion.forward if way > 0.0 else motion.backward
    if bend > 0.0:
        speed = min(speed, min(motion.turn / bend, math.sqrt(LATERAL_ACCELERATION / bend)))
    return abs(way) / speed


@borrowing_kernel
def kind_of(way: float, turn: float) -> int:
    """1: ahead, -1: back, 2: a pivot, 0: none."""
    if abs(way) < STILL:
        return 2 if abs(turn) > STILL else 0
    return 1 if way > 0.0 else -1


@borrowing_kernel
def stretch_cost(motion: MotionCost, way: float, turn: float, gap: float) -> float:
    """Cost [s] of a stretch with a least clearance [m]: its duration, and more near obstacles."""
    short = (motion.desired_clearance - gap) / motion.desired_clearance
    return duration(motion, way, turn) * (1.0 + motion.obstacle_weight * short * short)

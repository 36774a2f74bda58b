"""Distance that the chair's outline could follow a twist among obstacles."""

from __future__ import annotations

import math

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry.kinematics import arc_step
from wheelchair_gym.geometry.outline import signed_gap


@borrowing_kernel
def follow_arc(
    points: Array, outline: Array, v: float, w: float, step: float, steps: int, margin: float,
    maximum: float, give_up: float,
) -> tuple[int, float]:  # fmt: skip
    """Return how far the outline can follow a twist among points (n, 2) [m].

    Poses at which it cannot have come near enough to matter are left out.

    Args:
        points: in the chair's frame.
        outline: `Footprint.array`.
        v: speed [m/s].
        w: turn rate [rad/s].
        step: between two poses [s].
        steps: how many.
        margin: to be kept [m].
        maximum: a larger clearance counts as this [m].
        give_up: where the clearance is below this [m], the rest is not followed.

    Returns:
        How many steps keep the margin, or come no nearer than the chair is, and the least clearance
        on them.
    """
    n = points.shape[0]
    reach = math.hypot(max(outline[0], outline[1]), outline[2])
    nearer = step * (abs(v) + abs(w) * reach)  # m a step that a point of the outline moves at most
    minimum, clear, k = signed_gap(points, n, outline, 0.0, 0.0, 0.0), maximum, 0
    matters = max(clear, margin)  # a pose with a larger clearance changes nothing
    if minimum > matters:
        k = int(min(float(steps), (minimum - matters) / max(nearer, 1e-9)))
    while k < steps:
        x, y, yaw = arc_step(0.0, 0.0, 0.0, v, w, step * (k + 1))
        gap = signed_gap(points, n, outline, x, y, yaw)
        if gap < margin and gap < minimum:
            return k, clear
        minimum, clear = min(margin, gap), min(clear, gap)
        if clear < give_up:
            return steps, clear
        k, matters = k + 1, max(clear, margin)
        if gap > matters:
            k += int(min(float(steps), (gap - matters) / max(nearer, 1e-9)))
    return steps, clear


@borrowing_kernel
def free_share(
    points: Array, outline: Array, v: float, w: float, time: float, step: float, margin: float
) -> float:
    """Share of a time [s] for which the outline can follow a twist, in steps [s]: `follow_arc`."""
    steps = max(1, round(time / step))
    free, _ = follow_arc(points, outline, v, w, step, steps, margin, 0.0, -math.inf)
    return float(free / steps)

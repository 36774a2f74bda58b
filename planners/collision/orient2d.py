"""The orientation predicate: on which side of a line a point lies, exactly for the given numbers.

The area is computed in double precision, and in double-double where rounding could decide the sign.
"""

from __future__ import annotations

from wheelchair_gym.compiled.kernel import borrowing_kernel


@borrowing_kernel
def _two_product(a: float, b: float) -> tuple[float, float]:
    """Product of a and b as the sum of two doubles, exactly (Dekker 1971)."""
    p = a * b
    t = 134217729.0 * a
    ah = t - (t - a)
    t = 134217729.0 * b
    bh = t - (t - b)
    al, bl = a - ah, b - bh
    return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl


@borrowing_kernel
def _two_diff(a: float, b: float) -> tuple[float, float]:
    """Difference a - b as the sum of two doubles, exactly (Knuth)."""
    d = a - b
    t = d - a
    return d, (a - (d - t)) - (b + t)


@borrowing_kernel
def _orient2d_extended(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """The predicate in double-double arithmetic."""
    ux, ux_low = _two_diff(bx, ax)
    uy, uy_low = _two_diff(by, ay)
    vx, vx_low = _two_diff(cx, ax)
    vy, vy_low = _two_diff(cy, ay)
    p, p_low = _two_product(ux, vy)
    q, q_low = _two_product(uy, vx)
    low = (p_low - q_low) + ((ux * vy_low + ux_low * vy) - (uy * vx_low + uy_low * vx))
    return (p - q) + low


@borrowing_kernel
def orient2d(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Positive if c lies left of the line from a to b, negative if right, 0 if exactly on it."""
    p, q = (bx - ax) * (cy - ay), (by - ay) * (cx - ax)
    area = p - q
    if abs(area) > 4e-16 * (abs(p) + abs(q)) or (p == 0.0 and q == 0.0):
        return area
    return _orient2d_extended(ax, ay, bx, by, cx, cy)

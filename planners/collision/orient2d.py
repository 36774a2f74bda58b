"""Which side of a line a point lies on, exactly for the numbers given, as a kernel.

The area is computed in double, and once more with twice the digits where rounding could decide.
"""

from __future__ import annotations

from wheelchair_gym.compiled.kernel import borrowing_kernel


@borrowing_kernel
def _product(a: float, b: float) -> tuple[float, float]:
    """Product of a and b as the sum of two doubles, exactly (Dekker 1971)."""
    p = a * b
    t = 134217729.0 * a
    ah = t - (t - a)
    t = 134217729.0 * b
    bh = t - (t - b)
    al, bl = a - ah, b - bh
    return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl


@borrowing_kernel
def _difference(a: float, b: float) -> tuple[float, float]:
    """Difference a - b as the sum of two doubles, exactly (Knuth)."""
    d = a - b
    t = d - a
    return d, (a - (d - t)) - (b + t)


@borrowing_kernel
def _side_of_doubt(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """`side` with twice the digits."""
    ux, ux_low = _difference(bx, ax)
    uy, uy_low = _difference(by, ay)
    vx, vx_low = _difference(cx, ax)
    vy, vy_low = _difference(cy, ay)
    p, p_low = _product(ux, vy)
    q, q_low = _product(uy, vx)
    low = (p_low - q_low) + ((ux * vy_low + ux_low * vy) - (uy * vx_low + uy_low * vx))
    return (p - q) + low


@borrowing_kernel
def side(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Positive if c lies left of the line from a to b, negative if right, 0 if exactly on it."""
    p, q = (bx - ax) * (cy - ay), (by - ay) * (cx - ax)
    area = p - q
    if abs(area) > 4e-16 * (abs(p) + abs(q)) or (p == 0.0 and q == 0.0):
        return area
    return _side_of_doubt(ax, ay, bx, by, cx, cy)

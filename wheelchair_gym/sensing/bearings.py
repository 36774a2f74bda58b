"""Where a sensor sees the ends of segments, and an arc tangent that vectorises."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.kernel import borrowing_kernel, inlined

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

_F = np.float32
_ZERO, _TINY = _F(0.0), _F(1e-30)
_QUARTER, _HALF = _F(0.5 * math.pi), _F(math.pi)
# Odd polynomial of the arc tangent on [0, 1] (Abramowitz and Stegun 4.4.49), lowest power first.
_A1, _A3, _A5, _A7 = _F(0.9999993329), _F(-0.3332985605), _F(0.1994653599), _F(-0.1390853351)
_A9, _A11, _A13, _A15 = _F(0.0964200441), _F(-0.0559098861), _F(0.0218612286), _F(-0.0040540580)


@inlined
def bearing(y: np.float32, x: np.float32) -> np.float32:
    """The angle of (x, y) [rad] to 3e-7: a polynomial, so that it vectorises."""
    ax, ay = abs(x), abs(y)
    far = ax if ax > ay else ay
    near = ay if ax > ay else ax
    a = near / (far if far > _TINY else _TINY)
    s = a * a
    r = ((_A15 * s + _A13) * s + _A11) * s + _A9
    r = (((r * s + _A7) * s + _A5) * s + _A3) * s + _A1
    r = r * a
    r = _QUARTER - r if ay > ax else r
    r = _HALF - r if x < _ZERO else r
    return -r if y < _ZERO else r


@borrowing_kernel
def see_ends(walls: Array, x: float, y: float, ends: Floats) -> None:
    """Ends of the segments (n, 4) [m], seen from (x, y): ends (2 n, 2), flat."""
    flat = walls.reshape(walls.size)
    for k in range(np.uint64(2 * walls.shape[0])):
        ends[2 * k] = _F(flat[2 * k] - x)
        ends[2 * k + 1] = _F(flat[2 * k + 1] - y)

"""The laser: exact ranges on segments and discs, then noise, then what a scanner reports.

Each segment is rasterised onto its own interval of beams. In the sensor's frame, along the line
through a and b with e = b - a and c = a x e, the inverse range is linear in the beam's direction:
1/r = (e_y/c) cos - (e_x/c) sin. So a scan takes no division and no trigonometry per beam.

Loops over segments and beams are in float32 and made to vectorise: flat arrays, since a row's
length is a stride that the compiler does not know; unsigned indices, since a negative one would
count from the end; selects, not branches. The sensor's position is subtracted in float64 first.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.compiled.address import (
    Pointers,
    doubles_at,
    floats_at,
    read_record,
    rows_of,
    words_at,
)
from wheelchair_gym.compiled.kernel import absorbed_kernel, borrowing_kernel, inlined
from wheelchair_gym.compiled.random import LASER, LASER_BIAS, bits, mix, normal
from wheelchair_gym.compiled.simd import bits_of_float, rasterize_line
from wheelchair_gym.geometry.planar import point_to_world, world_to_body
from wheelchair_gym.sensors.echoes import atan2_f32, reach_of_mount, relative_endpoints
from wheelchair_gym.sensors.settings import LaserSettings, SensorSettings

WORKSPACE_ROWS = 10  # rows of workspace: 4 for ends, 2 for angles, 4 for lines

_F = np.float32
_ZERO, _ONE, _TINY, _NONE = _F(0.0), _F(1.0), _F(1e-30), _F(np.inf)
_TURN = _F(2.0 * math.pi)
_EDGE = _F(2e-6)  # rad: beams this near to a segment's end are hits, so that joints have no gap
_SLIM = _F(1e-12)  # rad2: segments that look narrower than the root of this are seen edge-on

# A beam's noise is the sum of the four bytes of a 32-bit hash (Irwin-Hall, n = 4, cut at 3.46).
_U = np.uint32
_MEAN = _F(2.0 * 255.0)
_PER_COUNT = _F(1.0 / math.sqrt(4.0 * (256.0**2 - 1.0) / 12.0))
_BYTES, _LOW_HALF = _U(0x00FF00FF), _U(0xFFFF)
_8, _15, _16 = _U(8), _U(15), _U(16)
_FIRST, _SECOND = _U(0x7FEB352D), _U(0x846CA68B)  # of a 32-bit xor-multiply mixer


@inlined
def median3(a: np.float32, b: np.float32, c: np.float32) -> np.float32:
    """The median of three ranges; where one is invalid, the middle one."""
    low, high = a if a < b else b, b if a < b else a
    top = high if high < c else c
    return low if low > top else top


@inlined
def shown_range(r: np.float32) -> np.float32:
    """Return the range at which a beam shows something: 0 if too near, +inf if it is invalid."""
    shown = r if r > _ZERO else _ZERO
    return shown if r == r else _NONE


@absorbed_kernel
def nearest_beam(scan: Floats, low: int, high: int) -> int:
    """Return which of the beams from low to high shows the nearest thing; the first of equals."""
    nearest = bits_of_float(_NONE)
    for k in range(np.uint64(low), np.uint64(high)):
        bits = bits_of_float(shown_range(scan[k]))
        nearest = bits if bits < nearest else nearest
    best = low
    while bits_of_float(shown_range(scan[best])) != nearest:
        best += 1
    return best


class LaserArrays(NamedTuple):
    """Arrays that kernels need of a laser."""

    cosine: Floats  # (beams,) of each beam's angle in the sensor's frame
    sine: Floats  # (beams,)
    salt: NDArray[np.uint32]  # (beams,) a hash of each beam's number in the reading
    first: float  # rad: angle of beam 0
    per_angle: float  # beams per rad
    mount: Array  # (3,) m, m, rad in the chair's frame
    reach: float  # m
    nearest: float  # m
    sigma: float  # m
    no_echo: float
    bias: float  # m
    offset: float  # m, beside the bias
    number: int  # among the chair's scanners
    start: int  # its first range in a reading
    shows_free: int  # 1: space that its beams cross is free

    @classmethod
    def of(cls, laser: LaserSettings, noise: bool, number: int = 0, start: int = 0) -> LaserArrays:
        """Arrays of settings; without noise all errors are zero.

        `number` is the scanner's among those of the chair, `start` its first range in a reading:
        so that no two scanners share a draw.
        """
        angles = laser.angles
        share = 1.0 if noise else 0.0
        return cls(
            np.cos(angles).astype(np.float32),
            np.sin(angles).astype(np.float32),
            np.array([mix(np.uint64(start + i)) for i in range(laser.beams)], np.uint64).astype(_U),
            -laser.fov / 2,
            (laser.beams - 1) / laser.fov,
            np.array([laser.x, laser.y, laser.yaw]),
            laser.reach,
            laser.range_min,
            laser.sigma * share,
            laser.dropout * share,
            laser.bias * share,
            0.0,
            number,
            start,
            int(laser.shows_free),
        )


@borrowing_kernel
def _find_beams(
    n: int, ends: Floats, c: np.float32, s: np.float32, first: float, per_angle: float, out: Floats
) -> None:
    """Write the fractional beam numbers of the n ends, counted from beam 0."""
    zero, scale = _F(first), _F(per_angle)
    for k in range(np.uint64(n)):
        x, y = ends[2 * k], ends[2 * k + 1]
        out[k] = (atan2_f32(c * y - s * x, c * x + s * y) - zero) * scale


@borrowing_kernel
def _lines_of_segments(
    n: int, ends: Floats, at: Floats, c: np.float32, s: np.float32, laser: LaserArrays, out: Floats
) -> None:
    """Of each of n segments its line (a, b) and its interval of beams, both ends included.

    An interval across the seam behind the sensor ends one turn further on; that of a segment which
    no beam can reach ends at -1.
    """
    square, turn = _F(laser.reach * laser.reach), _TURN * _F(laser.per_angle)
    edge, beams = _EDGE * _F(laser.per_angle), _F(laser.cosine.shape[0])
    for k in range(np.uint64(n)):
        x0, y0, x1, y1 = ends[4 * k], ends[4 * k + 1], ends[4 * k + 2], ends[4 * k + 3]
        ex, ey = x1 - x0, y1 - y0
        cross, length = x0 * ey - y0 * ex, ex * ex + ey * ey
        t = -(x0 * ex + y0 * ey) / (length if length > _TINY else _TINY)
        t = t if t > _ZERO else _ZERO
        t = t if t < _ONE else _ONE
        qx, qy = x0 + t * ex, y0 + t * ey
        near = qx * qx + qy * qy < square
        wide = cross * cross > _SLIM * (x0 * x0 + y0 * y0) * (x1 * x1 + y1 * y1)
        inverse = _ONE / cross
        start, end = at[2 * k], at[2 * k + 1]
        low = start if cross > _ZERO else end
        high = end if cross > _ZERO else start
        high = high if high >= low else high + turn
        low = np.ceil(low - edge)
        low = low if low > _ZERO else _ZERO
        high = high + edge
        seen = near & wide & (((low <= high) & (low < beams)) | (high >= turn))
        out[4 * k] = (c * ey - s * ex) * inverse
        out[4 * k + 1] = -(c * ex + s * ey) * inverse
        out[4 * k + 2] = low
        out[4 * k + 3] = high if seen else -_ONE


@borrowing_kernel
def _keep_visible(n: int, lines: Floats) -> np.int64:
    """Move the lines that some beam can reach to the front, without a branch; how many they are."""
    kept = np.uint64(0)
    for k in range(np.uint64(n)):
        a, b, low, high = lines[4 * k], lines[4 * k + 1], lines[4 * k + 2], lines[4 * k + 3]
        lines[4 * kept], lines[4 * kept + 1] = a, b
        lines[4 * kept + 2], lines[4 * kept + 3] = low, high
        kept += np.uint64(high >= _ZERO)
    return np.int64(kept)


@borrowing_kernel
def _rasterize_discs(
    laser: LaserArrays, x: float, y: float, yaw: float, discs: Array, out: Floats
) -> None:
    """Nearest of what the beams saw and the discs, as inverse ranges."""
    beams = out.shape[0]
    c, s = math.cos(yaw), math.sin(yaw)
    for k in range(discs.shape[0]):
        x0, y0, radius = discs[k, 0] - x, discs[k, 1] - y, discs[k, 2]
        far = x0 * x0 + y0 * y0
        rest = far - radius * radius
        if rest > laser.reach * (laser.reach + 2.0 * radius):
            continue
        if rest <= 0.0:
            out[:] = _NONE
            continue
        ax, ay = world_to_body(c, s, x0, y0)
        middle, half = math.atan2(ay, ax), math.asin(radius / math.sqrt(far))
        for turn in range(-1, 2):
            low = middle - half + 2.0 * math.pi * turn - laser.first
            i0 = max(0, math.ceil(low * laser.per_angle))
            i1 = min(beams, math.floor((low + 2.0 * half) * laser.per_angle) + 1)
            for i in range(np.uint64(i0), np.uint64(max(i0, i1))):
                along = ax * laser.cosine[i] + ay * laser.sine[i]
                inside = along * along - rest
                # The near root of r^2 - 2 along r + rest = 0, as its inverse.
                hit = _F((along + math.sqrt(inside if inside > 0.0 else 0.0)) / rest)
                out[i] = hit if hit > out[i] else out[i]


@borrowing_kernel
def exact_scan(
    laser: LaserArrays,
    x: float,
    y: float,
    yaw: float,
    walls: Array,
    discs: Array,
    workspace: Floats,
    out: Floats,
) -> None:
    """Exact ranges of one scan."""
    n, width = walls.shape[0], workspace.shape[1]
    rows = workspace.reshape(workspace.size)
    ends, at, lines = rows[: 4 * width], rows[4 * width : 6 * width], rows[6 * width :]
    c, s = _F(math.cos(yaw)), _F(math.sin(yaw))
    relative_endpoints(walls, x, y, ends)
    _find_beams(2 * n, ends, c, s, laser.first, laser.per_angle, at)
    _lines_of_segments(n, ends, at, c, s, laser, lines)
    seen = _keep_visible(n, lines)
    beams, turn = out.shape[0], _TURN * _F(laser.per_angle)
    reach = _F(laser.reach)
    farthest = _ONE / reach
    out[:] = farthest
    for k in range(seen):
        a, b, low, high = lines[4 * k], lines[4 * k + 1], lines[4 * k + 2], lines[4 * k + 3]
        while high >= _ZERO:  # twice if across the seam behind the sensor
            i0, i1 = int(low), min(beams, int(high) + 1)
            rasterize_line(out, laser.cosine, laser.sine, a, b, i0, i1)
            low, high = _ZERO, high - turn
    _rasterize_discs(laser, x, y, yaw, discs, out)
    for i in range(np.uint64(beams)):  # 1 / (1 / reach) may be rounded below the reach
        out[i] = _ONE / out[i] if out[i] > farthest else reach


@borrowing_kernel
def add_laser_noise(laser: LaserArrays, key: np.uint64, step: int, out: Floats) -> None:
    """Turn exact ranges (beams,) into what the scanner reports, in place.

    Offset, bias of the episode, noise, lost echoes; no echo within reach is +inf, too near is -inf.
    """
    seed = bits(key, step, LASER, 0)
    low, high = _U(seed), _U(seed >> np.uint64(32))
    scale = _F(laser.sigma) * _PER_COUNT
    bias = laser.bias * normal(key, 0, LASER_BIAS, laser.number)
    offset = _F(bias + laser.offset) - _MEAN * scale
    lost = _U(min(laser.no_echo * 2.0**32, 2.0**32 - 1.0))
    reach, nearest = _F(laser.reach), _F(laser.nearest)
    for i in range(np.uint64(out.shape[0])):
        # 32-bit rounds, which vectorise; after the first it is known whether the echo is lost. The
        # salt comes from memory, since numbers made from i would be mixed at its 64 bits.
        x = _U(laser.salt[i] ^ low)
        x = _U(_U(x ^ (x >> _16)) * _FIRST)
        x = _U(x ^ (x >> _15) ^ high)
        gone = x < lost
        x = _U(x * _SECOND)
        x = _U(x ^ (x >> _16))
        pairs = _U((x & _BYTES) + ((x >> _8) & _BYTES))
        total = np.int32(_U((pairs & _LOW_HALF) + (pairs >> _16)))
        exact = out[i]
        noisy = exact + (offset + _F(total) * scale)
        noisy = -_NONE if noisy < nearest else noisy
        out[i] = _NONE if (exact >= reach) | (noisy > reach) | gone else noisy


@borrowing_kernel
def sense_laser(
    laser: LaserArrays,
    pose: Array,
    walls: Array,
    discs: Array,
    key: np.uint64,
    step: int,
    workspace: Floats,
    out: Floats,
) -> None:
    """One scan of a chair at a pose (3,) [m, m, rad], as its laser reports it."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = point_to_world(c, s, pose[0], pose[1], laser.mount[0], laser.mount[1])
    share = reach_of_mount(pose[0], pose[1], x - pose[0], y - pose[1], walls, discs)
    if share < 1.0:
        x, y = pose[0] + share * (x - pose[0]), pose[1] + share * (y - pose[1])
    exact_scan(laser, x, y, pose[2] + laser.mount[2], walls, discs, workspace, out)
    add_laser_noise(laser, key, step, out)


SCANNER, _TARGETS = read_record("SCANNER", globals())
scanners_at = rows_of(SCANNER)


def scanner_pointers(sensors: SensorSettings, noise: bool) -> Pointers:
    """The scanners of a chair, a record (n,) of SCANNER; without noise all errors are zero."""
    lasers = sensors.lasers
    pointers = Pointers(np.zeros(len(lasers), SCANNER), _TARGETS, constant=True)
    for k, (laser, at) in enumerate(zip(lasers, sensors.slices, strict=True)):
        arrays = LaserArrays.of(laser, noise, k, at.start)
        _, *names = SCANNER.names or ()  # all but beams
        values = {name: getattr(arrays, name) for name in names}
        pointers.fill(k, beams=laser.beams, **values)
    return pointers


@inlined
def scanner_at(address: Any, count: int, k: int) -> LaserArrays:
    """Scanner k of `count` whose records lie at an address."""
    one = scanners_at(address, count)[k]
    return laser_arrays(one, doubles_at(one.mount, 3), one.sigma, one.no_echo, one.bias, 0.0)


@inlined
def laser_arrays(
    one: Any, mount: Any, sigma: float, no_echo: float, bias: float, offset: float
) -> LaserArrays:
    """Return the arrays of a record of SCANNER with another mount and other errors."""
    return LaserArrays(
        floats_at(one.cosine, one.beams),
        floats_at(one.sine, one.beams),
        words_at(one.salt, one.beams),
        one.first,
        one.per_angle,
        mount,
        one.reach,
        one.nearest,
        sigma,
        no_echo,
        bias,
        offset,
        one.number,
        one.start,
        one.shows_free,
    )

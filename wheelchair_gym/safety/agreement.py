"""Compare the scans of a scanner with the motion that the wheels report.

A key scan is stored as points of surfaces, in the frame of dead reckoning. Each later scan is
matched to it:

    key points ── motion of the wheels ──▶ expected places ── beams ──▶ offsets along the normals

One rigid motion is fitted to all offsets (point to line, robust weights: Censi 2008, PL-ICP). If
the world is static, the sensors work and the wheels roll, it is zero. It is not zero if scans are
late, repeated or of a stuck mirror, if the scanner was moved, turned or mirrored, if wheels slip,
or if an encoder is wrong. People and doors move parts of the scene, not all of it.

Key points at which beams lose their echo are remembered: no echo is no evidence of free space.
`faults.py` calls `disagrees` and raises the fault. Frozen and blind scans are checked there.
"""

import math
from typing import Any

import numpy as np

from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.compiled.address import floats_at, on_stack, rows_of
from wheelchair_gym.compiled.kernel import as_int, borrowing_kernel, inlined
from wheelchair_gym.geometry.planar import point_to_world, world_to_body
from wheelchair_gym.safety.grid import scanner_frame
from wheelchair_gym.safety.state import BODY, FAR, KEY_POINTS, SAME, Frame
from wheelchair_gym.sensors.echoes import atan2_f32
from wheelchair_gym.sensors.laser import LaserArrays

_F, _NAN, _INF = np.float32, np.float32(np.nan), np.float32(np.inf)
_ALONE = 0.2  # m: a range without a neighbour so near may be a ghost echo
_CHORD = 0.25  # m: minimum length of a surface that gives a normal
_NEIGHBOURS = 8  # maximum number of points on each side that span it
_FLAT = 0.04  # m: maximum distance of its middle from the chord
_SCALE = 0.05  # m: offset with half of the weight
_CAPTURE = 0.5  # m: larger offsets are not of the same surface
_FACING = 0.15  # cosine of the angle of incidence: from behind or edge-on, others are hit
_ITERATIONS = 2  # of the fit, for each scan
_PRIOR, _PRIOR_TURN = 2.0, 8.0  # weight of a zero motion, in points and in points times m2
_MATCHED, _ENOUGH = 90, 40  # minimum points of a fit that counts, and to keep the key scan
_MOVED = 0.05  # m and rad since the key scan: at rest, only the world can have moved
_AGREES = 0.85  # if the wheels' motion explains this share, one step from zero replaces the fit
_EXPLAINED = 0.6  # minimum share of points that the fitted motion explains
_TELLING = 0.03  # m: a point is *telling* if the motion moves it farther than this along its normal
_MIN_TELLING_SCORE = 0.72  # share of these that it explains: a trolley ahead is not the whole scene
_GAIN = 0.08  # difference of the scores of two motions, as a share of the points, that counts
_OFF, _OFF_PER_METRE, _OFF_PER_RADIAN = 0.05, 0.05, 0.04  # m: bound of the fitted shift
_TURNED, _TURNED_PER_RADIAN = 0.06, 0.10  # rad: bound of the fitted turn
_DISAGREES = 0.15  # s
_SHORTEST = 0.03  # m and rad: a shorter motion tells nothing about repeated scans
_MOST_TOLD = 0.15  # m: changes above this count no more
_CHANGED, _NOISE = 0.05, 0.01  # m, of the range: errors that noise alone does not give
_STEP, _WIDE = 0.05, 6.0  # of the range, key beams: neighbours farther apart span no surface
_APART = 0.3  # of the range: minimum difference from both neighbours of a pole's point
_EVIDENCE = 0.02  # m2: minimum sum of squares that tells scans that lag from fresh ones
_MOST = 0.7  # share of the sum with which a scan lags
_FEW = 12  # maximum number of sectors that a person who walks ahead changes
_LEAP = 0.04  # m: change of the fitted shift from one scan to the next that is in doubt
_DOUBTED = 0.4  # m and rad after which a mark that tells nothing is renewed
_MAX_FOLLOWED, _MANY = 0.25, 60  # m and rad, sectors: old ranges for longer are a fault
_LAG_PRIOR = 0.01  # m2/s: squared change of speed times its duration that counts for no lag
_LAG_SUM = 0.2  # m2/s, and rad2/s: the same of the latest changes of speed that count
_LAG_FADES = 60.0  # s
_MAX_LAG = 0.3  # s
_KEY_WAY, _KEY_TURN = 1.0, 1.2  # m, rad: motion after which the key scan is renewed
_STAY = 0.5  # share of its points: with fewer matched, it is renewed
_STRANGE, _UNEXPLAINED = 0.4, 42  # maximum share explained, and minimum points that are not
_RENEWS = 1.0  # s of strange scans: then people stand around, and the key scan is renewed
_FADES = 0.05  # m/s: at rest `followed` fades, so that a person who leaves does not block the path
_SPREAD = 2  # beams on each side of the expected one that may show the echo as well
_REACH_MARGIN = 0.5  # m: a point so near the reach may be out of it in the next scan
_EDGE = 0.1  # rad: the same for the ends of the fan
_FORGET_LOST = 5.0  # s at rest or at creep speed after which a lost point is forgotten
_FORGET_LOST_MOVING = 60.0  # s in motion: the memory of static points
_DARK = 1.0  # m and rad that points were lost on a beam which has had no echo since
DARK_BEAMS = 6  # neighbouring key beams (9 degrees) that make a blind sector
_GONE = np.float32(-1.0)  # s: of a point that has left
_STATIC = 1.0  # s for which a point was seen that is missed when it is lost
_INHERITS = 0.3  # m between a point of the key scan and the same one of the key scan before
_SEEN, _LEFT, _LOST, _UNCLEAR = range(4)

_HEARD, _HEARD_SHARE, _HEARD_POINTS = 1.5, 0.5, 2  # m, of the reach: a surface surely heard
_SQUARE = math.cos(math.radians(8.0))  # of the angle between its normal and the ranger's axis

# Normal equations of a fit; score and number of all points in it, and of those that are telling.
_VECTORS = [("h", "f8", (3, 3)), ("g", "f8", (3,)), ("other", "f8", (3,))]
_SCORES = [("score", "f8"), ("n", "i8"), ("telling_score", "f8"), ("n_telling", "i8")]
_FIT = np.dtype([*_VECTORS, *_SCORES])
_fit_at, _FIT_SIZE = rows_of(_FIT), _FIT.itemsize
_OLD = np.dtype([(name, "f4", (KEY_POINTS,)) for name in ("x", "y", "lost", "held")])
_old_at, _OLD_SIZE = rows_of(_OLD), _OLD.itemsize


@inlined
def _expected(one: LaserArrays, at: Frame, x: float, y: float) -> tuple[int, float]:
    """Beam towards a point and the distance [m] of the point; beam -1: not surely in view."""
    dx, dy = x - at.x, y - at.y
    ahead, left = world_to_body(at.c, at.s, dx, dy)
    far, beams = math.sqrt(dx * dx + dy * dy), one.cosine.shape[0]
    place = (atan2_f32(_F(left), _F(ahead)) - one.first) * one.per_angle
    edge = _EDGE * one.per_angle
    seen = (edge <= place) & (place < beams - 1 - edge)  # NaN gives false
    seen &= (one.nearest < far) & (far < one.reach - _REACH_MARGIN)
    return as_int(place + 0.5) if seen else as_int(-1), far


@borrowing_kernel
def _look(scan: Floats, b: int, far: float) -> int:
    """Return what a beam and those beside it show at a point that is so far away [m]."""
    begin, end = max(0, b - _SPREAD), min(scan.shape[0], b + _SPREAD + 1)
    without, beyond = 0, 0
    for k in range(begin, end):
        if abs(scan[k] - far) < SAME:
            return _SEEN
        without += scan[k] == _INF
        beyond += far + SAME < scan[k] < _INF
    if without == end - begin:
        return _LOST
    return _LEFT if 2 * beyond > end - begin else _UNCLEAR


@borrowing_kernel
def _find_normals(key: Any) -> None:
    """Store the unit normal of each key point on a flat surface; (0, 0) where there is none.

    Points are ordered counter-clockwise around the scanner, so that normals face it.
    """
    for k in range(KEY_POINTS):
        key.normal_x[k] = key.normal_y[k] = _F(0.0)
        for j in range(1, _NEIGHBOURS + 1):
            a, b = k - j, k + j
            if a < 0 or b >= KEY_POINTS:
                break
            dx, dy = key.x[b] - key.x[a], key.y[b] - key.y[a]
            far = math.sqrt(dx * dx + dy * dy)
            if not far < np.inf:  # a point is missing
                break
            if far < _CHORD:
                continue
            px, py = key.x[k] - key.x[a], key.y[k] - key.y[a]
            if abs(px * dy - py * dx) <= _FLAT * far and far <= 2.0 * j * _CHORD:
                key.normal_x[k], key.normal_y[k] = _F(-dy / far), _F(dx / far)
            break


@borrowing_kernel
def _renew_key(
    key: Any, one: LaserArrays, at: Frame, scan: Floats, velocity: tuple[float, float, float]
) -> None:
    """Store a scan as the key; lost points stay where the scan lacks an echo."""
    beams, old = scan.shape[0], _old_at(on_stack(_OLD_SIZE), 1)[0]
    for k in range(KEY_POINTS):
        old.x[k], old.y[k], old.lost[k], old.held[k] = key.x[k], key.y[k], key.lost[k], key.held[k]
        b = k * (beams - 1) // (KEY_POINTS - 1)
        r = scan[b]
        key.lost[k], key.held[k], key.x[k], key.y[k] = _F(0.0), _F(0.0), _NAN, _NAN
        beside = min(abs(scan[max(0, b - 1)] - r), abs(scan[min(beams - 1, b + 1)] - r))
        if one.nearest <= r < one.reach and beside < _ALONE:
            px, py = point_to_world(at.c, at.s, at.x, at.y, r * one.cosine[b], r * one.sine[b])
            key.x[k], key.y[k] = _F(px), _F(py)
    for k in range(KEY_POINTS if key.begun else 0):
        b, _ = _expected(one, at, old.x[k], old.y[k])
        to = (b * (KEY_POINTS - 1) + (beams - 1) // 2) // (beams - 1)
        if b < 0 or old.lost[k] < 0.0:
            continue
        if key.x[to] == key.x[to]:
            same = math.hypot(key.x[to] - old.x[k], key.y[to] - old.y[k]) < _INHERITS
            key.held[to] = max(key.held[to], old.held[k] if same else _F(0.0))
        elif old.lost[k] > 0.0:
            key.x[to], key.y[to], key.lost[to] = old.x[k], old.y[k], old.lost[k]
    _find_normals(key)
    key.begun, key.way, key.turned, key.renewed, key.strange = True, 0.0, 0.0, True, 0.0
    key.at[0], key.at[1], key.at[2], key.at[3] = at.x, at.y, at.c, at.s
    for k in range(3):
        key.offset[k], key.speed[k] = 0.0, velocity[k]


@borrowing_kernel
def _fit(key: Any, one: LaserArrays, at: Frame, scan: Floats, offset: Array, fit: Any) -> None:
    """Write the normal equations of the motion left over at an offset (3,), and its scores.

    A score counts the points that the offset explains, each by 1 / (1 + (residual / scale)^2).
    """
    beams = scan.shape[0]
    dx, dy, c, s = offset[0], offset[1], math.cos(offset[2]), math.sin(offset[2])
    fit.score, fit.n, fit.telling_score, fit.n_telling = 0.0, 0, 0.0, 0
    for i in range(3):
        fit.g[i] = 0.0
        for j in range(3):
            fit.h[i, j] = 0.0
    for k in range(KEY_POINTS):
        nx, ny = np.float64(key.normal_x[k]), np.float64(key.normal_y[k])
        if (nx == 0.0 and ny == 0.0) or key.lost[k] > 0.0:
            continue
        ax, ay = key.x[k] - at.x, key.y[k] - at.y
        ex, ey = point_to_world(c, s, dx, dy, ax, ay)
        if -(nx * ex + ny * ey) < _FACING * math.sqrt(ex * ex + ey * ey):
            continue
        ahead, left = world_to_body(at.c, at.s, ex, ey)
        b = math.floor((atan2_f32(_F(left), _F(ahead)) - one.first) * one.per_angle + 0.5)
        if b < 0 or b >= beams or not one.nearest <= scan[b] < _INF:  # nor too near, which is -inf
            continue
        fit.n += 1
        is_telling = abs(nx * (ex - ax) + ny * (ey - ay)) > _TELLING
        fit.n_telling += is_telling
        r = np.float64(scan[b])
        qx, qy = point_to_world(at.c, at.s, 0.0, 0.0, r * one.cosine[b], r * one.sine[b])
        e = nx * (qx - ex) + ny * (qy - ey)
        if abs(e) > _CAPTURE:
            continue
        share = 1.0 / (1.0 + (e / _SCALE) * (e / _SCALE))
        fit.score += share
        fit.telling_score += share if is_telling else 0.0
        row = nx, ny, ny * (ex - dx) - nx * (ey - dy)
        for i in range(3):
            fit.g[i] += share * row[i] * e
            for j in range(3):
                fit.h[i, j] += share * row[i] * row[j]


@borrowing_kernel
def _improve(fit: Any, offset: Array) -> None:
    """Improve an offset (3,) by one step of Gauss and Newton; unseen directions stay at zero."""
    h, g = fit.h, fit.g
    prior = _PRIOR, _PRIOR, _PRIOR_TURN
    for i in range(3):
        h[i, i] += prior[i]
        g[i] -= prior[i] * offset[i]
    for i in range(3):  # elimination; the matrix is positive definite
        for j in range(i + 1, 3):
            share = h[j, i] / h[i, i]
            g[j] -= share * g[i]
            for k in range(i, 3):
                h[j, k] -= share * h[i, k]
    for i in range(2, -1, -1):
        for k in range(i + 1, 3):
            g[i] -= h[i, k] * g[k]
        g[i] /= h[i, i]
        offset[i] += g[i]


@borrowing_kernel
def _refine(key: Any, one: LaserArrays, at: Frame, scan: Floats, offset: Array, fit: Any) -> None:
    """Fit an offset (3,) from where it is, and write its score."""
    for _ in range(_ITERATIONS):
        _fit(key, one, at, scan, offset, fit)
        _improve(fit, offset)
    _fit(key, one, at, scan, offset, fit)


@borrowing_kernel
def _fits_another_motion(key: Any, one: LaserArrays, at: Frame, scan: Floats, dt: float) -> bool:
    """Fit the motion of a scan that the wheels do not report; return True if it is large."""
    fit, offset = _fit_at(on_stack(_FIT_SIZE), 1)[0], key.offset[:]
    _fit(key, one, at, scan, key.still[:], fit)
    matched, plain = fit.n, fit.score
    if key.renewed:
        key.matched, key.renewed = matched, False
    key.few = matched < max(_ENOUGH, as_int(_STAY * key.matched))
    strange = (plain < _STRANGE * matched) & (matched - plain > _UNEXPLAINED)
    key.strange = key.strange + dt if strange else 0.0
    if plain >= _AGREES * matched:
        offset[0] = offset[1] = offset[2] = 0.0
        _improve(fit, offset)
        return False
    _refine(key, one, at, scan, offset, fit)
    other, best = fit.other[:], fit.score
    for k in range(1, 3 if best < _EXPLAINED * fit.n else 1):
        # A scan that repeats moves with the chair; a mirrored one turns at twice its rate.
        other[0], other[1] = k * (at.x - key.at[0]), k * (at.y - key.at[1])
        other[2] = k * math.atan2(
            at.s * key.at[2] - at.c * key.at[3], at.c * key.at[2] + at.s * key.at[3]
        )
        _refine(key, one, at, scan, other, fit)
        if fit.score > best:
            best = fit.score
            offset[0], offset[1], offset[2] = other[0], other[1], other[2]
    _fit(key, one, at, scan, offset, fit)
    if fit.score < plain - _GAIN * fit.n:  # a wrong minimum
        for k in range(3):
            offset[k] = 0.0
        return False
    explained = (fit.score - plain >= _GAIN * fit.n) & (fit.score >= _EXPLAINED * fit.n)
    explained &= fit.telling_score >= _MIN_TELLING_SCORE * fit.n_telling
    off = math.sqrt(offset[0] * offset[0] + offset[1] * offset[1])
    shifted = off > _OFF + _OFF_PER_METRE * key.way + _OFF_PER_RADIAN * key.turned
    turned = abs(offset[2]) > _TURNED + _TURNED_PER_RADIAN * key.turned
    return bool((fit.n >= _MATCHED) & explained & (shifted | turned))


@borrowing_kernel
def _nearest(scan: Floats, k: int, n: int) -> float:
    """Return the minimum range of the k-th of n sectors of a scan, so that no pole is missed."""
    beams, found = scan.shape[0], _INF
    b, half = k * (beams - 1) // (n - 1), (beams - 1) // (n - 1) // 2
    for i in range(max(0, b - half), min(beams, b + half + 1)):
        found = min(found, scan[i])
    return np.float64(found)


@borrowing_kernel
def _begin_mark(key: Any, at: Frame, scan: Floats) -> None:
    """Store the nearest range of each sector of a scan, to compare later scans with them."""
    n = min(KEY_POINTS, scan.shape[0])
    for k in range(n):
        key.mark[k] = _F(_nearest(scan, k, n))
    key.mark_at[0], key.mark_at[1], key.mark_at[2], key.mark_at[3] = at.x, at.y, at.c, at.s
    key.marked, key.followed, key.repeats = True, 0.0, 0


@borrowing_kernel
def _expect(key: Any, one: LaserArrays, at: Frame, ranges: Floats) -> float:
    """Write the ranges (n,) expected from the mark; return the motion [m, rad] since it.

    Two neighbouring points of similar range span a surface. A point far before or far behind both
    neighbours is as wide as its sector; between them, a wall is lost from sight. +inf: nothing.
    """
    dx, dy = world_to_body(at.c, at.s, key.mark_at[0] - at.x, key.mark_at[1] - at.y)
    c = at.c * key.mark_at[2] + at.s * key.mark_at[3]
    s = at.c * key.mark_at[3] - at.s * key.mark_at[2]
    n, last = ranges.shape[0], one.cosine.shape[0] - 1
    per_key = last / (n - 1)
    ax, ay, a, r_before, was_far, was_nearer = 0.0, 0.0, np.nan, np.nan, True, False
    ranges[:] = _INF
    for k in range(n):
        r, b = float(key.mark[k]), k * last // (n - 1)
        px, py, p, with_before = 0.0, 0.0, np.nan, False
        if one.nearest <= r < one.reach:
            px, py = point_to_world(c, s, dx, dy, r * one.cosine[b], r * one.sine[b])
            p = (atan2_f32(_F(py), _F(px)) - one.first) * one.per_angle / per_key
            with_before = (a < p < a + _WIDE) & (abs(r - r_before) < _STEP * r)
        is_far = not abs(r - r_before) < _APART * r
        is_end = (n == KEY_POINTS) & (was_nearer != (r < r_before))  # fewer sectors: also a pole
        if with_before:
            for j in range(max(0, math.ceil(a)), min(n, math.floor(p) + 1)):
                i = j * last // (n - 1)
                across = one.cosine[i] * (py - ay) - one.sine[i] * (px - ax)
                at_ray = (ax * py - ay * px) / across if across > 0.0 else np.inf
                if abs(at_ray - ranges[j]) < _STEP * at_ray:  # two pieces of one surface
                    ranges[j] = _F(0.5 * (at_ray + ranges[j]))
                else:
                    ranges[j] = min(ranges[j], _F(at_ray))
        elif was_far & is_far & (not is_end) & (-0.5 < a < n - 0.5):
            j = as_int(a + 0.5)
            ranges[j] = min(ranges[j], _F(math.sqrt(ax * ax + ay * ay)))
        ax, ay, a, r_before, was_far, was_nearer = px, py, p, r, is_far, r_before < r
    turn = math.atan2(s, c)
    return math.sqrt(dx * dx + dy * dy + turn * turn)


@borrowing_kernel
def _update_followed(key: Any, one: LaserArrays, at: Frame, scan: Floats) -> None:
    """Compare a scan with the mark, an earlier scan; store the motion since then if it is doubted.

    Where the motion changes the range of a sector, a fresh scan shows the expected range, and a
    repeated scan the old one. A late scan, or one of a laser that was moved, differs from the
    expectation in most sectors at once. The fit does not find this in a bare passage with one
    thing ahead or among cylinders, where few points are on flat surfaces.
    """
    if not key.marked:
        _begin_mark(key, at, scan)
        return
    n = min(KEY_POINTS, scan.shape[0])
    ranges = floats_at(on_stack(4 * KEY_POINTS), n)
    moved, behind, fresh = _expect(key, one, at, ranges), 0.0, 0.0
    n_behind, n_wrong, n_right = 0, 0, 0
    for k in range(n):
        old, now = np.float64(key.mark[k]), _nearest(scan, k, n)
        change, error, noise = ranges[k] - old, now - ranges[k], _CHANGED + _NOISE * old
        if not (abs(change) < _CAPTURE + moved and abs(error) < _CAPTURE + moved):
            continue  # another object, or no echo
        n_wrong += abs(error) > noise
        n_right += abs(error) < noise
        square = min(abs(change), _MOST_TOLD) ** 2
        if abs(change) < noise or moved < _SHORTEST:
            continue
        # Doubt ends only by ranges within the noise: a laser that was moved stays wrong by more.
        if abs(error) < min(0.5 * abs(change), noise if key.followed > 0.0 else np.inf):
            fresh += square
        elif error * change < 0.0:
            behind += square
            n_behind += 1
    # People change few sectors at first. If most are wrong at once, the scan is of another place.
    is_elsewhere, people = n_wrong > max(_FEW, n_right), 2 * n_wrong > max(_FEW, n_right)
    if is_elsewhere or behind + fresh < _EVIDENCE:
        if is_elsewhere:
            key.followed, key.repeats = max(moved, 1e-3), 0
        if moved > _DOUBTED or (people and key.followed == 0.0):
            _begin_mark(key, at, scan)
    elif behind > _MOST * (behind + fresh):
        key.followed, key.repeats = moved, n_behind
    else:
        _begin_mark(key, at, scan)


@inlined
def _repeats(key: Any) -> bool:
    """Return True if many beams have repeated the mark over too long a motion."""
    return bool((key.followed > _MAX_FOLLOWED) & (key.repeats >= _MANY))


@inlined
def is_doubted(key: Any) -> bool:
    """Return True if the latest scan may be wrong: repeated, or moved otherwise than the wheels."""
    return bool((key.followed > 0.0) | (key.astray > 0.0) | (key.strange > 0.0))


@borrowing_kernel
def _estimate_lag(key: Any, velocity: tuple[float, float, float], dt: float) -> None:
    """Estimate the age of scans [s]: a late scan is behind by the age times the change of speed.

    It is that of the latest changes: the sums are bounded.
    """
    keeps = math.exp(-dt / _LAG_FADES) * min(1.0, _LAG_SUM / max(key.square, 1e-9))
    key.square *= keeps
    key.product *= keeps
    for k in range(3):
        change = velocity[k] - key.speed[k]
        key.square += dt * change * change
        key.product += dt * change * key.offset[k]
    key.lag = min(max(key.product / (key.square + _LAG_PRIOR), 0.0), _MAX_LAG)


@borrowing_kernel
def disagrees(
    key: Any, one: LaserArrays, pose: Array, scan: Floats, v: float, w: float, dt: float
) -> bool:
    """Match a scan to the key scan; return True if it does not move as the wheels report.

    The pose is dead-reckoned (3,), v and w [m/s, rad/s] are what the wheels report, dt [s] is since
    the scan before.
    """
    at, velocity = scanner_frame(one.mount, pose), (v * math.cos(pose[2]), v * math.sin(pose[2]), w)
    if not key.begun:
        _renew_key(key, one, at, scan, velocity)
        return False
    key.way += abs(v) * dt
    key.turned += abs(w) * dt
    another = False
    if key.renewed or v != 0.0 or w != 0.0:
        x, y, renewed = key.offset[0], key.offset[1], key.renewed
        another = _fits_another_motion(key, one, at, scan, dt) and key.way + key.turned > _MOVED
        _update_followed(key, one, at, scan)
        if not renewed and math.hypot(key.offset[0] - x, key.offset[1] - y) > _LEAP:
            key.followed = max(key.followed, _LEAP)
    elif _repeats(key):  # it is a fault now, which only a person clears
        _begin_mark(key, at, scan)
    else:
        key.followed = max(0.0, key.followed - _FADES * dt)
        key.strange += dt if key.strange > 0.0 else 0.0
    _estimate_lag(key, velocity, dt)
    key.astray = key.astray + dt if another else 0.0
    moved = key.few or key.way > _KEY_WAY or key.turned > _KEY_TURN
    if not another and (key.strange > _RENEWS or (moved and key.strange == 0.0)):
        _renew_key(key, one, at, scan, velocity)
    return bool(key.astray > _DISAGREES or _repeats(key))


@borrowing_kernel
def count_expected(key: Any, one: LaserArrays, pose: Array) -> int:
    """Return the number of key points that should be in view from a pose (3,)."""
    at, count = scanner_frame(one.mount, pose), 0
    for k in range(KEY_POINTS):
        b, _ = _expected(one, at, key.x[k], key.y[k])
        count += b >= 0
    return count


@borrowing_kernel
def expected_echo(key: Any, at: Frame, half: float, reach: float) -> float:
    """Return the range [m] of a surface of the key scan that a ranger must hear; +inf: none.

    The ranger has a frame, half a cone [rad] and a reach [m].
    """
    found, far, nearest = 0, min(_HEARD_SHARE * reach, _HEARD), math.inf
    for k in range(KEY_POINTS):
        ahead, left = world_to_body(at.c, at.s, key.x[k] - at.x, key.y[k] - at.y)
        facing = abs(at.c * key.normal_x[k] + at.s * key.normal_y[k])
        heard = (ahead > 0.2) & (ahead < far) & (abs(left) < 0.5 * half * ahead)
        heard &= facing > _SQUARE
        found += heard
        nearest = ahead if heard & (ahead < nearest) else nearest
    return nearest if found >= _HEARD_POINTS else math.inf


@borrowing_kernel
def _has_moved(s: Any, x: float, y: float) -> bool:
    """Whether something that moved lately is beside a point."""
    for k in range(s.n_marks):
        dx, dy = s.marks[k].x - x, s.marks[k].y - y
        if dx * dx + dy * dy < (2.0 * BODY) ** 2:
            return True
    return False


@borrowing_kernel
def find_lost(
    s: Any, key: Any, one: LaserArrays, scan: Floats, minimum: Floats, slow: bool, way: float,
    dt: float,
) -> None:  # fmt: skip
    """Find key points at which no beam has an echo: these beams then show no free space.

    It also counts neighbouring beams that stay dark while known points pass before them.

    A lost point returns with its echo, and goes when a beam measures something behind it. It also
    goes after a while at creep speed if no ultrasonic hears anything that the laser does not.

    `minimum`, that of `Scan`, is set to -inf at lost points, and for a repeated scan. `slow`: the
    chair is at rest, or drives at creep speed. Way [m and rad] and dt [s] are since the last scan.
    """
    at, beams = scanner_frame(one.mount, s.pose), scan.shape[0]
    wide, heard = (beams - 1) // (KEY_POINTS - 1) + 1, False
    for k in range(s.n_arc.shape[0]):
        heard |= s.n_arc[k] > 0
    for k in range(KEY_POINTS):
        b, far = _expected(one, at, key.x[k], key.y[k])
        if b < 0:
            continue
        seen = _look(scan, b, far)
        if seen != _LOST:
            key.held[k] += _F(dt) if seen == _SEEN else _F(0.0)
            key.lost[k] = _GONE if seen == _LEFT else _F(0.0)
            continue
        moves = key.held[k] < _F(_STATIC) or _has_moved(s, key.x[k], key.y[k])
        if key.lost[k] == _F(0.0) and moves:
            key.lost[k] = _GONE
        if key.lost[k] == _GONE:
            continue
        key.lost[k] += _F(dt if slow else dt * _FORGET_LOST / _FORGET_LOST_MOVING)
        if key.lost[k] > _F(_FORGET_LOST) and not heard:
            key.lost[k] = _GONE
            continue
        s.n_lost += far < FAR
        key.dark[(b * (KEY_POINTS - 1) + (beams - 1) // 2) // (beams - 1)] += _F(way)
        for i in range(max(0, b - wide), min(beams, b + wide + 1)):
            minimum[i] = -_INF
    run, any_run, dark = 0, 0, key.dark[:]
    for k in range(KEY_POINTS):
        dark[k] = dark[k] if scan[k * (beams - 1) // (KEY_POINTS - 1)] == _INF else _F(0.0)
        run = run + 1 if dark[k] > _DARK else 0
        any_run = any_run + 1 if dark[k] > 0.0 else 0
        s.n_dark = max(s.n_dark, run)
        s.n_lost += any_run >= DARK_BEAMS
    if key.followed > 0.0:  # it may repeat
        minimum[:] = -_INF


@borrowing_kernel
def add_lost(s: Any, key: Any) -> None:
    """Add the lost key points nearby as obstacles of this reading."""
    points, n = s.points, s.n_points
    for k in range(KEY_POINTS if s.n_lost > 0 else 0):
        dx, dy = key.x[k] - s.pose[0], key.y[k] - s.pose[1]
        if key.lost[k] > 0.0 and dx * dx + dy * dy < FAR * FAR:
            points.x[n], points.y[n], points.stamp[n] = key.x[k], key.y[k], -math.inf
            n += 1
    s.n_points = n

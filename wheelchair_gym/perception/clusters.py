"""From a scan to clusters: what of it is static surroundings, what belongs together, and where.

Hits are compared with the scans of the last seconds (`look`): a place that a beam passed was free,
a place where something was seen a while ago is static, as is what a map shows. Neighbouring hits
form clusters. A narrow cluster is dropped if it is static; of a wide one, static hits are cut out.
"""

import math
from typing import Any

import numpy as np

from wheelchair_gym.base.arrays import Floats, Rows
from wheelchair_gym.compiled.address import field_at, floats_at, read_record, rows_of
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.geometry.planar import point_to_world, world_to_body
from wheelchair_gym.perception.track_state import CLUSTERS, FRAMES, PERSON_WIDTH, SECTORS
from wheelchair_gym.sensors.echoes import atan2_f32

_F, _INF = np.float32, np.float32(np.inf)
OUT, HIDDEN, NEAR, HIT, PASSED = range(5)  # how a place looks in a scan
FREE, UNSURE, STATIC = range(3)  # what is known of the place of a hit
_MAX_RANGE = 8.0  # m up to which something is tracked: someone at 1.5 m/s needs 5 s from there
# m: measured error of a cluster's centre, see the page on tracking; more where beams are far apart.
_SIGMA = 0.04
_GAP = 0.15  # m between neighbouring hits of one cluster at most (Leigh et al. 2015: 0.13)
_MAX_WIDTH = 1.2  # m: widest cluster that is tracked; a door leaf is 0.6 to 1.1 m wide
_LEG_DISTANCE = 0.8  # m between the legs of one person at most (Leigh et al. 2015); a step is 0.7
_TWO_LEGS = 0.08  # m: error of the centre of a pair of legs (Leigh et al. 2015: 0.1)
_TIME_SIGMA = 0.005  # s: error of a scan's stamp, half of a 10 ms step of the drive board
_STATIC_TIME = 1.0  # s at one place, and a hit is static: 0.25 m/s covers the noise of a place
_MAP_DISTANCE = 0.15  # m: what is so near a mapped wall belongs to it,
_MAP_SPREAD = 0.03  # and so much farther per range: the error of the heading [rad]
_PASSED = 0.20  # m: a beam that ends so far beyond a place has passed it
_BESIDE = 0.15  # m on either side of a place that must be empty, too
_SAME = 0.12  # m: a beam that ends so near a place has hit it
_SLANT = 6.0  # m of range per m between beams, of a surface that is seen at 10 degrees
_JUMP = 0.10  # m: where ranges jump, the place of a hit is looked at anew
_SPREAD = 1.3  # times as far apart as two beams are neighbours on one surface, if it is slanted
_OWNED = 0.05  # m beyond its radius: what is so near a confirmed track that rests is not static
_HUGE = 1e9  # cells
_FRESH = 0.3  # s since a track was seen: after longer, what is there may be something else
_OWN_MAP = 0.3  # times as near to a mapped wall such a hit must be to belong to the wall
_FARTHEST = 1.0  # m from the nearest confirmed track: hits farther from it are nobody's
_HALF_HIDDEN = 0.10  # m: error of a centre of which only one side is seen
_NARROW = 0.30  # m: a leg is narrower
_ONE_LEG = 0.15  # m: error of a centre of which one leg is seen
_COARSE = 0.10  # m between beams: more, and legs look like bodies
_STRAIGHT_WIDTH, _STRAIGHT = 0.45, 0.06  # m: what is so wide and bends less is straight,
_MANY_HITS = 6  # if it has this many hits
DISC = 0.25 * math.pi  # radii: how much nearer than its centre all beams see a disc, in the mean
RADII = (0.04, 0.45)  # m
_BODY = 0.25  # m: radius of what is seen in part, and width of people at least
_MAX_HITS = 3  # that such a width must have, or as many as its beams

HIT_ROW = read_record("HIT_ROW", globals())[0]
CLUSTER = read_record("CLUSTER", globals())[0]
hits_at, clusters_at = rows_of(HIT_ROW), rows_of(CLUSTER)


@borrowing_kernel
def set_frame(g: Any, pose: Any, stamp: float, laser: Floats, frame: Any) -> None:
    """Store a scan (beams,) that was taken at a pose (3,) as a record of FRAME."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = point_to_world(c, s, pose[0], pose[1], g.mount[0], g.mount[1])
    yaw = pose[2] + g.mount[2]
    frame.stamp, frame.x, frame.y = stamp, x, y
    frame.c, frame.s = math.cos(yaw), math.sin(yaw)
    for k in range(SECTORS):  # those beyond the last beam are empty
        minimum = _INF
        for b in range(k * g.group, min((k + 1) * g.group, g.beams)):
            r = laser[b] if laser[b] == laser[b] else -_INF  # of an invalid beam nothing is known
            minimum = r if r < minimum else minimum
        frame.range[k] = minimum


@inlined
def sector_of(g: Any, ahead: float, left: float) -> int:
    """The sector of a scan in which a point of the laser's frame lies; -1: not in view."""
    beam = (float(atan2_f32(_F(left), _F(ahead))) - g.first) * g.per_angle + 0.5
    return int(beam) // g.group if 0.0 <= beam < g.beams else -1


@borrowing_kernel
def look(g: Any, frame: Any, x: float, y: float) -> int:
    """State of a place (dead-reckoned) in a scan: passed by beams, hit, hidden, out of view."""
    ahead, left = world_to_body(frame.c, frame.s, x - frame.x, y - frame.y)
    far, k = math.sqrt(ahead * ahead + left * left), sector_of(g, ahead, left)
    if k < 0 or far > g.reach:
        return OUT
    here = float(frame.range[k])
    before, after = float(frame.range[max(k - 1, 0)]), float(frame.range[min(k + 1, g.sectors - 1)])
    if min(here, before, after) > far + _PASSED:
        return PASSED
    slant = _SLANT * here * g.group / g.per_angle
    low, high = here, here
    for beside in (before, after):
        if abs(beside - here) < slant:
            low, high = min(low, beside), max(high, beside)
    if low - _SAME <= far <= high + _SAME:
        return HIT
    return HIDDEN if here < far else NEAR


@borrowing_kernel
def is_empty(g: Any, frame: Any, x: float, y: float) -> bool:
    """Whether beams have passed a place (dead-reckoned) and all that is near it on either side."""
    ahead, left = world_to_body(frame.c, frame.s, x - frame.x, y - frame.y)
    far, k = math.sqrt(ahead * ahead + left * left), sector_of(g, ahead, left)
    wide = int(_BESIDE / max(far, _BESIDE) * g.per_angle / g.group) + 1
    if k < wide or k >= g.sectors - wide:
        return False
    minimum = _INF
    for j in range(k - wide, k + wide + 1):
        minimum = min(minimum, frame.range[j])
    return bool(minimum > far + _PASSED)


@borrowing_kernel
def _remember(g: Any, s: Any, x: float, y: float) -> int:
    """Whether a place (dead-reckoned) was free or static, by the scans of the last seconds."""
    passed = False
    for i in range(s.n_frames):
        frame = s.frames[(s.newest - i) % FRAMES]
        seen = look(g, frame, x, y)
        if seen == PASSED:
            if is_empty(g, frame, x, y):
                return FREE
            passed = True  # beside something thin, which a small error of the pose moves
        if seen == HIT and not passed and s.stamp - frame.stamp >= _STATIC_TIME:
            return STATIC
    return UNSURE


@borrowing_kernel
def _wall_distance(m: Any, s: Any, ahead: float, left: float) -> float:
    """Distance [m] from a point of the chair's frame to what a map shows; infinite without."""
    if m.rows == 0:
        return math.inf
    pose, origin = s.map_pose, m.origin
    c, sn = math.cos(pose[2]), math.sin(pose[2])
    x, y = point_to_world(c, sn, pose[0] - origin[0], pose[1] - origin[1], ahead, left)
    x, y = world_to_body(math.cos(origin[2]), math.sin(origin[2]), x, y)
    u, v = x * m.per_metre, y * m.per_metre
    if not (abs(u) < _HUGE and abs(v) < _HUGE):
        return math.inf
    col, row = min(max(u, 0.0), m.cols - 1.0), min(max(v, 0.0), m.rows - 1.0)
    off = max(abs(u - col), abs(v - row), 1.0) - 1.0  # cells beyond the map's edge
    return float(field_at(m.gap, m.rows, m.cols)[int(row), int(col)] + off / m.per_metre)


@borrowing_kernel
def _nearest_confirmed(s: Any, x: float, y: float) -> tuple[int, float]:
    """The confirmed track that is nearest to a place (dead-reckoned), or -1; how far it is [m]."""
    owner, minimum = -1, _FARTHEST
    for k in range(s.n_tracks):
        track = s.tracks[k]
        dx, dy = track.x - x, track.y - y
        far = math.sqrt(dx * dx + dy * dy)
        if track.confirmed and far < minimum:
            owner, minimum = k, far
    return owner, minimum


@borrowing_kernel
def _judge(g: Any, s: Any, m: Any, now: Any, hit: Any) -> None:
    """Store whose a hit is, and what is known of its place."""
    x, y = point_to_world(now.c, now.s, now.x, now.y, hit.x, hit.y)
    hit.owner, far = _nearest_confirmed(s, x, y)
    owned = False  # of a confirmed track, though that has stood for long
    if hit.owner >= 0:
        t = s.tracks[hit.owner]
        reach, moved = max(t.radius, 0.5 * t.width), math.hypot(t.x - t.rest_x, t.y - t.rest_y)
        owned = s.stamp - t.seen < _FRESH and moved < 2.0 * reach and far < reach + _OWNED
    c, sn = math.cos(g.mount[2]), math.sin(g.mount[2])
    ahead, left = point_to_world(c, sn, g.mount[0], g.mount[1], hit.x, hit.y)
    near = (_MAP_DISTANCE + _MAP_SPREAD * hit.r) * (_OWN_MAP if owned else 1.0)
    if _wall_distance(m, s, ahead, left) < near:
        hit.place = STATIC
        return
    hit.place = _remember(g, s, x, y)
    if owned and hit.place == STATIC:
        hit.place = UNSURE


@borrowing_kernel
def find_hits(g: Any, s: Any, m: Any, now: Any, laser: Floats, hits: Rows) -> int:
    """Store the valid hits of a scan (beams,); returns how many. One hit of a sector is judged."""
    cosine, sine = floats_at(g.cosine, g.beams), floats_at(g.sine, g.beams)
    n, maximum, last = 0, min(_MAX_RANGE, g.reach), 0
    for b in range(g.beams):
        r = laser[b]
        if not (g.nearest <= r <= maximum):
            continue
        hit = hits[n]
        hit.x, hit.y, hit.r, hit.beam = r * cosine[b], r * sine[b], r, b
        old = hits[last]
        if n == 0 or b // g.group != old.beam // g.group or abs(r - old.r) > _JUMP:
            _judge(g, s, m, now, hit)
            last = n
        else:
            hit.place, hit.owner = old.place, old.owner
        n += 1
    return n


@inlined
def _distance(a: Any, b: Any) -> float:
    """Distance [m] between two hits."""
    return math.hypot(a.x - b.x, a.y - b.y)


@borrowing_kernel
def _breaks(g: Any, a: Any, b: Any) -> bool:
    """Whether two neighbouring hits belong to two clusters."""
    skipped = min(b.beam - a.beam, 2)  # one echo may be lost
    gap = max(_GAP, _SPREAD * skipped * min(a.r, b.r) / g.per_angle)
    other = a.owner != b.owner and a.owner >= 0 and b.owner >= 0
    return bool(other or _distance(a, b) > gap)


@inlined
def place_of_cluster(c: Any, now: Any, radius: float) -> tuple[float, float]:
    """The centre of a cluster, as of a disc with a radius, in the frame of dead reckoning."""
    if c.straight or c.legs:
        return c.x, c.y
    far = c.mean + DISC * radius
    half = math.asin(min(radius / far, 1.0))
    middle = 0.5 * (c.low + c.high)
    if c.low_hidden and not c.high_hidden:
        middle = min(middle, c.high - half)
    elif c.high_hidden and not c.low_hidden:
        middle = max(middle, c.low + half)
    return point_to_world(
        now.c, now.s, now.x, now.y, far * math.cos(middle), far * math.sin(middle)
    )


@borrowing_kernel
def _is_hidden(g: Any, edge: Any, beside: Any, n: int, k: int) -> bool:
    """Whether something nearer hides what is beyond the edge of a cluster, or the view ends."""
    if k < 0 or k >= n:
        return bool(edge.beam < 2 or edge.beam > g.beams - 3)
    return bool(beside.r < edge.r - _GAP and abs(beside.beam - edge.beam) <= 3)


@borrowing_kernel
def _measure(g: Any, s: Any, now: Any, hits: Rows, n: int, begin: int, end: int, c: Any) -> bool:
    """Measure the cluster of hits begin to end; whether it is one that is tracked."""
    a, b = hits[begin], hits[end - 1]
    total, free, static, bend = 0.0, 0, 0, 0.0
    chord = max(_distance(a, b), 1e-6)
    for k in range(begin, end):
        hit = hits[k]
        total += hit.r
        free += hit.place == FREE
        static += hit.place == STATIC
        off = (hit.x - a.x) * (b.y - a.y) - (hit.y - a.y) * (b.x - a.x)
        bend = max(bend, abs(off) / chord)
    count, step = end - begin, 1.0 / g.per_angle
    c.mean, c.free = total / count, free / count
    spacing = c.mean * step
    c.width = chord + spacing
    minimum = min(_MAX_HITS, max(1, int(_BODY / spacing)))
    if count < minimum or c.width > _MAX_WIDTH or 2 * static > count:
        return False
    c.low, c.high = g.first + (a.beam - 0.5) * step, g.first + (b.beam + 0.5) * step
    c.low_hidden = _is_hidden(g, a, hits[max(begin - 1, 0)], n, begin - 1)
    c.high_hidden = _is_hidden(g, b, hits[min(end, n - 1)], n, end)
    c.straight = c.width >= _STRAIGHT_WIDTH and bend < _STRAIGHT and count >= _MANY_HITS
    c.legs, c.taken, c.owner = False, False, hits[(begin + end) // 2].owner
    sine = math.sin(min(0.5 * (c.high - c.low), 1.2))
    c.radius = min(max(c.mean * sine / (1.0 - DISC * sine), RADII[0]), RADII[1])
    part = c.low_hidden or c.high_hidden
    if part:
        c.radius = max(c.radius, _BODY)
    ax, ay = point_to_world(now.c, now.s, now.x, now.y, a.x, a.y)
    bx, by = point_to_world(now.c, now.s, now.x, now.y, b.x, b.y)
    c.ends[0], c.ends[1], c.ends[2], c.ends[3] = ax, ay, bx, by
    c.x, c.y = 0.5 * (ax + bx), 0.5 * (ay + by)
    c.x, c.y = place_of_cluster(c, now, c.radius)
    leg = c.width < _NARROW and spacing < _COARSE
    sigma, turned = _ONE_LEG if leg else _SIGMA, s.twist[1] * _TIME_SIGMA * c.mean
    c.variance = sigma * sigma + spacing * spacing / 12.0 + turned * turned
    if part:
        c.variance += _HALF_HIDDEN * _HALF_HIDDEN
    return True


@borrowing_kernel
def _merge_legs(g: Any, clusters: Rows, n: int) -> int:
    """Merge the two legs of a person into one cluster, the nearest pair first."""
    for _ in range(n):
        first, second, minimum = -1, -1, math.inf
        for j in range(n):
            for k in range(j + 1, min(j + 4, n)):
                a, b = clusters[j], clusters[k]
                apart = math.hypot(a.x - b.x, a.y - b.y)
                wide, spacing = max(a.width, b.width), max(a.mean, b.mean) / g.per_angle
                others = a.owner != b.owner and a.owner >= 0 and b.owner >= 0
                narrow = wide < _NARROW and spacing < _COARSE and not (a.legs or b.legs)
                if apart < min(minimum, _LEG_DISTANCE) and narrow and not others:
                    first, second, minimum = j, k, apart
        if first < 0:
            break
        a, b = clusters[first], clusters[second]
        a.radius = 0.5 * minimum + 0.5 * (a.radius + b.radius)
        a.x, a.y, a.mean = 0.5 * (a.x + b.x), 0.5 * (a.y + b.y), 0.5 * (a.mean + b.mean)
        a.free, a.width, a.legs = 0.5 * (a.free + b.free), 2.0 * a.radius, True
        a.variance = _TWO_LEGS * _TWO_LEGS
        a.owner = a.owner if a.owner >= 0 else b.owner
        n -= 1
        for k in range(second, n):
            clusters[k] = clusters[k + 1]
    return n


@borrowing_kernel
def _add(
    g: Any, s: Any, now: Any, hits: Rows, n: int, begin: int, end: int, attached: bool,
    clusters: Rows, count: int,
) -> int:  # fmt: skip
    """Add the cluster of hits begin to end where it is tracked and has room; how many there are."""
    if end > begin and count < CLUSTERS:
        clusters[count].attached = attached
        count += _measure(g, s, now, hits, n, begin, end, clusters[count])
    return count


@borrowing_kernel
def find_clusters(g: Any, s: Any, now: Any, hits: Rows, n: int, clusters: Rows) -> int:
    """Store what of n hits may move, as records of CLUSTER; returns how many."""
    count, begin = 0, 0
    for k in range(1, n + 1):
        if k < n and not _breaks(g, hits[k - 1], hits[k]):
            continue
        if _distance(hits[begin], hits[k - 1]) <= PERSON_WIDTH:
            count = _add(g, s, now, hits, n, begin, k, False, clusters, count)
        else:  # something stands in front of a wall, or is part of it: static hits are cut out
            first = begin
            for i in range(begin, k + 1):
                if i == k or hits[i].place == STATIC:
                    attached = first > begin or i < k
                    count = _add(g, s, now, hits, n, first, i, attached, clusters, count)
                    first = i + 1
        begin = k
    return _merge_legs(g, clusters, count)

"""The tracker: who and what moves, and how fast, from the scans of one laser.

    scan ──▶ hits: free, static? ──▶ clusters ──▶ association ──▶ Kalman filters ──▶ tracks

After the joint leg tracker of Leigh et al. (2015): whatever is narrow and not static is tracked, a
person or not, with constant velocity; a track is confirmed once it has moved to where nothing stood
before. One compiled function, `update`, serves one chair, a batch and a real chair.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array, Floats, Rows
from wheelchair_gym.compiled.address import Pointers, on_stack, read_record, rows_of
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.geometry.kinematics import arc_step
from wheelchair_gym.geometry.planar import wrap
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.perception.alignment import align
from wheelchair_gym.perception.clusters import (
    CLUSTER,
    HIDDEN,
    HIT_ROW,
    OUT,
    PASSED,
    clusters_at,
    find_clusters,
    find_hits,
    hits_at,
    is_empty,
    look,
    place_of_cluster,
    set_frame,
)
from wheelchair_gym.perception.track_state import (
    ACCELERATION_DENSITY,
    CLUSTERS,
    CONSTANTS,
    DOOR,
    FRAME,
    FRAMES,
    FURNITURE,
    PERSON,
    PERSON_WIDTH,
    STATIC_MAP,
    TRACKER,
    TRACKS,
    UNKNOWN,
    TrackerConstants,
    static_map_pointers,
)
from wheelchair_gym.sensors.settings import LaserSettings

_GATE = 3.0  # standard deviations from a track to its cluster at most: 99 % of a Gaussian
_FIRST_SPEED = 1.0  # m/s: deviation of a new track's speed along each axis; people walk at up to 2
_CONFIRM_TIME = 0.2  # s that a track is seen moving before it is confirmed: measured
_CONFIRM_DISTANCE = 0.25  # m that it has come by then: half a body (Leigh et al. 2015: 0.5)
_MOVING = 0.2  # m/s: a slow walk is 0.4
_MEMORY = 8.0  # s that what was free and occupied is remembered: with 3, tracks jump to walls
_GONE = 0.3  # s of seeing through its place before a track is dropped: three scans at 10 Hz
_MAX_SIGMA = 1.2  # m: deviation of its place at which a track is dropped, about 1.5 s hidden
_FASTEST = 50.0  # m/s, rad/s: no chair is faster
_LONGEST = 1.0  # s without a reading, after which the tracker begins anew
_LOOSE = 0.10  # m: error of a cluster's centre for association, at least: people swing and turn
_LEAP = 0.8  # m: a person who comes out farther from the expected place is somebody else
_SHARE = 0.2  # of a new value in a running mean
_FREE = 0.5  # share of a cluster's hits at places that were free: it has come there
_LARGE_SHARE = 0.5  # share of the last readings
_AWAY = 0.4  # m: the centre of a box whose other side comes into view moves by less
_ATTACHED = 3.0  # times as long something attached to a static object must be seen moving
_SURE = 1.0  # standard deviation of its speed: what moves is faster
_BESIDE = 0.45  # m: nothing new is born so near a confirmed track
_UNSEEN = 0.3  # s: an unconfirmed track is dropped that is in view and not seen for so long
_LOST = 1.0  # s: and so long for a confirmed one, which may have merged with something else
_STANDS = 1.0  # s: what has not moved for so long since it was first seen is furniture
_STAYED, _TURNED = 0.25, 0.35  # m, rad: a leaf's hinge stays, and the leaf turns about it
_PAIRS = 4 * CLUSTERS

PAIR = np.dtype([("cost", "f8"), ("track", "i8"), ("cluster", "i8")])
_pairs_at, _frame_at = rows_of(PAIR), rows_of(FRAME)
_PAIRS_SIZE, _FRAME_SIZE = _PAIRS * PAIR.itemsize, FRAME.itemsize
_CLUSTERS_SIZE, _HIT_SIZE = CLUSTERS * CLUSTER.itemsize, HIT_ROW.itemsize


@borrowing_kernel
def reset(s: Any) -> None:
    """Forget everything."""
    s.begun, s.stamp = False, 0.0
    s.pose[:] = s.map_pose[:] = 0.0
    s.twist[:] = 0.0
    s.n_tracks, s.n_frames, s.newest, s.next_id = 0, 0, 0, 0


@borrowing_kernel
def _follow_chair(s: Any, pose: Any, twist: Any, dt: float) -> None:
    """Move the pose by dead reckoning; the chair's own estimate, too, where it has none."""
    if abs(twist[0]) < _FASTEST and abs(twist[1]) < _FASTEST:  # false for NaN
        s.twist[0], s.twist[1] = twist[0], twist[1]
    v, w = s.twist[0], s.twist[1]
    known = math.isfinite(pose[0] + pose[1] + pose[2])
    x, y, yaw = arc_step(s.pose[0], s.pose[1], s.pose[2], v, w, dt)
    s.pose[0], s.pose[1], s.pose[2] = x, y, yaw
    x, y, yaw = arc_step(s.map_pose[0], s.map_pose[1], s.map_pose[2], v, w, dt)
    s.map_pose[0] = pose[0] if known else x
    s.map_pose[1] = pose[1] if known else y
    s.map_pose[2] = pose[2] if known else yaw


@borrowing_kernel
def place_variance(t: Any, dt: float, q: float) -> float:
    """Variance of a track's place after a time [s], with an acceleration of density q."""
    more = dt * (2.0 * t.covariance + dt * (t.speed_var + dt * q / 3.0))
    return float(t.place_var + more)


@borrowing_kernel
def predict(t: Any, dt: float, q: float) -> None:
    """Move a track on at constant velocity (Bar-Shalom et al. 2001, section 6.2.2).

    With a negative time it takes a prediction back.
    """
    t.x += dt * t.vx
    t.y += dt * t.vy
    t.place_var = place_variance(t, dt, q)
    t.covariance += dt * (t.speed_var + 0.5 * dt * q)
    t.speed_var += dt * q


@borrowing_kernel
def _correct(t: Any, x: float, y: float, variance: float) -> None:
    """Update a track by a measured place [m] (Kalman 1960)."""
    total = t.place_var + variance
    gain, speed_gain = t.place_var / total, t.covariance / total
    dx, dy = x - t.x, y - t.y
    t.x += gain * dx
    t.y += gain * dy
    t.vx += speed_gain * dx
    t.vy += speed_gain * dy
    t.speed_var -= speed_gain * t.covariance
    t.covariance *= 1.0 - gain
    t.place_var *= 1.0 - gain


@borrowing_kernel
def _find_pairs(s: Any, clusters: Rows, n: int, pairs: Rows) -> int:
    """Store tracks and clusters within the gate of each other; returns how many pairs."""
    count = 0
    for k in range(s.n_tracks):
        t = s.tracks[k]
        for i in range(n):
            c = clusters[i]
            dx, dy = c.x - t.x, c.y - t.y
            total = t.place_var + max(c.variance, _LOOSE * _LOOSE)
            square, far = (dx * dx + dy * dy) / total, math.hypot(dx, dy)
            others = t.confirmed and c.owner >= 0 and c.owner != k
            if square > _GATE * _GATE or far > _LEAP or others or count == _PAIRS:
                continue
            pair = pairs[count]
            # Minus twice the logarithm of the likelihood: a track of unknown place comes last.
            pair.cost, pair.track, pair.cluster = square + 2.0 * math.log(total), k, i
            count += 1
    return count


@borrowing_kernel
def _associate(g: Any, s: Any, now: Any, clusters: Rows, n: int) -> None:
    """Continue tracks by clusters: the likeliest pair first, confirmed tracks before others."""
    pairs = _pairs_at(on_stack(_PAIRS_SIZE), _PAIRS)
    count = _find_pairs(s, clusters, n, pairs)
    while count > 0:
        best, sure = 0, s.tracks[pairs[0].track].confirmed
        for k in range(1, count):
            confirmed = s.tracks[pairs[k].track].confirmed
            if confirmed > sure or (confirmed == sure and pairs[k].cost < pairs[best].cost):
                best, sure = k, confirmed
        track, cluster = pairs[best].track, pairs[best].cluster
        _continue(g, s, s.tracks[track], now, clusters[cluster])
        left = 0
        for k in range(count):
            if pairs[k].track != track and pairs[k].cluster != cluster:
                pairs[left] = pairs[k]
                left += 1
        count = left


@borrowing_kernel
def _continue(g: Any, s: Any, t: Any, now: Any, c: Any) -> None:
    """Update a track by the cluster that continues it."""
    dt = s.stamp - t.seen
    part = c.low_hidden or c.high_hidden
    if not part:
        t.radius += _SHARE * (c.radius - t.radius)
        t.width += _SHARE * (c.width - t.width)
    t.straight += _SHARE * (c.straight - t.straight)
    t.attached += _SHARE * (c.attached - t.attached)
    x, y = place_of_cluster(c, now, t.radius)
    _correct(t, x, y, c.variance)
    t.seen, t.passed_for, t.hidden, c.taken = s.stamp, 0.0, False, True
    _follow_leaf(t, c)
    t.travelled = max(t.travelled, math.hypot(t.x - t.first_x, t.y - t.first_y))
    speed = math.hypot(t.vx, t.vy)
    moves = speed > max(_MOVING, _SURE * math.sqrt(t.speed_var))
    far = math.hypot(t.x - t.rest_x, t.y - t.rest_y)
    # It has come to a place that was free, or the place where it rested is seen to be empty.
    left = far > _AWAY and is_empty(g, now, t.rest_x, t.rest_y)
    came = moves and (c.free >= _FREE or left)
    t.moving_for = t.moving_for + dt if came else max(0.0, t.moving_for - dt)
    slower = t.attached >= _LARGE_SHARE and not t.swings
    needed = _CONFIRM_TIME * (_ATTACHED if slower else 1.0)
    if t.moving_for >= needed and far > _CONFIRM_DISTANCE:
        t.confirmed = True
    if moves and t.confirmed:
        t.moved = s.stamp
    if speed < _MOVING:
        t.rest_x += _SHARE * (t.x - t.rest_x)
        t.rest_y += _SHARE * (t.y - t.rest_y)
    t.kind = _kind(s, t)


@borrowing_kernel
def _follow_leaf(t: Any, c: Any) -> None:
    """Watch whether a straight thing turns about one of its ends."""
    if not c.straight:
        return
    e = c.ends
    if t.straight <= _SHARE:  # the first time, or again after long
        for k in range(4):
            t.ends[k] = e[k]
        return
    before = math.atan2(t.ends[3] - t.ends[1], t.ends[2] - t.ends[0])
    turned = wrap(math.atan2(e[3] - e[1], e[2] - e[0]) - before)
    turned = min(abs(turned), math.pi - abs(turned))  # a line has no direction
    stayed = math.inf
    for k in (0, 2):
        for i in (0, 2):
            stayed = min(stayed, math.hypot(e[k] - t.ends[i], e[k + 1] - t.ends[i + 1]))
    if turned > _TURNED and stayed < _STAYED:
        t.swings = True


@borrowing_kernel
def _kind(s: Any, t: Any) -> int:
    """Return the kind of a track, by how it looks and moves: index into KINDS."""
    if t.swings or (t.confirmed and t.attached >= _LARGE_SHARE):
        return DOOR
    if t.confirmed and t.width <= PERSON_WIDTH and t.straight < _LARGE_SHARE:
        return PERSON
    if not t.confirmed and s.stamp - t.born >= _STANDS and t.moving_for == 0.0:
        return FURNITURE
    return UNKNOWN


@borrowing_kernel
def _keep_tracks(g: Any, s: Any, now: Any, dt: float) -> None:
    """Drop tracks whose place is empty, or has become too uncertain."""
    kept = 0
    for k in range(s.n_tracks):
        t = s.tracks[k]
        unseen = s.stamp - t.seen
        lives = t.place_var <= _MAX_SIGMA * _MAX_SIGMA
        if unseen > 0.0:
            dx, dy = t.x - now.x, t.y - now.y
            share = 1.0 - t.radius / max(math.hypot(dx, dy), t.radius)  # to its near side
            t.hidden = look(g, now, now.x + share * dx, now.y + share * dy) in (HIDDEN, OUT)
            passed = look(g, now, t.x, t.y) == PASSED
            t.passed_for = t.passed_for + dt if passed else 0.0
            lives = lives and t.passed_for <= _GONE
            lives = lives and (t.hidden or unseen <= (_LOST if t.confirmed else _UNSEEN))
        if lives:
            if kept < k:
                s.tracks[kept] = t
            kept += 1
    s.n_tracks = kept


@borrowing_kernel
def _free_row(s: Any, now: Any, c: Any) -> int:
    """Return the row of a new track: behind the others, or that of the farthest unconfirmed one."""
    if s.n_tracks < TRACKS:
        s.n_tracks += 1
        return int(s.n_tracks - 1)
    worst, far = -1, math.hypot(c.x - now.x, c.y - now.y)
    for k in range(TRACKS):
        t = s.tracks[k]
        d = math.hypot(t.x - now.x, t.y - now.y)
        if not t.confirmed and d > far:
            worst, far = k, d
    return worst  # -1: all are nearer


@borrowing_kernel
def _add_tracks(s: Any, now: Any, clusters: Rows, n: int) -> None:
    """Begin a track for each cluster that continues none."""
    for i in range(n):
        c = clusters[i]
        if c.taken:
            continue
        if c.owner >= 0:
            near = s.tracks[c.owner]
            if math.hypot(near.x - c.x, near.y - c.y) < _BESIDE:
                continue
        k = _free_row(s, now, c)
        if k < 0:
            continue
        t = s.tracks[k]
        t.id, s.next_id = s.next_id, s.next_id + 1
        t.x = t.first_x = t.rest_x = c.x
        t.y = t.first_y = t.rest_y = c.y
        t.vx, t.vy, t.covariance = 0.0, 0.0, 0.0
        t.place_var, t.speed_var = c.variance, _FIRST_SPEED * _FIRST_SPEED
        t.radius, t.width = c.radius, c.width
        t.born = t.seen = s.stamp
        t.moved, t.moving_for, t.passed_for, t.travelled = -math.inf, 0.0, 0.0, 0.0
        t.straight = _SHARE if c.straight else 0.0
        t.attached = 1.0 if c.attached else 0.0
        for j in range(4):
            t.ends[j] = c.ends[j]
        t.confirmed, t.swings, t.hidden, t.kind = False, False, False, UNKNOWN


@borrowing_kernel
def update(g: Any, s: Any, m: Any, pose: Any, twist: Any, laser: Floats, stamp: float) -> None:
    """Update a tracker (records g of CONSTANTS, s of TRACKER, m of STATIC_MAP) by a scan (beams,).

    A record s of zeros has not begun; with m of zeros the static surroundings are not known. Ranges
    are those of REP-117 [m]. Where the pose (3,) is not finite, dead reckoning goes on; where the
    twist (2,) is not, the last one counts. The same stamp [s] again is ignored, an earlier one
    begins anew.
    """
    if not math.isfinite(stamp) or (s.begun and stamp == s.stamp):
        return
    if not s.begun or not 0.0 < stamp - s.stamp <= _LONGEST:
        reset(s)
        s.begun, s.stamp = True, stamp
    dt = stamp - s.stamp
    s.stamp = stamp
    _follow_chair(s, pose, twist, dt)
    for k in range(s.n_tracks):
        predict(s.tracks[k], dt, ACCELERATION_DENSITY)
    now = _frame_at(on_stack(_FRAME_SIZE), 1)[0]
    set_frame(g, s.pose, stamp, laser, now)
    align(g, s, now, dt)
    hits = hits_at(on_stack(g.beams * _HIT_SIZE), g.beams)
    clusters = clusters_at(on_stack(_CLUSTERS_SIZE), CLUSTERS)
    n = find_hits(g, s, m, now, laser, hits)
    found = find_clusters(g, s, now, hits, n, clusters)
    _associate(g, s, now, clusters, found)
    _add_tracks(s, now, clusters, found)
    _keep_tracks(g, s, now, dt)
    if s.n_frames == 0 or s.stamp - s.frames[s.newest].stamp >= _MEMORY / FRAMES - 1e-6:
        s.newest = (s.newest + 1) % FRAMES
        s.n_frames = min(s.n_frames + 1, FRAMES)
        s.frames[s.newest] = now


TRACKERS, _TARGETS = read_record("TRACKERS", globals())
_constants_at, _states_at, _maps_at = rows_of(CONSTANTS), rows_of(TRACKER), rows_of(STATIC_MAP)


@inlined
def tracker_row(i: int, trackers: Any) -> Any:
    """Constants, state and static map of row i of trackers, a record (1,) of TRACKERS."""
    rows = trackers[0]
    constants = _constants_at(rows.constants, 1)[0]
    return constants, _states_at(rows.states, rows.n)[i], _maps_at(rows.static_maps, rows.n)[i]


@borrowing_kernel
def update_tracker(
    i: int, trackers: Any, pose: Array, twist: Array, laser: Floats, stamp: float
) -> None:
    """Give row i of trackers, a record (1,) of TRACKERS, a scan; see `update`."""
    constants, state, static_map = tracker_row(i, trackers)
    update(constants, state, static_map, pose, twist, laser, stamp)


@borrowing_kernel
def reset_tracker(i: int, trackers: Any) -> None:
    """Reset row i of trackers, a record (1,) of TRACKERS."""
    reset(tracker_row(i, trackers)[1])


def point_to_trackers(
    constants: TrackerConstants, states: Rows, static_maps: Sequence[OccupancyGrid | None]
) -> Pointers:
    """Return pointers to trackers (n,) of TRACKER and what they share, a record (1,) of TRACKERS.

    Args:
        constants: of all of them.
        states: one for each row.
        static_maps: what is known of each row's surroundings; None: nothing.
    """
    maps = static_map_pointers(static_maps)
    rows = Pointers(np.zeros(1, TRACKERS), _TARGETS)
    return rows.fill(n=len(states), constants=constants, states=states, static_maps=maps)


@dataclass(frozen=True, eq=False)
class Tracks:
    """Tracks of n things, in the frame of the pose that the tracker was given last.

    Attributes:
        id: (n,) it stays the same as long as the track lives.
        place: (n, 2) m: centre.
        velocity: (n, 2) m/s over ground.
        covariance: (n, 2, 2) of place and speed along x; along y it is the same, and independent.
        radius: (n,) m.
        kind: (n,) index into KINDS: unknown, person, door, furniture.
        confirmed: (n,) it has moved where nothing stood before.
        hidden: (n,) it is out of sight, and so predicted.
        age: (n,) s since it was first seen.
        unseen: (n,) s since it was last seen.
        still: (n,) s since it last moved; infinite: it never did.
        travelled: (n,) m: greatest distance from where it was first seen.
    """

    id: NDArray[np.int64]
    place: Array
    velocity: Array
    covariance: Array
    radius: Array
    kind: NDArray[np.int64]
    confirmed: NDArray[np.bool_]
    hidden: NDArray[np.bool_]
    age: Array
    unseen: Array
    still: Array
    travelled: Array

    def __len__(self) -> int:
        return len(self.id)

    @classmethod
    def of(cls, state: Any) -> Tracks:
        """The tracks of one record of TRACKER."""
        t, stamp = state["tracks"][: state["n_tracks"]].copy(), state["stamp"]
        x, y, yaw = state["pose"]
        to_x, to_y, to_yaw = state["map_pose"]
        c, s = math.cos(to_yaw - yaw), math.sin(to_yaw - yaw)
        turn = np.array([(c, s), (-s, c)])
        rows = [("place_var", "covariance"), ("covariance", "speed_var")]
        same = ("id", "radius", "kind", "confirmed", "hidden", "travelled")
        return cls(
            place=np.stack([t["x"] - x, t["y"] - y], axis=-1) @ turn + (to_x, to_y),
            velocity=np.stack([t["vx"], t["vy"]], axis=-1) @ turn,
            covariance=np.stack([np.stack([t[a], t[b]], -1) for a, b in rows], axis=-2),
            age=stamp - t["born"],
            unseen=stamp - t["seen"],
            still=stamp - t["moved"],
            **{name: t[name] for name in same},
        )


_LASER = LaserSettings()


class Tracker:
    """Tracks what moves around one chair.

    Args:
        laser: the scanner that it goes by.
    """

    def __init__(self, laser: LaserSettings = _LASER) -> None:
        self._constants, self._beams = TrackerConstants(laser), laser.beams
        self.state: Rows = np.zeros(1, TRACKER)
        self._map: OccupancyGrid | None = None
        self._rows = point_to_trackers(self._constants, self.state, [None])
        blank = np.full(self._beams, np.nan, np.float32)
        self.update(blank, np.zeros(3), np.zeros(2), 0.0)  # compiled before a chair drives
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.state["begun"] = self.state["n_tracks"] = 0

    def update(
        self,
        scan: Floats,
        pose: Array,
        twist: Array,
        time: float,
        static_map: OccupancyGrid | None = None,
    ) -> Tracks:
        """The tracks after a scan.

        Args:
            scan: ranges (beams,) [m]; no echo +inf, too near -inf, invalid NaN.
            pose: of the chair (3,) [m, m, rad] by its own estimate: on the map, if there is one.
            twist: of the chair (2,) [m/s, rad/s] by its encoders.
            time: of the scan [s]. After 1 s without a scan the tracker begins anew.
            static_map: of the surroundings, without what moves; None: they are not known.

        Raises:
            ValueError: an array has another shape.
        """
        shapes = ("scan", scan, (self._beams,)), ("pose", pose, (3,)), ("twist", twist, (2,))
        for name, array, shape in shapes:
            if array.shape != shape:
                raise ValueError(f"{name} has shape {array.shape}; expected {shape}")
        if static_map is not self._map:
            self._map = static_map
            self._rows.point("static_maps", static_map_pointers([static_map]))
        update_tracker(
            0, self._rows.record, np.asarray(pose, np.float64), np.asarray(twist, np.float64),
            np.ascontiguousarray(scan, np.float32), float(time),
        )  # fmt: skip
        return Tracks.of(self.state[0])

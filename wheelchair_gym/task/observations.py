"""Observations: one table of keys, and the functions that write each of them.

A key is one row of `OBSERVATION_KEYS` and one line of `observe`. The space, the place in a flat
observation, a network's scale, the environment's documentation and the vector environment follow
from the row.
"""

import math
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.compiled.address import (
    doubles_at,
    floats_at,
    moves_at,
    rows_of,
    states_at,
    table_at,
)
from wheelchair_gym.compiled.kernel import borrowing_kernel, check_written, inlined, kernel
from wheelchair_gym.geometry.planar import project, world_to_body
from wheelchair_gym.maps.cost_to_go import poses_ahead, to_local
from wheelchair_gym.perception.tracker import tracker_row
from wheelchair_gym.task.prepared_episode import geodesic_to_go, seconds_to_go
from wheelchair_gym.task.settings import TaskSettings
from wheelchair_gym.task.side_clearance import CLEARANCE_MAX, fan_poses, side_clearance

GOAL_REACH = 100.0  # m: farther goals are observed at this distance
PATH_REACH = 10.0  # m: points farther off than this on an axis are clipped
PRIVILEGED_MAX = 256.0  # s, m: a critic observes longer times and distances as this
INTERVENTION_MAX = 2.0  # full speeds ahead or of turning: more is observed as this
STRAIGHT = 0.8  # m/s: the pace of a way that is not known
TRAIL_POINTS = 64  # of a trail that are kept
STICKS = 5  # of a person that are observed: the present one and four earlier ones
TRAIL_SPACING = 0.25  # m between them
TRACK_REACH = 8.0  # m: tracks farther off are not observed
TRACK_SPEED = 3.0  # m/s: faster tracks are observed as so fast
TRACK_NUMBERS = 5  # of each track
FAR_FACTOR = 0.2  # 1/m: of ranges and the goal's distance, with `task.scaled`
_ZERO = np.float32(0.0)


class ObservationSource(NamedTuple):
    """Inputs of the sizes and bounds of observation keys."""

    settings: TaskSettings
    reaches: Array  # (rangers,) m, of the ultrasonics
    beam_reaches: Array  # (observed beams,) m, of all scanners
    twist_max: Array  # (2,) m/s, rad/s
    half_width: float  # m, of the chair
    points: int  # of the guidance that are looked at; 0: none
    per_point: int  # numbers of each: 2 of a point, 4 of a pose
    has_driver: bool = False  # a person drives, whose goal nobody else knows

    @property
    def uses_fan(self) -> bool:
        """Whether side clearances are those at a fan of poses, not at poses of the guidance."""
        return self.settings.hide_guidance or not (self.per_point == 4 and self.points)


class ObservationKey(NamedTuple):
    """One key of the observation."""

    name: str
    size: Callable[[ObservationSource], int]  # how many numbers; 0: the key is absent
    high: Callable[[ObservationSource], ArrayLike]
    meaning: str  # shape, range and meaning, as the environment's documentation shows them
    scale: tuple[float, ...] = (1.0,)  # factors on its numbers for a network, in turn
    privileged: bool = False  # for critics and teachers; these keys are the last
    low: Callable[[ObservationSource], ArrayLike] | None = None  # None: minus the highest


def _path_size(source: ObservationSource) -> int:
    return source.per_point * source.points


def _path_bound(source: ObservationSource) -> ArrayLike:
    each = [PATH_REACH, PATH_REACH, 1.0, 1.0][: source.per_point]
    return np.tile(np.array(each, np.float32), source.points)


def _clearance_size(source: ObservationSource) -> int:
    if not source.settings.side_clearance:
        return 0
    return 2 + (len(fan_poses()) // 2 if source.uses_fan else 2 * source.points)


def _hides_guidance(source: ObservationSource) -> bool:
    s = source.settings
    return s.privileged and s.hide_guidance and source.points > 0


_TRACK_MAX = np.array([1.0, TRACK_REACH, TRACK_REACH, TRACK_SPEED, TRACK_SPEED])
_TRACK_MIN = -_TRACK_MAX * [0.0, 1.0, 1.0, 1.0, 1.0]
_POSES, _CLEARANCE = (0.5, 0.5, 1.0, 1.0), (4.0,)  # of x, y [m], cosine, sine; of a clearance [m]

OBSERVATION_KEYS = (
    ObservationKey(
        "laser",
        lambda o: len(o.beam_reaches),
        lambda o: o.beam_reaches,
        "(beams,) | 0 to 10 m | right to left; no echo is 10 m; pooled by minimum if fewer; "
        "further scanners follow",
        low=lambda o: 0.0,
    ),
    ObservationKey(
        "ultrasonic",
        lambda o: len(o.reaches),
        lambda o: o.reaches,
        "(8,) | 0 to 4 or 6 m | latest range of each that is mounted",
        low=lambda o: 0.0,
    ),
    ObservationKey(
        "twist",
        lambda o: 2,
        lambda o: o.twist_max,
        "(2,) | 1.5 x the limits | speed [m/s] and turn [rad/s] by the encoders",
    ),
    ObservationKey(
        "goal",
        lambda o: 0 if o.has_driver else 5 if o.settings.heading else 3,
        lambda o: [GOAL_REACH, 1.0, 1.0, 1.0, 1.0][: 5 if o.settings.heading else 3],
        "(3,) | 0 to 100 m, -1 to 1 | distance, cosine and sine of its bearing; not with a driver",
        low=lambda o: [0.0, -1.0, -1.0, -1.0, -1.0][: 5 if o.settings.heading else 3],
    ),
    ObservationKey(
        "stick",
        lambda o: 1 + 2 * STICKS if o.has_driver else 0,
        lambda o: 1.0,
        "(11,) | -1 to 1 | with a driver only: deflections forward and to the left, now; whether "
        "they last by themselves (1 or 0); and those of earlier control periods, the latest first",
    ),
    ObservationKey(
        "action",
        lambda o: 2 if o.settings.last_action else 0,
        lambda o: 1.0,
        "(2,) | -1 to 1 | the last one; with `task.last_action`",
    ),
    ObservationKey(
        "shield",
        lambda o: 3 if o.settings.shield_state else 0,
        lambda o: [1.0, INTERVENTION_MAX, INTERVENTION_MAX],
        "(3,) | 0 to 1, -2 to 2 | with `task.shield_state`: see there",
        low=lambda o: [0.0, -INTERVENTION_MAX, -INTERVENTION_MAX],
    ),
    ObservationKey(
        "path",
        lambda o: 0 if o.settings.hide_guidance else _path_size(o),
        _path_bound,
        "(10,) | -10 to 10 m | guided only: x, y of points ahead, in the chair's frame",
        _POSES,
    ),
    ObservationKey(
        "side_clearance",
        _clearance_size,
        lambda o: CLEARANCE_MAX,
        "(30,) or (12,) | -0.31 to 0.5 m | with `task.side_clearance`: see there",
        _CLEARANCE,
        low=lambda o: -o.half_width,
    ),
    ObservationKey(
        "trail",
        lambda o: 2 * len(o.settings.trail),
        lambda o: PATH_REACH,
        "(2k,) | -10 to 10 m | with `task.trail`: x, y of where it was, in its frame",
        (0.5,),
    ),
    ObservationKey(
        "tracks",
        lambda o: TRACK_NUMBERS * o.settings.tracks,
        lambda o: np.tile(_TRACK_MAX, o.settings.tracks),
        "(5k,) | 0 or 1, -8 to 8 m, -3 to 3 m/s | with `task.tracks`, of each: 1 (0: there is "
        "none); x, y; velocity over ground along x and y",
        (1.0, 0.5, 0.5, 1.0, 1.0),
        low=lambda o: np.tile(_TRACK_MIN, o.settings.tracks),
    ),
    ObservationKey(
        "privileged",
        lambda o: 3 if o.settings.privileged else 0,
        lambda o: PRIVILEGED_MAX,
        "(3,) | 0 to 256 | with `task.privileged`: time to go, time left [s], way to go [m]",
        (1.0 / 15.0, 1.0 / 60.0, 1.0 / 10.0),
        True,
        low=lambda o: 0.0,
    ),
    ObservationKey(
        "privileged_path",
        lambda o: _path_size(o) if _hides_guidance(o) else 0,
        _path_bound,
        "as path | | with `task.privileged` and `task.hide_guidance`",
        _POSES,
        True,
    ),
    ObservationKey(
        "privileged_side_clearance",
        lambda o: 2 + 2 * o.points if _hides_guidance(o) and o.settings.side_clearance else 0,
        lambda o: CLEARANCE_MAX,
        "as side_clearance | | likewise",
        _CLEARANCE,
        True,
        low=lambda o: -o.half_width,
    ),
)
PRIVILEGED = tuple(key.name for key in OBSERVATION_KEYS if key.privileged)
SCALES = {key.name: list(key.scale) for key in OBSERVATION_KEYS if key.scale != (1.0,)}
# How the beams of one scanner are pooled: beams of it, numbers of the observation, reach [m].
POOL = np.dtype([("beams", "i8"), ("observed", "i8"), ("reach", "f8")])
pools_at = rows_of(POOL)
SIZES = np.dtype([(key.name, "i8") for key in OBSERVATION_KEYS])


def factors(source: ObservationSource) -> Floats:
    """Return the factor of each number of a flat observation with `task.scaled`, (size,)."""
    parts = [np.empty(0, np.float32)]
    for key in OBSERVATION_KEYS:
        each = key.scale[: source.per_point] if key.name.endswith("path") else key.scale
        part = np.resize(np.array(each, np.float32), key.size(source))
        if key.name in ("laser", "ultrasonic", "goal"):
            part[: 1 if key.name == "goal" else None] = FAR_FACTOR
        parts.append(part)
    return np.concatenate(parts)


def spaces(source: ObservationSource) -> dict[str, Any]:
    """Return the space of each key that is present, in the order of `OBSERVATION_KEYS`."""
    found = {}
    by = factors(source) if source.settings.scaled else np.ones(len(factors(source)), np.float32)
    where = places((key.name, key.size(source)) for key in OBSERVATION_KEYS)
    for key in OBSERVATION_KEYS:
        each = by[where[key.name]]
        if len(each):
            high = np.broadcast_to(np.asarray(key.high(source), np.float32), each.shape)
            low = -high if key.low is None else np.asarray(key.low(source), np.float32)
            found[key.name] = gym.spaces.Box(np.broadcast_to(low, each.shape) * each, high * each)
    return found


def places(sizes: Iterable[tuple[str, int]]) -> dict[str, slice]:
    """Return the slice of each key in a flat observation, given how many numbers each has."""
    found, begin = {}, 0
    for key, size in sizes:
        found[key] = slice(begin, begin + size)
        begin += size
    return found


def observation_table() -> str:
    """All keys as a table in Markdown."""
    rows = (f"| {key.name} | {key.meaning} |" for key in OBSERVATION_KEYS if not key.privileged)
    return "\n    ".join(["| key | shape | range | meaning |", "| --- | --- | --- | --- |", *rows])


@kernel
def observed_range(value: float, reach: float) -> float:
    """A range as it is observed: no echo is the reach, too near and invalid are 0 (REP-117)."""
    if not value > 0.0:  # NaN too
        return 0.0
    return reach if value > reach else value


@borrowing_kernel
def pool_beams(scan: Floats, reach: float, out: Floats) -> int:
    """Nearest range of each of out's equal groups of beams; returns how many beams are finite."""
    beams, groups = np.uint64(scan.shape[0]), np.uint64(out.shape[0])
    far, none = np.float32(reach), np.float32(np.inf)
    valid = np.uint32(0)  # 32 bits at every step, as wide as a range, so that the loops vectorise
    if groups == beams:
        for i in range(beams):
            value = scan[i]
            valid = np.uint32(valid + np.uint32(abs(value) < none))
            value = value if value > _ZERO else _ZERO  # as `observed_range`, but without a branch
            out[i] = value if value < far else far
        return int(valid)
    for i in range(beams):
        valid = np.uint32(valid + np.uint32(abs(scan[i]) < none))
    # Group j ends before floor((j + 1) beams / groups), counted on without a division each.
    size, rest, over, start = beams // groups, beams % groups, np.uint64(0), np.uint64(0)
    for j in range(groups):
        over += rest
        more = np.uint64(over >= groups)
        over -= more * groups
        stop = start + size + more
        # The last beam, then `size` from the first on: one loop length, whatever the group's size.
        last = scan[stop - np.uint64(1)]
        nearest = last if last > _ZERO else _ZERO
        nearest = nearest if nearest < far else far
        for i in range(start, start + size):
            value = scan[i] if scan[i] > _ZERO else _ZERO
            nearest = value if value < nearest else nearest
        out[j], start = nearest, stop
    return int(valid)


@kernel
def write_goal(pose: Array, goal: Array, out: Floats) -> None:
    """The goal (3,) in the chair's frame: distance [m], cosine and sine of its bearing.

    If `out` has five places, cosine and sine of the goal's heading follow.
    """
    dx, dy = goal[0] - pose[0], goal[1] - pose[1]
    distance = math.hypot(dx, dy)
    bearing = math.atan2(dy, dx) - pose[2] if distance > 0.0 else 0.0
    out[0] = np.float32(min(distance, GOAL_REACH))
    out[1], out[2] = np.float32(math.cos(bearing)), np.float32(math.sin(bearing))
    if out.shape[0] == 5:
        turn = goal[2] - pose[2]
        out[3], out[4] = np.float32(math.cos(turn)), np.float32(math.sin(turn))


@borrowing_kernel
def take_stick(progress: Any, forward: float, left: float, latched: bool, arrived: bool) -> None:
    """Take a person's latest signal, and whether it is at its goal; signals move back by one."""
    for k in range(STICKS - 1, 0, -1):
        for j in range(2):
            progress.sticks[k, j] = progress.sticks[k - 1, j]
    progress.sticks[0, 0], progress.sticks[0, 1] = forward, left
    progress.latched, progress.person_arrived = latched, arrived


@borrowing_kernel
def write_sticks(progress: Any, out: Floats) -> None:
    """The latest signal, whether it is latched, and those before (3 + 2 k,)."""
    out[0], out[1] = progress.sticks[0, 0], progress.sticks[0, 1]
    out[2] = 1.0 if progress.latched else 0.0
    for k in range(1, (out.shape[0] - 1) // 2):
        for j in range(2):
            out[1 + 2 * k + j] = progress.sticks[k, j]


@kernel
def write_local_point(c: float, s: float, dx: float, dy: float, out: Floats) -> None:
    """A place (dx, dy) off [m], in the frame of a chair with that cosine and sine of its yaw."""
    ahead, aside = world_to_body(c, s, dx, dy)
    out[0] = np.float32(min(PATH_REACH, max(-PATH_REACH, ahead)))
    out[1] = np.float32(min(PATH_REACH, max(-PATH_REACH, aside)))


@kernel
def write_path_ahead(path: Array, pose: Array, distances: Array, out: Floats) -> None:
    """Points (k, 2) [m] of a path (n, 2) at distances (k,) [m] ahead, in the chair's frame."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    segment, share, _ = project(path, pose[0], pose[1])
    last = path.shape[0] - 2
    walked = 0.0  # m from the nearest point to the end of the segments passed
    for j in range(distances.shape[0]):
        while True:
            ex = path[segment + 1, 0] - path[segment, 0]
            ey = path[segment + 1, 1] - path[segment, 1]
            length = math.hypot(ex, ey)
            rest = (1.0 - share) * length
            if walked + rest >= distances[j] or segment == last:
                break
            walked, segment, share = walked + rest, segment + 1, 0.0
        t = min(1.0, share + (distances[j] - walked) / length) if length > 0.0 else 1.0
        dx = path[segment, 0] + t * ex - pose[0]
        dy = path[segment, 1] + t * ey - pose[1]
        write_local_point(c, s, dx, dy, out[2 * j : 2 * j + 2])


@borrowing_kernel
def write_poses_ahead(prepared: Any, pose: Array, times: Array, out: Floats) -> None:
    """Poses (4 k,) at plan times (k,) [s] ahead of a pose (3,), in the chair's frame.

    Of each pose: x and y [m], cosine and sine of the heading. Where no way is known they lie on the
    straight line to the goal, as if driven at `STRAIGHT`.
    """
    goal = prepared.goal
    rows, cols, headings = prepared.state_rows, prepared.state_cols, prepared.n_headings
    states = states_at(prepared.packed_states, rows, cols, headings)
    moves = moves_at(prepared.moves, prepared.n_moves, headings, 3)
    x, y, yaw = to_local(prepared.state_origin, pose[0], pose[1], pose[2])
    c, s = math.cos(yaw), math.sin(yaw)
    left = poses_ahead(states, moves, prepared.state_cell, x, y, yaw, times, out)
    if math.isnan(left):
        c, s = math.cos(pose[2]), math.sin(pose[2])
        dx, dy = goal[0] - pose[0], goal[1] - pose[1]
        far = max(math.hypot(dx, dy), 1e-9)
    for j in range(times.shape[0] - 1, -1, -1):
        heading = out[4 * j + 2] - yaw
        ex, ey = out[4 * j] - x, out[4 * j + 1] - y
        if math.isnan(left):
            share = min(1.0, STRAIGHT * times[j] / far)
            ex, ey = share * dx, share * dy
            heading = math.atan2(dy, dx) - pose[2]
        write_local_point(c, s, ex, ey, out[4 * j : 4 * j + 2])
        out[4 * j + 2] = np.float32(math.cos(heading))
        out[4 * j + 3] = np.float32(math.sin(heading))


@borrowing_kernel
def reset_trail(progress: Any, pose: Array) -> None:
    """Begin a trail, in a record of PROGRESS, at a pose (3,) [m, m, rad]."""
    progress.n_trail = 1
    progress.trail_points[0, 0], progress.trail_points[0, 1] = pose[0], pose[1]


@borrowing_kernel
def extend_trail(progress: Any, pose: Array) -> None:
    """Add points from the last one towards a pose (3,); the oldest are lost.

    Straight distance counts, not the way driven: a pose that trembles adds no point.
    """
    for _ in range(TRAIL_POINTS):  # however far a pose jumps, and if it is no number
        last, at = (progress.n_trail - 1) % TRAIL_POINTS, progress.n_trail % TRAIL_POINTS
        dx, dy = pose[0] - progress.trail_points[last, 0], pose[1] - progress.trail_points[last, 1]
        share = TRAIL_SPACING / max(math.hypot(dx, dy), 1e-9)
        if not share <= 1.0:
            break
        progress.trail_points[at, 0] = progress.trail_points[last, 0] + share * dx
        progress.trail_points[at, 1] = progress.trail_points[last, 1] + share * dy
        progress.n_trail += 1


@borrowing_kernel
def write_trail(progress: Any, pose: Array, distances: Array, out: Floats) -> None:
    """Write the chair's places some metres (k,) ago: x and y in its frame now, (2 k,) [m]."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for k in range(distances.shape[0]):
        at = max(progress.n_trail - 1 - round(distances[k] / TRAIL_SPACING), 0) % TRAIL_POINTS
        dx, dy = progress.trail_points[at, 0] - pose[0], progress.trail_points[at, 1] - pose[1]
        write_local_point(c, s, dx, dy, out[2 * k : 2 * k + 2])


@borrowing_kernel
def write_tracks(state: Any, out: Floats) -> None:
    """The confirmed tracks (5 k,) of a record of TRACKER, the nearest first; zeros after the last.

    Of each: 1, place [m] and velocity over ground [m/s], both along x and y of the chair.
    """
    pose = state.pose
    c, s = math.cos(pose[2]), math.sin(pose[2])
    before = -1.0  # m: how far the track is that was written last
    for at in range(0, out.shape[0], TRACK_NUMBERS):
        nearest, best = TRACK_REACH, -1
        for k in range(state.n_tracks):
            t = state.tracks[k]
            far = math.hypot(t.x - pose[0], t.y - pose[1])
            if t.confirmed and before < far <= nearest:
                nearest, best = far, k
        for j in range(TRACK_NUMBERS):
            out[at + j] = 0.0
        if best < 0:
            continue
        t, before = state.tracks[best], nearest
        out[at] = 1.0
        out[at + 1], out[at + 2] = world_to_body(c, s, t.x - pose[0], t.y - pose[1])
        along, across = world_to_body(c, s, t.vx, t.vy)
        out[at + 3] = min(TRACK_SPEED, max(-TRACK_SPEED, along))
        out[at + 4] = min(TRACK_SPEED, max(-TRACK_SPEED, across))


@borrowing_kernel
def write_guidance(rules: Any, prepared: Any, pose: Array, out: Floats) -> None:
    """Points or poses of the guidance ahead of a pose (3,)."""
    ahead = doubles_at(rules.ahead, rules.points)
    if rules.has_poses:
        write_poses_ahead(prepared, pose, ahead, out)
    else:
        write_path_ahead(table_at(prepared.path, prepared.n_path_points, 2), pose, ahead, out)


@borrowing_kernel
def write_side_clearance(rules: Any, laser: Floats, poses: Floats, out: Floats) -> None:
    """Side clearances where the chair is and at poses (4 k,) ahead, by the first scanner."""
    directions, scan = table_at(rules.directions, rules.laser_beams, 2), laser[: rules.laser_beams]
    side_clearance(scan, directions, rules.mount[:], rules.outline[:], poses, out)


@inlined
def _part(out: Floats, begin: int, size: int) -> Floats:
    """Return the numbers of one key."""
    return out[begin : begin + size]


@borrowing_kernel
def observe(
    rules: Any,
    prepared: Any,
    progress: Any,
    row: int,
    trackers: Any,
    seen: Any,
    laser: Floats,
    out: Floats,
) -> int:
    """Write what a policy observes of a reading; return the number of finite beams.

    The reading is a record of SENSED and its scans. The tracks are those of a row of trackers, a
    record (1,) of TRACKERS.
    """
    size, place, pose, twist = rules.size, rules.place, seen.pose[:], seen.twist[:]
    at, valid, first = place.laser, 0, 0
    pools = pools_at(rules.pools, rules.scanners)
    for k in range(rules.scanners):
        beams, observed = pools[k].beams, pools[k].observed
        scan, pooled = laser[first : first + beams], out[at : at + observed]
        valid += pool_beams(scan, pools[k].reach, pooled)
        first, at = first + beams, at + observed
    reaches = doubles_at(rules.reaches, size.ultrasonic)
    for i in range(size.ultrasonic):
        out[place.ultrasonic + i] = observed_range(seen.ultrasonic[i], reaches[i])
    for i in range(2):
        maximum = rules.twist_max[i]
        out[place.twist + i] = min(maximum, max(-maximum, twist[i]))
    if size.goal > 0:
        write_goal(pose, prepared.goal, _part(out, place.goal, size.goal))
    if size.stick > 0:
        write_sticks(progress, _part(out, place.stick, size.stick))
    if size.action > 0:
        out[place.action], out[place.action + 1] = progress.action[0], progress.action[1]
    if size.shield > 0:
        out[place.shield] = 1.0 if progress.is_shielded else 0.0
        for i in range(2):
            change = progress.shield_share[i]
            out[place.shield + 1 + i] = min(INTERVENTION_MAX, max(-INTERVENTION_MAX, change))
    path = _part(out, place.path, size.path)
    if size.path > 0:
        write_guidance(rules, prepared, pose, path)
    if size.side_clearance > 0:
        poses = path
        if rules.uses_fan:
            poses = floats_at(rules.fan_poses, 2 * size.side_clearance - 4)
        sides = _part(out, place.side_clearance, size.side_clearance)
        write_side_clearance(rules, laser, poses, sides)
    if size.trail > 0:
        back = doubles_at(rules.back, size.trail // 2)
        write_trail(progress, pose, back, _part(out, place.trail, size.trail))
    if size.tracks > 0:
        write_tracks(tracker_row(row, trackers)[1], _part(out, place.tracks, size.tracks))
    if size.privileged > 0:
        seconds, at = seconds_to_go(prepared, pose[0], pose[1], pose[2]), place.privileged
        known = seconds >= 0.0  # NaN: not known
        out[at] = min(seconds, PRIVILEGED_MAX) if known else PRIVILEGED_MAX
        out[at + 1] = min(max(0.0, progress.steps_left * rules.period), PRIVILEGED_MAX)
        out[at + 2] = min(geodesic_to_go(prepared, pose[0], pose[1]), PRIVILEGED_MAX)
    if size.privileged_path > 0:
        hidden = _part(out, place.privileged_path, size.privileged_path)
        write_guidance(rules, prepared, pose, hidden)
        if size.privileged_side_clearance > 0:
            sides = _part(out, place.privileged_side_clearance, size.privileged_side_clearance)
            write_side_clearance(rules, laser, hidden, sides)
    if rules.scaled:
        by = floats_at(rules.factors, out.shape[0])
        for i in range(out.shape[0]):
            out[i] *= by[i]
    return valid


check_written("observation key", [key.name for key in OBSERVATION_KEYS], observe)

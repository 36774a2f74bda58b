"""Accuracy and run time of the tracker: `python -m tests.benchmarks.tracking`.

Scenes in simulation, with their truth and all noise; then a walker who starts, turns and stops at
once, as a body and as two legs; then the time of a reading. Only what is confirmed and in sight
counts. Places and speeds are compared in the chair's own frame, so that an error of its pose
counts once only, in the tracker. Each row prints its seeds.
"""

import argparse
import itertools
import math
import platform
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from tests.conftest import SHARED
from tests.sim.worlds import box, step
from wheelchair_gym.actors.records import DOOR, NOBODY, PERSON, person
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.geometry.planar import to_frame, to_world, wrap_angle
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.perception.logs import LASER, read_log
from wheelchair_gym.perception.track_state import PERSON as TRACKED_PERSON
from wheelchair_gym.perception.track_state import TRACKER, TrackerConstants
from wheelchair_gym.perception.tracker import Tracker, point_to_trackers, update_tracker
from wheelchair_gym.safety import Shield
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.scenes.crowd import Crowd
from wheelchair_gym.scenes.pedestrians import PeopleSettings
from wheelchair_gym.sensors.laser import WORKSPACE_ROWS, LaserArrays, sense_laser
from wheelchair_gym.sensors.settings import LaserSettings, SensorSettings
from wheelchair_gym.sim.chair import SimulatedChair
from wheelchair_gym.types import Episode, Reading

SPEEDS, RANGES = (0.3, 0.75, 1.25, 2.5), (0.0, 2.5, 5.0, 8.0)  # edges of bins: m/s, m
VISIBLE = 0.5  # share of a person's beams that must reach them
MOVES = 0.2  # m/s
ABREAST = 0.8  # m between people of a group (Moussaid et al. 2010)
HIDDEN = 1.5  # s: a person hidden for no longer should be recognised again
STILL = np.zeros(2)
NEAR = 0.6  # m: a track so near a person's centre is theirs


class Wander:
    """Drives on in curves, and turns in place for a while where the shield holds the chair."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng((seed, 1))
        self._until, self._turn = -1.0, 0.5

    def twist(self, reading: Reading, held: bool) -> Array:
        if reading.stamp < self._until:
            return np.array([0.0, self._turn])
        if held and abs(reading.twist[0]) < 0.05:
            self._turn = float(self._rng.choice((-0.6, 0.6)))
            self._until = reading.stamp + float(self._rng.uniform(1.0, 4.0))
        return np.array([0.8, 0.4 * math.sin(0.9 * reading.stamp)])


def wandered(
    episode: Episode, seed: int, periods: int, sensors: SensorSettings, period: float = 0.1,
    moves: bool = True,
) -> Iterator[tuple[SimulatedChair, Reading]]:  # fmt: skip
    """Yield a chair and its readings while it wanders behind its shield, or stands."""
    chair = SimulatedChair(sensors=sensors, period=period)
    shield, wander = Shield(sensors=sensors, period=period), Wander(seed)
    reading = chair.reset(episode, seed)
    for _ in range(periods):
        yield chair, reading
        held = shield.decision.reason != ""
        reading = step(chair, shield, wander.twist(reading, held) if moves else STILL, reading)


def shares_seen(episode: Episode, poses: Array, origin: Array, scan: Array, laser: Any) -> Array:
    """Return the share of beams towards each person that reach them; 0 out of view."""
    shares = np.zeros(len(poses))
    for k, (row, pose) in enumerate(zip(episode.actors.rows, poses, strict=True)):
        if row["kind"] != PERSON:
            continue
        x, y = to_frame(pose[:2], origin)
        far, radius = math.hypot(x, y), row["size"][0]
        off = wrap_angle(laser.angles - math.atan2(y, x))
        towards = np.abs(off) < math.asin(min(1.0, radius / far))
        full = 2 * math.asin(min(1.0, radius / far)) * (laser.beams - 1) / laser.fov
        hit = towards & (np.abs(scan - far) < radius + 0.1)
        shares[k] = hit.sum() / max(full, 1.0)
    return shares


class Score:
    """Counts and errors of one row of the table."""

    def __init__(self) -> None:
        self.errors: list[tuple[float, float, float, float]] = []  # speed, range, place, velocity
        self.confirmed_after: list[float] = []
        self.never = 0
        self.lost = self.switched = self.false = 0
        self.seen_time = self.time = 0.0
        self.passages = self.kept = 0
        self.inside: list[bool] = []  # the error of a speed is within 2 standard deviations
        self.people_right: list[bool] = []  # a person's track is called a person
        self.doors_right: list[bool] = []  # a track on a leaf is not called a person

    def row(self) -> str:
        e, nobody = np.array(self.errors).reshape(-1, 4), [math.nan]
        after = self.confirmed_after or nobody
        fast = np.quantile(e[:, 3], 0.95) if len(e) else math.nan
        seen, whole = self.seen_time / 60.0, self.time / 60.0
        lost, switched = (count / max(seen, 1e-9) for count in (self.lost, self.switched))
        return (
            f"{rms(e[:, 2]):5.3f}  {rms(e[:, 3]):5.2f} {fast:5.2f}  "
            f"{np.median(after):6.2f} {np.quantile(after, 0.9):6.2f}   {self.never:5d}  "
            f"{lost:5.2f}  {switched:6.2f}  {self.false / max(whole, 1e-9):6.2f}"
            f"   {self.kept:5d}/{self.passages:<5d}"
            f"   {np.mean(self.inside or nobody):4.2f}  {np.mean(self.people_right or nobody):4.2f}"
            f"  {np.mean(self.doors_right or nobody):4.2f}  {seen:6.1f} {whole:6.1f}"
        )

    def bins(self) -> list[tuple[str, str, int, float, float]]:
        e, out = np.array(self.errors).reshape(-1, 4), []
        for v0, v1 in itertools.pairwise(SPEEDS):
            for r0, r1 in itertools.pairwise(RANGES):
                some = e[(e[:, 0] >= v0) & (e[:, 0] < v1) & (e[:, 1] >= r0) & (e[:, 1] < r1)]
                names = f"{v0:g} to {v1:g}", f"{r0:g} to {r1:g}"
                out.append((*names, len(some), rms(some[:, 2]), rms(some[:, 3])))
        return out


def rms(values: Array) -> float:
    """Root of the mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else math.nan


def watch(
    score: Score, episode: Episode, seed: int, seconds: float, *, moves: bool, period: float,
    sensors: SensorSettings, static_map: OccupancyGrid | None,
) -> None:  # fmt: skip
    tracker, laser = Tracker(sensors.laser), sensors.laser
    kinds = episode.actors.rows["kind"]
    log: list[tuple[Any, ...]] = []
    drive = wandered(episode, seed, round(seconds / period), sensors, period, moves)
    for chair, reading in drive:
        tracks = tracker.update(
            reading.laser[: laser.beams], reading.pose, reading.twist, reading.stamp, static_map
        )
        truth = chair.truth
        place = to_world(to_frame(tracks.place, reading.pose), truth.pose)
        turn = truth.pose[2] - reading.pose[2]
        velocity = to_world(tracks.velocity, (0.0, 0.0, turn))
        origin = np.array([*to_world(np.array([laser.x, laser.y]), truth.pose), truth.pose[2]])
        seen = shares_seen(episode, truth.actor_poses, origin, reading.laser, laser)
        log.append((reading.stamp, tracks, place, velocity, truth.actor_poses, origin, seen))
    score_log(score, log, kinds, episode, period)


def score_log(
    score: Score, log: list[tuple[Any, ...]], kinds: Any, episode: Episode, period: float
) -> None:
    """Compare what was tracked with the truth."""
    poses = np.array([row[4] for row in log])  # (steps, k, 3)
    speeds = np.zeros((*poses.shape[:2], 2))
    speeds[1:-1] = (poses[2:, :, :2] - poses[:-2, :, :2]) / (2 * period)
    n = len(kinds)
    people = [k for k in range(n) if kinds[k] == PERSON]
    mine: list[int | None] = [None] * n  # the track that is theirs
    waiting: list[float | None] = [None] * n  # since when they move and are visible
    hidden: list[float | None] = [None] * n  # since when they are not
    taken: set[int] = set()  # false tracks that were counted
    score.time += period * len(log)
    for j in range(1, len(log) - 1):
        stamp, tracks, place, velocity, at, origin, seen = log[j]
        shown = tracks.confirmed & (tracks.unseen == 0.0)
        for k in people:
            speed = float(np.hypot(*speeds[j, k]))
            far = float(np.hypot(*(at[k, :2] - origin[:2])))
            if seen[k] < VISIBLE or far > 8.0:
                waiting[k], since = None, hidden[k]
                hidden[k] = stamp if since is None else since
                continue
            since, hidden[k] = hidden[k], None
            gaps = np.hypot(*(place - at[k, :2]).T)
            ids = {int(tracks.id[i]): i for i in np.flatnonzero(tracks.confirmed & (gaps < NEAR))}
            score.seen_time += period
            if mine[k] is not None and since is not None:
                if stamp - since <= HIDDEN:
                    score.passages += 1
                    score.kept += mine[k] in ids
                mine[k] = mine[k] if mine[k] in ids else None
            if mine[k] is not None and mine[k] not in ids:
                mine[k] = None
                score.lost += not ids
                score.switched += bool(ids)
            if mine[k] is None and ids:
                best = min(ids, key=lambda number: gaps[ids[number]])
                mine[k] = best
                if waiting[k] is not None:
                    score.confirmed_after.append(stamp - waiting[k])
            if mine[k] is None and speed > MOVES and waiting[k] is None:
                waiting[k] = stamp
            if mine[k] is not None:
                i = ids[mine[k]]
                if shown[i]:
                    off = float(np.hypot(*(velocity[i] - speeds[j, k])))
                    score.errors.append((speed, far, float(gaps[i]), off))
                    score.inside.append(off < 2.0 * math.sqrt(tracks.covariance[i, 1, 1]))
                    score.people_right.append(tracks.kind[i] == TRACKED_PERSON)
        for i in np.flatnonzero(shown):
            number = int(tracks.id[i])
            if _on_leaf(episode, at, place[i]):
                score.doors_right.append(tracks.kind[i] != TRACKED_PERSON)
            if number in taken or _explained(episode, at, place[i]):
                continue
            taken.add(number)
            score.false += 1
    score.never += sum(
        waiting[k] is not None and mine[k] is None and log[-1][0] - waiting[k] > 2.0 for k in people
    )


def _on_leaf(episode: Episode, poses: Array, place: Array) -> bool:
    """Return True if a track is on a leaf, with no person beside it."""
    found = False
    for row, (x, y, yaw) in zip(episode.actors.rows, poses, strict=True):
        if row["kind"] == DOOR:
            half = 0.5 * row["size"][0]
            ahead, left = to_frame(place, (x, y, yaw))
            found = found or (abs(ahead - half) < half + 0.1 and abs(left) < 0.15)
        elif math.hypot(place[0] - x, place[1] - y) < NEAR:
            return False
    return found


def _explained(episode: Episode, poses: Array, place: Array) -> bool:
    """Return True if a movable object is at a track's place."""
    for row, (x, y, yaw) in zip(episode.actors.rows, poses, strict=True):
        if not math.isfinite(x):
            continue
        reach = NEAR
        if row["kind"] == DOOR:
            half = 0.5 * row["size"][0]
            x, y, reach = x + half * math.cos(yaw), y + half * math.sin(yaw), half + 0.3
        if math.hypot(place[0] - x, place[1] - y) < reach:
            return True
    return False


def walkers(speed: float, crosses: bool, count: int = 1) -> Callable[[int], Episode]:
    """People abreast who walk up and down in a hall with columns, across the view or along it."""

    def make(seed: int) -> Episode:
        rng = np.random.default_rng((seed, 2))
        places = rng.uniform(-7.5, 7.5, (40, 2))
        discs = [(x, y, rng.uniform(0.05, 0.25)) for x, y in places if abs(y) > 5.5]
        x = rng.uniform(-3.0, 3.0)
        people = []
        for aside in ABREAST * np.arange(count):
            across = [(x + aside, -4.8), (x + aside, 4.8)]
            along = [(-4.5, 0.3 + aside), (6.5, 0.3 + aside)]
            people.append(person(across if crosses else along, speed, avoids=NOBODY))
        return box(8.0, (-6.5, 0.0, 0.0), discs=discs, actors=people)

    return make


def scene(name: Any) -> Callable[[int], Episode]:
    made = make_scene(name)
    return lambda seed: made.sample(np.random.default_rng((seed, 0)))


HALL = Crowd(place="hall")
GROUPS = Crowd(place="hall", people=PeopleSettings(density=(0.10, 0.15)))
BUILDING = Crowd(place="building")
# Name, worlds, how many seeds, seconds of each, whether the chair drives, rate, beams, pose, map.
Row = tuple[str, Callable[[int], Episode], int, float, bool, float, int, str, bool]


def rows() -> Iterator[Row]:
    """Yield the measured rows."""
    stands = (4, 20.0, False, 10.0, 1081, "odometry", False)
    for speed in (0.5, 1.0, 1.5):
        yield f"one across, {speed:g} m/s", walkers(speed, True), *stands
        yield f"one along, {speed:g} m/s", walkers(speed, False), *stands
    yield "three abreast, across, 1 m/s", walkers(1.0, True, 3), *stands
    yield "three abreast, along, 1 m/s", walkers(1.0, False, 3), *stands
    for moving in (False, True):
        word = "drives" if moving else "stands"
        yield f"hall, {word}", scene(HALL), 8, 30.0, moving, 10.0, 1081, "odometry", False
        crowd = (scene(GROUPS), 8, 30.0, moving, 10.0, 1081, "odometry", False)
        yield f"dense hall, {word}", *crowd
        doors = (scene(BUILDING), 8, 30.0, moving, 10.0, 1081)
        yield f"building with doors, {word}", *doors, "odometry", False
        yield f"the same with map, {word}", *doors, "modelled", True
    yield "hall, drives, 50 Hz", scene(HALL), 4, 30.0, True, 50.0, 1081, "odometry", False
    yield "hall, drives, 181 beams", scene(HALL), 8, 30.0, True, 10.0, 181, "odometry", False
    yield "hall, drives, 64 beams", scene(HALL), 8, 30.0, True, 10.0, 64, "odometry", False
    for name in ("floor_plan", "clutter", "barn"):
        one = (12, 30.0, True, 10.0, 1081, "odometry", False)
        yield f"{name}, nobody, drives", scene(name), *one


def measure_rows(only: str) -> None:
    """Every row of the table, as it becomes known."""
    print(
        "RMS of place [m] and velocity [m/s]; confirmed after [s], median and 90 %; never so;"
        "\nlost, switched and false a minute; known again of those hidden for 1.5 s at most;"
        "\nshares: velocity within 2 sigma, people called so, leaves not called people\n"
    )
    names = "place velocity, 95 % confirmed after never lost switched false known sigma person"
    print(f"{'':33}{names} leaf minutes: people, all")
    whole = Score()
    for name, make, n, seconds, moves, rate, beams, pose, mapped in rows():
        if only and only not in name:
            continue
        sensors: Any = SensorSettings(laser=LaserSettings(beams=beams), pose_source=pose)
        score = Score()
        for seed in range(n):
            episode = make(seed)
            watch(
                score, episode, seed, seconds, moves=moves, period=1.0 / rate, sensors=sensors,
                static_map=episode.map if mapped else None,
            )  # fmt: skip
        whole.errors += score.errors if beams == 1081 and rate == 10.0 else []
        print(f"{name:34}{score.row()}   seeds 0 to {n - 1}, {pose}", flush=True)
    print("\nspeed [m/s]    range [m]      readings  place  speed: RMS of all rows at 10 Hz")
    for speed, far, count, place, velocity in whole.bins():
        print(f"{speed:14} {far:14} {count:8d}  {place:5.3f}  {velocity:5.2f}")


def two_legs(way: float, along: Array) -> Array:
    """Discs (2, 3): in steps of 0.7 m one swings at twice the speed while the other stands."""
    phase = way / 0.7
    foot, share = math.floor(phase), phase - math.floor(phase)
    swing, stand = 0.7 * (foot - 0.5 + 2.0 * share), 0.7 * (foot + 0.5)
    left, right = (swing, stand) if foot % 2 else (stand, swing)
    aside = 0.1 * np.array([-along[1], along[0]])
    return np.array([(*(left * along + aside), 0.06), (*(right * along - aside), 0.06)])


def step_response(legs: bool, rate: float) -> dict[str, float]:
    """Delays of a tracker whose walker starts to 1.3 m/s, turns round and stops, each at once."""
    laser = LaserSettings()
    arrays = LaserArrays.of(laser, True)
    walls = box(6.0).walls
    workspace, scan = np.empty((WORKSPACE_ROWS, 16), np.float32), np.empty(1081, np.float32)
    chair = np.array([-4.0, 0.0, 0.0])
    speeds, delays, first = [], {name: [] for name in ("start", "turn", "stop")}, []
    errors, switched = [], 0
    for seed in range(8):
        tracker = Tracker(laser)
        heading = np.random.default_rng((seed, 3)).uniform(0.0, math.pi)
        along = np.array([math.cos(heading), math.sin(heading)])
        steps, number = round(9.0 * rate), None
        values = []
        way = -1.3
        for k in range(steps):
            t = k / rate
            v = 0.0 if t < 2.0 or t >= 6.0 else (1.3 if t < 4.0 else -1.3)
            way += v / rate
            centre = way * along
            discs = two_legs(way, along) if legs else np.array([(*centre, 0.25)])
            sense_laser(arrays, chair, walls, discs, np.uint64(seed), k, workspace, scan)
            tracks = tracker.update(scan, chair, np.zeros(2), t)
            gaps = np.hypot(*(tracks.place - centre).T)
            some = [i for i in np.flatnonzero(tracks.confirmed) if gaps[i] < NEAR]
            i = min(some, key=lambda j: gaps[j]) if some else None
            if i is not None:
                switched += number is not None and int(tracks.id[i]) != number
                number = int(tracks.id[i])
                errors.append(float(gaps[i]))
                if not first or len(first) <= seed:
                    first.append(t - 2.0)
            estimate = math.nan if i is None else float(tracks.velocity[i] @ along)
            values.append((t, estimate))
            if i is not None and t - (2.0, 4.0, 6.0)[(t >= 4.0) + (t >= 6.0)] > 1.0:
                speeds.append(float(np.hypot(*(tracks.velocity[i] - v * along))))
        changes = (("start", 2.0, 1.17), ("turn", 4.0, -1.04), ("stop", 6.0, -0.13))
        for name, since, level in changes:
            sign = -1.0 if name == "turn" else 1.0
            then = [t - since for t, e in values if t >= since and sign * e > sign * level]
            delays[name].append(min(then, default=math.inf))
    return {
        "confirmed_after": float(np.median(first)),
        **{f"{name}_90": float(np.median(values)) for name, values in delays.items()},
        "velocity_rms": rms(np.array(speeds)),
        "place_rms": rms(np.array(errors)),
        "switched": switched,
    }


def measure_log() -> dict[str, float]:
    """Count confirmed tracks in a log of a real robot among tables, with no known walkers."""
    log = read_log(SHARED / "logs" / "mines_exp1.dat")
    tracker, confirmed = Tracker(LASER), set()
    periods = np.diff(log.stamps, prepend=log.stamps[0] - 0.1)
    rows = zip(log.stamps, periods, log.increments, log.ranges, strict=True)
    for stamp, period, moved, ranges in rows:
        tracks = tracker.update(ranges, np.full(3, np.nan), moved[[0, 2]] / period, stamp)
        confirmed |= set(tracks.id[tracks.confirmed].tolist())
    way = float(np.hypot(*log.increments[:, :2].T).sum())
    return {"seconds": float(log.stamps[-1]), "metres": way, "confirmed": len(confirmed)}


def measure_cost() -> dict[str, float]:
    """Microseconds of a reading in a dense hall, chair driving: the smallest of several runs."""
    out = {}
    for beams in (1081, 181, 64):
        sensors: Any = SensorSettings(laser=LaserSettings(beams=beams), pose_source="odometry")
        readings = [reading for _, reading in wandered(scene(GROUPS)(0), 0, 200, sensors)]
        times = []
        for _ in range(7):
            state = np.zeros(1, TRACKER)
            constants = TrackerConstants(sensors.laser)
            trackers = point_to_trackers(constants, state, [None])
            own = []
            for r in readings:
                begun = time.perf_counter()
                update_tracker(0, trackers.record, r.pose, r.twist, r.laser, r.stamp)
                own.append(time.perf_counter() - begun)
            times.append(own)
        best = 1e6 * np.min(times, axis=0)[50:]
        out[f"{beams} beams"] = {"median": float(np.median(best)), "most": float(best.max())}
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="rows whose name has this in it; - for none")
    given = parser.parse_args()
    print(f"{platform.machine()}, Python {platform.python_version()}\n")
    measure_rows(given.only)
    if given.only and given.only != "-":
        return
    print("\na walker who starts, turns round and stops at once, 1.3 m/s, seeds 0 to 7")
    for rate in (10.0, 40.0):
        for legs in (False, True):
            found = step_response(legs, rate)
            name = f"{'legs' if legs else 'body'}, {rate:g} Hz"
            print(name, {key: round(value, 3) for key, value in found.items()})
    if SHARED.is_dir():
        print(f"\nlog of a real robot, nobody known to walk: {measure_log()}")
    print("\nmicroseconds of a reading in a dense hall, call from Python included")
    for name, cost in measure_cost().items():
        print(name, {key: round(value, 1) for key, value in cost.items()})


if __name__ == "__main__":
    sys.exit(main())

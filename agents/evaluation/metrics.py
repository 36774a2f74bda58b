"""Figures of episodes and paths: one definition of each figure that a report shows.

SPL (Anderson et al. 2018) and SCT (Yokoyama et al. 2021) refer to the shortest path of an episode.
A chair turns in place about the centre of its axle, so that point keeps at least the footprint's
smallest distance, min(front, rear, half width), from all that stands still. The shortest path of a
disc of that radius to the goal's region is therefore no longer than any drive without a contact.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple, cast

import numpy as np
import shapely
from numpy.typing import ArrayLike

from agents.evaluation.assisted import MEASURES, PeopleTrace, StickTrace
from agents.evaluation.statistics import share
from agents.evaluation.tables import json_value
from agents.policies.planning import PlanningFigures
from planners.collision import solids
from planners.collision.polygon_tests import SpaceArrays, clearance
from planners.collision.space import Space
from planners.graphs.visibility import Visibility
from planners.problem import Problem
from planners.swarm import path_cost
from wheelchair_gym import task as tasks
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry.planar import path_length, without_repeats
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.types import Episode

SIDES = 16  # of each quarter of a polygon that stands for a circle: 0.12 % of the radius
MARGIN = 1e-6  # m: far above the rounding of shapely's buffers
OVERSPEED = 1.1  # times its limit: no chair is faster
MAX_WALLS = 50_000  # of a world: about 12 s


class Shortest(NamedTuple):
    """A lower bound of the driven length [m], and whether obstacles count in it."""

    length: float
    is_exact: bool  # False: the straight line to the goal's region


NO_SHORTEST = Shortest(math.nan, False)


def shortest_path(task: tasks.Task, episode: Episode, start: Array) -> Shortest:
    """Return the length of the shortest path from a start to the goal's region.

    Only walls and discs of the episode are obstacles: people, doors and temporary obstacles may
    move away, and a chair can drive through unknown cells and over an open border of the map. The
    region is a disc; a rectangle (`Arrival`) counts as the disc around it. The straight line stands
    in where a world is too large or its shapes leave no path.

    The driven length is that between recorded poses. A straight line between two of them may cut
    a corner that the chair drove around, so the clearance is smaller by that: 3 mm at 10 Hz.

    Args:
        task: of the environment: footprint, tolerance, limits and control period.
        episode: the world and its goal.
        start: (2 or 3,) true pose at which the drive began [m, m, rad].
    """
    outline, tolerance = task.footprint, task.tolerance
    radius = min(outline.front, outline.rear, outline.half_width)
    step = OVERSPEED * max(task.limits.forward, task.limits.backward) * task.period
    clearance = math.sqrt(max(0.0, radius * radius - 0.25 * step * step))
    if episode.arrival is not None:
        tolerance = math.hypot(episode.arrival.along, episode.arrival.across)
    world, goal = (episode.walls.tobytes(), episode.discs.tobytes()), episode.goal[:2]
    return _shortest(world, start[:2].tobytes(), goal.tobytes(), float(tolerance), clearance)


@lru_cache(8)
def _grown(world: tuple[bytes, bytes], clearance: float) -> Any:
    """Walls and discs grown by a clearance [m]; polygons that stand for arcs lie inside them."""
    walls, discs = np.frombuffer(world[0]).reshape(-1, 4), np.frombuffer(world[1]).reshape(-1, 3)
    reach = max(0.0, clearance - MARGIN)
    centres = shapely.points(discs[:, :2])
    circles = shapely.buffer(centres, discs[:, 2] + reach, quad_segs=SIDES)
    solid = shapely.buffer(solids.non_zero(walls), reach, quad_segs=SIDES)
    return shapely.union_all([solid, *circles])


@lru_cache(1000)
def _shortest(
    world: tuple[bytes, bytes], start: bytes, goal: bytes, tolerance: float, clearance: float
) -> Shortest:
    """`shortest_path` of arrays by their bytes: others drive the same world next."""
    a, b = np.frombuffer(start), np.frombuffer(goal)
    straight = max(0.0, math.hypot(*(b - a)) - tolerance)
    if straight == 0.0 or len(world[0]) > MAX_WALLS * 32:
        return Shortest(straight, straight == 0.0)
    try:
        # Obstacles inside the goal's region are removed. From where it enters the region, a path
        # to the goal itself then goes straight on, which adds exactly the region's radius.
        outer = tolerance / math.cos(math.pi / (4 * SIDES))  # a polygon around the region
        region = shapely.buffer(shapely.Point(b), outer, quad_segs=SIDES)
        solid = shapely.difference(_grown(world, clearance), region)
        xmin, ymin, xmax, ymax = shapely.union(solid, shapely.LineString([a, b])).bounds
        space = Space(solids.polygonal(solid), (xmin - 1.0, ymin - 1.0, xmax + 1.0, ymax + 1.0))
        found = Visibility().plan(Problem(space, a, b), np.random.default_rng(0)).length
    except (ValueError, shapely.errors.GEOSException):
        found = math.inf
    if not math.isfinite(found):
        return Shortest(straight, False)
    return Shortest(max(straight, found - tolerance - MARGIN), True)


Record = dict[str, Any]

BARN_SPEED = 2.0  # m/s: the speed that BARN's score measures by
WIDE = 0.05  # m of margin; success with at least this margin is reported separately
STILL = 0.02  # m/s and rad/s: a slower chair stands still
HALT = 0.5  # s: standing still for this long on the way is a halt
ROUGH = 0.9  # m/s2: standing passengers of public transport begin to complain about here
SPACING = 0.1  # m between the points of a path whose clearances are averaged
MEANS = (
    "spl", "spl_grid", "sct", "barn", "barn_own", "halts", "replans", "clearance_mean", "accel_rms",
    "jerk_rms", "rough_share", "energy_per_m",
)  # fmt: skip
SOCIAL_MEANS = (
    "person_distance_min",
    "personal_share",
    "intimate_share",
    "ttc_min",
    "people_delay",
)
EFFICIENCIES = ("path_efficiency", "time_efficiency")
# The only fields in which equal runs may differ.
TIMING = (
    "plan_ms", "act_ms_p50", "act_ms_p95", "plans_ms_p50", "plans_ms_p95", "plans_ms_max",
)  # fmt: skip


def derivative_rms(speeds: Array, period: float, order: int) -> float:
    """Root mean square of an acceleration (order 1) [m/s2] or jerk (2) [m/s3] of speeds (n,)."""
    if len(speeds) <= order:
        return 0.0
    return float(np.sqrt(np.mean((np.diff(speeds, order) / period**order) ** 2)))


def rough_share(twists: Array, period: float) -> float:
    """Share of time with an acceleration of the axle's centre above `ROUGH`.

    Twists (n, 2) [m/s, rad/s] are one a control period [s].
    """
    if len(twists) < 2:
        return 0.0
    ahead = np.diff(twists[:, 0]) / period
    middle = 0.5 * (twists[1:] + twists[:-1])
    return float(np.mean(np.hypot(ahead, middle[:, 0] * middle[:, 1]) > ROUGH))


def barn_score(success: bool, seconds: float, way: float, speed: float) -> float:
    """BARN's score of an episode: the time for a way [m] at a speed, over that taken (Xu 2023).

    The time taken is clipped to 2 to 8 times the other, so that 0.5 is the best; 0 is a failure.
    """
    best = way / speed
    return best / min(max(seconds, 2.0 * best), 8.0 * best) if success and best > 0.0 else 0.0


def halts(twists: Array, period: float) -> int:
    """Count the stops of `HALT` or longer on the way; twists (n, 2) are one a period [s]."""
    still = (np.abs(twists) < STILL).all(axis=1)
    moving = np.flatnonzero(~still)
    spells = np.diff(moving) - 1  # periods of rest between two of motion
    return int((spells * period >= HALT - 1e-9).sum())


def touches(info: Mapping[str, Any]) -> bool:
    """Return whether the chair touches something, by truth or as its board reports a bump."""
    return bool(info["contact"]) or bool(info["bumped"])


def given_map(world: Any) -> OccupancyGrid | None:
    """Return the map that an environment gives its chair; None: the chair draws its own."""
    return None if world.task.built_map is not None else cast(OccupancyGrid, world.episode.map)


@dataclass(kw_only=True)
class Ending:
    """Events of an episode that decide its outcome, each from reset to the latest step."""

    given_map: OccupancyGrid | None = None  # None: the chair draws its own
    contact: bool = False
    left_map: bool = False

    def add(self, info: Mapping[str, Any]) -> None:
        """Add one info of the environment."""
        self.contact = self.contact or touches(info)
        if self.given_map is not None and not self.given_map.inside(info["pose"][:2]):
            self.left_map = True

    def outcome(self, info: Mapping[str, Any], truncated: bool) -> str:
        """Return how an episode ended, by its last info and whether its time was over."""
        if self.contact:
            return "collision"
        if self.left_map:
            return "left_map"
        if info["is_success"]:
            return "success"
        return "timeout" if truncated else "missed"


@dataclass
class Trace(Ending):
    """The true states of one episode: one entry for reset and each step."""

    period: float  # of control [s]
    margin: float = math.nan  # by how much the chair could grow and still pass [m]
    top: float = 0.8  # the chair's own top speed [m/s]
    shortest: Shortest = NO_SHORTEST  # path from the start to the goal's region
    reference: float | None = None  # path length of the BARN score, where the world names one [m]
    replans: int = 0  # plans made after the first
    people: PeopleTrace | None = None
    sticks: StickTrace | None = None
    poses: list[Array] = field(default_factory=list)
    twists: list[Array] = field(default_factory=list)
    clearances: list[float] = field(default_factory=list)
    at_fault: bool = False
    touched_actor: bool = False
    acts_s: list[float] = field(default_factory=list)
    plan_s: float = 0.0
    planning: PlanningFigures = field(default_factory=PlanningFigures)

    def add(self, info: Mapping[str, Any]) -> None:
        """See `Ending.add`."""
        super().add(info)
        self.poses.append(np.array(info["pose"], dtype=np.float64))
        self.twists.append(np.array(info["twist"], dtype=np.float64))
        self.clearances.append(float(info["clearance"]))
        self.at_fault = self.at_fault or bool(info["at_fault"])
        self.touched_actor = self.touched_actor or int(info["contact_with"]) >= 0


def measure(trace: Trace, info: Mapping[str, Any], truncated: bool) -> Record:
    """The figures of a finished episode.

    Args:
        trace: of the whole episode.
        info: of its last step.
        truncated: it ended by its time limit.

    Returns:
        A record without the policy, scene and seed. Success means by truth, without contact, and
        with the axle's centre on the given map all the time (else `left_map`); `missed`, that the
        chair wrongly believed to have arrived; `at_fault`, that it caused a
        contact; `touched_actor`, that it touched something that moves. `sct` is success weighted
        by completion time (Yokoyama et al. 2021), for the shortest path at the chair's top speed;
        `spl_grid` is SPL as it was up to 0.2, relative to the grid's geodesic to the goal itself.
        Social measures are added where the episode has people, those of `assisted` where a person
        drives.
    """
    poses, twists = np.array(trace.poses), np.array(trace.twists)
    outcome = trace.outcome(info, truncated)
    success = outcome == "success"
    length = path_length(poses)
    geodesic, shortest = float(info["geodesic"]), trace.shortest.length
    spl, spl_grid = (
        (1.0 if length <= best else best / max(length, 1e-9)) if success else 0.0
        for best in (shortest, geodesic)
    )
    reference = geodesic if trace.reference is None else trace.reference
    seconds = float(info["time"])
    acts = 1e3 * np.array(trace.acts_s or [0.0])
    record: Record = {
        "outcome": outcome,
        "success": success,
        "arrived": bool(info["arrived"]),
        "contact": trace.contact,
        "at_fault": trace.at_fault,
        "touched_actor": trace.touched_actor,
        "margin": trace.margin,
        "time": seconds,
        "length": length,
        "geodesic": geodesic,
        "shortest": shortest,
        "shortest_is_exact": trace.shortest.is_exact,
        "spl": spl,
        "spl_grid": spl_grid,
        "sct": min(1.0, shortest / trace.top / max(seconds, 1e-9)) if success else 0.0,
        "barn": barn_score(success, seconds, reference, BARN_SPEED),
        "barn_own": barn_score(success, seconds, reference, trace.top),
        "halts": halts(twists, trace.period),
        "replans": trace.replans,
        "clearance_min": min(trace.clearances),
        "clearance_mean": float(np.mean(trace.clearances)),
        "accel_rms": derivative_rms(twists[:, 0], trace.period, 1),
        "jerk_rms": derivative_rms(twists[:, 0], trace.period, 2),
        "rough_share": rough_share(twists, trace.period),
        "energy_per_m": float(info["energy"]) / length if length > 0.1 else None,  # Wh/m
        "plan_ms": 1e3 * trace.plan_s,
        "act_ms_p50": float(np.percentile(acts, 50)),
        "act_ms_p95": float(np.percentile(acts, 95)),
        **trace.planning.record(),
    }
    if trace.people is not None and (social := trace.people.figures(poses, twists, trace.period)):
        way, best = (record[key] if success else math.nan for key in ("spl", "sct"))
        record |= social | dict(zip(EFFICIENCIES, (way, best), strict=True))
    if trace.sticks is not None:
        record |= trace.sticks.figures(twists, length)
    return {key: json_value(value) for key, value in record.items()}


def _mean(records: Sequence[Record], key: str) -> float | None:
    values = [record[key] for record in records if record[key] is not None]
    return float(np.mean(values)) if values else None


def summarise(records: Sequence[Record]) -> list[Record]:
    """One row for each policy on each scene, and one on `all` scenes together.

    Time and length are of successful episodes only; the rest is of all.
    """
    rows = []
    policies, scenes = (
        dict.fromkeys(record[key] for record in records) for key in ("policy", "scene")
    )
    for policy, scene in product(policies, [*scenes, "all"]):
        of = [r for r in records if r["policy"] == policy and scene in ("all", r["scene"])]
        if not of:
            continue
        successes = [record for record in of if record["success"]]
        row: Record = {"policy": policy, "scene": scene, "episodes": len(of)}
        for name in ("success", "collision", "timeout"):
            row |= share(name, sum(record["outcome"] == name for record in of), len(of))
        for key in ("at_fault", "touched_actor", "arrived"):
            row[key] = sum(record[key] for record in of) / len(of)
        for name in ("missed", "left_map"):
            row[name] = sum(record["outcome"] == name for record in of) / len(of)
        wide = [r for r in of if r["margin"] is not None and r["margin"] >= WIDE]
        row |= share("wide", sum(r["success"] for r in wide), len(wide)) if wide else {"wide": None}
        row |= {key: _mean(of, key) for key in MEANS}
        row |= {key: _mean(successes, key) for key in ("time", "length")}
        among = [record for record in of if SOCIAL_MEANS[0] in record]
        if among:
            row |= {key: _mean(among, key) for key in (*SOCIAL_MEANS, *EFFICIENCIES)}
        driven = [record for record in of if MEASURES[0] in record]
        if driven:
            row |= {key: _mean(driven, key) for key in MEASURES}
        for key in ("margin", "clearance_min"):
            row[key] = min((r[key] for r in of if r[key] is not None), default=None)
        for name, key, q in (
            ("plan_ms_p50", "plan_ms", 50), ("plan_ms_p95", "plan_ms", 95),
            ("act_ms_p50", "act_ms_p50", 50), ("act_ms_p95", "act_ms_p95", 95),
        ):  # fmt: skip
            row[name] = float(np.percentile([record[key] for record in of], q))
        rows.append(row)
    return rows


def turning(path: ArrayLike) -> float:
    """Mean absolute angle [rad] between successive legs of a path (n, 2); 0 for a single leg."""
    return path_cost.mean_turning(_apart(path))


def printed_turning(path: ArrayLike) -> float:
    """Smoothness f1 as the paper on RRT-WOA prints it, its (1)-(5): less is called smoother."""
    points = _apart(path)
    return path_cost.printed_turning(points) if len(points) > 1 else 0.0


def backing(path: ArrayLike) -> float:
    """Way in reverse [m] along a path (n, 3); 0 where it has no headings."""
    points = np.asarray(path, dtype=np.float64)
    if points.shape[1] < 3:
        return 0.0
    steps, yaw = np.diff(points[:, :2], axis=0), points[:-1, 2]
    along = steps[:, 0] * np.cos(yaw) + steps[:, 1] * np.sin(yaw)
    return float(np.maximum(0.0, -along).sum())


def _apart(path: ArrayLike) -> Array:
    """The points (n, 2) of a path without those that repeat the one before."""
    return without_repeats(np.asarray(path, dtype=np.float64)[:, :2])


@borrowing_kernel
def _clearances(arrays: SpaceArrays, points: Array, out: Array) -> None:
    for i in range(points.shape[0]):
        out[i] = clearance(arrays, points[i, 0], points[i, 1])


def path_figures(path: ArrayLike, problem: Problem) -> dict[str, float | None]:
    """Length [m], smoothness and clearances [m] of a path (n, 2 or 3); None where infinite.

    Clearances are those of the path's points, from obstacles and from the map's border: the least
    of all, and the mean along the way.
    """
    points = np.asarray(path, dtype=np.float64)[:, :2]
    line = shapely.LineString(points)
    way = np.append(np.arange(0.0, line.length, SPACING), line.length)
    along = shapely.get_coordinates(shapely.line_interpolate_point(line, way))
    distances = np.empty(len(along))
    _clearances(problem.space.arrays, along, distances)
    figures = {
        "length_m": path_length(points),
        "turning_rad": turning(points),
        "printed_turning": printed_turning(points),
        "clearance_min_m": float(shapely.distance(line, shapely.boundary(problem.space.free))),
        "clearance_mean_m": float(distances.mean()),
    }
    return {key: json_value(value) for key, value in figures.items()}

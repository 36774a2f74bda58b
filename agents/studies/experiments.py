"""The worlds and runs of the studies; a new kind of run is a function and a row of `EXPERIMENTS`.

Times are CPU seconds of the process, measured after compilation: other work on the machine does not
count. Keys that end in `_s` are times, the only ones in which equal runs differ.
"""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from time import process_time
from typing import Any, Final

import numpy as np
import shapely
from scipy.interpolate import CubicSpline

from agents.evaluation.metrics import printed_turning, turning
from agents.evaluation.runs import Record
from agents.evaluation.tables import json_value
from agents.studies.model import SEED_STRIDE, Job
from planners import Problem, Space, make_planner
from planners.problem import Plan, Status
from planners.registries import OBJECTIVES, OPTIMIZERS
from planners.rrt_star_woa.control_generator import ControlGenerator
from planners.swarm.planner import RrtWoa
from planners.swarm.search import iterate, new_search, result_of
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import InputError, load
from wheelchair_gym.compiled.random import stream
from wheelchair_gym.geometry.kinematics import Limits
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import path_length, to_world, wrap_angle
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.scenes.published import CHAOTIC_PSO_DISCS, GREY_WOLF_DISCS, LAB_SIZE, LABS
from wheelchair_gym.types import Episode


@lru_cache(maxsize=64)
def world_of(scene: str) -> tuple[Episode, Space]:
    """Return the one world of a scene, which is given as JSON, and its map for planners."""
    episode = make_scene(json.loads(scene)).sample(np.random.default_rng(0))
    return episode, Space.from_map(episode.map, episode.walls, episode.discs)


def problem_of(scene: Any, clearance: float = 0.0) -> Problem:
    """Return the problem of a scene's one world."""
    episode, space = world_of(json.dumps(scene))
    return Problem(space, episode.start[:2], episode.goal[:2], clearance)


def room_problem(boxes: Array, start: Any, goal: Any) -> Problem:
    """Return a room as in T2: separate axis-aligned boxes (n, 4) [m], without outer walls."""
    space = Space.from_rectangles(boxes, (0.0, 0.0, *LAB_SIZE))
    return Problem(space, np.array(start, dtype=float), np.array(goal, dtype=float))


@lru_cache(maxsize=64)
def lab_problem(number: int) -> Problem:
    """Return a lab of T2, of boxes only."""
    walls, start, goal = LABS[number - 1]
    return room_problem(np.array(walls, dtype=float), start, goal)


MAX_DRAWS: Final = 100  # rooms drawn until one has a path
_APART: Final = 0.3  # m from boxes to start and goal
_ENDS: Final = ((0.5, 0.5), (6.5, 4.5))
_LONG: Final = (0.5, 2.0)  # m, as T2's screens and benches
_THIN: Final = (0.1, 0.4)  # m


def random_room_problem(count: int, seed: int) -> tuple[Problem, float]:
    """Draw a room with this number of boxes; return it and its shortest path [m].

    Raises:
        InputError: no room that was drawn has a path.
    """
    rng = np.random.default_rng([seed, count])
    for _ in range(MAX_DRAWS):
        boxes: list[Array] = []
        while len(boxes) < count:
            sides = np.array([rng.uniform(*_LONG), rng.uniform(*_THIN)])
            sides = sides[:: rng.choice([1, -1])]
            low = rng.uniform(-0.5 * sides, np.array(LAB_SIZE) - 0.5 * sides)
            box = np.concatenate([np.maximum(low, 0.0), np.minimum(low + sides, LAB_SIZE)])
            apart = [np.maximum(box[:2] - end, end - box[2:]).max() for end in np.array(_ENDS)]
            if min(apart) > _APART:
                boxes.append(box)
        problem = room_problem(np.array(boxes), *_ENDS)
        shortest = make_planner("visibility").plan(problem, rng).length
        if math.isfinite(shortest):
            return problem, shortest
    raise InputError(f"none of {MAX_DRAWS} rooms with {count} boxes has a path")


@lru_cache(maxsize=16)
def disc_problem(size: float, discs: Any, start: Any, goal: Any) -> Problem:
    """Return a free square with discs."""
    space = Space.from_walls(np.empty((0, 4)), discs, (0.0, 0.0, size, size))
    return Problem(space, np.array(start, dtype=float), np.array(goal, dtype=float))


# The discs of a square by the name of the scene.
DISCS: Final[dict[str, tuple[tuple[float, float, float], ...]]] = {
    "chaotic_pso": CHAOTIC_PSO_DISCS,
    "grey_wolf": GREY_WOLF_DISCS,
    "none": (),
}
SETTLED = 1.001  # a swarm has settled once its cost is within this factor of its last


def measure(job: Job) -> Record:
    """Run a job and return its record; `kind` names the experiment, `seed` its random numbers."""
    run = EXPERIMENTS[str(job["kind"])]
    if (needed := kernel_key(job)) not in _compiled:  # compile before times are measured
        run(job, 0)
        _compiled.add(needed)
    record = run(job, int(job["seed"]))
    return {key: json_value(value) for key, value in record.items()}


_compiled: set[str] = set()


def kernel_key(job: Job) -> str:
    """Return a key that is equal for jobs with the same kernels and the same map."""
    planner = job.get("planner", {})
    optimizer = job.get("optimizer") or planner.get("optimizer", "")
    name = optimizer if isinstance(optimizer, str) else optimizer.get("name")
    return json.dumps(
        [job["kind"], planner.get("name"), name, job.get("scene"), job.get("lab"), job.get("goal")]
    )


def _timed_plan(job: Job, problem: Problem, seed: int) -> tuple[Plan, Record]:
    """Make the plan of a job's planner; return it and its record."""
    planner, rng = make_planner(job["planner"]), np.random.default_rng(seed)
    problem.free.arrays  # noqa: B018  cached before the time is measured
    begun = process_time()
    plan = planner.plan(problem, rng)
    seconds, solved = process_time() - begun, plan.status is Status.SOLVED
    return plan, {
        "solved": solved,
        "status": str(plan.status),
        "length_m": plan.length if solved else None,
        "nodes": plan.counters.get("nodes"),
        "edges": len(plan.path) - 1 if solved else None,
        "edges_tested": plan.counters.get("edges_tested"),
        "time_s": seconds,
    }


def plan(job: Job, seed: int) -> Record:
    """Run a planner on the one world of a scene, or on a lab."""
    lab = job.get("lab")
    problem = problem_of(job["scene"]) if lab is None else lab_problem(lab)
    found, record = _timed_plan(job, problem, seed)
    return {**record, "walls_cut": found.counters.get("walls_cut")}


@lru_cache(maxsize=4096)
def tree_path(scene: str, tree: str, seed: int) -> Array:
    """Return the path (n, 2) [m] of a tree, which the swarms of many rows then shorten."""
    planner = make_planner(json.loads(tree))
    return planner.plan(problem_of(json.loads(scene)), np.random.default_rng(seed)).path


def shortened(job: Job, seed: int) -> Record:
    """T1's global variant on the path of a tree: the length of its answer, relative to that path.

    The answer is the path of least cost, even where an obstacle blocks it.
    """
    path = tree_path(json.dumps(job["scene"]), json.dumps(job["tree"]), seed)
    if not len(path):
        return {"solved": False, "status": "exhausted", "time_s": 0.0}
    planner: Any = make_planner(job["planner"])
    begun = process_time()
    _, best = planner.shorten(
        problem_of(job["scene"]).free.arrays, path, stream(np.random.default_rng([seed, 1]))
    )
    seconds = process_time() - begun
    length = path_length(best)
    return {
        "solved": True,
        "status": "solved",
        "length_m": length,
        "ratio": length / path_length(path),
        "time_s": seconds,
    }


def plan_drawn(job: Job, seed: int) -> Record:
    """Run a planner in a random room of the seed."""
    problem, shortest = random_room_problem(job["boxes"], seed)
    found, record = _timed_plan(job, problem, seed)
    return {**record, "ratio": found.length / shortest}


def smoothing(job: Job, seed: int) -> Record:
    """P1: one optimizer, from the initial population that all optimizers share."""
    problem = problem_of(job["scene"], clearance=job["clearance"])
    swarm = replace(
        RrtWoa().swarm,
        optimizer=job["optimizer"],
        objective=OBJECTIVES.make(job["objective"]),
        curve=job["curve"],
    )
    rng = np.random.default_rng([seed, 0])
    first = RrtWoa().tree.plan(problem, rng)
    if first.status is not Status.SOLVED or len(first.path) < 3:
        return {"solved": False, "status": str(first.status), "time_s": 0.0}
    start = swarm.start(problem, first.path[:, :2], rng)
    begun = process_time()
    found = swarm.search(start, np.random.default_rng([seed, 1]))
    seconds = process_time() - begun
    given = start.path_problem
    bent = given.anchors + start.population[0].reshape(-1, 2)
    before = turning(np.vstack([given.start, bent, given.goal]))
    after = turning(found.way_points)
    valid = len(found.line) > 0
    return {
        "solved": valid,
        "status": "solved" if valid else "exhausted",
        "time_s": seconds,
        "cost": found.best_cost,
        "smoothness": after,
        "smoothness_before": before,
        "improvement": 100.0 * (before - after) / before if before > 0.0 else 0.0,
        "printed_turning": printed_turning(found.way_points),
        "length_m": path_length(found.line) if valid else None,
        "curvature": peak_curvature(found.line) if valid else None,
        "best_is_valid": valid and found.cost <= found.best_cost + 1e-9,
    }


def peak_curvature(line: Array) -> float:
    """Return the maximum angle between pieces of a line (n, 2) per mean length [1/m]."""
    steps = np.diff(line, axis=0)
    length = np.hypot(*steps.T)
    steps, length = steps[length > 1e-9], length[length > 1e-9]
    angle = np.arctan2(steps[:, 1], steps[:, 0])
    turn = np.abs(wrap_angle(np.diff(angle)))
    return float((turn / (0.5 * (length[1:] + length[:-1]))).max(initial=0.0))


def among_discs(job: Job, seed: int) -> Record:
    """Run a swarm among discs; its path is valid if it stays `reach` radii from their centres.

    With `by_legs` the path is that of the way points, and the spline drawn through them is judged,
    too: R1, section 5.12.
    """
    discs = DISCS[job["discs"]]
    problem = disc_problem(job["size"], discs, tuple(job["start"]), tuple(job["goal"]))
    planner = make_planner(job["planner"])
    rng = np.random.default_rng(seed)
    begun = process_time()
    found, costs = _search(planner, problem, rng)
    seconds = process_time() - begun
    # The published answer is the path of least cost; ours is the best valid path of all.
    line = found.best if job["faithful"] else found.line
    points = found.way_points if job["by_legs"] else line
    free = len(line) > 0 and _keeps_off(line, discs, job["reach"])
    length = path_length(points) if len(points) else None
    record: Record = {
        "solved": len(points) > 0,
        "status": "valid" if free else "not valid",
        "valid": free,
        "length_m": length,
        "near": free and length is not None and length <= job["near"] * job["best"],
        "loss": float(found.best_cost),
        "turning": turning(found.way_points),
        "found": 1 + int(np.argmin(costs)),
        "settled": 1 + int(np.argmax(costs <= SETTLED * costs[-1])),
        "time_s": seconds,
    }
    if job["by_legs"]:
        at = np.linspace(0, len(points) - 1, 500)
        line = CubicSpline(np.arange(len(points)), points)(at)
        record["spline_m"] = path_length(line)
        record["spline_valid"] = _keeps_off(line, discs, job["reach"])
    if seed % SEED_STRIDE < job.get("kept", 0):
        record["costs"] = [round(float(c), 6) for c in costs]
        record["line"] = np.round(line, 6).tolist()
    return record


def _keeps_off(line: Array, discs: Any, reach: float) -> bool:
    """Return whether a line (n, 2) stays `reach` radii from the centres of discs."""
    x, y, radius = np.reshape(discs, (-1, 3)).T
    away = shapely.distance(shapely.LineString(line), shapely.points(x, y))
    return bool((away / radius >= reach - 1e-9).all())


def _search(planner: Any, problem: Problem, rng: np.random.Generator) -> tuple[Any, Array]:
    """Run a swarm's search; return it and the minimum cost after each iteration (n,)."""
    cost = OBJECTIVES.make(planner.objective).path_cost
    rule = OPTIMIZERS.make(planner.optimizer).parameters
    search = new_search(planner.start(problem, None, rng), cost, rule)
    state, costs = stream(rng), np.empty(planner.iterations)
    for t in range(planner.iterations):  # equal to one call for all iterations
        iterate(search, t, t + 1, planner.cycle, state)
        costs[t] = search.swarm.best_cost[0]
    return result_of(search, planner.iterations), costs


def controls(job: Job, seed: int) -> Record:
    """T1 figure 2.27: a path of the global variant, its controls, and their roll-out."""
    footprint, limits = Footprint(), Limits()
    problem = problem_of(job["scene"], clearance=job["clearance"])
    episode, _ = world_of(json.dumps(job["scene"]))
    rng = np.random.default_rng(seed)
    begun = process_time()
    found = make_planner(job["planner"]).plan(problem, rng)
    planned = process_time() - begun
    if found.status is not Status.SOLVED:
        return {"solved": False, "status": str(found.status), "time_s": planned}
    begun = process_time()
    made = load(ControlGenerator, job["generator"], "generator").generate(
        found.path, episode.start, episode.walls, episode.discs, footprint, limits, rng
    )
    seconds = process_time() - begun
    poses = made.rollout
    outline = np.array([to_world(footprint.corners, pose) for pose in poses])
    solid = shapely.union_all(
        [*shapely.linestrings(episode.walls.reshape(-1, 2, 2)),
         *shapely.buffer(shapely.points(episode.discs[:, :2]), episode.discs[:, 2])]
    )  # fmt: skip
    shapely.prepare(solid)
    # An independent test of each pose; the generator tests the swept footprint.
    touched = bool(shapely.intersects(solid, shapely.polygons(outline)).any())
    off = shapely.distance(shapely.linestrings(found.path[:, :2]), shapely.points(poses[:, :2]))
    gap = float(np.hypot(*(poses[-1, :2] - episode.goal[:2])))
    record: Record = {
        "solved": True,
        "status": "solved",
        "free": bool(made.collision_free) and not touched,
        "arrived": bool(made.arrived),
        "feasible": bool(made.collision_free) and not touched and bool(made.arrived),
        "end_error_m": gap,
        "cross_track_m": float(off.max()),
        "path_m": found.length,
        "length_m": path_length(poses[:, :2]),
        "drive_time": float(made.times[-1]),
        "commands": len(made.commands),
        "time_s": seconds,
    }
    if seed % SEED_STRIDE < job.get("kept", 0):
        record["path"] = np.round(found.path[:, :2], 3).tolist()
        record["driven"] = np.round(poses[::5, :2], 3).tolist()
    return record


EXPERIMENTS: Final[dict[str, Callable[[Job, int], Record]]] = {
    run.__name__: run for run in (plan, plan_drawn, shortened, smoothing, among_discs, controls)
}

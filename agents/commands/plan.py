"""`wheelchair plan`: a path in a map, or in each problem of a file."""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING, Any

from agents.commands.arguments import add_json, distance, pose, report, whole

if TYPE_CHECKING:
    from planners.types import Plan, Problem

CLEARANCE = 0.36  # m: the chair's half width of 0.31 m and a margin of 0.05 m


def add(parts: Any) -> None:
    """Add the subcommand's parser."""
    parser: argparse.ArgumentParser = parts.add_parser(
        "plan",
        help="plan a path in a map_server map, or in each problem of a JSON file",
        description="Plan a path. Exit code 0: solved; 1: no path was found; 2: wrong input.",
        epilog="example: wheelchair plan --map hall.yaml --planner a_star --start 1,2 --goal 9,4",
    )
    parser.add_argument("--planner", required=True, metavar="NAME", help="see: wheelchair settings")
    parser.add_argument("--map", metavar="FILE.yaml", help="a map_server map")
    parser.add_argument("--problems", metavar="FILE.json", help="problems in place of a map")
    parser.add_argument("--start", type=pose, metavar="X,Y[,YAW]", help="m, m, rad")
    parser.add_argument("--goal", type=pose, metavar="X,Y[,YAW]", help="m, m, rad")
    parser.add_argument(
        "--clearance", type=distance, metavar="M",
        help=f"distance kept from obstacles [m]; default {CLEARANCE} in a map, 0 in problems",
    )  # fmt: skip
    parser.add_argument("--seed", type=whole, default=0, help="of random draws (default 0)")
    parser.add_argument("--picture", metavar="FILE", help="draw the map and the path (PNG, SVG)")
    add_json(parser)
    parser.set_defaults(run=run)


def run(given: argparse.Namespace) -> int:
    """Plan, report, and say by the exit code how it went."""
    from planners import make_planner
    from wheelchair_gym.config import InputError

    if (given.map is None) == (given.problems is None):
        raise InputError("plan: give either --map or --problems")
    if given.problems is None and (given.start is None or given.goal is None):
        raise InputError("plan: --map needs --start and --goal")
    planner = make_planner(given.planner)
    if given.problems is not None:
        return _run_problems(given, planner)
    return _run_map(given, planner)


def _answer(planner: Any, problem: Problem, seed: int) -> tuple[Plan, dict[str, Any]]:
    import numpy as np

    begun = time.perf_counter()
    plan = planner.plan(problem, np.random.default_rng(seed))
    spent = time.perf_counter() - begun
    solved = len(plan.path) > 0
    return plan, {
        "name": problem.name,
        "status": str(plan.status),
        "length": plan.length if solved else None,
        "optimum": None,
        "time_s": spent,
        "nodes": plan.counters.get("nodes"),
        "path": plan.path.tolist(),
    }


def _run_map(given: argparse.Namespace, planner: Any) -> int:
    import numpy as np

    from planners.space import Space
    from planners.types import Problem, Status
    from wheelchair_gym.config import InputError
    from wheelchair_gym.maps import read_map

    clearance = CLEARANCE if given.clearance is None else given.clearance
    grid = read_map(given.map)
    problem = Problem(
        Space.from_grid(grid), np.array(given.start), np.array(given.goal), clearance, given.map
    )
    plan, answer = _answer(planner, problem, given.seed)
    if plan.status is Status.SOLVED:
        text = (
            f"solved: {plan.length:.3f} m, {len(plan.path)} points, {1e3 * answer['time_s']:.1f} ms"
        )
        if given.picture:
            _draw(problem, plan, given.picture)
        report(given, answer, text)
        return 0
    if given.json:
        report(given, answer, str(plan.status))
    places = {
        Status.START_OUTSIDE: f"the start {_at(given.start)} lies outside the map",
        Status.START_OCCUPIED: f"the start {_at(given.start)} is not {clearance} m from obstacles",
        Status.GOAL_OUTSIDE: f"the goal {_at(given.goal)} lies outside the map",
        Status.GOAL_OCCUPIED: f"the goal {_at(given.goal)} is not {clearance} m from obstacles",
    }
    if plan.status in places:
        raise InputError(f"plan: {plan.status}: {places[plan.status]}")
    import sys

    print(f"wheelchair: plan: {plan.status}: no path with {clearance} m clearance", file=sys.stderr)
    return 1


def _at(point: list[float]) -> str:
    return "(" + ", ".join(f"{value:g}" for value in point) + ")"


def read_problems(path: str, clearance: float) -> list[tuple[Problem, float | None]]:
    """Problems of a JSON file, and the optimum of each where the file gives it.

    Raises:
        InputError: the file is not a list of objects with name, size, rects, start and goal.
    """
    import numpy as np

    from planners.space import Space
    from planners.types import Problem
    from wheelchair_gym.config import InputError, read_json

    entries = read_json(path)
    if not isinstance(entries, list):
        raise InputError(f"{path}: expected a list of problems")
    problems = []
    for index, entry in enumerate(entries):
        where = f"{path}: problem {index}"
        if not isinstance(entry, dict):
            raise InputError(f"{where}: expected an object")
        for key in ("size", "rects", "start", "goal"):
            if key not in entry:
                raise InputError(f"{where}: the key {key} is missing")
        try:
            size = float(entry["size"])
            rects = np.array(entry["rects"], dtype=np.float64).reshape(-1, 4)
            start, goal = (np.array(entry[key], dtype=np.float64) for key in ("start", "goal"))
            optimum = None if entry.get("optimum") is None else float(entry["optimum"])
        except (TypeError, ValueError):
            raise InputError(f"{where}: size, rects, start and goal must be numbers") from None
        numbers = np.concatenate([[size], rects.ravel(), start.ravel(), goal.ravel()])
        if start.shape not in ((2,), (3,)) or goal.shape not in ((2,), (3,)):
            raise InputError(f"{where}: start and goal must have two or three numbers")
        if not np.isfinite(numbers).all() or size <= 0:
            raise InputError(f"{where}: numbers must be finite, and the size above 0")
        corners = [np.array([(a, b), (c, b), (c, d), (a, d)]) for a, b, c, d in rects]
        space = Space.from_polygons(corners, (0.0, 0.0, size, size))
        name = str(entry.get("name", index))
        problems.append((Problem(space, start, goal, clearance, name), optimum))
    return problems


def _run_problems(given: argparse.Namespace, planner: Any) -> int:
    problems = read_problems(given.problems, given.clearance or 0.0)
    answers = []
    if problems:
        _answer(planner, problems[0][0], given.seed)  # so that no time holds compilation
    for problem, optimum in problems:
        _, answer = _answer(planner, problem, given.seed)
        answers.append(answer | {"optimum": optimum})
    lines = []
    for answer in answers:
        text = f"{answer['name']}: {answer['status']}"
        if answer["length"] is not None:
            text += f", {answer['length']:.3f} m"
            if answer["optimum"]:
                text += f" ({answer['length'] / answer['optimum']:.4f} of the optimum)"
        lines.append(f"{text}, {1e3 * answer['time_s']:.1f} ms")
    report(given, answers, "\n".join(lines))
    return 0


def _draw(problem: Problem, plan: Plan, file: str) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.collections import LineCollection

    from wheelchair_gym.config import InputError

    figure, axes = plt.subplots(figsize=(8, 8), layout="constrained")
    walls = problem.space.arrays.segments.reshape(-1, 2, 2)
    axes.add_collection(LineCollection(list(walls), colors="black", linewidths=0.8))
    if len(plan.tree):
        tree = plan.tree.reshape(-1, 2, 2)
        axes.add_collection(LineCollection(list(tree), colors="0.8", linewidths=0.5))
    axes.plot(plan.path[:, 0], plan.path[:, 1], color="tab:blue")
    axes.plot(*problem.start[:2], "o", color="tab:green", label="start")
    axes.plot(*problem.goal[:2], "*", color="tab:red", label="goal")
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.legend()
    try:
        figure.savefig(file, dpi=120)
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: cannot be written ({error})") from None
    finally:
        plt.close(figure)

"""`wheelchair plan`: a path in a map, or in each problem of a file."""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from agents.cli.arguments import add_json, changed, distance, pose, report, spec, whole

if TYPE_CHECKING:
    from planners import Plan, Problem
    from planners.thesis_settings import ThesisFile

CLEARANCE = 0.36  # m: the chair's half width of 0.31 m and a margin of 0.05 m
INVALID = "invalid"  # a status that only the judge gives
OUTLINES = 0.8  # m between the outlines drawn along a path


def add(parts: Any) -> None:
    """Add the subcommand's parser."""
    parser: argparse.ArgumentParser = parts.add_parser(
        "plan",
        help="plan a path in a map, or in each problem of a JSON file",
        description="Plan a path. Exit code 0: solved; 1: no path was found; 2: wrong input.",
        epilog="example: wheelchair plan --map hall.yaml --start 1,2 --goal 9,4 "
        "--planner rrt_star --set iterations=30000",
    )
    parser.add_argument(
        "--planner", metavar="NAME",
        help="or FILE.json:NAME as in configs/planners.json; see: wheelchair settings",
    )  # fmt: skip
    parser.add_argument(
        "--config", metavar="FILE.json",
        help="the thesis's own settings: planner, map 1 to 5 with start and goal, dilation; "
        "other options go before it",
    )  # fmt: skip
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", dest="changes",
        help="change a setting of the planner, such as tree.iterations=30000; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--map", metavar="FILE", help="map_server .yaml, MovingAI .map, HouseExpo .json"
    )
    parser.add_argument("--problems", metavar="FILE.json", help="problems in place of a map")
    parser.add_argument("--start", type=pose, metavar="X,Y[,YAW]", help="m, m, rad")
    parser.add_argument("--goal", type=pose, metavar="X,Y[,YAW]", help="m, m, rad")
    parser.add_argument(
        "--clearance", type=distance, metavar="M",
        help=f"distance kept from obstacles [m]; default {CLEARANCE} in a map, 0 in problems",
    )  # fmt: skip
    parser.add_argument("--seed", type=whole, default=0, help="of random draws (default 0)")
    parser.add_argument("--picture", metavar="FILE", help="draw the map and the path (.png)")
    add_json(parser)
    parser.set_defaults(run=run)


def run(given: argparse.Namespace) -> int:
    """Plan, report, and say by the exit code how it went."""
    from planners import make_planner
    from wheelchair_gym.config import InputError

    thesis = None
    if given.config is not None:
        from planners.thesis_settings import read_thesis

        thesis = read_thesis(given.config)
    named = given.planner or (thesis.planner() if thesis else None)
    if not named:
        raise InputError("plan: give --planner, or --config with the thesis's settings")
    if thesis is None and (given.map is None) == (given.problems is None):
        raise InputError("plan: give either --map or --problems")
    if thesis is None and given.problems is None and (given.start is None or given.goal is None):
        raise InputError("plan: --map needs --start and --goal")
    if given.problems is not None and (given.start or given.goal or given.picture):
        raise InputError("plan: --problems takes neither --start, --goal nor --picture")
    planner = make_planner(changed(spec(named) if isinstance(named, str) else named, given.changes))
    _compile_beside(planner)
    if given.problems is not None:
        return _run_problems(given, planner)
    return _run_map(given, planner, _problem(given, thesis))


def _problem(given: argparse.Namespace, thesis: ThesisFile | None) -> Problem:
    """The map and the ends that a person names, or those of the thesis's settings."""
    from pathlib import Path

    from planners import Problem, Space
    from wheelchair_gym.config import InputError
    from wheelchair_gym.maps import read_ground
    from wheelchair_gym.scenes import make_scene

    number = thesis.map_name if thesis and given.map is None else ""
    ends = {"start": given.start, "goal": given.goal}
    if number in ("1", "2", "3", "4", "5"):
        name = f"thesis_{number}"
        episode = make_scene(name).sample(np.random.default_rng(given.seed))
        space = Space.from_walls(episode.walls, episode.discs, episode.map.bounds)
        cell = episode.map.resolution
        for end, pose_there in (("start", episode.start), ("goal", episode.goal)):
            ends[end] = ends[end] or pose_there[:2].tolist()
    else:
        name = given.map or str(Path(given.config).parent / number)
        if given.map is None and not Path(number).suffix:
            said = f"{given.config}: MapProcessor_Map_Name is {number!r}"
            raise InputError(f"{said}; expected 1 to 5 or the name of a map file, or give --map")
        grid, walls = read_ground(name)
        cell, outlined = grid.resolution, Path(name).suffix.lower() == ".json"
        space = Space.from_walls(walls, (), grid.bounds) if outlined else Space.from_grid(grid)
    if ends["start"] is None or ends["goal"] is None:
        raise InputError("plan: --map needs --start and --goal")
    clearance = given.clearance
    if clearance is None:
        clearance = CLEARANCE if thesis is None else thesis.dilation * cell
    return Problem(space, np.array(ends["start"]), np.array(ends["goal"]), clearance, name)


def _small(clearance: float) -> Problem:
    from planners import Problem, Space

    space = Space.from_rectangles([(2.0, 1.5, 3.0, 2.5)], (0.0, 0.0, 5.0, 4.0))
    ends = np.array([1.0, 2.0]), np.array([4.0, 2.0])
    return Problem(space, *ends, min(clearance, CLEARANCE))


def _warm(planner: Any, clearance: float) -> None:
    """Compile, or load what is compiled, so that no time holds that."""
    _answer(planner, _small(clearance), 0)


def _compile_beside(planner: Any) -> None:
    """Let a helper compile the planner, from now on, while this process compiles what it needs."""
    from wheelchair_gym.compiled.progress import called_by, kernels_of
    from wheelchair_gym.compiled.second_process import compile_beside

    # The largest kernel stands for the planner: some others are compiled for some settings only.
    kernels = sorted(kernels_of(type(planner).plan), key=lambda k: len(called_by(k)))
    compile_beside(kernels[-1:], lambda: _warm(planner, 0.0))


def _grow_obstacles(planner: Any, clearance: float) -> None:
    """Compile what grows obstacles by a clearance: the helper does so last, if at all."""
    if clearance > 0.0 and not hasattr(planner, "footprint"):
        _small(clearance).free.mesh  # noqa: B018 - for the sake of its kernels


def _answer(planner: Any, problem: Problem, seed: int) -> tuple[Plan, dict[str, Any]]:
    begun = time.perf_counter()
    plan = planner.plan(problem, np.random.default_rng(seed))
    spent = time.perf_counter() - begun
    solved = len(plan.path) > 0
    why = _fault(planner, plan, problem) if solved else ""
    if why:  # said by who did not plan it
        plan = dataclasses.replace(plan, note=why)
    return plan, {
        "name": problem.name,
        "status": INVALID if why else str(plan.status),
        "length": plan.length if solved else None,
        "optimum": None,
        "time_s": spent,
        "nodes": plan.counters.get("nodes"),
        "note": plan.note,
        "path": plan.path.tolist(),
    }


def _fault(planner: Any, plan: Plan, problem: Problem) -> str:
    """What is wrong with a path by a judge that shares nothing with planners; '' if nothing is.

    A path of points is judged as a disc drives it, one of poses as its planner's footprint does.
    """
    from planners.judge import TOLERANCE, Judge, sweep_faults

    if not np.isfinite(plan.path).all():
        return "a point is not finite"
    footprint = getattr(planner, "footprint", None)
    if plan.path.shape[1] == 2 or footprint is None:
        found = Judge.of(problem).faults(plan.path, problem.start, problem.goal)
        return found[0] if found else ""
    for name, end, at in (("start", problem.start, 0), ("end", problem.goal, -1)):
        gap = float(np.hypot(*(plan.path[at, :2] - end[:2])))
        if not gap <= TOLERANCE:
            return f"its {name} is {gap} m from where it should be"
    space = problem.space
    found = sweep_faults(plan.path, footprint.corners, space.solid, space.bounds)
    return found[0] if found else ""


def _run_map(given: argparse.Namespace, planner: Any, problem: Problem) -> int:
    from planners import Status
    from planners.graphs.visibility import Visibility, optima
    from wheelchair_gym.config import InputError

    clearance = problem.clearance
    _grow_obstacles(planner, clearance)
    if given.picture:
        _warm(Visibility(), clearance)
    _warm(planner, clearance)
    plan, answer = _answer(planner, problem, given.seed)
    if answer["status"] == INVALID:
        if given.json:
            report(given, answer, INVALID)
        said = f"{type(planner).__name__} says solved, but by an independent judge {plan.note}"
        print(f"wheelchair: plan: {INVALID}: {said}", file=sys.stderr)
        return 1
    if plan.status is Status.SOLVED:
        text = (
            f"solved: {plan.length:.3f} m, {len(plan.path)} points, {1e3 * answer['time_s']:.1f} ms"
        )
        if isinstance(planner, Visibility) and clearance > 0.0:
            bounds = optima(problem)
            answer |= {"touching": bounds.touching, "at_least": bounds.at_least}
            text += (
                f"; no path with {clearance:g} m clearance is shorter than {bounds.at_least:.3f} m"
                f", none at all than {bounds.touching:.3f} m"
            )
        if given.picture:
            _draw(problem, plan, planner, text, given.picture)
        report(given, answer, text)
        return 0
    if given.json:
        report(given, answer, str(plan.status))
    start, goal = f"the start {_at(problem.start)}", f"the goal {_at(problem.goal)}"
    places = {
        Status.START_OUTSIDE: f"{start} lies outside the map",
        Status.START_OCCUPIED: f"{start} is not {clearance:g} m from obstacles",
        Status.GOAL_OUTSIDE: f"{goal} lies outside the map",
        Status.GOAL_OCCUPIED: f"{goal} is not {clearance:g} m from obstacles",
    }
    if plan.status in places:
        raise InputError(f"plan: {plan.status}: {places[plan.status]}")
    none = "there is no path" if plan.status is Status.NO_PATH else "no path was found"
    why = f": {plan.note}" if plan.note else ""
    print(
        f"wheelchair: plan: {plan.status}: {none} with {clearance:g} m clearance{why}",
        file=sys.stderr,
    )
    return 1


def _at(point: Any) -> str:
    return "(" + ", ".join(f"{value:g}" for value in point) + ")"


def _run_problems(given: argparse.Namespace, planner: Any) -> int:
    from planners.problem_files import read_problems

    problems = read_problems(given.problems)
    clearance = given.clearance or 0.0
    _grow_obstacles(planner, clearance)
    _warm(planner, clearance)
    answers = []
    for problem, optimum in problems:
        problem = dataclasses.replace(problem, clearance=clearance)
        _, answer = _answer(planner, problem, given.seed)
        answers.append(answer | {"optimum": optimum})
    lines = []
    for answer in answers:
        text = f"{answer['name']}: {answer['status']}"
        if answer["length"] is not None:
            text += f", {answer['length']:.3f} m"
            if answer["optimum"]:
                text += f" ({answer['length'] / answer['optimum']:.4f} of the optimum)"
        why = f": {answer['note']}" if answer["note"] else ""
        lines.append(f"{text}, {1e3 * answer['time_s']:.1f} ms{why}")
    report(given, answers, "\n".join(lines))
    return 0


def _draw(problem: Problem, plan: Plan, planner: Any, caption: str, file: str) -> None:
    import shapely

    from wheelchair_gym.rendering import draw_plan, write_png

    rings = shapely.get_rings(shapely.get_parts(problem.space.solid))
    loops = [shapely.get_coordinates(ring)[:-1] for ring in rings]
    image = draw_plan(
        problem.space.bounds, problem.start, problem.goal, plan.path, plan.tree,
        polygons=loops, optimum=_shortest(problem), swarm=getattr(plan, "swarm", ()),
        outlines=_outlines(problem, plan, planner), size=960, caption=caption, legend=True,
    )  # fmt: skip
    write_png(file, image)


def _shortest(problem: Problem) -> Any:
    """The shortest path of a disc (n, 2) [m]; None where there is none."""
    from planners import make_planner

    best = make_planner("visibility").plan(problem, np.random.default_rng(0))
    return best.path if len(best.path) else None


def _outlines(problem: Problem, plan: Plan, planner: Any) -> list[Any]:
    """What moves, at the path's ends and about every `OUTLINES` metres between: (k, 2) [m] each.

    A path with headings is driven by the planner's footprint, any other by the disc that keeps
    the clearance.
    """
    from wheelchair_gym.geometry import Footprint, to_world

    path = plan.path
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path[:, :2], axis=0).T))])
    stops = np.linspace(0.0, way[-1], max(2, round(way[-1] / OUTLINES) + 1))
    if path.shape[1] == 3:
        corners = getattr(planner, "footprint", Footprint()).corners
        near = np.abs(way[:, None] - stops).argmin(axis=0)
        return [to_world(corners, path[k]) for k in near]
    if problem.clearance == 0.0:
        return []
    around = np.linspace(0.0, 2.0 * np.pi, 49)[:-1]
    disc = problem.clearance * np.stack([np.cos(around), np.sin(around)], axis=-1)
    places = np.stack([np.interp(stops, way, path[:, axis]) for axis in range(2)], axis=-1)
    return [place + disc for place in places]

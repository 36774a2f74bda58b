"""`wheelchair plan`: a path in a map, or in each problem of a file."""

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from agents.benchmarks.entrants import small_problem
from agents.cli.arguments import changed, refuse, report, spec
from agents.studies import plan_pictures
from agents.studies.plan_pictures import SHORTENS, STEERS, Drawn, PlanPictures
from agents.studies.plan_pictures import problem_of as thesis_problem
from planners import PLANNERS, Plan, Problem, Space, Status, make_planner
from planners.graphs.visibility import Visibility, optima
from planners.judge import plan_faults
from planners.problem import check, checked_plan
from planners.problem_files import read_problems
from planners.rrt_star_woa.thesis import GLOBAL, PLANNERS_OF_FILE, ThesisFile, read_thesis
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.compiled.linking import Kernel
from wheelchair_gym.compiled.second_process import compile_beside
from wheelchair_gym.maps import read_any_map
from wheelchair_gym.rendering import write_png
from wheelchair_gym.rendering.video import video_suffix, write_video

CLEARANCE = 0.36  # m: the chair's half width of 0.31 m and a margin of 0.05 m
INVALID = "invalid"  # a status that only the independent judge gives


def run(given: argparse.Namespace) -> int:
    """Plan and report; 0 when a path was found."""
    thesis = None if given.config is None else read_thesis(given.config)
    named = given.planner or GLOBAL
    if thesis is None and (given.map is None) == (given.problems is None):
        raise InputError("plan: give either --map or --problems")
    if thesis is None and given.problems is None and (given.start is None or given.goal is None):
        raise InputError("plan: --map needs --start and --goal")
    if given.problems is not None:
        names = "map", "resolution", "unknown", "start", "goal", "picture", "video"
        refuse(given, names, "expected without --problems")
    settings = thesis.planner(named) if thesis and named in PLANNERS_OF_FILE else spec(named)
    planner = make_planner(changed(settings, given.changes))
    solve = getattr(type(planner), "solve", type(planner).plan)  # others' planners have a plan only
    if (kernel := _longest_kernel(solve)) is not None:  # while this process compiles the rest
        compile_beside(kernel, _warm, planner, 0.0)
    if given.problems is not None:
        code = _run_problems(given, planner)
    elif thesis is not None:
        _name_files(given, thesis)
        drawn = thesis_problem(
            thesis, given.map, given.resolution, given.start, given.goal, given.clearance,
            given.unknown != "free",
        )  # fmt: skip
        code = _run_map(given, planner, drawn.problem, drawn)
    else:
        grid, walls = read_any_map(given.map, given.unknown != "free", given.resolution)
        outlined = Path(given.map).suffix.lower() == ".json"
        space = Space.from_map(grid, walls) if outlined else Space.from_grid(grid)
        clearance = CLEARANCE if given.clearance is None else given.clearance
        ends = np.array(given.start), np.array(given.goal)
        code = _run_map(given, planner, Problem(space, *ends, clearance, given.map))
    if thesis and (idle := thesis.without_effect(named, given.problems is not None)):
        print(f"wheelchair: plan: {idle}", file=sys.stderr)
    return code


def _name_files(given: argparse.Namespace, thesis: ThesisFile) -> None:
    """Names for the picture and the film that the thesis's settings ask for, if they have none.

    A file that nobody named is not overwritten.
    """
    for key, option, ending in (
        ("RenderGraphics", "picture", ".png"),
        ("CreateVideo", "video", video_suffix()),
    ):
        if thesis.value(key) and getattr(given, option) is None:
            file = Path(thesis.path.stem + ending)
            if file.exists():
                what = f"{thesis.path}: {key} would overwrite {file}"
                raise InputError(f"{what}; name it with --{option} {file}, or choose another name")
            setattr(given, option, str(file))


def _warm(planner: Any, clearance: float) -> None:
    """Compile, or load compiled code, before times are measured."""
    problem = small_problem(min(clearance, CLEARANCE))
    if clearance > 0.0 and not hasattr(planner, "footprint"):
        assert problem.free.mesh is not None  # the second process inflates last, or not at all
    _answer(planner, problem, 0)


def _longest_kernel(function: Callable[..., Any]) -> Kernel | None:
    """Return the longest kernel that a function calls, itself or by other functions of planners.

    The longest is compiled for all settings; some others are compiled only for some.
    """
    kernels: list[Kernel] = []
    functions = [function]
    for caller in functions:
        for name in caller.__code__.co_names:
            value = caller.__globals__.get(name)
            if isinstance(value, Kernel):
                kernels.append(value)
            elif (
                isinstance(value, FunctionType)
                and value.__module__.startswith("planners.")
                and value not in functions
            ):
                functions.append(value)
    return max(kernels, key=lambda kernel: len(kernel.py_func.__code__.co_code), default=None)


def _answer(planner: Any, problem: Problem, seed: int) -> tuple[Plan, dict[str, Any]]:
    begun = time.perf_counter()
    plan = checked_plan(planner, planner.plan(problem, np.random.default_rng(seed)))
    spent = time.perf_counter() - begun
    solved = len(plan.path) > 0
    if not solved and (status := check(problem)):  # also where somebody's planner says less
        plan = replace(plan, status=status)
    why = next(iter(plan_faults(plan, problem, getattr(planner, "footprint", None))), "")
    if why:  # by the independent judge, which shares no code with planners
        plan = replace(plan, note=why)
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


def _run_map(
    given: argparse.Namespace, planner: Any, problem: Problem, drawn: Drawn | None = None
) -> int:
    clearance = problem.clearance
    if given.picture and drawn is None:
        _warm(Visibility(), clearance)
    _warm(planner, clearance)
    plan, answer = _answer(planner, problem, given.seed)
    pictures = PlanPictures(drawn or Drawn.of(problem), planner, plan, given.seed)
    if answer["status"] == INVALID:
        if given.picture:
            finite = replace(plan, path=plan.path[np.isfinite(plan.path).all(axis=-1)])
            picture = replace(pictures, plan=finite).draw(f"{INVALID}: {plan.note}")
            write_png(given.picture, picture)
        if given.json:
            report(given, answer, INVALID)
        why = f"{type(planner).__name__} says solved, but by an independent judge {plan.note}"
        print(f"wheelchair: plan: {INVALID}: {why}", file=sys.stderr)
        return 1
    if plan.status is Status.SOLVED:
        spent = 1e3 * answer["time_s"]
        text = f"solved: {plan.length:.3f} m, {len(plan.path)} points, {spent:.1f} ms"
        if isinstance(planner, Visibility) and clearance > 0.0:
            bounds = optima(problem)
            answer |= {"touching": bounds.touching, "lower_bound": bounds.lower_bound}
            text += (
                f"; no path with {clearance:g} m clearance is shorter than {bounds.lower_bound:.3f}"
                f" m, none at all than {bounds.touching:.3f} m"
            )
        shown = given.picture or given.video
        if drawn is not None or (shown and PLANNERS.name_of(planner) in (SHORTENS, STEERS)):
            made = plan_pictures.controls_of(pictures.drawn, plan, given.seed)
            pictures = replace(pictures, made=made)
            text += f"; {plan_pictures.describe(made)}"
            answer |= {"commands": made.commands.tolist(), "arrived": bool(made.arrived)}
            answer |= {"collision_free": bool(made.collision_free), "error": made.error}
        if given.picture:
            write_png(given.picture, pictures.draw(text))
        if given.video:
            write_video(given.video, pictures.film(), plan_pictures.RATE)
        report(given, answer, text)
        return 0
    if given.json:
        report(given, answer, str(plan.status))
    name, _, fault = str(plan.status).partition("_")
    if fault in ("outside", "occupied"):
        where = "(" + ", ".join(f"{value:g}" for value in getattr(problem, name)) + ")"
        what = "lies outside the map"
        if fault == "occupied":
            what = f"lies in an obstacle of {problem.name}, as it is dilated"
            if clearance > 0.0 or drawn is None:
                what = f"is not {clearance:g} m from obstacles"
        raise InputError(f"plan: {plan.status}: the {name} {where} {what}")
    none = "there is no path" if plan.status is Status.NO_PATH else "no path was found"
    why = f": {plan.note}" if plan.note else ""
    said = f"{plan.status}: {none} with {clearance:g} m clearance{why}"
    print(f"wheelchair: plan: {said}", file=sys.stderr)
    return 1


def _run_problems(given: argparse.Namespace, planner: Any) -> int:
    problems = read_problems(given.problems)
    clearance = given.clearance or 0.0
    _warm(planner, clearance)
    answers, lines = [], []
    for problem, optimum in problems:
        _, answer = _answer(planner, replace(problem, clearance=clearance), given.seed)
        answers.append(answer | {"optimum": optimum})
        text = f"{answer['name']}: {answer['status']}"
        if answer["length"] is not None:
            text += f", {answer['length']:.3f} m"
            if optimum:
                text += f" ({answer['length'] / optimum:.4f} of the optimum)"
        why = f": {answer['note']}" if answer["note"] else ""
        lines.append(f"{text}, {1e3 * answer['time_s']:.1f} ms{why}")
    report(given, answers, "\n".join(lines))
    return 0

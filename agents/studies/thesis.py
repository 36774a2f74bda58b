"""The thesis's program: a map image becomes polygons, a plan, commands, a picture and a film.

Its sections 3.2.1 and 3.2.2 and its figure 2.27, with the keys of its settings file (figure 3.1).
The plan itself is that of any planner.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import shapely

from planners import Plan, Problem, Space
from planners.rrt_star_woa.control_generator import ControlGenerator, Controls
from planners.rrt_star_woa.thesis import ThesisFile
from wheelchair_gym.arrays import Array
from wheelchair_gym.errors import InputError, shorten
from wheelchair_gym.geometry import Footprint, polygon_edges, to_world
from wheelchair_gym.kinematics import Limits
from wheelchair_gym.maps import occupied_polygons, read_grid
from wheelchair_gym.rendering import draw_plan
from wheelchair_gym.rendering.video import Image
from wheelchair_gym.scenes import make_scene

OUR_MAPS: Final = ("1", "2", "3", "4", "5")  # drawn to the thesis's text
RATE: Final = 15.0  # pictures of the film a second
GROWTH, DRIVE = 60, 120  # pictures of the growth of the tree, and of the roll-out, at most
_DISTANCE: Final = 1.0  # m between the footprints drawn along a roll-out


class Drawn(NamedTuple):
    """A map as the thesis's program sees it, and what is asked there."""

    problem: Problem  # among the dilated polygons
    solid: list[Array]  # loops (k, 2) [m] round what is solid before the dilation
    kept_free: list[Array]  # loops round that and what the dilation adds; none without dilation


def problem_of(
    file: ThesisFile,
    map_file: str | None = None,
    resolution: float | None = None,
    start: list[float] | None = None,
    goal: list[float] | None = None,
    clearance: float | None = None,
    unknown_is_solid: bool = True,
) -> Drawn:
    """The problem of a settings file: its map, binarised, dilated, and approximated by polygons.

    Args:
        file: gives the map, the dilation and the epsilon.
        map_file: in place of the file's map.
        resolution: edge of a pixel of an image [m].
        start: (2,) or (3,) m, m, rad; None for that of one of our five maps.
        goal: likewise.
        clearance: of a disc [m], in place of the dilation.
        unknown_is_solid: unknown cells of a map file are occupied; otherwise they are free.

    Raises:
        InputError: there is no such map, no start, no goal, or no free space.
    """
    named = file.value("MapProcessor_Map_Name")
    beside = str(file.path.parent / named)
    if map_file is None and not Path(named).suffix and os.path.isfile(f"{beside}.png"):
        beside += ".png"
    elif map_file is None and not Path(named).suffix and named not in OUR_MAPS:
        raise InputError(
            f"{file.path}: MapProcessor_Map_Name is {shorten(named)}; expected a map file, the "
            "name of a .png beside this one, or 1 to 5; or give --map"
        )
    if map_file is None and not Path(beside).suffix:
        name = f"thesis_{named}"
        if resolution is not None:
            raise InputError(f"{name}: the resolution is for images; this map has its own scale")
        episode = make_scene(name).sample(np.random.default_rng(0))
        grid = episode.map
        start, goal = start or episode.start.tolist(), goal or episode.goal.tolist()
    else:
        name = map_file or beside
        grid = read_grid(name, unknown_is_solid, resolution)
    if start is None or goal is None:
        raise InputError(f"plan: {name} needs --start and --goal")
    epsilon, dilation = file.value("MapProcessor_Epsilon"), 0
    if clearance is None:
        dilation = file.value("MapProcessor_Obstacles_Dilation")
    if 2 * dilation >= min(grid.shape):
        raise InputError(
            f"{file.path}: MapProcessor_Obstacles_Dilation is {dilation}; expected less than half "
            f"of the shorter side of {name}, which is {min(grid.shape)} pixels"
        )
    upright = grid if grid.origin[2] == 0.0 else replace(grid, origin=(0.0, 0.0, 0.0))
    grown = occupied_polygons(upright, dilate=dilation, epsilon=epsilon)
    space = Space.from_outlines(grown, upright.bounds)
    space = space if upright is grid else space.placed(grid.origin)
    if space.free.is_empty:
        raise InputError(
            f"{name}: no free space with MapProcessor_Obstacles_Dilation {dilation} and "
            f"MapProcessor_Epsilon {epsilon:g}; expected less [pixels]"
        )
    problem = Problem(space, np.array(start), np.array(goal), clearance or 0.0, name)
    exact = occupied_polygons(grid, epsilon=epsilon)
    solid = [ring for region in exact for ring in (region.outer, *region.holes)]
    shut = shapely.difference(shapely.box(*grid.bounds), problem.free.free)
    rings = shapely.get_rings(shapely.get_parts(shut)) if dilation or clearance else []
    return Drawn(problem, solid, [shapely.get_coordinates(ring)[:-1] for ring in rings])


def controls_of(drawn: Drawn, plan: Plan, seed: int) -> Controls:
    """The commands that lead along a plan, kept free of the polygons by the chair's outline.

    The chair starts with the heading of the start, or else along the path.
    """
    start, path = drawn.problem.start, plan.path
    heading = start[2] if len(start) == 3 else np.arctan2(*(path[1] - path[0])[1::-1])
    walls = np.concatenate([np.empty((0, 4)), *map(polygon_edges, drawn.solid)])
    rng = np.random.default_rng(seed)
    return ControlGenerator().generate(
        path, [*start[:2], heading], walls, (), Footprint(), Limits(), rng
    )


def describe(made: Controls) -> str:
    """What becomes of the commands, in a few words."""
    if made.collision_free and made.arrived:
        return f"{len(made.commands)} commands arrive in {made.times[-1]:.1f} s, free of contact"
    return (
        f"{len(made.commands)} commands end {made.error:.1f} m before the goal: the end of segment "
        f"{made.reached + 1} of {made.segments} is missed by {made.missed:.2f} m"
    )


def draw(drawn: Drawn, plan: Plan, made: Controls, caption: str) -> Image:
    """The thesis's figure 2.27: map, tree, path in red, and the roll-out in blue (h, w, 3)."""
    way = np.cumsum(np.hypot(*np.diff(made.rollout[:, :2], axis=0, prepend=made.rollout[:1, :2]).T))
    near = np.searchsorted(way, np.arange(0.0, way[-1], _DISTANCE))
    return _picture(drawn, plan, made.rollout, made.rollout[[*near, -1]], caption, 960, legend=True)


def film(drawn: Drawn, planner: Any, plan: Plan, made: Controls, seed: int) -> Iterator[Image]:
    """Pictures (h, w, 3) at `RATE`: the tree grows, then the commands are rolled out."""
    for part in growth(drawn.problem, planner, plan, seed):
        grown = part.counters.get("iterations", 0)
        yield _picture(drawn, part, made.rollout[:0], made.rollout[:0], f"{grown} samples")
    count = min(len(made.rollout), DRIVE)
    for k in np.linspace(0, len(made.rollout) - 1, count).round().astype(int):
        said = f"{made.times[k]:.1f} s"
        yield _picture(drawn, plan, made.rollout[: k + 1], made.rollout[k : k + 1], said)


def growth(
    problem: Problem, planner: Any, plan: Plan, seed: int, frames: int | None = None
) -> Iterator[Plan]:
    """Plans of ever more samples, the last the plan itself; equal seeds grow equal trees."""
    limited = planner.tree if hasattr(planner, "tree") else planner
    if len(plan.tree) and hasattr(limited, "iterations"):
        made = plan.counters["iterations"]
        counts = np.unique(np.linspace(1, max(1, made), frames or GROWTH).round().astype(int))
        for k in counts[:-1].tolist():
            fewer = replace(limited, iterations=k)
            some = fewer if limited is planner else replace(planner, tree=fewer)
            yield some.plan(problem, np.random.default_rng(seed))
    yield plan


def _picture(
    drawn: Drawn, plan: Plan, rollout: Array, places: Array, caption: str,
    size: int = 640, legend: bool = False,
) -> Image:  # fmt: skip
    problem = drawn.problem
    return draw_plan(
        problem.space.bounds, problem.start, problem.goal, plan.path, plan.tree,
        polygons=drawn.solid, inflated=drawn.kept_free, rollout=rollout,
        outlines=[to_world(Footprint().corners, pose) for pose in places],
        size=size, caption=caption, legend=legend,
    )  # fmt: skip

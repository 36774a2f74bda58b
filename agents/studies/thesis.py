"""The thesis's program: a map image becomes polygons, a plan and commands.

Its sections 3.2.1 and 3.2.2 and its figure 2.27, with the keys of its settings file (figure 3.1).
The plan itself is that of any planner.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import shapely

from planners import Plan, Problem, Space
from planners.rrt_star_woa.control_generator import ControlGenerator, Controls
from planners.rrt_star_woa.thesis import ThesisFile
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.errors import InputError, shorten
from wheelchair_gym.geometry import kinematics, outline, planar
from wheelchair_gym.maps import occupied_polygons, read_grid
from wheelchair_gym.scenes import make_scene

OUR_MAPS: Final = ("1", "2", "3", "4", "5")  # drawn to the thesis's text


class Drawn(NamedTuple):
    """A map as the thesis's program sees it, and what is asked there."""

    problem: Problem  # among the dilated polygons
    solid: list[Array]  # loops (k, 2) [m] round what is solid before the dilation
    kept_free: list[Array]  # loops round that and what the dilation adds; none without dilation

    @classmethod
    def of(cls, problem: Problem) -> Drawn:
        """A problem without dilation."""
        return cls(problem, _loops(problem.space.solid), [])


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
    return Drawn(problem, solid, _loops(shut) if dilation or clearance else [])


def _loops(area: Any) -> list[Array]:
    """The rings (k, 2) [m] of an area."""
    rings = shapely.get_rings(shapely.get_parts(area))
    return [shapely.get_coordinates(ring)[:-1] for ring in rings]


def controls_of(drawn: Drawn, plan: Plan, seed: int) -> Controls:
    """The commands that lead along a plan, kept free of the polygons by the chair's outline.

    The chair starts with the heading of the start, or else along the path.
    """
    start, path = drawn.problem.start, plan.path
    heading = start[2] if len(start) == 3 else np.arctan2(*(path[1] - path[0])[1::-1])
    walls = np.concatenate([np.empty((0, 4)), *map(planar.polygon_edges, drawn.solid)])
    rng = np.random.default_rng(seed)
    return ControlGenerator().generate(
        path, [*start[:2], heading], walls, (), outline.Footprint(), kinematics.Limits(), rng
    )


def describe(made: Controls) -> str:
    """Return a summary: when the commands arrive, or the segment whose end they miss."""
    if made.collision_free and made.arrived:
        return f"{len(made.commands)} commands arrive in {made.times[-1]:.1f} s, free of contact"
    return (
        f"{len(made.commands)} commands end {made.error:.1f} m before the goal: the end of segment "
        f"{made.reached + 1} of {made.segments} is missed by {made.missed:.2f} m"
    )

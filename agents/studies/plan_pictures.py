"""The thesis's program: a map image becomes polygons, a plan and commands; and its pictures.

Its sections 3.2.1 and 3.2.2 and its figure 2.27, with the keys of its settings file (figure 3.1).
The plan itself is that of any planner. Pictures and films show the tree as it grows, the whales,
the path and its roll-out.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final, NamedTuple, Self

import numpy as np
import shapely

from agents.policies.planned import PlannedDriver
from planners import PLANNERS, Plan, Problem, Space, make_planner
from planners.collision.polygon_tests import blocked_edges
from planners.rrt_star_woa.control_generator import ControlGenerator, Controls
from planners.rrt_star_woa.local_steering import GOAL_HIDDEN_COST, NODE_HIDDEN_COST
from planners.rrt_star_woa.path_shortening import scatter_in_ellipses
from planners.rrt_star_woa.thesis import ThesisFile
from planners.rrt_star_woa.woa import WhaleParameters, move, new_whales, tell
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.errors import InputError, shorten
from wheelchair_gym.compiled.random import Stream, stream
from wheelchair_gym.geometry import kinematics, outline, planar
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import arc_lengths, path_length, to_world
from wheelchair_gym.maps import occupied_polygons, read_grid
from wheelchair_gym.rendering import PlanPicture
from wheelchair_gym.rendering.canvas import Image
from wheelchair_gym.rendering.palette import BLUE, GREEN, ORANGE, PURPLE, VERMILION, Colour
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.types import Mission

OUR_MAPS: Final = ("1", "2", "3", "4", "5")  # drawn to the thesis's text


class Drawn(NamedTuple):
    """A map as the thesis's program sees it, and what is asked there."""

    problem: Problem  # among the dilated polygons
    solid: list[Array]  # loops (k, 2) [m] round what is solid before the dilation
    kept_free: list[Array]  # loops round that and what the dilation adds; none without dilation

    @classmethod
    def of(cls, problem: Problem) -> Self:
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


# Words, colour, and a path (n, 2) or a point (1, 2) [m].
Whale = tuple[str, Colour, Array]

# By whether a whale sees the node to extend, and the goal.
SIGHT: Final = {
    (False, False): ("sees neither", VERMILION),
    (True, False): ("sees the node", BLUE),
    (False, True): ("sees the goal", ORANGE),
    (True, True): ("sees both", GREEN),
}


def paths_of_whales(
    planner: Any, problem: Problem, path: Array, rng: np.random.Generator
) -> Iterator[list[Whale]]:
    """The whales of the global variant around the tree's path, before each move and at the end.

    With the generator as the tree leaves it, these are the whales of the plan.
    """
    space, n, best = problem.free.arrays, len(path) - 2, path
    if n < 1:
        return
    bounds, state = (planner.width_bound, planner.height_bound), stream(rng)
    population = scatter_in_ellipses(planner.whales.population, n, *bounds, state)

    def costs_of(shifts: Array) -> tuple[Array, list[Whale]]:
        whales = [np.vstack([path[:1], path[1:-1] + of.reshape(n, 2), path[-1:]]) for of in shifts]
        lengths = np.array([path_length(whale) for whale in whales])
        blocked = np.array([blocked_edges(space, whale).sum() for whale in whales])
        found: list[Whale] = [
            ("blocked path", VERMILION, whale) if hit else ("free path", BLUE, whale)
            for whale, hit in zip(whales, blocked, strict=True)
        ]
        costs = planner.shortness_weight * lengths + planner.collision_free_weight * blocked
        return costs, found

    for found, _ in _swim(
        planner.whales.parameters, population, np.tile(bounds, n), state, costs_of
    ):
        of = [] if planner.whales.leader == "latest" else [best]
        free = [*of, *(whale for words, _, whale in found if words == "free path")]
        best = min(free, key=path_length, default=path)
        yield [*found, ("best free path", GREEN, best)]


def points_of_whales(
    planner: Any, problem: Problem, node: Array, sample: Array, rng: np.random.Generator
) -> Iterator[list[Whale]]:
    """The whales of the local variant around a sample (2,) [m], before each move and at the end.

    They extend a node (2,) [m] of the tree; those of the planner itself are other draws.
    """
    space, goal, state = problem.free.arrays, problem.goal[:2], stream(rng)
    w, h = planner.width_bound, planner.height_bound
    # The first of a scattered population is not shifted.
    population = scatter_in_ellipses(planner.whales.population + 1, 1, w, h, state)[1:].copy()

    def costs_of(shifts: Array) -> tuple[Array, list[Whale]]:
        whales = sample + shifts
        near, far = (
            np.array([not blocked_edges(space, np.vstack([end, whale])).any() for whale in whales])
            for end in (node, goal)
        )
        costs = np.hypot(*shifts.T) + planner.goal_weight * np.hypot(*(whales - goal).T)
        found = [
            (*SIGHT[bool(a), bool(b)], w[None]) for a, b, w in zip(near, far, whales, strict=True)
        ]
        return costs + NODE_HIDDEN_COST * ~near + GOAL_HIDDEN_COST * ~far, found

    for found, leader in _swim(
        planner.whales.parameters, population, np.array([w, h]), state, costs_of
    ):
        yield [*found, ("best whale", PURPLE, (sample + leader)[None])]


def _swim(
    parameters: WhaleParameters, population: Array, upper: Array, state: Stream,
    costs_of: Callable[[Array], tuple[Array, list[Whale]]],
) -> Iterator[tuple[list[Whale], Array]]:  # fmt: skip
    """Move a population as algorithm 3 does; yield the whales with colours, and the leader."""
    whales = new_whales(population, parameters, -upper, upper)
    for t in range(parameters.iterations + 1):
        costs, found = costs_of(population)
        for i, cost in enumerate(costs):
            tell(whales, i, cost)
        yield found, whales.leader
        if t < parameters.iterations:
            move(whales, t / parameters.iterations, state)


RATE: Final = 15.0  # pictures of a film a second
GROWTH, SWARM, DRIVE = 60, 60, 120  # pictures of the tree, of whales and of the roll-out, at most
SPACING: Final = 0.9  # m between the footprints drawn along a path or a roll-out
_SAMPLES = 40
SHORTENS, STEERS = "rrt_star_woa_global", "rrt_star_woa_local"  # planners whose whales are drawn


@dataclass(frozen=True)
class PlanPictures:
    """The pictures of a plan that a planner made with a seed."""

    drawn: Drawn
    planner: Any
    plan: Plan
    seed: int | Sequence[int]
    made: Controls | None = None  # the commands that lead along the path
    size: int | tuple[int, int] = 640  # of the pictures of a film, as `PlanPicture.draw` takes it

    @classmethod
    def of_drive(cls, driver: PlannedDriver, mission: Mission, **more: Any) -> Self:
        """Return the pictures of a plan to a policy's goal from its start, on a given map.

        Planner, clearance and seed are those of the policy's own plan. That has other random draws
        where the policy tried several clearances, or ends, before.
        """
        assert mission.map is not None
        space, start = Space.from_grid(mission.map), np.asarray(mission.reading.pose)
        drawn = Drawn.of(Problem(space, start, driver.goal, driver.answer.clearance))
        seed, planner = (driver.config.seed, mission.key), make_planner(dict(driver.config.planner))
        plan = planner.plan(drawn.problem, np.random.default_rng(seed))
        made = controls_of(drawn, plan, 0) if len(plan.path) > 1 else None
        return cls(drawn, planner, plan, seed, made, **more)

    @cached_property
    def _name(self) -> str | None:
        rotated = self.drawn.problem.space.in_frame is not self.drawn.problem.space
        return None if rotated else PLANNERS.name_of(self.planner)

    @cached_property
    def _shortening(self) -> tuple[Plan, list[list[Whale]]]:
        """The plan of the tree alone, and the whales that shorten its path."""
        if self._name != SHORTENS:
            return self.plan, []
        rng, problem = np.random.default_rng(self.seed), self.drawn.problem
        raw = self.planner.tree.plan(problem, rng)
        return raw, [*paths_of_whales(self.planner, problem, raw.path, rng)]

    def _steering(self, part: Plan, number: int) -> list[Whale]:
        """The whales of a local variant around the random sample of a number."""
        if self._name != STEERS or not len(part.tree):
            return []
        problem = self.drawn.problem
        rng = np.random.default_rng([*np.atleast_1d(self.seed), number])
        x0, y0, x1, y1 = problem.space.bounds
        sample, nodes = rng.uniform((x0, y0), (x1, y1)), part.tree.reshape(-1, 2)
        node = nodes[np.hypot(*(nodes - sample).T).argmin()]
        found = [*points_of_whales(self.planner, problem, node, sample, rng)]
        return found[number % len(found)]

    def draw(self, caption: str) -> Image:
        """Map, tree, path and roll-out with a legend (h, w, 3); whales in a picture above it."""
        raw, whales = self._shortening
        more: dict[str, Any] = {"raw": raw.path if whales else None}
        if whales:
            swarm = whales[3 * len(whales) // 4]
        else:  # around the random sample at which most kinds of whales are seen
            swarms = (self._steering(self.plan, k) for k in range(_SAMPLES))
            swarm = max(swarms, key=lambda whales: len({words for words, _, _ in whales}))
        panels = []
        if swarm:
            bare = replace(raw, path=raw.path[:0]) if whales else raw
            panels = [self._shown(bare, 0, swarm=swarm, **more).draw(720, legend=True)]
        if self.made is None:
            best = make_planner("visibility").plan(self.drawn.problem, np.random.default_rng(0))
            more["optimum"] = best.path if len(best.path) else None
        last = self._shown(self.plan, **more).draw(720 if swarm else 960, caption, legend=True)
        return np.vstack([*panels, last])

    def film(self) -> Iterator[Image]:
        """Pictures (h, w, 3) at `RATE`: the tree, the whales, the roll-out; the last for 1 s."""
        raw, whales = self._shortening
        tree = self.planner.tree if whales else self.planner
        for k, part in enumerate(growth(self.drawn.problem, tree, raw, self.seed)):
            said = f"tree, {part.counters.get('iterations', 0)} samples"
            shown = self._shown(part, 0, swarm=self._steering(part, k))
            yield (picture := shown.draw(self.size, said))
        bare = replace(raw, path=raw.path[:0])
        for t in _frames(len(whales), SWARM):
            shown = self._shown(bare, 0, swarm=whales[t], raw=raw.path)
            yield (picture := shown.draw(self.size, f"whales, iteration {t}"))
        times = () if self.made is None else self.made.times
        for k in _frames(len(times), DRIVE):
            shown = self._shown(self.plan, k + 1)
            yield (picture := shown.draw(self.size, f"commands, {times[k]:.1f} s"))
        yield from [picture] * round(RATE)

    def _shown(self, plan: Plan, poses: int | None = None, **more: Any) -> PlanPicture:
        """A plan with the first poses of the roll-out, or with all; then also all footprints."""
        problem = self.drawn.problem
        rollout = None if self.made is None else self.made.rollout[:poses]
        outlines = _footprints(problem, plan.path if rollout is None else rollout, self.planner)
        if rollout is not None and poses is not None:
            outlines = outlines[-1:]
        return PlanPicture(
            problem.space.bounds, problem.start, problem.goal, plan.path, plan.tree,
            polygons=self.drawn.solid, inflated=self.drawn.kept_free, rollout=rollout,
            outlines=outlines, **more,
        )  # fmt: skip


def _frames(count: int, maximum: int) -> list[int]:
    """Return numbers below a count, evenly spaced, at most `maximum` of them."""
    return [round(k) for k in np.linspace(0, count - 1, min(count, maximum)).tolist()]


def growth(
    problem: Problem, planner: Any, plan: Plan, seed: Any, frames: int | None = None
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


def _footprints(problem: Problem, path: Array, planner: Any) -> list[Array]:
    """Footprints (k, 2) [m] about every `SPACING` of a path or a roll-out, and at its ends.

    A path with headings has the planner's footprint, another one the disc of the clearance.
    """
    if not len(path):
        return []
    way = arc_lengths(path)
    stops = np.linspace(0.0, way[-1], max(2, round(way[-1] / SPACING) + 1))
    if path.shape[1] == 3:
        corners = getattr(planner, "footprint", Footprint()).corners
        return [to_world(corners, path[k]) for k in np.abs(way[:, None] - stops).argmin(axis=0)]
    if problem.clearance == 0.0:
        return []
    around = np.linspace(0.0, 2.0 * np.pi, 49)[:-1]
    disc = problem.clearance * np.stack([np.cos(around), np.sin(around)], axis=-1)
    places = np.stack([np.interp(stops, way, path[:, axis]) for axis in range(2)], axis=-1)
    return [place + disc for place in places]

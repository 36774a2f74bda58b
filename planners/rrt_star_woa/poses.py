"""RRT*-WOA for the footprint: the planner `se2_rrt_star_woa` in (x, y, yaw).

Two trees of poses make the first path (`pose_tree`). Rounds of RRT*, of shortcuts and of whales
make it cheaper. A whale is the shifts of some poses of a window of the path, all of them jointly,
and costs what connections through these poses cost. From top to bottom: the cost of a whale, the
search of whales, the rounds, and the planner.
"""

import math
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from planners.collision.footprint import FootprintPlanner, goal_poses, start_and_goal
from planners.collision.nearby import Nearby, nearby, passage_poses
from planners.problem import Plan, Problem, Status, remaining
from planners.rrt_star_woa.woa import Whales, WhaleSettings, move, new_whales, tell
from planners.smoothing.shortcut import resample, shortcut
from planners.steering import LONGEST_PIECE, SteeringContext, connect, new_context, poses_along
from planners.trees.pose_tree import (
    MIN_GAIN,
    Path,
    Search,
    grow,
    kind_before,
    new_search,
    pose_of,
    rewire,
    splice,
    window_cost,
)
from planners.trees.rrt_star import InformedRrtStar
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.compiled.random import Stream, next_uniform, stream

MAX_POSES = 64  # largest number of poses that whales move jointly
WINDOW: Final = 25  # pieces, 5 m: longest part of the path that local whales or a shortcut replace
SHORTCUTS: Final = 16  # tried in a round
SPACING: Final = 6  # pieces, 1.2 m: about the distance of the poses that whales move jointly
MIN_SCALE = 0.02  # of the bounds
SHRINK, GROW = 0.8, 1.3  # factors of the scale after a search without and with a gain
GUIDE = InformedRrtStar(iterations=2_000)  # planner of the disc's path
GUIDE_SPACING = 0.1  # m
TREE_SHARE, SHORTCUT_SHARE = 1.0, 1.0  # of the rounds: samples of RRT*, and shortcuts; tuned
ROOTS = 24  # approximate number of headings at a goal without heading that are roots of a tree
CHUNK = 4  # iterations between two readings of the clock
SHARPEST_TURN = 1.6  # 1/m: largest curvature of arcs, as of `lattice`; sharper turns are pivots
SHIFT_BOUND = 0.4  # m: largest shift of a pose by whales; it shrinks while they find nothing
TURN_BOUND = 0.5  # rad: largest turn of a pose by whales
_TUNED = "tuned on training seeds"


class Refinement(NamedTuple):
    """Whales that shift poses of a path, in the frames of these poses, and shares of rounds."""

    whales: Whales  # (k, 3 MAX_POSES) m, m, rad
    bounds: Array  # (3,) largest shift ahead and aside [m], and turn [rad]
    scale: Array  # (1,) of the bounds
    tree: float  # share of the rounds of RRT*
    shortcuts: float  # share of these and of the rounds of shortcuts; the rest are of whales


@borrowing_kernel
def via_cost(
    context: SteeringContext, path: Path, i: int, j: int, shifts: Array, turned: float,
    budget: float,
) -> tuple[int, float]:  # fmt: skip
    """Write connections through shifted poses of a window to `context.candidate`.

    The shifts (3 k,) [m, m, rad] are in the frames of k poses, which share the window evenly; with
    none it is one connection. Each pose is `turned` [rad], too. Returns the number of pieces and
    the cost [s], which is infinite where the connections are not free below the budget.
    """
    pieces, poses = path.pieces, shifts.shape[0] // 3
    pose, before = pose_of(pieces[i]), kind_before(path, i)
    cost, count = 0.0, 0
    for k in range(poses + 1):
        if k < poses:
            on = pieces[i + ((k + 1) * (j - i)) // (poses + 1)]
            c, s = math.cos(on.yaw), math.sin(on.yaw)
            ahead, aside = shifts[3 * k], shifts[3 * k + 1]
            x, y = on.x + c * ahead - s * aside, on.y + s * ahead + c * aside
            target, after = (x, y, on.yaw + turned + shifts[3 * k + 2]), 0
        else:
            yaw = path.goal[2] if j == path.size[0] else pieces[j].yaw
            target, after = (pieces[j].x, pieces[j].y, yaw), int(pieces[j].kind)
        kind, made, more = connect(context, pose, before, target, after, budget - cost, count)
        if kind < 0:
            return 0, math.inf
        cost += more
        count += made
        if count > 0:
            before = int(context.candidate[count - 1].kind)
        pose = target
    return count, cost


@borrowing_kernel
def replace_window(
    context: SteeringContext, path: Path, i: int, j: int, shifts: Array, turned: float
) -> bool:
    """Replace a window by connections through shifted poses if that is cheaper; see `via_cost`."""
    old = window_cost(context.around.motion, path, i, j)
    count, cost = via_cost(context, path, i, j, shifts, turned, old - MIN_GAIN)
    return cost < old and splice(path, context.around.motion, i, j, context.candidate, count)


@borrowing_kernel
def search_vias(
    context: SteeringContext, path: Path, refinement: Refinement, i: int, j: int, poses: int,
    turned: float, state: Stream,
) -> int:  # fmt: skip
    """Replace a window by connections through poses that whales shift; return the evaluations.

    The first leader is the path itself: all shifts are 0. Bounds shrink if nothing is found. With
    the poses turned by pi, the chair turns round and drives forward instead of backward.
    """
    every, scale, d = refinement.whales, refinement.scale[0], 3 * poses
    whales = Whales(
        every.population[:, :d], every.leader[:d], every.leader_cost, every.c_range[:d],
        every.lower[:d], every.upper[:d], every.parameters,
    )  # fmt: skip
    population, parameters, made = whales.population, whales.parameters, 0
    for k in range(d):
        bound = scale * refinement.bounds[k % 3]
        whales.leader[k], whales.lower[k], whales.upper[k] = 0.0, -bound, bound
    for whale in range(parameters.population):
        for k in range(d):
            low, high = whales.lower[k], whales.upper[k]
            drawn = low + (high - low) * next_uniform(state)
            population[whale, k] = drawn if whale > 0 else 0.0
    old = window_cost(context.around.motion, path, i, j)
    whales.leader_cost[0] = old - MIN_GAIN
    for t in range(parameters.iterations + 1):
        for whale in range(parameters.population):
            _, cost = via_cost(
                context, path, i, j, population[whale], turned, whales.leader_cost[0]
            )
            tell(whales, whale, cost)
            made += 1
        if t < parameters.iterations:
            move(whales, t / parameters.iterations, state)
    found = whales.leader_cost[0] < old - MIN_GAIN
    if found:
        found = replace_window(context, path, i, j, whales.leader, turned)
    if turned == 0.0:
        factor = GROW if found else SHRINK
        refinement.scale[0] = min(1.0, max(MIN_SCALE, factor * scale))
    return made


@borrowing_kernel
def refine(search: Search, refinement: Refinement, state: Stream) -> None:
    """Run one round: of RRT*, of shortcuts, or of whales, drawn by their shares."""
    path, run = search.path, search.run[0]
    drawn = next_uniform(state)
    n = int(path.size[0])
    if drawn < refinement.tree:
        rewire(search, state)
    elif drawn < refinement.shortcuts:
        for _ in range(SHORTCUTS):
            n = int(path.size[0])
            i = int(next_uniform(state) * n)
            j = min(n, i + 1 + int(next_uniform(state) * WINDOW))
            replace_window(search.context, path, i, j, refinement.whales.leader[:0], 0.0)
    else:
        span = 2 + int(next_uniform(state) * (WINDOW - 1))
        i = int(next_uniform(state) * n)
        j = min(n, i + span)
        poses, turned = min(1, j - i - 1), 0.0
        if path.pieces[i].kind == -1:  # back: what if the chair turned round?
            while j < n and path.pieces[j].kind == -1 and next_uniform(state) < 0.95:
                j += 1
            poses = min(MAX_POSES, min(j - i - 1, 1 + (j - i) // SPACING))
            turned = math.pi
        if poses > 0:
            run.local_evaluations += search_vias(
                search.context, path, refinement, i, j, poses, turned, state
            )


@kernel
def advance(search: Search, refinement: Refinement, until: int, stop: bool, state: Stream) -> None:
    """Run iterations up to a number, or, if `stop` is true, up to a first path."""
    run = search.run[0]
    while run.iteration < until:
        if run.refining == 0:
            grow(search, state)
        else:
            refine(search, refinement, state)
        run.iteration += 1
        if stop and run.first_path > 0:
            return


@settings
class Se2RrtStarWoa(FootprintPlanner):
    """A path (n, 3) with headings for the chair's rectangle, by RRT* over poses and whales.

    RRT*-WOA of the thesis in the space of the chair. A path of the disc within the outline guides
    samples; two trees of poses make the first path. Then rounds of RRT*, of shortcuts and of whales
    improve it, by their shares.
    """

    obstacle_weight: float = setting(default=6.0, low=0.0, source=_TUNED)
    """Additional cost of a move without clearance, as a multiple of its time."""
    pivot_speed_ratio: float = setting(
        default=0.2, low=0.05, high=1.0, source="rear corners may sweep unseen floor at 0.1 m/s"
    )
    """Turn rate of pivots as a share of the limit."""
    whales: WhaleSettings = setting(default=WhaleSettings(population=8, iterations=4))
    """The swarms."""
    iterations: int = setting(default=15_000, low=0)
    """Largest number of iterations: of samples up to the first paths, then of rounds."""
    improvement: int = setting(default=200, low=0)
    """Rounds after the search for first paths; with a deadline a large number is anytime."""
    local_share: float = setting(default=1.0, low=0.0, source=_TUNED)
    """Share of the rounds of whales that move poses of a window of the path; of RRT* and of
    shortcuts it is 1."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return the cheapest path of all rounds; `first_path` is the first one's iteration."""
        began = clock()
        start, goal = start_and_goal(problem)
        reach = self.footprint.reach + LONGEST_PIECE + self.desired_clearance
        near = nearby(problem.space, reach)
        status, motion = self.fit(problem, near)
        if status is not None:
            return Plan(status)
        if np.array_equal(start[: len(goal)], goal):
            return Plan(Status.SOLVED, np.stack([start, start]))
        state = stream(rng)
        guide, guide_iterations = self._guide(problem, near, motion.margin, rng, end)
        guided_s = clock() - began
        context = new_context(near, motion, SHARPEST_TURN)
        goals = goal_poses(context.around, goal, ROOTS)
        search, parameters = new_search(context, start, goal, goals, guide), self.whales.parameters
        whales = new_whales(
            np.zeros((parameters.population, 3 * MAX_POSES)), parameters,
            np.zeros(3 * MAX_POSES), np.zeros(3 * MAX_POSES),
        )  # fmt: skip
        shares = TREE_SHARE, SHORTCUT_SHARE, self.local_share
        tree, shortcuts, _ = np.cumsum(shares) / max(sum(shares), 1e-9)
        bounds = np.array([SHIFT_BOUND, SHIFT_BOUND, TURN_BOUND])
        refinement = Refinement(whales, bounds, np.ones(1), float(tree), float(shortcuts))
        run, path = search.run[0], search.path
        first_s, maximum = math.inf, self.iterations if len(goals) else 0
        while run["iteration"] < maximum and clock() < end:
            until = min(maximum, int(run["iteration"]) + CHUNK)
            advance(search, refinement, until, run["first_path"] == 0, state)
            if run["first_path"] and first_s == math.inf:
                first_s = clock() - began
            if run["refining"]:
                maximum = min(maximum, int(run["refining"]) + self.improvement)
        solved = path.size[0] > 0
        return Plan(
            Status.SOLVED if solved else Status.EXHAUSTED,
            poses_along(path.pieces[: path.size[0] + 1]) if solved else np.empty((0, 3)),
            counters={
                "iterations": int(run["iteration"]),
                "guide_iterations": guide_iterations,
                "nodes": int(search.start_tree.size[0] + search.goal_tree.size[0]),
                "first_path": int(run["first_path"]),
                "local_evaluations": int(run["local_evaluations"]),
            },
            timings={"guided_s": guided_s, "first_path_s": first_s},
        )

    def _guide(
        self, problem: Problem, near: Nearby, margin: float, rng: np.random.Generator, end: float
    ) -> tuple[Array, int]:
        """Return poses (n, 3) along the path of the inscribed disc, if any, and iterations."""
        footprint = self.footprint
        radius = min(footprint.front, footprint.rear, footprint.half_width) + margin
        disc = replace(problem, start=problem.start[:2], goal=problem.goal[:2], clearance=radius)
        plan = GUIDE.plan(disc, rng, remaining(end))
        iterations = plan.counters.get("iterations", 0)
        if plan.status is not Status.SOLVED or plan.length < GUIDE_SPACING:
            return np.empty((0, 3)), iterations
        points = resample(shortcut(plan.path, disc.free), GUIDE_SPACING)
        steps = np.gradient(points, axis=0)
        guide = np.column_stack([points, np.arctan2(steps[:, 1], steps[:, 0])])
        return np.vstack([guide, passage_poses(near, guide, footprint.front)]), iterations

"""The planner RRT*-WOA in SE(2), as settings; `pose_tree` has the search."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from planners.collision.connections import MIN_GAP, fit_ends, goal_poses, start_and_goal
from planners.collision.nearby import Nearby, nearby, passage_poses
from planners.problem import Plan, PlannerBase, Problem, Status, check, remaining
from planners.rrt_star_woa.woa import WhaleSettings
from planners.smoothing.shortcut import resample, shortcut
from planners.trees.pose_path import (
    LONGEST_PIECE,
    new_drive,
    new_path,
    new_pose_whales,
    poses_of_path,
)
from planners.trees.pose_tree import (
    NEIGHBOURS,
    NODE,
    NONE,
    RUN,
    Options,
    Search,
    Tree,
    add_pose,
    advance,
)
from planners.trees.settings import InformedRrtStar
from wheelchair_gym.arrays import Array
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.config import setting, settings
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.kinematics import Limits
from wheelchair_gym.maps.driving_cost import DrivingCost, MotionCost
from wheelchair_gym.random import stream

GUIDE_SPACING = 0.1  # m
POSE_SPACING = 0.05  # m, and rad of a pivot times 2: between poses of the path
ROOTS = 24  # about so many headings at a goal without one are roots of a tree
CHUNK = 4  # iterations between two readings of the clock
NODES = 10_000  # of a tree at most
SHARPEST_TURN = 1.6  # 1/m: greatest curvature of arcs, as of `lattice`; sharper turns are pivots
SHIFT_BOUND = 0.4  # m: largest shift of a pose by whales; it shrinks while they find nothing
TURN_BOUND = 0.5  # rad: largest turn of a pose by whales
_DESIGN = "design choice"
_TUNED = "tuned on training seeds"


@settings
class Se2RrtStarWoa(DrivingCost, PlannerBase):
    """A path (n, 3) with headings for the chair's rectangle, by RRT* over poses and whales.

    RRT*-WOA of the thesis in the space of the chair. The rectangle keeps the problem's clearance
    less half its width. A start without heading has heading 0; a goal without heading allows any.
    A path of the disc within the outline guides samples; two trees of poses make the first path.
    Then rounds of RRT*, of shortcuts and of whales improve it, by their shares.
    """

    obstacle_weight: float = setting(default=6.0, low=0.0, source=_TUNED)
    """Additional cost of a move without clearance, as a multiple of its time."""
    pivot_speed_ratio: float = setting(
        default=0.2,
        low=0.05,
        high=1.0,
        source="rear corners may sweep unseen floor at 0.1 m/s",
    )
    """Turn rate of pivots as a share of the limit."""
    footprint: Footprint = Footprint()
    limits: Limits = Limits()
    guide: InformedRrtStar = setting(default=InformedRrtStar(iterations=2_000), source=_DESIGN)
    """The planner of the disc's path."""
    whales: WhaleSettings = setting(
        default=WhaleSettings(population=8, iterations=4), source=_DESIGN
    )
    """The swarms."""
    iterations: int = setting(default=15_000, low=0, source=_DESIGN)
    """Largest number of iterations: of samples up to the first paths, then of rounds."""
    improvement: int = setting(default=200, low=0, source=_DESIGN)
    """Rounds after the first path; with a deadline, make it large for an anytime planner."""
    tree_share: float = setting(default=1.0, low=0.0, source=_TUNED)
    """Share of the rounds that are samples of RRT*."""
    shortcut_share: float = setting(default=1.0, low=0.0, source=_TUNED)
    """Share of the rounds that are shortcuts."""
    local_share: float = setting(default=1.0, low=0.0, source=_TUNED)
    """Share of the rounds of whales that move poses of a window of the path."""

    def trivial(self, problem: Problem) -> Plan | None:
        """The plan where the axle cannot stand at an end; the rectangle is tested later."""
        status = check(replace(problem, clearance=0.0 * problem.clearance))  # NaN stays NaN
        return None if status is None else Plan(status)

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """The cheapest path of all rounds; the counter `first_path` is its first iteration."""
        began = clock()
        start, goal = start_and_goal(problem)
        reach = self.footprint.reach + LONGEST_PIECE + self.desired_clearance
        near = nearby(problem.space, reach)
        margin = max(MIN_GAP, problem.clearance - self.footprint.half_width)
        motion = self.motion_cost(self.footprint, self.limits, margin)
        status, motion = fit_ends(problem, self.footprint, near, motion)
        if status is not None:
            return Plan(status)
        if np.array_equal(start[: len(goal)], goal):
            return Plan(Status.SOLVED, np.stack([start, start]))
        state = stream(rng)
        guide, guide_iterations = self._guide(problem, near, motion.margin, rng, end)
        guided_s = clock() - began
        goals = goal_poses(near, motion, goal, ROOTS)
        search = self._search(near, motion, start, goal, goals, guide)
        run, path = search.run[0], search.path
        first_s, most = math.inf, self.iterations if len(goals) else 0
        while run["iteration"] < most and clock() < end:
            until = min(most, int(run["iteration"]) + CHUNK)
            advance(search, until, run["first_path"] == 0, state)
            if run["first_path"] and first_s == math.inf:
                first_s = clock() - began
            if run["refining"]:
                most = min(most, int(run["refining"]) + self.improvement)
        solved = path.size[0] > 0
        return Plan(
            Status.SOLVED if solved else Status.EXHAUSTED,
            poses_of_path(path, POSE_SPACING) if solved else np.empty((0, 3)),
            counters={
                "iterations": int(run["iteration"]),
                "guide_iterations": guide_iterations,
                "nodes": int(search.start_tree.size[0] + search.goal_tree.size[0]),
                "first_path": int(run["first_path"]),
                "local_evaluations": int(run["local_evaluations"]),
            },
            timings={"guided_s": guided_s, "first_path_s": first_s},
        )

    def _search(
        self, near: Nearby, motion: MotionCost, start: Array, goal: Array, goals: Array,
        guide: Array,
    ) -> Search:  # fmt: skip
        """A search that has not begun."""
        bounds = SHIFT_BOUND, SHIFT_BOUND, TURN_BOUND
        search = Search(
            new_drive(near, motion, SHARPEST_TURN),
            self._tree(start[None], 1.0), self._tree(goals, -1.0),
            new_path(goal), new_pose_whales(self.whales.parameters, bounds), guide,
            self._options(), np.zeros(1, RUN), np.zeros(3),
            np.zeros(NEIGHBOURS, np.int64), np.zeros(NEIGHBOURS), np.zeros(NODES + 1, np.int64),
            np.zeros(0),
        )  # fmt: skip
        search.run["synced"], search.run["goals"] = math.inf, len(goals)
        return search

    def _guide(
        self, problem: Problem, near: Nearby, margin: float, rng: np.random.Generator, end: float
    ) -> tuple[Array, int]:
        """Poses (n, 3) along the path of the disc within the outline, if there is one."""
        footprint = self.footprint
        radius = min(footprint.front, footprint.rear, footprint.half_width) + margin
        disc = replace(problem, start=problem.start[:2], goal=problem.goal[:2], clearance=radius)
        plan = self.guide.plan(disc, rng, remaining(end))
        iterations = plan.counters.get("iterations", 0)
        if plan.status is not Status.SOLVED or plan.length < GUIDE_SPACING:
            return np.empty((0, 3)), iterations
        points = resample(shortcut(plan.path, disc.free), GUIDE_SPACING)
        steps = np.gradient(points, axis=0)
        guide = np.column_stack([points, np.arctan2(steps[:, 1], steps[:, 0])])
        return np.vstack([guide, passage_poses(near, guide, footprint.front)]), iterations

    def _tree(self, roots: Array, sign: float) -> Tree:
        tree = Tree(np.zeros(NODES, NODE), np.zeros(1, np.int64), sign)
        for x, y, yaw in roots:
            add_pose(tree, x, y, yaw, NONE)
        return tree

    def _options(self) -> Options:
        shares = self.tree_share, self.shortcut_share, self.local_share
        tree, shortcuts, _ = np.cumsum(shares) / max(sum(shares), 1e-9)
        return Options(float(tree), float(shortcuts))

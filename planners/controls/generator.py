"""The control generator: from a path to commands (v, w, t) that the chair can drive.

Segment by segment a swarm searches the commands whose roll-out ends where the segment ends, turned
towards the next one, soon, and away from obstacles (thesis, section 2.9.3 and algorithm 6). Each
segment's commands leave room to come to rest, so that a chair that drives them is never trapped in
motion: where nothing leads on, the commands end at rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planners.controls.maneuver import Aims, Leg, bridge
from planners.controls.rollout import INTEREST, World, brake, drive, look, motion_at, rollout
from planners.swarm.woa import WhaleParameters, WhaleSettings
from wheelchair_gym.compiled.kernel import kernel
from wheelchair_gym.config import setting, settings
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.kinematics import Limits
from wheelchair_gym.random import Stream, stream

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Controls:
    """Commands, and where they take the chair."""

    commands: Array  # (k, 3) m/s, rad/s, s
    rollout: Array  # (n, 3) m, m, rad: poses on the way, the start first
    twists: Array  # (n, 2) m/s, rad/s
    times: Array  # (n,) s
    collision_free: bool  # the outline touches nothing on the way
    arrived: bool  # at rest at the path's end, or led on as far as the horizon
    error: float  # m, from that end: of the last pose, or of the nearest where a horizon ends it

    def twist_at(self, time: float) -> Array:
        """The twist (2,) to ask for at a time [s] since the start; at rest after the end."""
        k = int(np.searchsorted(np.cumsum(self.commands[:, 2]), time, side="right"))
        return self.commands[k, :2].copy() if k < len(self.commands) else np.zeros(2)


@kernel
def around(walls: Array, box: Array) -> Array:
    """The walls (k, 4) whose own boxes meet a box (4,) xmin, ymin, xmax, ymax [m]."""
    kept = np.empty_like(walls)
    n = 0
    for k in range(walls.shape[0]):
        ax, ay, bx, by = walls[k, 0], walls[k, 1], walls[k, 2], walls[k, 3]
        if (
            max(ax, bx) >= box[0]
            and min(ax, bx) <= box[2]
            and max(ay, by) >= box[1]
            and min(ay, by) <= box[3]
        ):
            kept[n] = walls[k]
            n += 1
    return kept[:n].copy()


@kernel
def follow(
    targets: Array,
    start: Array,
    whole: World,
    roam: float,
    to_rest: bool,
    aims: Aims,
    swarm: WhaleParameters,
    state: Stream,
) -> tuple[Array, int, bool]:
    """Commands (k, 3) through targets (n, 2) [m]; the targets reached, and whether all was free.

    Args:
        targets: where the segments end.
        start: the motion at the beginning.
        whole: the chair and all its surroundings.
        roam: how far off a segment the axle may go [m].
        to_rest: whether the chair comes to rest at the last target, or may still be in motion.
        aims: what commands are worth.
        swarm: the whales.
        state: stream of random numbers.
    """
    n = targets.shape[0]
    commands = np.empty((8 * n + 1, 3))
    count = 0
    motions = start.copy()
    motion = motions[0]
    reach = math.hypot(max(whole.footprint[0], whole.footprint[1]), whole.footprint[2])
    reached = 0
    while reached < n:
        x, y = targets[reached, 0], targets[reached, 1]
        box = np.array(
            [
                min(x, motion.x) - roam,
                min(y, motion.y) - roam,
                max(x, motion.x) + roam,
                max(y, motion.y) + roam,
            ]
        )
        far = reach + 2.0 * INTEREST
        known = box + np.array([-far, -far, far, far])
        world = World(
            around(whole.walls, known),
            whole.discs,
            box,
            whole.footprint,
            whole.limits,
            whole.margin,
        )
        onward = math.atan2(y - motion.y, x - motion.x)
        if reached + 1 < n:
            onward = math.atan2(targets[reached + 1, 1] - y, targets[reached + 1, 0] - x)
        leg = Leg(x, y, onward, to_rest and reached + 1 == n)
        found, free = bridge(motions, leg, world, aims, swarm, state)
        if not free:
            break
        for k in range(found.shape[0]):
            if found[k, 2] > 1e-3:
                drive(motion, found[k, 0], found[k, 1], found[k, 2], world)
                commands[count] = found[k]
                count += 1
        reached += 1
    rest = brake(motion, whole)
    if rest > 0.0:
        commands[count] = 0.0, 0.0, rest
        count += 1
    return commands[:count].copy(), reached, bool(motion.free)


def simplified(path: Array, tolerance: float) -> Array:
    """A path (n, 2) by fewer of its points; none left out lies farther off than the tolerance [m].

    Douglas and Peucker 1973.
    """
    if len(path) < 3:
        return path
    first, last = path[0], path[-1]
    along = last - first
    square = float(along @ along)
    part = np.clip((path - first) @ along / square, 0.0, 1.0) if square > 0 else np.zeros(len(path))
    off = np.hypot(*(path - first - part[:, None] * along).T)
    k = int(off.argmax())
    if off[k] <= tolerance:
        return path[[0, -1]]
    return np.vstack([simplified(path[: k + 1], tolerance)[:-1], simplified(path[k:], tolerance)])


def ahead(path: Array, position: Array, horizon: float | None) -> tuple[Array, bool]:
    """What of a path (n, 2) lies ahead of a position (2,), that first, up to a horizon [m].

    Returns:
        The points, and whether the last of them is the path's own end.
    """
    here, there = path[:-1], path[1:]
    along = there - here
    square = np.maximum((along**2).sum(axis=1), 1e-12)
    part = np.clip(((position - here) * along).sum(axis=1) / square, 0.0, 1.0)
    k = int(np.hypot(*(position - here - part[:, None] * along).T).argmin())
    rest = np.vstack([position, path[k + 1 :]])
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(rest, axis=0).T))])
    if horizon is None or way[-1] <= horizon:
        return rest, True
    end = [np.interp(horizon, way, rest[:, 0]), np.interp(horizon, way, rest[:, 1])]
    return np.vstack([rest[way < horizon], end]), False


@settings
class ControlGenerator:
    """How commands are searched, and what they are worth."""

    whales: WhaleSettings = setting(
        default=WhaleSettings(population=12, iterations=10), source="design choice"
    )
    """The swarm that searches the commands of a segment."""
    horizon: float | None = setting(default=None, unit="m", low=0.1, source="design choice")
    """Length of the path to follow; null for the whole path."""
    tolerance: float = setting(default=0.05, unit="m", low=0.0, source="design choice")
    """Distance from the simplified path up to which points are left out."""
    max_segment_length: float = setting(default=1.5, unit="m", low=0.1, source="design choice")
    """Longest segment."""
    min_first_segment_length: float = setting(
        default=0.25, unit="m", low=0.0, source="design choice"
    )
    """Shortest first segment."""
    search_range: float = setting(default=1.0, unit="m", low=0.0, source="design choice")
    """How far the commands of a segment may lead off it."""
    margin: float = setting(default=0.02, unit="m", low=0.0, source="design choice")
    """Least gap to obstacles."""
    desired_clearance: float = setting(
        default=0.15, unit="m", low=1e-3, high=0.5, source="design choice"
    )
    """Clearance from which on more costs no less."""
    end_weight: float = setting(
        default=10.0, unit="s/m", low=0.0, source="design choice: 5 cm cost 0.5 s"
    )
    """Cost of the distance from the end of a segment."""
    arrival_weight: float = setting(
        default=50.0, unit="s/m", low=0.0, source="design choice: 2 cm cost 1 s"
    )
    """Cost of the distance from the goal."""
    heading_weight: float = setting(
        default=1.5, unit="s/rad", low=0.0, source="duration of a turn in place, with its ramps"
    )
    """Cost of the heading error at the end of a segment."""
    time_weight: float = setting(default=1.0, low=0.0, source="unit of the other weights")
    """Cost of time."""
    clearance_weight: float = setting(default=2.0, unit="s", low=0.0, source="design choice")
    """Cost of a lack of clearance."""
    arrival: float = setting(
        default=0.10, unit="m", low=0.0, source="design choice: below the 0.30 m of the task"
    )
    """Distance from the goal that counts as arrived."""

    def targets(self, path: Array, start: Array) -> tuple[Array, bool]:
        """Ends (n, 2) of the segments to drive from a start (3,); is the last the path's end?"""
        points, to_rest = ahead(path, start[:2], self.horizon)
        near = np.hypot(*(points - start[:2]).T) < self.min_first_segment_length
        near[[0, -1]] = False
        begun = near.argmin() if near[1:].all() else 1 + int(near[1:].argmin())
        points = simplified(np.vstack([points[:1], points[begun:]]), self.tolerance)
        pieces = []
        for a, b in pairwise(points):
            k = max(1, math.ceil(math.hypot(*(b - a)) / self.max_segment_length))
            pieces.append(a + np.arange(1, k + 1)[:, None] / k * (b - a))
        return np.vstack(pieces), to_rest

    def generate(
        self,
        path: ArrayLike,
        start_pose: ArrayLike,
        walls: ArrayLike,
        discs: ArrayLike,
        footprint: Footprint,
        limits: Limits,
        rng: np.random.Generator,
        start_twist: ArrayLike = (0.0, 0.0),
    ) -> Controls:
        """Commands that drive a path from where the chair is.

        Args:
            path: points (n, 2 or 3) [m]; what lies behind the chair does not count.
            start_pose: (3,) m, m, rad.
            walls: segments (k, 4) [m].
            discs: (m, 3) m: x, y, radius.
            footprint: the chair's outline.
            limits: what it may be asked to do.
            rng: draws the numbers.
            start_twist: (2,) m/s, rad/s.

        Raises:
            ValueError: the path has fewer than two points.
        """
        points = np.asarray(path, dtype=np.float64)[:, :2]
        if len(points) < 2:
            raise ValueError(f"path has {len(points)} points; expected at least two")
        pose, twist = (np.array(v, dtype=np.float64) for v in (start_pose, start_twist))
        everywhere = np.array([-np.inf, -np.inf, np.inf, np.inf])
        world = World(
            np.ascontiguousarray(walls, dtype=np.float64).reshape(-1, 4),
            np.ascontiguousarray(discs, dtype=np.float64).reshape(-1, 3),
            everywhere,
            footprint.array,
            limits.array,
            self.margin,
        )
        start = motion_at(pose, twist)
        look(start[0], pose[0], pose[1], pose[2], world)
        if 0.0 < start[0]["gap"] < self.margin:  # already nearer: at least no nearer than now
            world = world._replace(margin=float(start[0]["gap"]) * 0.999)
            look(start[0], pose[0], pose[1], pose[2], world)
        targets, to_rest = self.targets(points, pose)
        aims = Aims(
            end=self.end_weight,
            arrival=self.arrival_weight,
            heading=self.heading_weight,
            time=self.time_weight,
            clearance=self.clearance_weight,
            comfortable=self.desired_clearance,
        )
        commands, reached, free = follow(
            targets,
            start,
            world,
            self.search_range,
            to_rest,
            aims,
            self.whales.parameters,
            stream(rng),
        )
        poses, twists, times = rollout(commands, pose, twist, world.limits)
        gaps = np.hypot(*(poses[:, :2] - targets[-1]).T)
        error = float(gaps[-1] if to_rest else gaps.min())
        arrived = reached == len(targets) and (not to_rest or error <= self.arrival)
        return Controls(commands, poses, twists, times, free, arrived, error)

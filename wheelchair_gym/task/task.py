"""The live task: what a policy may know while it drives; how its steps are seen and judged."""

from __future__ import annotations

import math
from collections.abc import Callable

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.config import InputError
from wheelchair_gym.geometry import path_length
from wheelchair_gym.maps import Geodesic, OccupancyGrid, geodesic
from wheelchair_gym.sensing.settings import SensorSettings
from wheelchair_gym.simulation.settings import ChairSettings
from wheelchair_gym.task.judge import TERMS, Verdict, reached, weigh
from wheelchair_gym.task.observe import (
    GOAL_REACH,
    PATH_REACH,
    bearing_to,
    look_ahead,
    pool,
    project,
    see,
)
from wheelchair_gym.task.settings import TaskSettings
from wheelchair_gym.types import Episode, Reading

Array = NDArray[np.float64]
Observation = dict[str, NDArray[np.float32]]
Guidance = Callable[["Task"], Array]  # a path (n, 2) [m] from the chair to the goal

TWIST_ROOM = 1.5  # a chair pushed or overshooting is seen up to this multiple of its limits


class Task:
    """Navigation to a goal; made once, begun anew each episode.

    Attributes:
        map: what the chair is told about the world.
        start: where the chair believed to be at the beginning (3,) [m, m, rad].
        goal: (3,) [m, m, rad].
        tolerance: [m].
        time_limit: [s].
        period: control period [s].
        footprint, limits, drive, sensors: settings of the chair.
        reading: the latest; its pose is the chair's own estimate.
        path: guidance (n, 2) [m], or None; a policy may set it, so that it is drawn.
        key: of the episode's randomness; seeds whatever a policy draws.
    """

    map: OccupancyGrid
    start: Array
    goal: Array
    reading: Reading
    key: int

    def __init__(
        self,
        settings: TaskSettings,
        chair: ChairSettings,
        sensors: SensorSettings,
        period: float,
        guidance: Guidance | None = None,
    ) -> None:
        if settings.beams > sensors.laser.beams:
            raise InputError(
                f"task.beams is {settings.beams}; the laser has only {sensors.laser.beams}"
            )
        self.settings = settings
        self.sensors = sensors
        self.footprint, self.limits, self.drive = chair.footprint, chair.limits, chair.drive
        self.period = period
        self.guidance = guidance
        self.tolerance = settings.tolerance
        self.time_limit = settings.time_base
        self.path: Array | None = None
        self._episode: Episode | None = None
        self._reach = np.array(
            [
                (
                    sensors.ultrasonic.narrow if m.model == "narrow" else sensors.ultrasonic.wide
                ).reach
                for m in sensors.ultrasonic.mounted
            ]
        )
        limits = self.limits
        self._twist_most = TWIST_ROOM * np.array(
            [max(limits.forward, limits.backward), limits.turn], np.float32
        )
        self._look_ahead = np.array(settings.look_ahead)
        r = settings.reward
        self._weights = np.array([r.progress, r.time, r.arrived, r.bumped, r.timeout, r.change])

    @property
    def space(self) -> gym.spaces.Dict:
        """The space of observations."""
        room = 5 if self.settings.heading else 3
        high = np.array([GOAL_REACH, 1.0, 1.0, 1.0, 1.0][:room], np.float32)
        low = np.array([0.0, -1.0, -1.0, -1.0, -1.0][:room], np.float32)
        beams = self.settings.beams
        spaces: dict[str, gym.Space[NDArray[np.float32]]] = {
            "laser": gym.spaces.Box(0.0, self.sensors.laser.reach, (beams,), np.float32),
            "ultrasonic": gym.spaces.Box(
                np.zeros_like(self._reach, np.float32), self._reach.astype(np.float32)
            ),
            "twist": gym.spaces.Box(-self._twist_most, self._twist_most),
            "goal": gym.spaces.Box(low, high),
        }
        if self.guidance is not None:
            shape = (2 * len(self._look_ahead),)
            spaces["path"] = gym.spaces.Box(-PATH_REACH, PATH_REACH, shape, np.float32)
        return gym.spaces.Dict(spaces)

    def begin(self, episode: Episode, reading: Reading, key: int) -> None:
        """Take up a new episode with its first reading."""
        if episode is not self._episode:
            radius = self.footprint.half_width + self.settings.margin
            self.geodesic: Geodesic = geodesic(episode.map, episode.goal[:2], radius)
            self._episode = episode
        self.map, self.goal = episode.map, episode.goal
        self.start, self.reading, self.key = reading.pose, reading, key
        s = self.settings
        self.tolerance = s.tolerance if episode.tolerance is None else episode.tolerance
        way = self.way_to_go(reading.pose)
        limit = s.time_base + s.time_factor * way / self.limits.forward
        self.time_limit = limit if episode.time_limit is None else episode.time_limit
        self.path = None
        if self.guidance is not None:
            self.path = np.ascontiguousarray(self.guidance(self), dtype=np.float64)
            if self.path.ndim != 2 or len(self.path) < 2 or self.path.shape[1] < 2:
                raise ValueError(
                    f"guidance gave a path of shape {self.path.shape}; expected (n, 2)"
                )

    def way_to_go(self, pose: Array) -> float:
        """Length of the geodesic from a pose to the goal [m]; straight if none is known."""
        way = float(self.geodesic.at(pose[:2]))
        return way if math.isfinite(way) else float(np.hypot(*(self.goal - pose)[:2]))

    @property
    def steps(self) -> int:
        """Control periods within the time limit."""
        return max(1, round(self.time_limit / self.period))

    def observe(self, reading: Reading) -> Observation:
        """What a policy sees of a reading; fresh arrays, bounded, float32."""
        laser = np.empty(self.settings.beams, np.float32)
        pool(reading.laser, self.sensors.laser.reach, laser)
        heard = [see(r, reach) for r, reach in zip(reading.ultrasonic, self._reach, strict=True)]
        goal = np.empty(5 if self.settings.heading else 3, np.float32)
        bearing_to(reading.pose, self.goal, goal)
        twist = np.clip(reading.twist.astype(np.float32), -self._twist_most, self._twist_most)
        observation = {
            "laser": laser,
            "ultrasonic": np.array(heard, np.float32),
            "twist": twist,
            "goal": goal,
        }
        if self.guidance is not None and self.path is not None:
            ahead = np.empty((len(self._look_ahead), 2), np.float32)
            look_ahead(self.path, reading.pose, self._look_ahead, ahead)
            observation["path"] = ahead.ravel()
        return observation

    def judge(
        self, before: Reading, after: Reading, action: Array, previous: Array, steps_left: int
    ) -> Verdict:
        """What a step was worth, and whether it ended the episode.

        Args:
            before: the reading that the action was chosen on.
            after: the reading that it led to.
            action: (2,) in [-1, 1].
            previous: the action before it.
            steps_left: control periods left after this one.
        """
        arrived = self.believes_arrived(after.pose)
        timeout = steps_left <= 0 and not arrived and not after.bumped
        progress = self._to_go(before.pose) - self._to_go(after.pose)
        terms = np.empty(len(TERMS))
        weigh(
            self._weights,
            progress,
            self.period,
            arrived,
            after.bumped,
            timeout,
            action,
            previous,
            terms,
        )
        return Verdict(terms, bool(arrived), after.bumped)

    def at_goal(self, pose: Array) -> bool:
        """Whether a true pose (3,) is at the goal."""
        return self._reached(pose, 0.0)

    def believes_arrived(self, pose: Array) -> bool:
        """Whether a chair that believes to be at a pose (3,) may say that it has arrived."""
        known = self.sensors.pose_source == "truth"
        return self._reached(pose, 0.0 if known else self.settings.doubt)

    def _reached(self, pose: Array, doubt: float) -> bool:
        s, tolerance = self.settings, max(self.tolerance - doubt, 0.5 * self.tolerance)
        return bool(reached(pose, self.goal, tolerance, s.heading, s.heading_tolerance))

    def _to_go(self, pose: Array) -> float:
        """Way to go [m], as the aim setting measures it."""
        if self.settings.aim == "field":
            return self.way_to_go(pose)
        if self.settings.aim == "path" and self.path is not None:
            segment, share, gap = project(self.path, pose[0], pose[1])
            rest = path_length(self.path[segment:])
            return gap + rest - share * path_length(self.path[segment : segment + 2])
        return float(np.hypot(*(self.goal - pose)[:2]))

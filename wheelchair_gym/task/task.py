"""The live task of an environment: how its steps are observed and judged."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.address import Pointers, Target, as_array
from wheelchair_gym.config import InputError
from wheelchair_gym.maps import Geodesic, OccupancyGrid, geodesic
from wheelchair_gym.maps.cost_to_go import CostToGo
from wheelchair_gym.physics.settings import ChairSettings
from wheelchair_gym.safety.settings import ShieldSettings
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.task.assessment import assess_alone, start_task
from wheelchair_gym.task.observation_layout import boxes, places
from wheelchair_gym.task.prepared_episode import AIMS, COURSE, Course, way_from
from wheelchair_gym.task.records import ALONE, PROGRESS, RULES, VERDICT
from wheelchair_gym.task.rewards import TERMS, Verdict, reached
from wheelchair_gym.task.settings import TaskSettings
from wheelchair_gym.task.side_clearance import fan
from wheelchair_gym.types import Episode, Reading

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Rows = NDArray[np.void]
Observation = dict[str, Floats]
# A path (n, 2) [m] from the start to the goal; or, if its attribute `poses` is true, the ways of
# the chair's outline.
Guidance = Callable[["Task"], Array | CostToGo]

TWIST_ROOM = 1.5  # a chair pushed or overshooting is seen up to this multiple of its limits

_RULE_TARGETS = {
    "reaches": Target("f8", None),
    "ahead": Target("f8", None),
    "back": Target("f8", None),
    "fan": Target("f4", None),
    "directions": Target("f8", None, 2),
}
_ALONE_TARGETS = {
    "rules": Target(RULES, 1),
    "progress": Target(PROGRESS, 1),
    "verdict": Target(VERDICT, 1),
    "course": Target(COURSE, 1),
}


class Task:
    """Navigation to a goal; made once, begun anew each episode.

    Attributes:
        map: what the chair knows of the world: what it was told, or what it has drawn itself.
        built_map: gives what it has drawn, if the world is unknown.
        start: where the episode begins (3,) [m, m, rad].
        goal: (3,) [m, m, rad].
        geodesic: the shortest ways to the goal.
        tolerance: [m].
        time_limit: [s].
        period: control period [s].
        chair, sensors: settings of the chair.
        footprint, limits, drive: those of its parts.
        shield: settings of what filters its commands, or None.
        reading: the latest; its pose is the chair's own estimate.
        observation, verdict: of that reading.
        guarded: a shield filters what the chair is told.
        action: the last one (2,), of a policy or of what stands between it and the task.
        withheld: what the shield took from the twist that it asked for [m/s, rad/s].
        path: of the guidance (n, 2) [m], or None.
        key: of the episode's randomness; seeds whatever a policy draws.
        boxes: the space of each key of an observation, in the order in which kernels write them.
        room: numbers in an observation.
        rules: what kernels need to know of all this (1,), a record of RULES.
    """

    start: Array
    goal: Array
    geodesic: Geodesic
    reading: Reading
    observation: Observation
    verdict: Verdict
    key: int
    guarded: bool
    action: Array
    withheld: tuple[float, float]

    def __init__(
        self,
        settings: TaskSettings,
        chair: ChairSettings,
        sensors: SensorSettings,
        period: float,
        guidance: Guidance | None = None,
        shield: ShieldSettings | None = None,
    ) -> None:
        if settings.beams > sensors.laser.beams:
            raise InputError(
                f"task.beams is {settings.beams}; the laser has only {sensors.laser.beams}"
            )
        self.settings = settings
        self.chair, self.sensors, self.shield = chair, sensors, shield
        self.footprint, self.limits, self.drive = chair.footprint, chair.limits, chair.drive
        self.period = period
        self.guidance = guidance
        self.tolerance = settings.tolerance
        self.time_limit = settings.time_base
        self.path: Array | None = None
        self.built_map: Callable[[], OccupancyGrid] | None = None
        rangers = sensors.ultrasonic
        self._reaches = np.array(
            [
                (rangers.narrow if m.model == "narrow" else rangers.wide).reach
                for m in rangers.mounted
            ]
        )
        self.posed = bool(getattr(guidance, "poses", False))
        if settings.aim == "time" and not self.posed:
            raise InputError("task.aim is 'time'; it needs the guidance 'poses'")
        if settings.unguided and guidance is not None and not self.posed:
            raise InputError("task.unguided needs the guidance 'poses', or none")
        self._ahead = np.array(settings.look_ahead_time if self.posed else settings.look_ahead)
        self._back = np.array(settings.trail, np.float64)
        self._directions = sensors.laser.directions
        self._pointers = Pointers(np.zeros(1, RULES), _RULE_TARGETS)
        self.rules: Rows = self._pointers.record
        self._set_rules()
        self._progress = np.zeros(1, PROGRESS)
        self._judged = np.zeros(1, VERDICT)
        self._rows = Pointers(np.zeros(1, ALONE), _ALONE_TARGETS)
        self._alone = self._rows.record
        self._rows.point("rules", self._pointers)
        self._rows.point("progress", self._progress)
        self._rows.point("verdict", self._judged)
        self.boxes = boxes(settings, self.rules[0], self._reaches, self.footprint.half_width)
        self._places = places((key, box.shape[0]) for key, box in self.boxes.items())
        self.room = sum(box.shape[0] for box in self.boxes.values())

    def _set_rules(self) -> None:
        r, s, limits = cast("Any", self.rules[0]), self.settings, self.limits
        point = self._pointers.point
        r["period"] = self.period
        r["forward"], r["backward"], r["turn"] = limits.forward, limits.backward, limits.turn
        r["beams"], r["laser_reach"] = s.beams, self.sensors.laser.reach
        r["rangers"] = len(self._reaches)
        point("reaches", self._reaches)
        most = max(limits.forward, limits.backward), limits.turn
        r["twist_most"] = np.float32(TWIST_ROOM) * np.array(most, np.float32)
        r["goal_room"] = 5 if s.heading else 3
        r["points"] = 0 if self.guidance is None else len(self._ahead)
        r["posed"] = self.posed
        point("ahead", self._ahead)
        r["last_action"], r["privileged"] = s.last_action, s.privileged
        r["shield_state"] = s.shield_state
        r["unguided"] = s.unguided
        if s.gaps:
            r["fanned"] = s.unguided or not (self.posed and r["points"])
            r["gaps"] = 2 + (len(fan()) // 2 if r["fanned"] else 2 * int(r["points"]))
            point("fan", fan())
        r["trail"] = len(self._back)
        point("back", self._back)
        laser = self.sensors.laser
        r["outline"], r["mount"] = self.footprint.array, (laser.x, laser.y)
        r["laser_beams"] = laser.beams
        point("directions", self._directions)
        r["doubt"] = 0.0 if self.sensors.pose_source == "truth" else s.doubt
        r["heading"], r["heading_tolerance"] = s.heading, s.heading_tolerance
        r["aim"] = AIMS.index(s.aim)
        w = s.reward
        r["weights"] = tuple(getattr(w, term) for term in TERMS)
        r["time_base"], r["time_factor"] = s.time_base, s.time_factor

    @property
    def space(self) -> gym.spaces.Dict:
        """The space of observations."""
        return gym.spaces.Dict(cast("dict[str, gym.Space[Floats]]", self.boxes))

    @property
    def map(self) -> OccupancyGrid:
        """What the chair knows of the world."""
        return self._told if self.built_map is None else self.built_map()

    def prepare(self, episode: Episode, radius: float | None = None) -> Course:
        """What an episode is driven on: the ways to its goal, and the guidance.

        Args:
            episode: to be driven.
            radius: that ways keep from what is solid [m]; none: half the width and a margin.

        Raises:
            ValueError: the guidance gave no path.
        """
        if radius is None:
            radius = self.footprint.half_width + self.settings.margin
        ways = geodesic(episode.map, episode.goal[:2], radius)
        path = None
        if self.guidance is not None:
            self._take(episode, ways)
            self.tolerance = self.tolerance_of(episode)
            path = self.guidance(self)
            if isinstance(path, CostToGo) != self.posed:
                expected = "ways of the outline" if self.posed else "a path (n, 2)"
                raise ValueError(f"guidance gave {type(path).__name__}; expected {expected}")
        return self.lay_out(episode, ways, path)

    def tolerance_of(self, episode: Episode) -> float:
        """How near its goal counts [m]."""
        return self.settings.tolerance if episode.tolerance is None else episode.tolerance

    def lay_out(self, episode: Episode, ways: Geodesic, guide: Array | CostToGo | None) -> Course:
        """The course of an episode whose ways and guidance are known."""
        if isinstance(guide, CostToGo):
            path = guide.path(episode.start)[:, :2]
            if len(path) < 2:
                path = np.stack([episode.start[:2], episode.goal[:2]])
            return Course.of(episode, ways, path, self.settings.tolerance, guide)
        if guide is not None:
            guide = as_array(guide, np.float64, (None, None), "the path of the guidance")
            if len(guide) < 2 or guide.shape[1] < 2:
                raise InputError(f"guidance gave a path of shape {guide.shape}; expected (n, 2)")
        return Course.of(episode, ways, guide, self.settings.tolerance)

    def _take(self, episode: Episode, ways: Geodesic) -> None:
        self._told, self.start, self.goal = episode.map, episode.start, episode.goal
        self.geodesic = ways
        self._goal = tuple(episode.goal.tolist())

    def begin(
        self, course: Course, reading: Reading, key: int, guarded: bool = False
    ) -> Observation:
        """Take up a new episode with its first reading, behind a shield if it is guarded."""
        self.redirect(course)
        self.reading, self.key, self.guarded = reading, key, guarded
        self.action, self.withheld = np.zeros(2), (0.0, 0.0)
        out, verdict = np.empty(self.room, np.float32), self._judged
        start_task(
            0,
            self.rules,
            course.record,
            self._progress,
            verdict,
            reading.pose,
            reading.twist,
            reading.laser,
            reading.ultrasonic,
            guarded,
            out,
        )
        self.tolerance = float(course.record["tolerance"][0])
        self.time_limit = float(self._progress["time_limit"][0])
        self._take_verdict()
        self.observation = self.unpack(out)
        return self.observation

    def redirect(self, course: Course) -> None:
        """Go on on another course: on a map that has grown, say."""
        self._take(course.episode, course.geodesic)
        self._course, self.path = course, course.path
        self._rows.point("course", course.pointers)

    def assess(
        self, reading: Reading, action: Array, less: tuple[float, float] = (0.0, 0.0)
    ) -> Observation:
        """Judge the step that an action (2,) in [-1, 1] led to, and observe where it led.

        `less` is what a shield took from the twist that was asked for [m/s, rad/s].

        `verdict` then holds what it was worth, `reading` where it led.
        """
        out = np.empty(self.room, np.float32)
        assess_alone(
            self._alone,
            action,
            reading.pose,
            reading.twist,
            reading.laser,
            reading.ultrasonic,
            reading.bumped,
            *less,
            out,
        )
        self.reading, self.action, self.withheld = reading, action, less
        self._take_verdict()
        self.observation = self.unpack(out)
        return self.observation

    def _take_verdict(self) -> None:
        terms, *rest = cast("tuple[Any, ...]", self._judged.item())
        self.verdict = Verdict(tuple(terms.tolist()), *rest)

    def unpack(self, out: Floats) -> Observation:
        """Observations (n, room) or one (room,), written in one piece, by key."""
        if out.ndim == 1:
            return {key: out[place] for key, place in self._places.items()}
        return {key: out[:, place] for key, place in self._places.items()}

    def way_to_go(self, pose: Array) -> float:
        """Length of the geodesic from a pose to the goal [m]; straight if none is known."""
        return way_from(self._course.record, float(pose[0]), float(pose[1]))

    def at_goal(self, pose: Array) -> bool:
        """Whether a true pose (3,) is at the goal."""
        s = self.settings
        plain: Any = reached  # as plain Python, which is sooner done than calling compiled code
        x, y, yaw = pose.tolist()
        at = plain.py_func((x, y, yaw), self._goal, self.tolerance, s.heading, s.heading_tolerance)
        return bool(at)

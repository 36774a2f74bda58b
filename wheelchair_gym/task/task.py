"""The live task of an environment: how its steps are observed and judged."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import gymnasium as gym
import numpy as np

from wheelchair_gym.base.arrays import Array, Floats, Rows
from wheelchair_gym.base.settings import LARGEST_INTEGER, InputError
from wheelchair_gym.compiled.address import Pointers, as_array
from wheelchair_gym.maps import Geodesic, OccupancyGrid, geodesic
from wheelchair_gym.maps.cost_to_go import CostToGo
from wheelchair_gym.perception.track_state import TRACKER, TrackerConstants
from wheelchair_gym.perception.tracker import TRACKERS, point_to_trackers
from wheelchair_gym.safety.settings import ShieldSettings
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings
from wheelchair_gym.sim.state import sensed_of
from wheelchair_gym.task import assessment, observations
from wheelchair_gym.task.observations import ObservationSource
from wheelchair_gym.task.prepared_episode import AIMS, PreparedEpisode, geodesic_to_go
from wheelchair_gym.task.rewards import TERMS, VERDICT, has_arrived
from wheelchair_gym.task.settings import TaskSettings
from wheelchair_gym.task.side_clearance import fan_poses
from wheelchair_gym.types import Arrival, Episode, Reading, Stick

Observation = dict[str, Floats]
# A path (n, 2) [m] from the start to the goal; or, if its attribute `poses` is true, the cost to
# go of the chair's outline.
Guidance = Callable[["Task"], Array | CostToGo]

TWIST_RANGE = 1.5  # a chair pushed or overshooting is seen up to this multiple of its limits


class Task:
    """Navigation to a goal; made once, reset for each episode."""

    # Of the present episode; `map` is what the chair knows of its world.
    start: Array  # (3,) m, m, rad
    goal: Array  # (3,) m, m, rad
    arrival: Arrival | None  # when it counts as reached, where the goal is a pose
    geodesic: Geodesic  # the shortest distances to the goal
    key: int  # of the episode's randomness; seeds what a policy draws
    is_shielded: bool  # a shield filters the commands
    observation: Observation  # of the latest reading
    action: tuple[float, float]  # the last one, as it was given
    shield_intervention: tuple[float, float]  # taken from the last twist [m/s, rad/s]

    def __init__(
        self,
        settings: TaskSettings,
        chair: ChairSettings,
        sensors: SensorSettings,
        period: float,
        guidance: Guidance | None = None,
        shield: ShieldSettings | None = None,
        has_driver: bool = False,
    ) -> None:
        if has_driver and guidance is not None:
            settings = replace(settings, hide_guidance=True)
        self.has_driver = has_driver  # a person drives, whose goal and way are not observed
        if settings.beams > sensors.laser.beams > 0:
            raise InputError(
                f"task.beams is {settings.beams}; the laser has only {sensors.laser.beams}"
            )
        self.settings = settings
        self.chair, self.sensors, self.shield = chair, sensors, shield
        self.footprint, self.limits = chair.footprint, chair.limits
        self.period = period
        self.guidance = guidance
        self.tolerance = settings.tolerance  # m
        self.time_limit = settings.time_base  # s
        self.path: Array | None = None  # (n, 2) m: of the guidance
        self.built_map: Callable[[], OccupancyGrid] | None = None
        self._reaches = np.array([m.reach for m in sensors.ultrasonic.models], np.float64)
        scanners = zip(sensors.lasers, settings.observed_beams(sensors), strict=True)
        pools = [(laser.beams, observed, laser.reach) for laser, observed in scanners]
        self._pools = np.array(pools, observations.POOL)
        self.has_poses = bool(getattr(guidance, "poses", False))
        if settings.aim == "time" and not self.has_poses:
            raise InputError("task.aim is 'time'; it needs the guidance 'poses'")
        if settings.hide_guidance and guidance is not None and not self.has_poses:
            raise InputError("task.hide_guidance needs the guidance 'poses', or none")
        name = "look_ahead_time" if self.has_poses else "look_ahead"
        self._ahead = np.array(getattr(settings, name))
        if (np.diff(self._ahead) < 0.0).any():
            raise InputError(f"task.{name} is {self._ahead.tolist()}; expected rising values")
        self._pointers = Pointers(np.zeros(1, assessment.RULES), assessment.RULES_TARGETS)
        self.rules: Rows = self._pointers.record
        self._set_rules()
        self._tracker: TrackerConstants | None = None
        if settings.tracks:
            if period > 1.0:
                hertz = f"a rate of {1.0 / period:g} Hz; expected 1 Hz at least"
                raise InputError(f"task.tracks is {settings.tracks} at {hertz}")
            self._tracker = TrackerConstants(sensors.laser)
        self._progress = np.zeros(1, assessment.PROGRESS)
        self.judged = np.zeros(1, VERDICT)  # of the latest reading
        self.rows = self.row_pointers(self._progress)
        self.spaces = observations.spaces(self._source)
        self._places = observations.places((key, box.shape[0]) for key, box in self.spaces.items())
        self.observation_size = sum(box.shape[0] for box in self.spaces.values())

    def row_pointers(
        self, progress: Rows, prepared: Rows | None = None, tracked: Rows | None = None
    ) -> Pointers:
        """Return pointers to rows (n,) of PROGRESS, PREPARED and TRACKER, a record (1,) of TASK."""
        n, trackers = len(progress), cast("Any", np.zeros(1, TRACKERS))
        if self._tracker is not None:
            tracked = np.zeros(n, TRACKER) if tracked is None else tracked
            trackers = point_to_trackers(self._tracker, tracked, [None] * n)
        rows = Pointers(np.zeros(1, assessment.TASK), assessment.TASK_TARGETS)
        rows.fill(n=n, rules=self._pointers, progress=progress, trackers=trackers)
        if prepared is not None:
            rows.point("prepared", prepared)
        return rows

    def _set_rules(self) -> None:
        s, limits, laser = self.settings, self.limits, self.sensors.laser
        fastest = max(limits.forward, limits.backward)
        twist_max = np.float32(TWIST_RANGE) * np.array((fastest, limits.turn), np.float32)
        self._source = source = ObservationSource(
            s,
            self._reaches,
            np.repeat(self._pools["reach"], self._pools["observed"]),
            twist_max.astype(np.float64),
            self.footprint.half_width,
            0 if self.guidance is None else len(self._ahead),
            4 if self.has_poses else 2,
            self.has_driver,
        )
        sizes = [key.size(source) for key in observations.OBSERVATION_KEYS]
        self._pointers.fill(
            period=self.period, max_steps=s.max_episode_steps or LARGEST_INTEGER,
            forward=limits.forward, backward=limits.backward, turn=limits.turn,
            scanners=len(self._pools), pools=self._pools, reaches=self._reaches,
            twist_max=twist_max, points=source.points, has_poses=self.has_poses, ahead=self._ahead,
            size=tuple(sizes), place=(0, *np.cumsum(sizes[:-1]).tolist()), scaled=s.scaled,
            factors=observations.factors(source), uses_fan=source.uses_fan, fan_poses=fan_poses(),
            back=np.array(s.trail, np.float64), outline=self.footprint.array,
            mount=(laser.x, laser.y), laser_beams=laser.beams, directions=laser.directions,
            has_driver=self.has_driver, bump_ends=s.bump_ends, aim=AIMS.index(s.aim),
            arrival_margin=0.0 if self.sensors.pose_source == "truth" else s.arrival_margin,
            heading=s.heading, heading_tolerance=s.heading_tolerance,
            weights=tuple(getattr(s.reward, term) for term in TERMS),
            time_base=s.time_base, time_factor=s.time_factor,
        )  # fmt: skip

    @property
    def space(self) -> gym.spaces.Dict:
        """The space of observations."""
        return gym.spaces.Dict(cast("dict[str, gym.Space[Floats]]", self.spaces))

    @property
    def map(self) -> OccupancyGrid:
        """The map that the chair knows; unknown cells of a given map are occupied."""
        return self._told if self.built_map is None else self.built_map()

    @property
    def route_radius(self) -> float:
        """Distance [m] that routes keep from what is solid: half the width and a margin."""
        return self.footprint.half_width + self.settings.margin

    def prepare(self, episode: Episode, radius: float | None = None) -> PreparedEpisode:
        """Prepare an episode to be driven: compute the distances to its goal, and the guidance.

        Args:
            episode: to be driven.
            radius: that routes keep from what is solid [m]; none: `route_radius`.

        Raises:
            ValueError: the guidance gave no path.
        """
        radius = self.route_radius if radius is None else radius
        distances = geodesic(episode.map, episode.goal[:2], radius)
        path = None
        if self.guidance is not None:
            self._take(episode, distances)
            self.tolerance = self.tolerance_of(episode)
            path = self.guidance(self)
            if isinstance(path, CostToGo) != self.has_poses:
                expected = "the cost to go of the outline" if self.has_poses else "a path (n, 2)"
                raise ValueError(f"guidance gave {type(path).__name__}; expected {expected}")
        return self.make_prepared(episode, distances, path)

    def tolerance_of(self, episode: Episode) -> float:
        """Its tolerance at the goal [m]."""
        return self.settings.tolerance if episode.tolerance is None else episode.tolerance

    def make_prepared(
        self, episode: Episode, distances: Geodesic, guide: Array | CostToGo | None
    ) -> PreparedEpisode:
        """The prepared episode of known distances and guidance."""
        if isinstance(guide, CostToGo):
            path = guide.path(episode.start)[:, :2]
            if len(path) < 2:
                path = np.stack([episode.start[:2], episode.goal[:2]])
            return PreparedEpisode.of(episode, distances, path, self.settings.tolerance, guide)
        if guide is not None:
            guide = as_array(guide, np.float64, (None, None), "the path of the guidance")
            if len(guide) < 2 or guide.shape[1] < 2:
                raise InputError(f"guidance gave a path of shape {guide.shape}; expected (n, 2)")
        return PreparedEpisode.of(episode, distances, guide, self.settings.tolerance)

    def _take(self, episode: Episode, distances: Geodesic) -> None:
        self._told = episode.map.without_unknown(unknown_is_solid=True)
        self.start, self.goal = episode.start, episode.goal
        self.arrival = episode.arrival
        self.geodesic = distances

    def begin(
        self, prepared: PreparedEpisode, reading: Reading, key: int, is_shielded: bool = False
    ) -> Observation:
        """Begin an episode with its first reading; behind a shield if it is shielded."""
        self.enter(prepared, key)
        out = np.empty(self.observation_size, np.float32)
        row, seen = self.rows.record, sensed_of(reading)[0]
        assessment.begin_task(0, row, self.judged, seen, reading.laser, is_shielded, out)
        self.take_limits()
        self.take_step(reading, self.unpack(out), (0.0, 0.0), (0.0, 0.0))
        return self.observation

    def enter(self, prepared: PreparedEpisode, key: int) -> None:
        """Take a prepared episode, with the key of its draws, which is begun next."""
        self.replace_prepared(prepared)
        self.key, self.tolerance = key, float(prepared.record["tolerance"][0])

    def take_limits(self) -> None:
        """Take what the beginning of an episode decided: its time limit, and its shield."""
        self.time_limit = float(self._progress["time_limit"][0])
        self.is_shielded = bool(self._progress["is_shielded"][0])

    def replace_prepared(self, prepared: PreparedEpisode) -> None:
        """Go on with another prepared episode, such as that of a map that has grown."""
        self._take(prepared.episode, prepared.geodesic)
        self._prepared, self.path = prepared, prepared.path
        self.rows.point("prepared", prepared.pointers)

    def assess(
        self, reading: Reading, action: tuple[float, float], less: tuple[float, float] = (0.0, 0.0)
    ) -> Observation:
        """Assess the step of an action in [-1, 1], and return the observation that follows.

        `less` is what a shield took from the twist that was asked for [m/s, rad/s].

        `judged` then holds its verdict, `reading` the new reading.
        """
        out = np.empty(self.observation_size, np.float32)
        row, seen = self.rows.record, sensed_of(reading)[0]
        assessment.assess(0, row, self.judged, action, less, seen, reading.laser, out)
        self.take_step(reading, self.unpack(out), action, less)
        return self.observation

    def take_step(
        self,
        reading: Reading | Callable[[], Reading],
        observation: Observation,
        action: tuple[float, float],
        less: tuple[float, float],
    ) -> None:
        """Take what an assessed step gave; the reading may be one that is made when asked for."""
        self._reading, self.observation = reading, observation
        self.action, self.shield_intervention = action, less

    def take_stick(self, stick: Stick, true_pose: Array, true_twist: Array) -> None:
        """Take what a person's interface gives where the chair truly is, before the assessment."""
        observations.take_stick(self._progress[0], *stick, self.at_goal(true_pose, true_twist))

    def replace_stick(self, stick: Stick) -> None:
        """Take what the interface gives by now, in place of what it gave with the reading."""
        self._progress["sticks"][0, 0] = stick.forward, stick.left
        self._progress["latched"] = stick.latched

    @property
    def stick(self) -> Stick | None:
        """Present signal of the interface of the person who drives; None where nobody drives."""
        if not self.has_driver:
            return None
        forward, left = self._progress["sticks"][0, 0].tolist()
        return Stick(forward, left, bool(self._progress["latched"][0]))

    @property
    def reading(self) -> Reading:
        """The latest reading; its pose is the chair's estimate."""
        if callable(self._reading):
            self._reading = self._reading()
        return self._reading

    def __getstate__(self) -> dict[str, Any]:
        """With the latest reading itself."""
        state = self.__dict__.copy()
        if "_reading" in state:
            state["_reading"] = self.reading
        return state

    def unpack(self, out: Floats) -> Observation:
        """Observations (n, numbers) or one (numbers,), written in one piece, by key."""
        return {key: out[..., place] for key, place in self._places.items()}

    def way_to_go(self, pose: Array) -> float:
        """Length of the geodesic from a pose to the goal [m]; straight if none is known."""
        return geodesic_to_go(self._prepared.record[0], float(pose[0]), float(pose[1]))

    def at_goal(self, pose: Array, twist: Array) -> bool:
        """Return True if a true pose (3,) is at the goal, with the true twist (2,) if it counts."""
        return bool(has_arrived(self.rules[0], self._prepared.record[0], pose, twist, 0.0))

"""Records commands, readings and verdicts of episodes to an MCAP file, or live for viewers.

Typed messages (`recording.messages`) are for viewers. JSON messages (`recording.topics`) hold the
same to the last bit, so that a run can be replayed and judged again (`recording.replay`).
"""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.actors.records import actor_shapes
from wheelchair_gym.base.settings import dump, setting, settings
from wheelchair_gym.hardware.ros.make_messages import NANO, scanner_name
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.people.drivers import driver_spec
from wheelchair_gym.perception.localized_chair import unwrapped
from wheelchair_gym.recording import topics
from wheelchair_gym.recording.sink import Format, Sink
from wheelchair_gym.safety.stops import StopMonitor, active_stops
from wheelchair_gym.types import Belief, Shown, Stick

if TYPE_CHECKING:
    from wheelchair_gym.task.task import Observation

_SPACING = 0.05  # m between two points of a trail
_JPEG_QUALITY = 80
REFRESH_PERIOD = 1.0  # s, of what changes seldom: map, path, mounts, outline and trail
_LONGEST_TRAIL = 2000  # points: of a longer drive, the trail is thinned out


@settings
class RecordingSettings:
    """Rates of messages that are not sent with every reading."""

    image_rate: float = setting(default=0.0, unit="Hz", low=0.0, high=60.0)
    """Rate of rendered pictures; 0 records none."""
    when_full: Literal["go-on", "end"] = setting(default="go-on")
    """Whether the run goes on when the disk is full; the recording ends in any case."""
    format: Format = setting(default="foxglove")
    """Format of a recording: one MCAP file with Foxglove's messages, or a rosbag2."""


class RecordEpisodes(gym.Wrapper[Any, Any, Any, Any]):
    """A Gymnasium wrapper that writes all episodes to a file, shows them live, or both.

    Args:
        env: a `NavigationEnv`, wrapped or not.
        file: MCAP to write; if it exists, a number is added to its name. It is complete after
            `close`, and after a disk has run full. In the format ros2, the folder of a bag.
        port: of this machine, for Foxglove's viewers (WebSocket); 0: a free one.
        recording: rates of messages, and the format.

    Attributes:
        file: that is written, or None.
        port: for viewers, or None.

    Raises:
        InputError: the extra 'record' or 'ros' is not installed, the file cannot be written, or the
            port is taken.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        file: str | Path | None = None,
        port: int | None = None,
        recording: RecordingSettings | None = None,
    ) -> None:
        super().__init__(env)
        self._config = recording or RecordingSettings()
        self._out = Sink(file, port, self._config.format)
        self.file, self.port = self._out.path, self._out.port
        self._base = 0  # ns: episodes follow each other in time
        self._trail: list[Any] = []
        self._labels: dict[str, Any] = {}  # as last recorded
        self._stick: Stick | None = None  # likewise

    def reset(self, **arguments: Any) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode, and record it."""
        observation, info = self.env.reset(**arguments)
        out = self._out
        self._base = out.now = out.now + NANO if out.now else 0
        self._refreshed = self._image = -math.inf  # s: when both were last sent
        self._trail.clear()
        self._lines: dict[str, Any] = {}  # path and roll-out as last sent
        self._map: OccupancyGrid = self._env.episode.map
        self._note, self._stops = "", StopMonitor()
        self._log_episode()
        if self._env.task.built_map is None:
            self._log_map(self._map)
        self._log_reading()
        self._out.check_disk(self._config.when_full)
        return observation, info

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive for one control period, and record it.

        Raises:
            InputError: the disk is full, and the run is to end then.
        """
        env = self._env
        news: dict[str, Any] = {}  # where they are other ones than were recorded last
        if env.task.stick != self._stick:
            news["stick"] = env.task.stick
        if env.labels != self._labels:
            self._labels = news["labels"] = dict(env.labels)
        observation, reward, terminated, truncated, info = self.env.step(action)
        v, w = env.task.limits.twist_of(*env.task.action)  # with the assistant's part
        self._out.write(topics.COMMAND, {"action": env.last_action, "v": v, "w": w, **news})
        if "shield" in info:
            self._out.write(topics.SHIELD, info["shield"])
        self._log_reading()
        ends = {"reward": env.last_reward, "terminated": terminated, "truncated": truncated}
        self._out.write(topics.VERDICT, {"terms": info["reward_terms"], **ends})
        self._out.check_disk(self._config.when_full)
        return observation, float(reward), terminated, truncated, info

    def close(self) -> None:
        """Stop the chair first; then complete the file and disconnect viewers."""
        try:
            super().close()
        finally:
            self._out.close()

    @property
    def _env(self) -> Any:
        return self.env.unwrapped

    def _log_episode(self) -> None:
        env = self._env
        episode = env.episode
        settings = {name: dump(getattr(env.settings, name)) for name in topics.SETTINGS}
        person, told = env.drivers.driver, env.episode_info
        # Whole, so that it means the same in a later release.
        settings["driver"] = None if person is None else driver_spec(person)
        if not env.task.is_shielded:  # a share of episodes may be driven without
            settings["shield"] = None
        rows = episode.actors.rows
        actors = {"actors": rows, "actor_size": rows.itemsize, "routes": episode.actors.routes}
        self._labels = dict(env.labels)
        drawn = {"number": told["episode_number"], "labels": self._labels, "settings": settings}
        values = vars(episode) | actors | told | drawn
        if (boards := unwrapped(env.chair).board_parameters) is not None:
            values["boards"] = boards
        path = None if env.task.guidance is None else np.asarray(env.task.path).tolist()
        if env.task.has_poses:  # the guidance itself, which searches poses of the outline
            path = env.settings.guidance
            path = {"call": "poses", **dump(path)} if callable(path) else path
        self._out.write(topics.EPISODE, values, path=path)

    def _log_map(self, map_: OccupancyGrid) -> None:
        """Send what rarely changes."""
        env, sensors = self._env, self._env.settings.sensors
        self._map = map_
        self._out.send("/map", map_)
        self._out.send("/goal", env.episode.goal)
        self._out.send("/tf_static", sensors.lasers, sensors.ultrasonic)
        self._out.send("/footprint", env.settings.chair.footprint.corners)
        self._lines = {}  # so that they are sent, too

    def _log_reading(self) -> None:
        env = self._env
        reading, truth, sensors = env.task.reading, env.chair.truth, env.settings.sensors
        believed: Belief = env.chair.belief or Belief(reading.pose)
        self._out.now = self._base + round(reading.stamp * NANO)
        changed = self._refresh(reading, believed)
        values = reading._asdict() | {"odometry": believed.odometry, "truth": truth}
        del values["map"], values["stick"]  # the map is sent where it has changed
        self._stick = env.task.stick
        if self._stick is not None:
            values["stick"] = self._stick
        if believed.particles is not None:
            values["particles"] = believed.particles
            self._out.send("/particles", believed.particles)
        if changed:
            values["map"] = self._map
        self._out.write(topics.READING, values)
        self._out.write(topics.BATTERY, {"voltage": reading.battery})
        for k, (laser, at) in enumerate(zip(sensors.lasers, sensors.slices, strict=True)):
            self._out.send(scanner_name(k, "/scan"), laser, reading.laser[at], k)
        self._out.send("/ultrasonic", sensors.ultrasonic, reading.ultrasonic, reading.age)
        self._out.send("/tf", reading.pose, believed.odometry)
        self._out.send("/odometry", believed.odometry, reading.twist)
        self._out.send("/pose", reading.pose)
        self._out.send("/truth", truth.pose)
        if len(truth.actor_poses):
            self._out.send("/actors", actor_shapes(env.episode.actors, truth.actor_poses))
        if (ahead := env.points_ahead) is not None:
            self._out.send("/lookahead", ahead)
        chair = unwrapped(env.chair)
        reports = {"reports": chair.wheels, "scans": chair.scan_stamps}
        self._out.write(topics.WHEELS, reports)
        if (report := chair.report) is not None:
            self._out.write(topics.BOARD, {"wall": time.time(), **report})
        self._log_changes(env.shown, reading.stamp)

    def _refresh(self, reading: Any, believed: Belief) -> bool:
        """Send trail, pictures and static content at their rates; returns if the map changed."""
        config, trail, changed = self._config, self._trail, False
        place = reading.pose[:2]
        if not trail or np.hypot(*(place - trail[-1])) >= _SPACING:
            trail.append(place)
            if len(trail) > _LONGEST_TRAIL:
                del trail[1:-1:2]
        if config.image_rate and _due(reading.stamp - self._image, 1.0 / config.image_rate):
            self._image = reading.stamp
            if (picture := self._env.render()) is not None:
                self._out.send("/image", picture, _JPEG_QUALITY)
        if _due(reading.stamp - self._refreshed, REFRESH_PERIOD):
            first, self._refreshed = self._refreshed < 0.0, reading.stamp
            self._out.send("/trail", trail)
            map_ = self._map if believed.built_map is None else believed.built_map()
            changed = map_ is not self._map
            if changed or (self.port is not None and not first):
                self._log_map(map_)
        return changed

    def _log_changes(self, shown: Shown, stamp: float) -> None:
        """Send path, roll-out and notes when they change."""
        for topic, line in (("/path", shown.path), ("/rollout", shown.rollout)):
            if line is not None and line is not self._lines.get(topic):
                self._out.send(topic, line)
            self._lines[topic] = line
        if shown.status != self._note:
            self._note = shown.status
            self._out.send("/note", "policy", self._note or "-", False)
        shield, reading = self._env.shield, self._env.task.reading
        for message in self._stops.update(stamp, active_stops(reading.halted, shield)):
            self._out.send("/note", "chair", message, bool(self._stops.messages))


def _due(since: float, period: float) -> bool:
    return since > period - 1e-6  # of rounding: a period may be a whole number of readings

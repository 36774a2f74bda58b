"""Records commands, readings and verdicts of episodes to an MCAP file, or live for viewers.

Typed messages (`recording.messages`) are for viewers. The topics READING, COMMAND and VERDICT hold
the same once more to the last bit, so that a run can be driven and judged again
(`recording.replay`).
"""

from __future__ import annotations

import base64
import logging
import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from wheelchair_gym.config import InputError, dump, setting, settings
from wheelchair_gym.localization.localized_chair import unwrapped
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.physics.actors.records import ACTOR, actor_shapes
from wheelchair_gym.recording.sink import NANO, Sink
from wheelchair_gym.safety.stops import StopMonitor, active_stops
from wheelchair_gym.types import Belief

if TYPE_CHECKING:
    from wheelchair_gym.task.task import Observation

EPISODE: Final = "/episode"
READING: Final = "/reading"
COMMAND: Final = "/command"
SHIELD: Final = "/shield"  # what became of the command
VERDICT: Final = "/verdict"
BOARD: Final = "/board"  # of a real chair: wall time, and what its drive board tells
# Of an environment: what judging needs.
SETTINGS: Final = ("rate", "chair", "sensors", "task", "shield")

_LOG = logging.getLogger(__name__)


@settings
class RecordingSettings:
    """Rates of messages that are not sent with every reading."""

    refresh_period: float = setting(default=1.0, unit="s", low=0.01, source="design choice")
    """Period of what changes seldom: map, path, mounts, outline and trail."""
    trail_spacing: float = setting(default=0.05, unit="m", low=0.001, source="design choice")
    """Spacing of the trail's points."""
    image_rate: float = setting(default=0.0, unit="Hz", low=0.0, high=60.0, source="design choice")
    """Rate of rendered pictures; 0 records none."""
    jpeg_quality: int = setting(default=80, low=1, high=100, source="design choice")
    """JPEG quality of the pictures."""
    when_full: Literal["go-on", "end"] = setting(default="go-on")
    """Whether the run goes on when the disk is full; the recording ends in any case."""


def packed(values: ArrayLike, kind: DTypeLike) -> str:
    """An array as text, to the bit, infinities and NaN included."""
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode()


def packed_map(grid: OccupancyGrid) -> dict[str, Any]:
    """A map as JSON takes it."""
    return {
        "cells": packed(grid.cells, "<i1"),
        "shape": grid.shape,
        "resolution": grid.resolution,
        "origin": grid.origin,
    }


class RecordEpisodes(gym.Wrapper[Any, Any, Any, Any]):
    """A Gymnasium wrapper that writes all episodes to a file, shows them live, or both.

    Args:
        env: a `NavigationEnv`, wrapped or not.
        file: MCAP to write; a number is added to its name where it exists. It is whole after
            `close`, and up to the moment at which a disk has run full.
        port: of this machine, where Foxglove's viewers may join (WebSocket); 0: a free one.
        recording: how often what is sent.

    Attributes:
        file: that is written, or None.
        port: where viewers may join, or None.

    Raises:
        InputError: the extra 'record' is not installed, the file cannot be written, or the port is
            taken.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        file: str | Path | None = None,
        port: int | None = None,
        recording: RecordingSettings | None = None,
    ) -> None:
        super().__init__(env)
        self._out = Sink(file, port)
        self.file, self.port = self._out.file, self._out.port
        from wheelchair_gym.recording import messages

        self._m: Any = messages
        self._own = recording or RecordingSettings()
        self._base = 0  # ns: episodes follow each other in time
        self._trail: list[Any] = []

    def reset(self, **arguments: Any) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode, and a chapter of the recording."""
        observation, info = self.env.reset(**arguments)
        out = self._out
        self._base = out.now = out.now + NANO if out.now else 0
        self._seldom = self._image = -math.inf  # s: when they were sent last
        self._trail.clear()
        self._path: Any = None
        self._chart: OccupancyGrid = self._env.episode.map
        self._note, self._stops = "", StopMonitor()
        self._log_episode()
        if self._env.task.built_map is None:
            self._log_map(self._chart)
        self._log_reading()
        self._see_to_disk()
        return observation, info

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive for one control period, and record it.

        Raises:
            InputError: the disk is full, and the run is to end then.
        """
        observation, reward, terminated, truncated, info = self.env.step(action)
        chosen = np.asarray(action, np.float64).tolist()
        twist = self._env.task.limits.twist(action).tolist()
        self._out.write(COMMAND, {"action": chosen, "v": twist[0], "w": twist[1]})
        if "shield" in info:
            told = info["shield"]
            plain = {name: told[name].tolist() for name in ("asked", "given")}
            self._out.write(SHIELD, told | plain)
        self._log_reading()
        ends = {"terminated": terminated, "truncated": truncated}
        self._out.write(VERDICT, {"reward": reward, "terms": info["reward_terms"], **ends})
        self._see_to_disk()
        return observation, float(reward), terminated, truncated, info

    def close(self) -> None:
        """Stop the chair first; then finish the file and let viewers go."""
        try:
            super().close()
        finally:
            self._out.close()

    def _see_to_disk(self) -> None:
        why = self._out.new_error()
        if why and self._own.when_full == "end":
            raise InputError(f"{why}, and the run, too")
        if why:
            _LOG.warning("%s; the run goes on", why)

    @property
    def _env(self) -> Any:
        return self.env.unwrapped

    def _send(self, topic: str, kind: str, *content: Any) -> None:
        self._out.send(topic, getattr(self._m, kind)(self._out.now, *content))

    def _log_episode(self) -> None:
        env = self._env
        episode = env.episode
        told = {name: dump(getattr(env.settings, name)) for name in SETTINGS}
        if not env.task.is_shielded:  # a share of episodes may be driven without
            told["shield"] = None
        self._out.write(
            EPISODE,
            {
                "settings": told,
                "map": packed_map(episode.map),
                **{name: np.asarray(getattr(episode, name)).tolist() for name in _ARRAYS},
                **{name: getattr(episode, name) for name in _VALUES},
                "movers": packed(episode.actors.rows, ACTOR),
                "routes": episode.actors.routes.tolist(),
                "path": self._guide(),
            },
        )

    def _guide(self) -> Any:
        """The path that guides; or the guidance itself, where it guides by ways of the outline."""
        task = self._env.task
        if task.has_poses:
            spec = self._env.settings.guidance
            return {"call": "poses", **dump(spec)} if callable(spec) else spec
        return None if task.guidance is None else np.asarray(task.path).tolist()

    def _log_map(self, chart: OccupancyGrid) -> None:
        """What stays as it is, or nearly so."""
        env, sensors = self._env, self._env.settings.sensors
        self._chart = chart
        self._send("/map", "grid", chart)
        self._send("/goal", "pose_in_map", env.episode.goal)
        self._send("/tf_static", "mounts", sensors.laser, sensors.ultrasonic)
        self._send("/footprint", "footprint", env.settings.chair.footprint.corners)
        self._path = None  # is sent, too

    def _log_reading(self) -> None:
        env = self._env
        reading, truth, sensors = env.task.reading, env.chair.truth, env.settings.sensors
        believed: Belief = getattr(env.chair, "belief", Belief(reading.pose))
        self._out.now = self._base + round(reading.stamp * NANO)
        changed = self._log_seldom(reading, believed)
        told = {"pose": reading.pose.tolist(), "twist": reading.twist.tolist()}
        told |= {name: packed(getattr(reading, name), "<f4") for name in FLOATS}
        told |= {name: getattr(reading, name) for name in ("bumped", "stamp", "halted")}
        told["battery"] = reading.battery if math.isfinite(reading.battery) else None
        told["odometry"] = believed.odometry.tolist()
        if believed.particles is not None:
            told["particles"] = packed(believed.particles, "<f4")
            self._send("/particles", "particles", believed.particles)
        if changed:
            told["map"] = packed_map(self._chart)
        real = truth._asdict()
        real |= {"pose": truth.pose.tolist(), "twist": truth.twist.tolist()}
        real["actor_poses"] = packed(truth.actor_poses, "<f8")  # NaN: not there
        self._out.write(READING, {**told, "truth": real})
        self._out.write("/battery", {"voltage": told["battery"]})
        self._send("/scan", "scan", sensors.laser, reading.laser)
        self._send("/ultrasonic", "cones", sensors.ultrasonic, reading.ultrasonic, reading.age)
        self._send("/tf", "frames", reading.pose, believed.odometry)
        self._send("/odometry", "odometry", believed.odometry, reading.twist)
        self._send("/pose", "pose_in_map", reading.pose)
        self._send("/truth", "pose_in_map", truth.pose)
        if len(truth.actor_poses):
            self._send("/movers", "movers", actor_shapes(env.episode.actors, truth.actor_poses))
        ahead = env.points_ahead
        if ahead is not None:
            self._send("/lookahead", "poses_in_map", ahead)
        report = getattr(unwrapped(env.chair), "report", None)
        if report is not None:
            self._out.write(BOARD, {"wall": time.time(), **report})
        self._log_news(env.shown.path, reading.stamp)

    def _log_seldom(self, reading: Any, believed: Belief) -> bool:
        """Send trail, pictures and static content at their rates; whether the map changed."""
        own, trail, changed = self._own, self._trail, False
        place = reading.pose[:2]
        if not trail or np.hypot(*(place - trail[-1])) >= own.trail_spacing:
            trail.append(place)
        if own.image_rate and _due(reading.stamp - self._image, 1.0 / own.image_rate):
            self._image = reading.stamp
            picture = self._env.render()
            if picture is not None:
                self._send("/image", "image", picture, own.jpeg_quality)
        if _due(reading.stamp - self._seldom, own.refresh_period):
            first, self._seldom = self._seldom < 0.0, reading.stamp
            self._send("/trail", "trail", trail)
            chart = self._chart if believed.built_map is None else believed.built_map()
            changed = chart is not self._chart
            if changed or (self.port is not None and not first):
                self._log_map(chart)
        return changed

    def _log_news(self, path: Any, stamp: float) -> None:
        """Send path and notes when they change."""
        if path is not None and path is not self._path:
            self._send("/path", "poses_in_map", path)
        self._path = path
        note = self._env.shown.status
        if note != self._note:
            self._note = note
            self._send("/note", "log_message", "policy", note or "-", False)
        shield, reading = self._env.shield, self._env.task.reading
        for line in self._stops.update(stamp, active_stops(reading.halted, shield)):
            self._send("/note", "log_message", "chair", line, bool(self._stops.messages))


def _due(since: float, period: float) -> bool:
    return since > period - 1e-6  # of rounding: a period may be a whole number of readings


_ARRAYS = ("start", "goal", "walls", "discs")  # of an episode
_VALUES = ("tolerance", "time_limit", "name")
FLOATS: Final = ("laser", "ultrasonic", "age")  # of a reading

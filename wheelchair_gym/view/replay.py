"""Replay: a recording read back as a chair that was driven before, judged by the same loop."""

from __future__ import annotations

import base64
import dataclasses
import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from wheelchair_gym.config import InputError, load
from wheelchair_gym.envs import EnvSettings, NavigationEnv
from wheelchair_gym.kinematics import odometric_step
from wheelchair_gym.mapping.log import Log
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.movers import MOVER, Movers
from wheelchair_gym.sensing.settings import LaserSettings
from wheelchair_gym.types import Belief, Episode, Reading, Truth
from wheelchair_gym.view.record import COMMAND, EPISODE, FLOATS, READING, VERDICT

Array = NDArray[np.float64]
Record = dict[str, Any]


class Moment(NamedTuple):
    """What a chair knew, how things were, and what its pose source went by."""

    reading: Reading
    truth: Truth
    belief: Belief


class Chapter(NamedTuple):
    """One episode of a recording; entry k + 1 of the readings follows from action k."""

    settings: EnvSettings
    episode: Episode
    path: Any  # guidance (n, 2) [m], or what guides by ways of the outline, or None
    readings: list[Moment]  # (n + 1,)
    actions: list[NDArray[Any]]  # (n,) of (2,), as they were given
    verdicts: list[Record]  # (n,) of reward, terms, terminated, truncated


class ReplayedChair:
    """A chair that was driven before: it says again what it said, whatever it is asked to do.

    Args:
        readings: the first of an episode, then one a control period.
    """

    def __init__(self, readings: list[Moment]) -> None:
        self._readings = readings
        self._at = 0

    def reset(self, episode: Episode, key: int) -> Reading:
        """The first reading."""
        self._at = 0
        return self._readings[0].reading

    def drive(self, twist: Array, protective: bool = False) -> Reading:
        """The next reading.

        Raises:
            ValueError: there is none.
        """
        if self._at + 1 >= len(self._readings):
            raise ValueError("the recording ends here")
        self._at += 1
        return self._readings[self._at].reading

    @property
    def truth(self) -> Truth:
        """How things were."""
        return self._readings[self._at].truth

    def chart(self) -> OccupancyGrid:
        """The map that the chair had drawn, as it was last recorded."""
        told = self.belief.chart
        assert told is not None  # each episode's first reading holds one
        return told()

    @property
    def belief(self) -> Belief:
        """What the pose source went by."""
        return self._readings[self._at].belief

    def close(self) -> None:
        """Nothing is held."""


def read_recording(file: str | Path) -> list[Chapter]:
    """The episodes of a recording.

    Raises:
        InputError: the extra 'record' is not installed, or the file is no whole recording of ours.
    """
    try:
        from mcap.reader import make_reader
    except ImportError:
        raise InputError("replaying needs: pip install 'wheelchair_gym[record]'") from None
    chapters: list[Chapter] = []
    try:
        with Path(file).open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            messages = reader.iter_messages([EPISODE, READING, COMMAND, VERDICT])
            for _, channel, message in messages:
                _take(chapters, channel.topic, json.loads(message.data))
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror or error})") from None
    except Exception as error:  # whatever readers and decompressors make of damaged bytes
        why = str(error) or type(error).__name__
        raise InputError(f"{file}: expected a whole recording as MCAP ({why})") from None
    if chapters:  # a full disk or an error may have cut the last step
        _cut(chapters)
    for chapter in chapters:
        if not len(chapter.readings) - 1 == len(chapter.actions) == len(chapter.verdicts):
            raise InputError(f"{file}: expected a reading after each command, and a verdict")
    if not chapters:
        raise InputError(f"{file}: expected a recording of a chair; there is no {EPISODE} in it")
    return chapters


def _cut(chapters: list[Chapter]) -> None:
    """Leave out what the last episode holds beyond its last whole step."""
    last = chapters[-1]
    steps = min(len(last.readings) - 1, len(last.actions), len(last.verdicts))
    if steps < 0:
        chapters.pop()
        return
    del last.readings[steps + 1 :], last.actions[steps:], last.verdicts[steps:]


def _take(chapters: list[Chapter], topic: str, content: Record) -> None:
    if topic == EPISODE:
        chapters.append(_begun(content))
    elif topic == READING:
        readings = chapters[-1].readings
        readings.append(_moment(content, readings[-1] if readings else None))
    elif topic == COMMAND:
        chapters[-1].actions.append(np.array(content["action"]))
    else:
        chapters[-1].verdicts.append(content)


def _floats(text: str, kind: DTypeLike) -> NDArray[Any]:
    return np.frombuffer(base64.b64decode(text), kind)


def _grid(content: Record) -> OccupancyGrid:
    cells = _floats(content["cells"], "<i1").reshape(content["shape"])
    return OccupancyGrid(cells, content["resolution"], tuple(content["origin"]))


def _begun(content: Record) -> Chapter:
    episode = Episode(
        _grid(content["map"]),
        np.array(content["start"]),
        np.array(content["goal"]),
        np.array(content["walls"]).reshape(-1, 4),
        np.array(content["discs"]).reshape(-1, 3),
        *(content[name] for name in ("tolerance", "time_limit", "name")),
    )
    if "movers" in content:  # not in recordings of the first release
        rows, routes = _floats(content["movers"], MOVER), np.array(content["routes"])
        episode = dataclasses.replace(episode, movers=Movers(rows, routes.reshape(-1, 2)))
    path = content["path"]
    if isinstance(path, list):
        path = np.array(path)
    settings = load(EnvSettings, content["settings"], EPISODE)
    return Chapter(settings, episode, path, [], [], [])


def _moment(content: Record, before: Moment | None) -> Moment:
    """A moment as it was recorded; what older recordings do not hold is as good as unknown."""
    told = {name: content[name] for name in ("bumped", "stamp")}
    told |= {name: np.array(content[name]) for name in ("pose", "twist")}
    told |= {name: _floats(content[name], "<f4") for name in FLOATS}
    voltage = content["battery"]
    told["battery"] = math.nan if voltage is None else voltage
    real = content["truth"] | {name: np.array(content["truth"][name]) for name in ("pose", "twist")}
    if "movers" in real:
        real["movers"] = _floats(real["movers"], "<f8").reshape(-1, 3)
    particles, chart = content.get("particles"), before.belief.chart if before else None
    if "map" in content:
        grid = _grid(content["map"])
        chart = lambda: grid  # noqa: E731
    belief = Belief(
        np.array(content.get("odometry", content["pose"])),
        None if particles is None else _floats(particles, "<f4").reshape(-1, 3),
        chart,
    )
    return Moment(Reading(**told, halted=content.get("halted", "")), Truth(**real), belief)


def recorded_log(file: str | Path) -> tuple[Log, LaserSettings]:
    """What the wheels and the laser said in a recording's first episode, to build a map of.

    Raises:
        InputError: see `read_recording`.
    """
    chapter = read_recording(file)[0]
    readings = [moment.reading for moment in chapter.readings]
    stamps = np.array([reading.stamp for reading in readings])
    ways = (
        np.array([reading.twist for reading in readings])
        * np.diff(stamps, prepend=stamps[0])[:, None]
    )
    increments = np.array([odometric_step(0.0, 0.0, 0.0, way, turn) for way, turn in ways])
    ranges = np.stack([reading.laser for reading in readings])
    return Log(stamps - stamps[0], increments, ranges, {}), chapter.settings.sensors.laser


def replayed(chapter: Chapter, render_mode: str | None = None) -> NavigationEnv:
    """An environment whose next `reset()` and steps repeat an episode, observed and judged anew."""
    sensors = chapter.settings.sensors
    if sensors.pose_source != "truth":  # the recorded pose is what it came to; nobody looks again
        sensors = dataclasses.replace(sensors, pose_source="odometry")
    path = chapter.path
    guidance = (lambda task: path) if isinstance(path, np.ndarray) else path
    settings = dataclasses.replace(chapter.settings, sensors=sensors, guidance=guidance)
    chair = ReplayedChair(chapter.readings)
    env = NavigationEnv(config=settings, chair=chair, render_mode=render_mode)
    if chapter.settings.sensors.pose_source == "slam":
        env.task.chart = chair.chart
    return env

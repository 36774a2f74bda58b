"""Replay: a recording read back as a chair that was driven before, judged by the same loop."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any, Final, NamedTuple, get_type_hints

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.config import load
from wheelchair_gym.envs import EnvSettings, NavigationEnv
from wheelchair_gym.envs.guidance import is_built_in
from wheelchair_gym.errors import InputError, shown
from wheelchair_gym.files import check_cells, is_coordinate, parse_json, read_bytes
from wheelchair_gym.kinematics import odometric_step
from wheelchair_gym.localization.logs import SensorLog
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.migration import migrated
from wheelchair_gym.physics.actors.records import MOVER, Movers
from wheelchair_gym.recording.decode import mcap_messages, number, numbers, packed_array, value_of
from wheelchair_gym.recording.record import COMMAND, EPISODE, FLOATS, READING, SETTINGS, VERDICT
from wheelchair_gym.sensors.settings import LaserSettings, SensorSettings
from wheelchair_gym.types import Belief, Episode, Reading, Truth

Array = NDArray[np.float64]
Record = dict[str, Any]
_TOPICS: Final = (EPISODE, READING, COMMAND, VERDICT)


class RecordedState(NamedTuple):
    """What a chair knew, how things were, and what its pose source went by."""

    reading: Reading
    truth: Truth
    belief: Belief


class RecordedEpisode(NamedTuple):
    """One episode of a recording; entry k + 1 of the readings follows from action k."""

    settings: EnvSettings
    episode: Episode
    path: Any  # guidance (n, 2) [m], or what guides by ways of the outline, or None
    states: list[RecordedState]  # (n + 1,)
    actions: list[NDArray[Any]]  # (n,) of (2,), as they were given
    verdicts: list[Record]  # (n,) of reward, terms, terminated, truncated


class ReplayedChair:
    """A chair that was driven before: it says again what it said, whatever it is asked to do.

    Args:
        readings: the first of an episode, then one a control period.
    """

    def __init__(self, readings: list[RecordedState]) -> None:
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

    def built_map(self) -> OccupancyGrid:
        """The map that the chair had drawn, as it was last recorded."""
        told = self.belief.built_map
        assert told is not None  # each episode's first reading holds one
        return told()

    @property
    def belief(self) -> Belief:
        """What the pose source went by."""
        return self._readings[self._at].belief

    def close(self) -> None:
        """Nothing is held."""


def read_recording(file: str | Path) -> list[RecordedEpisode]:
    """The episodes of a recording.

    Raises:
        InputError: the extra 'record' is not installed, or the file is no whole recording of ours.
    """
    content = read_bytes(file, "recording")
    chapters: list[RecordedEpisode] = []
    try:
        for topic, text in mcap_messages(content, _TOPICS):
            _take(chapters, topic, parse_json(text, topic))
    except ImportError:
        raise InputError("replaying needs: pip install 'wheelchair_gym[record]'") from None
    except Exception as error:  # whatever readers and decompressors make of damaged bytes
        why = f"no {error}" if isinstance(error, KeyError) else str(error) or type(error).__name__
        why = " ".join(why.split())[:200]
        raise InputError(f"{file}: expected a whole recording as MCAP ({why})") from None
    if chapters:  # a full disk or an error may have cut the last step
        _cut(chapters)
    for chapter in chapters:
        if not len(chapter.states) - 1 == len(chapter.actions) == len(chapter.verdicts):
            raise InputError(f"{file}: expected a reading after each command, and a verdict")
    if not chapters:
        raise InputError(f"{file}: expected a recording of a chair; there is no {EPISODE} in it")
    return chapters


def _cut(chapters: list[RecordedEpisode]) -> None:
    """Leave out what the last episode holds beyond its last whole step."""
    last = chapters[-1]
    steps = min(len(last.states) - 1, len(last.actions), len(last.verdicts))
    if steps < 0:
        chapters.pop()
        return
    del last.states[steps + 1 :], last.actions[steps:], last.verdicts[steps:]


def _take(chapters: list[RecordedEpisode], topic: str, content: Record) -> None:
    if not isinstance(content, dict):
        raise ValueError(f"{topic} holds no object")
    if topic == EPISODE:
        chapters.append(_begun(content))
    elif not chapters:
        raise ValueError(f"{topic} comes before the first {EPISODE}")
    elif topic == READING:
        readings = chapters[-1].states
        before = readings[-1] if readings else None
        readings.append(_moment(content, before, chapters[-1].settings.sensors))
    elif topic == COMMAND:
        chapters[-1].actions.append(numbers(content, "action", (2,)))
    else:
        for name in ("terminated", "truncated"):
            value_of(content, name, bool)
        number(content, "reward")
        for name in value_of(content, "terms", dict):
            number(content["terms"], name)
        chapters[-1].verdicts.append(content)


def _grid(content: Record) -> OccupancyGrid:
    rows, columns = (int(side) for side in numbers(content, "shape", (2,)))
    check_cells(rows, columns, "map")
    x, y, yaw = numbers(content, "origin", (3,)).tolist()
    cells = packed_array(content, "cells", "<i1", rows * columns).reshape(rows, columns)
    grid = OccupancyGrid(cells, number(content, "resolution"), (x, y, yaw))
    if not all(map(is_coordinate, grid.bounds)):
        raise ValueError("the map reaches too far")
    return grid


def _begun(content: Record) -> RecordedEpisode:
    tolerance, time_limit = (
        None if content[name] is None else number(content, name)
        for name in ("tolerance", "time_limit")
    )
    episode = Episode(
        _grid(value_of(content, "map", dict)),
        numbers(content, "start", (3,)),
        numbers(content, "goal", (3,)),
        numbers(content, "walls", (-1, 4)),
        numbers(content, "discs", (-1, 3)),
        tolerance,
        time_limit,
        value_of(content, "name", str),
    )
    if "movers" in content:  # not in recordings of the first release
        rows, routes = packed_array(content, "movers", MOVER), numbers(content, "routes", (-1, 2))
        episode = dataclasses.replace(episode, movers=Movers(rows, routes))
    path = content["path"]
    if isinstance(path, list):
        path = numbers(content, "path", (-1, 3 if path and np.size(path[0]) == 3 else 2))
    elif not is_built_in(path):
        raise ValueError(f"path is {shown(path)}")
    given = value_of(content, "settings", dict)
    if not set(given) <= set(SETTINGS):
        raise ValueError(f"settings has {shown(sorted(given))}; expected {', '.join(SETTINGS)}")
    settings = load(EnvSettings, migrated(given), EPISODE)
    return RecordedEpisode(settings, episode, path, [], [], [])


def _moment(
    content: Record, before: RecordedState | None, sensors: SensorSettings
) -> RecordedState:
    """A moment as it was recorded; what older recordings do not hold is as good as unknown."""
    told: Record = {"bumped": value_of(content, "bumped", bool), "stamp": number(content, "stamp")}
    told |= {"pose": numbers(content, "pose", (3,)), "twist": numbers(content, "twist", (2,))}
    rangers = len(sensors.ultrasonic.mounted)
    sizes = {"laser": sensors.laser.beams, "ultrasonic": rangers, "age": rangers}
    told |= {name: packed_array(content, name, "<f4", sizes[name]) for name in FLOATS}
    told["battery"] = math.nan if content["battery"] is None else number(content, "battery")
    real = dict(value_of(content, "truth", dict))
    for name, kind in get_type_hints(Truth).items():
        if kind is float and name in real:
            real[name] = number(real, name)
        elif kind in (bool, int) and name in real:
            value_of(real, name, kind)
    real |= {"pose": numbers(real, "pose", (3,)), "twist": numbers(real, "twist", (2,))}
    if "movers" in real:
        real["movers"] = packed_array(real, "movers", "<f8").reshape(-1, 3)
    particles, chart = content.get("particles"), before.belief.built_map if before else None
    if "map" in content:
        grid = _grid(value_of(content, "map", dict))
        chart = lambda: grid  # noqa: E731
    belief = Belief(
        numbers(content, "odometry" if "odometry" in content else "pose", (3,)),
        None if particles is None else packed_array(content, "particles", "<f4").reshape(-1, 3),
        chart,
    )
    return RecordedState(
        Reading(**told, halted=str(content.get("halted", ""))), Truth(**real), belief
    )


def sensor_log(file: str | Path) -> tuple[SensorLog, LaserSettings]:
    """What the wheels and the laser said in a recording's first episode, to build a map of.

    Raises:
        InputError: see `read_recording`.
    """
    chapter = read_recording(file)[0]
    readings = [moment.reading for moment in chapter.states]
    stamps = np.array([reading.stamp for reading in readings])
    ways = (
        np.array([reading.twist for reading in readings])
        * np.diff(stamps, prepend=stamps[0])[:, None]
    )
    increments = np.array([odometric_step(0.0, 0.0, 0.0, way, turn) for way, turn in ways])
    ranges = np.stack([reading.laser for reading in readings])
    return SensorLog(stamps - stamps[0], increments, ranges, {}), chapter.settings.sensors.laser


def replay_env(chapter: RecordedEpisode, render_mode: str | None = None) -> NavigationEnv:
    """An environment whose next `reset()` and steps repeat an episode, observed and judged anew."""
    sensors = chapter.settings.sensors
    if sensors.pose_source != "truth":  # the recorded pose is what it came to; nobody looks again
        sensors = dataclasses.replace(sensors, pose_source="odometry")
    path = chapter.path
    guidance = (lambda task: path) if isinstance(path, np.ndarray) else path
    settings = dataclasses.replace(chapter.settings, sensors=sensors, guidance=guidance)
    chair = ReplayedChair(chapter.states)
    env = NavigationEnv(config=settings, chair=chair, render_mode=render_mode)
    if chapter.settings.sensors.pose_source == "slam":
        env.task.built_map = chair.built_map
    return env

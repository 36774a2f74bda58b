"""Replay: a recording is read as a chair that was driven before, judged by the same loop.

Files are unpacked within limits; what is damaged is refused with the file's name.
"""

from __future__ import annotations

import base64
import dataclasses
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, get_type_hints

import numpy as np
from numpy.typing import DTypeLike, NDArray

from wheelchair_gym.config import load
from wheelchair_gym.envs import EnvSettings, NavigationEnv
from wheelchair_gym.envs.guidance import is_built_in
from wheelchair_gym.errors import InputError, shorten
from wheelchair_gym.files import LIMITS, check_cells, is_coordinate, parse_json, read_bytes
from wheelchair_gym.kinematics import odometric_step
from wheelchair_gym.localization.logs import SensorLog
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.migration import migrated
from wheelchair_gym.physics.actors.records import ACTOR, Actors
from wheelchair_gym.recording.record import COMMAND, EPISODE, FLOATS, READING, SETTINGS, VERDICT
from wheelchair_gym.sensors.settings import LaserSettings, SensorSettings
from wheelchair_gym.types import Belief, Episode, Reading, Truth

Array = NDArray[np.float64]


def mcap_messages(content: bytes, topics: Sequence[str]) -> list[tuple[str, bytes]]:
    """Topics and texts of messages on these topics, in the order of their time.

    Raises:
        ImportError: the extra 'record' is not installed.
        ValueError, McapError: the file is damaged, or beyond a limit.
    """
    from mcap.records import Channel, Chunk, Message
    from mcap.stream_reader import StreamReader, breakup_chunk

    names: dict[int, str] = {}
    found: list[tuple[int, str, bytes]] = []
    unpacked = 0
    for record in StreamReader(io.BytesIO(content), emit_chunks=True, validate_crcs=True).records:
        records: list[Any] = [record]
        if isinstance(record, Chunk):
            record.data = _decompressed(record.compression, record.data)
            record.compression = ""
            unpacked += len(record.data)
            if unpacked > LIMITS["unpacked"].most:
                raise ValueError(f"more than {LIMITS['unpacked'].most:,} bytes unpacked")
            records = breakup_chunk(record, validate_crc=True)
        for inner in records:
            if isinstance(inner, Channel):
                names[inner.id] = inner.topic
            elif isinstance(inner, Message) and names[inner.channel_id] in topics:
                found.append((inner.log_time, names[inner.channel_id], inner.data))
    found.sort(key=lambda message: message[0])  # stable: equal times stay in the file's order
    return [(topic, data) for _, topic, data in found]


def _decompressed(compression: str, data: bytes) -> bytes:
    """The content of a chunk, no longer than the limit whatever its header says."""
    most = LIMITS["chunk"].most
    if compression == "":
        content = data
    elif compression == "zstd":
        import zstandard

        with zstandard.ZstdDecompressor(max_window_size=most).stream_reader(data) as stream:
            content = stream.read(most + 1)
    elif compression == "lz4":
        import lz4.frame

        content = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most + 1)
    else:
        raise ValueError(f"compression {shorten(compression)} is unknown")
    if len(content) > most:
        raise ValueError(f"a chunk of more than {most:,} bytes")
    return content


def value_of(content: Mapping[str, Any], name: str, kind: type) -> Any:
    """The value of a key, of this type."""
    value = content[name]
    if type(value) is not kind:
        raise ValueError(f"{name} is {shorten(value)}")
    return value


def number(content: Mapping[str, Any], name: str) -> float:
    """The value of a key, a number as large as a coordinate may be."""
    if not is_coordinate(content[name]):
        raise ValueError(f"{name} is {shorten(content[name])}")
    return float(content[name])


def numbers(content: Mapping[str, Any], name: str, shape: tuple[int, ...]) -> Array:
    """The value of a key, an array (*shape) of coordinates; -1 is any length."""
    values = np.array(value_of(content, name, list), dtype=np.float64)
    if values.size == 0 and -1 in shape:
        values = np.empty([max(0, side) for side in shape])
    fits = values.ndim == len(shape) and all(
        wanted in (-1, side) for side, wanted in zip(values.shape, shape, strict=True)
    )
    if not fits or not (np.abs(values) <= LIMITS["coordinate"].most).all():
        raise ValueError(f"{name} is {shorten(content[name])}")
    return values


def packed_array(
    content: Mapping[str, Any], name: str, kind: DTypeLike, size: int = -1
) -> NDArray[Any]:
    """The value of a key, an array (size,) as `recording.record.packed` wrote it; -1: any size."""
    # Of bytes that may be written to: for read-only arrays, kernels would be compiled once more.
    data = bytearray(base64.b64decode(value_of(content, name, str), validate=True))
    values = np.frombuffer(data, kind)
    if size not in (-1, len(values)):
        raise ValueError(f"{name} has {len(values)} values; expected {size}")
    return values


Record = dict[str, Any]
_TOPICS: Final = (EPISODE, READING, COMMAND, VERDICT)


class RecordedState(NamedTuple):
    """Reading, truth and belief of one recorded instant."""

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
    """A chair that returns recorded readings, whatever the command.

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
    """Cut the last episode after its last complete step."""
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
        content["terms"] = migrated(content["terms"], "task.reward")
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
        rows, routes = packed_array(content, "movers", ACTOR), numbers(content, "routes", (-1, 2))
        episode = dataclasses.replace(episode, actors=Actors(rows, routes))
    path = content["path"]
    if isinstance(path, list):
        path = numbers(content, "path", (-1, 3 if path and np.size(path[0]) == 3 else 2))
    elif not is_built_in(path):
        raise ValueError(f"path is {shorten(path)}")
    given = value_of(content, "settings", dict)
    if not set(given) <= set(SETTINGS):
        raise ValueError(f"settings has {shorten(sorted(given))}; expected {', '.join(SETTINGS)}")
    settings = load(EnvSettings, migrated(given), EPISODE)
    return RecordedEpisode(settings, episode, path, [], [], [])


def _moment(
    content: Record, before: RecordedState | None, sensors: SensorSettings
) -> RecordedState:
    """A recorded instant; fields missing in older recordings count as unknown."""
    told: Record = {"bumped": value_of(content, "bumped", bool), "stamp": number(content, "stamp")}
    told |= {"pose": numbers(content, "pose", (3,)), "twist": numbers(content, "twist", (2,))}
    rangers = len(sensors.ultrasonic.mounted)
    sizes = {"laser": sensors.laser.beams, "ultrasonic": rangers, "age": rangers}
    told |= {name: packed_array(content, name, "<f4", sizes[name]) for name in FLOATS}
    told["battery"] = math.nan if content["battery"] is None else number(content, "battery")
    real = migrated(value_of(content, "truth", dict), "truth")
    for name, kind in get_type_hints(Truth).items():
        if kind is float and name in real:
            real[name] = number(real, name)
        elif kind in (bool, int) and name in real:
            value_of(real, name, kind)
    real |= {"pose": numbers(real, "pose", (3,)), "twist": numbers(real, "twist", (2,))}
    if "actor_poses" in real:
        real["actor_poses"] = packed_array(real, "actor_poses", "<f8").reshape(-1, 3)
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
    """Odometry and scans of a recording's first episode, for mapping.

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
    """An environment whose next `reset()` and steps replay an episode and judge it again."""
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

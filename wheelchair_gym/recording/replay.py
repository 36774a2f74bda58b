"""Replays a recording as a chair that returns recorded readings, judged by the same loop.

Files are unpacked within limits; damaged ones are refused with the file's name.
"""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.arrays import Array
from wheelchair_gym.config import load
from wheelchair_gym.envs import EnvSettings, NavigationEnv
from wheelchair_gym.envs.guidance import is_built_in
from wheelchair_gym.errors import InputError, shorten
from wheelchair_gym.files import LIMITS, parse_json, read_bytes
from wheelchair_gym.kinematics import odometric_step
from wheelchair_gym.localization.logs import SensorLog
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.migration import migrated
from wheelchair_gym.physics.actors.records import ACTOR, Actors
from wheelchair_gym.recording.topics import (
    COMMAND,
    EPISODE,
    FIELDS,
    READING,
    SETTINGS,
    VERDICT,
    Content,
    numbers,
    read_fields,
    reading_fields,
    widened_actors,
)
from wheelchair_gym.sensors.settings import RANGERS, LaserSettings, SensorSettings
from wheelchair_gym.types import Belief, Episode, Reading, Truth


def mcap_messages(content: bytes, topics: Sequence[str]) -> list[tuple[str, bytes]]:
    """Topics and texts of messages on these topics, in the order of their times.

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
    """The content of a chunk, which must not exceed the limit."""
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


_TOPICS: Final = (EPISODE, READING, COMMAND, VERDICT)


class RecordedState(NamedTuple):
    """Reading, truth and belief of one recorded instant."""

    reading: Reading
    truth: Truth
    belief: Belief


class RecordedEpisode(NamedTuple):
    """One episode of a recording; state k + 1 follows from action k."""

    settings: EnvSettings
    episode: Episode
    path: Any  # guidance (n, 2) [m], or its settings, or None
    states: list[RecordedState]  # (n + 1,)
    actions: list[NDArray[Any]]  # (n,) of (2,)
    verdicts: list[Content]  # (n,) of reward, terms, terminated, truncated


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
        """The recorded truth."""
        return self._readings[self._at].truth

    def built_map(self) -> OccupancyGrid:
        """The map that the chair had built, as last recorded."""
        built_map = self.belief.built_map
        assert built_map is not None  # the first reading of each episode has one
        return built_map()

    @property
    def belief(self) -> Belief:
        """The recorded belief."""
        return self._readings[self._at].belief

    def close(self) -> None:
        """Do nothing: no resource is held."""


def read_recording(file: str | Path) -> list[RecordedEpisode]:
    """The episodes of a recording.

    Raises:
        InputError: the extra 'record' is not installed, or the file is no complete recording.
    """
    content = read_bytes(file, "recording")
    episodes: list[RecordedEpisode] = []
    try:
        for topic, text in mcap_messages(content, _TOPICS):
            _take(episodes, topic, parse_json(text, topic))
    except ImportError:
        raise InputError("replaying needs: pip install 'wheelchair_gym[record]'") from None
    except Exception as error:  # of readers and decompressors, for damaged bytes
        why = f"no {error}" if isinstance(error, KeyError) else str(error) or type(error).__name__
        why = " ".join(why.split())[:200]
        raise InputError(f"{file}: expected a complete recording as MCAP ({why})") from None
    if episodes:  # a full disk or an error may have cut the last step
        _cut(episodes)
    for recorded in episodes:
        if not len(recorded.states) - 1 == len(recorded.actions) == len(recorded.verdicts):
            raise InputError(f"{file}: expected a reading after each command, and a verdict")
    if not episodes:
        raise InputError(f"{file}: expected a recording of a chair; there is no {EPISODE} in it")
    return episodes


def _cut(episodes: list[RecordedEpisode]) -> None:
    """Cut the last episode after its last complete step."""
    last = episodes[-1]
    steps = min(len(last.states) - 1, len(last.actions), len(last.verdicts))
    if steps < 0:
        episodes.pop()
        return
    del last.states[steps + 1 :], last.actions[steps:], last.verdicts[steps:]


def _take(episodes: list[RecordedEpisode], topic: str, content: Any) -> None:
    """Add a message to the episodes."""
    if not isinstance(content, dict):
        raise ValueError(f"{topic} holds no object")
    if topic == EPISODE:
        episodes.append(_read_episode(content))
    elif not episodes:
        raise ValueError(f"{topic} comes before the first {EPISODE}")
    elif topic == READING:
        states = episodes[-1].states
        before = states[-1].belief if states else None
        states.append(_read_state(content, before, episodes[-1].settings.sensors))
    elif topic == COMMAND:
        episodes[-1].actions.append(FIELDS[COMMAND]["action"].read(content["action"]))
    else:
        episodes[-1].verdicts.append(read_fields(FIELDS[VERDICT], content))


def _read_episode(content: Content) -> RecordedEpisode:
    if "movers" in content:  # until release 0.1
        content["actors"] = content.pop("movers")
    if "actors" in content and "actor_size" not in content:  # until release 0.2
        content["actors"] = widened_actors(content["actors"])
    # Recordings of the first release have no actors.
    values = read_fields(FIELDS[EPISODE], content, "actors", "routes", "actor_size")
    given, routes = values.pop("settings"), values.pop("routes", None)
    size = values.pop("actor_size", ACTOR.itemsize)
    if size != ACTOR.itemsize:
        raise ValueError(f"actor_size is {size}; expected {ACTOR.itemsize}")
    if "actors" in values:
        values["actors"] = Actors(values["actors"], routes)
    path = content["path"]
    if isinstance(path, list):
        path = numbers(-1, 3 if path and np.size(path[0]) == 3 else 2).read(path)
    elif not is_built_in(path):
        raise ValueError(f"path is {shorten(path)}")
    if not set(given) <= set(SETTINGS):
        raise ValueError(f"settings has {shorten(sorted(given))}; expected {', '.join(SETTINGS)}")
    settings = load(EnvSettings, migrated(given), EPISODE)
    return RecordedEpisode(settings, Episode(**values), path, [], [], [])


def _read_state(content: Content, before: Belief | None, sensors: SensorSettings) -> RecordedState:
    """A recorded instant; fields that older recordings lack count as unknown."""
    fields = reading_fields(sensors.beams, RANGERS)
    values = read_fields(fields, content, "halted", "odometry", "particles", "map")
    built_map = before.built_map if before else None
    if "map" in values:
        grid = values.pop("map")
        built_map = lambda: grid  # noqa: E731
    odometry = values.pop("odometry", values["pose"])
    belief = Belief(odometry, values.pop("particles", None), built_map)
    truth = values.pop("truth")
    return RecordedState(Reading(**{"halted": "", **values}), truth, belief)


def sensor_log(file: str | Path) -> tuple[SensorLog, LaserSettings]:
    """Odometry and scans of a recording's first episode, for mapping.

    Raises:
        InputError: see `read_recording`.
    """
    recorded = read_recording(file)[0]
    readings = [moment.reading for moment in recorded.states]
    stamps = np.array([reading.stamp for reading in readings])
    periods = np.diff(stamps, prepend=stamps[0])[:, None]
    motions = np.array([reading.twist for reading in readings]) * periods
    increments = np.array([odometric_step(0.0, 0.0, 0.0, *motion) for motion in motions])
    laser = recorded.settings.sensors.laser
    if not laser.beams:
        raise InputError(f"{file}: expected the scans of a laser; the chair has none")
    ranges = np.stack([reading.laser[: laser.beams] for reading in readings])
    return SensorLog(stamps - stamps[0], increments, ranges, {}), laser


def replay_env(recorded: RecordedEpisode, render_mode: str | None = None) -> NavigationEnv:
    """An environment whose next `reset()` and steps replay an episode and judge it again."""
    sensors = recorded.settings.sensors
    if sensors.pose_source != "truth":  # the recorded pose is the result: no localizer runs again
        sensors = dataclasses.replace(sensors, pose_source="odometry")
    path = recorded.path
    guidance = (lambda task: path) if isinstance(path, np.ndarray) else path
    settings = dataclasses.replace(recorded.settings, sensors=sensors, guidance=guidance)
    chair = ReplayedChair(recorded.states)
    env = NavigationEnv(config=settings, chair=chair, render_mode=render_mode)
    if recorded.settings.sensors.pose_source == "slam":
        env.task.built_map = chair.built_map
    return env

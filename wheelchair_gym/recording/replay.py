"""Replays a recording as a chair that returns recorded readings, judged by the same loop."""

import dataclasses
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.actors.records import ACTOR, Actors
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.errors import InputError, shorten
from wheelchair_gym.base.files import parse_json
from wheelchair_gym.base.settings import UnknownKeyError, load
from wheelchair_gym.compiled.random import Split
from wheelchair_gym.envs import EnvSettings, NavigationEnv
from wheelchair_gym.envs.guidance import is_built_in
from wheelchair_gym.envs.settings import check_split
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.people.drivers import DRIVERS
from wheelchair_gym.perception.logs import SensorLog, log_of_poses
from wheelchair_gym.recording import topics
from wheelchair_gym.recording.read_bags import bag_log, bag_texts, complete, is_bag, mcap_messages
from wheelchair_gym.recording.topics import EPISODE, SETTINGS, Content
from wheelchair_gym.sensors.settings import LaserSettings, SensorSettings
from wheelchair_gym.types import Belief, Chair, Episode, Reading, Stick, Truth

_TOPICS: Final = (EPISODE, topics.READING, topics.COMMAND, topics.VERDICT, topics.WHEELS)


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
    labels: Content  # who drove, by `NavigationEnv.labels`, at the beginning
    seed: int
    number: int  # of the episode, of that seed
    split: Split
    states: list[RecordedState]  # (n + 1,)
    actions: list[NDArray[Any]]  # (n,) of (2,)
    verdicts: list[Content]  # (n,) of reward, terms, terminated, truncated
    wheels: list[Content]  # (n + 1,) reports about the wheels and times of scans, where recorded
    changed: tuple[str, ...] = ()  # labels that changed in mid-drive

    @property
    def has_person(self) -> bool:
        """Whether a person drove, whose stick was recorded."""
        return self.states[0].reading.stick is not None


class ReplayedChair(Chair):
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
        if self.ended:
            raise ValueError("the recording ends here")
        self._at += 1
        return self._readings[self._at].reading

    def stick(self) -> Stick:
        """The stick of the person who drove."""
        stick = self._readings[self._at].reading.stick
        if stick is None:
            raise ValueError("a reading has no stick, though a person drove")
        return stick

    @property
    def ended(self) -> bool:
        """Whether the latest reading was the last one."""
        return self._at + 1 >= len(self._readings)

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


def read_recording(file: str | Path) -> list[RecordedEpisode]:
    """The episodes of a recording, also of one in the format ros2.

    An MCAP file that was cut off is read as far as it goes, with a warning.

    Raises:
        InputError: the extra 'record' or 'ros' is not installed, the file is damaged, or nothing
            that was driven is in it.
    """
    episodes: list[RecordedEpisode] = []
    texts: Iterable[tuple[str, str | bytes]]
    if is_bag(file):
        texts = bag_texts(file, _TOPICS)
    else:
        found = mcap_messages(file, lambda topic, _: topic in _TOPICS)
        texts = ((one.topic, one.data) for one in found)
    with complete(file):
        for topic, text in texts:
            _take(episodes, topic, parse_json(text, topic))
    if episodes:  # a full disk or an error may have cut the last step
        last = episodes[-1]
        steps = min(len(last.states) - 1, len(last.actions), len(last.verdicts))
        if steps < 0:
            episodes.pop()
        else:
            del last.states[steps + 1 :], last.actions[steps:], last.verdicts[steps:]
            del last.wheels[steps + 1 :]
    for recorded in episodes:
        if not len(recorded.states) - 1 == len(recorded.actions) == len(recorded.verdicts):
            raise InputError(f"{file}: expected a reading after each command, and a verdict")
    if not episodes:
        raise InputError(f"{file}: expected a recording of a chair; there is no {EPISODE} in it")
    return episodes


def _take(episodes: list[RecordedEpisode], topic: str, content: Any) -> None:
    """Add a message to the episodes."""
    if not isinstance(content, dict):
        raise ValueError(f"{topic} holds no object")
    if topic == EPISODE:
        episodes.append(_read_episode(content))
    elif not episodes:
        raise ValueError(f"{topic} comes before the first {EPISODE}")
    elif topic == topics.READING:
        states = episodes[-1].states
        before = states[-1].belief if states else None
        states.append(_read_state(content, before, episodes[-1].settings.sensors))
    elif topic == topics.COMMAND:
        episodes[-1] = _take_command(episodes[-1], content)
    elif topic == topics.WHEELS:
        episodes[-1].wheels.append(topics.read_fields(topics.FIELDS[topics.WHEELS], content))
    else:
        episodes[-1].verdicts.append(topics.read_fields(topics.FIELDS[topics.VERDICT], content))


def _take_command(recorded: RecordedEpisode, content: Content) -> RecordedEpisode:
    """The episode with one more command, and with the stick and the labels that came with it."""
    fields = {name: topics.FIELDS[topics.COMMAND][name] for name in ("action", "stick", "labels")}
    values = topics.read_fields(fields, content, "stick", "labels")
    recorded.actions.append(values["action"])
    if "stick" in values:
        if not recorded.states:
            raise ValueError(f"{topics.COMMAND} comes before the first {topics.READING}")
        state = recorded.states[-1]
        reading = state.reading._replace(stick=values["stick"])
        recorded.states[-1] = state._replace(reading=reading)
    labels, before = values.get("labels", recorded.labels), recorded.labels
    changed = {name for name in {**labels, **before} if labels.get(name) != before.get(name)}
    return recorded._replace(changed=tuple(sorted(changed.union(recorded.changed))))


def _read_episode(content: Content) -> RecordedEpisode:
    if content.get("actor_size") != ACTOR.itemsize:
        raise ValueError(
            f"another release wrote it (actor_size is {shorten(content.get('actor_size'))}, "
            f"expected {ACTOR.itemsize}): read it with that one"
        )
    values = topics.read_fields(topics.FIELDS[EPISODE], content, "boards")
    values.pop("boards", None)
    names = "settings", "seed", "number", "split", "labels", "routes", "actor_size"
    given, seed, number, split, labels, routes, _ = map(values.pop, names)
    values["actors"] = Actors(values["actors"], routes)
    path = content["path"]
    if isinstance(path, list):
        path = topics.numbers(-1, 3 if path and np.size(path[0]) == 3 else 2).read(path)
    elif not is_built_in(path):
        raise ValueError(f"path is {shorten(path)}")
    if not set(given) <= set(SETTINGS):
        raise ValueError(f"settings has {shorten(sorted(given))}; expected {', '.join(SETTINGS)}")
    driver = given.get("driver")
    if driver is not None and (
        not isinstance(driver, dict) or driver.get("name") not in DRIVERS.built_in
    ):  # a name may stand for code
        raise ValueError(f"driver is {shorten(driver)}")
    try:
        settings = load(EnvSettings, given, EPISODE)
    except UnknownKeyError as error:
        raise ValueError(f"another release wrote it ({error}): read it with that one") from None
    episode = Episode(**values)
    return RecordedEpisode(
        settings, episode, path, labels, seed, number, check_split(split), [], [], [], []
    )


def _read_state(content: Content, before: Belief | None, sensors: SensorSettings) -> RecordedState:
    """A recorded instant."""
    fields = topics.reading_fields(sensors)
    values = topics.read_fields(fields, content, "particles", "map", "stick")
    built_map = before.built_map if before else None
    if "map" in values:
        grid = values.pop("map")
        built_map = lambda: grid  # noqa: E731
    belief = Belief(values.pop("odometry"), values.pop("particles", None), built_map)
    truth = values.pop("truth")
    return RecordedState(Reading(**values), truth, belief)


def sensor_log(
    file: str | Path, scan: str = "", odometry: str = ""
) -> tuple[SensorLog, LaserSettings]:
    """Odometry and scans of a recording's first episode, or of a bag, for mapping.

    Args:
        file: a recording, or a ROS 2 bag of any robot.
        scan: the bag's topic of scans; empty: /scan, or the only one.
        odometry: the bag's topic of odometry; empty: /odom, or the only one.

    Raises:
        InputError: see `read_recording` and `bag_log`.
    """
    if is_bag(file):
        return bag_log(file, scan, odometry)
    for name, given in (("--scan-topic", scan), ("--odometry-topic", odometry)):
        if given:
            raise InputError(f"{name} {given}: {file} is no ROS 2 bag")
    recorded = read_recording(file)[0]
    laser = recorded.settings.sensors.laser
    if not laser.beams:
        raise InputError(f"{file}: expected the scans of a laser; the chair has none")
    stamps = np.array([state.reading.stamp for state in recorded.states])
    poses = np.array([state.belief.odometry for state in recorded.states])
    ranges = np.stack([state.reading.laser[: laser.beams] for state in recorded.states])
    return log_of_poses(stamps, poses, ranges), laser


def replay_env(recorded: RecordedEpisode, render_mode: str | None = None) -> NavigationEnv:
    """An environment whose next `reset()` and steps replay an episode and judge it again."""
    sensors = recorded.settings.sensors
    if sensors.pose_source != "truth":  # the recorded pose is the result: no localizer runs again
        sensors = dataclasses.replace(sensors, pose_source="odometry")
    path = recorded.path
    guidance = (lambda task: path) if isinstance(path, np.ndarray) else path
    settings = dataclasses.replace(
        recorded.settings, sensors=sensors, guidance=guidance, driver=None
    )
    chair = ReplayedChair(recorded.states)
    person = chair.stick if recorded.has_person else None
    env = NavigationEnv(
        config=settings, split=recorded.split, chair=chair, person=person, render_mode=render_mode
    )
    env.labels = dict(recorded.labels)
    if recorded.settings.sensors.pose_source == "slam":
        env.task.built_map = chair.built_map
    return env

"""One drive: a person's stick through hand and assistant to the environment, and its pictures.

The page Compare draws the course of an episode, driven or recorded; a recording becomes a film.
"""

import dataclasses
import math
import re
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from agents.evaluation.metrics import Ending, Shortest, given_map, shortest_path, touches
from agents.people import is_shielded, make_assistant
from agents.people.assistant import AssistMission
from agents.studio.catalogue import ANY_TIME, NO_HAND, NO_SIGHT, Place
from wheelchair_gym.actors.records import ACTOR_KINDS
from wheelchair_gym.base.settings import InputError, dump
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.people.drivers import make_driver
from wheelchair_gym.people.drivers.intention import NEAR_GOAL
from wheelchair_gym.people.drivers.live_person import LiveInput, LiveSight, scanning
from wheelchair_gym.people.drivers.settings import Perception
from wheelchair_gym.perception.tracker import Tracker
from wheelchair_gym.recording.record import RecordEpisodes
from wheelchair_gym.recording.replay import RecordedEpisode, read_recording, replay_env
from wheelchair_gym.rendering.floor import closed_loops
from wheelchair_gym.rendering.video import video_suffix, write_video
from wheelchair_gym.safety.stops import active_stops
from wheelchair_gym.types import Stick

_REST: Final = 0.02  # m/s, rad/s: slower is at rest
_LONGEST_STOP: Final = 5.0  # s in which a chair that is let go comes to rest
HELP: Final = 0.05  # m/s, rad/s: more than this changed of a stick's twist is help
_TOUCHED: Final = 0.01  # deflection below which a stick is centred
_FINE, _FINE_STEP = 40, 0.005  # Hz, s: its period is no multiple of the usual step of 0.01 s
_NOTHING: Final = Stick(0.0, 0.0, False)


@dataclass(frozen=True)
class Order:
    """Order of a drive: place, seed, assistant, hand, rate, recording and sight."""

    key: str  # of the place
    place: Place
    seed: int
    assist: Any
    hand: Any
    rate: int  # Hz, of control and of pictures
    file: Path | None = None  # of the recording; None: named after the order, in a folder
    sight: str | Perception = NO_SIGHT  # of whom; or what is seen and noticed


class Drive:
    """An episode that a person drives; the clock stands until they first move the stick.

    Args:
        order: what is driven.
        folder: where the recording goes.
        scan_period: of a single switch [s]; 0: the person has a stick.

    Attributes:
        steps: driven so far.
        over: the episode has ended.
        note: why the drive is not recorded; empty: it is.
        file: of the recording; None: there is none.

    Raises:
        InputError: the place cannot be drawn, or the file cannot be written.
    """

    def __init__(self, order: Order, folder: Path, scan_period: float = 0.0) -> None:
        self.order, self.steps, self.over = order, 0, False
        place = order.place
        env = {**place.env, "rate": order.rate, "shield": is_shielded(order.assist)}
        env["guidance"] = None  # nobody is shown the way of a person
        if order.rate == _FINE:
            env["config"] = {**place.env.get("config", {}), "physics": {"step": _FINE_STEP}}
        if place.twin:
            from wheelchair_gym.hardware.registry import localized
            from wheelchair_gym.hardware.twin.inprocess import EpisodeTwin

            settings = env_settings(env.pop("config", None), scene=place.scene, **env)
            env = {"config": settings, "chair": localized(EpisodeTwin(settings), settings)}
        else:
            env["scene"] = place.scene
        self._world: Any = NavigationEnv(split="test", person=lambda: self._stick, **env)
        self._env: Any = self._world  # recorded, where it can be
        self.note, self.file = "", None
        try:
            label = re.sub(r"[^\w.-]+", "_", order.place.label)
            name = f"{time.strftime('%Y%m%d-%H%M%S')}-{label}-{order.seed}-{order.assist}.mcap"
            self._env = RecordEpisodes(self._world, order.file or folder / name)
            self.file = Path(self._env.file)
        except InputError as error:  # without the extra, or on a full disk, people drive anyway
            self.note = str(error)
        try:
            self._begin()
            self.set_device(scan_period)
            self.set_sight(order.sight)
            self.set_assistant(order.assist)
        except BaseException:
            self.close()
            raise
        sensors = self._world.settings.sensors
        episode: Any = self._world.episode
        moving = bool(len(episode.actors)) and sensors.laser.beams > 0
        self._tracker = Tracker(laser=sensors.laser) if moving else None
        self._tracks: list[Any] = []

    def _begin(self) -> None:
        self._stick = self._asked = _NOTHING
        self._by = ""
        seed = self.order.seed
        _, self._info = self._world.reset(seed=seed)
        if not self.order.place.timed:
            episode = dataclasses.replace(self._world.episode, time_limit=ANY_TIME)
            _, self._info = self._world.reset(seed=seed, options={"episode": episode})
        self._start, self._minimum = self._info["pose"], self._info["clearance"]
        self._changed, self._truncated = 0, False
        self._ending = self._new_ending()
        self._ending.given_map = given_map(self._world)
        self._ending.add(self._info)

    def _new_ending(self) -> Ending:
        return Ending()

    def set_assistant(self, name: Any) -> None:
        """Change the assistant from now on.

        Raises:
            InputError: it is driven with a shield and this one is not, or the other way round; or
                it does not fit the chair. The previous assistant goes on.
        """
        if is_shielded(name) != is_shielded(self.order.assist):
            raise InputError(f"assistant {name}: expected a new drive, since the shield changes")
        world = self._world
        assistant = make_assistant(name)
        mission = AssistMission(world.settings.chair, world.settings.sensors, world.task.period)
        assistant.reset(mission)
        assistant.assist(_NOTHING, world.reading, world.task.map)  # compiled before it drives
        assistant.reset(mission)
        self._assistant = assistant
        self.order = dataclasses.replace(self.order, assist=name)

    def set_hand(self, name: str) -> None:
        """Put the hand of a simulated person on the stick from now on."""
        self.order = dataclasses.replace(self.order, hand=name)
        self.set_device(self._scan_period)

    def set_sight(self, sight: str | Perception) -> None:
        """Hide from now on what a simulated person, or one with such a perception, does not see."""
        self.order, self._sight = dataclasses.replace(self.order, sight=sight), None
        if sight != NO_SIGHT:
            seen = sight if isinstance(sight, Perception) else make_driver(sight).perception
            self._sight = LiveSight(seen, self._world.task.key)

    def set_device(self, scan_period: float) -> None:
        """Take a single switch with a scan period [s]; 0: a stick, in the order's hand."""
        self._scan_period, self._hand = scan_period, None
        settings, period = self._world.settings, self._world.task.period
        driver = None
        if scan_period > 0.0:
            driver = scanning(scan_period)
        elif self.order.hand != NO_HAND:
            driver = make_driver(self.order.hand)
        if driver is not None:
            self._hand = LiveInput(driver, settings.chair, settings.sensors, period)
            self._hand.begin(self._world.task.key)

    def press(self) -> None:
        """Press the single switch."""
        if self._hand is not None:
            self._hand.press()

    def release_switch(self) -> None:
        """Stop what a single switch drives; its scan begins anew."""
        if self._scan_period > 0.0 and self._hand is not None:
            self._hand.begin(self._world.task.key)

    def step(self, forward: float, left: float, by: str = "") -> None:
        """Advance one control period with a deflection; before the first one, time stands.

        Args:
            forward: deflection, in [-1, 1].
            left: the same to the left.
            by: what moves the stick: an `--input` of `wheelchair drive`, or touch.
        """
        if self.over:
            return
        if forward or left:
            self._by = by
        self._asked = _NOTHING._replace(forward=forward, left=left)
        pose = self._world.chair.truth.pose
        stick = self._asked
        if self._hand is not None:
            goal = self._world.episode.goal
            near = math.hypot(goal[0] - pose[0], goal[1] - pose[1]) < NEAR_GOAL
            stick = self._hand.step(forward, left, float(pose[2]), near)
        scans = self._scan_period > 0.0 and any(stick[:2])
        moved = max(abs(forward), abs(left)) > _TOUCHED or scans
        if self.steps or moved:
            self._advance(stick if self.steps else _NOTHING)  # an episode begins at rest

    def _advance(self, stick: Stick) -> None:
        world, task = self._world, self._world.task
        world.labels = self._labels()
        if not self.steps and self._env is not world:  # only now is it known by what they drive
            self._env.reset(seed=self.order.seed, options={"episode": world.episode})
        self._stick = stick
        task.replace_stick(stick)
        twist = self._assistant.assist(stick, world.reading, task.map)
        action = task.limits.action(np.asarray(twist, np.float64))
        _, _, ended, truncated, info = self._env.step(action)
        self._info, self.steps = info, self.steps + 1
        self.over, self._truncated = bool(ended or truncated), bool(truncated and not ended)
        self._minimum = min(self._minimum, info["clearance"])
        self._ending.add(info)
        self._given = task.limits.twist(action) - np.array(task.shield_intervention)
        asked = task.limits.twist_of(stick.forward, stick.left)
        self._changed += bool(np.abs(self._given - asked).max() > HELP)
        if self._tracker is not None:
            self._track()

    def _labels(self) -> dict[str, Any]:
        """Labels of the driver for the recording; also how they differ from a healthy person."""
        order, by = self.order, self._by
        labels = {"assistant": order.assist}
        if self._hand is not None:  # what is recorded is what it makes of the person's
            by = self._hand.driver.interface.kind
            is_simulated = order.hand != NO_HAND and not self._scan_period
            labels |= {"hand": order.hand} if is_simulated else {}
        if order.sight != NO_SIGHT:
            sight = order.sight
            labels["sight"] = dump(sight) if isinstance(sight, Perception) else sight
        return labels | {"interface": by}

    def _track(self) -> None:
        assert self._tracker is not None
        reading, sensors = self._world.task.reading, self._world.settings.sensors
        scan = reading.laser[sensors.slices[0]]
        tracks = self._tracker.update(scan, reading.pose, reading.twist, reading.stamp)
        self._tracks = [
            [int(tracks.id[k]), *tracks.place[k], *tracks.velocity[k], tracks.radius[k]]
            for k in np.flatnonzero(tracks.confirmed)
        ]

    def rest(self) -> None:
        """Release the stick until the chair stands; simulated time runs as fast as it can."""
        world = self._world
        for _ in range(math.ceil(_LONGEST_STOP / world.task.period)):
            if self.over or not self.steps or np.abs(world.chair.truth.twist).max() < _REST:
                return
            self._advance(_NOTHING)

    def close(self) -> None:
        """Bring the chair to rest and complete the recording; without any step there is none."""
        try:
            self.rest()
        finally:
            self._env.close()
            if self.file is not None and not self.steps:
                self.file.unlink(missing_ok=True)
                self.file = None

    def shortest(self) -> Shortest:
        """Return the shortest path of the drive, which compiles its search at first use."""
        return shortest_path(self._world.task, self._world.episode, self._start)

    def summary(self) -> dict[str, Any]:
        """The figures of the drive so far, and its outcome as `compare` names it."""
        info = self._info
        outcome = self._ending.outcome(info, self._truncated) if self.over else "stopped"
        return {
            "outcome": outcome, "time": float(info["time"]), "length": float(info["distance"]),
            "shortest": self.shortest().length, "clearance_min": float(self._minimum),
            "energy": float(info["energy"]), "changed": self._changed / max(1, self.steps),
            "file": None if self.file is None else self.file.name, "note": self.note,
        }  # fmt: skip

    def world(self) -> dict[str, Any]:
        """Return the constants of a drive: walls, sensors, the chair, kinds of actors, order."""
        return {
            **world_of(self._world), "order": {
                "place": self.order.key, "seed": self.order.seed, "assist": self.order.assist,
                "hand": self.order.hand, "rate": self.order.rate,
            }, "recorded": self.file is not None, "note": self.note,
        }  # fmt: skip

    def picture(self) -> tuple[dict[str, Any], bytes]:
        """Return what changes: a head, and the first scanner's ranges.

        Ranges are little-endian uint16 [mm]; 0 where there is no echo.
        """
        world, truth, info = self._world, self._world.chair.truth, self._info
        reading, shield = world.task.reading, world.shield
        sensors, sight = world.settings.sensors, self._sight
        reason = ""
        given = world.task.limits.twist(np.array(world.task.action))
        if shield is not None and world.task.is_shielded:
            reason, given = shield.decision.reason, shield.decision.given
        head = {
            "t": reading.stamp, "pose": truth.pose, "believed": reading.pose, "twist": truth.twist,
            "asked": self._asked[:2], "stick": self._stick[:2], "given": given, "reason": reason,
            "clearance": truth.clearance, "least": self._minimum, "energy": info["energy"],
            "way": truth.distance, "to_go": world.task.way_to_go(truth.pose),
            "sonar": reading.ultrasonic, "actors": truth.actor_poses, "tracks": self._tracks,
            "contact": touches(info), "battery": reading.battery,
            "stands": active_stops(reading.halted, shield),
            "lit": "" if self._hand is None else self._hand.lit, "waits": not self.steps,
            # Angles left, right and of neglect [rad], and the sectors that go unnoticed.
            "sight": sight and [
                sight.perception.left, sight.perception.right, sight.perception.neglect,
                sight.unnoticed(reading.stamp),
            ],
        }  # fmt: skip
        ranges = reading.laser[sensors.slices[0]]
        finite = np.where(np.isfinite(ranges), ranges, 0.0)
        return head, np.clip(finite * 1e3, 0.0, 65535.0).astype("<u2").tobytes()


def world_of(world: Any) -> dict[str, Any]:
    """Return the constants of an episode: walls, sensors, the chair, kinds and sizes of actors."""
    episode, settings = world.episode, world.settings
    laser, sonar = settings.sensors.laser, settings.sensors.ultrasonic
    models = zip(sonar.mounted, sonar.models, strict=True)
    limits = world.task.limits
    return {
        "walls": episode.walls, "solids": closed_loops(episode.walls), "discs": episode.discs,
        "goal": episode.goal, "bounds": episode.map.bounds, "tolerance": world.task.tolerance,
        "outline": settings.chair.footprint.corners,
        "laser": [laser.x, laser.y, laser.yaw, laser.fov, laser.beams, laser.reach],
        "cones": [[m.x, m.y, m.yaw, model.field_of_view] for m, model in models],
        "actors": [
            [ACTOR_KINDS[row["kind"]], *map(float, row["size"])] for row in episode.actors.rows
        ],
        "limits": [limits.forward, limits.backward, limits.turn],
        "shielded": bool(world.task.is_shielded),
    }  # fmt: skip


MAXIMUM: Final = 20_000  # states of a track; a longer episode is cut
_PAUSE: Final = 1.0  # s: what comes back sooner is the same event


class Track:
    """Collects the states of an episode; called with the environment after reset and each step.

    Args:
        stop: called each time; the episode is to end where it returns true.
    """

    def __init__(self, stop: Callable[[], bool] = lambda: False) -> None:
        self._stop = stop
        self._states: list[list[Any]] = []
        self._actors: list[Any] = []
        self._events: list[list[Any]] = []
        self._last: dict[str, float] = {}  # s: when each kind of event was last on
        self._stick: Any = None  # that the latest action answers
        self._world: dict[str, Any] = {}
        self._minimum, self._figures = np.inf, dict[str, Any]()

    def __call__(self, env: Any) -> bool:
        """Add a state; true: the episode is to end."""
        world = env.unwrapped
        task, truth, shield = world.task, world.chair.truth, world.shield
        if not self._states:
            self._world = world_of(world)
        time = float(task.reading.stamp)
        given = task.limits.twist(np.array(task.action)) - np.array(task.shield_intervention)
        stick = given if self._stick is None else task.limits.twist(np.array(self._stick[:2]))
        self._stick = task.stick
        reason = shield.decision.reason if shield is not None and task.is_shielded else ""
        helps = bool(np.abs(given - stick).max() > HELP)
        touched = bool(truth.contact or task.reading.bumped)
        for kind, on, more in (
            ("contact", touched, ""), ("shield", bool(reason), reason), ("help", helps, ""),
        ):  # fmt: skip
            if on and time - self._last.get(kind, -np.inf) > _PAUSE:
                self._events.append([time, kind, more])
            if on:
                self._last[kind] = time
        clearance = float(truth.clearance)
        self._states.append([time, *truth.pose, *truth.twist, *given, *stick, clearance])
        self._actors.append(np.round(truth.actor_poses, 3))
        self._minimum = min(self._minimum, clearance)
        self._figures = {
            "time": time, "length": float(truth.distance), "energy": float(truth.energy),
            "clearance_min": self._minimum,
        }  # fmt: skip
        return len(self._states) >= MAXIMUM or self._stop()

    def content(self, name: str, outcome: str) -> dict[str, Any]:
        """The track as the page takes it.

        Args:
            name: of who drove, or of the file.
            outcome: how the episode ended.
        """
        return {
            "name": name, "world": self._world, "states": self._states, "actors": self._actors,
            "events": self._events, "figures": {**self._figures, "outcome": outcome},
        }  # fmt: skip


def recorded_track(path: Path, number: int, name: str, stop: Callable[[], bool]) -> dict[str, Any]:
    """The track of an episode of a recording, judged again.

    Args:
        path: of the MCAP file.
        number: of the episode, from 0.
        name: that the page shows.
        stop: as that of `Track`.

    Raises:
        InputError: the file is no recording, or has no such episode.
    """
    episodes = read_recording(path)
    if number >= len(episodes):
        raise InputError(f"{name}: episode {number}; it has {len(episodes)}, from 0")
    track, ending = Track(stop), Ending()
    with closing(_replayed(episodes[number])) as states:
        for env, step in states:
            *_, ended, truncated, info = step
            ending.given_map = given_map(env)
            ending.add(info)
            if track(env):
                break
    timeout = truncated and not ended
    outcome = ending.outcome(info, timeout) if ended or truncated else "stopped"
    return track.content(name, outcome)


def _replayed(recorded: RecordedEpisode, mode: str | None = None) -> Generator[tuple[Any, Any]]:
    """Yield the environment that repeats an episode and its answer, after reset and each step."""
    env: Any = replay_env(recorded, mode)
    try:
        _, info = env.reset(seed=0, options={"episode": recorded.episode})
        yield env, (False, False, info)
        for action in recorded.actions:
            yield env, env.step(action)
    finally:
        env.close()


def film(recording: Path, stop: Callable[[], bool] = lambda: False) -> Path:
    """Write the film of a recorded drive beside it, drawn by the environment's own renderer.

    Args:
        recording: MCAP file of a drive.
        stop: called before each picture; the film ends where it returns true.

    Returns:
        The film: .mp4, or .gif where moviepy is missing.

    Raises:
        InputError: the file is no recording, or the film cannot be written.
    """
    episodes, target = read_recording(recording), recording.with_suffix(video_suffix())

    def frames() -> Iterator[Any]:
        for recorded in episodes:
            for env, _ in _replayed(recorded, "rgb_array"):
                if stop():
                    return
                yield env.render()

    write_video(target, frames(), episodes[0].settings.rate)
    return target

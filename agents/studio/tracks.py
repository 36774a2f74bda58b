"""The course of an episode, driven or recorded, as the page Compare draws it, and its film."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, Final

import numpy as np

from agents.evaluation.metrics import Ending, given_map
from agents.studio.drive import HELP, world_of
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.recording.replay import RecordedEpisode, read_recording, replay_env
from wheelchair_gym.rendering.video import video_suffix, write_video

MAXIMUM: Final = 20_000  # states of a track; a longer episode is cut
_PAUSE: Final = 1.0  # s: what comes back sooner is the same event


class Track:
    """Collects the states of an episode; called with the environment after reset and each step.

    Args:
        stop: called each time; the episode is to end where it returns true.
    """

    def __init__(self, stop: Any = None) -> None:
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
        return len(self._states) >= MAXIMUM or (self._stop is not None and bool(self._stop()))

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


def recorded_track(path: Path, number: int, name: str, stop: Any = None) -> dict[str, Any]:
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


def film(recording: Path, stop: Any = None) -> Path:
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
                if stop is not None and stop():
                    return
                yield env.render()

    write_video(target, frames(), episodes[0].settings.rate)
    return target

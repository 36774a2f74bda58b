"""Films of recorded drives, drawn by the environment's own renderer."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from wheelchair_gym.recording.replay import RecordedEpisode, read_recording, replay_env
from wheelchair_gym.rendering.video import video_suffix, write_video


def film(recording: Path, stop: Any = None) -> Path:
    """Write the film of a recording beside it.

    Args:
        recording: MCAP file of a drive.
        stop: called before each picture; the film ends where it returns true.

    Returns:
        The film: .mp4, or .gif where moviepy is missing.

    Raises:
        InputError: the file is no recording, or the film cannot be written.
    """
    episodes = read_recording(recording)
    target = recording.with_suffix(video_suffix())
    frames = (frame for one in episodes for frame in _frames(one, stop))
    write_video(target, frames, episodes[0].settings.rate)
    return target


def _frames(recorded: RecordedEpisode, stop: Any) -> Iterator[Any]:
    env = replay_env(recorded, "rgb_array")
    try:
        env.reset(seed=0, options={"episode": recorded.episode})
        for action in recorded.actions:
            if stop is not None and stop():
                return
            yield env.render()
            env.step(action)
        yield env.render()
    finally:
        env.close()

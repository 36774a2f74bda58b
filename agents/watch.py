"""Who looks on while a chair drives: a recording, viewers that join live, or nobody."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from wheelchair_gym.config import InputError

if TYPE_CHECKING:
    from wheelchair_gym.localization.logs import SensorLog
    from wheelchair_gym.localization.slam import Slam
    from wheelchair_gym.sensors.settings import LaserSettings

Each = Callable[[Any], None]  # called with the environment after reset and each step


@dataclass(frozen=True)
class Watch:
    """What a person asked for.

    Attributes:
        record: MCAP file to write, or None.
        live: port where viewers may join, 0 for a free one, or None.
        images: rendered pictures, too, so many a second [Hz]; 0: none.
        when_full: what becomes of the run when the disk is full, see `RecordingSettings.when_full`.
    """

    record: str | None = None
    live: int | None = None
    images: float = 0.0
    when_full: Literal["go-on", "end"] = "go-on"

    def __bool__(self) -> bool:
        return self.record is not None or self.live is not None

    def of_episode(self, *names: Any) -> Watch:
        """The same for one episode of many: its recording is a file in the folder `record`."""
        if self.record is None:
            return self
        name = re.sub(r"[^\w.+-]", "_", "-".join(map(str, names)))
        return replace(self, record=str(Path(self.record) / f"{name}.mcap"))

    def on(self, env: Any, film: Each | None = None) -> tuple[Any, Each | None]:
        """The environment as it is watched, and what is to be called after reset and each step.

        Raises:
            InputError: the extra 'record' is not installed, the file cannot be written, or the
                port is taken.
        """
        if not self:
            return env, film
        from wheelchair_gym.recording.record import RecordEpisodes, RecordingSettings

        own = RecordingSettings(image_rate=self.images, when_full=self.when_full)
        env = RecordEpisodes(env, self.record, self.live, own)
        if env.port is None:
            return env, film
        _say(env.port)
        return env, _paced(env.unwrapped.task.period, film)

    def on_survey(
        self, log: SensorLog, laser: LaserSettings
    ) -> tuple[Callable[[Slam], None], Each]:
        """What is to be called after each scan of a log, and at the end (with anything)."""
        if not self:
            return lambda slam: None, lambda end: None
        from wheelchair_gym.recording.record import RecordingSettings
        from wheelchair_gym.recording.sink import NANO, Sink

        out, own, reckoned = Sink(self.record, self.live), RecordingSettings(), log.odometry
        if out.port is not None:
            _say(out.port)
        begun, shown, k = time.perf_counter(), -np.inf, 0

        def each(slam: Slam) -> None:
            nonlocal shown, k
            stamp = float(log.stamps[k] - log.stamps[0])
            if out.port is not None:
                time.sleep(max(0.0, begun + stamp - time.perf_counter()))
            out.now = round(stamp * NANO)
            period = stamp - float(log.stamps[k - 1] - log.stamps[0]) if k else 0.0
            way = log.increments[k][[0, 2]] / period if period > 0.0 else np.zeros(2)
            if stamp - shown >= own.refresh_period:
                shown = stamp
                out.send("/map", slam.map)
                out.send("/tf_static", laser)
                out.send("/trail", slam.trajectory[:, :2])
            out.send("/tf", slam.pose, reckoned[k])
            out.send("/scan", laser, log.ranges[k])
            out.send("/odometry", reckoned[k], way)
            out.send("/pose", slam.pose)
            out.send("/particles", slam.poses)
            k += 1
            if (why := out.new_error()) and self.when_full == "end":
                raise InputError(f"{why}, and the run, too")
            if why:
                print(f"{why}; the run goes on", file=sys.stderr)

        return each, lambda end: out.close()


def _say(port: int) -> None:
    print(f"ws://127.0.0.1:{port}", file=sys.stderr)


def _paced(period: float, film: Each | None) -> Each:
    """Called once a control period [s]: waits for its time, then films if that is asked for."""
    begun, calls = time.perf_counter(), 0

    def each(env: Any) -> None:
        nonlocal calls
        calls += 1
        time.sleep(max(0.0, begun + calls * period - time.perf_counter()))
        if film is not None:
            film(env)

    return each

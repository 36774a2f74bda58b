"""Recordings and live viewers of a drive."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

if TYPE_CHECKING:
    from wheelchair_gym.perception.logs import SensorLog
    from wheelchair_gym.perception.slam import Slam
    from wheelchair_gym.recording.sink import Format
    from wheelchair_gym.sensors.settings import LaserSettings

Each = Callable[[Any], None]  # called with the environment after reset and each step


def ignore(*_: Any) -> None:
    """Do nothing, where nobody watches."""


@dataclass(frozen=True)
class Watch:
    """The recording and the viewers of a drive; neither by default."""

    record: str | None = None  # MCAP file to write
    live: int | None = None  # port where viewers may join, 0 for a free one
    images: float = 0.0  # rate of rendered pictures [Hz]; 0: none
    when_full: Literal["go-on", "end"] = "go-on"  # see `RecordingSettings.when_full`
    format: Format = "foxglove"  # see `RecordingSettings.format`

    def __bool__(self) -> bool:
        return self.record is not None or self.live is not None

    def of_episode(self, *names: Any) -> Watch:
        """The same for one episode of many: its recording is a file in the folder `record`."""
        if self.record is None:
            return self
        name = re.sub(r"[^\w.+-]", "_", "-".join(map(str, names)))
        suffix = ".mcap" if self.format == "foxglove" else ""  # a bag is a folder
        return replace(self, record=str(Path(self.record) / f"{name}{suffix}"))

    def on(self, env: Any, film: Each = lambda env: None) -> tuple[Any, Each]:
        """The recorded environment, and the function to call after reset and each step.

        Raises:
            InputError: the extra 'record' or 'ros' is not installed, the file cannot be written, or
                the port is taken.
        """
        if not self:
            return env, film
        from wheelchair_gym.recording.record import RecordEpisodes, RecordingSettings

        settings = RecordingSettings(
            image_rate=self.images, when_full=self.when_full, format=self.format
        )
        env = RecordEpisodes(env, self.record, self.live, settings)
        if env.port is None:
            return env, film
        print(f"ws://127.0.0.1:{env.port}", file=sys.stderr)
        return env, _paced(env.unwrapped.task.period, film)

    @contextmanager
    def on_log(self, log: SensorLog, laser: LaserSettings) -> Iterator[Callable[[Slam], None]]:
        """The function to call after each scan of a log."""
        if not self:
            yield ignore
            return
        from wheelchair_gym.recording.record import REFRESH_PERIOD
        from wheelchair_gym.recording.sink import Sink

        out, odometry = Sink(self.record, self.live, self.format), log.odometry
        if out.port is not None:
            print(f"ws://127.0.0.1:{out.port}", file=sys.stderr)
        begun, drawn, k = time.perf_counter(), -np.inf, 0

        def each(slam: Slam) -> None:
            nonlocal drawn, k
            stamp = float(log.stamps[k] - log.stamps[0])
            if out.port is not None:
                time.sleep(max(0.0, begun + stamp - time.perf_counter()))
            out.now = round(1e9 * stamp)  # ns
            period = stamp - float(log.stamps[k - 1] - log.stamps[0]) if k else 0.0
            twist = log.increments[k][[0, 2]] / period if period > 0.0 else np.zeros(2)
            if stamp - drawn >= REFRESH_PERIOD:
                drawn = stamp
                out.send("/map", slam.built_map())
                out.send("/tf_static", [laser])
                out.send("/trail", slam.trajectory[:, :2])
            out.send("/tf", slam.pose, odometry[k])
            out.send("/scan", laser, log.ranges[k])
            out.send("/odometry", odometry[k], twist)
            out.send("/pose", slam.pose)
            out.send("/particles", slam.poses)
            k += 1
            out.check_disk(self.when_full)

        try:
            yield each
        finally:
            out.close()


def _paced(period: float, film: Each) -> Each:
    """Called once a control period [s]: waits for real time, then films."""
    begun, calls = time.perf_counter(), 0

    def each(env: Any) -> None:
        nonlocal calls
        calls += 1
        time.sleep(max(0.0, begun + calls * period - time.perf_counter()))
        film(env)

    return each

"""Recording: what a chair was told, did and was judged by: an MCAP file, or live, for viewers.

Typed messages are for viewers: map, transforms, scan, path, goal, poses. The topics READING,
COMMAND and VERDICT hold the same once more to the last bit, so that a run can be driven and judged
again (`view.replay`). Frames follow REP-105: map, base_link, laser.
"""

from __future__ import annotations

import base64
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from wheelchair_gym.config import InputError, dump
from wheelchair_gym.files import refused
from wheelchair_gym.movers import MOVER, shapes

if TYPE_CHECKING:
    from wheelchair_gym.task.task import Observation

EPISODE: Final = "/episode"
READING: Final = "/reading"
COMMAND: Final = "/command"
VERDICT: Final = "/verdict"
SETTINGS: Final = ("rate", "chair", "sensors", "task")  # of an environment: what judging needs
_NANO = 1_000_000_000
_NAME = "wheelchair_gym"
_AGAIN = 10  # steps between two messages of what stays, while viewers may join


def packed(values: ArrayLike, kind: DTypeLike) -> str:
    """An array as text, to the bit, infinities and NaN included."""
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode()


class Recorded(gym.Wrapper[Any, Any, Any, Any]):
    """An environment all of whose episodes are written to a file, shown live, or both.

    Args:
        env: a `NavigationEnv`, wrapped or not.
        file: MCAP to write; what was there is lost. It is whole after `close`.
        port: of this machine, where Foxglove's viewers may join (WebSocket); 0: a free one.

    Attributes:
        port: where viewers may join, or None.

    Raises:
        InputError: the extra 'record' is not installed, the file cannot be written, or the port is
            taken.
    """

    def __init__(
        self, env: gym.Env[Any, Any], file: str | Path | None = None, port: int | None = None
    ) -> None:
        super().__init__(env)
        try:
            import foxglove
            from foxglove import channels, messages
        except ImportError:
            raise InputError("recording needs: pip install 'wheelchair_gym[record]'") from None
        self._context = context = foxglove.Context()  # channels end with it
        self._file = None if file is None else _opened(file, context)
        self._server = None
        if port is not None:
            try:
                self._server = foxglove.start_server(name=_NAME, port=port, context=context)
            except (OSError, OverflowError, RuntimeError) as error:
                raise InputError(f"port {port}: nobody can join there ({error})") from None
        self.port = self._server.port if self._server else None
        self._m: Any = messages
        kinds = {
            "/map": channels.GridChannel,
            "/tf": channels.FrameTransformsChannel,
            "/scan": channels.LaserScanChannel,
            "/path": channels.PosesInFrameChannel,
            "/goal": channels.PoseInFrameChannel,
            "/pose": channels.PoseInFrameChannel,
            "/truth": channels.PoseInFrameChannel,
            "/movers": channels.SceneUpdateChannel,
        }
        self._channels: dict[str, Any] = {
            topic: kind(topic, context=context) for topic, kind in kinds.items()
        }
        for topic in (EPISODE, READING, COMMAND, VERDICT):
            schema = {"type": "object", "title": topic[1:]}
            self._channels[topic] = foxglove.Channel(topic, schema=schema, context=context)
        self._base = self._now = 0  # ns: episodes follow each other in time
        self._steps = 0  # of this episode

    def reset(self, **arguments: Any) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode, and a chapter of the recording."""
        observation, info = self.env.reset(**arguments)
        self._base = self._now = self._now + _NANO if self._now else 0
        self._steps = 0
        self._log_episode()
        self._log_map()
        self._log_reading()
        return observation, info

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive for one control period, and record it."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        chosen = np.asarray(action, np.float64).tolist()
        twist = self._env.task.limits.twist(action).tolist()
        self._json(COMMAND, {"action": chosen, "v": twist[0], "w": twist[1]})
        self._steps += 1
        if self._server and self._steps % _AGAIN == 0:
            self._log_map()
        self._log_reading()
        ends = {"terminated": terminated, "truncated": truncated}
        self._json(VERDICT, {"reward": reward, "terms": info["reward_terms"], **ends})
        return observation, float(reward), terminated, truncated, info

    def close(self) -> None:
        """Finish the file, let viewers go and close the environment."""
        if self._file:
            self._file.close()
        if self._server:
            self._server.stop()
        self._file = self._server = None
        super().close()

    @property
    def _env(self) -> Any:
        return self.env.unwrapped

    def _json(self, topic: str, content: dict[str, Any]) -> None:
        text = json.dumps(content, allow_nan=False)
        self._channels[topic].log(text.encode(), log_time=self._now)

    def _log(self, topic: str, message: Any) -> None:
        self._channels[topic].log(message, log_time=self._now)

    def _log_episode(self) -> None:
        env = self._env
        episode, task = env.episode, env.task
        grid = episode.map
        self._json(
            EPISODE,
            {
                "settings": {name: dump(getattr(env.settings, name)) for name in SETTINGS},
                "map": {
                    "cells": packed(grid.cells, "<i1"),
                    "shape": grid.shape,
                    "resolution": grid.resolution,
                    "origin": grid.origin,
                },
                **{name: np.asarray(getattr(episode, name)).tolist() for name in _ARRAYS},
                **{name: getattr(episode, name) for name in _VALUES},
                "movers": packed(episode.movers.rows, MOVER),
                "routes": episode.movers.routes.tolist(),
                "path": None if env.task.guidance is None else np.asarray(task.path).tolist(),
            },
        )

    def _log_map(self) -> None:
        """What stays as it is, for those who come late."""
        env, m = self._env, self._m
        grid, path = env.episode.map, env.task.path
        kind = m.PackedElementFieldNumericType.Int8
        self._log(
            "/map",
            m.Grid(
                frame_id="map",
                timestamp=self._stamp,
                pose=self._pose(*grid.origin),
                column_count=grid.shape[1],
                cell_size=m.Vector2(x=grid.resolution, y=grid.resolution),
                row_stride=grid.shape[1],
                cell_stride=1,
                fields=[m.PackedElementField(name="occupancy", offset=0, type=kind)],
                data=grid.cells.tobytes(),
            ),
        )
        self._log("/goal", self._placed(env.episode.goal))
        if path is not None:
            headed = [(x, y, 0.0) for x, y in np.asarray(path)[:, :2].tolist()]
            poses = [self._pose(*pose) for pose in headed]
            message = m.PosesInFrame(frame_id="map", timestamp=self._stamp, poses=poses)
            self._log("/path", message)

    def _log_reading(self) -> None:
        env, m = self._env, self._m
        reading, truth, laser = env.task.reading, env.chair.truth, env.settings.sensors.laser
        self._now = self._base + round(reading.stamp * _NANO)
        told = {"pose": reading.pose.tolist(), "twist": reading.twist.tolist()}
        told |= {name: packed(getattr(reading, name), "<f4") for name in _FLOATS}
        told |= {name: getattr(reading, name) for name in ("bumped", "battery", "stamp")}
        real = truth._asdict()
        real |= {"pose": truth.pose.tolist(), "twist": truth.twist.tolist()}
        real["movers"] = packed(truth.movers, "<f8")  # NaN: not there
        self._json(READING, {**told, "truth": real})
        half = 0.5 * laser.fov
        self._log(
            "/scan",
            m.LaserScan(
                frame_id="laser",
                timestamp=self._stamp,
                pose=self._pose(0.0, 0.0, 0.0),
                start_angle=-half,
                end_angle=half,
                ranges=reading.laser.astype(float).tolist(),
            ),
        )
        self._log("/pose", self._placed(reading.pose))
        self._log("/truth", self._placed(truth.pose))
        if len(truth.movers):
            self._log("/movers", self._moving(truth.movers))
        mount = (laser.x, laser.y, laser.yaw)
        transforms = [
            self._transform("map", "base_link", reading.pose),
            self._transform("base_link", "laser", mount),
        ]
        self._log("/tf", m.FrameTransforms(transforms=transforms))

    def _moving(self, poses: NDArray[np.float64]) -> Any:
        """Movers as a scene: round ones as cylinders, the others as lines."""
        m, (discs, segments) = self._m, shapes(self._env.episode.movers, poses)
        colour = m.Color(r=0.34, g=0.71, b=0.91, a=0.9)
        round_ones = [
            m.CylinderPrimitive(
                pose=self._pose(x, y, 0.0),
                size=m.Vector3(x=2.0 * r, y=2.0 * r, z=0.1),
                bottom_scale=1.0,
                top_scale=1.0,
                color=colour,
            )
            for x, y, r in discs.tolist()
        ]
        lines = m.LinePrimitive(
            type=m.LinePrimitiveLineType.LineList,
            pose=self._pose(0.0, 0.0, 0.0),
            thickness=0.04,
            points=[m.Point3(x=x, y=y, z=0.0) for x, y in segments.reshape(-1, 2).tolist()],
            color=colour,
        )
        entity = m.SceneEntity(
            timestamp=self._stamp,
            frame_id="map",
            id="movers",
            cylinders=round_ones,
            lines=[lines] if len(segments) else [],
        )
        return m.SceneUpdate(entities=[entity])

    @property
    def _stamp(self) -> Any:
        return self._m.Timestamp(self._now // _NANO, self._now % _NANO)

    def _turned(self, yaw: float) -> Any:
        return self._m.Quaternion(x=0.0, y=0.0, z=math.sin(0.5 * yaw), w=math.cos(0.5 * yaw))

    def _pose(self, x: float, y: float, yaw: float) -> Any:
        place = self._m.Vector3(x=float(x), y=float(y), z=0.0)
        return self._m.Pose(position=place, orientation=self._turned(yaw))

    def _placed(self, pose: Any) -> Any:
        x, y, yaw = pose
        message = self._m.PoseInFrame
        return message(frame_id="map", timestamp=self._stamp, pose=self._pose(x, y, yaw))

    def _transform(self, parent: str, child: str, pose: Any) -> Any:
        x, y, yaw = pose
        return self._m.FrameTransform(
            timestamp=self._stamp,
            parent_frame_id=parent,
            child_frame_id=child,
            translation=self._m.Vector3(x=float(x), y=float(y), z=0.0),
            rotation=self._turned(yaw),
        )


def _opened(file: str | Path, context: Any) -> Any:
    import foxglove

    try:
        Path(file).parent.mkdir(parents=True, exist_ok=True)
        with Path(file).open("wb"):
            pass
        return foxglove.open_mcap(file, allow_overwrite=True, context=context)
    except OSError as error:
        raise refused(Path(file), error) from None


_ARRAYS = ("start", "goal", "walls", "discs")  # of an episode
_VALUES = ("tolerance", "time_limit", "name")
_FLOATS = ("laser", "ultrasonic", "age")  # of a reading

"""`wheelchair twin`: the boards' firmware on emulated chips, in real time."""

from __future__ import annotations

import argparse
import dataclasses
import os
import select
import sys
from typing import Any

import numpy as np

from agents.cli.arguments import spec
from wheelchair_gym.config import InputError
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.hardware.twin.faults import run_command
from wheelchair_gym.hardware.twin.lockstep import Twin
from wheelchair_gym.hardware.twin.plant import Plant
from wheelchair_gym.hardware.twin.serve import ServedTwin
from wheelchair_gym.maps import write_map

_STATUS_PERIOD = 0.5  # s
_FRAME_PERIOD = 0.1  # s of the window


def run(given: argparse.Namespace) -> int:
    """Serve the twin; print the true pose and the duration of contacts [ms] at the end."""
    if given.port > 65535:
        raise InputError(f"--port {given.port}: expected at most 65535")
    scene = None if given.scene is None else spec(given.scene)
    settings = env_settings(given.config, scene=scene)
    exact = dataclasses.replace(settings.sensors, pose_source="truth")
    env = NavigationEnv(config=dataclasses.replace(settings, sensors=exact))
    env.reset(seed=given.seed)
    assert env.episode is not None
    if given.write_map is not None:
        write_map(env.episode.map, given.write_map)
    twin = Twin(Plant(settings.chair, settings.sensors))
    twin.reset(env.episode, given.seed)
    twin.run(0.1)
    twin.plant.scan(0)  # compiled before real time begins
    twin.plant.ping(0)
    try:
        served = ServedTwin(twin, port=given.port)
    except OSError as error:
        raise InputError(f"the twin cannot be served: {error}") from None
    watcher = _Watcher(given, served, env)
    print(f"drive board  {served.drive.path}")
    print(f"range board  {served.range.path}")
    print(f"laser        tcp://127.0.0.1:{served.laser.port}")
    _print_pose("start", env.episode.start)
    _print_pose("goal", env.episode.goal[:2])
    try:
        served.run(watcher.done)
    finally:
        if served.max_delay > _FRAME_PERIOD:
            print(f"the world was up to {served.max_delay:.2f} s late", file=sys.stderr)
        _print_pose("end", twin.plant.pose)
        print(f"{'touched':12} {twin.bumper_steps}", flush=True)  # ms
        served.close()
        watcher.close()
        twin.close()
        env.close()
    return 0


def _print_pose(name: str, where: Any) -> None:
    print(f"{name:12} " + ",".join(f"{value:.3f}" for value in where), flush=True)


class _Watcher:
    """Handles input, status and window between two slices of simulated time."""

    def __init__(self, given: argparse.Namespace, served: Any, env: Any) -> None:
        self._given, self._served, s = given, served, env.settings
        self._begun = served.twin.steps
        self._text, self._open = b"", True
        self._shown = self._drawn = 0.0
        self._trail = [served.twin.plant.pose[:2]]
        self._window: Any = None
        self._view: Any = None
        if given.window or given.picture:
            from wheelchair_gym.rendering.picture import TopView

            size = s.render_height, s.render_width
            self._view = TopView(env.episode, s.chair.footprint, s.chair.drive, s.sensors, size)
            self._picture()  # compiled before real time begins
        if given.window:
            from wheelchair_gym.rendering.video import Window

            self._window = Window("wheelchair twin")

    def done(self) -> bool:
        """Whether the window was closed or the time is over."""
        now = (self._served.twin.steps - self._begun) * 1e-3
        self._read_input()
        if now - self._shown >= _STATUS_PERIOD and sys.stderr.isatty():
            self._shown = now
            sys.stderr.write("\r\033[K" + self._status(now))
            sys.stderr.flush()
        if now - self._drawn >= _FRAME_PERIOD:
            self._drawn = now
            self._trail.append(self._served.twin.plant.pose[:2])
            if self._window is not None and not self._window.show(self._picture()):
                return True
        return self._given.seconds is not None and now >= self._given.seconds

    def close(self) -> None:
        """Draw the end, and close the window."""
        if self._shown and sys.stderr.isatty():
            sys.stderr.write("\n")
        if self._given.picture:
            from wheelchair_gym.rendering.video import write_png

            write_png(self._given.picture, self._picture())
        if self._window is not None:
            self._window.close()

    def _read_input(self) -> None:
        """Inject the faults that were typed."""
        if not self._open:
            return
        try:
            number = sys.stdin.fileno()
            if not select.select([number], [], [], 0)[0]:
                return
            data = os.read(number, 4096)
        except (AttributeError, OSError, ValueError):  # standard input cannot be polled
            data = b""
        self._open = bool(data)
        *lines, self._text = (self._text + data).split(b"\n")
        for line in lines:
            if said := run_command(self._served, line.decode("utf-8", "replace")):
                print(said, flush=True)

    def _status(self, now: float) -> str:
        twin, behind = self._served.twin, self._served.max_delay
        x, y, yaw = twin.plant.pose
        motion, state = twin.motion, "braked" if twin.braked else "driven"
        late = f"  {behind:.2f} s late at most" if behind > _FRAME_PERIOD else ""
        return (
            f"{now:7.1f} s  ({x:.2f}, {y:.2f}) m  {yaw:5.2f} rad  {motion.speed:5.2f} m/s  "
            f"{motion.turn:5.2f} rad/s  {state}  {motion.battery:.1f} V{late}"
        )

    def _picture(self) -> Any:
        return self._view.draw(self._served.twin.plant.pose, trail=np.array(self._trail))

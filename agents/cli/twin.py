"""`wheelchair twin` and `robot`: a simulated chair behind its boards, or behind ROS 2's topics."""

import argparse
import dataclasses
import os
import select
import sys
import time
from functools import partial
from typing import Any

import numpy as np

from agents.cli.arguments import chair_spec, env_of, refuse, report, scene_of, watch
from agents.deploy import to_stderr as _log
from agents.evaluation.evaluate import without_labels
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.hardware.boards.senses import LASERS
from wheelchair_gym.hardware.twin import lockstep, plant, serve
from wheelchair_gym.maps import write_map

_STATUS_PERIOD = 0.5  # s
_FRAME_PERIOD = 0.1  # s of the window


def run(given: argparse.Namespace) -> int:
    """Serve the twin; print the true pose and the duration of contacts [ms] at the end."""
    settings = env_settings(given.config, scene=without_labels(scene_of(given, None)))
    if given.port > (highest := 65536 - len(settings.sensors.lasers)):
        raise InputError(f"--port {given.port}: expected at most {highest}")
    exact = dataclasses.replace(settings.sensors, pose_source="truth")
    env = NavigationEnv(config=dataclasses.replace(settings, sensors=exact), split="test")
    env.reset(seed=given.seed)
    assert env.episode is not None
    if given.write_map is not None:
        write_map(env.episode.map, given.write_map)
    real = plant.PlantSettings(settings.chair, settings.sensors, settings.physics)
    if given.plant is not None:
        real = plant.PlantSettings.read(given.plant, settings)
    twin = lockstep.Twin(plant.Plant(*real), believed=settings.chair)
    twin.reset(env.episode, given.seed)
    twin.run(0.1)
    twin.plant.scan(0)  # compiled before real time begins
    twin.plant.ping(0)
    try:
        served = serve.ServedTwin(twin, port=given.port)
    except OSError as error:
        raise InputError(f"the twin cannot be served: {error}") from None
    watcher = _Watcher(given, served, env)
    print(f"drive board  {served.drive.path}")
    print(f"range board  {served.range.path}")
    for laser, who in zip(served.lasers, LASERS, strict=False):
        print(f"{who:12} tcp://127.0.0.1:{laser.port}")
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


def robot(given: argparse.Namespace) -> int:
    """Drive the simulated chair by /cmd_vel; report the figures of its episodes."""
    from agents.evaluation.evaluate import drive_episode, label, make_env
    from agents.evaluation.map_evaluation import NO_TOLERANCE
    from agents.evaluation.metrics import TIMING, summarise
    from agents.robot import SERVICES, Robot, RobotSettings

    settings: dict[str, Any] = {**env_of(given), "rate": given.rate}
    config = RobotSettings(
        scan_rate=given.scan_rate, speed=given.sim_time, localized=not given.no_map, imu=given.imu,
        namespace=given.namespace or "",
    )  # fmt: skip
    scene = scene_of(given)
    env = make_env(scene, settings, "human" if given.window else None)
    world, judged = env.unwrapped, given.episodes is not None
    if world.settings.sensors.pose_source == "slam":
        raise InputError("--pose slam: expected another; with --no-map, ROS draws the map")
    driver = Robot(config, _log, waits=judged)
    begun, records, number = time.monotonic(), [], 0
    link: Any = None

    def over() -> bool:
        return given.seconds is not None and time.monotonic() - begun >= given.seconds

    try:
        env.reset(seed=given.seed)
        env.step(np.zeros(2))  # compiled before real time begins
        link = _link(given, driver)
        driver.connect(link, world.mission, over)
        print(f"{'dds' if given.dds else 'rosbridge':12} {link.url}", flush=True)
        env, film = watch(given).on(env)

        def each(now: Any) -> bool:
            film(now)
            return driver.follow(now)

        while not over() and (not judged or number < given.episodes):
            seed = given.seed + number
            world.reset(seed=seed)  # outside the recording
            episode = world.episode
            if not judged:
                episode = dataclasses.replace(episode, tolerance=NO_TOLERANCE, time_limit=1e9)
            _print_pose("start", episode.start)
            _print_pose("goal", episode.goal)
            record = drive_episode(env, driver, seed, each, episode)
            if judged and not over():
                record |= {"policy": "ros", "scene": label(scene), "seed": seed}
                records.append(record)
                print(f"{record['outcome']:12} {record['time']:.1f} s", flush=True)
            elif not (driver.service or over()):
                names = " or ".join(map(driver.names.of, SERVICES))
                _log(f"the chair has touched something: it stands until {names}")
                driver.stand(world.task.reading, lambda: False)
            number += driver.service != SERVICES[1]
    finally:
        env.close()
        if link is not None:
            link.close()
        if driver.late:
            _log(f"{driver.late} control periods ended over a second late")
    rows = summarise(records)[-1:]
    for row in (*records, *rows):  # Robot waits in act: its times are not the commander's
        for key in {*TIMING, "act_ms_p50", "plan_ms_p50", "plan_ms_p95"}:
            row.pop(key, None)
    found = sum(record["success"] for record in records)
    text = f"{found} of {len(records)} episodes are successes" if judged else "the end"
    report(given, {"episodes": records, "summary": rows}, text)
    return 0


def _link(given: argparse.Namespace, driver: Any) -> Any:
    """Return the link that commands the chair: a rosbridge server, a client of one, or DDS."""
    from agents.robot import COMMAND, COMMAND_TYPES, SERVICES
    from wheelchair_gym.hardware.registry import chair_settings
    from wheelchair_gym.hardware.ros import rosbridge
    from wheelchair_gym.hardware.ros.dds import DdsLink, domain_number
    from wheelchair_gym.hardware.ros.settings import RosSettings

    link: Any
    command = driver.names.of(COMMAND)
    if given.dds:
        refuse(given, ("rosbridge", "token_file", "tls", "stamped"), "expected without --dds")
        domain = domain_number(os.environ.get("ROS_DOMAIN_ID", ""))
        link = DdsLink(given.host, domain, driver.command, driver.left, driver.config.namespace)
        for kind in COMMAND_TYPES:
            link.subscribe(command, kind.replace("/", "/msg/"))
        if rosbridge.is_local(given.host):
            _log("ROS 2 on this machine finds it with ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST")
    elif given.rosbridge is not None:
        refuse(given, ("token_file", "tls"), "expected in FILE.json:NAME of --rosbridge")
        other = chair_settings(chair_spec(given.rosbridge))
        if not isinstance(other, RosSettings):
            raise InputError(f"--rosbridge {given.rosbridge}: expected ros://HOST:PORT")
        link = rosbridge.Rosbridge(other.host, other.port, driver.command, other.link)
        link.subscribe(command, COMMAND_TYPES[given.stamped])
    else:
        refuse(given, ("stamped",), "expected with --rosbridge")
        token = "" if given.token_file is None else rosbridge.read_token(given.token_file)
        link = driver.server(given.host, given.port, token, given.tls)
    for name in SERVICES if given.episodes is None else ():
        link.serve(driver.names.of(name), "std_srvs/srv/Trigger", partial(driver.ask, name))
    return link


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
            if reply := serve.run_command(self._served, line.decode("utf-8", "replace")):
                print(reply, flush=True)

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

"""A person drives the twin in real time with an assistant: latencies, and what fails on the way.

`python -m tests.benchmarks.assisted_chair [--latencies 100] [--kills 100] [--faults 20]`: figures
on stderr, JSON on stdout. Emulated boards run in real time behind pseudo-terminals, and `wheelchair
drive --assist slide --input board` in a process of its own, in open space.

- Latency, with help and in the board's manual mode: the stick is pushed from 30 to 100 %, and let
  back to its centre, at random moments. It counts from the change of the stick, before its
  receiver, to the first change of the board's set point for the wheels. The odometry shows that
  every 20 ms; the moment follows from the limit of jerk, with which each change begins, to 3 ms.
- The host is killed (SIGKILL) while it drives and the stick is pushed: how long until the set point
  falls and the chair rests, whether it stays at rest, and whether the person drives on by hand.
- An assistant that does not answer, and one that raises: the same, from its call on.

Trials in which the twin itself was more than 20 ms behind real time are left out, and counted.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import multiprocessing
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from agents.cli import drive, main
from agents.deploy import rehearse
from tests.physics.worlds import box
from wheelchair_gym.config import dump
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.hardware.boards.protocol import Mode, Odometry, Receiver
from wheelchair_gym.hardware.twin.lockstep import JoystickState, Twin
from wheelchair_gym.hardware.twin.plant import Plant
from wheelchair_gym.hardware.twin.serve import ServedTwin

CONFIG = "configs/hardware.json"
NAME = "tests.benchmarks.assisted_chair"
CALLED = "WHEELCHAIR_BENCHMARK_CALLED"  # the file with the time of the call that fails
SLOW, FULL = 0.3, 1.0  # deflections of a step
RUN = 0.005  # s between two runs of the board's control
BEHIND = 0.02  # s that the twin may lag behind real time in a trial
REST = 0.01  # m/s
PATIENCE = 60.0  # s for a host to drive
BOUNDS = {"assisted": 120.0, "manual": 60.0}  # ms
HELD, PUSHED = JoystickState(dead_man=True), JoystickState(forward=FULL, dead_man=True)


class Late:
    """An assistant that does not answer for 3 s once it has driven for 2.5 s."""

    def reset(self, mission):
        self._calls, self._most = 0, round(2.5 / mission.period)

    def assist(self, stick, reading, map):
        self._calls += stick.forward > 0.0
        if self._calls == self._most:
            self.fail()
            self._calls += 1
        return np.array([0.8 * stick.forward, 0.0])

    def fail(self):
        Path(os.environ[CALLED]).write_text(f"{time.monotonic()}")
        time.sleep(3.0)


class Raises(Late):
    """An assistant that raises an error once it has driven for 2.5 s."""

    def fail(self):
        Path(os.environ[CALLED]).write_text(f"{time.monotonic()}")
        raise ZeroDivisionError("on purpose")


def host(config: str, assist: str) -> None:
    """`wheelchair drive` in a forked process, in which all is compiled and rehearsed already."""
    log = os.open(os.devnull, os.O_WRONLY)
    os.dup2(log, 1)
    os.dup2(log, 2)
    drive.rehearse = lambda *arguments: None
    sys.exit(main(["drive", "--config", config, "--assist", assist]))


class World:
    """The twin in real time, a script that moves the stick, and what the drive board reports."""

    def __init__(self, folder: Path) -> None:
        settings = env_settings(CONFIG, pose_source="odometry", noise=False)
        self.jerk = settings.chair.limits.jerk
        self.twin = Twin(Plant(settings.chair, settings.sensors))
        self.twin.reset(box(500.0), 0)
        self.ahead = self._clock_offset()
        self.twin.plant.scan(0)  # compiled before real time begins
        self.twin.plant.ping(0)
        self.served = ServedTwin(self.twin)
        self.served.drive.wire.log = []
        config = dump(settings)
        config["hardware"] |= {
            "drive_port": self.served.drive.path, "range_port": self.served.range.path,
            "laser_port": f"tcp://127.0.0.1:{self.served.laser.port}",
        }  # fmt: skip
        self.config = folder / "config.json"
        self.config.write_text(json.dumps(config))
        self.frames: list[tuple[Odometry, float]] = []  # and the wall time at which they came
        self.lags: list[float] = []
        self.hosts: list = []
        self._receiver = Receiver()
        self._begun = time.monotonic() - self.now

    def _clock_offset(self) -> float:
        """By how much the twin's time is ahead of the drive board's [s], to a millisecond."""
        receiver, offsets = Receiver(), []
        for _ in range(200):
            self.twin.run(0.001)
            for frame in receiver.feed(self.twin.drive.read()):
                if isinstance(frame.message, Odometry):
                    offsets.append(self.now - 0.001 - frame.message.stamp)  # 1 ms on the line
        return min(offsets)

    @property
    def now(self) -> float:
        return self.twin.steps * 1e-3

    @property
    def speed(self) -> float:
        return abs(self.twin.motion.speed)

    def run(self, script) -> None:
        """Run a script: a generator that is continued every 5 ms."""

        def until() -> bool:
            data, self.served.drive.wire.log = self.served.drive.wire.log, []
            wall = time.monotonic()
            for frame in self._receiver.feed(b"".join(data)):
                if isinstance(frame.message, Odometry):
                    self.frames.append((frame.message, wall))
            self.lags.append(wall - self._begun - self.now)
            del self.frames[:-1500], self.lags[:-3000]
            try:
                next(script)
            except StopIteration:
                return True
            return False

        try:
            self.served.run(until)
        finally:
            self.kill()

    def hold(self, stick: JoystickState) -> None:
        self.twin.faults.joystick = stick

    def wait(self, seconds: float):
        end = self.now + seconds
        while self.now < end:
            yield

    def was_behind(self, seconds: float) -> bool:
        """Whether the twin has lagged in the last seconds; a lasting lag is none."""
        lags = self.lags[-round(seconds / 0.005) :]
        return max(lags) - min(lags) > BEHIND

    def set_points(self, since: float) -> list[tuple[float, float]]:
        """Time [s] and set point [m/s] of the odometry since a time."""
        points = [(one.stamp + self.ahead, one.v) for one, _ in self.frames]
        return [point for point in points if point[0] >= since]

    def start(self, assist: str = "slide") -> None:
        self.kill()
        process = multiprocessing.get_context("fork").Process(
            target=host, args=(str(self.config), assist), daemon=True
        )
        process.start()
        self.hosts.append(process)

    def kill(self) -> None:
        while self.hosts:
            process = self.hosts.pop()
            process.kill()
            process.join()

    def arm(self):
        """Take the chair with the manual switch, which re-arms it, and return it."""
        for stick in (
            JoystickState(manual=True), JoystickState(manual=True, dead_man=True), HELD
        ):  # fmt: skip
            self.hold(stick)
            yield from self.wait(0.3)

    def driving(self, wanted: float = 0.3):
        """Arm, and push the stick until the host drives at so many m/s; whether it does."""
        begun = self.now
        while self.now - begun < PATIENCE:
            yield from self.arm()
            self.hold(PUSHED)
            end = self.now + 2.0
            while self.now < end:
                yield
                if self.speed > wanted and self.frames[-1][0].mode == Mode.HOST:
                    return True
        return False


def onset(points, jerk: float, rises: bool, from_time: float) -> float | None:
    """When a set point began to change [s after a time], by the limit of jerk."""
    before = points[0][1]
    for stamp, v in points:
        change = v - before if rises else before - v
        if change > 5e-4:
            # The set point moves once a run, by whole runs of constant acceleration.
            return stamp + 0.5 * RUN - math.sqrt(2.0 * change / jerk) - from_time
    return None


def latencies(world: World, count: int, mode: str, found: dict, rng: np.random.Generator):
    """Steps of the stick, until there are as many good ones; latencies in ms."""
    kept: dict[str, list[float]] = {"push": [], "centre": []}
    left_out = missed = 0
    manual = mode == "manual"
    if not manual:
        world.start()

    def stick(forward: float) -> JoystickState:
        return JoystickState(forward=forward, dead_man=True, manual=manual)

    while len(kept["centre"]) < count and missed < count:
        if manual:
            for one in (JoystickState(manual=True), stick(0.0)):
                world.hold(one)
                yield from world.wait(0.3)
        elif world.speed < REST and not (yield from world.driving(0.1)):
            raise SystemExit("the host does not drive")
        while len(kept["centre"]) < count and missed < count:
            world.hold(stick(SLOW))
            yield from world.wait(1.5 + 0.1 * rng.random())
            steady = world.set_points(world.now - 0.1)
            if not steady or steady[-1][1] < 0.05:
                missed += 1
                break
            delays = []
            for key, to in (("push", FULL), ("centre", 0.0)):
                at, rises = world.now, key == "push"
                world.hold(stick(to))
                yield from world.wait(0.4)
                delay = onset(world.set_points(at - 0.02), world.jerk, rises, at)
                delays.append((key, delay))
                yield from world.wait(1.4 + 0.1 * rng.random() if rises else 0.0)
            if world.was_behind(2.5):
                left_out += 1
                continue
            for key, delay in delays:
                if delay is None:
                    missed += 1
                else:
                    kept[key].append(1e3 * delay)
    world.kill()
    found[mode] = {"left_out": left_out, "missed": missed} | {
        key: {
            "n": len(values),
            **{f"p{q}": float(np.percentile(values, q)) for q in (50, 95)},
            "most": float(max(values)),
        }
        for key, values in kept.items()
        if values
    }


def failures(world: World, count: int, kind: str, found: dict, rng: np.random.Generator):
    """A host that is killed, or an assistant that fails, in the midst of a drive."""
    assist = {"killed": "slide", "late": f"{NAME}:Late", "raises": f"{NAME}:Raises"}[kind]
    falls, rests, stays, by_hand, again, left_out, silent = [], [], 0, 0, 0, 0, 0
    called = Path(os.environ[CALLED])
    for _ in range(count):
        called.unlink(missing_ok=True)
        world.start(assist)
        if not (yield from world.driving()):
            silent += 1
            continue
        if kind == "killed":
            yield from world.wait(0.3 + 0.3 * rng.random())
            moment = time.monotonic()
            world.kill()
        else:
            end = world.now + 5.0
            while not called.exists() and world.now < end:
                yield
            yield
            moment = float(called.read_text())
        speed, end = world.speed, world.now + 4.0
        fell = rest = None
        while world.now < end and rest is None:
            yield
            odometry, wall = world.frames[-1]
            top = max(one.v for one, _ in world.frames[-200:])
            if fell is None and wall > moment and odometry.v < top - 0.02:
                fell = wall - moment
            if world.speed < REST and fell is not None:
                rest = time.monotonic() - moment
        fastest = 0.0
        end = world.now + 1.0
        while world.now < end:  # the stick is still pushed
            yield
            fastest = max(fastest, world.speed)
        stays += rest is not None and fastest < REST and speed > REST
        if world.was_behind(3.0):
            left_out += 1
        elif rest is not None:
            falls.append(1e3 * fell)
            rests.append(rest)
        if kind == "late":
            yield from world.wait(1.5)
            world.hold(HELD)
            yield from world.wait(0.3)
            world.hold(PUSHED)
            yield from world.wait(1.5)
            again += world.speed > 0.1
        world.hold(HELD)
        yield from world.wait(0.5)
        for one in (
            JoystickState(manual=True), JoystickState(manual=True, dead_man=True),
            dataclasses.replace(PUSHED, manual=True),
        ):  # fmt: skip
            world.hold(one)
            yield from world.wait(0.3)
        yield from world.wait(1.0)
        by_hand += world.speed > 0.1
        world.kill()
        world.hold(HELD)
        yield from world.wait(0.8)
    found[kind] = {"trials": count, "host_never_drove": silent, "stopped_and_stayed": stays,
                   "driven_on_by_hand": by_hand, "left_out_of_times": left_out}  # fmt: skip
    if kind == "late":
        found[kind]["driven_on_with_help"] = again
    for name, values in (("set_point_falls_ms", falls), ("rest_s", rests)):
        if values:
            found[kind][name] = {
                **{f"p{q}": float(np.percentile(values, q)) for q in (50, 95)},
                "most": float(max(values)),
            }


def load() -> list[float]:
    return [round(one, 1) for one in os.getloadavg()]


def measure(given: argparse.Namespace) -> dict:
    found: dict = {"cores": os.cpu_count(), "load_before": load()}
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        os.environ[CALLED] = str(Path(folder) / "called")
        config = env_settings(CONFIG, pose_source="truth", rate=20.0)
        rehearse({"name": "assisted", "assist": "slide"}, {"config": config, "driver": "expert"})
        world = World(Path(folder))

        def script():
            if given.latencies:
                yield from latencies(world, given.latencies, "assisted", found, rng)
                report(found)
                yield from latencies(world, given.latencies, "manual", found, rng)
                report(found)
            for kind, count in (
                ("killed", given.kills), ("late", given.faults), ("raises", given.faults)
            ):  # fmt: skip
                if count:
                    yield from failures(world, count, kind, found, rng)
                    report(found)

        try:
            world.run(script())
        finally:
            world.served.close()
            world.twin.close()
    return found | {"load_after": load()}


def report(found: dict) -> None:
    """Print the latest figures on standard error."""
    name = list(found)[-1]
    print(f"{name}: {json.dumps(found[name])}  load {load()}", file=sys.stderr, flush=True)


def run() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--latencies", type=int, default=100, help="steps of the stick")
    parser.add_argument("--kills", type=int, default=100, help="hosts that are killed")
    parser.add_argument("--faults", type=int, default=20, help="of each kind of assistant")
    given = parser.parse_args()
    found = measure(given)
    json.dump(found, sys.stdout, indent=1)
    print()
    good = all(
        found[mode][key]["p95"] <= bound
        for mode, bound in BOUNDS.items()
        if mode in found
        for key in set(found[mode]) & {"push", "centre"}
    ) and all(
        one["stopped_and_stayed"] == one["trials"] - one["host_never_drove"]
        for kind, one in found.items()
        if kind in ("killed", "late", "raises")
    )
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(run())

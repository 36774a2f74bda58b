"""Where the time of a step goes: microseconds per part, one thread, inside compiled loops.

`python -m tests.benchmarks.parts [repeats]`: floor plans of seeds 0 to 7, 25 poses in each, default
sensors with noise. The least of many repeats counts, since whatever else runs only adds.
"""

from __future__ import annotations

import json
import platform
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit

from wheelchair_gym.envs import NavigationVectorEnv
from wheelchair_gym.physics.step import drive_period, write_sensed
from wheelchair_gym.physics.world import measure_clearance
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.sensors.laser import WORKSPACE_ROWS, LaserArrays, add_laser_noise, exact_scan
from wheelchair_gym.sensors.odometry import update_odometry
from wheelchair_gym.sensors.settings import LaserSettings, UltrasonicSettings
from wheelchair_gym.sensors.ultrasonic import UltrasonicArrays, sense_ultrasonic
from wheelchair_gym.task.assessment import assess
from wheelchair_gym.task.observations import pool_beams

SCENE, PLANS, POSES, PERIODS, REPEATS = "floor_plan", 8, 25, 10, 40
_compiled = njit(error_model="numpy", nogil=True)


@_compiled
def _scans(laser, poses, plans, walls, starts, discs, firsts, workspace, out):
    for j in range(poses.shape[0]):
        k = plans[j]
        around = discs[firsts[k] : firsts[k + 1]]
        segments = walls[starts[k] : starts[k + 1]]
        exact_scan(
            laser, poses[j, 0], poses[j, 1], poses[j, 2], segments, around, workspace, out[j]
        )


@_compiled
def _reports(laser, out):
    for j in range(out.shape[0]):
        add_laser_noise(laser, np.uint64(j), j, out[j])


@_compiled
def _pools(scans, out):
    for j in range(scans.shape[0]):
        pool_beams(scans[j], 10.0, out[j])


@_compiled
def _firings(rangers, poses, plans, walls, starts, discs, firsts, workspace, out):
    for j in range(poses.shape[0]):
        k = plans[j]
        around = discs[firsts[k] : firsts[k + 1]]
        segments = walls[starts[k] : starts[k + 1]]
        for i in range(out.shape[1]):
            out[j, i] = sense_ultrasonic(
                rangers, i, poses[j], segments, around, np.uint64(j), j, workspace
            )


@_compiled
def _drives(suites, chairs, states, worlds, twists, order, workspace):
    for k in range(twists.shape[0]):
        for j in range(states.shape[0]):
            world, suite = worlds[j], suites[0]
            v, w = twists[k, 0], twists[k, 1]
            measure_clearance(states[j], chairs[j], world, workspace)
            drive_period(states[j], chairs[j], world, suite, v, w, False, order, workspace)


@_compiled
def _reckons(states, chairs, periods):
    for _ in range(periods):
        for j in range(states.shape[0]):
            update_odometry(states[j], chairs[j])


@_compiled
def _tells(states, chairs, worlds, sensed, periods, workspace):
    for _ in range(periods):
        for j in range(states.shape[0]):
            measure_clearance(states[j], chairs[j], worlds[j], workspace)
            write_sensed(states[j], chairs[j], worlds[j], 8, sensed[j])


@_compiled
def _judges(task, verdicts, actions, sensed, scan, out, periods):
    for _ in range(periods):
        for j in range(verdicts.shape[0]):
            s = sensed[j]
            own = s.pose, s.twist, scan, s.ultrasonic, s.stamp, s.bumped
            assess(j, task, verdicts, actions[j], *own, 0.0, 0.0, out[j])


def microseconds(act: Callable[[], None], count: int, repeats: int) -> float:
    """Least time of one of `count` things that an act does; the first act compiles."""
    act()
    times = []
    for _ in range(repeats):
        begun = time.perf_counter()
        act()
        times.append(time.perf_counter() - begun)
    return 1e6 * min(times) / count


def measure(repeats: int) -> dict[str, float]:
    """Microseconds of each part."""
    rng = np.random.default_rng(0)
    episodes = [make_scene(SCENE).sample(np.random.default_rng((k, 0))) for k in range(PLANS)]
    walls = np.vstack([e.walls for e in episodes])
    discs = np.vstack([e.discs for e in episodes])
    starts = np.cumsum([0, *(len(e.walls) for e in episodes)])
    firsts = np.cumsum([0, *(len(e.discs) for e in episodes)])
    plans = np.repeat(np.arange(PLANS), POSES)
    # About the start, so that every pose is a free one or nearly so.
    poses = np.array([episodes[k].start for k in plans]) + rng.normal(0, (0.3, 0.3, 2), (200, 3))
    world = (poses, plans, walls, starts, discs, firsts)
    workspace = np.empty((WORKSPACE_ROWS, max(len(e.walls) for e in episodes)), np.float32)
    n = len(poses)
    parts: dict[str, float] = {}

    def part(name: str, count: int, kernel: Callable[..., Any], *arguments: Any) -> None:
        parts[name] = microseconds(lambda: kernel(*arguments), count, repeats)

    for beams in (1081, 181, 64):
        laser = LaserArrays.of(LaserSettings(beams=beams), True)
        out = np.empty((n, beams), np.float32)
        part(f"exact scan, {beams} beams", n, _scans, laser, *world, workspace, out)
        part(f"report, {beams} beams", n, _reports, laser, out)
    scans = np.empty((n, 1081), np.float32)
    _scans(LaserArrays.of(LaserSettings(), True), *world, workspace, scans)
    for beams in (1081, 181, 64):
        part(f"pool 1081 to {beams}", n, _pools, scans, np.empty((n, beams), np.float32))
    rangers = UltrasonicArrays.of(UltrasonicSettings(), True)
    ranges = np.empty((n, 8))
    part("fire, mean of 8", 8 * n, _firings, rangers, *world, workspace, ranges)

    env = NavigationVectorEnv(PLANS, split="test", pose_source="modelled", num_threads=1)
    env.reset(seed=0)
    suites, chairs = env.chairs.suite.record, env.chairs.parameters
    states, worlds = env.chairs.states, env.chairs.world_rows
    # Turning on the spot, so that nothing is touched.
    twists = np.column_stack([np.zeros(PERIODS), rng.uniform(-1, 1, PERIODS)])
    count = PERIODS * PLANS
    own = suites, chairs, states, worlds, twists, rangers.order, workspace
    part("drive, with clearance", count, _drives, *own)
    part("reckon", count, _reckons, states, chairs, PERIODS)
    sensed, verdicts, *_ = env._last.columns
    part("tell, clearance", count, _tells, states, chairs, worlds, sensed, PERIODS, workspace)
    own = env._task_rows.record, verdicts
    actions, out = np.zeros((PLANS, 2)), np.empty((PLANS, env.task.observation_size), np.float32)
    part("judge and observe", count, _judges, *own, actions, sensed, scans[0], out, PERIODS)
    begun = np.zeros((PLANS, 2))
    begun[:, 1] = 0.3
    part("whole step, batch of 8", PLANS, env.step, begun)
    part("whole reset, batch of 8", PLANS, env.reset)
    return parts


def main() -> None:
    """Print a table on standard error and JSON on standard output."""
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else REPEATS
    settings = {
        "machine": f"{platform.machine()}, Python {platform.python_version()}",
        "scene": SCENE,
        "seeds": list(range(PLANS)),
        "poses": PLANS * POSES,
        "repeats": repeats,
    }
    print(f"microseconds per part: {settings}", file=sys.stderr)
    parts = measure(repeats)
    for name, cost in parts.items():
        print(f"  {name:24s} {cost:7.3f}", file=sys.stderr)
    json.dump({**settings, "microseconds": parts}, sys.stdout, indent=2)
    print()


if __name__ == "__main__":
    main()

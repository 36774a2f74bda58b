"""Pose estimates and drawn maps of chairs: python -m tests.benchmarks.poses.

In floor plans with all noise: a chair explores and draws its map (SLAM); then the best scripted
policy drives there with each pose source, `mcl` once on the true map and once on the drawn one. For
each: how far the believed pose is off, and for how long (the lag at which its correlation with
itself falls to 1/e), beside the error model `modelled`.

With `--floor 45 --seeds 1` instead: one drive through all of a clinic of 45 m by 45 m, and what
SLAM makes of its readings with each number of particles.
"""

import argparse
import sys
import time
from dataclasses import replace
from typing import Any

import numpy as np

from agents.evaluation.compare import BEST
from agents.evaluation.evaluate import make_env
from agents.evaluation.map_evaluation import map_by_driving, map_quality
from agents.policies import make_policy
from tests.agents.fakes import infos_of
from wheelchair_gym.geometry.planar import relative_pose, wrap_angle
from wheelchair_gym.perception.slam import Slam, SlamSettings


def drive(source: str, seed: int, scene: Any, grid: Any = None) -> tuple[np.ndarray, bool]:
    """Errors (n, 3) [m, m, rad] of the believed pose along one episode, and whether it arrived."""
    env = make_env(scene, {"pose_source": source})
    env.reset(seed=seed)
    episode = env.unwrapped.episode
    given = episode if grid is None else replace(episode, map=grid)
    infos = [env.reset(seed=seed, options={"episode": given})[1], *infos_of(env, BEST)]
    env.close()
    off = np.array([np.subtract(info["pose_estimate"], info["pose"]) for info in infos[:-1]])
    off[:, 2] = wrap_angle(off[:, 2])
    return off, bool(infos[-1]["is_success"])


def lasting(runs: list[np.ndarray], period: float = 0.1) -> float:
    """Lag [s] at which errors along x and y correlate with themselves by less than 1/e."""
    longest = 200
    kept = [run[:, k] for run in runs for k in (0, 1) if len(run) > longest]
    if not kept:
        return float("nan")
    for lag in range(1, longest):
        if (
            sum(float(e[:-lag] @ e[lag:]) / (len(e) - lag) for e in kept)
            < sum(float(e @ e) / len(e) for e in kept) / np.e
        ):
            return lag * period
    return longest * period


def row(name: str, runs: list[np.ndarray], arrived: int) -> str:
    off = np.concatenate(runs)
    far, turn = 100 * np.hypot(off[:, 0], off[:, 1]), np.degrees(np.abs(off[:, 2]))
    worst = max(100 * np.sqrt((run[:, :2] ** 2).sum(axis=1).mean()) for run in runs)
    return (
        f"{name:22s}{np.sqrt((far**2).mean()):7.2f}{np.percentile(far, 50):7.2f}"
        f"{np.percentile(far, 95):7.2f}{np.percentile(far, 99):7.2f}{worst:7.2f}"
        f"{np.sqrt((turn**2).mean()):9.3f}{np.percentile(turn, 99):8.3f}{lasting(runs):8.1f}"
        f"{arrived:6d}/{len(runs)}"
    )


def map_floor(side: float, seed: int, particles: list[int]) -> None:
    """Explore a clinic, then run SLAM on the readings of that drive again and again."""
    scene = {
        "name": "floor_plan", "kind": "clinic", "building_size": [side - 0.1, side],
        "door_width": [1.0, 1.4], "corridor_width": [1.5, 2.4], "path_length": [5.0, 300.0],
    }  # fmt: skip
    env, taken = make_env(scene, {"pose_source": "slam"}), []

    def take(env: Any) -> None:
        chair, reading = env.unwrapped.chair, env.unwrapped.reading
        if len(taken) % 600 == 0:
            print(f"drives: {reading.stamp:.0f} s", file=sys.stderr, flush=True)
        taken.append((chair.belief.odometry, reading.laser.copy(), chair.truth.pose.copy()))

    explore = make_policy({"name": "explore", "seek": False})
    made = map_by_driving(env, explore, seed, 7200.0, take)
    episode, laser = env.unwrapped.episode, env.unwrapped.settings.sensors.laser
    print(
        f"clinic {side:g} m by {side:g} m, seed {seed}: {made.ended} after {made.seconds:.0f} s and"
        f" {made.way:.0f} m\nparticles  seed  pose RMS cm    p50    p95    max  deg RMS"
        "  cells right %  wall p50 cm    p95  times real time"
    )
    for count in particles:
        for draw in range(2 if count > 1 else 1):
            slam = Slam(laser, SlamSettings(particles=count), draw, episode.start)
            begun, off, last = time.perf_counter(), [], taken[0][0]
            for odometry, ranges, true in taken:
                off.append(slam.update(relative_pose(last, odometry), ranges) - true)
                last = odometry
            took = time.perf_counter() - begun
            far = 100 * np.hypot(*np.array(off)[:, :2].T)
            turn = np.degrees(wrap_angle(np.array(off)[:, 2]))
            found = map_quality(slam.built_map(), episode, env.unwrapped.task.footprint.half_width)
            print(
                f"{count:9d}{draw:6d}{np.sqrt((far**2).mean()):13.1f}{np.median(far):7.1f}"
                f"{np.percentile(far, 95):7.1f}{far.max():7.1f}{np.sqrt((turn**2).mean()):9.2f}"
                f"{100 * found.right:15.1f}{100 * found.wall_median:13.1f}"
                f"{100 * found.wall_p95:7.1f}{made.seconds / took:17.0f}",
                flush=True,
            )
    env.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10, help="0 to N - 1")
    parser.add_argument("--scene", default="floor_plan")
    parser.add_argument("--floor", type=float, help="side of a clinic [m]")
    parser.add_argument("--particles", default="1,8,30", help="with --floor")
    given = parser.parse_args()
    if given.floor:
        counts = [int(count) for count in given.particles.split(",")]
        for seed in range(given.seeds):
            map_floor(given.floor, seed, counts)
        return
    seeds = range(given.seeds)
    charts = []
    count = SlamSettings().particles
    print(f"{given.scene}, all noise: explored by frontiers with SLAM, {count} particles")
    print(
        "seed  ended   time s   way m  cells right %  wall p50 cm  p95 cm  floor %  pose cm   deg"
    )
    for seed in seeds:
        env = make_env(given.scene, {"pose_source": "slam"})
        policy = make_policy({"name": "explore", "seek": False})
        begun = time.perf_counter()
        made = map_by_driving(env, policy, seed, 900.0)
        env.close()
        charts.append(made)
        of = made.figures
        print(
            f"{seed:4d}  {made.ended:8s}{made.seconds:6.1f}{made.way:8.1f}{100 * of['right']:12.2f}"
            f"{100 * of['wall_median']:13.2f}{100 * of['wall_p95']:9.2f}"
            f"{100 * of['floor_seen']:9.1f}{100 * of['pose_rms_m']:9.2f}"
            f"{of['heading_rms_deg']:7.3f}   ({time.perf_counter() - begun:.0f} s of computing)",
            flush=True,
        )
    print(f"\n{BEST}, error of the believed pose [cm, deg], its memory [s], arrivals")
    print("source                    RMS    p50    p95    p99  worst  deg RMS     p99  memory")
    for name, source in (
        ("truth", "truth"), ("modelled", "modelled"), ("mcl", "mcl"), ("mcl on SLAM's map", "mcl"),
        ("slam, map unknown", "slam"), ("odometry", "odometry"),
    ):  # fmt: skip
        grids = [made.grid for made in charts] if "SLAM" in name else [None] * len(charts)
        runs = [drive(source, s, given.scene, grid) for s, grid in zip(seeds, grids, strict=True)]
        print(row(name, [off for off, _ in runs], sum(ok for _, ok in runs)), flush=True)


if __name__ == "__main__":
    main()

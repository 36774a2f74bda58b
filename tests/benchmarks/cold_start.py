"""How long the first commands take on a machine where nothing is compiled yet.

    python -m tests.benchmarks.cold_start
    python -m tests.benchmarks.cold_start --against ../other --only plan_lattice,env --runs 3

Each command runs in a process of its own with an empty folder for compiled kernels. Printed are
seconds, the processor's seconds of user time (helper processes included) and the number of
compiled pieces in the folder. With --against, another checkout runs in turn with this one.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.conftest import ROOT

_PLAN = "plan --map wheelchair_gym/maps/data/clinic.yaml --start 2,2 --goal 13,8 --planner"
_STEP = """
import gymnasium as gym, wheelchair_gym
env = gym.make("wheelchair_gym/Navigation-v0", scene="floor_plan", pose_source="modelled")
observation, _ = env.reset(seed=0)
{}
"""
_POLICY = """from agents.policies import GymPolicy, make_policy
policy = GymPolicy(make_policy("lattice+window"), env)
policy.reset()
env.step(policy.act(observation))"""
_VECTOR = """
import numpy as np
from wheelchair_gym.envs import NavigationVectorEnv
envs = NavigationVectorEnv(8, beams=64, bank=16)
envs.reset(seed=0)
envs.step(np.zeros((8, 2), np.float32))
"""
# What `python` is given; {out} is a folder for results.
COMMANDS = {
    "plan_rrt_star": [
        "-m", "wheelchair_gym", *_PLAN.split(), "rrt_star", "--set", "iterations=30000",
    ],
    "plan_picture": [
        "-m", "wheelchair_gym", *_PLAN.split(), "rrt_star", "--set", "iterations=30000",
        "--picture", "{out}/plan.png",
    ],
    "plan_lattice": ["-m", "wheelchair_gym", *_PLAN.split(), "lattice"],
    "env": ["-c", _STEP.format("env.step(env.action_space.sample())")],
    "env_policy": ["-c", _STEP.format(_POLICY)],
    "vector_env": ["-c", _VECTOR],
    "demo": ["-m", "wheelchair_gym", "compare", "--suite", "demo", "--out", "{out}/demo"],
    "tests": ["-m", "pytest", "-q", "-n", "2", "--dist", "loadfile", "-m", "not long"],
}  # fmt: skip


def measure(checkout: Path, arguments: list[str]) -> tuple[float, float, int]:
    """Seconds, user seconds and compiled pieces of one cold run of `python ARGUMENTS`."""
    with tempfile.TemporaryDirectory() as cache, tempfile.TemporaryDirectory() as out:
        env = {**os.environ, "NUMBA_CACHE_DIR": cache, "PYTHONPATH": str(checkout)}
        command = [sys.executable, *(part.replace("{out}", out) for part in arguments)]
        before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        ran = subprocess.run(
            command, cwd=checkout, env=env, capture_output=True, text=True, check=False
        )
        seconds = time.perf_counter() - begun
        user = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before.ru_utime
        if ran.returncode:
            print(ran.stderr[-2000:], file=sys.stderr)
        return seconds, user, sum(1 for _ in Path(cache).rglob("*.nbc"))


def main() -> None:
    """Measure what is asked for and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    known = [name for name in COMMANDS if name != "tests"]
    parser.add_argument("--only", default=",".join(known), help=f"of {', '.join(COMMANDS)}")
    parser.add_argument("--against", type=Path, help="another checkout")
    parser.add_argument("--runs", type=int, default=1, help="the medians are printed (default 1)")
    given = parser.parse_args()
    checkouts = [ROOT] + ([given.against.resolve()] if given.against else [])
    print(f"{'command':14} {'checkout':12} {'s':>7} {'user s':>7} {'pieces':>7}")
    for name in given.only.split(","):
        runs = [[measure(c, COMMANDS[name]) for c in checkouts] for _ in range(given.runs)]
        for k, checkout in enumerate(checkouts):
            seconds, user, pieces = (
                statistics.median(r[k][part] for r in runs) for part in range(3)
            )
            print(
                f"{name:14} {checkout.name:12} {seconds:7.1f} {user:7.1f} {pieces:7.0f}",
                flush=True,
            )


if __name__ == "__main__":
    main()

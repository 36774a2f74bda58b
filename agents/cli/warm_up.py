"""`wheelchair warm-up`: compile once what other commands would compile when they need it."""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from agents import read_data
from agents.benchmarks.entrants import small_problem
from agents.control import FOLLOWERS
from agents.evaluation.evaluate import warm
from planners import PLANNERS, make_planner
from wheelchair_gym.envs import NavigationEnv, NavigationVectorEnv

# Environments whose kernels differ, by what they are for.
ENVIRONMENTS: dict[str, dict[str, Any]] = read_data("warm_up.yaml")


def warm_up(given: argparse.Namespace) -> int:
    """Compile environments, planners and followers, and say what is ready."""
    from joblib import Parallel, delayed

    works: list[tuple[str, Callable[[str], None], str]] = [
        *((f"environment: {name}", _drive, name) for name in ENVIRONMENTS),
        ("vector environment", _drive_many, "crowd"),
        *((f"planner {name}", _plan, name) for name in PLANNERS.built_in),
        *((f"follower {name}", _follow, name) for name in FOLLOWERS.built_in),
    ]
    begun = time.monotonic()
    jobs = given.jobs or os.cpu_count()
    pool = Parallel(n_jobs=jobs, return_as="generator_unordered", batch_size=1)
    for number, what in enumerate(pool(delayed(_compile)(*each) for each in works), 1):
        seconds = time.monotonic() - begun
        print(f"{number:2} of {len(works)}, {seconds:4.0f} s: {what}", flush=True)
    return 0


def _compile(what: str, work: Callable[[str], None], name: str) -> str:
    """Do some work that calls kernels, and return what it was."""
    work(name)
    return what


def _drive(name: str) -> None:
    env = NavigationEnv(**ENVIRONMENTS[name])
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.zeros(2, np.float32))
    env.close()


def _drive_many(scene: str) -> None:
    envs = NavigationVectorEnv(2, scene, shield=True)
    envs.reset(seed=0)
    envs.step(np.zeros((2, 2), np.float32))
    envs.close()


def _plan(name: str) -> None:
    make_planner(name).plan(small_problem(), np.random.default_rng(0))


def _follow(name: str) -> None:
    warm(f"a_star+{name}", "clutter", {})

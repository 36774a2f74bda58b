"""Evaluation of many episodes at once: each row drives one, by a network in plain numpy."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from agents.learning.settings import Trials
from agents.learning.weights import Network
from wheelchair_gym.envs import EnvSettings, NavigationVectorEnv
from wheelchair_gym.envs.settings import BankSettings, StartSettings


def trial_env(env: EnvSettings, own: Trials, threads: int) -> NavigationVectorEnv:
    """Environments whose first episodes are the trials: the scene's own starts, another bank."""
    bank = BankSettings(own.episodes, 0.0, own.seed, env.bank.cache)
    own_env = dataclasses.replace(env, bank=bank, starts=StartSettings())
    return NavigationVectorEnv(
        own.episodes, own_env, autoreset_mode="SameStep", num_threads=min(threads, own.episodes)
    )


def flat(observations: dict[str, Any]) -> Any:
    """Observations (n, room) in one piece."""
    return np.concatenate(list(observations.values()), axis=1)


def run_trials(env: NavigationVectorEnv, network: Network, seed: int) -> dict[str, float]:
    """Shares of success, collision and timeout of the first episode of each row, and its time.

    Success is by truth and without contact; the mean time [s] is of successes.
    """
    n = env.num_envs
    observations, _ = env.reset(seed=seed)
    network.reset(n)
    running = np.ones(n, bool)
    success, collision, times = np.zeros(n, bool), np.zeros(n, bool), np.zeros(n)
    while running.any():
        actions = network(flat(observations))
        observations, _, terminated, truncated, infos = env.step(actions)
        ended = (terminated | truncated) & running
        if ended.any():
            final = infos["final_info"]
            success[ended] = final["is_success"][ended]
            collision[ended] = (final["bumped"] | final["contact"])[ended] & ~success[ended]
            times[ended] = final["time"][ended]
            running &= ~ended
    return {
        "success": float(success.mean()),
        "collision": float(collision.mean()),
        "timeout": float((~success & ~collision).mean()),
        "time": float(times[success].mean()) if success.any() else 0.0,
    }

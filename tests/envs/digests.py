"""Fingerprints of runs: as a program, it prints those of each environment that it is named."""

import hashlib
import sys

import gymnasium as gym
import numpy as np

from wheelchair_gym.envs import NavigationEnv

STEPS, SEEDS = 500, (0, 1, 2)


def digest_of(env_id, seed):
    """A fingerprint of everything that a run returns."""
    env = gym.make(env_id, split="test", pose_source="modelled", randomize=True)
    assert isinstance(env.unwrapped, NavigationEnv)
    h = hashlib.sha256()

    def take(observation, info):
        for value in observation.values():
            h.update(value.tobytes())
        for key in sorted(info):
            h.update(repr(info[key]).encode())

    take(*env.reset(seed=seed))
    rng = np.random.default_rng(seed)
    for _ in range(STEPS):
        observation, reward, terminated, truncated, info = env.step(rng.uniform(-1, 1, 2))
        h.update(repr((reward, terminated, truncated)).encode())
        take(observation, info)
        if terminated or truncated:
            take(*env.reset())
    return h.hexdigest()


def digests_of(env_ids):
    return [[digest_of(env_id, seed) for seed in SEEDS] for env_id in env_ids]


if __name__ == "__main__":
    print(digests_of(sys.argv[1:]))

"""Drive worlds and rotated copies of them side by side: outcomes and times should be the same.

Run: python -m tests.benchmarks.rotated [--episodes 20] [--policy lattice+window]
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace

import numpy as np

from agents.evaluation.evaluate import drive_episode, make_env
from agents.policies import make_policy
from wheelchair_gym.geometry import to_world


def rotated(episode, yaw):
    """The same world, turned about the origin by an angle [rad]."""
    frame = (0.0, 0.0, yaw)
    x, y, heading = episode.map.origin
    discs = episode.discs.copy()
    discs[:, :2] = to_world(discs[:, :2], frame)
    start, goal = (
        np.append(to_world(end[:2], frame), end[2] + yaw) for end in (episode.start, episode.goal)
    )
    return replace(
        episode,
        map=replace(episode.map, origin=(*to_world(np.array([x, y]), frame), heading + yaw)),
        walls=to_world(episode.walls.reshape(-1, 2), frame).reshape(-1, 4),
        discs=discs, start=start, goal=goal,
    )  # fmt: skip


def main():
    """Print a line for each episode, and how many pairs have the same outcome."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--policy", default="lattice+window")
    given = parser.parse_args()
    env, rng, pairs = make_env("floor_plan", {}), np.random.default_rng(0), []
    for seed in range(given.episodes):
        env.reset(seed=seed)
        episode, yaw = env.unwrapped.episode, rng.uniform(-math.pi, math.pi)
        pair = [
            drive_episode(env, make_policy(given.policy), seed, None, world)
            for world in (episode, rotated(episode, yaw))
        ]
        pairs.append(pair)
        told = "; ".join(f"{one['outcome']}, {one['time']:.1f} s" for one in pair)
        print(f"seed {seed}, turned by {math.degrees(yaw):4.0f} deg: {told}", flush=True)
    same = [pair for pair in pairs if pair[0]["outcome"] == pair[1]["outcome"]]
    ratio = np.median([after["time"] / before["time"] for before, after in same])
    print(f"{len(same)} of {len(pairs)} have the same outcome; median ratio of times {ratio:.4f}")


if __name__ == "__main__":
    main()

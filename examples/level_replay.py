"""Prioritised level replay: 1,024 chairs drive most often in the worlds where a policy fails."""

import argparse
import time

import numpy as np

from agents.learning.level_replay import LevelScores
from wheelchair_gym.envs import NavigationVectorEnv

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--steps", type=int, default=1000, help="of each chair")
parser.add_argument("--chairs", type=int, default=1024)
parser.add_argument("--worlds", type=int, default=512)
given = parser.parse_args()

env = NavigationVectorEnv(
    given.chairs,
    scene={"name": "mixture", "scenes": ["clutter", "empty"], "weights": [0.5, 0.5]},
    bank={"size": given.worlds, "turnover": 0.0},
    beams=64,
    config={"sensors": {"laser": {"beams": 64}}},
    autoreset_mode="SameStep",
)
env.worlds.fill()
levels, drawn = LevelScores(given.worlds), np.zeros(given.worlds, int)
observation, info = env.reset(seed=0)
began = time.perf_counter()
for _ in range(given.steps):
    _, cosine, sine = observation["goal"].T  # straight towards the goal: your policy stands here
    actions = np.stack([np.maximum(cosine, 0.0), np.clip(2.0 * sine, -1.0, 1.0)], axis=1)
    observation, _, terminated, truncated, info = env.step(actions)
    over = np.flatnonzero(terminated | truncated)
    if len(over):  # a failure scores 1; a learner would take the errors of its critic
        ended = {key: info["final_info"][key][over] for key in ("level", "is_success")}
        levels.update(ended["level"], 1.0 - ended["is_success"])
        env.set_next(over, weights=levels.weights())
        drawn += np.bincount(ended["level"], minlength=given.worlds)
seconds = time.perf_counter() - began

print(f"{given.steps * given.chairs / seconds:,.0f} steps/s")
hard = np.isfinite(levels.scores) & (levels.scores > 0.5)
for name, of in (("easy", levels.scores <= 0.5), ("hard", hard)):
    scenes = np.bincount(env.worlds.scenes[of], minlength=2)
    each = drawn[of].mean() if of.any() else 0.0
    print(f"{of.sum()} {name} levels: {each:.1f} episodes each; clutter, empty: {scenes}")

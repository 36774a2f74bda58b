"""Prioritised level replay: 1,024 chairs drive most often in the worlds where a policy fails."""

import argparse
import time

import numpy as np

from agents.learning.level_replay import LevelScores
from agents.learning.sb3 import flatten_observations
from agents.learning.weights import Network, find_weights, load_weights
from wheelchair_gym.envs import NavigationVectorEnv

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--steps", type=int, default=400, help="of each chair")
parser.add_argument("--chairs", type=int, default=1024)
parser.add_argument("--worlds", type=int, default=1024)
given = parser.parse_args()
STEPS, ROWS, LEVELS = given.steps, given.chairs, given.worlds

weights = load_weights(find_weights("td3_guided"))  # a policy that you would train meanwhile
network = Network(weights)
settings = weights.card["env"] | {
    "scene": {"name": "mixture", "scenes": ["barn", "empty"], "weights": [0.5, 0.5]},
    "bank": {"size": LEVELS, "turnover": 0.0},
    "task": weights.card["env"]["task"] | {"privileged": False, "max_episode_steps": 200},
}
env = NavigationVectorEnv(ROWS, config=settings, autoreset_mode="SameStep")
env.worlds.fill()
levels = LevelScores(LEVELS)
observation, info = env.reset(seed=0)
drawn = np.zeros(LEVELS, int)
began = time.perf_counter()
for _ in range(STEPS):
    at, action = info["level"], network(flatten_observations(observation))
    observation, _, terminated, truncated, info = env.step(action)
    over = terminated | truncated
    if over.any():  # a failure scores 1; with a critic, take its errors (the paper's score)
        success = info["final_info"]["is_success"][over]
        levels.update(at[over], 1.0 - success)
        env.set_next(range(ROWS), weights=levels.weights())
        drawn += np.bincount(at[over], minlength=LEVELS)
seconds = time.perf_counter() - began

scored = np.isfinite(levels.scores)
hard = scored & (levels.scores > 0.5)
print(f"{STEPS * ROWS / seconds:,.0f} steps/s; {scored.sum()} of {LEVELS} levels were driven")
for name, of in (("easy", scored & ~hard), ("hard", hard)):
    each = drawn[of].mean() if of.any() else 0.0
    scenes = np.bincount(env.worlds.scenes[of], minlength=2)
    print(f"{of.sum()} {name} levels: {each:.1f} episodes each; BARN, empty: {scenes}")

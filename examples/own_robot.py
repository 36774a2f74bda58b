"""A chair of your own from one JSON file: try it, drive it behind its shield, and learn with it.

The file names the outline, the limits, two laser scanners, a depth camera's fan and four
ultrasonics. Copy it, and change it to your chair:

    python examples/own_robot.py --config my_robot.json --steps 100000
"""

import argparse
from pathlib import Path

import gymnasium as gym
from stable_baselines3 import PPO

import wheelchair_gym  # noqa: F401 (registers the ids)
from agents.evaluation.evaluate import drive_episode
from agents.policies import make_policy

parser = argparse.ArgumentParser(description=__doc__)
default = str(Path(__file__).with_name("own_robot.json"))
parser.add_argument("--config", default=default, help="settings of the environment")
parser.add_argument("--episodes", type=int, default=5, help="that the planner drives")
parser.add_argument("--steps", type=int, default=100_000, help="of training")
given = parser.parse_args()

env = gym.make("wheelchair_gym/Navigation-v1", config=given.config)
for key, space in env.observation_space.items():
    print(f"{key}: {space.shape}")

policy = make_policy("lattice+window")  # a planner with a local controller
drives = [drive_episode(env, policy, seed) for seed in range(given.episodes)]
arrived = sum(drive["success"] for drive in drives)
print(f"lattice+window arrives in {arrived / len(drives):.0%} of the episodes")

model = PPO("MultiInputPolicy", env, n_steps=min(512, given.steps), batch_size=32, seed=0)
model.learn(given.steps)
print(f"trained {model.num_timesteps} steps")

"""Learn from pictures: the policy sees the chair and its world from above, and nothing else.

`render_width` and `render_height` set the size of every frame, for every shape of its world, so
that a frame can be an observation. Under 200 pixels a frame has no caption.

    python examples/pixel_observations.py --steps 200000 --film films
"""

import argparse

import gymnasium as gym
from gymnasium.wrappers import AddRenderObservation, RecordVideo
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor

import wheelchair_gym  # noqa: F401 (registers the ids)

SIDE = 84  # pixels: the least that SB3's CnnPolicy is used with


def make(film: str | None = None) -> gym.Env:
    """An environment whose observation is its frame (SIDE, SIDE, 3), uint8."""
    env = gym.make(
        "wheelchair_gym/Navigation-v1",
        scene="clutter",
        beams=64,
        render_mode="rgb_array",
        render_width=SIDE,
        render_height=SIDE,
    )
    if film is not None:
        env = RecordVideo(env, film, episode_trigger=lambda episode: True, disable_logger=True)
    return Monitor(AddRenderObservation(env))


parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--steps", type=int, default=200_000, help="of training")
parser.add_argument("--episodes", type=int, default=5, help="of the evaluation")
parser.add_argument("--film", metavar="FOLDER", help="film the evaluation")
given = parser.parse_args()

model = PPO("CnnPolicy", make(), n_steps=min(512, given.steps), batch_size=32, seed=0)
print(f"observations are {model.observation_space}")
model.learn(given.steps)
if given.episodes:
    env = make(given.film)
    mean, deviation = evaluate_policy(model, env, given.episodes)
    env.close()
    print(f"reward {mean:.2f} +- {deviation:.2f} in {given.episodes} episodes")

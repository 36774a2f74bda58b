"""Train PPO of stable-baselines3 in the vector environment, and judge it on worlds it has not seen.

python examples/train_sb3.py --steps 200000
"""

import argparse

from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO

from agents.evaluation.evaluate import evaluate
from agents.learning.sb3 import SaveModel, SB3VecEnv
from wheelchair_gym.envs import NavigationVectorEnv

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--steps", type=int, default=200_000, help="of training")
parser.add_argument("--episodes", type=int, default=10, help="of the evaluation")
parser.add_argument("--out", default="runs/train_sb3", help="folder of the model and the results")
given = parser.parse_args()

envs = NavigationVectorEnv(
    16,
    scene="clutter",
    beams=64,
    rate=5.0,
    guidance="geodesic",
    pose_source="modelled",
    bank=64,
    autoreset_mode=AutoresetMode.SAME_STEP,
)
model = PPO("MultiInputPolicy", SB3VecEnv(envs), n_steps=64, batch_size=256, seed=0)
# The file holds the settings of the environment, too: the policy observes and acts as in training.
file = f"{given.out}/model.zip"
model.learn(given.steps, callback=SaveModel(file), progress_bar=False)

policy = {"name": file, "label": "mine"}
records = evaluate(
    [policy, "straight"],
    ["clutter"],
    range(given.episodes),
    folder=given.out,
    env={"shield": True, "pose_source": "modelled"},
)
for name in ("mine", "straight"):
    of = [record for record in records if record["policy"] == name]
    print(f"{name:10} {sum(record['success'] for record in of)} of {len(of)} arrived")

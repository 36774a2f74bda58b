"""Print one line for each simulated person around a chair that waits.

The scene `people` has a person of every kind; `docs/concepts/people.md` explains them.
"""

import argparse

import numpy as np

from wheelchair_gym.actors.records import BEHAVIOURS, FURNITURE, PERSON, REACTIONS
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.sensors.settings import LaserSettings, SensorSettings
from wheelchair_gym.sim.chair import SimulatedChair

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--seed", type=int, default=1)
parser.add_argument("--seconds", type=int, default=20)
parser.add_argument("--model", choices=("orca", "social_force"), default="orca")
given = parser.parse_args()

scene = make_scene({"name": "people", "people": {"model": given.model}})
episode = scene.sample(np.random.default_rng(given.seed))
chair = SimulatedChair(sensors=SensorSettings(laser=LaserSettings(beams=64)))
chair.reset(episode, given.seed)
poses = [chair.truth.actor_poses]
for _ in range(10 * given.seconds):
    chair.drive(np.zeros(2))
    poses.append(chair.truth.actor_poses)

rows, places = episode.actors.rows, np.array(poses)[:, :, :2]
steps = np.hypot(*np.diff(places, axis=0).T).T  # (steps, actors) m
nearest = np.hypot(*(places - episode.start[:2]).T).min(axis=1)
print("  who           reaction     speed [m/s]  walked [m]  stood [s]  nearest to the chair [m]")
for k in np.flatnonzero(rows["kind"] == PERSON):
    row, name = rows[k], BEHAVIOURS[rows["behaviour"][k]]
    after = rows[k + 1] if k + 1 < len(rows) else None
    if row["leader"] > 0:
        name = "in a group"
    elif after is not None and after["leader"] == 1:
        name = "has a trolley" if after["kind"] == FURNITURE else "leads a group"
    stood = 0.1 * (steps[:, k] < 5e-3).sum()  # s
    print(
        f"  {name.replace('_', ' '):13} {REACTIONS[row['reaction']]:11}"
        f"  {row['speed']:12.2f}  {steps[:, k].sum():10.1f}  {stood:9.1f}"
        f"  {nearest[k]:24.2f}"
    )

"""Print the tracks around a chair that drives among people, after each second.

The tracker needs scans, twists and stamps, as any chair has them; here they are simulated, and the
last column compares with the truth.
"""

import argparse

import numpy as np

from wheelchair_gym.perception.track_state import KINDS
from wheelchair_gym.perception.tracker import Tracker
from wheelchair_gym.safety import Shield
from wheelchair_gym.scenes.crowd import Crowd
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.chair import SimulatedChair

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--seed", type=int, default=1)
parser.add_argument("--seconds", type=int, default=8)
given = parser.parse_args()

sensors = SensorSettings(pose_source="truth")
chair, shield, tracker = SimulatedChair(sensors=sensors), Shield(sensors=sensors), Tracker()
episode = Crowd(place="hall").sample(np.random.default_rng(given.seed))
reading = chair.reset(episode, given.seed)

print("  time  number  kind      place [m]     speed [m/s]  hidden  off by [m]")
for step in range(10 * given.seconds):
    tracks = tracker.update(reading.laser, reading.pose, reading.twist, reading.stamp)
    for k in np.flatnonzero(tracks.confirmed) if step % 10 == 9 else ():
        x, y = tracks.place[k]
        off = np.hypot(*(chair.truth.actor_poses[:, :2] - tracks.place[k]).T).min()
        print(
            f"{reading.stamp:6.1f}  {tracks.id[k]:6d}  {KINDS[tracks.kind[k]]:8}"
            f"  {x:5.2f}, {y:5.2f}  {np.hypot(*tracks.velocity[k]):11.2f}"
            f"  {'yes' if tracks.hidden[k] else 'no':6}  {off:.2f}"
        )
    twist = shield.filter(np.array([0.4, 0.3 * np.sin(0.1 * step)]), reading)
    reading = chair.drive(twist, shield.decision.protective)

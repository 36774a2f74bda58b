"""A policy of your own, compared with one of ours, each on the same two episodes.

Anything with `reset(mission)` and `act(reading) -> Command` is a policy. From the command line:
`wheelchair compare --policies own_policy:TowardsGoal,lattice+window --scenes clutter`.
"""

import argparse
import math

import numpy as np

from agents.evaluation.evaluate import evaluate
from wheelchair_gym.types import Command


class TowardsGoal:
    """Turns to the goal and drives, with no eye for obstacles."""

    def __init__(self, speed: float = 0.5):
        self.speed = speed

    def reset(self, mission):
        """Begin an episode; the mission holds map, goal and chair."""
        self.goal = mission.goal

    def act(self, reading):
        """The twist [m/s, rad/s] for the next control period."""
        x, y, yaw = reading.pose
        error = math.remainder(math.atan2(self.goal[1] - y, self.goal[0] - x) - yaw, math.tau)
        return Command(np.array([self.speed * max(0.0, math.cos(error)), 1.5 * error]))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", default="runs/own_policy", help="folder of the results")
    out = parser.parse_args().out
    policies = [{"name": "own_policy:TowardsGoal", "speed": 0.4}, "lattice+window"]
    for record in evaluate(policies, ["clutter"], [0, 1], folder=out, env={"shield": True}):
        print(f"{record['policy']:32} seed {record['seed']}: {record['outcome']}")

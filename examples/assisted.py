"""A new assistant, beside three of the project's, for a person with a tremor.

It halves every turn of the stick, which is no good idea. `docs/concepts/assistants.md`
explains drivers, assistants and measures.
"""

import argparse

import numpy as np

from agents.evaluation.evaluate import drive_episode, make_env
from agents.policies import make_policy

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--driver", default="essential_tremor")
parser.add_argument("--seed", type=int, default=0)


class HalfTurns:
    """Half of the stick's turn rate, at its speed."""

    def reset(self, mission):
        """Take what an assistant may know: chair, sensors, control period; no goal."""
        self.limits = mission.limits

    def assist(self, stick, reading, map):
        """The twist (2,) [m/s, rad/s] that the chair is asked for."""
        v, w = self.limits.twist_of(stick.forward, stick.left)
        return np.array([v, 0.5 * w])


if __name__ == "__main__":
    given = parser.parse_args()
    for assist in ("direct", "slide", "residual", "assisted:HalfTurns"):
        settings = {"driver": given.driver, "shield": assist != "direct"}
        env = make_env("clutter", settings)
        policy = make_policy({"name": "assisted", "assist": assist})
        record = drive_episode(env, policy, given.seed)
        env.close()
        print(
            f"{assist:18} {record['outcome']:9} after {record['time']:4.1f} s, "
            f"{np.degrees(record['agreement_angle']):4.1f} deg off the stick, "
            f"{record['stick_movements']:3.0f} movements/min"
        )

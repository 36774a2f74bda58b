"""A scene of your own: a hall with a row of pillars, new for each episode.

Anything with `sample(rng, footprint) -> Episode` is a scene. From the command line: `wheelchair
simulate --scene own_scene:Pillars --policy lattice+window --picture pillars.png`.
"""

import numpy as np

from agents.policies import GymPolicy, make_policy
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.types import Episode


class Pillars:
    """A hall of 12 m x 6 m, with square pillars in its middle."""

    def __init__(self, count: int = 4):
        self.count = count

    def sample(self, rng, footprint=None):
        """Draw a world, a start and a goal."""
        cells = np.zeros((120, 240), np.int8)  # 5 cm each; 0: free, 100: occupied
        cells[[0, -1]] = cells[:, [0, -1]] = 100
        for row in rng.integers(5, 105, self.count):
            cells[row : row + 8, 116:124] = 100
        grid = OccupancyGrid(cells, 0.05, (0.0, 0.0, 0.0))
        return Episode(grid, np.array([1.5, 3.0, 0.0]), np.array([10.5, 3.0, 0.0]), grid.walls())


if __name__ == "__main__":
    env = NavigationEnv("own_scene:Pillars", shield=True)
    policy = GymPolicy(make_policy("lattice+window"), env)
    observation, info = env.reset(seed=0)
    policy.reset()
    over = False
    while not over:
        observation, _, terminated, truncated, info = env.step(policy.act(observation))
        over = terminated or truncated
    print(f"arrived: {info['is_success']}, after {info['time']:.1f} s")

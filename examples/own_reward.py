"""A reward of your own, in the single and in the vector environment.

In a file of settings it is `"reward": "own_reward:gentle"`, for `wheelchair train` as well.
"""

import numpy as np

from wheelchair_gym.envs import NavigationEnv, NavigationVectorEnv


def gentle(terms, sensed, action):
    """Progress, less what is driven near obstacles and turned in haste."""
    near = max(0.0, 0.3 - sensed.clearance)
    return terms.progress + terms.arrived + terms.bumped - 0.1 * near - 0.01 * action[1] ** 2


if __name__ == "__main__":
    single = NavigationEnv("clutter", reward=gentle, beams=64)
    many = NavigationVectorEnv(4, scene="clutter", reward=gentle, beams=64)
    single.reset(seed=0)
    many.reset(seed=0)
    action = np.array([0.5, 0.2], np.float32)
    for _ in range(20):
        one = single.step(action)[1]
        rows = many.step(np.tile(action, (4, 1)))[1]
    assert one == rows[0]  # row 0 has the seed of the single environment
    print(f"single {one:.5f}, rows {np.round(rows, 5)}")

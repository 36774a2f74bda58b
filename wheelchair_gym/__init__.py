"""A robotic wheelchair you can simulate, plan for, train for and drive, through one loop.

Importing registers `wheelchair_gym/Navigation-v0` and `wheelchair_gym/GuidedNavigation-v0`.
"""

import gymnasium as gym

from wheelchair_gym.config import InputError

__version__ = "0.1.0"
__all__ = ["InputError", "__version__"]

_ENTRY = "wheelchair_gym.envs.navigation:NavigationEnv"

gym.register("wheelchair_gym/Navigation-v0", _ENTRY)
gym.register("wheelchair_gym/GuidedNavigation-v0", _ENTRY, kwargs={"guidance": "geodesic"})

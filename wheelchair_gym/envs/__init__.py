"""Gymnasium environments and their registered ids."""

from wheelchair_gym.envs.navigation import NavigationEnv
from wheelchair_gym.envs.settings import EnvSettings
from wheelchair_gym.envs.vector import NavigationVectorEnv

__all__ = ["EnvSettings", "NavigationEnv", "NavigationVectorEnv"]

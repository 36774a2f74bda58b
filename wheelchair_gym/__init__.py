"""A robotic wheelchair you can simulate, plan for, train for and drive, through one loop.

Importing registers `wheelchair_gym/Navigation-v1`, `wheelchair_gym/GuidedNavigation-v1`,
`wheelchair_gym/AssistedNavigation-v1`, where a simulated person drives and actions are those of an
assistant, and `wheelchair_gym/Hardware-v1`, which is the first over the real chair.
"""

import gymnasium as gym

from wheelchair_gym.base.settings import InputError

__version__ = "0.3.1"
__all__ = ["InputError", "__version__"]

_ENTRY = "wheelchair_gym.envs.navigation:NavigationEnv"

_VECTOR_ENTRY = "wheelchair_gym.envs.vector:NavigationVectorEnv"

_IDS: dict[str, dict[str, object]] = {
    "Navigation-v1": {"split": "train"},
    "GuidedNavigation-v1": {"split": "train", "guidance": "geodesic"},
    "AssistedNavigation-v1": {"split": "train", "driver": "novice", "shield": True},
}
for _id, _kwargs in _IDS.items():
    gym.register(f"wheelchair_gym/{_id}", _ENTRY, vector_entry_point=_VECTOR_ENTRY, kwargs=_kwargs)
# What configs/hardware.json changes of the defaults: a real chair does not know its true pose.
_REAL = {
    "sensors": {"pose_source": "mcl"},
    "chair": {"motor": {"control_rate": 200.0}},
    "physics": {"step": 0.005},
    "slam": {"reserve": 20.0},
}
gym.register("wheelchair_gym/Hardware-v1", _ENTRY, kwargs={"chair": "hardware", "config": _REAL})

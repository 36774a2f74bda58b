"""The task: observe and judge, pure functions of readings; rewards are named terms."""

from wheelchair_gym.task.rewards import TERMS, RewardWeights
from wheelchair_gym.task.settings import TaskSettings
from wheelchair_gym.task.task import Guidance, Observation, Task

__all__ = ["TERMS", "Guidance", "Observation", "RewardWeights", "Task", "TaskSettings"]

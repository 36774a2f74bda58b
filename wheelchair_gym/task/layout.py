"""How an observation is laid out: the space of each key, and where it stands in one piece."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.task.assess import LONG, WITHHELD
from wheelchair_gym.task.gaps import GAP_REACH
from wheelchair_gym.task.observe import GOAL_REACH, PATH_REACH
from wheelchair_gym.task.settings import TaskSettings


def boxes(
    settings: TaskSettings, rules: Any, reaches: NDArray[np.float64], half_width: float
) -> dict[str, Any]:
    """The space of each key, in the order in which kernels write them.

    Args:
        settings: what is observed.
        rules: record of RULES.
        reaches: of the ultrasonics (rangers,) [m].
        half_width: of the chair [m].
    """
    room, twist = int(rules["goal_room"]), rules["twist_most"].astype(np.float32)
    goal = np.array([GOAL_REACH, 1.0, 1.0, 1.0, 1.0][:room], np.float32)
    low = np.array([0.0, -1.0, -1.0, -1.0, -1.0][:room], np.float32)
    far, laser = reaches.astype(np.float32), float(rules["laser_reach"])
    spaces = {
        "laser": gym.spaces.Box(0.0, laser, (settings.beams,), np.float32),
        "ultrasonic": gym.spaces.Box(np.zeros_like(far), far),
        "twist": gym.spaces.Box(-twist, twist),
        "goal": gym.spaces.Box(low, goal),
    }
    if settings.last_action:
        spaces["action"] = gym.spaces.Box(-1.0, 1.0, (2,), np.float32)
    if settings.shield_state:
        low = np.array([0.0, -WITHHELD, -WITHHELD], np.float32)
        spaces["shield"] = gym.spaces.Box(low, np.array([1.0, WITHHELD, WITHHELD], np.float32))
    if rules["points"]:
        each = [PATH_REACH, PATH_REACH, 1.0, 1.0][: 4 if rules["posed"] else 2]
        most = np.tile(np.array(each, np.float32), int(rules["points"]))
        spaces["path"] = gym.spaces.Box(-most, most)
    if settings.gaps:
        low = np.full(rules["gaps"], -half_width, np.float32)
        spaces["gaps"] = gym.spaces.Box(low, np.full_like(low, GAP_REACH))
    if settings.trail:
        most = np.full(2 * len(settings.trail), PATH_REACH, np.float32)
        spaces["trail"] = gym.spaces.Box(-most, most)
    if settings.privileged:
        spaces["privileged"] = gym.spaces.Box(0.0, LONG, (3,), np.float32)
    return spaces


def places(spaces: dict[str, Any]) -> tuple[dict[str, slice], int]:
    """Where each key stands in an observation written in one piece, and of how many numbers."""
    found, begin = {}, 0
    for key, box in spaces.items():
        found[key] = slice(begin, begin + box.shape[0])
        begin += box.shape[0]
    return found, begin

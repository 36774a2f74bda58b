"""How an observation is laid out: the space of each key, and where it stands in one piece."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.task.assessment import LONG, WITHHELD
from wheelchair_gym.task.observations import GOAL_REACH, PATH_REACH
from wheelchair_gym.task.settings import TaskSettings
from wheelchair_gym.task.side_clearance import GAP_REACH

# Every key that an observation may have, the first four always.
KEYS = (
    "laser", "ultrasonic", "twist", "goal", "action", "shield", "path", "gaps", "trail",
    "privileged", "hidden_path", "hidden_gaps",
)  # fmt: skip
PRIVATE = "privileged", "hidden_path", "hidden_gaps"  # keys for critics and teachers; they are last


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
    each = [PATH_REACH, PATH_REACH, 1.0, 1.0][: 4 if rules["posed"] else 2]
    ahead = np.tile(np.array(each, np.float32), int(rules["points"]))
    if rules["points"] and not settings.unguided:
        spaces["path"] = gym.spaces.Box(-ahead, ahead)
    if settings.gaps:
        spaces["gaps"] = _gaps(int(rules["gaps"]), half_width)
    if settings.trail:
        most = np.full(2 * len(settings.trail), PATH_REACH, np.float32)
        spaces["trail"] = gym.spaces.Box(-most, most)
    if settings.privileged:
        spaces["privileged"] = gym.spaces.Box(0.0, LONG, (3,), np.float32)
        if rules["points"] and settings.unguided:
            spaces["hidden_path"] = gym.spaces.Box(-ahead, ahead)
            if settings.gaps:
                spaces["hidden_gaps"] = _gaps(2 + 2 * int(rules["points"]), half_width)
    return spaces


def _gaps(count: int, half_width: float) -> Any:
    low = np.full(count, -half_width, np.float32)
    return gym.spaces.Box(low, np.full_like(low, GAP_REACH))


def places(sizes: Iterable[tuple[str, int]]) -> dict[str, slice]:
    """Where each key stands in an observation written in one piece, by how many numbers tell it."""
    found, begin = {}, 0
    for key, size in sizes:
        found[key] = slice(begin, begin + size)
        begin += size
    return found

"""The features that a network gets: one definition for training, driving and export."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Floats
from wheelchair_gym.task.observations import PRIVILEGED, SCALES, places

RANGE_SCALE, RANGE_SHIFT = 0.6, 0.1  # a range r [m] becomes 0.6 ln(r + 0.1)
GOAL_RANGE = 10.0  # m: the goal's distance is clipped to this
GOAL_PROXIMITY_WEIGHT = 2.0  # weight of exp(-distance to the goal)
SCALED = (  # keys with a factor
    "twist", "goal", "stick", "action", "shield", "path", "side_clearance", "trail",
    "tracks",
)  # fmt: skip


@dataclass(frozen=True)
class Layout:
    """The place of each key in a flat observation, in the order of the task."""

    sizes: tuple[tuple[str, int], ...]  # key, count of numbers
    path_has_heading: bool  # the path holds poses, not points

    @classmethod
    def of_task(cls, task: Any) -> Layout:
        """The layout of a task's observations."""
        return cls(tuple((key, box.shape[0]) for key, box in task.spaces.items()), task.has_poses)

    @classmethod
    def of_card(cls, card: Mapping[str, Any]) -> Layout:
        """The layout that a card of weights holds."""
        layout = card["layout"]
        sizes = tuple((str(key), int(n)) for key, n in layout["sizes"])
        return cls(sizes, layout["path_has_heading"])

    @cached_property
    def _places(self) -> dict[str, slice]:
        return places(self.sizes)

    def slice_of(self, key: str) -> slice:
        """The place of a key; an empty slice if it is absent."""
        return self._places.get(key, slice(0, 0))

    @property
    def size(self) -> int:
        """Numbers in an observation."""
        return sum(size for _, size in self.sizes)

    @property
    def ranges_size(self) -> int:
        """Numbers that are ranges of lasers and ultrasonics; they are first."""
        return sum(size for key, size in self.sizes if key in ("laser", "ultrasonic"))

    @property
    def privileged_size(self) -> int:
        """Numbers that only a critic gets; they are last."""
        return sum(size for key, size in self.sizes if key in PRIVILEGED)

    @property
    def is_assistant(self) -> bool:
        """Whether a person's stick is observed, in place of a goal."""
        return "stick" in self._places

    @property
    def actor_size(self) -> int:
        """Features that an actor gets."""
        twice = int("goal" in self._places)  # the goal's distance gives two
        return self.size - self.privileged_size + twice

    @property
    def scales(self) -> Floats:
        """Factors of the keys of SCALED (n,), without the distance of the goal."""
        parts = [self._scale(key) for key in SCALED]
        del parts[SCALED.index("goal")][:1]
        return np.concatenate(parts).astype(np.float32)

    @property
    def privileged_scales(self) -> Floats:
        """Factors of the privileged numbers (privileged_size,)."""
        return np.concatenate([self._scale(key) for key in PRIVILEGED]).astype(np.float32)

    def _scale(self, key: str) -> list[float]:
        each = SCALES.get(key, [1.0])
        if key.endswith("path") and not self.path_has_heading:
            each = each[:2]
        return each * (dict(self.sizes).get(key, 0) // len(each))

    @property
    def scaled_indices(self) -> NDArray[np.int64]:
        """The places of the numbers of `scales` in a flat observation."""
        each = {key: self.slice_of(key) for key in SCALED}
        goal = each["goal"]
        each["goal"] = slice(min(goal.start + 1, goal.stop), goal.stop)
        return np.concatenate([np.arange(at.start, at.stop) for at in each.values()])


def features(xp: Any, flat: Any, layout: Layout, scaled: Any, scales: Any) -> Any:
    """Features (n, actor_size) of flat observations (n, size), by numpy or torch as `xp`.

    `scaled` and `scales` are `layout.scaled_indices` and `layout.scales`, as arrays of `xp`.
    """
    ranges = flat[:, : layout.ranges_size]
    parts = [RANGE_SCALE * xp.log(ranges + RANGE_SHIFT), flat[:, scaled] * scales]
    goal = layout.slice_of("goal")
    if goal.stop:
        far = flat[:, goal.start : goal.start + 1]
        parts += [far.clip(None, GOAL_RANGE) / GOAL_RANGE, GOAL_PROXIMITY_WEIGHT * xp.exp(-far)]
    return xp.concatenate(parts, -1)

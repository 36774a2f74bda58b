"""What a network is told of an observation: one definition for training, driving and export."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.task.observation_layout import PRIVATE, places

Floats = NDArray[np.float32]

RANGE_SCALE, RANGE_SHIFT = 0.6, 0.1  # ranges r [m] are told as 0.6 ln(r + 0.1)
GOAL_MOST = 10.0  # m: goals farther off are told as this far
NEAR_GOAL = 2.0  # weight of exp(-distance)
SCALED = "twist", "goal", "action", "shield", "path", "gaps", "trail"  # keys told times a factor
_AHEAD, _GAP = [0.5, 0.5, 1.0, 1.0], [4.0]  # of x, y [m] and heading of a pose; of a gap [m]
SCALES = {  # of keys whose numbers are not told as they are
    "path": _AHEAD, "gaps": _GAP, "trail": [0.5], "hidden_path": _AHEAD, "hidden_gaps": _GAP,
    "privileged": [1.0 / 15.0, 1.0 / 60.0, 1.0 / 10.0],  # of time to go, time left, way to go
}  # fmt: skip


@dataclass(frozen=True)
class Layout:
    """Where each key of an observation stands in a flat one, in the order of the task."""

    sizes: tuple[tuple[str, int], ...]  # key and how many numbers
    posed: bool  # poses lie ahead, not points

    @classmethod
    def of(cls, sizes: Iterable[Any], posed: bool) -> Layout:
        """The layout of pairs of a key and its size, in their order."""
        return cls(tuple((str(key), int(n)) for key, n in sizes), posed)

    def place(self, key: str) -> slice:
        """Where a key stands; an empty place where it is absent."""
        return places(self.sizes).get(key, slice(0, 0))

    @property
    def room(self) -> int:
        """Numbers in an observation."""
        return sum(size for _, size in self.sizes)

    @property
    def private(self) -> int:
        """Numbers that only a critic may see; they stand last."""
        return sum(size for key, size in self.sizes if key in PRIVATE)

    @property
    def told(self) -> int:
        """Numbers that an actor is told."""
        return self.room - self.private + 1  # the goal's distance is told twice

    @property
    def scales(self) -> Floats:
        """What the keys of SCALED are multiplied by (n,); of the goal, all but its distance."""
        parts = [self._scale(key) for key in SCALED]
        parts[SCALED.index("goal")].pop()
        return np.concatenate(parts).astype(np.float32)

    @property
    def private_scales(self) -> Floats:
        """What the numbers that only a critic may see are multiplied by (private,)."""
        return np.concatenate([self._scale(key) for key in PRIVATE]).astype(np.float32)

    def _scale(self, key: str) -> list[float]:
        each = SCALES.get(key, [1.0])
        if key.endswith("path") and not self.posed:
            each = each[:2]
        return each * (dict(self.sizes).get(key, 0) // len(each))

    @property
    def scaled(self) -> NDArray[np.int64]:
        """Which numbers of a flat observation those are."""
        each = {key: self.place(key) for key in SCALED}
        each["goal"] = slice(each["goal"].start + 1, each["goal"].stop)
        return np.concatenate([np.arange(at.start, at.stop) for at in each.values()])


def features(xp: Any, flat: Any, layout: Layout, scaled: Any, scales: Any) -> Any:
    """What a network is told, from flat observations (n, room): features (n, told).

    Args:
        xp: numpy or torch.
        flat: an array or a tensor.
        layout: of the observation.
        scaled: `layout.scaled`, as xp likes it.
        scales: `layout.scales`, as xp likes them.
    """
    ranges = flat[:, : layout.place("ultrasonic").stop]
    far = flat[:, layout.place("goal").start : layout.place("goal").start + 1]
    parts = [
        RANGE_SCALE * xp.log(ranges + RANGE_SHIFT),
        flat[:, scaled] * scales,
        far.clip(None, GOAL_MOST) / GOAL_MOST,
        NEAR_GOAL * xp.exp(-far),
    ]
    return xp.concatenate(parts, -1)

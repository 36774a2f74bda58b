"""Dead reckoning as a finder: what odometry alone knows, from where an episode starts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.geometry import compose
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]


class Reckoned:
    """Believes the odometry; see `mapping.chair.Finder`."""

    def begin(self, episode: Episode, key: int) -> None:
        """Start where an episode does; nothing is drawn."""
        self._pose = np.array(episode.start, np.float64)

    def update(self, increment: Array, ranges: NDArray[np.float32]) -> Array:
        """The pose (3,), moved on by what the odometry says (3,); ranges are not looked at."""
        self._pose = compose(self._pose, increment)
        return self._pose

    @property
    def poses(self) -> Array:
        """The one pose (1, 3)."""
        return self._pose[None]

    @property
    def chart(self) -> Callable[[], OccupancyGrid] | None:
        """It draws no map."""
        return None

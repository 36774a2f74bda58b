"""Any chair, with its pose from localisation on the map instead of from dead reckoning."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.geometry import between
from wheelchair_gym.mapping.localise import Localisation, Localiser
from wheelchair_gym.sensing.settings import LaserSettings
from wheelchair_gym.types import Belief, Chair, Episode, Reading, Truth

Array = NDArray[np.float64]


class LocalisedChair:
    """A chair that finds itself on the episode's map, from where the episode says it starts.

    Args:
        chair: whose readings hold dead-reckoned poses, in any frame.
        settings: of the localiser.
        laser: of the chair.
    """

    def __init__(self, chair: Chair, settings: Localisation, laser: LaserSettings) -> None:
        self.chair = chair
        self.localiser = Localiser(settings, laser)

    def reset(self, episode: Episode, key: int) -> Reading:
        """See `Chair.reset`."""
        reading = self.chair.reset(episode, key)
        self._reckoned = reading.pose
        self.localiser.begin(episode.map, episode.start, key)
        return reading._replace(pose=self.localiser.update(np.zeros(3), reading.laser))

    def drive(self, twist: Array) -> Reading:
        """See `Chair.drive`."""
        reading = self.chair.drive(twist)
        increment = between(self._reckoned, reading.pose)
        self._reckoned = reading.pose
        return reading._replace(pose=self.localiser.update(increment, reading.laser))

    @property
    def belief(self) -> Belief:
        """The pose before localisation, and the particles."""
        return Belief(self._reckoned, self.localiser.poses)

    @property
    def truth(self) -> Truth:
        """See `Chair.truth`."""
        return self.chair.truth

    def close(self) -> None:
        """See `Chair.close`."""
        self.chair.close()

"""Prioritised level replay (Jiang, Grefenstette and Rocktäschel 2021), for a bank of worlds.

Each world, a level, has a score: how much is to be learned there. Levels are drawn by the rank of
their score, and the longer ago they were drawn last, the more often.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.settings import InputError, setting, settings


@settings
class LevelReplay:
    """Parameters of prioritised level replay, named as in the paper."""

    beta: float = setting(default=0.3, low=1e-3, source="Jiang et al. 2021, for mazes")
    """Temperature: a level of rank r is drawn in proportion to (1 / r)^(1 / beta)."""
    rho: float = setting(default=0.3, low=0.0, high=1.0, source="Jiang et al. 2021, for mazes")
    """Share that is drawn by the age of scores instead."""


class LevelScores:
    """Scores of the levels of a bank.

    Args:
        levels: how many there are; all are unseen at first.
        replay: parameters.

    Attributes:
        scores: (levels,); infinite where a level is unseen, so that unseen ones come first.
        drawn: (levels,) number of the latest update in which each was scored; 0 at first.
    """

    def __init__(self, levels: int, replay: LevelReplay | None = None) -> None:
        if levels < 1:
            raise InputError(f"levels is {levels}; expected 1 at least")
        self.replay = replay or LevelReplay()
        self.scores, self.drawn = np.full(levels, math.inf), np.zeros(levels, np.int64)
        self._updates = 0

    def update(self, levels: NDArray[np.int64], scores: Array) -> None:
        """Take new scores (k,) of levels (k,); of a level that is named twice, their mean.

        Raises:
            InputError: a level is unknown, such as that of a world of no bank; or a score is NaN.
        """
        named, inverse = np.unique(self._known(levels), return_inverse=True)
        if np.isnan(scores).any():
            raise InputError(f"scores {shorten(scores)}: expected no NaN")
        self._updates += 1
        self.scores[named] = np.bincount(inverse, scores) / np.bincount(inverse)
        self.drawn[named] = self._updates

    def replace(self, levels: NDArray[np.int64]) -> None:
        """Forget levels (k,), as if they were unseen.

        Raises:
            InputError: a level is unknown.
        """
        known = self._known(levels)
        self.scores[known], self.drawn[known] = math.inf, 0

    def _known(self, levels: NDArray[np.int64]) -> NDArray[np.int64]:
        if len(levels) and not 0 <= np.min(levels) <= np.max(levels) < len(self.scores):
            expected = f"expected 0 to {len(self.scores) - 1}"
            raise InputError(f"levels {shorten(levels)}: {expected}")
        return levels

    def weights(self) -> Array:
        """How often each level is to be drawn (levels,); their sum is 1 (equations 1 to 3)."""
        by_score = rankdata(-self.scores) ** (-1.0 / self.replay.beta)  # equal ones share a rank
        age = (self._updates - self.drawn).astype(np.float64)
        by_age = age / age.sum() if age.any() else np.full(len(age), 1.0 / len(age))
        rho = self.replay.rho
        mixed: Array = (1.0 - rho) * by_score / by_score.sum() + rho * by_age
        return mixed

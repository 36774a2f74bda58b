"""Sums of means over strata, with their errors: what tests of claims are made of."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]
Sample = Mapping[str, Array]  # by stratum, such as a map: values (n,)


@dataclass(frozen=True)
class Estimate:
    """A sum of means with its standard error and degrees of freedom (Welch and Satterthwaite)."""

    value: float
    error: float
    freedom: float

    def p_above(self, least: float = 0.0) -> float:
        """One-sided p-value of 'the true value is above'."""
        gap = self.value - least
        if not math.isfinite(gap):
            return 1.0
        if self.error == 0.0:  # a method without chance
            return 0.0 if gap > 0.0 else 1.0
        return float(stats.t.sf(gap / self.error, self.freedom))

    def p_below(self, most: float = 0.0) -> float:
        """One-sided p-value of 'the true value is below'."""
        return Estimate(-self.value, self.error, self.freedom).p_above(-most)

    @property
    def interval(self) -> tuple[float, float]:
        """95 %, two-sided."""
        if self.error == 0.0 or not math.isfinite(self.error):
            half = 0.0 if self.error == 0.0 else math.inf
        else:
            half = float(stats.t.ppf(0.975, self.freedom)) * self.error
        return self.value - half, self.value + half


def estimate(samples: Sequence[Sample], weights: Sequence[float]) -> Estimate:
    """The weighted sum of samples' means; NaN where a stratum has fewer than two values."""
    value, parts = 0.0, []
    for sample, weight in zip(samples, weights, strict=True):
        for values in sample.values():
            n = len(values)
            if n < 2:
                return Estimate(math.nan, math.nan, math.nan)
            share = weight / len(sample)
            value += share * float(np.mean(values))
            parts.append((share**2 * float(np.var(values, ddof=1)) / n, n - 1))
    square = sum(part for part, _ in parts)
    below = sum(part**2 / n for part, n in parts)
    freedom = square**2 / below if below > 0.0 else math.inf
    return Estimate(value, math.sqrt(square), freedom)

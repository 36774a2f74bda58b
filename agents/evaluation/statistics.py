"""Statistics of results: shares, means and medians with 95 % intervals, and paired tests.

A sample has strata (a map, a goal): {stratum: values (n,)}. Strata are fixed and runs are random:
means are over strata with equal weights.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # which loads scipy.stats when it is used
from numpy.typing import ArrayLike

from wheelchair_gym.base.arrays import Array

Sample = Mapping[str, Array]  # by stratum, such as a map: values (n,)

Z95 = 1.959963984540054  # two-sided 95 % quantile of the normal distribution


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share (Wilson 1927); (0, 1) without any trial.

    Raises:
        ValueError: the counts are impossible.
    """
    if not 0 <= successes <= trials:
        raise ValueError(f"{successes} successes of {trials} trials")
    if trials == 0:
        return 0.0, 1.0
    share, square = successes / trials, Z95 * Z95
    centre = (share + square / (2 * trials)) / (1 + square / trials)
    spread = math.sqrt(share * (1 - share) / trials + square / (4 * trials * trials))
    spread *= Z95 / (1 + square / trials)
    return max(0.0, centre - spread), min(1.0, centre + spread)


def share(name: str, hits: int, trials: int) -> dict[str, Any]:
    """Return a share with its Wilson interval, under the keys NAME, NAME_low and NAME_high."""
    low, high = wilson(hits, trials)
    return {name: hits / trials if trials else None, f"{name}_low": low, f"{name}_high": high}


@dataclass(frozen=True)
class Estimate:
    """A sum of means with its standard error and degrees of freedom (Welch and Satterthwaite)."""

    value: float
    error: float
    freedom: float

    def p_above(self, minimum: float = 0.0) -> float:
        """Return the one-sided p-value of 'the true value is above `minimum`' (small: yes)."""
        gap = self.value - minimum
        if not math.isfinite(gap):
            return 1.0
        if self.error == 0.0:  # a deterministic method
            return 0.0 if gap > 0.0 else 1.0
        return float(scipy.stats.t.sf(gap / self.error, self.freedom))

    def p_below(self, maximum: float = 0.0) -> float:
        """Return the one-sided p-value of 'the true value is below `maximum`' (small: yes)."""
        return Estimate(-self.value, self.error, self.freedom).p_above(-maximum)

    @property
    def interval(self) -> tuple[float, float]:
        """95 %, two-sided."""
        quantile = float(scipy.stats.t.ppf(0.975, self.freedom)) if self.error > 0.0 else 0.0
        return self.value - quantile * self.error, self.value + quantile * self.error


def estimate(samples: Sequence[Sample], weights: Sequence[float], paired: bool = False) -> Estimate:
    """Return the weighted sum of samples' means; NaN where a stratum has fewer than two values.

    Paired samples have the same runs in the same order, NaN where a run has no value: the weighted
    sum is taken within each run, so that effects common to a run's values cancel.
    """
    if paired:  # of the runs that have all values
        sums = {s: np.tensordot(weights, [of[s] for of in samples], 1) for s in samples[0]}
        samples, weights = [{s: of[np.isfinite(of)] for s, of in sums.items()}], [1.0]
    value, variances = 0.0, []
    for sample, weight in zip(samples, weights, strict=True):
        for values in sample.values():
            n = len(values)
            if n < 2:
                return Estimate(math.nan, math.nan, math.nan)
            factor = weight / len(sample)
            value += factor * float(np.mean(values))
            variances.append((factor**2 * float(np.var(values, ddof=1)) / n, n - 1))
    variance = sum(part for part, _ in variances)
    denominator = sum(part**2 / freedom for part, freedom in variances)
    freedom = variance**2 / denominator if denominator > 0.0 else math.inf
    return Estimate(value, math.sqrt(variance), freedom)


def mean_interval(values: ArrayLike) -> tuple[float, float, float]:
    """Return the mean of values (n,) and its 95 % interval; NaN of fewer than two."""
    found = estimate([{"": np.asarray(values, dtype=float)}], [1.0])
    return found.value, *found.interval


def ratio_interval(ours: ArrayLike, theirs: ArrayLike) -> tuple[float, float, float]:
    """Return the geometric mean of paired ratios (n,) and its 95 % interval (of logarithms)."""
    mean, low, high = np.exp(mean_interval(np.log(np.divide(ours, theirs)))).tolist()
    return mean, low, high


def median_interval(values: Array) -> tuple[float, float, float]:
    """Return a median and its 95 % interval: the k-th smallest and k-th largest of n values.

    The number of values below the true median is binomial (n, 1/2). For fewer than six values no k
    gives 95 %, and the ends are NaN.
    """
    ordered, n = np.sort(values), len(values)
    k = int(scipy.stats.binom.ppf(0.025, n, 0.5))
    low, high = (ordered[k - 1], ordered[n - k]) if k else (math.nan, math.nan)
    return float(np.median(ordered)), float(low), float(high)


def effect_size(values: Array) -> dict[str, float]:
    """Return Cohen's d of differences with its 95 % interval: mean over standard deviation.

    The interval is that of the noncentral t distribution (Cumming and Finch 2001); NaN of fewer
    than two values, or of equal ones. Keys: d, d_low, d_high.
    """
    n, spread = len(values), float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    if spread == 0.0:
        return dict.fromkeys(("d", "d_low", "d_high"), math.nan)
    d, root = float(np.mean(values)) / spread, math.sqrt(n)
    low, high = (float(scipy.special.nctdtrinc(n - 1, p, d * root)) for p in (0.975, 0.025))
    return {"d": d, "d_low": low / root, "d_high": high / root}


def wilcoxon_p(values: Array, alternative: str = "two-sided") -> float:
    """Return the p-value of Wilcoxon's signed-rank test of differences; 1 where all are 0."""
    if not np.any(values):
        return 1.0
    return float(scipy.stats.wilcoxon(values, alternative=alternative).pvalue)


def mcnemar_p(ahead: int, behind: int) -> float:
    """Return McNemar's exact p-value of how often only one of two succeeds."""
    one = ahead + behind
    return float(scipy.stats.binomtest(ahead, one).pvalue) if one else 1.0


def mcnemar(ours: Sequence[bool], theirs: Sequence[bool]) -> tuple[int, int, float]:
    """Return how often only one of two succeeds, ours and theirs, and McNemar's exact p-value."""
    pairs = list(zip(ours, theirs, strict=True))
    ahead, behind = sum(a and not b for a, b in pairs), sum(b and not a for a, b in pairs)
    return ahead, behind, mcnemar_p(ahead, behind)


def holm(p: Sequence[float]) -> list[float]:
    """Return Holm's adjusted p-values (Holm 1979)."""
    adjusted, maximum = [0.0] * len(p), 0.0
    for rank, k in enumerate(np.argsort(p)):
        maximum = max(maximum, min(1.0, (len(p) - rank) * p[k]))
        adjusted[int(k)] = maximum
    return adjusted

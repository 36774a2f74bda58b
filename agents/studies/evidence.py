"""Statistical tests of claims: effects with intervals, and p-values for and against a claim.

Rows of a study whose runs share their seeds are compared run by run. A claim is tested twice, for
confirmation and for refutation; if neither test is significant, it cannot be decided. A claim of
'no effect' is confirmed by equivalence: the effect lies within a margin (two one-sided tests,
Schuirmann 1987).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from typing import Any

import numpy as np
from scipy import stats

from agents.evaluation.statistics import (
    Estimate,
    Sample,
    estimate,
    median_interval,
    wilcoxon_p,
    wilson,
)
from wheelchair_gym.base.arrays import Array

LEVEL = 0.05  # of all claims together


class ClaimVerdict(StrEnum):
    """The result of the tests of a claim."""

    HOLDS = "holds"
    FAILS = "does not hold"
    OPEN = "cannot be decided"


@dataclass(frozen=True)
class Evidence:
    """An effect with its 95 % interval, and the p-values for and against a claim."""

    p_for: float
    p_against: float
    effect: float
    low: float
    high: float
    unit: str
    test: str
    text: str = ""  # what is compared

    def verdict(self, claims: int) -> ClaimVerdict:
        """The verdict among this number of claims (Bonferroni)."""
        if claims * self.p_for < LEVEL:
            return ClaimVerdict.HOLDS
        if claims * self.p_against < LEVEL:
            return ClaimVerdict.FAILS
        return ClaimVerdict.OPEN


def no_evidence(why: str) -> Evidence:
    """Evidence neither for nor against a claim."""
    return Evidence(1.0, 1.0, math.nan, math.nan, math.nan, "", why)


def common_strata(samples: Sequence[Sample]) -> list[Sample]:
    """The samples, restricted to strata in which each has at least two values."""

    def enough(values: Array) -> bool:
        return int(np.isfinite(values).sum()) > 1

    common = [s for s in samples[0] if all(s in other and enough(other[s]) for other in samples)]
    return [{s: sample[s] for s in common} for sample in samples]


@dataclass(frozen=True)
class Effect:
    """A difference of means relative to another mean."""

    samples: Sequence[Sample]
    change: Sequence[float]  # weights of the difference
    level: Sequence[float]  # weights of the reference
    paired: bool = False

    def beyond(self, part: float) -> Estimate:
        """The difference less a multiple of the reference, for exact tests of ratios."""
        weights = [c - part * m for c, m in zip(self.change, self.level, strict=True)]
        return estimate(self.samples, weights, self.paired)

    @property
    def test(self) -> str:
        """The name of the test."""
        return "paired t" if self.paired else "Welch t"

    def p_within(self, low: float, high: float) -> float:
        """P-value of 'the effect lies between', two one-sided tests."""
        return max(self.beyond(low).p_above(), self.beyond(high).p_below())

    def evidence(self, p_for: float, p_against: float, test: str, text: str) -> Evidence:
        """The effect in per cent, with p-values for a claim and against it."""
        difference, level = self.beyond(0.0), estimate(self.samples, self.level, self.paired).value
        effect, low, high = (100.0 * v / level for v in (difference.value, *difference.interval))
        return Evidence(p_for, p_against, effect, low, high, "%", test, text)


def _difference(a: Sample, b: Sample, paired: bool) -> Effect | None:
    """The difference of a from b relative to b; None without a common stratum."""
    samples = common_strata([a, b])
    return Effect(samples, (1.0, -1.0), (0.0, 1.0), paired) if samples[0] else None


def below(
    a: Sample, b: Sample, negligible: float, text: str, paired: bool = False, sign: float = -1.0
) -> Evidence:
    """Evidence for 'the mean of a is below that of b': Welch's or the paired t, strata alike.

    `negligible` is a relative difference that counts as none, `text` says what is compared.
    """
    effect = _difference(a, b, paired)
    if effect is None:
        return no_evidence("no runs to compare")
    gap = effect.beyond(0.0)
    p = min(1.0, 2.0 * min(gap.p_below(), gap.p_above()))
    none = effect.p_within(-negligible, negligible)
    return effect.evidence(*_directional_p(sign * gap.value > 0.0, p, none), effect.test, text)


above = partial(below, sign=1.0)  # evidence for 'the mean of a is above that of b'


def _directional_p(right: bool, p: float, none: float) -> tuple[float, float]:
    """P-values for and against a direction, from those of a difference and of equivalence."""
    return (p, none) if right else (1.0, min(p, none))


def between(
    a: Sample, b: Sample, low: float, high: float, text: str, paired: bool = False
) -> Evidence:
    """Evidence for 'a differs from b by a part of b from low to high'."""
    effect = _difference(a, b, paired)
    test = f"two one-sided {effect.test if effect else 't'}, {100 * low:+g} to {100 * high:+g} %"
    return _within(effect, low, high, test, text)


def _within(effect: Effect | None, low: float, high: float, test: str, text: str) -> Evidence:
    """Evidence for 'the effect lies from low to high'."""
    if effect is None:
        return no_evidence("no runs to compare")
    p_outside = min(1.0, 2.0 * min(effect.beyond(low).p_below(), effect.beyond(high).p_above()))
    return effect.evidence(effect.p_within(low, high), p_outside, test, text)


def _slope(samples: Sequence[Sample], x: Sequence[float], paired: bool) -> Effect | None:
    """The change of the regression line from the first x to the last, relative to the mean."""
    ours = common_strata(samples)
    if not ours[0]:
        return None
    at = np.asarray(x, dtype=float) - np.mean(x)
    change = at / (at**2).sum() * (x[-1] - x[0])
    return Effect(ours, change.tolist(), [1.0 / len(x)] * len(x), paired)


def _spearman(samples: Sequence[Sample], x: Sequence[float]) -> tuple[float, float]:
    """Spearman's rank correlation of values with x, ranked within each stratum; its p-value."""
    places, ranks = [], []
    for stratum in samples[0]:
        values = [sample[stratum] for sample in samples]
        rank = stats.rankdata(np.concatenate(values))
        ranks.append(rank / (len(rank) + 1.0))
        places.append(np.repeat(np.asarray(x, dtype=float), [len(v) for v in values]))
    if not ranks or np.ptp(np.concatenate(ranks)) == 0.0:
        return 0.0, 1.0
    found = stats.spearmanr(np.concatenate(places), np.concatenate(ranks))
    return float(found.statistic), float(found.pvalue)


def _page(samples: Sequence[Sample]) -> tuple[float, float]:
    """Page's test of a trend over paired samples: its direction, and its two-sided p-value.

    The values of each run are ranked among themselves (Page 1963).
    """
    runs = [np.stack([sample[stratum] for sample in samples], axis=1) for stratum in samples[0]]
    ranked = np.concatenate(runs)
    ranked = ranked[np.isfinite(ranked).all(axis=1)]
    if len(ranked) < 2 or np.ptp(ranked, axis=1).max() == 0.0:
        return 0.0, 1.0
    up, down = (
        float(stats.page_trend_test(values, method="asymptotic").pvalue)
        for values in (ranked, ranked[:, ::-1])
    )
    return down - up, min(1.0, 2.0 * min(up, down))


def rises(
    samples: Sequence[Sample], x: Sequence[float], negligible: float, text: str,
    paired: bool = False, sign: float = 1.0,
) -> Evidence:  # fmt: skip
    """Evidence for 'the values rise as x grows'; the effect is the line's over the range of x.

    The test is Spearman's rank correlation, or Page's trend of paired samples in the order of x.
    """
    effect = _slope(samples, x, paired)
    if effect is None:
        return no_evidence("no runs to compare")
    if paired:
        (direction, p), test = _page(effect.samples), "Page's trend"
    else:
        direction, p = _spearman(effect.samples, x)
        test = f"Spearman, rho {direction:+.2f}"
    both = _directional_p(sign * direction > 0.0, p, effect.p_within(-negligible, negligible))
    return effect.evidence(*both, test, text)


falls = partial(rises, sign=-1.0)  # evidence for 'the values fall as x grows'


def level(
    samples: Sequence[Sample], x: Sequence[float], margin: float, text: str, paired: bool = False
) -> Evidence:
    """Evidence for 'the values do not depend on x': the line's change lies within a margin."""
    test = f"two one-sided t of the line, within {100 * margin:g} %"
    return _within(_slope(samples, x, paired), -margin, margin, test, text)


def paired_below(a: Array, b: Array, negligible: float, text: str, sign: float = 1.0) -> Evidence:
    """Evidence for 'a is below b' of paired runs (above for sign -1): Wilcoxon's signed-rank test.

    The effect is the median difference relative to the median of b.
    """
    if len(a) < 2:
        return no_evidence("no runs to compare")
    p_low, p_high = wilcoxon_p(a - b, "less"), wilcoxon_p(a - b, "greater")
    p = min(1.0, 2.0 * min(p_low, p_high))
    scale = abs(float(np.median(b))) or 1.0
    none = max(wilcoxon_p(a - b + negligible * scale, "greater"),
               wilcoxon_p(a - b - negligible * scale, "less"))  # fmt: skip
    effect, low, high = (100.0 * v / scale for v in median_interval(a - b))
    both = _directional_p(sign * (p_high - p_low) > 0.0, p, none)
    return Evidence(*both, effect, low, high, "%", "Wilcoxon, paired", text)


SPREAD_MARGIN = 0.05  # part of a scatter that counts as none


def spread_below(a: Sample, b: Sample, negligible: float, text: str) -> Evidence:
    """Evidence for 'a scatters less than b': distances from medians of strata (Brown-Forsythe).

    The effect is the mean distance of a relative to that of b.
    """
    near, far = (
        np.concatenate([np.abs(values - np.median(values)) for values in sample.values()])
        for sample in (a, b)
    )
    return below({"": near}, {"": far}, negligible, text)


def share_above(successes: int, trials: int, bound: float, text: str) -> Evidence:
    """Evidence for 'the share of successes is above': the exact binomial test."""
    if trials == 0:
        return no_evidence("no runs")
    p_for, p_against = (
        float(stats.binomtest(successes, trials, bound, alternative=side).pvalue)
        for side in ("greater", "less")
    )
    low, high = (100.0 * v for v in wilson(successes, trials))
    effect = 100.0 * successes / trials
    return Evidence(p_for, p_against, effect, low, high, "%", f"binomial, {100 * bound:g} %", text)


def all_of(parts: Sequence[Evidence], text: str) -> Evidence:
    """Evidence for 'all of these hold'; its effect is that of the least certain one."""
    worst: Any = max(parts, key=lambda part: (part.p_for, -part.p_against))
    return Evidence(
        max(part.p_for for part in parts),
        min(1.0, len(parts) * min(part.p_against for part in parts)),
        worst.effect, worst.low, worst.high, worst.unit,
        f"{worst.test}; all of {len(parts)}", f"{text}; least certain: {worst.text}",
    )  # fmt: skip

"""Claims of the sources: how each is tested on the runs of a study, and the statistical tests.

A test gives an effect with its interval, and p-values for and against a claim. Rows of a study
whose runs share their seeds are compared run by run. A claim is tested twice, for confirmation and
for refutation; if neither test is significant, it cannot be decided. A claim of 'no effect' is
confirmed by equivalence: the effect lies within a margin (two one-sided tests, Schuirmann 1987).

One claim is that the thesis agrees with itself. Each row of its tuning tables of the global
variant has a printed mean length. A reading of the algorithm predicts how long that row's paths are
relative to those of RRT*. One number is free: the mean length of RRT*'s own paths on the thesis's
maps, which table 3.1 prints, too.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from typing import Any, Final, NamedTuple

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
from agents.studies.model import RATIO, Metric, Results, Row, Study
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


PRINTED_RRT_STAR: Final = 35.268  # m: mean length of RRT*, table 3.1
_DRAWS: Final = 2000  # of the bootstrap over the rows of the tables


class Fit(NamedTuple):
    """Agreement of a reading with the printed lengths."""

    correlation: float
    r2: float  # share of the printed variance that is explained
    rms: float  # m, of the residuals
    length: Estimate  # m: RRT*'s mean length that is implied
    predicted: Array  # (n,) m
    printed: Array  # (n,) m


def fit(ratios: Array, printed: Array) -> Fit:
    """The fit of printed lengths (n,) [m] by a multiple of predicted ratios (n,)."""
    square = float((ratios**2).sum())
    length = float((ratios * printed).sum()) / square
    off = printed - length * ratios
    spread = float(((printed - printed.mean()) ** 2).sum())
    error = float(np.sqrt((off**2).sum() / (len(off) - 1) / square))
    return Fit(
        float(np.corrcoef(ratios, printed)[0, 1]), 1.0 - float((off**2).sum()) / spread,
        float(np.sqrt((off**2).mean())), Estimate(length, error, len(off) - 1.0),
        length * ratios, printed,
    )  # fmt: skip


def ratios_of(r: Results, reading: str, strata: Sequence[str] = (), without: str = "") -> Array:
    """Columns (n, 2) of a reading: mean ratio of each row over the maps, and printed length [m]."""
    rows = [row for row in r.study.series(reading) if row.group != without]
    found = []
    for row in rows:
        sample = r.sample(row.label, RATIO)
        means = [values.mean() for s, values in sample.items() if not strata or s in strata]
        found.append((float(np.mean(means)), row.x))
    return np.array(found)


def fit_reading(r: Results, reading: str, strata: Sequence[str] = (), without: str = "") -> Fit:
    """The fit of a reading, of all maps or some, perhaps without one table."""
    return fit(*ratios_of(r, reading, strata, without).T)


WITHOUT: Final = "t1-3.7"  # the table of mu, after which its exchange was chosen


def agreement(r: Results) -> list[dict[str, Any]]:
    """A row for each reading: the figures of its fit with intervals, and of parts held out."""
    readings = list(dict.fromkeys(row.series for row in r.study.rows))
    maps = list(next(iter(r.study.rows)).jobs)
    parts = {"odd": maps[::2], "even": maps[1::2]}
    rows = []
    for reading in readings:
        columns, rng = ratios_of(r, reading), np.random.default_rng(0)
        n = len(columns)
        bootstrap = [fit(*columns[rng.integers(n, size=n)].T) for _ in range(_DRAWS)]
        fits = [fit(*columns.T), *bootstrap]
        figures = np.array([(*one[:3], one.length.value) for one in fits])
        row: dict[str, Any] = {"reading": reading, "rows": n}
        for key, (found, *drawn) in zip(Fit._fields, figures.T.tolist(), strict=False):
            row[key] = found
            row[f"{key}_low"], row[f"{key}_high"] = np.percentile(drawn, [2.5, 97.5]).tolist()
        for part, strata in parts.items():
            row[part] = fit_reading(r, reading, strata).correlation
        row["without"] = fit_reading(r, reading, without=WITHOUT).correlation
        rows.append(row)
    return rows


def residuals(r: Results, reading: str) -> Array:
    """Absolute differences (n,) [m] of the printed lengths from the fit of a reading."""
    found = fit_reading(r, reading)
    return np.abs(found.printed - found.predicted)


_Test = Callable[..., Evidence]
_COMPARISONS: Final[dict[str, _Test]] = {"below": below, "above": above}
_PAIRED: Final = {"paired_below": 1.0, "paired_above": -1.0}
_TRENDS: Final[dict[str, _Test]] = {"rises": rises, "falls": falls, "level": level}


@dataclass(frozen=True)
class Claim:
    """A claim of a source and its test; rows are named by their label, group or series."""

    text: str
    source: str
    # below, above, between, paired_below, paired_above, rises, falls, level, spread_below; share or
    # share_without: the share of runs in which the metric is true, or is not, is above `low`; of
    # readings (see `agreement`) follows, fits_better, implied
    test: str
    metric: str  # its key
    # Rows that are compared with others, or with a value of each stratum; all pairs must hold.
    pairs: Sequence[tuple[str, Any]] = ()
    rows: Sequence[str] = ()  # of a trend or a share; empty: all
    low: float | None = None  # bounds of `between`; None: the margin of the metric
    high: float | None = None
    of_solved: bool = False  # a share of the runs that found a path only
    by_series: bool = False  # rows of different series are different strata
    # The row of the shortest paths that there are: how much of the effect is possible at all.
    ceiling: str = ""
    printed: float | None = None  # effect in the source, where no table of it has our rows
    reading: str = ""  # of the source's text; empty: that of the study

    def printed_effect(self, study: Study) -> float:
        """Return the effect that the source prints, as a part; NaN where it prints no figure.

        Of several comparisons it is the smallest; of a trend, the change of the line.
        """
        if self.printed is not None:
            return self.printed
        if self.test in _TRENDS:
            rows = [row for row in _named(study, self.rows) if self.metric in row.published]
            if len(rows) < 2:
                return math.nan
            values = [row.published[self.metric] for row in rows]
            slope = np.polyfit([row.x for row in rows], values, 1)[0]
            return float(slope * (rows[-1].x - rows[0].x) / np.mean(values))
        effects = [self._printed_pair(study, *pair) for pair in self.pairs]
        return min((e for e in effects if math.isfinite(e)), key=abs, default=math.nan)

    def _printed_pair(self, study: Study, a: str, b: Any) -> float:
        ours, theirs = (self._published(study, name) for name in (a, b))
        common = ours.keys() & theirs.keys()
        if not common:
            return math.nan
        first, second = (np.mean([of[key] for key in common]) for of in (ours, theirs))
        return float(first / second - 1.0)

    def _published(self, study: Study, name: Any) -> dict[tuple[str, ...], float]:
        """The printed means of the rows of a name, by stratum."""
        found: dict[tuple[str, ...], list[float]] = {}
        for row in _named(study, [str(name)]):
            if self.metric in row.published:
                key = (row.series if self.by_series else "", *row.jobs)
                found.setdefault(key, []).append(row.published[self.metric])
        return {key: float(np.mean(values)) for key, values in found.items()}

    def margin(self, study: Study) -> float | None:
        """Return the relative difference that counts as none; None for a test without a margin.

        An effect as large as the printed one never refutes a claim: the margin of a difference is
        no larger than the printed effect, that of no difference no smaller.
        """
        if self.metric not in study.margins or self.test in _AGREEMENT or self.low is not None:
            return None
        margin, printed = study.margins[self.metric], abs(self.printed_effect(study))
        if self.test == "spread_below":
            margin = SPREAD_MARGIN
        if math.isnan(printed):
            return margin
        return max(margin, printed) if self.test in ("level", "between") else min(margin, printed)

    def judge(self, r: Results) -> Evidence:
        """The evidence for the claim in the results of its study."""
        if self.test.startswith("share"):
            return self._share(r)
        if self.test in _AGREEMENT:
            return _AGREEMENT[self.test](self, r)
        metric, margin = r.study.metric(self.metric), self.margin(r.study) or 0.0
        paired = r.study.paired
        if self.test in _TRENDS:
            rows = _named(r.study, self.rows)
            text = f"{metric.name} from {rows[0].label} to {rows[-1].label}"
            return _TRENDS[self.test](
                _trend(r, rows, metric), [row.x for row in rows], margin, text, paired
            )
        parts = [self._compare(r, *pair, metric, margin) for pair in self.pairs]
        found = parts[0]
        if len(parts) > 1:
            found = all_of(parts, f"{metric.name} in {len(parts)} comparisons")
        if self.ceiling:
            minimum = replace(self, test="between", ceiling="")._compare(
                r, self.ceiling, self.pairs[0][1], metric, margin
            )
            text = f"{found.text}; no path can be more than {-minimum.effect:.1f} % shorter"
            found = replace(found, text=text)
        return found

    def _compare(self, r: Results, a: str, b: Any, metric: Metric, margin: float) -> Evidence:
        text = f"{metric.name} of {a} against {b if isinstance(b, str) else 'the optimum'}"
        if self.test in _PAIRED:
            first, second = r.paired(a, metric), r.paired(b, metric)
            both = np.isfinite(first) & np.isfinite(second)
            sign = _PAIRED[self.test]
            return paired_below(first[both], second[both], margin, text, sign)
        if self.test == "spread_below":
            return spread_below(r.sample(a, metric), r.sample(b, metric), margin, text)
        ours = self._sample(r, a, metric)
        if isinstance(b, str):
            theirs = self._sample(r, b, metric)
        else:
            value = b if isinstance(b, Mapping) else dict.fromkeys(ours, b)
            theirs = {s: np.full(max(2, len(of)), value[s]) for s, of in ours.items()}
        paired = r.study.paired
        if self.test == "between":
            low, high = -margin if self.low is None else self.low, self.high
            high = margin if high is None else high
            return between(ours, theirs, low, high, text, paired)
        return _COMPARISONS[self.test](ours, theirs, margin, text, paired)

    def _sample(self, r: Results, name: str, metric: Metric) -> Sample:
        """The values of all rows of a name, by stratum; of paired rows, the mean of each run."""
        found: dict[str, list[np.ndarray]] = {}
        for row in _named(r.study, [name]):
            for stratum, values in r.sample(row.label, metric, r.study.paired).items():
                key = f"{row.series}, {stratum}" if self.by_series else stratum
                found.setdefault(key, []).append(values)
        if r.study.paired:
            return {key: np.mean(values, axis=0) for key, values in found.items()}
        return {key: np.concatenate(values) for key, values in found.items()}

    def _share(self, r: Results) -> Evidence:
        labels = {row.label for row in _named(r.study, self.rows)}
        runs = [run for (label, _), of in r.runs.items() if label in labels for run in of]
        runs = [run for run in runs if run["solved"] or not self.of_solved]
        wanted = self.test == "share"
        hits = sum(bool(run[self.metric]) is wanted for run in runs)
        of = f"runs of {', '.join(self.rows)}" if self.rows else "all runs"
        text = f"{of}: {'' if wanted else 'not '}{self.metric.replace('_', ' ')}"
        return share_above(hits, len(runs), self.low or 0.0, text)


def _follows(claim: Claim, r: Results) -> Evidence:
    """Evidence for 'the printed lengths follow a reading': their correlation is above `low`.

    P-values and interval are those of Fisher's z.
    """
    (reading,), minimum = claim.rows, claim.low or 0.0
    found = fit_reading(r, reading)
    error, place = 1.0 / np.sqrt(len(found.printed) - 3.0), np.arctanh(found.correlation)
    z = (place - np.arctanh(minimum)) / error
    p_for, p_against = float(stats.norm.sf(z)), float(stats.norm.cdf(z))
    low, high = np.tanh([place - 1.96 * error, place + 1.96 * error]).tolist()
    text = f"{len(found.printed)} printed lengths and those predicted"
    test = f"Pearson's r above {minimum:g}"
    return Evidence(p_for, p_against, found.correlation, low, high, "", test, text)


def _fits_better(claim: Claim, r: Results) -> Evidence:
    """Evidence for 'one reading's residuals are smaller than another's', row by row."""
    ((a, b),) = claim.pairs
    text = f"residual of {a} against {b}"
    return paired_below(residuals(r, a), residuals(r, b), 0.05, text, 1.0)


def _implied(claim: Claim, r: Results) -> Evidence:
    """Evidence for 'the printed length of RRT* is that which the tables imply', within bounds."""
    (reading,) = claim.rows
    printed, length = PRINTED_RRT_STAR, fit_reading(r, reading).length
    margin = claim.high or 0.0
    shortest, longest = printed * (1.0 - margin), printed * (1.0 + margin)  # m
    p_for = max(length.p_above(shortest), length.p_below(longest))
    p_against = min(1.0, 2.0 * min(length.p_below(shortest), length.p_above(longest)))
    effect, low, high = (100.0 * (v / printed - 1.0) for v in (length.value, *length.interval))
    test = f"two one-sided t of the fit, within {100 * margin:g} %"
    return Evidence(p_for, p_against, effect, low, high, "%", test, "implied against printed")


_AGREEMENT: Final = {"follows": _follows, "fits_better": _fits_better, "implied": _implied}


def _named(study: Study, names: Sequence[str]) -> list[Row]:
    """The rows with a label, group or series among the names; without names, all."""
    return [r for r in study.rows if not names or {r.label, r.group, r.series} & {*names}]


def _trend(r: Results, rows: Sequence[Row], metric: Metric) -> list[Sample]:
    """The values of each row.

    For shares, each row is one stratum, with one success and one failure more (Agresti and Caffo
    2000), so that no row is without chance.
    """
    if metric.unit == "share":
        return [{"": np.append(r.pooled(row.label, metric), [0.0, 1.0])} for row in rows]
    return [r.sample(row.label, metric, r.study.paired) for row in rows]

"""Claims of the sources, and how each is tested on the runs of a study.

One claim is that the thesis agrees with itself. Each row of its tuning tables of the global
variant has a printed mean length. A reading of the algorithm predicts how long that row's paths are
relative to those of RRT*. One number is free: the mean length of RRT*'s own paths on the thesis's
maps, which table 3.1 prints, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from scipy import stats

from agents.evaluation.statistics import Estimate, Sample
from agents.studies import evidence
from agents.studies.evidence import Evidence
from agents.studies.model import RATIO, Metric, Results, Row, Study
from wheelchair_gym.base.arrays import Array

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
_COMPARISONS: Final[dict[str, _Test]] = {"below": evidence.below, "above": evidence.above}
_PAIRED: Final = {"paired_below": 1.0, "paired_above": -1.0}
_TRENDS: Final[dict[str, _Test]] = {
    "rises": evidence.rises, "falls": evidence.falls, "level": evidence.level,
}  # fmt: skip


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
            margin = evidence.SPREAD_MARGIN
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
            found = evidence.all_of(parts, f"{metric.name} in {len(parts)} comparisons")
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
            return evidence.paired_below(first[both], second[both], margin, text, sign)
        if self.test == "spread_below":
            return evidence.spread_below(r.sample(a, metric), r.sample(b, metric), margin, text)
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
            return evidence.between(ours, theirs, low, high, text, paired)
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
        return evidence.share_above(hits, len(runs), self.low or 0.0, text)


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
    return evidence.paired_below(residuals(r, a), residuals(r, b), 0.05, text, 1.0)


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

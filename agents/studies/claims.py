"""Claims of the sources, and how each is tested on the runs of a study."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from agents.evaluation.statistics import Sample
from agents.studies import agreement, evidence
from agents.studies.evidence import Evidence

if TYPE_CHECKING:
    from agents.studies.model import Metric, Results, Row, Study

_COMPARISONS: Final = {"below": evidence.below, "above": evidence.above}
_PAIRED: Final = {"paired_below": 1.0, "paired_above": -1.0}
_TRENDS: Final = {"rises": evidence.rises, "falls": evidence.falls, "level": evidence.level}


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
            least = replace(self, test="between", ceiling="")._compare(
                r, self.ceiling, self.pairs[0][1], metric, margin
            )
            text = f"{found.text}; no path can be more than {-least.effect:.1f} % shorter"
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
    """Evidence for 'the printed lengths follow a reading': their correlation is above `low`."""
    (reading,), least = claim.rows, claim.low or 0.0
    found = agreement.fit_reading(r, reading)
    p_for, p_against = agreement.correlation_p(found, least)
    half = 1.96 / np.sqrt(len(found.printed) - 3.0)
    low, high = np.tanh(np.arctanh(found.correlation) + np.array([-half, half]))
    text = f"{len(found.printed)} printed lengths and those predicted"
    return Evidence(
        p_for, p_against, found.correlation, float(low), float(high), "",
        f"Pearson's r above {least:g}", text,
    )  # fmt: skip


def _fits_better(claim: Claim, r: Results) -> Evidence:
    """Evidence for 'one reading's residuals are smaller than another's', row by row."""
    ((a, b),) = claim.pairs
    text = f"residual of {a} against {b}"
    return evidence.paired_below(
        agreement.residuals(r, a), agreement.residuals(r, b), 0.05, text, 1.0
    )


def _implied(claim: Claim, r: Results) -> Evidence:
    """Evidence for 'the printed length of RRT* is that which the tables imply', within bounds."""
    (reading,) = claim.rows
    printed, length = agreement.PRINTED_RRT_STAR, agreement.fit_reading(r, reading).length
    margin = claim.high or 0.0
    p_for, p_against = agreement.p_within(
        length, printed * (1.0 - margin), printed * (1.0 + margin)
    )
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

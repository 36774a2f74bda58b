"""Does the thesis agree with itself? Its printed lengths against those that a reading predicts.

Each row of its tuning tables of the global variant has a printed mean length. A reading of the
algorithm predicts how long that row's paths are relative to those of RRT*. One number is free: the
mean length of RRT*'s own paths on the thesis's maps, which table 3.1 prints, too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from scipy import stats

from agents.evaluation.statistics import Estimate
from agents.studies.model import RATIO, Results
from wheelchair_gym.arrays import Array

PRINTED_RRT_STAR: Final = 35.268  # m: mean length of RRT*, table 3.1
_DRAWS: Final = 2000  # of the bootstrap over the rows of the tables


class Fit(NamedTuple):
    """How well a reading predicts the printed lengths."""

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


def _bootstrap(columns: Array, figure: Callable[[Fit], float]) -> tuple[float, float]:
    """The 95 % interval of a figure of the fit, by drawing rows with replacement; one seed."""
    rng = np.random.default_rng(0)
    drawn = [
        figure(fit(*columns[rng.integers(len(columns), size=len(columns))].T))
        for _ in range(_DRAWS)
    ]
    low, high = np.percentile(drawn, [2.5, 97.5])
    return float(low), float(high)


FIGURES_OF_FIT: Final[Mapping[str, Callable[[Fit], float]]] = {
    "correlation": lambda found: found.correlation,
    "r2": lambda found: found.r2,
    "rms": lambda found: found.rms,
    "length": lambda found: found.length.value,
}
WITHOUT: Final = "t1-3.7"  # the table of mu, after which its exchange was chosen


def agreement(r: Results) -> list[dict[str, Any]]:
    """A row for each reading: the figures of its fit with intervals, and of parts held out."""
    readings = list(dict.fromkeys(row.series for row in r.study.rows))
    maps = list(next(iter(r.study.rows)).jobs)
    parts = {"odd": maps[::2], "even": maps[1::2]}
    found = []
    for reading in readings:
        columns = ratios_of(r, reading)
        whole = fit(*columns.T)
        row: dict[str, Any] = {"reading": reading, "rows": len(columns)}
        for key, figure in FIGURES_OF_FIT.items():
            row[key] = figure(whole)
            row[f"{key}_low"], row[f"{key}_high"] = _bootstrap(columns, figure)
        for part, strata in parts.items():
            row[part] = fit_reading(r, reading, strata).correlation
        row["without"] = fit_reading(r, reading, without=WITHOUT).correlation
        found.append(row)
    return found


def residuals(r: Results, reading: str) -> Array:
    """Absolute differences (n,) [m] of the printed lengths from the fit of a reading."""
    found = fit_reading(r, reading)
    return np.abs(found.printed - found.predicted)


def p_within(length: Estimate, low: float, high: float) -> tuple[float, float]:
    """P-values of 'the true length lies between', and of 'outside' [m]."""
    inside = max(length.p_above(low), length.p_below(high))
    return inside, min(1.0, 2.0 * min(length.p_below(low), length.p_above(high)))


def correlation_p(found: Fit, least: float) -> tuple[float, float]:
    """P-values of 'the correlation is above', and of 'below' (Fisher's z)."""
    z = (np.arctanh(found.correlation) - np.arctanh(least)) * np.sqrt(len(found.printed) - 3.0)
    return float(stats.norm.sf(z)), float(stats.norm.cdf(z))

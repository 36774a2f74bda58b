"""P1, the paper on smoothing an RRT's path by modified whales: five optimisers, one start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np

from agents.studies.evidence import Evidence, all_of, paired_below
from agents.studies.figures import box_figures
from agents.studies.model import Array, Claim, Metric, Results, Row, Study
from wheelchair_gym.scenes.published import DESIGN_LAB_INFLATION

RIVALS: Final = {  # the paper's ranking, best first
    "WOA (modified)": "woa_modified",
    "WOA": "woa",
    "PSO": "pso",
    "ABC": "abc",
    "FA": "firefly",
}
SECONDS: Final = Metric("time_s", "optimisation time", "s", 5, only_solved=False)
SMOOTHNESS: Final = Metric("smoothness", "mean turning angle", "rad", 4, only_solved=False)
GAIN: Final = Metric("improvement", "improvement", "%", 1, only_solved=False)
PRINTED: Final = Metric("printed_turning", "f1 as printed", "", 4, only_solved=False)
COST: Final = Metric("cost", "cost f", "m", 3, only_solved=False)
NEGLIGIBLE: Final = 0.01  # of the rival's median


def _rows() -> tuple[Row, ...]:
    return tuple(
        Row(
            label,
            {
                f"path {k}": {
                    "kind": "smoothing",
                    "optimizer": optimizer,
                    "scene": {"name": "design_lab", "path": k},
                    "clearance": DESIGN_LAB_INFLATION,
                }
                for k in (1, 2)
            },
        )
        for label, optimizer in RIVALS.items()
    )


def _values(r: Results, row: str, metric: Metric) -> Array:
    """Values of runs with equal initial populations, in one order; NaN without a path to smooth."""
    records = [record for (label, _), of in r.runs.items() if label == row for record in of]
    return np.array([record.get(metric.key, np.nan) for record in records], dtype=float)


def _less(r: Results, a: str, b: str, metric: Metric, sign: float = 1.0) -> Evidence:
    """The first is below the second (above for sign -1), in pairs of equal initial populations."""
    first, second = (sign * _values(r, row, metric) for row in (a, b))
    both = np.isfinite(first) & np.isfinite(second)
    text = f"{metric.name} of {a} against {b}"
    found = paired_below(first[both], second[both], NEGLIGIBLE, text)
    if sign > 0:
        return found
    return replace(found, effect=-found.effect, low=-found.high, high=-found.low)


def _best(metric: Metric, sign: float = 1.0) -> Callable[[Results], Evidence]:
    others = list(RIVALS)[1:]
    return lambda r: all_of(
        [_less(r, "WOA (modified)", other, metric, sign) for other in others],
        f"{metric.name} of WOA (modified) against each rival",
    )


def _chain(metric: Metric, *order: str, sign: float = 1.0) -> Callable[[Results], Evidence]:
    return lambda r: all_of(
        [_less(r, a, b, metric, sign) for a, b in pairwise(order)],
        f"{metric.name}, " + " before ".join(order),
    )


CLAIMS: Final = (
    Claim("WOA (modified) takes the least time", "P1, figure 9", _best(SECONDS)),
    Claim("Time ranks WOA (modified), WOA, PSO, ABC, FA", "P1, figure 9",
          _chain(SECONDS, *RIVALS)),
    Claim("WOA (modified) gives the smoothest path", "P1, figure 10", _best(SMOOTHNESS)),
    Claim("WOA (modified) gives a smoother path than WOA", "P1, figure 10",
          lambda r: _less(r, "WOA (modified)", "WOA", SMOOTHNESS)),
    Claim("Smoothness ranks PSO, FA, ABC", "P1, figure 10",
          _chain(SMOOTHNESS, "PSO", "FA", "ABC")),
    Claim("WOA (modified) improves smoothness most", "P1, figure 11", _best(GAIN, -1.0)),
    Claim("PSO improves smoothness more than ABC", "P1, figure 11",
          lambda r: _less(r, "PSO", "ABC", GAIN, -1.0)),
    Claim("FA improves smoothness least", "P1, figure 11",
          lambda r: all_of([_less(r, other, "FA", GAIN, -1.0) for other in list(RIVALS)[:-1]],
                           "improvement of each rival against FA")),
    Claim("Of f1 as the paper prints it, WOA (modified) has the least", "P1 (5), figure 10",
          _best(PRINTED)),
    Claim("Cost ranks WOA (modified), WOA, PSO, ABC, FA", "P1, figure 12, as cost f",
          _chain(COST, *RIVALS)),
)  # fmt: skip

STUDIES: Final = (
    Study(
        "p1",
        "Modified whales and four rivals smooth an RRT's path",
        "P1, RRT smoothed by a modified WOA with PCHIP",
        "Cost (8) with exact edges and the mean turning angle as f1; 20 iterations, population 30 "
        "(not given); usual Yarpiz parameters, as table 1 is not in the text; every rival starts "
        "from the same population on each of two paths and each seed, of RRT as of swarm (the "
        "paper: three seeds). Map drawn to the description, inflated by 0.4 m.",
        (SECONDS, SMOOTHNESS, GAIN, PRINTED, COST),
        _rows(),
        CLAIMS,
        lambda r: box_figures(r, list(RIVALS), (SECONDS, SMOOTHNESS, GAIN)),
        paired=True,
        runs=100,
        quick_runs=30,
        notes=(
            "The paper gives medians as box plots and a ranking, no figures: orders compare, "
            "metric by metric, by Wilcoxon's signed ranks of runs with equal initial populations.",
            "(3) as printed is no cosine; f1 with the turning angle is ours, and f1 as printed "
            "stands beside it.",
        ),
    ),
)

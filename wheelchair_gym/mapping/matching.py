"""Scan matching: where a scan lies best on a map's field.

First a correlative search of a window of poses, whose blocks are ranked by what they could score at
most (Olson 2009, Real-time correlative scan matching): the best pose of its lattice, never a local
one. Then Gauss-Newton on the field, interpolated (Kohlbrecher et al. 2011, equations 5 to 14).

Both heed one measurement model: a point where the field is M costs (1 - M)^2 / (2 spread^2); and
both may heed a Gaussian prior about the guess. Kernels work in cells; a symmetric matrix is its six
numbers xx, xy, xt, yy, yt, tt. `search` and `descent` hold them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.config import setting, settings
from wheelchair_gym.kernel import borrowing_kernel
from wheelchair_gym.mapping.descent import misfit, refine
from wheelchair_gym.mapping.occupancy import OccupancyMap
from wheelchair_gym.mapping.scan import Scan, reach_of
from wheelchair_gym.mapping.search import search

Array = NDArray[np.float64]
Floats = NDArray[np.float32]


@settings
class MatchSettings:
    """How scans are laid onto maps."""

    window: float = setting(
        default=0.20, unit="m", source="searched to each side of the guess", low=0.0, high=5.0
    )
    turn: float = setting(
        default=0.12, unit="rad", source="searched to each side of the guess", low=0.0, high=3.2
    )
    step: float = setting(default=0.015, unit="rad", source="a cell at 3.3 m", low=0.001, high=0.5)
    spacing: float = setting(
        default=0.03, unit="m", source="points of a scan nearer to each other tell the same twice",
        low=0.001, high=1.0,
    )  # fmt: skip
    points: int = setting(default=300, source="at most, evenly thinned", low=10, high=20000)
    spread: float = setting(
        default=0.25, low=0.01, high=100.0,
        source="deviation of 1 - M of one point, widened since neighbours err alike",
    )  # fmt: skip
    doubt: float = setting(
        default=0.5, low=0.0, high=1.0,
        source="mean (1 - M)^2 above which a match found by descent alone is searched for",
    )  # fmt: skip
    iterations: int = setting(default=10, source="of Gauss-Newton, at most", low=0, high=1000)


class Match(NamedTuple):
    """Where a scan lies best."""

    pose: Array  # (3,) m, m, rad
    score: float  # mean of the field at the scan's points: 1 where all lie in occupied cells
    covariance: Array  # (3, 3) m2, m rad, rad2


def thin(scan: Scan, spacing: float, most: int) -> Array:
    """Echoes (n, 2) of a sweep, one for each `spacing` [m] of way across its beams, at most `most`.

    How far two echoes are from each other would be no measure: their noise would choose, always
    towards the end of the sweep, and turn the chair.
    """
    points = scan.echoes
    ranges = np.hypot(*(points - scan.origin).T)
    across = np.cumsum(ranges * scan.step)
    kept = points[np.diff(np.floor(across / spacing), prepend=-1.0) > 0.0]
    if len(kept) > most:
        kept = kept[np.linspace(0, len(kept) - 1, most).astype(np.int64)]
    return np.ascontiguousarray(kept)


def match(
    known: OccupancyMap,
    scan: Scan,
    guess: ArrayLike,
    settings: MatchSettings | None = None,
    prior: ArrayLike | None = None,
    layer: int = 0,
) -> Match:
    """Lay a scan onto a map, near a guess (3,) [m, m, rad].

    Args:
        known: the map; it grows where the scan leaves it.
        scan: with some echoes; without any, the guess comes back.
        guess: where to search about.
        settings: how.
        prior: covariance (3, 3) [m2, m rad, rad2] of the guess, or None: no trust in it.
        layer: of the map.
    """
    own = settings or MatchSettings()
    start = np.asarray(guess, dtype=np.float64)
    known.make_room(start, reach_of(scan) + own.window)
    unit = known.settings.resolution
    points = thin(scan, own.spacing, own.points) / unit
    scale = np.array([unit, unit, 1.0])
    told = (0.0,) * 6
    if prior is not None:
        m = np.linalg.inv(np.asarray(prior, dtype=np.float64)) * np.outer(scale, scale)
        told = (m[0, 0], m[0, 1], m[0, 2], m[1, 1], m[1, 2], m[2, 2])
    field = known.field[layer]
    begin, best, end = known.lattice(start), np.empty(3), np.empty(3)
    search(
        field, points, begin, told, own.spread, round(own.window / unit),
        round(own.turn / own.step), own.step, known.wide, best,
    )  # fmt: skip
    _, m6 = refine(field, points, best, begin, told, own.spread, own.iterations, end)
    xx, xy, xt, yy, yt, tt = m6
    sure = np.array([(xx, xy, xt), (xy, yy, yt), (xt, yt, tt)])
    covariance = np.linalg.inv(sure) * np.outer(scale, scale)
    score = _mean_field(field, points, *end) if len(points) else 0.0
    return Match(known.world(end), score, covariance)


@borrowing_kernel
def _mean_field(field: Floats, points: Array, x: float, y: float, yaw: float) -> float:
    total = 0.0
    for k in range(len(points)):
        total += 1.0 - math.sqrt(misfit(field, points[k : k + 1], x, y, yaw))
    return total / len(points)

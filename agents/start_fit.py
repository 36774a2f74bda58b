"""Check of the start that a person gives: how well the first scan fits the map there and elsewhere.

A scan that fits another place as well cannot tell the two apart: rooms may be symmetric or alike.
"""

from __future__ import annotations

import math
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import kernel
from wheelchair_gym.geometry.planar import wrap, wrap_angle
from wheelchair_gym.maps import FREE, OccupancyGrid
from wheelchair_gym.perception.likelihood_field import (
    LikelihoodField,
    hill_climb,
    log_likelihood,
    make_likelihood_field,
)
from wheelchair_gym.perception.monte_carlo import LocalizationSettings
from wheelchair_gym.perception.occupancy import Scan, read_scan
from wheelchair_gym.sensors.settings import LaserSettings

_BEAMS, _FEW = 180, 20  # of a scan, evenly: for the fit, and to preselect poses nearby
_LENIENT = 3.0  # factor of sigma while preselecting: a better pose may lie between two
_CLIMBED = 12  # preselected poses from which hill climbing starts
MIN_FIT = 0.45  # fit of the scan at an accepted start: measured in simulation 0.56 and more at true
# starts, median 0.12 at those far off
BETTER = 0.15  # the start is wrong if a place nearby fits better by this much
ECHOES = 0.05  # least share of beams with an echo; with fewer, the scan does not allow a check
POSITION, HEADING = 0.4, math.radians(12.0)  # m, rad: errors that localization corrects
AROUND, STEP = 2.0, 0.25  # m: how far from the start places are compared, and how far apart
TURN = math.radians(15.0)  # between the headings that are compared
ALIKE = 0.05  # a place anywhere on the map that fits nearly as well makes the start ambiguous
_PLACES = 60_000  # of the whole map: on larger maps they lie farther apart
_APART, _TURNED = 1.0, math.radians(30.0)  # m, rad: at least, between places to climb from


class StartFit(NamedTuple):
    """Fit of a scan to a map at a start."""

    fit: float  # likelihood of a beam at the start, 0 to 1
    pose: Array  # (3,) m, m, rad: the best pose near the start
    better: float  # the best fit elsewhere on the map
    elsewhere: Array  # (3,) m, m, rad: the pose of that fit
    wrong: str  # why the start is refused; empty: it is accepted
    ambiguous: bool = False  # the scan fits as well elsewhere: a person has to confirm the start


def start_fit(
    grid: OccupancyGrid, start: Array, laser: LaserSettings, ranges: NDArray[np.float32]
) -> StartFit:
    """Compare a scan (beams,) [m] with a map at a start (3,) [m, m, rad], and at other places."""
    model = LocalizationSettings()
    scan = read_scan(laser, ranges)
    share = len(scan.echoes) / laser.beams
    if share < ECHOES:
        minimum = f"{ECHOES:.0%} or more"
        wrong = f"{share:.0%} of the laser's beams have an echo; expected {minimum}"
        return StartFit(0.0, start, 0.0, start, wrong)
    field = make_likelihood_field(grid, model.sigma)
    ends = _some(scan, _BEAMS)

    def climbed(pose: Array) -> tuple[float, Array]:
        end = np.array(pose, np.float64)
        return math.exp(hill_climb(field, ends, math.radians(3.0), end)), end

    def near_start(pose: Array) -> bool:
        distance = math.hypot(pose[0] - start[0], pose[1] - start[1])
        return distance <= POSITION and abs(wrap(pose[2] - start[2])) <= HEADING

    fit, pose = climbed(start)
    if not near_start(pose):
        x, y, yaw = start.tolist()
        fit = math.exp(log_likelihood(field, x, y, yaw, ends))
        pose = start
    climbs = map(climbed, _preselected(grid, field, start, _some(scan, _FEW)))
    others = [(other, end) for other, end in climbs if not near_start(end)]
    around = [one for one in others if math.hypot(*(one[1] - start)[:2]) <= AROUND + STEP]
    better, elsewhere = max(around, key=itemgetter(0), default=(0.0, start))
    if better > fit + BETTER:
        x, y, yaw = elsewhere
        wrong = f"it fits {better:.2f} at {x:.2f},{y:.2f},{yaw:.2f}"
        return StartFit(fit, pose, better, elsewhere, wrong)
    better, elsewhere = max(others, key=itemgetter(0), default=(0.0, start))
    wrong = f"expected {MIN_FIT:g} or more" if fit < MIN_FIT else ""
    return StartFit(fit, pose, better, elsewhere, wrong, better > fit - ALIKE)


def _some(scan: Scan, maximum: int) -> Array:
    """Echoes (n, 2) [m] of a scan, evenly chosen."""
    ends = scan.echoes
    chosen = np.linspace(0, len(ends) - 1, min(len(ends), maximum)).astype(int)
    return np.ascontiguousarray(ends[chosen])


@kernel
def _fits(field: LikelihoodField, places: Array, headings: Array, ends: Array, fits: Array) -> None:
    """Write the log-likelihood of a scan at places (n, 2) with headings (m,) into (n, m)."""
    for i in range(places.shape[0]):
        for j in range(headings.shape[0]):
            fits[i, j] = log_likelihood(field, places[i, 0], places[i, 1], headings[j], ends)


def _preselected(
    grid: OccupancyGrid, field: LikelihoodField, start: Array, few: Array
) -> list[Array]:
    """Return the best fitting poses (3,) around a start, and the best of the rest of the map.

    Those of the rest are apart from each other, so that each is another place.
    """
    headings = start[2] + np.arange(0.0, 2.0 * math.pi - 1e-9, TURN)
    lenient = field._replace(sigma=_LENIENT * field.sigma)
    x0, y0, x1, y1 = grid.bounds
    step = max(STEP, math.sqrt((x1 - x0) * (y1 - y0) / _PLACES))
    offsets = np.arange(-AROUND, AROUND + 0.5 * STEP, STEP)
    chosen: list[Array] = []
    for rest, xs, ys in (  # around the start everything is compared
        (False, start[0] + offsets, start[1] + offsets),
        (True, np.arange(x0, x1, step), np.arange(y0, y1, step)),
    ):
        places = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
        places = places[grid.inside(places)]
        places = places[grid.cells[tuple(grid.to_cell(places).T)] == FREE]
        fits = np.empty((len(places), len(headings)))
        _fits(lenient, places, headings, few, fits)
        if rest:
            fits[np.hypot(*(places - start[:2]).T) <= AROUND] = -math.inf
        for _ in range(min(_CLIMBED, fits.size)):
            place, heading = np.unravel_index(np.argmax(fits), fits.shape)
            if fits[place, heading] == -math.inf:
                break
            chosen.append(np.append(places[place], headings[heading]))
            if rest:
                near = np.hypot(*(places - places[place]).T) < _APART
                turned = np.abs(wrap_angle(headings - headings[heading])) < _TURNED
                fits[np.ix_(near, turned)] = -math.inf
            fits[place, heading] = -math.inf
    return chosen

"""Whether the start that a person gives is right: how well the first scan fits the map there."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.geometry import wrap
from wheelchair_gym.localization.likelihood_field import (
    LikelihoodField,
    hill_climb,
    log_likelihood,
    make_likelihood_field,
)
from wheelchair_gym.localization.monte_carlo import LocalizationSettings
from wheelchair_gym.localization.occupancy import Scan, read_scan
from wheelchair_gym.maps import OCCUPIED, OccupancyGrid
from wheelchair_gym.sensors.settings import LaserSettings

Array = NDArray[np.float64]

_BEAMS, _FEW = 180, 20  # of a scan, evenly: for the fit, and to preselect poses nearby
_LENIENT = 3.0  # factor of sigma while preselecting: a better pose may lie between two
_CLIMBED = 12  # preselected poses from which hill climbing starts
LEAST = 0.45  # fit of the scan at an accepted start: measured in simulation 0.56 and more at true
# starts, median 0.12 at those far off
BETTER = 0.15  # the start is wrong if a place nearby fits better by this much
ECHOES = 0.05  # least share of beams with an echo; with fewer, the scan does not allow a check
POSITION, HEADING = 0.4, math.radians(12.0)  # m, rad: errors that localization corrects
AROUND, STEP = 2.0, 0.25  # m: how far from the start places are compared, and how far apart
TURN = math.radians(15.0)  # between the headings that are compared


class StartFit(NamedTuple):
    """How well a scan fits a map at a start."""

    echoes: float  # share of beams with an echo
    fit: float  # likelihood of a beam at the start, 0 to 1
    pose: Array  # (3,) m, m, rad: the best pose near the start
    better: float  # the best fit elsewhere around it
    elsewhere: Array  # (3,) m, m, rad: the pose of that fit
    wrong: str  # why the start is refused; empty: it is accepted


def start_fit(
    grid: OccupancyGrid, start: Array, laser: LaserSettings, ranges: NDArray[np.float32]
) -> StartFit:
    """How well a scan (beams,) [m] fits a map at a start (3,) [m, m, rad], and around it."""
    model = LocalizationSettings()
    scan = read_scan(laser, ranges)
    share = len(scan.echoes) / laser.beams
    if share < ECHOES:
        least = f"{ECHOES:.0%} or more"
        wrong = f"{share:.0%} of the laser's beams have an echo; expected {least}"
        return StartFit(share, 0.0, start, 0.0, start, wrong)
    field = make_likelihood_field(grid, model.sigma, model.outlier_share)
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
    better, elsewhere = 0.0, start
    for place in _preselected(grid, field, start, _some(scan, _FEW)):
        other, end = climbed(place)
        if other > better and not near_start(end):
            better, elsewhere = other, end
    wrong = ""
    if better > fit + BETTER:
        x, y, yaw = elsewhere
        wrong = f"it fits {better:.2f} at {x:.2f},{y:.2f},{yaw:.2f}"
    elif fit < LEAST:
        wrong = f"expected {LEAST:g} or more"
    return StartFit(share, fit, pose, better, elsewhere, wrong)


def _some(scan: Scan, most: int) -> Array:
    """Echoes (n, 2) [m] of a scan, evenly chosen."""
    ends = scan.echoes
    chosen = np.linspace(0, len(ends) - 1, min(len(ends), most)).astype(int)
    return np.ascontiguousarray(ends[chosen])


def _preselected(
    grid: OccupancyGrid, field: LikelihoodField, start: Array, few: Array
) -> list[Array]:
    """The best fitting of the poses (3,) on a lattice around a start that are in free space."""
    offsets = np.arange(-AROUND, AROUND + 0.5 * STEP, STEP)
    across, along = np.meshgrid(start[0] + offsets, start[1] + offsets)
    places = np.column_stack([across.ravel(), along.ravel()])
    cells = grid.to_cell(places)
    inside = ((cells >= 0) & (cells < grid.shape)).all(axis=1)
    free = np.zeros(len(cells), np.bool_)
    free[inside] = grid.cells[tuple(cells[inside].T)] != OCCUPIED
    headings = start[2] + np.arange(0.0, 2.0 * math.pi - 1e-9, TURN)
    places = places[free]
    poses = np.column_stack([places.repeat(len(headings), axis=0), np.tile(headings, len(places))])
    lenient = field._replace(sigma=_LENIENT * field.sigma)
    fits = [log_likelihood(lenient, x, y, yaw, few) for x, y, yaw in poses.tolist()]
    return [poses[k] for k in np.argsort(fits)[::-1][:_CLIMBED]]

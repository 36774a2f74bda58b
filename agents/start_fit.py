"""Whether a chair stands where a person says: how well its first scan fits the map there."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.config import setting, settings
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

_BEAMS, _FEW = 180, 20  # of a scan, evenly: for the fit, and for a first look at places nearby
_LENIENT = 3.0  # a first look is, as between its places there may be a better one
_CLIMBED = 12  # of the places looked at first


@settings
class StartCheck:
    """When a start that a person gives is believed."""

    least: float = setting(
        default=0.45,
        low=0.0,
        high=1.0,
        source="measured in simulation: 0.56 and more at true starts, median 0.12 at those far off",
    )
    """Least fit of the scan, from 0 to 1, at which a start is believed."""
    better: float = setting(default=0.15, low=0.0, high=1.0, source="design choice")
    """The start is wrong if a place nearby fits better by this much."""
    echoes: float = setting(default=0.05, low=0.0, high=1.0, source="design choice")
    """Least share of beams with an echo; with fewer, the scan says nothing."""
    position: float = setting(default=0.4, unit="m", low=0.0, source="design choice")
    """Error of the start's position that localization corrects."""
    heading: float = setting(
        default=math.radians(12.0), unit="rad", low=0.0, high=math.pi, source="design choice"
    )
    """Error of the start's heading that localization corrects."""
    around: float = setting(default=2.0, unit="m", low=0.0, source="design choice")
    """Distance from the start within which a better place is looked for."""
    step: float = setting(default=0.25, unit="m", low=0.05, source="design choice")
    """Distance between the places that are compared."""
    turn: float = setting(default=math.radians(15.0), unit="rad", low=0.05, source="design choice")
    """Angle between the headings that are compared."""


class StartFit(NamedTuple):
    """How well a scan fits a map at a start."""

    echoes: float  # share of beams that met something
    fit: float  # likelihood of a beam at the start, 0 to 1
    pose: Array  # (3,) m, m, rad: the best pose near the start
    better: float  # the best fit elsewhere around it
    elsewhere: Array  # (3,) m, m, rad: there
    wrong: str  # why the start is not believed; empty: it is


def start_fit(
    grid: OccupancyGrid,
    start: Array,
    laser: LaserSettings,
    ranges: NDArray[np.float32],
    own: StartCheck | None = None,
) -> StartFit:
    """How well a scan (beams,) [m] fits a map at a start (3,) [m, m, rad], and around it."""
    own, model = own or StartCheck(), LocalizationSettings()
    scan = read_scan(laser, ranges, 0.0)
    share = len(scan.echoes) / laser.beams
    if share < own.echoes:
        wrong = f"{share:.0%} of the laser's beams have an echo; expected {own.echoes:.0%} or more"
        return StartFit(share, 0.0, start, 0.0, start, wrong)
    field = make_likelihood_field(grid, model.sigma, model.outlier_share)
    ends = _some(scan, _BEAMS)

    def climbed(pose: Array) -> tuple[float, Array]:
        end = np.array(pose, np.float64)
        return math.exp(hill_climb(field, ends, math.radians(3.0), end)), end

    fit, pose = climbed(start)
    if not _near(pose, start, own):
        x, y, yaw = start.tolist()
        fit = math.exp(log_likelihood(field, x, y, yaw, ends))
        pose = start
    better, elsewhere = 0.0, start
    for place in _places(grid, field, start, _some(scan, _FEW), own):
        worth, end = climbed(place)
        if worth > better and not _near(end, start, own):
            better, elsewhere = worth, end
    wrong = ""
    if better > fit + own.better:
        x, y, yaw = elsewhere
        wrong = f"it fits {better:.2f} at {x:.2f},{y:.2f},{yaw:.2f}"
    elif fit < own.least:
        wrong = f"expected {own.least:g} or more"
    return StartFit(share, fit, pose, better, elsewhere, wrong)


def _some(scan: Scan, most: int) -> Array:
    """Echoes (n, 2) [m] of a scan, evenly chosen."""
    ends = scan.echoes
    chosen = np.linspace(0, len(ends) - 1, min(len(ends), most)).astype(int)
    return np.ascontiguousarray(ends[chosen])


def _near(pose: Array, start: Array, own: StartCheck) -> bool:
    far = math.hypot(pose[0] - start[0], pose[1] - start[1])
    return far <= own.position and abs(wrap(pose[2] - start[2])) <= own.heading


def _places(
    grid: OccupancyGrid,
    field: LikelihoodField,
    start: Array,
    few: Array,
    own: StartCheck,
) -> list[Array]:
    """The most promising of the poses (3,) around a start that are not in something solid."""
    offsets = np.arange(-own.around, own.around + 0.5 * own.step, own.step)
    across, along = np.meshgrid(start[0] + offsets, start[1] + offsets)
    places = np.column_stack([across.ravel(), along.ravel()])
    cells = grid.to_cell(places)
    inside = ((cells >= 0) & (cells < grid.shape)).all(axis=1)
    free = np.zeros(len(cells), np.bool_)
    free[inside] = grid.cells[tuple(cells[inside].T)] != OCCUPIED
    headings = start[2] + np.arange(0.0, 2.0 * math.pi - 1e-9, own.turn)
    places = places[free]
    poses = np.column_stack([places.repeat(len(headings), axis=0), np.tile(headings, len(places))])
    lenient = field._replace(sigma=_LENIENT * field.sigma)
    worth = [log_likelihood(lenient, x, y, yaw, few) for x, y, yaw in poses.tolist()]
    return [poses[k] for k in np.argsort(worth)[::-1][:_CLIMBED]]

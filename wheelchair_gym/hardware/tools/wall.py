"""A flat wall ahead of a chair at rest, by its laser."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.hardware.boards.senses import BoardSensors
from wheelchair_gym.perception.occupancy import read_scan

_FAN = math.radians(12.0)  # to each side of ahead
_FLAT = 0.02  # m: root mean square distance of echoes from a wall; the laser's noise is 15 mm
_SHARE = 0.7  # least share of echoes on the wall
_TURNED = math.radians(25.0)  # greatest angle between heading and wall normal


class Wall(NamedTuple):
    """A wall ahead, in the chair's frame."""

    distance: float  # m, of the axle's centre from it
    bearing: float  # rad, of its foot


def fit_wall(echoes: Array) -> Wall:
    """The wall that echoes (n, 2) [m] ahead lie on.

    Raises:
        ValueError: they do not lie on one.
    """
    if len(echoes) < 20:
        raise ValueError("the laser sees no wall ahead: face a flat one")
    x, y = echoes.T
    near = np.abs(x - np.median(x)) < 1.0
    for _ in range(8):
        slope, start = np.polyfit(y[near], x[near], 1)
        off = np.abs(x - start - slope * y) / math.hypot(1.0, slope)
        near = off < max(3.0 * _FLAT, 2.0 * float(np.median(off)))
        near = near & (off < 3.0 * _FLAT) if (off < 3.0 * _FLAT).sum() >= 20 else near
    rms = float(np.sqrt(np.mean(off[near] ** 2)))
    if near.mean() < _SHARE or rms > _FLAT:
        raise ValueError("the laser finds no flat wall ahead: face one")
    bearing = -math.atan(slope)
    if abs(bearing) > _TURNED:
        raise ValueError(
            f"the wall ahead is turned by {math.degrees(bearing):.0f} deg; expected to face it "
            f"within {math.degrees(_TURNED):.0f} deg"
        )
    return Wall(float(start) * math.cos(bearing), bearing)


def echoes_ahead(senses: BoardSensors, ranges: NDArray[np.float32]) -> Array:
    """Echoes (n, 2) within a fan ahead, in the chair's frame."""
    laser = senses.sensors.laser
    echoes = read_scan(laser, ranges[: laser.beams]).echoes
    aside = np.arctan2(echoes[:, 1] - laser.y, echoes[:, 0] - laser.x)
    ahead: Array = echoes[np.abs(aside) <= _FAN]
    return ahead

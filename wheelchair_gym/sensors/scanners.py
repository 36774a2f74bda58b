"""A chair's planar scanners as rows of one record, in the order in which a reading holds them."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelchair_gym.compiled.address import (
    Pointers,
    Target,
    doubles_at,
    floats_at,
    pointer_record,
    rows_of,
    words_at,
)
from wheelchair_gym.compiled.kernel import inlined
from wheelchair_gym.sensors.laser import LaserArrays
from wheelchair_gym.sensors.settings import SensorSettings

_ARRAYS = ("cosine", "sine", "salt", "mount")
_VALUES = ("first", "per_angle", "reach", "nearest", "sigma", "no_echo", "bias")
_NUMBERS = ("number", "start", "shows_free")

SCANNER, _TARGETS = pointer_record(
    ("beams", "i8"),
    ("cosine", Target("f4", None)),
    ("sine", Target("f4", None)),
    ("salt", Target("u4", None)),
    ("mount", Target("f8", 3)),
    *((name, "f8") for name in _VALUES),
    *((name, "i8") for name in _NUMBERS),
)
scanners_at = rows_of(SCANNER)


def scanner_pointers(sensors: SensorSettings, noise: bool) -> Pointers:
    """The scanners of a chair, a record (n,) of SCANNER; without noise all errors are zero."""
    lasers = sensors.lasers
    pointers = Pointers(np.zeros(len(lasers), SCANNER), _TARGETS, constant=True)
    for k, (laser, at) in enumerate(zip(lasers, sensors.slices, strict=True)):
        arrays, row = LaserArrays.of(laser, noise, k, at.start), pointers.record[k]
        row["beams"] = laser.beams
        for name in _ARRAYS:
            pointers.point(name, getattr(arrays, name), k)
        for name in (*_VALUES, *_NUMBERS):
            row[name] = getattr(arrays, name)
    return pointers


@inlined
def scanner_at(address: Any, count: int, k: int) -> LaserArrays:
    """Scanner k of `count` whose records lie at an address."""
    one = scanners_at(address, count)[k]
    return laser_arrays(one, doubles_at(one.mount, 3), one.sigma, one.no_echo, one.bias)


@inlined
def laser_arrays(one: Any, mount: Any, sigma: float, no_echo: float, bias: float) -> LaserArrays:
    """Return the arrays of a record of SCANNER with another mount and other errors."""
    return LaserArrays(
        floats_at(one.cosine, one.beams),
        floats_at(one.sine, one.beams),
        words_at(one.salt, one.beams),
        one.first,
        one.per_angle,
        mount,
        one.reach,
        one.nearest,
        sigma,
        no_echo,
        bias,
        one.number,
        one.start,
        one.shows_free,
    )

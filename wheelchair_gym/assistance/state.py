"""Records of compiled assistants: CONSTANTS of one, and ASSISTANT, what each row remembers."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelchair_gym.assistance.freedom import Freedom
from wheelchair_gym.compiled.address import Pointers, Target, pointer_record, rows_of
from wheelchair_gym.compiled.kernel import inlined
from wheelchair_gym.config import copy_numbers, numbers_of
from wheelchair_gym.physics.settings import ChairSettings
from wheelchair_gym.sensors.settings import SensorSettings

GROUPS = 128  # of beams: of each, the nearest is an obstacle
SECTORS = 64  # around the outline's middle: of each, the nearest out of sight is remembered
MOST = GROUPS + SECTORS  # obstacles

ASSISTANT = np.dtype(
    [
        ("stamp", "f8"),  # s: of the latest reading; NaN: there was none yet
        ("steady", "f8"),  # s for which the stick has been low and steady
        ("held", "f8", (2,)),  # the stick from which it is
        ("asked", "f8", (2,)),  # m/s, rad/s: the stick's twist
        ("turn", "f8"),  # rad/s: by how much the turn rate may differ
        ("margin", "f8"),  # m: that is kept
        ("twist", "f8", (2,)),  # m/s, rad/s: what the method makes of it
        ("n_points", "i8"),
        ("points", "f8", (MOST, 2)),  # m: obstacles in the chair's frame, those seen first
        ("n_seen", "i8"),  # of them
        ("until", "f8", (SECTORS,)),  # s: stamp until which each of the others is remembered
    ],
    align=True,
)


def constants_record(*methods: type) -> tuple[np.dtype[Any], dict[str, Target]]:
    """The dtype of the constants of assistants with settings of these classes, and its targets."""
    return pointer_record(
        ("kind", "i8"),  # of the method
        ("method", numbers_of(*methods)),  # zero: the method has no such number
        ("freedom", numbers_of(Freedom)),
        ("period", "f8"),  # s: of control
        ("forward", "f8"),  # m/s
        ("backward", "f8"),
        ("turn", "f8"),  # rad/s
        ("deceleration", "f8"),  # m/s2
        ("outline", "f8", (3,)),  # `Footprint.array`
        ("middle", "f8"),  # m: of the outline, ahead of the axle
        ("mount", "f8", (4,)),  # m, m: of the first scanner; cosine and sine of its yaw
        ("view_cosine", "f8"),  # cosine of half its field of view
        ("beams", "i8"),
        ("directions", Target("f8", None, 2)),  # of its beams in the chair's frame
    )


def constants_of(
    record: tuple[np.dtype[Any], dict[str, Target]], kind: int, method: Any, freedom: Freedom,
    chair: ChairSettings, sensors: SensorSettings, period: float,
) -> Pointers:  # fmt: skip
    """The constants (1,) of an assistant of a chair, with its control period [s]."""
    dtype, targets = record
    pointers = Pointers(np.zeros(1, dtype), targets, constant=True)
    p: Any = pointers.record[0]
    p["kind"], p["period"] = kind, period
    copy_numbers(p["method"], method)
    copy_numbers(p["freedom"], freedom)
    for name in ("forward", "backward", "turn", "deceleration"):
        p[name] = getattr(chair.limits, name)
    outline, laser = chair.footprint, sensors.laser
    p["outline"], p["middle"] = outline.array, 0.5 * (outline.front - outline.rear)
    p["mount"] = laser.x, laser.y, np.cos(laser.yaw), np.sin(laser.yaw)
    p["view_cosine"], p["beams"] = np.cos(0.5 * laser.fov), laser.beams
    pointers.point("directions", laser.directions)
    return pointers


assistant_rows = rows_of(ASSISTANT)


@inlined
def assistant_at(rows: Any, i: int) -> Any:
    """The record of row i of a record of ASSISTANTS."""
    return assistant_rows(rows.assistants, rows.n)[i]

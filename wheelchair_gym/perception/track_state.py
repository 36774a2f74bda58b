"""The tracker's records: CONSTANTS of the laser, STATIC_MAP, and TRACKER, its state.

All coordinates are in the frame of dead reckoning, in which near things keep their place whatever a
localization corrects. The state has a fixed size, so that a row of a batch can hold it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from wheelchair_gym.base.settings import InputError
from wheelchair_gym.compiled.address import Pointers, pointer_record
from wheelchair_gym.compiled.address import Target as To
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.sensors.laser import LaserArrays
from wheelchair_gym.sensors.settings import LaserSettings

TRACKS = 48  # at once; then a nearer thing takes the place of the farthest unconfirmed one
CLUSTERS = 96  # of a scan; those farther on counter-clockwise are left out
SECTORS = 512  # of a remembered scan at most
FRAMES = 8  # remembered scans
KINDS: Final = ("unknown", "person", "door", "furniture")
UNKNOWN, PERSON, DOOR, FURNITURE = range(4)

# Spectral density of the random acceleration of what is tracked [m2/s3]: 2 m/s2, kept for 0.25 s;
# people start with 1.4 +- 0.9 m/s2 (Fugger et al. 2000).
ACCELERATION_DENSITY = 1.0
PERSON_WIDTH = 0.9  # m: widest track that can be a person, with shoulders and swinging arms

_F8 = "f8"
CONSTANTS, _LASER = pointer_record(
    ("beams", "i8"),
    ("group", "i8"),  # beams per sector
    ("sectors", "i8"),
    ("cosine", To("f4", None)),  # of each beam's direction (beams,)
    ("sine", To("f4", None)),
    ("first", _F8),  # rad: of beam 0
    ("per_angle", _F8),  # beams per rad
    ("nearest", _F8),  # m
    ("reach", _F8),  # m
    ("mount", _F8, (3,)),  # pose of the laser
)

STATIC_MAP, _FIELD = pointer_record(
    ("gap", To("f4", None, None)),  # m: from each cell's centre to the nearest occupied one
    ("rows", "i8"),  # 0: there is no map
    ("cols", "i8"),
    ("per_metre", _F8),  # cells
    ("origin", _F8, (3,)),  # m, m, rad
)

# A scan where it was taken: the laser's place, cosine and sine of its yaw, and the nearest range of
# each sector [m].
FRAME = np.dtype(
    [*((name, _F8) for name in ("stamp", "x", "y", "c", "s")), ("range", "f4", (SECTORS,))]
)

TRACK = np.dtype(
    [
        ("id", "i8"),
        *((name, _F8) for name in ("x", "y", "vx", "vy")),  # m, m/s
        # Variances of place and speed and their covariance: the same along each axis.
        *((name, _F8) for name in ("place_var", "covariance", "speed_var")),
        ("radius", _F8),  # m
        ("width", _F8),  # m: of its cluster
        ("born", _F8),  # stamps [s]: when it was first seen,
        ("seen", _F8),  # was last seen
        ("moved", _F8),  # and last moved; -inf: never
        ("moving_for", _F8),  # s
        ("passed_for", _F8),  # s for which the laser has seen through its place
        *((name, _F8) for name in ("first_x", "first_y", "rest_x", "rest_y")),  # m
        ("travelled", _F8),  # m: greatest distance from where it was first seen
        ("ends", _F8, (4,)),  # m: of a straight thing as it was first seen
        ("straight", _F8),  # share of the last readings in which it was straight
        ("attached", _F8),  # and in which it hung on something static
        ("confirmed", "b1"),
        ("swings", "b1"),  # one of its ends has stayed while the other turned about it
        ("hidden", "b1"),  # something nearer hides it, or the laser does not look there
        ("kind", "i8"),  # index into KINDS
    ],
    align=True,
)

TRACKER = np.dtype(
    [
        ("begun", "b1"),
        ("stamp", _F8),  # s
        ("pose", _F8, (3,)),  # dead-reckoned since reset
        ("twist", _F8, (2,)),  # m/s, rad/s: the last one known
        ("map_pose", _F8, (3,)),  # by the chair's own estimate
        ("next_id", "i8"),
        ("n_tracks", "i8"),
        ("tracks", TRACK, (TRACKS,)),
        ("n_frames", "i8"),
        ("newest", "i8"),  # the frame that was remembered last
        ("frames", FRAME, (FRAMES,)),
    ],
    align=True,
)


class TrackerConstants(Pointers):
    """The laser of a tracker, as the record `record` (1,).

    Raises:
        InputError: the laser has no beams.
    """

    def __init__(self, laser: LaserSettings) -> None:
        if not laser.beams:
            raise InputError("a tracker needs a laser; expected beams of sensors.laser")
        arrays = LaserArrays.of(laser, False)
        super().__init__(np.zeros(1, CONSTANTS), _LASER, constant=True)
        g: Any = self.record[0]
        g["beams"], g["group"] = laser.beams, -(-laser.beams // SECTORS)
        g["sectors"] = -(-laser.beams // int(g["group"]))
        self.point("cosine", arrays.cosine)
        self.point("sine", arrays.sine)
        for name in ("first", "per_angle", "nearest", "mount", "reach"):
            g[name] = getattr(arrays, name)


def static_map_pointers(grids: Sequence[OccupancyGrid | None]) -> Pointers:
    """The static surroundings that maps show, a record (n,) of STATIC_MAP; None: no map."""
    pointers = Pointers(np.zeros(len(grids), STATIC_MAP), _FIELD, constant=True)
    for k, grid in enumerate(grids):
        if grid is not None:
            gap, row = grid.distance(), pointers.record[k]
            pointers.point("gap", gap, k)
            row["rows"], row["cols"] = gap.shape
            row["per_metre"], row["origin"] = 1.0 / grid.resolution, grid.origin
    return pointers

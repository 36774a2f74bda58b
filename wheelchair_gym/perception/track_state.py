"""The tracker's records: CONSTANTS of the laser, STATIC_MAP, and TRACKER, its state.

All coordinates are in the frame of dead reckoning, in which near things keep their place whatever a
localization corrects. The state has a fixed size, so that a row of a batch can hold it.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from wheelchair_gym.base.settings import InputError
from wheelchair_gym.compiled.address import Pointers, read_record
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

CONSTANTS, _LASER = read_record("CONSTANTS", globals())
STATIC_MAP, _FIELD = read_record("STATIC_MAP", globals())

FRAME = read_record("FRAME", globals())[0]
TRACK = read_record("TRACK", globals())[0]
TRACKER = read_record("TRACKER", globals())[0]


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
        group = -(-laser.beams // SECTORS)
        names = "cosine", "sine", "first", "per_angle", "nearest", "mount", "reach"
        values = {name: getattr(arrays, name) for name in names}
        self.fill(beams=laser.beams, group=group, sectors=-(-laser.beams // group), **values)


def static_map_pointers(grids: Sequence[OccupancyGrid | None]) -> Pointers:
    """The static surroundings that maps show, a record (n,) of STATIC_MAP; None: no map."""
    pointers = Pointers(np.zeros(len(grids), STATIC_MAP), _FIELD, constant=True)
    for k, grid in enumerate(grids):
        if grid is not None:
            rows, cols = grid.shape
            pointers.fill(
                k, gap=grid.distance(), rows=rows, cols=cols, per_metre=1.0 / grid.resolution,
                origin=grid.origin,
            )  # fmt: skip
    return pointers

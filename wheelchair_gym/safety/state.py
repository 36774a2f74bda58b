"""The shield's records: constants of the chair (GUARD) and the state of the last seconds (SHIELD).

The memory is bounded: points that the laser hit, echoes that only ultrasonics measured, and a grid
that moves with the chair and holds when each cell was last seen. All coordinates are in the frame
of uncorrected dead reckoning, so that near objects keep their place.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.address import Pointers, Target
from wheelchair_gym.config import InputError
from wheelchair_gym.kinematics import LIMITS
from wheelchair_gym.physics.settings import ChairSettings
from wheelchair_gym.safety.settings import ShieldSettings
from wheelchair_gym.safety.stops import SHIELD_FAULTS
from wheelchair_gym.sensors.laser import LaserArrays
from wheelchair_gym.sensors.settings import RANGERS, SensorSettings

Rows = NDArray[np.void]

# Why a twist was changed; those from LASER_SILENT on are faults and latch.
REASONS: Final = ("", "obstacle", "moving", "unseen", *SHIELD_FAULTS)
NOTHING, OBSTACLE, MOVING, UNSEEN, LASER_SILENT, LASER_FROZEN, LASER_BLIND = range(7)
SONAR_SILENT, SONAR_FROZEN, ODOMETRY_SILENT, ODOMETRY_FROZEN, BUMPED = range(7, 12)

CELL = 0.10  # m: of the grid of what was looked at
CELLS = 64  # a side of it: 3.2 m round the chair, as far as whoever moves matters
REACH = 2.6  # m from the axle: what a chair at 0.8 m/s sweeps before it rests, and its outline
FAR = 3.6  # m: points farther off are not taken in
BINS = 36  # of distance, to order points by
FRESH = 512  # points of one scan
KEPT = 512  # and of those before
ARC = 12  # points on the arc of an echo
NEAR = FRESH + KEPT + RANGERS * ARC
MOVERS = 96  # points of what moves
CLOSE = 64  # points inside the stop zone
LONE = 48  # things that one beam hit
RATES: Final = (4.0, 100.0)  # Hz: of control
_SPARE = 1.2  # times what its limits ask for a chair must be able to do, to follow its set point
_ROUND = 1e-6
STANDS = 0.02  # m/s, rad/s: slower is at rest
ECHOES = 64  # beams of the last scan with echoes that are kept, to notice a laser gone blind
SAMPLES = 38  # points of the outline that may enter what nobody has seen

NUMBERS = (  # of the settings, as kernels take them
    "stop_margin", "time_headway", "reaction_time", "creep_speed", "memory_time",
    "static_memory_time", "vacated_time", "unseen_speed", "person_speed", "person_acceleration",
    "moving_memory_time",
)  # fmt: skip

GUARD = np.dtype(
    [
        ("limits", LIMITS),
        ("outline", "f8", (3,)),  # Footprint.array
        ("samples", "f8", (SAMPLES, 4)),  # x, y and outward normal; corners of the rear: 0, 0
        ("period", "f8"),  # s
        ("track", "f8"),  # m
        *((name, "f8") for name in NUMBERS),
        ("stale_laser", "f8"),
        ("stale_ultrasonic", "f8"),
        ("stale_odometry", "f8"),
        ("beams", "i8"),
        ("cosine", "u8"),  # addresses of each beam's direction (beams,)
        ("sine", "u8"),
        ("first", "f8"),  # rad: of beam 0
        ("per_angle", "f8"),  # beams per rad
        ("nearest", "f8"),  # m
        ("reach", "f8"),  # m
        ("mount", "f8", (3,)),  # of the laser
        ("ranger_mount", "f8", (RANGERS, 3)),
        ("ranger_half", "f8", (RANGERS,)),  # rad: half of the cone
        ("ranger_reach", "f8", (RANGERS,)),  # m
    ],
    align=True,
)

SHIELD = np.dtype(
    [
        ("begun", "b1"),  # there was a reading
        ("stamp", "f8"),  # s: of the last one
        ("pose", "f8", (3,)),  # m, m, rad: dead-reckoned since reset
        ("told", "f8", (5,)),  # pose and twist of the last reading, to the bit
        ("set", "f8", (4,)),  # speed, its slope, turn, its slope: what the chair is set to
        ("late", "f8", (2,)),  # speed and turn that it was set to a reaction time ago
        # faults
        ("latched", "i8"),  # reason, 0: none
        ("rearmed", "b1"),  # a person asks to be let go on
        ("laser_hash", "u8"),
        ("sonar_hash", "u8"),
        ("laser_silent", "f8"),  # s without, s that it was the same
        ("laser_frozen", "f8"),
        ("laser_blind", "f8"),  # s without an echo where the scan before had some
        ("laser_denied", "f8"),  # s without an echo while ultrasonics hear something
        ("echo", "f4", (ECHOES,)),  # m: ranges of beams, evenly, of the last scan with echoes
        ("echo_pose", "f8", (3,)),  # m, m, rad: where that was taken
        ("sonar_silent", "f8", (RANGERS,)),
        ("sonar_frozen", "f8"),
        ("odometry_silent", "f8"),
        ("odometry_frozen", "f8"),
        ("astray", "f8"),  # s that the wheels did not what they were told
        # what was looked at
        ("corner", "i8", (2,)),  # cell of the grid's lower left corner
        ("columns", "i8"),  # 0 or 1: which of them were looked at last, even or odd ones
        ("seen", "f4", (CELLS, CELLS)),  # s: by a ray that came so far
        ("clear", "f4", (CELLS, CELLS)),  # s: by one that went well beyond
        ("beam", "i4", (CELLS,)),  # of one column of cells: which sees it, how far it is
        ("range", "f4", (CELLS,)),
        # points: x, y [m], until when they are kept [s]; those that may move: when they last did,
        ("n_points", "i8"),
        ("n_old", "i8"),  # of them are of scans before the last one
        ("points", "f8", (FRESH + KEPT, 3)),
        # what one beam hit: x, y [m], when last [s], in how many scans
        ("n_lone", "i8"),
        ("lone", "f8", (LONE, 4)),
        ("n_marks", "i8"),
        ("marks", "f8", (MOVERS, 4)),  # and were seen
        ("marked", "f8", (MOVERS, 4)),  # before the last scan
        # echoes that no laser explains
        ("fired", "f8", (RANGERS,)),  # s: when each ranger fired
        ("doubtful", "f8", (RANGERS,)),  # m: an echo heard once, or NaN
        ("n_arc", "i8", (RANGERS,)),
        ("arc", "f8", (RANGERS, ARC, 2)),  # m
        # the same in the chair's frame now
        ("n_near", "i8"),
        ("local", "f8", (NEAR, 3)),  # x, y, distance
        ("near", "f8", (NEAR, 3)),  # x, y, and no more than its distance; which rises
        ("n_moving", "i8"),
        ("moving", "f8", (MOVERS, 5)),  # x, y, 0; for how long it stands, and is hidden [s]
        ("hidden", "f8"),  # s: the longest of these
        ("n_close", "i8"),
        ("close", "f8", (CLOSE, 3)),  # x, y, and its signed gap
        ("gap", "f8"),  # m: of the outline
        ("bins", "i8", (BINS + 1,)),
        # what was decided last
        ("reason", "i8"),
        ("asked", "f8", (2,)),
        ("given", "f8", (2,)),
        ("protective", "b1"),
    ],
    align=True,
)


def check(chair: ChairSettings, period: float) -> None:
    """Refuse a chair that cannot brake at its limits, and a control rate outside the tested range.

    Raises:
        InputError: tyres or motors hold less than the limits ask for; the period is out of bounds.
    """
    limits = chair.limits
    rate = 1.0 / period
    if not RATES[0] - _ROUND <= rate <= RATES[1] + _ROUND:
        raise InputError(
            f"rate is {rate:g} Hz; with a shield expected {RATES[0]:g} to {RATES[1]:g} Hz"
        )
    brakes = max(limits.deceleration, limits.protective)
    for what, asked, held in (
        ("brake with", brakes, chair.braking),
        ("brake in a curve with", math.hypot(brakes, limits.forward * limits.turn), chair.grip),
        ("turn with", limits.turn_acceleration, chair.turn_braking),
    ):
        asked *= _SPARE
        if asked > held:
            raise InputError(
                f"chair.limits ask to {what} {asked:.2f}, with a fifth to spare; by its mass, "
                f"friction and motors the chair reaches {held:.2f} (SI units), so no shield holds: "
                "lower the limits, or drive without a shield"
            )


class Guard:
    """Constants of a shield: settings, outline, limits and mounts, as the record `record` (1,).

    A copy in this process is the object itself; another process makes a new one.

    Raises:
        InputError: see `check`.
    """

    def __init__(
        self, own: ShieldSettings, chair: ChairSettings, sensors: SensorSettings, period: float
    ) -> None:
        self._made_of = own, chair, sensors, period
        check(chair, period)
        self.laser = LaserArrays.of(sensors.laser, False)
        targets = dict.fromkeys(("cosine", "sine"), Target("f4", None))
        self.pointers = pointers = Pointers(np.zeros(1, GUARD), targets, constant=True)
        self.record: Rows = pointers.record
        g: Any = self.record[0]
        g["limits"], g["outline"] = chair.limits.array, chair.footprint.array
        g["samples"] = _samples(*chair.footprint.array.tolist())
        g["period"], g["track"] = period, chair.drive.track
        for name in NUMBERS:
            g[name] = getattr(own, name)
        g["reaction_time"] += chair.following_lag
        for name in ("laser", "ultrasonic", "odometry"):
            g[f"stale_{name}"] = getattr(own.stale, name)
        g["beams"] = sensors.laser.beams
        pointers.point("cosine", self.laser.cosine)
        pointers.point("sine", self.laser.sine)
        g["first"], g["per_angle"] = self.laser.first, self.laser.per_angle
        g["nearest"], g["mount"] = sensors.laser.range_min, self.laser.mount
        g["reach"] = sensors.laser.reach
        rangers = sensors.ultrasonic
        for k, one in enumerate(rangers.mounted):
            model = rangers.narrow if one.model == "narrow" else rangers.wide
            g["ranger_mount"][k] = one.x, one.y, one.yaw
            g["ranger_half"][k], g["ranger_reach"][k] = 0.5 * model.field_of_view, model.reach

    def __deepcopy__(self, memo: dict[int, Any]) -> Guard:
        return self

    def __reduce__(self) -> tuple[type[Guard], tuple[Any, ...]]:
        return type(self), self._made_of


def _samples(front: float, rear: float, half: float) -> NDArray[np.float64]:
    """Points of the outline with their normals, about one cell apart."""
    rows = [(-rear, side * half, 0.0, 0.0) for side in (-1, 1)]
    rows += [(front, y, 1.0, 0.0) for y in np.linspace(-half, half, 7)]
    rows += [(-rear, y, -1.0, 0.0) for y in np.linspace(-half, half, 7)]
    rows += [(x, side * half, 0.0, side) for side in (-1, 1) for x in np.linspace(-rear, front, 11)]
    return np.array(rows, np.float64)

"""The shield's records: CONSTANTS of the chair, and SHIELD, the state of the last seconds.

The memory is bounded: points that the laser hit, echoes that only ultrasonics measured, and a grid
that moves with the chair and holds when each cell was last seen. All coordinates are in the frame
of uncorrected dead reckoning, so that near objects keep their place.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np

from wheelchair_gym.base.arrays import Rows
from wheelchair_gym.base.settings import InputError, copy_numbers, numbers_of
from wheelchair_gym.compiled.address import Pointers, Target, read_record
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry.kinematics import LIMITS  # noqa: F401 for the records
from wheelchair_gym.perception.track_state import CONSTANTS as TRACKER_CONSTANTS
from wheelchair_gym.perception.track_state import TRACKER, TRACKS, TrackerConstants  # noqa: F401
from wheelchair_gym.safety.settings import ShieldSettings
from wheelchair_gym.safety.stops import SHIELD_FAULTS
from wheelchair_gym.sensors.laser import SCANNER, scanner_pointers
from wheelchair_gym.sensors.settings import RANGERS, SCANNERS, SensorSettings
from wheelchair_gym.sensors.ultrasonic import LOSS
from wheelchair_gym.sim.randomization import RandomizedName
from wheelchair_gym.sim.settings import ChairSettings

# Why a twist was changed; those from LASER_SILENT on are faults and latch.
REASONS: Final = ("", "obstacle", "moving", "unseen", *SHIELD_FAULTS)
NOTHING, OBSTACLE, MOVING, UNSEEN = range(4)
LASER_SILENT, LASER_FROZEN, LASER_BLIND, LASER_DISAGREES = range(4, 8)
SONAR_SILENT, SONAR_FROZEN, SONAR_DEAF, ODOMETRY_SILENT, ODOMETRY_FROZEN, BUMPED = range(8, 14)

CELL = 0.10  # m: side of a cell of the grid
CELLS = 64  # cells per side, a power of two: 3.2 m around the chair, as far as people matter
GRID = CELLS * CELLS
REACH = 2.6  # m from the axle: the outline, and what it sweeps from 0.8 m/s to rest
FAR = 3.6  # m from the laser: farther points are not stored
JUMP = np.float32(0.10)  # m: where ranges jump, the edge is a point of its own
SAME = 0.10  # m: a ray that ends so near a point, or beyond it, has seen its place again
CLOSE_BY = 1.5  # m from the laser: what was last seen farther away is not in the way
FRESH = 512  # points of one scan
KEPT = 512  # points of earlier scans
ARC = 12  # points on the arc of an echo
SECTORS = 256  # of each further scanner: each gives a point where it is hit
OTHERS_KEPT = 256  # points of earlier scans that further scanners hit
OTHERS = (SCANNERS - 1) * SECTORS + OTHERS_KEPT
HITS = 48  # hits of single beams
KEY_POINTS = 181  # of a key scan, evenly spaced
SCANNED = FRESH + KEPT  # points of scans of the first scanner
_MOST = SCANNED + HITS + SCANNERS * KEY_POINTS  # of these, repeated hits, and lost points
STORED = _MOST + -_MOST % 32
_KNOWN = STORED + OTHERS + RANGERS * ARC
NEAR = _KNOWN + -_KNOWN % 32  # whole blocks of 32 points, which `decision` compares at once
MARKS = 96  # points that may move
BESIDE = 0.20  # m: points so near a moving point may belong to the same object
BODY = 0.35  # m: marks so near each other are of one body
EDGE = math.radians(15.0)  # of a scanner's view: half a body at 2 m
CLOSE = 64  # points inside the stop zone
RATES: Final = (4.0, 100.0)  # Hz: of control
SPARE = 1.2  # the chair must exceed its limits by this factor to follow its set point
_ROUND = 1e-6
_ARM = 1.0  # m: from a scanner to the farthest points that the outline may touch
REST_SPEED = 0.02  # m/s, rad/s: slower is at rest
_AHEAD_V, _AHEAD_W = 0.03, 0.08  # m/s, rad/s: so much faster are wheels that outrun it,
_AHEAD_READINGS = 3  # in this number of readings one after another
_ASIDE = math.radians(4.0)  # cones of ultrasonics have soft edges
SAMPLES = 38  # points of the outline that are checked against unseen space
SIDES: Final = ((2, 8), (9, 15), (16, 26), (27, 37))  # the first and last of each side

_F8 = "f8"
SETPOINT = np.dtype([(name, _F8) for name in ("v", "v_slope", "w", "w_slope")])
SAMPLE = np.dtype([(name, _F8) for name in ("x", "y", "normal_x", "normal_y")])
XY = np.dtype([("x", _F8), ("y", _F8)])  # m
POINT = np.dtype([*XY.descr, ("stamp", _F8)])  # stamp: kept until then [s]
HIT = np.dtype([*POINT.descr, ("scans", _F8)])  # stamp: of the last hit; scans: number with hits
MARK = np.dtype([*POINT.descr, ("seen", _F8)])  # stamps [s] of the last motion and sighting
DISTANT = np.dtype([(name, _F8) for name in ("x", "y", "distance")])  # m
TRACKED = read_record("TRACKED", globals())[0]


def _columns(row: np.dtype[np.void], n: int) -> list[tuple[str, str, tuple[int]]]:
    """Fields that hold n such rows, each field of theirs as an array, for loops in vectors."""
    return [(name, _F8, (n,)) for name in row.names or ()]


POINTS, ARC_POINTS = np.dtype(_columns(POINT, STORED)), np.dtype(_columns(XY, ARC))
OUTLINE = np.dtype(_columns(SAMPLE, SAMPLES))
# Of each also its scanner, and the number of readings in which that has seen beyond it.
_MORE = [(name, "i1", (OTHERS,)) for name in ("scanner", "passed")]
OTHER_POINTS = np.dtype([*_columns(POINT, OTHERS), *_MORE], align=True)

SETTINGS = numbers_of(ShieldSettings)
CONSTANTS = read_record("CONSTANTS", globals())[0]
KEY = read_record("KEY", globals())[0]
STEADY = read_record("STEADY", globals())[0]
DECISION = read_record("DECISION", globals())[0]
SHIELD = read_record("SHIELD", globals())[0]
NEARBY = read_record("NEARBY", globals())[0]
UPDATE = read_record("UPDATE", globals())[0]


@borrowing_kernel
def set_motion(s: Any, v: float, v_slope: float, w: float, w_slope: float) -> None:
    """Set the motion of a SHIELD record's chair to a set point, without delay."""
    setpoint = s.setpoint
    setpoint.v, setpoint.v_slope, setpoint.w, setpoint.w_slope = v, v_slope, w, w_slope
    s.delayed_v, s.delayed_w = v, w


@borrowing_kernel
def outrun(s: Any, v: float, w: float) -> tuple[bool, bool]:
    """Return whether the wheels are faster than the set point, in speed and in turn rate."""
    max_v = max(abs(s.setpoint.v), abs(s.delayed_v))
    max_w = max(abs(s.setpoint.w), abs(s.delayed_w))
    return abs(v) > max_v + _AHEAD_V, abs(w) > max_w + _AHEAD_W


@borrowing_kernel
def follow_wheels(s: Any, v: float, w: float) -> None:
    """Raise the set point to at least the wheels' speed: a board's ramp may differ from the model.

    They must be faster in several readings: wheels that change direction are behind for a moment.
    """
    fast, turns = outrun(s, v, w)
    s.ahead = s.ahead + 1 if (fast or turns) and not s.decision.protective else 0
    if s.ahead < _AHEAD_READINGS:
        return
    if fast:
        s.setpoint.v, s.setpoint.v_slope, s.delayed_v = v, 0.0, v
    if turns:
        s.setpoint.w, s.setpoint.w_slope, s.delayed_w = w, 0.0, w


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
        asked *= SPARE
        if asked > held:
            raise InputError(
                f"chair.limits ask to {what} {asked:.2f}, with a fifth to spare; by its mass, "
                f"friction and motors the chair reaches {held:.2f} (SI units), so no shield holds: "
                "lower the limits, or drive without a shield"
            )


def range_error(chair: ChairSettings, sensors: SensorSettings) -> float:
    """Error [m] of a point near the outline, by the settings of the lasers and what is drawn.

    It is two standard deviations of the offset, noise, and the greatest errors of offset and mount
    that rows of `chair` can draw, as those of a fit. Points are means of several beams, whose noise
    is about a third of that of one beam.
    """

    def greatest(name: RandomizedName, configured: float = 0.0) -> float:
        return max(map(abs, chair.bounds(name, configured, configured)))

    mount = math.hypot(greatest("laser.x_error"), greatest("laser.y_error"))
    mount += _ARM * greatest("laser.yaw_error")
    offset = greatest("laser.offset_error")
    return mount + max(
        max(2.0 * greatest("laser.bias", laser.bias), offset)
        + greatest("laser.sigma", laser.sigma) / 3.0
        for laser in sensors.lasers
    )


class Frame(NamedTuple):
    """A frame in another: its origin, and cosine and sine of its yaw."""

    x: float
    y: float
    c: float
    s: float


class ShieldConstants(Pointers):
    """Settings, outline, limits and mounts of a shield, as the record `record` (1,).

    Raises:
        InputError: see `check`.
    """

    def __init__(
        self, config: ShieldSettings, chair: ChairSettings, sensors: SensorSettings, period: float
    ) -> None:
        check(chair, period)
        if not sensors.lasers:
            raise InputError(
                "shield: it needs a laser, since ultrasonics alone do not show what is free; "
                "expected beams of sensors.laser, or no shield"
            )
        self.scanners = scanner_pointers(sensors, False)
        targets = {"scanners": Target(SCANNER, None), "tracker": Target(TRACKER_CONSTANTS, 1)}
        super().__init__(np.zeros(1, CONSTANTS), targets, constant=True)
        g: Any = self.record[0]
        g["limits"], g["outline"] = chair.limits.record, chair.footprint.array
        samples = outline_samples(*chair.footprint.array.tolist())
        for name in SAMPLE.names or ():
            g["samples"][name] = samples[name]
        g["period"], g["track"] = period, chair.drive.track
        copy_numbers(g, config)
        g["tracks"] = config.tracks
        g["reaction_time"] += chair.following_lag + chair.longest_delay
        g["stop_margin"] += range_error(chair, sensors)
        for name in ("laser", "ultrasonic", "odometry"):
            g[f"stale_{name}"] = getattr(config.stale, name)
        self.point("scanners", self.scanners)
        self.point("tracker", TrackerConstants(sensors.laser))
        g["beams"], g["n_scanners"] = sensors.laser.beams, len(sensors.lasers)
        rangers = zip(sensors.ultrasonic.mounted, sensors.ultrasonic.models, strict=True)
        for k, (one, model) in enumerate(rangers):
            g["ranger_mount"][k] = one.x, one.y, one.yaw
            half = 0.5 * model.field_of_view
            g["ranger_half"][k], g["ranger_reach"][k] = half, model.reach
            g["ranger_slope"][k] = math.tan(half + _ASIDE)
            g["ranger_oblique"][k] = half + LOSS[one.model][1]


def outline_samples(front: float, rear: float, half: float) -> Rows:
    """Points of the outline with their normals, about one cell apart, as SAMPLE (SAMPLES,)."""
    rows = [(-rear, side * half, 0.0, 0.0) for side in (-1, 1)]
    rows += [(front, y, 1.0, 0.0) for y in np.linspace(-half, half, 7)]
    rows += [(-rear, y, -1.0, 0.0) for y in np.linspace(-half, half, 7)]
    rows += [(x, side * half, 0.0, side) for side in (-1, 1) for x in np.linspace(-rear, front, 11)]
    return np.array(rows, SAMPLE)

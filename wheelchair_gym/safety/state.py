"""The shield's records: CONSTANTS of the chair, and SHIELD, the state of the last seconds.

The memory is bounded: points that the laser hit, echoes that only ultrasonics measured, and a grid
that moves with the chair and holds when each cell was last seen. All coordinates are in the frame
of uncorrected dead reckoning, so that near objects keep their place.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from wheelchair_gym.base.arrays import Rows
from wheelchair_gym.base.settings import InputError, copy_numbers, numbers_of
from wheelchair_gym.compiled.address import Pointers, Target
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry.kinematics import LIMITS
from wheelchair_gym.perception.track_state import CONSTANTS as TRACKER_CONSTANTS
from wheelchair_gym.perception.track_state import TRACKER, TRACKS, TrackerConstants
from wheelchair_gym.safety.settings import ShieldSettings
from wheelchair_gym.safety.stops import SHIELD_FAULTS
from wheelchair_gym.sensors.laser import SCANNER, LaserArrays, scanner_pointers
from wheelchair_gym.sensors.settings import RANGERS, SCANNERS, SensorSettings
from wheelchair_gym.sim.settings import ChairSettings

# Why a twist was changed; those from LASER_SILENT on are faults and latch.
REASONS: Final = ("", "obstacle", "moving", "unseen", *SHIELD_FAULTS)
NOTHING, OBSTACLE, MOVING, UNSEEN = range(4)
LASER_SILENT, LASER_FROZEN, LASER_BLIND, LASER_DISAGREES = range(4, 8)
SONAR_SILENT, SONAR_FROZEN, SONAR_DEAF, ODOMETRY_SILENT, ODOMETRY_FROZEN, BUMPED = range(8, 14)

CELL = 0.10  # m: side of a cell of the grid
CELLS = 64  # cells per side, a power of two: 3.2 m around the chair, as far as people matter
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
_KNOWN = FRESH + KEPT + OTHERS + RANGERS * ARC
NEAR = _KNOWN + -_KNOWN % 32  # whole blocks of 32 points, which `decision` compares at once
MARKS = 96  # points that may move
BESIDE = 0.20  # m: points so near a moving point may belong to the same object
BODY = 0.35  # m: marks so near each other are of one body
EDGE = math.radians(15.0)  # of a scanner's view: half a body at 2 m
CLOSE = 64  # points inside the stop zone
HITS = 48  # hits of single beams
RATES: Final = (4.0, 100.0)  # Hz: of control
_SPARE = 1.2  # the chair must exceed its limits by this factor to follow its set point
_ROUND = 1e-6
REST_SPEED = 0.02  # m/s, rad/s: slower is at rest
_AHEAD_V, _AHEAD_W = 0.03, 0.08  # m/s, rad/s: so much faster are wheels that outrun it,
_AHEAD_READINGS = 3  # in this number of readings one after another
KEY_POINTS = 181  # of a key scan, evenly spaced
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
# What is tracked: as it was seen last, so long ago [s], with the variances of TRACK; and where it
# would be at some time at constant velocity, and how far [m] from there it may be.
TRACKED = np.dtype(
    [
        *((name, _F8) for name in ("x", "y", "vx", "vy", "radius", "unseen")),
        *((name, _F8) for name in ("place_var", "covariance", "speed_var")),
        *((name, _F8) for name in ("then_x", "then_y", "spread")),
        ("is_person", "b1"),  # confirmed to be one
    ],
    align=True,
)


def _columns(row: np.dtype[np.void], n: int) -> list[tuple[str, str, tuple[int]]]:
    """Fields that hold n such rows, each field of theirs as an array, for loops in vectors."""
    return [(name, _F8, (n,)) for name in row.names or ()]


POINTS, ARC_POINTS = np.dtype(_columns(POINT, FRESH + KEPT)), np.dtype(_columns(XY, ARC))
OUTLINE = np.dtype(_columns(SAMPLE, SAMPLES))
# Of each also its scanner, and the number of readings in which that has seen beyond it.
_MORE = [(name, "i1", (OTHERS,)) for name in ("scanner", "passed")]
OTHER_POINTS = np.dtype([*_columns(POINT, OTHERS), *_MORE], align=True)

CONSTANTS = np.dtype(
    [
        ("limits", LIMITS),
        ("outline", "f8", (3,)),  # Footprint.array
        ("samples", OUTLINE),  # outward normals; 0, 0 at the rear corners
        ("period", "f8"),  # s
        ("track", "f8"),  # m
        *numbers_of(ShieldSettings).descr,
        ("tracks", "b1"),
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
        ("mount", "f8", (3,)),  # pose of the laser
        ("n_scanners", "i8"),  # the laser, which is the first, and further ones
        ("scanners", "u8"),  # address of their records, of SCANNER
        ("ranger_mount", "f8", (RANGERS, 3)),  # poses
        ("ranger_half", "f8", (RANGERS,)),  # rad: half of the cone
        ("ranger_slope", "f8", (RANGERS,)),  # of the edge of a slightly wider cone
        ("ranger_reach", "f8", (RANGERS,)),  # m
        ("tracker", "u8"),  # address of its constants, a record of perception.track_state.CONSTANTS
    ],
    align=True,
)

# An earlier scan of a scanner, and how later ones differ from it: see `safety.agreement`.
KEY = np.dtype(
    [
        *((name, "f4", (KEY_POINTS,)) for name in ("x", "y")),  # m, dead-reckoned; NaN: no point
        *((name, "f4", (KEY_POINTS,)) for name in ("normal_x", "normal_y")),  # (0, 0): none
        ("lost", "f4", (KEY_POINTS,)),  # s without an echo; -1: no longer expected
        ("held", "f4", (KEY_POINTS,)),  # s for which it was seen
        ("dark", "f4", (KEY_POINTS,)),  # m and rad that points were lost on beams without echoes
        ("offset", "f8", (3,)),  # fitted motion that the wheels do not report [m, m, rad]
        ("still", "f8", (3,)),  # zeros
        ("at", "f8", (4,)),  # frame of the scanner at the key scan: x, y, cosine, sine
        ("speed", "f8", (3,)),  # velocity at the key scan [m/s, m/s, rad/s]
        ("square", "f8"),  # sums of a regression of the offset on the change of speed
        ("product", "f8"),
        ("lag", "f8"),  # s: estimated age of a scan
        ("way", "f8"),  # m since the key scan
        ("turned", "f8"),  # rad since the key scan
        ("astray", "f8"),  # s for which another motion than that of the wheels fits
        ("strange", "f8"),  # s for which scans have shown little of what the key scan shows
        ("mark", "f4", (KEY_POINTS,)),  # nearest range [m] of each sector of an earlier scan
        ("mark_at", "f8", (4,)),  # frame of the scanner at that time
        ("followed", "f8"),  # m and rad since then if scans are doubted, else 0
        ("repeats", "i8"),  # sectors that show the old range
        ("marked", "b1"),
        ("matched", "i8"),  # points with a normal that the scan after it showed
        ("begun", "b1"),
        ("renewed", "b1"),  # `matched` is to be counted
        ("few", "b1"),  # most points are out of view
    ],
    align=True,
)

# An echo that no laser point explains, since when it has had one range, and the ranger's pose then.
STEADY = np.dtype(
    [*((name, _F8) for name in ("range", "x", "y", "yaw")), ("stuck", "b1")], align=True
)

# How the last twist was changed, and why: fields of `safety.shield.Decision`.
DECISION = np.dtype(
    [
        ("reason", "i8"),  # index into REASONS
        ("asked", "f8", (2,)),  # m/s, rad/s
        ("given", "f8", (2,)),
        ("protective", "b1"),
    ],
    align=True,
)

SHIELD = np.dtype(
    [
        ("begun", "b1"),  # a reading has come
        ("stamp", "f8"),  # s: of the last reading
        ("pose", "f8", (3,)),  # dead-reckoned since reset
        ("read_pose", "f8", (3,)),  # pose and twist of the last reading, to the bit
        ("read_twist", "f8", (2,)),
        ("reaction_time", "f8"),  # s: with the estimated age of scans
        ("setpoint", SETPOINT),  # speed and turn rate that the chair approaches, and their slopes
        ("delayed_v", "f8"),  # the set point a reaction time ago
        ("delayed_w", "f8"),
        # faults
        ("latched", "i8"),  # reason, 0: none
        ("rearmed", "b1"),  # a person asks to clear the fault
        ("laser_hash", "u8"),
        ("sonar_hash", "u8"),
        ("laser_silent", "f8"),  # s without valid ranges
        ("laser_frozen", "f8"),  # s with repeated ranges
        ("laser_blind", "f8"),  # s without the echoes that the scan before predicts
        ("laser_denied", "f8"),  # s without an echo while ultrasonics measure one
        ("other_silent", "f8", (SCANNERS,)),  # s without valid ranges of each further scanner
        ("other_frozen", "f8", (SCANNERS,)),  # s with repeated ranges
        ("other_hash", "u8", (SCANNERS,)),
        ("keys", KEY, (SCANNERS,)),
        ("n_lost", "i8"),  # nearby key points without an echo
        ("sonar_silent", "f8", (RANGERS,)),
        ("sonar_frozen", "f8"),
        ("odometry_silent", "f8"),
        ("odometry_frozen", "f8"),
        ("astray", "f8"),  # s for which the wheels have not followed the set point
        ("ahead", "i8"),  # latest readings in which they outrun it
        # grid
        ("corner", "i8", (2,)),  # cell of the grid's lower left corner
        ("columns", "i8"),  # 0 or 1: whether even or odd columns were updated last
        ("seen", "f4", (CELLS * CELLS,)),  # s: when a ray last reached the cell
        ("clear", "f4", (CELLS * CELLS,)),  # s: when a ray last passed well beyond it
        # points that the laser hit; the first n_old are of earlier scans
        ("n_points", "i8"),
        ("n_old", "i8"),
        ("points", POINTS),
        ("n_hits", "i8"),
        ("hits", HIT, (HITS,)),  # of single beams
        # points that further scanners hit, those of the last reading first
        ("n_others", "i8"),
        ("others", OTHER_POINTS),
        ("n_marks", "i8"),
        ("marks", MARK, (MARKS,)),  # points that may move
        ("marked", "f8"),  # s: when there was a mark last
        ("tracker", TRACKER),
        ("n_dark", "i8"),  # longest run of beams of a scanner that stay dark
        ("travel", "f8"),  # m, and rad, that the wheels have turned through since reset
        ("deaf", "i8", (RANGERS,)),  # surfaces before a ranger that it did not hear, in a row
        ("deaf_at", "f8", (RANGERS,)),  # `travel` at the last surface
        ("steady", STEADY, (RANGERS,)),
        # echoes that no laser point explains
        ("fired", "f8", (RANGERS,)),  # s: when each ranger fired
        ("doubtful", "f8", (RANGERS,)),  # m: an echo measured once, or NaN
        ("n_arc", "i8", (RANGERS,)),
        ("arc", ARC_POINTS, (RANGERS,)),
        ("gap", "f8"),  # m: clearance of the outline
        ("decision", DECISION),
    ],
    align=True,
)

# What is near, in the chair's frame: workspace of a decision.
NEARBY = np.dtype(
    [
        ("n", "i8"),
        ("x", "f8", (NEAR,)),
        ("y", "f8", (NEAR,)),
        ("gaps", "f8", (NEAR,)),  # m: signed clearances
        ("out_x", "f8", (SAMPLES,)),  # points of the outline that move outward
        ("out_y", "f8", (SAMPLES,)),
        ("n_moving", "i8"),
        ("moving_x", "f8", (MARKS,)),
        ("moving_y", "f8", (MARKS,)),
        ("standing_for", "f8", (MARKS,)),  # s
        ("hidden_for", "f8", (MARKS,)),  # s
        ("owner", "i8", (MARKS,)),  # the one tracked person that a moving point is of, or -1
        ("n_tracked", "i8"),
        ("tracked", TRACKED, (TRACKS,)),
        ("hidden", "f8"),  # s: the longest of these
        ("n_close", "i8"),
        ("close", DISTANT, (CLOSE,)),  # signed clearances
        ("gap", "f8"),  # m: clearance of the outline
    ],
    align=True,
)

# Workspace of an update.
UPDATE = np.dtype(
    [
        ("kept", "i1", (FRESH + KEPT,)),  # 1: a point is kept
        ("beam", "i4", (FRESH + KEPT,)),  # the beam towards it
        ("far", "f8", (FRESH + KEPT,)),  # m: from the laser
        ("x", "f4", (FRESH + KEPT,)),  # m: points of the last scan in the laser's frame
        ("y", "f4", (FRESH + KEPT,)),
        ("old_marks", MARK, (MARKS,)),  # before the scan
        ("in_view", "i1", (MARKS,)),  # 1: the body of a mark is wholly in view
    ],
    align=True,
)


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
        asked *= _SPARE
        if asked > held:
            raise InputError(
                f"chair.limits ask to {what} {asked:.2f}, with a fifth to spare; by its mass, "
                f"friction and motors the chair reaches {held:.2f} (SI units), so no shield holds: "
                "lower the limits, or drive without a shield"
            )


def range_error(sensors: SensorSettings) -> float:
    """Error [m] that the configured lasers make: two standard deviations of the offset, and noise.

    Points are means of several beams, whose noise is about a third of that of one beam.
    """
    return max(2.0 * laser.bias + laser.sigma / 3.0 for laser in sensors.lasers)


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
        self.laser = laser = LaserArrays.of(sensors.laser, False)
        self.scanners = scanner_pointers(sensors, False)
        targets = dict.fromkeys(("cosine", "sine"), Target("f4", None))
        targets["scanners"] = Target(SCANNER, None)
        targets["tracker"] = Target(TRACKER_CONSTANTS, 1)
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
        g["stop_margin"] += range_error(sensors)
        for name in ("laser", "ultrasonic", "odometry"):
            g[f"stale_{name}"] = getattr(config.stale, name)
        self.point("cosine", laser.cosine)
        self.point("sine", laser.sine)
        self.point("scanners", self.scanners)
        self.point("tracker", TrackerConstants(sensors.laser))
        g["beams"], g["n_scanners"] = sensors.laser.beams, len(sensors.lasers)
        for name in ("first", "per_angle", "nearest", "mount", "reach"):
            g[name] = getattr(laser, name)
        rangers = sensors.ultrasonic
        for k, one in enumerate(rangers.mounted):
            model = rangers.narrow if one.model == "narrow" else rangers.wide
            g["ranger_mount"][k] = one.x, one.y, one.yaw
            half = 0.5 * model.field_of_view
            g["ranger_half"][k], g["ranger_reach"][k] = half, model.reach
            g["ranger_slope"][k] = math.tan(half + _ASIDE)


def outline_samples(front: float, rear: float, half: float) -> Rows:
    """Points of the outline with their normals, about one cell apart, as SAMPLE (SAMPLES,)."""
    rows = [(-rear, side * half, 0.0, 0.0) for side in (-1, 1)]
    rows += [(front, y, 1.0, 0.0) for y in np.linspace(-half, half, 7)]
    rows += [(-rear, y, -1.0, 0.0) for y in np.linspace(-half, half, 7)]
    rows += [(x, side * half, 0.0, side) for side in (-1, 1) for x in np.linspace(-rear, front, 11)]
    return np.array(rows, SAMPLE)

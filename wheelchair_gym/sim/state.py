"""Records of simulated chairs: their sensors, and one chair's parameters and its state at a time.

A kernel takes each of them in one piece.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.settings import copy_numbers, numbers_of
from wheelchair_gym.compiled.address import Pointers, read_record
from wheelchair_gym.compiled.kernel import inlined
from wheelchair_gym.engine import ENGINE, engine_record
from wheelchair_gym.geometry.kinematics import LIMITS  # noqa: F401 for the records
from wheelchair_gym.sensors.laser import (  # noqa: F401 for the records
    SCANNER,
    LaserArrays,
    laser_arrays,
    scanner_pointers,
    scanners_at,
)
from wheelchair_gym.sensors.settings import (  # noqa: F401
    POSE_MAX,
    POSE_SOURCES,
    RANGERS,
    SCANNERS,
    SensorSettings,
)
from wheelchair_gym.sensors.ultrasonic import RANGER, ranger_rows, rangers_at  # noqa: F401
from wheelchair_gym.signals import SENSED_READING, SENSED_TRUTH
from wheelchair_gym.sim.randomization import (  # noqa: F401
    DRAW,
    JOINED,
    RANDOMIZED,
    draws_of,
    factor_of,
)
from wheelchair_gym.sim.settings import (
    BatterySettings,
    BodySettings,
    ChairSettings,
    MotorSettings,
    PhysicsSettings,
    integer_ratio,
)

BODY, MOTOR, BATTERY = map(numbers_of, (BodySettings, MotorSettings, BatterySettings))
DRAWS = len(RANDOMIZED)
SUITE, _TARGETS = read_record("SUITE", globals())
PARAMETER = read_record("PARAMETER", globals())[0]
STATE = read_record("STATE", globals())[0]


class SensorSuite(Pointers):
    """Sensors and engine of a kind of chair; `record` (1,) points to what it keeps alive.

    It never changes: a copy in this process is itself, one in another process is made anew.
    """

    def __init__(self, sensors: SensorSettings) -> None:
        super().__init__(np.zeros(1, SUITE), _TARGETS, constant=True)
        self._sensors = sensors
        self.scanners = scanner_pointers(sensors, sensors.noise)
        self.order = np.array(sensors.ultrasonic.firing_order, np.int64)
        for name in ENGINE.names or ():
            self.record[name] = engine_record()[name]
        self.fill(
            n_scanners=len(self.scanners.record), scanners=self.scanners, rangers=len(self.order),
            ranger_rows=ranger_rows(sensors.ultrasonic, sensors.noise), order=self.order,
        )  # fmt: skip

    def __reduce__(self) -> tuple[type[SensorSuite], tuple[SensorSettings]]:
        return type(self), (self._sensors,)


@inlined
def scanner_of(suite: Any, p: Any, k: int) -> LaserArrays:
    """Scanner k of a suite's record, with the mount and the errors of an episode's parameters."""
    one, mount, bias = scanners_at(suite.scanners, suite.n_scanners)[k], p.laser_mount, p.laser_bias
    sigma, dropout, offset = p.laser_sigma[k], p.laser_dropout[k], p.laser_offset[k]
    return laser_arrays(one, mount[k], sigma, dropout, bias[k], offset)


@inlined
def ranger_of(suite: Any, which: int) -> Any:
    """One of the ultrasonics of a suite's record, a record of RANGER."""
    return rangers_at(suite.ranger_rows, suite.rangers)[which]


# Faults of a laser whose scans look right.
DECEITS = (
    "laser late",
    "laser repeats",
    "laser jitters",
    "laser stuck",
    "laser blind",
    "laser mirrored",
    "laser turned",
    "laser moved",
)
FAULTS = (
    "",
    "laser silent",
    "laser frozen",
    *DECEITS,
    "ultrasonic silent",
    "ultrasonic frozen",
    "odometry silent",
    "odometry frozen",
)

# What a control period gives, without the scans and the actors' poses.
SENSED = np.dtype(
    [(signal.column, signal.kind, signal.shape) for signal in (*SENSED_READING, *SENSED_TRUTH)],
    align=True,
)


def sensed_of(reading: Any, truth: Any = None) -> NDArray[np.void]:
    """Return a reading without its scan, and the truth if given, as a record (1,) of SENSED."""
    sensed = np.zeros(1, SENSED)
    row: Any = sensed[0]
    row["ultrasonic"], row["age"] = np.nan, np.inf  # of columns that a reading does not have
    for source, signals in ((reading, SENSED_READING), (truth, SENSED_TRUTH)):
        for signal in signals if source is not None else ():
            value = getattr(source, signal.name)
            if signal.name in ("ultrasonic", "age"):
                row[signal.column][: len(value)] = value
            else:
                row[signal.column] = value
    return sensed


_DECISION_PERIOD = 0.1  # s between two choices of a velocity by people
_NEVER = 2**62  # physics steps: more than there are


def parameters(
    chair: ChairSettings, sensors: SensorSettings, physics: PhysicsSettings, period: float
) -> NDArray[np.void]:
    """The parameters (1,) of a chair before an episode's own are drawn.

    Raises:
        InputError: control period, speed control and physics step are not integer multiples.
    """
    rows = np.zeros(1, PARAMETER)
    p: Any = rows[0]
    body, motor, battery = chair.body, chair.motor, chair.battery
    drive, odometry = chair.drive, sensors.odometry
    random, errors = chair.random, 1.0 if sensors.noise else 0.0
    for section in ("body", "motor", "battery"):
        copy_numbers(p[section], getattr(chair, section))
    p["mass_range"] = random.mass if chair.randomize else (body.mass, body.mass)
    p["friction_range"] = random.friction if chair.randomize else (body.friction, body.friction)
    p["gain_range"] = random.gain if chair.randomize else (1.0, 1.0)
    p["diameter_error"] = errors * odometry.diameter_error
    p["track_error"] = errors * odometry.track_error
    p["outline"] = chair.footprint.array
    p["nominal_track"], p["nominal_radius"] = drive.track, drive.wheel_radius
    p["wheel_share"] = drive.wheel_shares
    p["counts_per_metre"] = drive.counts_per_metre
    p["feed_constant"] = motor.believed_constant
    p["slope"], p["downhill"] = physics.slope, physics.downhill
    p["limits"] = chair.limits.record
    p["capacity"] = battery.capacity * 3600.0
    p["wheel_variance"] = errors * odometry.variance
    # A localizer gets the dead-reckoned pose of the chair.
    source = "odometry" if sensors.localizes else sensors.pose_source
    p["pose_source"] = POSE_SOURCES.index(source)
    modelled = sensors.modelled
    p["pose_sigma"] = modelled.position, modelled.position, modelled.heading
    p["pose_max"] = POSE_MAX
    p["pose_time"] = modelled.time
    p["fault_share"], p["fault_onset"] = sensors.faults.share, sensors.faults.onset
    p["dt"] = physics.step
    p["substeps"] = integer_ratio(period, physics.step, "control period and physics.step")
    p["speed_every"] = integer_ratio(
        1.0 / motor.control_rate, physics.step, "1/motor.control_rate and physics.step"
    )
    p["delay"] = round(chair.command_delay / physics.step)
    for k, laser in enumerate(sensors.lasers):
        p["laser_mount"][k] = laser.x, laser.y, laser.yaw
        p["laser_sigma"][k], p["laser_bias"][k] = errors * laser.sigma, errors * laser.bias
        p["laser_dropout"][k] = errors * laser.dropout
    for k, model in enumerate(sensors.ultrasonic.models):
        p["ranger_sigma"][k] = errors * model.sigma
    p["draws"] = draws_of(chair.randomization, chair.joint, sensors.noise)
    p["joint_factor"] = factor_of(chair.joint)
    rangers = sensors.ultrasonic
    p["fire_every"] = _NEVER
    if rangers.mounted:
        what = "ultrasonic.interval and physics.step"
        p["fire_every"] = integer_ratio(rangers.interval, physics.step, what)
    p["decide_every"] = max(1, round(_DECISION_PERIOD / physics.step))
    return rows

"""Two records of one simulated chair: its parameters, and its state at a time."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.settings import copy_numbers, numbers_of
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.compiled.random import PARAMETERS, uniform
from wheelchair_gym.engine import GRAVITY
from wheelchair_gym.geometry.kinematics import LIMITS
from wheelchair_gym.sensors.settings import (
    POSE_MAX,
    POSE_SOURCES,
    RANGERS,
    SCANNERS,
    SensorSettings,
)
from wheelchair_gym.signals import SENSED_READING, SENSED_TRUTH
from wheelchair_gym.sim.randomization import (
    DIAMETER,
    DRAG,
    DRAW,
    GAIN,
    JOINED,
    MASS,
    RANDOMIZED,
    RESISTANCE,
    ROLLING,
    SCALE,
    SLOPE,
    TRACK,
    drawn,
    draws_of,
    factor_of,
    randomize_sensors,
)
from wheelchair_gym.sim.settings import (
    BatterySettings,
    BodySettings,
    ChairSettings,
    MotorSettings,
    PhysicsSettings,
    integer_ratio,
)

PARAMETER = np.dtype(
    [
        # settings
        ("body", numbers_of(BodySettings)),
        ("motor", numbers_of(MotorSettings)),
        ("battery", numbers_of(BatterySettings)),
        # the body, as it truly is this episode
        ("mass", "f8"),  # kg
        ("moment", "f8"),  # kg m2, about the centre of mass
        ("friction", "f8"),
        # wheels, true
        ("track", "f8"),  # m
        ("radius_left", "f8"),  # m
        ("radius_right", "f8"),  # m
        ("pull", "f8", (2,)),  # m/s2: by gravity on the floor, in the world
        # motors
        ("gain", "f8"),
        # control, with the geometry the chair believes in
        ("nominal_track", "f8"),  # m
        ("nominal_radius", "f8"),  # m
        ("wheel_share", "f8", (2,)),  # radii over the nominal one
        ("counts_per_metre", "f8"),
        ("feed_constant", "f8"),  # V s/rad
        ("limits", LIMITS),
        # battery
        ("capacity", "f8"),  # J
        # what is drawn anew each episode, uniform from, to; errors from minus to plus
        ("mass_range", "f8", (2,)),  # kg
        ("friction_range", "f8", (2,)),
        ("gain_range", "f8", (2,)),
        ("diameter_error", "f8"),
        ("track_error", "f8"),
        # outline, and how it is hurt
        ("outline", "f8", (3,)),  # front, rear, half width [m]
        # sensing
        ("wheel_variance", "f8"),  # m2/m
        ("pose_source", "i8"),  # index into POSE_SOURCES
        ("pose_sigma", "f8", (3,)),  # m, m, rad
        ("pose_max", "f8", (3,)),  # m, m, rad
        ("pose_time", "f8"),  # s
        # of each scanner and ranger, as they truly are this episode
        ("laser_mount", "f8", (SCANNERS, 3)),  # m, m, rad in the chair's frame
        ("laser_sigma", "f8", (SCANNERS,)),  # m
        ("laser_bias", "f8", (SCANNERS,)),  # m
        ("laser_offset", "f8", (SCANNERS,)),  # m
        ("laser_dropout", "f8", (SCANNERS,)),
        ("ranger_sigma", "f8", (RANGERS,)),  # m
        # faults
        ("fault_share", "f8"),
        ("fault_onset", "f8", (2,)),  # s: from, to
        # time
        ("dt", "f8"),  # s, physics step
        ("substeps", "i8"),  # in a control period
        ("delay", "i8"),  # physics steps from a command to its effect
        ("speed_every", "i8"),  # physics steps between two runs of the speed control
        ("fire_every", "i8"),  # physics steps between two ultrasonic firings
        # people
        ("decide_every", "i8"),  # physics steps between two choices of a velocity
        # what is drawn anew each episode, read at its reset
        ("slope", "f8"),  # rad, of the floor
        ("downhill", "f8"),  # rad, in the world
        ("draws", DRAW, (len(RANDOMIZED),)),
        ("joint_factor", "f8", (JOINED, JOINED)),
    ],
    align=True,
)

STATE = np.dtype(
    [
        ("key", "u8"),  # of the episode's randomness
        ("step", "i8"),  # control periods since reset
        ("tick", "i8"),  # physics steps since reset
        # set point, m/s and rad/s, and rates of change
        ("v", "f8"),
        ("v_rate", "f8"),
        ("w", "f8"),
        ("w_rate", "f8"),
        # what its own driving explains, m/s and rad/s: least and greatest speed, and turn
        ("explained", "f8", (4,)),
        # wheels: left, right
        ("spin", "f8", (2,)),  # rad/s
        ("turned", "f8", (2,)),  # rad since reset
        ("counts", "i8", (2,)),  # encoder at the last run of the speed control
        ("speed", "f8", (2,)),  # m/s, smoothed measurement
        ("target", "f8", (2,)),  # m/s, smoothed target
        ("integral", "f8", (2,)),  # V, integral part
        ("error", "f8", (2,)),  # m/s, of the last run
        ("duty", "f8", (2,)),
        # battery
        ("charge", "f8"),  # J
        ("voltage", "f8"),  # V
        ("energy", "f8"),  # J drawn since reset
        # truth
        ("pose", "f8", (3,)),  # m, m, rad: drive axle's centre
        ("twist", "f8", (2,)),  # m/s, rad/s
        ("distance", "f8"),  # m driven since reset, forward or backward
        ("contact", "b1"),  # touched anything in this period
        ("touched", "b1"),  # and since reset
        ("bumped", "b1"),  # a bumper strip was pressed in this period
        ("contact_recorded", "b1"),  # the next three describe a contact of this period
        ("at_fault", "b1"),  # the chair caused a contact in this period
        ("contact_with", "i8"),  # the actor touched in this period; -1: none
        ("approach_speed", "f8", (2,)),  # m/s: chair and other, at that contact
        # what the chair knows
        ("measured_counts", "i8", (2,)),  # encoder at the last reading
        ("measured_twist", "f8", (2,)),  # m/s, rad/s
        ("odometry", "f8", (3,)),  # m, m, rad
        ("pose_error", "f8", (3,)),  # m, m, rad, of the modelled pose source
        ("estimated_pose", "f8", (3,)),  # m, m, rad: the chosen pose source
        ("ranges", "f8", (RANGERS,)),  # m
        ("fired", "i8", (RANGERS,)),  # tick of each ranger's last firing
        ("firings", "i8"),  # since reset
        ("fire_pose", "f8", (RANGERS, 3)),  # pose at the firings of this period, by ranger
        # what fails
        ("fault", "i8"),  # index into FAULTS
        ("fault_step", "i8"),  # the first reading that is wrong
        ("fault_scanner", "i8"),  # the scanner that fails
        ("frozen_twist", "f8", (2,)),  # the last right values
        ("frozen_pose", "f8", (3,)),
        ("frozen_ranges", "f4", (RANGERS,)),
        ("frozen_age", "f4", (RANGERS,)),
    ],
    align=True,
)

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


@borrowing_kernel
def _uniform_between(low: float, high: float, key: np.uint64, index: int) -> float:
    """A number between two bounds, drawn from an episode's key."""
    return low + (high - low) * uniform(key, 0, PARAMETERS, index)


@borrowing_kernel
def randomize_parameters(p: Any, key: np.uint64) -> None:
    """Draw what is random about the chair of one episode."""
    randomize_sensors(p, key)
    p.mass = _uniform_between(p.mass_range[0], p.mass_range[1], key, 0)
    p.friction = _uniform_between(p.friction_range[0], p.friction_range[1], key, 1)
    p.gain = _uniform_between(p.gain_range[0], p.gain_range[1], key, 2)
    p.gain *= drawn(p, key, GAIN, 0, p.motor.gain)
    p.mass = drawn(p, key, MASS, 0, p.mass)
    body, motor = p.body, p.motor
    body.rolling_resistance = drawn(p, key, ROLLING, 0, body.rolling_resistance)
    body.caster_drag = drawn(p, key, DRAG, 0, body.caster_drag)
    motor.resistance = drawn(p, key, RESISTANCE, 0, motor.resistance)
    p.slope = drawn(p, key, SLOPE, 0, p.slope)
    along = GRAVITY * math.sin(p.slope)
    p.pull[0], p.pull[1] = along * math.cos(p.downhill), along * math.sin(p.downhill)
    p.moment = p.mass * p.body.radius_of_gyration**2
    e_d = drawn(p, key, DIAMETER, 0, p.diameter_error * _uniform_between(-1.0, 1.0, key, 3))
    e_b = drawn(p, key, TRACK, 0, p.track_error * _uniform_between(-1.0, 1.0, key, 4))
    scale = 1.0 + drawn(p, key, SCALE, 0, 0.0)
    p.track = p.nominal_track * (1.0 + e_b)
    p.radius_left = p.nominal_radius * (1.0 - 0.5 * e_d) * (scale * p.wheel_share[0])
    p.radius_right = p.nominal_radius * (1.0 + 0.5 * e_d) * (scale * p.wheel_share[1])

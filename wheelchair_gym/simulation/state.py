"""What one simulated chair is (its parameters) and where it is in time (its state): two records."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelchair_gym.sensing.noise import PARAMETERS, uniform
from wheelchair_gym.sensing.settings import SensorSettings
from wheelchair_gym.simulation.settings import ChairSettings, PhysicsSettings, whole_ratio

RANGERS = 8
GRAVITY = 9.81  # m/s2

PARAMETER = np.dtype(
    [
        # the body, as it truly is this episode
        ("mass", "f8"),  # kg
        ("moment", "f8"),  # kg m2, about the centre of mass
        ("centre", "f8"),  # m, of mass, ahead of the axle
        ("friction", "f8"),
        ("rolling", "f8"),
        ("casters", "f8"),  # m
        ("caster_track", "f8"),  # m
        ("caster_drag", "f8"),
        ("bumper", "f8"),  # N
        # wheels, true
        ("track", "f8"),  # m
        ("radius_left", "f8"),  # m
        ("radius_right", "f8"),  # m
        ("wheel_inertia", "f8"),  # kg m2
        # motors
        ("constant", "f8"),  # V s/rad = N m/A
        ("gain", "f8"),
        ("resistance", "f8"),  # ohm
        ("current", "f8"),  # A
        # control, with the geometry the chair believes in
        ("nominal_track", "f8"),  # m
        ("nominal_radius", "f8"),  # m
        ("counts_per_metre", "f8"),
        ("kp", "f8"),
        ("ki", "f8"),
        ("kd", "f8"),
        ("ka", "f8"),
        ("smoothing", "f8"),  # s
        ("limits", "f8", (9,)),  # Limits.array
        # battery
        ("capacity", "f8"),  # J
        ("full", "f8"),  # V
        ("empty", "f8"),  # V
        ("battery_resistance", "f8"),  # ohm
        ("idle", "f8"),  # W
        ("regeneration", "f8"),
        # sensing
        ("wheel_variance", "f8"),  # m2/m
        ("pose_source", "i8"),  # index into POSE_SOURCES
        ("pose_sigma", "f8", (3,)),  # m, m, rad
        ("pose_most", "f8", (3,)),  # m, m, rad
        ("pose_time", "f8"),  # s
        # time
        ("dt", "f8"),  # s, physics step
        ("substeps", "i8"),  # in a control period
        ("speed_every", "i8"),  # physics steps between two runs of the speed control
        ("fire_every", "i8"),  # physics steps between two ultrasonic firings
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
        # wheels: left, right
        ("spin", "f8", (2,)),  # rad/s
        ("turned", "f8", (2,)),  # rad since reset
        ("counts", "i8", (2,)),  # encoder at the last run of the speed control
        ("speed", "f8", (2,)),  # m/s, smoothed measurement
        ("aim", "f8", (2,)),  # m/s, smoothed target
        ("sum", "f8", (2,)),  # V, integral part
        ("error", "f8", (2,)),  # m/s, of the last run
        ("duty", "f8", (2,)),
        # battery
        ("charge", "f8"),  # J
        ("voltage", "f8"),  # V
        ("energy", "f8"),  # J drawn since reset
        # truth
        ("pose", "f8", (3,)),  # m, m, rad: drive axle's centre
        ("twist", "f8", (2,)),  # m/s, rad/s
        ("way", "f8"),  # m driven since reset, forward or backward
        ("contact", "b1"),  # touched anything in this period
        ("bumped", "b1"),  # a bumper strip was pressed in this period
        # what the chair knows
        ("seen_counts", "i8", (2,)),  # encoder at the last reading
        ("seen_twist", "f8", (2,)),  # m/s, rad/s
        ("odometry", "f8", (3,)),  # m, m, rad
        ("pose_error", "f8", (3,)),  # m, m, rad, of the modelled pose source
        ("seen_pose", "f8", (3,)),  # m, m, rad: the chosen pose source
        ("ranges", "f8", (RANGERS,)),  # m
        ("fired", "i8", (RANGERS,)),  # tick of each ranger's last firing
        ("firings", "i8"),  # since reset
        ("fire_pose", "f8", (RANGERS, 3)),  # pose at the firings of this period, by ranger
    ],
    align=True,
)

POSE_SOURCES = ("truth", "odometry", "modelled")


def parameters(
    chair: ChairSettings, sensors: SensorSettings, physics: PhysicsSettings, period: float, key: int
) -> Any:
    """The parameters (1,) of one episode; what is random is drawn from the key.

    Raises:
        InputError: control period, speed control and physics step are not whole multiples.
    """

    def draw(index: int, low: float, high: float) -> float:
        return low + (high - low) * uniform(np.uint64(key), 0, PARAMETERS, index)

    rows = np.zeros(1, PARAMETER)
    p = rows[0]
    body, motor, battery = chair.body, chair.motor, chair.battery
    drive, odometry = chair.drive, sensors.odometry
    random, errors = chair.random, 1.0 if sensors.noise else 0.0
    p["mass"] = draw(0, *random.mass) if chair.randomise else body.mass
    p["friction"] = draw(1, *random.friction) if chair.randomise else body.friction
    p["gain"] = draw(2, *random.gain) if chair.randomise else 1.0
    p["moment"] = p["mass"] * body.gyration**2
    for name in ("centre", "rolling", "casters", "caster_track", "caster_drag", "bumper"):
        p[name] = getattr(body, name)
    e_d = errors * odometry.diameter_error * draw(3, -1.0, 1.0)
    e_b = errors * odometry.track_error * draw(4, -1.0, 1.0)
    p["track"] = drive.track * (1.0 + e_b)
    p["radius_left"] = drive.wheel_radius * (1.0 - 0.5 * e_d)
    p["radius_right"] = drive.wheel_radius * (1.0 + 0.5 * e_d)
    p["wheel_inertia"] = motor.inertia
    for name in ("constant", "resistance", "current", "kp", "ki", "kd", "ka", "smoothing"):
        p[name] = getattr(motor, name)
    p["nominal_track"], p["nominal_radius"] = drive.track, drive.wheel_radius
    p["counts_per_metre"] = drive.counts_per_metre
    p["limits"] = chair.limits.array
    p["capacity"] = battery.capacity * 3600.0
    p["full"], p["empty"] = battery.full, battery.empty
    p["battery_resistance"], p["idle"] = battery.resistance, battery.idle
    p["regeneration"] = battery.regeneration
    p["wheel_variance"] = errors * odometry.variance
    p["pose_source"] = POSE_SOURCES.index(sensors.pose_source)
    modelled = sensors.modelled
    p["pose_sigma"] = modelled.position, modelled.position, modelled.heading
    p["pose_most"] = modelled.position_most, modelled.position_most, modelled.heading_most
    p["pose_time"] = modelled.time
    p["dt"] = physics.step
    p["substeps"] = whole_ratio(period, physics.step, "control period and physics.step")
    p["speed_every"] = whole_ratio(1.0 / motor.rate, physics.step, "1/motor.rate and physics.step")
    interval = sensors.ultrasonic.interval
    p["fire_every"] = whole_ratio(interval, physics.step, "ultrasonic.interval and physics.step")
    return rows

"""Settings of the sensors: where they sit, what they can see, how they err."""

from __future__ import annotations

import math
from typing import Literal

from wheelchair_gym.config import InputError, setting, settings


@settings
class LaserSettings:
    """A planar laser scanner; default as a Hokuyo UST-10LX, clipped to 10 m."""

    x: float = setting(0.66, "m", "in front, low; frame: drive axle's centre")
    y: float = setting(0.0, "m")
    yaw: float = setting(0.0, "rad")
    beams: int = setting(1081, "", "0.25 deg between beams", low=2, high=20000)
    fov: float = setting(math.radians(270.0), "rad", "UST-10LX", low=0.1, high=2 * math.pi)
    reach: float = setting(10.0, "m", "specified up to 10 m", low=0.5, high=100.0)
    nearest: float = setting(0.06, "m", "UST-10LX: nearer is invalid", low=0.0)
    sigma: float = setting(0.015, "m", "0.5-2 cm repeatability at 10 m", low=0.0, high=1.0)
    no_echo: float = setting(0.005, "", "share of beams without echo", low=0.0, high=1.0)
    bias: float = setting(
        0.002, "m", "standard deviation of one offset an episode", low=0.0, high=1.0
    )


@settings
class UltrasonicModel:
    """One model of ultrasonic ranger: its cone and its errors."""

    cone: float = setting(
        math.radians(15.0), "rad", "HC-SR04: full opening angle", low=0.01, high=3.0
    )
    reach: float = setting(4.0, "m", "HC-SR04", low=0.1, high=20.0)
    blind: float = setting(0.02, "m", "HC-SR04: nearer echoes read as this", low=0.0)
    sigma: float = setting(0.010, "m", "", low=0.0, high=1.0)
    ghosts: float = setting(
        0.01, "", "share of readings that show an echo that is not there", low=0.0, high=1.0
    )
    loss_from: float = setting(
        math.radians(15.0), "rad", "incidence at which echoes begin to be lost", low=0.0
    )
    loss_at: float = setting(
        math.radians(25.0), "rad", "incidence beyond which all are lost", low=0.0
    )

    def __post_init__(self) -> None:
        if self.loss_at <= self.loss_from:
            raise InputError("UltrasonicModel.loss_at must lie above loss_from")


@settings
class Ultrasonic:
    """Where one ranger sits and of which model it is."""

    x: float = setting(0.0, "m")
    y: float = setting(0.0, "m")
    yaw: float = setting(0.0, "rad")
    model: Literal["narrow", "wide"] = "narrow"


def _mounted() -> tuple[Ultrasonic, ...]:
    places = [
        (0.70, 0.12, 5, "narrow"),
        (0.70, 0.24, 20, "narrow"),
        (0.66, 0.31, 50, "wide"),
        (0.40, 0.31, 90, "wide"),
    ]
    return tuple(
        Ultrasonic(x, side * y, math.radians(side * yaw), "narrow" if model == "narrow" else "wide")
        for x, y, yaw, model in places
        for side in (1, -1)
    )


@settings
class UltrasonicSettings:
    """Eight rangers of two models, fired one after another."""

    mounted: tuple[Ultrasonic, ...] = setting(
        _mounted(), "", "narrow ones look ahead, wide ones to corners and sides"
    )
    narrow: UltrasonicModel = setting(UltrasonicModel(), "", "HC-SR04")
    wide: UltrasonicModel = setting(
        UltrasonicModel(
            cone=math.radians(55.0),
            reach=6.0,
            blind=0.03,
            sigma=0.020,
            ghosts=0.02,
            loss_from=math.radians(80.0),
            loss_at=math.radians(90.0),
        ),
        "",
        "SRF08: first echo in the cone",
    )
    order: tuple[int, ...] = setting(
        (0, 4, 1, 5, 2, 6, 3, 7), "", "opposite sides in turn, against cross-talk"
    )
    interval: float = setting(
        0.06, "s", "between two firings: 50-65 ms a cycle", low=0.01, high=1.0
    )

    def __post_init__(self) -> None:
        if sorted(self.order) != list(range(len(self.mounted))):
            raise InputError("UltrasonicSettings.order must name each mounted ranger once")


@settings
class OdometrySettings:
    """Errors of dead reckoning: some drawn anew each episode, one that grows with the way."""

    diameter_error: float = setting(
        0.005, "", "E_d: relative difference of wheel diameters, uniform within", low=0.0, high=0.2
    )
    track_error: float = setting(
        0.01, "", "E_b: relative error of the track, uniform within", low=0.0, high=0.2
    )
    variance: float = setting(1e-6, "m2/m", "of each wheel's way", low=0.0, high=1.0)


@settings
class ModelledPose:
    """An error model of a localiser: a clipped first-order Markov process."""

    position: float = setting(0.03, "m", "standard deviation of x and of y", low=0.0)
    heading: float = setting(math.radians(1.0), "rad", "standard deviation", low=0.0)
    time: float = setting(2.0, "s", "correlation time", low=0.01)
    position_most: float = setting(0.10, "m", "clip", low=0.0)
    heading_most: float = setting(math.radians(3.0), "rad", "clip", low=0.0)


@settings
class SensorSettings:
    """Every sensor of the chair."""

    laser: LaserSettings = LaserSettings()
    ultrasonic: UltrasonicSettings = UltrasonicSettings()
    odometry: OdometrySettings = OdometrySettings()
    modelled: ModelledPose = ModelledPose()
    pose_source: Literal["truth", "odometry", "modelled"] = "truth"
    noise: bool = setting(
        True, "", "false: exact ranges, no drop-outs, no ghosts, exact odometry parameters"
    )

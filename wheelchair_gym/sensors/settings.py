"""Settings of the sensors: where they sit, what they can see, how they err."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.config import InputError, setting, settings

Array = NDArray[np.float64]

RANGERS = 8  # ultrasonics of a chair, whatever it is


@settings
class LaserSettings:
    """A planar laser scanner; default as a Hokuyo UST-10LX, clipped to 10 m."""

    x: float = setting(default=0.66, unit="m", source="in front, low; frame: drive axle's centre")
    y: float = setting(default=0.0, unit="m")
    yaw: float = setting(default=0.0, unit="rad")
    beams: int = setting(default=1081, low=2, high=20000, source="0.25 deg between beams")
    fov: float = setting(
        default=math.radians(270.0), unit="rad", low=0.1, high=2 * math.pi, source="UST-10LX"
    )
    reach: float = setting(
        default=10.0, unit="m", low=0.5, high=100.0, source="specified up to 10 m"
    )
    range_min: float = setting(
        default=0.06, unit="m", low=0.0, source="UST-10LX: nearer is invalid"
    )
    sigma: float = setting(
        default=0.015, unit="m", low=0.0, high=1.0, source="0.5-2 cm repeatability at 10 m"
    )
    dropout: float = setting(default=0.005, low=0.0, high=1.0, source="share of beams without echo")
    bias: float = setting(
        default=0.002,
        unit="m",
        low=0.0,
        high=1.0,
        source="standard deviation of one offset an episode",
    )

    @property
    def angles(self) -> Array:
        """Of each beam in the laser's own frame (beams,) [rad], from right to left."""
        return np.linspace(-0.5 * self.fov, 0.5 * self.fov, self.beams)

    @property
    def directions(self) -> Array:
        """Cosine and sine of each beam in the chair's frame (beams, 2)."""
        bearings = self.yaw + self.angles
        return np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)


@settings
class UltrasonicModel:
    """One model of ultrasonic ranger: its cone and its errors."""

    field_of_view: float = setting(
        default=math.radians(15.0),
        unit="rad",
        low=0.01,
        high=3.0,
        source="HC-SR04: full opening angle",
    )
    reach: float = setting(default=4.0, unit="m", low=0.1, high=20.0, source="HC-SR04")
    range_min: float = setting(
        default=0.02, unit="m", low=0.0, source="HC-SR04: nearer echoes read as this"
    )
    sigma: float = setting(default=0.010, unit="m", low=0.0, high=1.0, source="")
    ghost_share: float = setting(
        default=0.01,
        low=0.0,
        high=1.0,
        source="share of readings that show an echo that is not there",
    )
    loss_from: float = setting(
        default=math.radians(15.0),
        unit="rad",
        low=0.0,
        source="incidence at which echoes begin to be lost",
    )
    loss_at: float = setting(
        default=math.radians(25.0),
        unit="rad",
        low=0.0,
        source="incidence beyond which all are lost",
    )

    def __post_init__(self) -> None:
        if self.loss_at <= self.loss_from:
            raise InputError("UltrasonicModel.loss_at must lie above loss_from")


@settings
class Ultrasonic:
    """Where one ranger sits and of which model it is."""

    x: float = setting(default=0.0, unit="m")
    y: float = setting(default=0.0, unit="m")
    yaw: float = setting(default=0.0, unit="rad")
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
        default=_mounted(), source="narrow ones look ahead, wide ones to corners and sides"
    )
    narrow: UltrasonicModel = setting(default=UltrasonicModel(), source="HC-SR04")
    wide: UltrasonicModel = setting(
        default=UltrasonicModel(
            field_of_view=math.radians(55.0),
            reach=6.0,
            range_min=0.03,
            sigma=0.020,
            ghost_share=0.02,
            loss_from=math.radians(80.0),
            loss_at=math.radians(90.0),
        ),
        source="SRF08: first echo in the cone",
    )
    order: tuple[int, ...] = setting(
        default=(0, 4, 1, 5, 2, 6, 3, 7), source="opposite sides in turn, against cross-talk"
    )
    interval: float = setting(
        default=0.06, unit="s", low=0.01, high=1.0, source="between two firings: 50-65 ms a cycle"
    )

    def __post_init__(self) -> None:
        if len(self.mounted) != RANGERS:
            raise InputError(
                f"UltrasonicSettings.mounted has {len(self.mounted)} rangers; expected {RANGERS}"
            )
        if sorted(self.order) != list(range(len(self.mounted))):
            raise InputError("UltrasonicSettings.order must name each mounted ranger once")


@settings
class OdometrySettings:
    """Errors of dead reckoning: some drawn anew each episode, one that grows with the way."""

    diameter_error: float = setting(
        default=0.005,
        low=0.0,
        high=0.2,
        source="E_d: relative difference of wheel diameters, uniform within",
    )
    track_error: float = setting(
        default=0.01, low=0.0, high=0.2, source="E_b: relative error of the track, uniform within"
    )
    variance: float = setting(
        default=1e-6, unit="m2/m", low=0.0, high=1.0, source="of each wheel's way"
    )


@settings
class ModelledPose:
    """An error model of a localiser: a clipped first-order Markov process.

    Defaults are those of `mcl` on maps that `slam` drew: python -m tests.benchmarks.poses.
    """

    position: float = setting(
        default=0.02, unit="m", low=0.0, source="standard deviation of x and of y; measured"
    )
    heading: float = setting(
        default=math.radians(0.4), unit="rad", low=0.0, source="standard deviation; measured"
    )
    time: float = setting(default=10.0, unit="s", low=0.01, source="correlation time; measured")
    position_max: float = setting(default=0.10, unit="m", low=0.0, source="clip")
    heading_max: float = setting(default=math.radians(3.0), unit="rad", low=0.0, source="clip")


@settings
class FaultSettings:
    """Sensors that fail: they fall silent, or say the same bytes again for the rest of an episode.

    One of laser, ultrasonics and wheel encoders, silent or frozen, at a time drawn evenly.
    """

    share: float = setting(default=0.0, low=0.0, high=1.0, source="of episodes with a fault")
    onset: tuple[float, float] = setting(
        default=(1.0, 5.0), unit="s", low=0.0, source="when it begins: from, to"
    )

    def __post_init__(self) -> None:
        if self.onset[0] > self.onset[1]:
            raise InputError(f"FaultSettings.since is {self.onset}; expected from, to")


@settings
class SensorSettings:
    """Every sensor of the chair."""

    laser: LaserSettings = LaserSettings()
    ultrasonic: UltrasonicSettings = UltrasonicSettings()
    odometry: OdometrySettings = OdometrySettings()
    modelled: ModelledPose = ModelledPose()
    faults: FaultSettings = FaultSettings()
    pose_source: Literal["truth", "odometry", "modelled", "mcl", "slam"] = setting(
        default="truth", source="what the chair believes about where it is"
    )
    noise: bool = setting(
        default=True,
        source="false: exact ranges, no drop-outs, no ghosts, exact odometry parameters",
    )

    @property
    def localizes(self) -> bool:
        """Whether the pose comes from what the chair sees, and not from the chair itself."""
        return self.pose_source in ("mcl", "slam")

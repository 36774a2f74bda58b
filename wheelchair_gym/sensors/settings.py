"""Settings of the sensors: where they sit, what they can see, how they err."""

from __future__ import annotations

import itertools
import math
from typing import Final, Literal, get_args

import numpy as np

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import InputError, Range, setting, settings

RANGERS = 10  # most ultrasonics of a chair; records have a column for each
_COLUMNS = 8  # of readings, at least
SCANNERS = 4  # most planar scanners of a chair
PoseSource = Literal["truth", "odometry", "modelled", "mcl", "slam"]
POSE_SOURCES: Final = get_args(PoseSource)

_MEASURED = "measured by tests.benchmarks.poses"


@settings
class Mount:
    """Mounting place of a sensor."""

    x: float = setting(default=0.0, unit="m")
    """Place ahead of the drive axle."""
    y: float = setting(default=0.0, unit="m")
    """Place to the left of the middle."""
    yaw: float = setting(default=0.0, unit="rad")
    """Heading of the middle beam, or of the cone."""


def _check_ranges(sensor: LaserSettings | UltrasonicModel) -> None:
    """Refuse a sensor whose minimum range is not below its largest one."""
    if sensor.range_min >= sensor.reach:
        raise InputError(
            f"{type(sensor).__name__}.range_min is {sensor.range_min:g} m; expected less than "
            f"the reach, {sensor.reach:g} m"
        )


@settings
class LaserSettings(Mount):
    """A planar laser scanner; default as a Hokuyo UST-10LX, clipped to 10 m."""

    x: float = setting(default=0.66, unit="m", source="design choice: in front, low")
    """Place ahead of the drive axle."""
    beams: int = setting(default=1081, low=0, high=20000, source="Hokuyo UST-10LX: 0.25 deg apart")
    """Number of beams: 2 or more; 0: the chair has no such scanner."""
    fov: float = setting(
        default=math.radians(270.0), unit="rad", low=0.1, high=2 * math.pi, source="Hokuyo UST-10LX"
    )
    """Angle between the first and the last beam."""
    reach: float = setting(
        default=10.0, unit="m", low=0.5, high=100.0, source="Hokuyo UST-10LX: specified up to 10 m"
    )
    """Largest range; farther is no echo."""
    range_min: float = setting(default=0.06, unit="m", low=0.0, source="Hokuyo UST-10LX")
    """Minimum range; nearer is invalid."""
    sigma: float = setting(
        default=0.015, unit="m", low=0.0, high=1.0, source="Hokuyo UST-10LX: 0.5 to 2 cm at 10 m"
    )
    """Standard deviation of a range."""
    dropout: float = setting(default=0.005, low=0.0, high=1.0)
    """Share of beams without an echo."""
    bias: float = setting(default=0.002, unit="m", low=0.0, high=1.0)
    """Standard deviation of the offset that all ranges of an episode share and nobody knows."""
    offset: float = setting(
        default=0.0, unit="m", low=-1.0, high=1.0, source="`wheelchair fit` measures it"
    )
    """Known error of all ranges: the scanner adds it, the chair subtracts it."""
    shows_free: bool = setting(default=False, source="a camera may look over what is low")
    """Of a further scanner: space that its beams cross counts as seen by the shield, and what
    enters it as moving, as with the first scanner. For a scanner in the plane of the first."""

    def __post_init__(self) -> None:
        if self.beams == 1:
            raise InputError("LaserSettings.beams is 1; expected 2 or more, or 0: no scanner")
        _check_ranges(self)

    @property
    def angles(self) -> Array:
        """Angle of each beam in the laser's frame (beams,) [rad], from right to left."""
        return np.linspace(-0.5 * self.fov, 0.5 * self.fov, self.beams)

    @property
    def directions(self) -> Array:
        """Cosine and sine of each beam in the chair's frame (beams, 2)."""
        angles = self.yaw + self.angles
        return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


@settings
class UltrasonicModel:
    """One model of ultrasonic ranger: its cone and its errors."""

    field_of_view: float = setting(
        default=math.radians(15.0), unit="rad", low=0.01, high=3.0, source="data sheet: HC-SR04"
    )
    """Full opening angle of the cone."""
    reach: float = setting(default=4.0, unit="m", low=0.1, high=20.0, source="data sheet: HC-SR04")
    """Largest range."""
    range_min: float = setting(default=0.02, unit="m", low=0.0, source="data sheet: HC-SR04")
    """Minimum range; nearer echoes read as this."""
    sigma: float = setting(default=0.010, unit="m", low=0.0, high=1.0)
    """Standard deviation of a range."""
    ghost_share: float = setting(default=0.01, low=0.0, high=1.0)
    """Share of readings that show an echo of nothing."""

    def __post_init__(self) -> None:
        _check_ranges(self)


@settings
class Ultrasonic(Mount):
    """Mounting place and model of one ranger."""

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


_FIRING_ORDER = (0, 4, 1, 5, 9, 2, 6, 3, 7, 8)  # opposite sides in turn, against cross-talk


@settings
class UltrasonicSettings:
    """Up to ten rangers of two models, fired one after another."""

    mounted: tuple[Ultrasonic, ...] = setting(
        default=_mounted(), source="narrow ones look ahead, wide ones to corners and sides"
    )
    """Place and model of each ranger: 0 to 10 of them."""
    narrow: UltrasonicModel = setting(default=UltrasonicModel(), source="data sheet: HC-SR04")
    """Model of the narrow rangers."""
    wide: UltrasonicModel = setting(
        default=UltrasonicModel(
            field_of_view=math.radians(55.0),
            reach=6.0,
            range_min=0.03,
            sigma=0.020,
            ghost_share=0.02,
        ),
        source="data sheet: SRF08, first echo in the cone",
    )
    """Model of the wide rangers."""
    interval: float = setting(
        default=0.06, unit="s", low=0.01, high=1.0, source="data sheets: 50 to 65 ms a cycle"
    )
    """Time between two firings."""

    def __post_init__(self) -> None:
        if len(self.mounted) > RANGERS:
            raise InputError(
                f"UltrasonicSettings.mounted has {len(self.mounted)} rangers; expected at most "
                f"{RANGERS}"
            )

    @property
    def firing_order(self) -> tuple[int, ...]:
        """The order of firing without rangers that are not mounted."""
        return tuple(k for k in _FIRING_ORDER if k < len(self.mounted))

    @property
    def columns(self) -> int:
        """Number of columns of a reading: 8, or the number of rangers where that is more."""
        return max(_COLUMNS, len(self.mounted))

    @property
    def models(self) -> tuple[UltrasonicModel, ...]:
        """The model of each mounted ranger."""
        return tuple(self.narrow if m.model == "narrow" else self.wide for m in self.mounted)


@settings
class OdometrySettings:
    """Errors of dead reckoning: some drawn for each episode, one that grows with the distance."""

    diameter_error: float = setting(default=0.005, low=0.0, high=0.2)
    """Largest relative difference of wheel diameters; uniform (E_d of Borenstein and Feng 1996)."""
    track_error: float = setting(default=0.01, low=0.0, high=0.2)
    """Largest relative error of the track; uniform (E_b of Borenstein and Feng 1996)."""
    variance: float = setting(default=1e-6, unit="m2/m", low=0.0, high=1.0)
    """Variance of each wheel's path per metre."""


POSE_MAX = 0.10, 0.10, math.radians(3.0)  # m, m, rad: largest error of a modelled pose


@settings
class ModelledPose:
    """An error model of a localiser: a clipped first-order Markov process.

    Defaults are those of `mcl` on maps that `slam` drew: python -m tests.benchmarks.poses.
    """

    position: float = setting(default=0.02, unit="m", low=0.0, source=_MEASURED)
    """Standard deviation of x and of y."""
    heading: float = setting(default=math.radians(0.4), unit="rad", low=0.0, source=_MEASURED)
    """Standard deviation of the heading."""
    time: float = setting(default=10.0, unit="s", low=0.01, source=_MEASURED)
    """Correlation time of the errors."""


@settings
class FaultSettings:
    """Sensors that fail at a time drawn evenly, for the rest of an episode.

    Laser, ultrasonics or wheel encoders are silent or frozen, or the laser deceives: late scans,
    the last few again and again, a standing mirror, a blind sector, mirrored, turned or moved.
    """

    share: float = setting(default=0.0, low=0.0, high=1.0)
    """Share of episodes with a fault."""
    onset: Range[float] = setting(default=(1.0, 5.0), unit="s", low=0.0)
    """Bounds of the time at which a fault begins."""


@settings
class SensorSettings:
    """Every sensor of the chair."""

    laser: LaserSettings = LaserSettings()
    more_lasers: tuple[LaserSettings, ...] = setting(default=())
    """Further planar scanners, such as one at the back, or a depth camera's fan of few beams.
    Readings hold their ranges after those of `laser`."""
    ultrasonic: UltrasonicSettings = UltrasonicSettings()
    odometry: OdometrySettings = OdometrySettings()
    modelled: ModelledPose = ModelledPose()
    faults: FaultSettings = FaultSettings()
    pose_source: PoseSource = setting(default="truth")
    """Source of the chair's pose: the truth, dead reckoning, a model of a localizer,
    Monte Carlo localization or SLAM."""
    noise: bool = setting(default=True)
    """False: exact ranges, no lost echoes, no ghosts, exact parameters of odometry."""

    def __post_init__(self) -> None:
        if len(self.more_lasers) >= SCANNERS:
            raise InputError(
                f"SensorSettings.more_lasers has {len(self.more_lasers)} scanners; expected at most"
                f" {SCANNERS - 1}"
            )
        if self.more_lasers and not all(laser.beams for laser in (self.laser, *self.more_lasers)):
            raise InputError(
                "SensorSettings.more_lasers: expected beams of each scanner, `laser` included"
            )
        if not self.laser.beams and self.localizes:
            raise InputError(
                f"SensorSettings.pose_source is {self.pose_source!r}; it needs a laser, and "
                "laser.beams is 0"
            )

    @property
    def lasers(self) -> tuple[LaserSettings, ...]:
        """All scanners, in the order in which a reading holds their ranges; () without any."""
        return (self.laser, *self.more_lasers) if self.laser.beams else ()

    @property
    def looks_back(self) -> bool:
        """Whether a further scanner shows what is free straight behind the chair."""
        return any(
            laser.shows_free and abs(math.remainder(math.pi - laser.yaw, math.tau)) < laser.fov / 2
            for laser in self.lasers[1:]
        )

    @property
    def beams(self) -> int:
        """Number of ranges in a reading: the beams of all scanners."""
        return sum(laser.beams for laser in self.lasers)

    @property
    def slices(self) -> tuple[slice, ...]:
        """Slices of a reading with the ranges of each scanner."""
        ends = list(itertools.accumulate(laser.beams for laser in self.lasers))
        return tuple(slice(b - laser.beams, b) for laser, b in zip(self.lasers, ends, strict=True))

    @property
    def directions(self) -> Array:
        """Cosine and sine of each beam of all scanners in the chair's frame (beams, 2)."""
        return np.concatenate([np.empty((0, 2)), *(laser.directions for laser in self.lasers)])

    @property
    def localizes(self) -> bool:
        """Whether the pose comes from what the chair sees, and not from the chair itself."""
        return self.pose_source in ("mcl", "slam")

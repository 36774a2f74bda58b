"""Settings of the chair's body, motors and battery, and of the physics that moves them."""

from __future__ import annotations

from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.kinematics import DriveGeometry, Limits

GRAVITY = 9.81  # m/s2


@settings
class BodySettings:
    """Mass and what it stands on."""

    mass: float = setting(
        default=135.0, unit="kg", low=20.0, high=400.0, source="60 kg chair + 75 kg person"
    )
    centre_of_mass: float = setting(
        default=0.15, unit="m", low=0.0, high=0.5, source="centre of mass ahead of the axle"
    )
    radius_of_gyration: float = setting(
        default=0.33,
        unit="m",
        low=0.05,
        high=1.0,
        source="radius of gyration: 1.00 m x 0.62 m plate",
    )
    wheelbase: float = setting(
        default=0.48, unit="m", low=0.1, high=1.5, source="ahead of the axle"
    )
    caster_track: float = setting(default=0.46, unit="m", low=0.0, high=1.0, source="between them")
    caster_drag: float = setting(
        default=0.03, low=0.0, high=1.0, source="rolling and swivelling, share of their load"
    )
    rolling_resistance: float = setting(
        default=0.015, low=0.0, high=1.0, source="rolling resistance of pneumatic tyres"
    )
    friction: float = setting(default=0.7, low=0.05, high=2.0, source="tyre on floor")
    wall_friction: float = setting(default=0.3, low=0.0, high=2.0, source="outline on wall")
    bumper_force: float = setting(default=20.0, unit="N", low=0.0, source="strip switches")

    def __post_init__(self) -> None:
        if self.centre_of_mass >= self.wheelbase:
            raise InputError("BodySettings.centre_of_mass must lie behind the casters (wheelbase)")


@settings
class MotorSettings:
    """Two equal hub motors with their drivers, as brushed direct-current machines."""

    torque_constant: float = setting(
        default=3.7, unit="V s/rad", low=0.01, source="1.6 m/s at 36 V without load"
    )
    resistance: float = setting(default=1.0, unit="ohm", low=0.01)
    current_limit: float = setting(default=12.0, unit="A", low=0.1, source="driver's limit: 44 N m")
    inertia: float = setting(default=0.15, unit="kg m2", low=0.001, source="rotor and wheel")
    kp: float = setting(default=40.0, unit="V s/m", low=0.0, source="closed loop of about 50 ms")
    ki: float = setting(default=120.0, unit="V/m", low=0.0)
    kd: float = setting(default=0.0, unit="V s2/m", low=0.0)
    ka: float = setting(
        default=3.0, unit="V s2/m", low=0.0, source="feed-forward of acceleration: 135 kg"
    )
    filter_time: float = setting(
        default=0.02, unit="s", low=0.0, high=1.0, source="low-pass of the encoder's speed"
    )
    control_rate: float = setting(
        default=100.0, unit="Hz", low=10.0, high=2000.0, source="speed control"
    )


@settings
class BatterySettings:
    """Two 36 V, 4 Ah packs in parallel."""

    capacity: float = setting(default=288.0, unit="Wh", low=1.0, source="2 x 36 V x 4 Ah")
    full_voltage: float = setting(
        default=42.0, unit="V", low=1.0, source="10 lithium cells at 4.2 V"
    )
    empty_voltage: float = setting(
        default=30.0, unit="V", low=1.0, source="10 lithium cells at 3.0 V"
    )
    initial_charge: float = setting(default=0.9, low=0.0, high=1.0, source="share at reset")
    resistance: float = setting(default=0.1, unit="ohm", low=0.0)
    idle_power: float = setting(default=15.0, unit="W", low=0.0, source="computer and sensors")
    regeneration: float = setting(
        default=0.5, low=0.0, high=0.95, source="share of braking energy stored"
    )


@settings
class RandomSettings:
    """Chair parameters drawn anew each episode, uniform within these bounds."""

    mass: tuple[float, float] = setting(
        default=(100.0, 180.0), unit="kg", low=20.0, source="ISO 7176-11 dummies"
    )
    friction: tuple[float, float] = setting(default=(0.5, 0.9), low=0.05, source="wet to rubber")
    gain: tuple[float, float] = setting(default=(0.9, 1.1), low=0.1, source="of the motors")


@settings
class ChairSettings:
    """The chair: outline, drive, limits, body, motors, battery."""

    footprint: Footprint = Footprint()
    drive: DriveGeometry = DriveGeometry()
    limits: Limits = Limits()
    body: BodySettings = BodySettings()
    motor: MotorSettings = MotorSettings()
    battery: BatterySettings = BatterySettings()
    random: RandomSettings = RandomSettings()
    randomize: bool = setting(
        default=False, source="true: draw mass, friction and motor gain anew each episode"
    )

    @property
    def grip(self) -> float:
        """What its tyres hold together [m/s2], on the slipperiest floor that it is told of."""
        body = self.body
        friction = min(self.random.friction) if self.randomize else body.friction
        return friction * GRAVITY * (1.0 - body.centre_of_mass / body.wheelbase)

    @property
    def braking(self) -> float:
        """The deceleration [m/s2] that tyres and motors are sure to reach, on level ground."""
        motor, radius = self.motor, self.drive.wheel_radius
        mass = max(self.random.mass) if self.randomize else self.body.mass
        gain = min(self.random.gain) if self.randomize else 1.0
        force = 2.0 * gain * motor.torque_constant * motor.current_limit / radius
        return min(self.grip, force / (mass + 2.0 * motor.inertia / radius**2))

    @property
    def following_lag(self) -> float:
        """How much later [s] the heaviest chair it is told of follows than its feed-forward says.

        What that does not give of the volts for an acceleration, an error of speed has to.
        """
        motor = self.motor
        mass = max(self.random.mass) if self.randomize else self.body.mass
        gain = min(self.random.gain) if self.randomize else 1.0
        pull = 2.0 * gain * motor.torque_constant / (motor.resistance * self.drive.wheel_radius)
        missing = max(0.0, mass / pull - motor.ka)  # V s2/m
        return missing / motor.kp if motor.kp > 0.0 else 0.0

    @property
    def turn_braking(self) -> float:
        """The turn acceleration [rad/s2] that tyres and motors are sure to reach."""
        square = self.body.radius_of_gyration**2 + self.body.centre_of_mass**2
        return 0.5 * self.drive.track * self.braking / square


@settings
class PeopleSettings:
    """How people move: optimal reciprocal collision avoidance, and legs of limited force."""

    decision_period: float = setting(
        default=0.1, unit="s", low=0.01, high=1.0, source="between two choices of a velocity"
    )
    horizon: float = setting(
        default=2.0, unit="s", low=0.1, high=10.0, source="kept clear of people and chair: RVO2"
    )
    wall_horizon: float = setting(
        default=0.5, unit="s", low=0.05, high=10.0, source="kept clear of walls"
    )
    neighbour_distance: float = setting(
        default=4.0, unit="m", low=0.5, high=20.0, source="farther people are not heeded"
    )
    inattentive_distance: float = setting(
        default=1.0,
        unit="m",
        low=0.0,
        high=20.0,
        source="who pays no attention sees a chair so near: a step away",
    )
    relaxation_time: float = setting(
        default=0.3, unit="s", low=0.02, source="to take up a velocity: below a step's time"
    )
    max_force: float = setting(
        default=200.0,
        unit="N",
        low=1.0,
        source="75 kg at 2.7 m/s2: 1.34 m/s in 0.5 s (Helbing and Molnar 1995)",
    )


@settings
class PhysicsSettings:
    """How finely time is cut, and how people move."""

    step: float = setting(default=0.01, unit="s", low=0.0005, high=0.05, source="ten in a period")
    people: PeopleSettings = PeopleSettings()


def integer_ratio(long: float, short: float, names: str) -> int:
    """How many short periods fit into a long one.

    Raises:
        InputError: the ratio is not a whole number of at least 1.
    """
    ratio = long / short
    if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-6:
        raise InputError(f"{names}: {long:g} s is not a whole multiple of {short:g} s")
    return round(ratio)

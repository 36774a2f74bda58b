"""Settings of the chair's body, motors and battery, and of the physics that moves them."""

from wheelchair_gym.base.settings import InputError, Range, setting, settings
from wheelchair_gym.engine import GRAVITY
from wheelchair_gym.geometry.kinematics import DriveGeometry, Limits
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.sim.randomization import JointRandomization, Randomization, RandomizedName

WHEEL_INERTIA = 0.15  # kg m2, of rotor and wheel


@settings
class BodySettings:
    """Mass and what it stands on."""

    mass: float = setting(
        default=135.0, unit="kg", low=20.0, high=400.0, source="60 kg chair and 75 kg person"
    )
    """Mass of chair and person."""
    centre_of_mass: float = setting(
        default=0.15, unit="m", low=0.0, high=0.5, source="most weight rests on the drive wheels"
    )
    """Distance of the centre of mass ahead of the drive axle."""
    radius_of_gyration: float = setting(
        default=0.33, unit="m", low=0.05, high=1.0, source="a plate of 1.00 m x 0.62 m"
    )
    """Radius of gyration about the centre of mass."""
    wheelbase: float = setting(default=0.48, unit="m", low=0.1, high=1.5)
    """Distance of the casters ahead of the drive axle."""
    friction: float = setting(default=0.7, low=0.05, high=2.0, source="tyre on floor")
    """Coefficient of friction between tyre and floor."""
    rolling_resistance: float = setting(default=0.015, low=0.0, high=0.5, source="pneumatic tyres")
    """Resistance of the drive wheels to rolling, as a share of their load."""
    caster_drag: float = setting(default=0.03, low=0.0, high=0.5)
    """Resistance of the casters to rolling and swivelling, as a share of their load."""
    bumper_force: float = setting(default=20.0, unit="N", low=0.0, source="strip switches")
    """Force from which a bumper strip counts as pressed."""

    def __post_init__(self) -> None:
        if self.centre_of_mass >= self.wheelbase:
            raise InputError("BodySettings.centre_of_mass must lie behind the casters (wheelbase)")


@settings
class MotorSettings:
    """Two equal hub motors with their drivers, as brushed direct-current machines."""

    torque_constant: float = setting(
        default=3.7, unit="V s/rad", low=0.01, source="1.6 m/s at 36 V without load"
    )
    """Torque constant at the wheel, and back electromotive force per turn rate."""
    gain: float = setting(default=1.0, low=0.1, high=10.0, source="loss-free motors")
    """Torque over that of `torque_constant`: losses, and magnets other than specified."""
    resistance: float = setting(default=1.0, unit="ohm", low=0.01, high=100.0)
    """Resistance of a motor with its driver."""
    feed_constant: float | None = setting(default=None, unit="V s/rad", low=0.0)
    """Torque constant that the board's feed-forward assumes; None: `torque_constant`."""
    current_limit: float = setting(
        default=12.0, unit="A", low=0.1, source="driver of the prototype: 44 N m"
    )
    """Largest current of a motor."""
    kp: float = setting(default=40.0, unit="V s/m", low=0.0, source="tuned: loop of about 50 ms")
    """Proportional gain of the speed control."""
    ki: float = setting(default=120.0, unit="V/m", low=0.0)
    """Integral gain of the speed control."""
    kd: float = setting(default=0.0, unit="V s2/m", low=0.0)
    """Derivative gain of the speed control."""
    ka: float = setting(default=3.0, unit="V s2/m", low=0.0, source="computed for 135 kg")
    """Feed-forward of the acceleration."""
    filter_time: float = setting(default=0.02, unit="s", low=0.0, high=1.0)
    """Time constant of the low-pass on the measured wheel speed."""
    control_rate: float = setting(default=100.0, unit="Hz", low=10.0, high=2000.0)
    """Frequency of the speed control."""

    @property
    def believed_constant(self) -> float:
        """The torque constant [V s/rad] of the feed-forward."""
        return self.torque_constant if self.feed_constant is None else self.feed_constant


@settings
class BatterySettings:
    """Two 36 V, 4 Ah packs in parallel."""

    capacity: float = setting(default=288.0, unit="Wh", low=1.0, source="two packs of 36 V, 4 Ah")
    """Energy of the full battery."""
    full_voltage: float = setting(default=42.0, unit="V", low=1.0, source="10 Li cells of 4.2 V")
    """Open-circuit voltage of the full battery."""
    empty_voltage: float = setting(default=30.0, unit="V", low=1.0, source="10 Li cells of 3.0 V")
    """Open-circuit voltage of the empty battery."""
    initial_charge: float = setting(default=0.9, low=0.0, high=1.0)
    """Share of the capacity that is left at reset."""
    idle_power: float = setting(default=15.0, unit="W", low=0.0)
    """Power of computer and sensors."""
    regeneration: float = setting(default=0.5, low=0.0, high=0.95)
    """Share of the braking energy that is stored."""

    def __post_init__(self) -> None:
        if self.empty_voltage > self.full_voltage:
            raise InputError(
                f"BatterySettings.empty_voltage is {self.empty_voltage:g} V; expected at most "
                f"full_voltage, {self.full_voltage:g} V"
            )


@settings
class RandomSettings:
    """Chair parameters drawn for each episode, uniform within these bounds."""

    mass: Range[float] = setting(
        default=(100.0, 180.0), unit="kg", low=20.0, source="ISO 7176-11 dummies"
    )
    """Bounds of the mass."""
    friction: Range[float] = setting(default=(0.5, 0.9), low=0.05, source="wet floor to dry rubber")
    """Bounds of the friction between tyre and floor."""
    gain: Range[float] = setting(default=(0.9, 1.1), low=0.1)
    """Bounds of the motors' gain."""


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
    randomize: bool = setting(default=False)
    """True: mass, friction and motor gain are drawn for each episode."""
    randomization: tuple[Randomization, ...] = setting(default=())
    """Quantities that are drawn for each episode, each by itself, whatever `randomize` is."""
    joint: JointRandomization = JointRandomization()
    command_delay: float = setting(default=0.0, unit="s", low=0.0, high=1.0)
    """Delay from a command to its effect in simulation, rounded to whole physics steps."""

    def __post_init__(self) -> None:
        named = [*(row.quantity for row in self.randomization), *self.joint.quantities]
        for k, name in enumerate(named):
            if name in named[:k]:
                raise InputError(f"randomization names {name} twice")

    def bounds(self, quantity: RandomizedName, low: float, high: float) -> tuple[float, float]:
        """The least and the greatest value of a quantity in any episode.

        `low` and `high` are its bounds where no row of `randomization` or `joint` names it.
        """
        rows = [row.bounds for row in self.randomization if row.quantity == quantity]
        if quantity in self.joint.quantities:
            rows.append(self.joint.bounds(quantity))
        return rows[0] if rows else (low, high)

    @property
    def longest_delay(self) -> float:
        """The longest delay [s] from a command to its effect in any episode."""
        return self.bounds("command_delay", self.command_delay, self.command_delay)[1]

    @property
    def max_mass(self) -> float:
        """The mass [kg] of the heaviest chair of the settings."""
        mass = max(self.random.mass) if self.randomize else self.body.mass
        return self.bounds("body.mass", mass, mass)[1]

    @property
    def min_gain(self) -> float:
        """The motor gain of the weakest chair of the settings."""
        drawn = min(self.random.gain) if self.randomize else 1.0
        return drawn * self.bounds("motor.gain", self.motor.gain, self.motor.gain)[0]

    @property
    def grip(self) -> float:
        """The acceleration [m/s2] that its tyres hold on the least rough floor of the settings."""
        body = self.body
        friction = min(self.random.friction) if self.randomize else body.friction
        return friction * GRAVITY * (1.0 - body.centre_of_mass / body.wheelbase)

    @property
    def braking(self) -> float:
        """The deceleration [m/s2] that tyres and motors are sure to reach, on level ground."""
        motor, radius = self.motor, self.drive.wheel_radius
        force = 2.0 * self.min_gain * motor.torque_constant * motor.current_limit / radius
        return min(self.grip, force / (self.max_mass + 2.0 * WHEEL_INERTIA / radius**2))

    @property
    def following_lag(self) -> float:
        """Delay [s] of the heaviest chair of the settings behind its feed-forward.

        What that does not give of the volts for an acceleration, an error of speed has to.
        """
        motor = self.motor
        ohm = self.bounds("motor.resistance", motor.resistance, motor.resistance)[1]
        pull = 2.0 * self.min_gain * motor.torque_constant / (ohm * self.drive.wheel_radius)
        missing = max(0.0, self.max_mass / pull - motor.ka)  # V s2/m
        return missing / motor.kp if motor.kp > 0.0 else 0.0

    @property
    def turn_braking(self) -> float:
        """The turn acceleration [rad/s2] that tyres and motors are sure to reach."""
        square = self.body.radius_of_gyration**2 + self.body.centre_of_mass**2
        return 0.5 * self.drive.track * self.braking / square


@settings
class PhysicsSettings:
    """Length of a step, and the floor."""

    step: float = setting(
        default=0.01, unit="s", low=0.0005, high=0.05, source="ten in a control period"
    )
    """Physics step."""
    slope: float = setting(default=0.0, unit="rad", low=-0.3, high=0.3, source="a level floor")
    """Angle of the floor to the horizontal."""
    downhill: float = setting(default=0.0, unit="rad", low=-6.3, high=6.3)
    """Direction in the world in which a sloping floor falls."""


def integer_ratio(long: float, short: float, names: str) -> int:
    """Return the number of short periods in a long one.

    Raises:
        InputError: the ratio is not an integer of at least 1.
    """
    ratio = long / short
    if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-6:
        raise InputError(f"{names}: {long:g} s is not an integer multiple of {short:g} s")
    return round(ratio)

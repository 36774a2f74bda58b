"""The simulated chair under motors that the firmware drives: the same physics, one step at a time.

Inputs are the two duties, whether each motor's circuit is closed, the torque of the spring brakes,
and external forces (a slope, a person).
"""

from __future__ import annotations

import dataclasses
import math
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.actors.bodies import shapes_of, write_actor_shapes
from wheelchair_gym.actors.separation import move_the_others
from wheelchair_gym.base.settings import InputError, dotted, dump, load, read_json
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.engine import GRAVITY, body_view
from wheelchair_gym.hardware.settings import check_boards
from wheelchair_gym.sensors.laser import sense_laser
from wheelchair_gym.sensors.settings import OdometrySettings, SensorSettings
from wheelchair_gym.sensors.ultrasonic import sense_ultrasonic
from wheelchair_gym.sim.chair import SimulatedChair
from wheelchair_gym.sim.drive_train import DriveConstants, drive_constants, physics_step, pull_body
from wheelchair_gym.sim.randomization import JointRandomization
from wheelchair_gym.sim.settings import ChairSettings, PhysicsSettings
from wheelchair_gym.sim.state import ranger_of, scanner_of
from wheelchair_gym.sim.step import chair_row, prepare_step, read_true_state, workspace_of
from wheelchair_gym.types import Episode

TIME_STEP = 0.001  # s: of the physics and of the lock step


# Torque of each spring brake at its wheel [N m]: stops 180 kg at 1.5 m/s2 or more.
BRAKE_TORQUE = 32.0


class Motion(NamedTuple):
    """Motion of the chair that the boards can measure."""

    left: float  # encoder counts, with their fraction
    right: float
    battery: float  # V
    speed: float  # m/s, true
    turn: float  # rad/s, true
    bumped: bool  # a strip was pressed hard enough in this step


class Slope(NamedTuple):
    """A floor that is not level."""

    angle: float  # rad, to the horizontal
    downhill: float = 0.0  # rad: the direction in the world in which it falls

    @property
    def pull(self) -> tuple[float, float]:
        """Acceleration (x, y) [m/s2] of a chair that rolls freely."""
        along = GRAVITY * math.sin(self.angle)
        return along * math.cos(self.downhill), along * math.sin(self.downhill)


@borrowing_kernel
def brake_impulses(
    state: Any, p: Any, k: DriveConstants, forward: float, aside: float, turn: float, maximum: float
) -> tuple[float, float]:
    """Impulses [N s] at the left and right rim with which closed spring brakes hold their wheels.

    A brake is dry friction: the impulses bring the chair to rest in this step, but none exceeds
    `maximum`. The speeds are those of the centre of mass, along the heading and to its left.
    """
    half = 0.5 * p.track
    left = k.inertia[0] * k.radii[0] * state.spin[0]
    right = k.inertia[1] * k.radii[1] * state.spin[1]
    along = p.mass * forward + left + right
    about = p.moment * turn + p.mass * p.body.centre_of_mass * aside + half * (right - left)
    left, right = 0.5 * (along - about / half), 0.5 * (along + about / half)
    return min(maximum, max(-maximum, left)), min(maximum, max(-maximum, right))


@borrowing_kernel
def step_plant(
    chairs: Any,
    left: float,
    right: float,
    closed: tuple[bool, bool],
    brake: float,
    held: tuple[bool, bool],
    pull: tuple[float, float],
    force: float,
) -> tuple[float, float, float, float, float, bool]:
    """One physics step of the first of CHAIRS under given duties; the fields of `Motion`.

    `pull` is the acceleration (x, y) [m/s2] by gravity on a slope, at the centre of mass. The load
    of the tyres is that of level ground: 1 % more than on 8 degrees. See `Plant.step` for the rest.
    """
    suite, p, state, world = chair_row(chairs, 0)
    k = drive_constants(p)
    fields = body_view(world.body)
    before = (fields.x, fields.y, fields.vx, fields.vy, fields.w)
    bump, space = prepare_step(suite, world, state, p, before, workspace_of(chairs))
    c, s = math.cos(state.pose[2]), math.sin(state.pose[2])
    x, y = pull[0] + p.pull[0], pull[1] + p.pull[1]
    pull_body(fields, p.dt, x + c * force / p.mass, y + s * force / p.mass)
    forward, aside = c * fields.vx + s * fields.vy, c * fields.vy - s * fields.vx
    maximum = brake * p.dt * k.per_radius[0]
    taken = brake_impulses(state, p, k, forward, aside, fields.w, maximum)
    for i in range(2):
        # A brake slows the wheel, and then the tyre slows the chair; until then the wheel turns
        # as the chair moves, by its speed before.
        slower = taken[i] / (k.inertia[i] * k.radii[i])
        state.spin[i] -= slower
        state.turned[i] += slower * p.dt
        # An open motor draws no current: its voltage is its own back-EMF. Nor does a shorted one
        # that its brake holds.
        free = p.motor.torque_constant * state.spin[i] / state.voltage
        duty = left if i == 0 else right
        rests = duty == 0.0 and abs(taken[i]) < maximum
        state.duty[i] = duty if closed[i] and not rests else free
        if held[i]:
            state.spin[i], state.duty[i] = 0.0, 0.0
    hit = physics_step(state, p, k, space, world.body, suite.step)
    state.tick += 1
    if world.n_actors > 0:
        move_the_others(world, p.dt)
    read_true_state(state, p, fields)
    counts = state.turned[0] * k.counts_per_rad, state.turned[1] * k.counts_per_rad
    bumped = max(hit, bump) > p.body.bumper_force * p.dt
    return counts[0], counts[1], state.voltage, state.twist[0], state.twist[1], bumped


@inlined
def present_shapes(world: Any) -> Any:
    """Walls (n, 4) and discs (m, 3) of a world, with those of actors where they are now."""
    if world.n_actors > 0:
        write_actor_shapes(world)
    return shapes_of(world)


@borrowing_kernel
def measure_ultrasonic(chairs: Any, which: int) -> float:
    """The range [m] of one ultrasonic at the chair's present pose; +inf without echo."""
    suite, p, state, world = chair_row(chairs, 0)
    walls, discs = present_shapes(world)
    ranger, sigma, workspace = ranger_of(suite, which), p.ranger_sigma[which], workspace_of(chairs)
    return sense_ultrasonic(
        ranger, sigma, state.pose, walls, discs, state.key, state.tick, workspace
    )


@borrowing_kernel
def scan_laser(chairs: Any, which: int, turn: int, ranges: Any) -> None:
    """Write the ranges [m] of one turn of a laser at the chair's present pose."""
    suite, p, state, world = chair_row(chairs, 0)
    walls, discs = present_shapes(world)
    laser, workspace = scanner_of(suite, p, which), workspace_of(chairs)
    sense_laser(laser, state.pose, walls, discs, state.key, turn, workspace, ranges)


# What emulated boards on a simulated chair do not have.
_COMMANDS = "commands reach the emulated boards at once"
_ENCODERS = "the twin's encoders count exactly"
_FAULTS = "inject faults by the twin's own lines"
_ABSENT = {"command_delay": _COMMANDS, "odometry.variance": _ENCODERS}
_VARIANCE = OdometrySettings().variance  # the default is no wish
# Settings of `--plant`: those that are the chair's own and not its computer's, by pattern.
_OWN = (
    "chair.body.*", "chair.drive.*", "chair.motor.torque_constant", "chair.motor.gain",
    "chair.motor.resistance", "chair.motor.current_limit", "chair.battery.*", "chair.footprint.*",
    "chair.random.*", "chair.randomize", "chair.randomization", "chair.joint.*", "sensors.noise",
    "sensors.laser.*", "sensors.more_lasers", "sensors.ultrasonic.mounted",
    "sensors.ultrasonic.narrow.*", "sensors.ultrasonic.wide.*", "sensors.odometry.diameter_error",
    "sensors.odometry.track_error", "physics.slope", "physics.downhill",
)  # fmt: skip


def check_twin(chair: ChairSettings, sensors: SensorSettings) -> None:
    """Refuse settings that the twin does not carry out.

    Raises:
        InputError: the first of them, and why.
    """
    check_boards(sensors)
    if chair.command_delay:
        raise InputError(f"chair.command_delay is {chair.command_delay:g}; {_COMMANDS}")
    if sensors.faults.share:
        raise InputError(f"sensors.faults.share is {sensors.faults.share:g}; {_FAULTS}")
    if sensors.noise and sensors.odometry.variance not in (0.0, _VARIANCE):
        raise InputError(f"sensors.odometry.variance: {_ENCODERS}; expected {_VARIANCE:g}")
    for name in (*(row.quantity for row in chair.randomization), *chair.joint.quantities):
        if name in _ABSENT:
            raise InputError(f"chair.randomization draws {name}; {_ABSENT[name]}")


class PlantSettings(NamedTuple):
    """A chair as it is, whatever its computer believes."""

    chair: ChairSettings
    sensors: SensorSettings
    physics: PhysicsSettings

    @classmethod
    def read(cls, file: Any, believed: Any) -> PlantSettings:
        """Read sections chair, sensors and physics, or a JSON file of them, over believed settings.

        Beside noise, nothing is drawn, such as errors of wheels, unless the file says so.

        Raises:
            InputError: the file cannot be read, or sets something that the chair's computer or
                boards decide, or that the twin does not carry out.
        """
        named = isinstance(file, str | Path)
        content, file = (read_json(file), file) if named else (file, "the plant")
        if not isinstance(content, dict) or (unknown := set(content) - set(cls._fields)):
            given = "no object" if not isinstance(content, dict) else f"the key {min(unknown)}"
            raise InputError(f"{file} has {given}; expected chair, sensors or physics")
        exact = dataclasses.replace(believed.sensors.odometry, diameter_error=0.0, track_error=0.0)
        sensors = dataclasses.replace(believed.sensors, odometry=exact)
        chair = dataclasses.replace(
            believed.chair, randomize=False, randomization=(), joint=JointRandomization()
        )
        believed = cls(chair, sensors, believed.physics)
        parts: Any = [
            load(type(base), content.get(name, {}), f"{file}.{name}", base)
            for name, base in believed._asdict().items()
        ]
        found = cls(*parts)
        before = dotted(dump(believed._asdict()))
        for key, value in dotted(dump(found._asdict())).items():
            if value != before.get(key) and not any(fnmatch(key, own) for own in _OWN):
                raise InputError(
                    f"{file} sets {key}, which the chair's computer decides, not the chair: set "
                    "it in --config"
                )
        check_twin(found.chair, found.sensors)
        return found


class Plant:
    """A chair in a world, driven by given duties of its motors.

    Args:
        chair: its settings.
        sensors: its sensors; their offsets are added to the ranges, as real scanners add them.
        physics: the floor; its step is replaced by TIME_STEP.

    Raises:
        InputError: a setting that the twin does not carry out.
    """

    def __init__(
        self,
        chair: ChairSettings | None = None,
        sensors: SensorSettings | None = None,
        physics: PhysicsSettings | None = None,
    ) -> None:
        chair, sensors = chair or ChairSettings(), sensors or SensorSettings()
        check_twin(chair, sensors)
        physics = dataclasses.replace(physics or PhysicsSettings(), step=TIME_STEP)
        self.chair = SimulatedChair(chair, sensors, physics)
        for k, laser in enumerate(sensors.lasers):
            self.chair.chairs.base["laser_offset"][0, k] = laser.offset
        self._rows = self.chair.pointers.record

    def reset(self, episode: Episode, key: int) -> None:
        """Put the chair at the episode's start."""
        self.chair.reset(episode, key)

    def step(
        self,
        duty: tuple[float, float],
        closed: tuple[bool, bool],
        brake: float,
        held: tuple[bool, bool] = (False, False),
        slope: Slope | None = None,
        force: float = 0.0,
    ) -> Motion:
        """Advance by TIME_STEP.

        Args:
            duty: of the left and the right motor.
            closed: which motors' circuits are, by a driver, or at duty 0 by the relay's short
                circuit; an open motor turns freely. Both limit the current as the driver does.
            brake: share of the spring brakes' torque that holds the wheels; 0: they are open.
            held: wheels that something blocks.
            slope: of the floor; None: level.
            force: with which a person pushes the chair along its heading [N].
        """
        pull = slope.pull if slope else (0.0, 0.0)
        torque = brake * BRAKE_TORQUE
        return Motion._make(step_plant(self._rows, *duty, closed, torque, held, pull, force))

    def ping(self, which: int) -> float:
        """The present range of an ultrasonic [m]; +inf without echo."""
        return float(measure_ultrasonic(self._rows, which))

    def scan(self, turn: int, which: int = 0) -> NDArray[np.float32]:
        """The ranges (beams,) [m] of a turn of a laser, by its number, as in REP-117."""
        ranges = np.empty(self.chair.sensors.lasers[which].beams, np.float32)
        scan_laser(self._rows, which, turn, ranges)
        return ranges

    @property
    def pose(self) -> NDArray[np.float64]:
        """The true pose (3,) [m, m, rad]."""
        return np.array(self.chair.state["pose"][0])

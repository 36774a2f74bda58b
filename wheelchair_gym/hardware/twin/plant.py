"""The simulated chair under motors that somebody else drives: the same physics, one step at a time.

Only what the simulation leaves to its own speed control is given from outside: the two duties,
whether the drivers have power, and whether the spring brakes are closed.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.address import field_at, rows_of, table_at
from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.kernel import borrowing_kernel
from wheelchair_gym.sensing import SensorSettings
from wheelchair_gym.sensing.laser import SCRATCH, scan
from wheelchair_gym.sensing.ultrasonic import fire
from wheelchair_gym.simulation.chair import SimulatedChair
from wheelchair_gym.simulation.engine import body_view
from wheelchair_gym.simulation.motion import step_once, work_out
from wheelchair_gym.simulation.period import locate
from wheelchair_gym.simulation.rig import RIG, laser_of, rangers_of
from wheelchair_gym.simulation.settings import ChairSettings, PhysicsSettings
from wheelchair_gym.simulation.state import PARAMETER, STATE
from wheelchair_gym.simulation.world import WORLD
from wheelchair_gym.types import Episode

STEP = 0.001  # s: of the physics and of the lock step

_rigs_at, _chairs_at, _states_at, _worlds_at = map(rows_of, (RIG, PARAMETER, STATE, WORLD))


@settings
class BrakeSettings:
    """The spring brakes on the motors' axles: closed without current."""

    torque: float = setting(
        default=32.0, unit="N m", source="each; 180 kg at 1.5 m/s2 or more", low=1.0
    )


class Motion(NamedTuple):
    """What the chair's boards can sense of it."""

    left: float  # encoder counts, with their fraction
    right: float
    battery: float  # V
    speed: float  # m/s, true
    turn: float  # rad/s, true
    hit: bool  # a strip was pressed hard enough in this step


@borrowing_kernel
def push(
    alone: Any, left: float, right: float, powered: bool, brake: float, held: tuple[bool, bool]
) -> tuple[float, float, float, float, float, bool]:
    """One physics step under given duties; the fields of `Motion`.

    Args:
        alone: (1,) of ALONE, whose chair it is.
        left: duty of the left motor.
        right: duty of the right one.
        powered: false: the drivers' outputs are open, the motors turn freely.
        brake: torque of each closed spring brake [N m]; 0 where they are held open.
        held: wheels (left, right) that something blocks.
    """
    own = alone[0]
    p = _chairs_at(own.chair, 1)[0]
    state = _states_at(own.state, 1)[0]
    world = _worlds_at(own.world, 1)[0]
    rig = _rigs_at(own.rig, 1)[0]
    k = work_out(p)
    for i in range(2):
        # A brake takes from the wheel's own momentum; the tyre then takes from the chair's.
        slower = min(abs(state.spin[i]), brake * p.dt / p.wheel_inertia)
        state.spin[i] -= math.copysign(slower, state.spin[i])
        # An open motor draws nothing: its voltage is that which it makes itself.
        free = p.constant * state.spin[i] / state.voltage
        state.duty[i] = (left if i == 0 else right) if powered else free
        if held[i]:
            state.spin[i], state.duty[i] = 0.0, 0.0
    hit = step_once(state, p, k, world.space, world.body, rig.step)
    state.tick += 1
    locate(state, p, body_view(world.body))
    scale = k.counts_per_rad
    return (
        state.turned[0] * scale,
        state.turned[1] * scale,
        state.voltage,
        state.twist[0],
        state.twist[1],
        hit > p.bumper * p.dt,
    )


@borrowing_kernel
def ping(alone: Any, which: int) -> float:
    """What one ultrasonic ranges from where the chair stands now [m]; +inf without echo."""
    own = alone[0]
    state = _states_at(own.state, 1)[0]
    world = _worlds_at(own.world, 1)[0]
    return fire(
        rangers_of(_rigs_at(own.rig, 1)[0]),
        which,
        state.pose,
        table_at(world.walls, world.n_walls, 4),
        table_at(world.discs, world.n_discs, 3),
        state.key,
        state.tick,
        field_at(own.scratch, SCRATCH, own.walls),
    )


@borrowing_kernel
def look(alone: Any, turn: int, ranges: Any) -> None:
    """One turn of the laser from where the chair stands now, as it reports it [m]."""
    own = alone[0]
    state = _states_at(own.state, 1)[0]
    world = _worlds_at(own.world, 1)[0]
    scan(
        laser_of(_rigs_at(own.rig, 1)[0]),
        state.pose,
        table_at(world.walls, world.n_walls, 4),
        table_at(world.discs, world.n_discs, 3),
        state.key,
        turn,
        field_at(own.scratch, SCRATCH, own.walls),
        ranges,
    )


class Plant:
    """A chair in a world, to be pushed by motors from outside.

    Args:
        chair: body, motors, battery.
        sensors: its ultrasonics.
        brakes: its spring brakes.
    """

    def __init__(
        self,
        chair: ChairSettings | None = None,
        sensors: SensorSettings | None = None,
        brakes: BrakeSettings | None = None,
    ) -> None:
        self.chair = SimulatedChair(chair, sensors, PhysicsSettings(step=STEP))
        self.brakes = brakes or BrakeSettings()
        self._alone = self.chair.rows

    def reset(self, episode: Episode, key: int) -> None:
        """Stand at the episode's start.

        Raises:
            InputError: something moves in its world: here everything but the chair stands still.
        """
        if len(episode.movers):
            raise InputError("the twin's world holds still: expected an episode without movers")
        self.chair.reset(episode, key)

    def push(
        self,
        duty: tuple[float, float],
        powered: bool,
        braked: bool,
        held: tuple[bool, bool] = (False, False),
    ) -> Motion:
        """Move on by STEP under these duties; wheels that are held do not turn."""
        brake = self.brakes.torque if braked else 0.0
        return Motion._make(push(self._alone, *duty, powered, brake, held))

    def ping(self, which: int) -> float:
        """What an ultrasonic ranges now [m]; +inf without echo."""
        return float(ping(self._alone, which))

    def scan(self, turn: int) -> NDArray[np.float32]:
        """What the laser reports in its turn of this number (beams,) [m], REP-117."""
        ranges = np.empty(self.chair.sensors.laser.beams, np.float32)
        look(self._alone, turn, ranges)
        return ranges

    @property
    def pose(self) -> NDArray[np.float64]:
        """The true pose (3,) [m, m, rad]."""
        return np.array(self.chair.state["pose"][0])

"""The simulated chair: one world, one state, driven and sensed by the kernels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.geometry import footprint_clearance, wrap
from wheelchair_gym.sensing.laser import SCRATCH, LaserArrays
from wheelchair_gym.sensing.settings import SensorSettings
from wheelchair_gym.sensing.ultrasonic import UltrasonicArrays
from wheelchair_gym.simulation.advance import advance, begin
from wheelchair_gym.simulation.engine import STEP
from wheelchair_gym.simulation.settings import ChairSettings, PhysicsSettings
from wheelchair_gym.simulation.state import STATE, parameters
from wheelchair_gym.simulation.world import World
from wheelchair_gym.types import Episode, Reading, Truth

Array = NDArray[np.float64]

JOULES_PER_WH = 3600.0
CLEARANCE_REACH = 2.0  # m: clearances beyond this are reported as this


class SimulatedChair:
    """A chair in a pymunk world; time passes only when it is driven.

    Args:
        chair: body, motors, limits.
        sensors: what it senses and how it errs.
        physics: the physics step.
        period: control period [s], a whole number of physics steps.

    Raises:
        InputError: the periods are not whole multiples of the physics step.
    """

    def __init__(
        self,
        chair: ChairSettings | None = None,
        sensors: SensorSettings | None = None,
        physics: PhysicsSettings | None = None,
        period: float = 0.1,
    ) -> None:
        self.settings = chair or ChairSettings()
        self.sensors = sensors or SensorSettings()
        self.physics = physics or PhysicsSettings()
        self.period = period
        self._laser = LaserArrays.of(self.sensors.laser, self.sensors.noise)
        self._rangers = UltrasonicArrays.of(self.sensors.ultrasonic, self.sensors.noise)
        self._parameters = parameters(self.settings, self.sensors, self.physics, period, 0)
        self._state = np.zeros(1, STATE)
        self._world: World | None = None
        self._episode: Episode | None = None

    def reset(self, episode: Episode, key: int) -> Reading:
        """Stand at the episode's start and sense; see `Chair.reset`."""
        if episode is not self._episode:
            body = self.settings.body
            self._world = World(
                episode.walls,
                episode.discs,
                self.settings.footprint,
                body.centre,
                body.wall_friction,
            )
            self._episode = episode
            self._scratch = np.empty((SCRATCH, len(episode.walls)), np.float32)
        world = self._running()
        self._parameters = parameters(self.settings, self.sensors, self.physics, self.period, key)
        p = self._parameters[0]
        world.enter(episode.start, p["mass"], p["moment"], p["dt"])
        self._state = np.zeros(1, STATE)
        scan = self._blank()
        share = self.settings.battery.charge
        begin(
            self._state,
            self._parameters,
            world.addresses[1],
            np.uint64(key),
            share,
            self._laser,
            self._rangers,
            episode.walls,
            episode.discs,
            self._scratch,
            scan,
        )
        return self._reading(scan)

    def drive(self, twist: Array) -> Reading:
        """Drive towards a target twist (2,) [m/s, rad/s] for one control period, then sense.

        Raises:
            ValueError: the twist is not two finite numbers, or the chair was never reset.
        """
        v, w = float(twist[0]), float(twist[1])
        if not np.isfinite(v + w):
            raise ValueError(f"twist is ({v}, {w}); expected two finite numbers")
        world = self._running()
        assert self._episode is not None
        scan = self._blank()
        advance(
            self._state,
            self._parameters,
            *world.addresses,
            STEP,
            v,
            w,
            self._laser,
            self._rangers,
            self._episode.walls,
            self._episode.discs,
            self._scratch,
            scan,
        )
        return self._reading(scan)

    def close(self) -> None:
        """Let the world go."""
        self._world = self._episode = None

    @property
    def truth(self) -> Truth:
        """How things really are; see `Chair.truth`.

        Raises:
            ValueError: the chair was never reset.
        """
        if self._episode is None:
            raise ValueError("the chair was never reset, or it was closed")
        s = self._state[0]
        x, y, yaw = s["pose"]
        clearance = footprint_clearance(
            x,
            y,
            yaw,
            self.settings.footprint.array,
            self._episode.walls,
            self._episode.discs,
            CLEARANCE_REACH,
        )
        return Truth(
            pose=np.array((x, y, wrap(yaw))),
            twist=np.array(s["twist"]),
            clearance=clearance,
            contact=bool(s["contact"]),
            way=float(s["way"]),
            energy=float(s["energy"]) / JOULES_PER_WH,
        )

    @property
    def state(self) -> NDArray[np.void]:
        """The whole state (1,), a record; see `simulation.state.STATE`."""
        return np.array(self._state)

    @property
    def parameters(self) -> NDArray[np.void]:
        """The parameters (1,) of this episode, a record; see `simulation.state.PARAMETER`."""
        return np.array(self._parameters)

    def _running(self) -> World:
        if self._world is None:
            raise ValueError("the chair was never reset, or it was closed")
        return self._world

    def _blank(self) -> NDArray[np.float32]:
        # A fresh array for each reading: what was handed out is never written again.
        return np.empty(self.sensors.laser.beams, np.float32)

    def _reading(self, scan: NDArray[np.float32]) -> Reading:
        s = self._state[0]
        dt = self.physics.step
        return Reading(
            pose=s["seen_pose"].copy(),
            twist=s["seen_twist"].copy(),
            laser=scan,
            ultrasonic=s["ranges"].astype(np.float32),
            age=((s["tick"] - s["fired"]) * dt).astype(np.float32),
            bumped=bool(s["bumped"]),
            battery=float(s["voltage"]),
            stamp=float(s["tick"] * dt),
        )

"""The simulated chair: one world, one state, driven and sensed by the kernels."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.address import address_of
from wheelchair_gym.sensing.laser import SCRATCH
from wheelchair_gym.sensing.settings import SensorSettings
from wheelchair_gym.simulation.advance import ALONE, advance_alone, begin
from wheelchair_gym.simulation.rig import Rig
from wheelchair_gym.simulation.settings import ChairSettings, PhysicsSettings
from wheelchair_gym.simulation.state import SENSED, STATE, parameters
from wheelchair_gym.simulation.world import NOWHERE, WORLD, World
from wheelchair_gym.types import Belief, Episode, Reading, Truth

Array = NDArray[np.float64]
Rows = NDArray[np.void]

_STORE = 64  # records made at once


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
        self.settings = chair = chair or ChairSettings()
        self.sensors = sensors = sensors or SensorSettings()
        self.physics = physics or PhysicsSettings()
        self.period = period
        self._rig = Rig(sensors)
        self._base = parameters(chair, sensors, self.physics, period)
        self._chair = self._base.copy()
        self._blank = np.zeros(1, STATE)
        self._state = self._blank.copy()
        self._place = np.zeros(1, WORLD)
        body = chair.body
        self._world = World(chair.footprint, body.centre, body.wall_friction, self._place)
        self._beams = sensors.laser.beams
        self._kept = np.zeros(self._beams, np.float32)
        self._place["kept"] = address_of(self._kept)
        self._alone = np.zeros(1, ALONE)
        rows = {
            "rig": self._rig.record,
            "chair": self._chair,
            "state": self._state,
            "world": self._place,
        }
        for name, row in rows.items():
            self._alone[name] = address_of(row)
        self._store, self._used = np.empty(0, SENSED), 0
        self._episode: Episode | None = None
        self._moves = False  # anything beside it
        self._truth: Truth | None = None

    def reset(self, episode: Episode, key: int) -> Reading:
        """Stand at the episode's start and sense; see `Chair.reset`."""
        walls = np.ascontiguousarray(episode.walls, np.float64)
        discs = np.ascontiguousarray(episode.discs, np.float64)
        self._world.make_room(episode)
        place = self._place
        place["walls"], place["n_walls"] = address_of(walls), len(walls)
        place["discs"], place["n_discs"] = address_of(discs), len(discs)
        place["n_fixed_walls"], place["n_fixed_discs"] = len(walls), len(discs)
        place["n_movers"] = len(episode.movers)
        self._solid = walls, discs  # kept alive
        segments = len(walls)
        if len(episode.movers):
            movers = np.ascontiguousarray(episode.movers.rows)
            routes = np.ascontiguousarray(episode.movers.routes, np.float64)
            place["movers"] = address_of(movers)
            place["routes"], place["n_routes"] = address_of(routes), len(routes)
            self._moving = movers, routes  # kept alive
            segments += episode.movers.segments
        self._scratch = np.empty((SCRATCH, segments), np.float32)
        self._alone["scratch"], self._alone["walls"] = address_of(self._scratch), segments
        ranges, sensed = self._blank_reading()
        self._episode, self._moves = episode, len(episode.movers) > 0
        begin(
            0,
            self._rig.record,
            self._base,
            self._blank,
            self._chair,
            self._state,
            place,
            np.ascontiguousarray(episode.start, np.float64),
            np.uint64(key),
            self._scratch,
            ranges,
            sensed,
        )
        return self._reading(ranges, sensed)

    def drive(self, twist: Array, protective: bool = False) -> Reading:
        """See `Chair.drive`.

        Raises:
            ValueError: the twist is not two finite numbers, or the chair was never reset.
        """
        v, w = twist.tolist()
        if not math.isfinite(v + w):
            raise ValueError(f"twist is ({v}, {w}); expected two finite numbers")
        if self._episode is None:
            raise ValueError("the chair was never reset, or it was closed")
        ranges, sensed = self._blank_reading()
        advance_alone(self._alone, v, w, protective, ranges, sensed)
        return self._reading(ranges, sensed)

    def close(self) -> None:
        """Let the episode go."""
        self._episode = self._truth = None

    @property
    def truth(self) -> Truth:
        """How things really are; see `Chair.truth`.

        Raises:
            ValueError: the chair was never reset.
        """
        if self._truth is None:
            raise ValueError("the chair was never reset, or it was closed")
        return self._truth

    @property
    def belief(self) -> Belief:
        """The dead-reckoned pose; with pose source 'truth', which has no drift, the true one."""
        exact = self.sensors.pose_source == "truth"
        return Belief(np.array(self._state["seen_pose" if exact else "odometry"][0]))

    @property
    def state(self) -> Rows:
        """The whole state (1,), a record; see `simulation.state.STATE`."""
        return np.array(self._state)

    @property
    def parameters(self) -> Rows:
        """The parameters (1,) of this episode, a record; see `simulation.state.PARAMETER`."""
        return np.array(self._chair)

    @property
    def rows(self) -> Rows:
        """Where its rows lie (1,), a record of `advance.ALONE`: for who moves it by other means."""
        return self._alone

    def _blank_reading(self) -> tuple[NDArray[np.float32], Rows]:
        # Fresh memory for each reading: what was handed out is never written again. Small records
        # come from a common store, since numpy is slow to make them one by one.
        if self._used == len(self._store):
            self._store, self._used = np.empty(_STORE, SENSED), 0
        self._used += 1
        return np.empty(self._beams, np.float32), self._store[self._used - 1 : self._used]

    def _reading(self, ranges: NDArray[np.float32], sensed: Rows) -> Reading:
        told: Any = sensed.item()
        movers = self._world.poses() if self._moves else NOWHERE
        self._truth = Truth._make((*told[7:], movers))
        return Reading(told[0], told[1], ranges, *told[2:7])

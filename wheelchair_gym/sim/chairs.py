"""Simulated chairs, a row each: their state, and the worlds that they stand in.

A copy is exact: it drives on as the original does, to the bit. What cannot be copied is the memory
of the physics engine (contact caches, order of the broad phase), so a copy enters the episode anew
and drives again what was driven since the reset, without sensing: the same inputs to the same
functions. That costs a few microseconds for each control period of the episode.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.address import Pointers
from wheelchair_gym.sensors.laser import WORKSPACE_ROWS
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.fault_injection import PAST
from wheelchair_gym.sim.settings import ChairSettings, PhysicsSettings
from wheelchair_gym.sim.state import STATE, SensorSuite, parameters
from wheelchair_gym.sim.step import CHAIRS, CHAIRS_TARGETS, replay_drives
from wheelchair_gym.sim.world import TARGETS, WORLD, World
from wheelchair_gym.types import Episode

_DRIVES_RESERVED = 128  # drives recorded before memory grows

# What sensing alone writes into a state: a copy takes it as it was.
_WRITTEN_BY_SENSING = (
    "touched", "measured_counts", "measured_twist", "odometry", "pose_error", "estimated_pose",
    "ranges", "frozen_twist", "frozen_pose", "frozen_ranges", "frozen_age",
)  # fmt: skip


def size_workspace(rows: Pointers, columns: int) -> None:
    """Give a record of CHAIRS a workspace of `columns` columns (`columns_of`)."""
    workspace = np.empty((WORKSPACE_ROWS, columns), np.float32)
    rows.fill(workspace=workspace, columns=columns)


def columns_of(episode: Episode) -> int:
    """Columns of the workspace that an episode takes: for what sensors see of it, and its discs."""
    actors = episode.actors
    return max(len(episode.walls) + actors.segments, len(episode.discs) + actors.discs)


class SimulatedChairs:
    """State of n simulated chairs and their worlds, which share a control period [s].

    Attributes:
        suite: sensors and engine.
        base: (1,) of PARAMETER, before what is random is drawn.
        blank: (1,) of STATE, zero.
        parameters: (n,) of PARAMETER, of the present episodes.
        states: (n,) of STATE.
        world_rows: (n,) of WORLD.
        worlds: with the Space of each.
        episodes: that they drive in; None before the first.
        drives_left: drives for which every row has memory.

    Raises:
        InputError: the periods are not integer multiples of the physics step.
    """

    def __init__(
        self,
        chair: ChairSettings,
        sensors: SensorSettings,
        physics: PhysicsSettings,
        period: float,
        n: int = 1,
    ) -> None:
        self._chair = chair
        self.suite = SensorSuite(sensors)
        self.base = parameters(chair, sensors, physics, period)
        self.blank = np.zeros(1, STATE)
        self.parameters = np.zeros(n, self.base.dtype)
        self.states = np.zeros(n, STATE)
        self.world_rows = np.zeros(n, WORLD)
        self.episodes: list[Episode | None] = [None] * n
        fail = n if sensors.faults.share > 0.0 else 1
        self._past = np.zeros((fail, PAST * sensors.beams), np.float32)
        self._make_worlds()

    def _make_worlds(self) -> None:
        body, self.world_rows[:] = self._chair.body, np.zeros((), WORLD)
        pointers = self.pointers = Pointers(self.world_rows, TARGETS)
        self.worlds = [
            World(self._chair.footprint, body.centre_of_mass, pointers, i)
            for i in range(len(self.world_rows))
        ]
        for i, row in enumerate(self._past):
            pointers.point("past_scans", row, i)
        for world in self.worlds:
            world.reserve_drives(_DRIVES_RESERVED)
        self.drives_left = _DRIVES_RESERVED  # control periods for which every row has memory

    def row_pointers(self) -> Pointers:
        """Pointers to the rows, a record (1,) of CHAIRS; the caller adds its workspace."""
        return Pointers(np.zeros(1, CHAIRS), CHAIRS_TARGETS).fill(
            n=len(self.states), suite=self.suite, worlds=self.pointers, base=self.base,
            blank=self.blank, parameters=self.parameters, states=self.states,
        )  # fmt: skip

    def enter(self, i: int, episode: Episode) -> None:
        """Set row i's world to that of an episode."""
        self.worlds[i].reserve_shapes(episode)
        self.episodes[i] = episode
        n, m, actors = len(episode.walls), len(episode.discs), episode.actors
        self.pointers.fill(
            i, walls=episode.walls, n_walls=n, n_fixed_walls=n, discs=episode.discs, n_discs=m,
            n_fixed_discs=m, n_actors=len(actors), n_routes=len(actors.routes),
        )  # fmt: skip
        if len(actors):
            self.pointers.fill(i, actors=actors.rows, routes=actors.routes)

    def expect_drive(self) -> None:
        """Reserve memory to record one more drive of each row."""
        self.drives_left -= 1
        if self.drives_left >= 0:
            return
        capacity = self.world_rows["drives_capacity"]
        for i, world in enumerate(self.worlds):
            if capacity[i] - self.states["step"][i] <= _DRIVES_RESERVED:
                world.reserve_drives(2 * int(capacity[i]))
        self.drives_left = int((capacity - self.states["step"]).min()) - 1

    def __getstate__(self) -> dict[str, Any]:
        """All but the worlds, with what was driven in them since the reset."""
        state = self.__dict__.copy()
        del state["worlds"], state["pointers"]
        steps = enumerate(self.states["step"].tolist())
        state["drives"] = [self.pointers.array("drives", i)[:step].copy() for i, step in steps]
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make the worlds, and drive again what was driven in them.

        Raises:
            TypeError: that leads elsewhere.
        """
        driven: list[NDArray[np.float64]] = state.pop("drives")
        self.__dict__.update(state)
        self._make_worlds()
        for i, (episode, drives) in enumerate(zip(self.episodes, driven, strict=True)):
            if episode is not None:
                self._replay(i, episode, drives)
        self.drives_left = int((self.world_rows["drives_capacity"] - self.states["step"]).min())

    def _replay(self, i: int, episode: Episode, drives: NDArray[np.float64]) -> None:
        self.enter(i, episode)
        self.worlds[i].reserve_drives(max(_DRIVES_RESERVED, 2 * len(drives)))
        self.pointers.array("drives", i)[: len(drives)] = drives
        was, parameters = self.states[i : i + 1].copy(), self.parameters[i].copy()
        rows = self.row_pointers()
        size_workspace(rows, columns_of(episode))
        replay_drives(i, rows.record, episode.start, was["key"][0], len(drives))
        self.parameters[i] = parameters  # a scanner may have been moved
        now = self.states[i : i + 1]
        for name in _WRITTEN_BY_SENSING:
            now[name] = was[name]
        if any(now[name].tobytes() != was[name].tobytes() for name in STATE.names or ()):
            raise TypeError(
                f"chair {i} is not where its drives lead: it was moved by other means than `drive`,"
                " or by another release; it cannot be copied"
            )

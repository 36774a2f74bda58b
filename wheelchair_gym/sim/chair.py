"""The simulated chair: one world, one state, driven and sensed by the kernels."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array, Rows
from wheelchair_gym.compiled.second_process import compile_beside
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.signals import SENSED_READING, SENSED_TRUTH, Signal
from wheelchair_gym.sim.chairs import SimulatedChairs, columns_of, size_workspace
from wheelchair_gym.sim.settings import ChairSettings, PhysicsSettings
from wheelchair_gym.sim.state import SENSED
from wheelchair_gym.sim.step import reset_chair, step_chair
from wheelchair_gym.sim.world import NO_POSES
from wheelchair_gym.types import WHEELS, Belief, Chair, Episode, Reading, Truth

_STORE = 64  # records made at once
_COLUMNS = SENSED.names or ()


def _stand_nowhere(*settings: Any) -> None:
    """Compile a reset, for a helper process; settings are those of `SimulatedChair`."""
    nowhere: Any = None
    SimulatedChair(*settings).reset(Episode(nowhere, np.zeros(3), np.zeros(3)), 0)


class SimulatedChair(Chair):
    """A chair in a pymunk world; time passes only when it is driven.

    A copy, by `copy.deepcopy` or `pickle`, drives on as the original does, to the bit.

    Attributes:
        pointers: to its row, a record (1,) of `sim.step.CHAIRS`.
        sensed: the latest reading and the truth, a record (1,) of `sim.state.SENSED`.

    Args:
        chair: body, motors, limits.
        sensors: what it senses and how it errs.
        physics: the physics step.
        period: control period [s], an integer number of physics steps.

    Raises:
        InputError: the periods are not integer multiples of the physics step.
    """

    real_time = False

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
        self.chairs = SimulatedChairs(chair, sensors, self.physics, period)
        self._beams = sensors.beams
        self._episode: Episode | None = None
        self._moves = False  # anything beside it
        self._truth: Truth | None = None  # of the latest reading, once asked for
        self.sensed: Rows = np.empty(0, SENSED)
        self._ranges: NDArray[np.float32] = np.empty(0, np.float32)
        self._bind()

    def compile_beside(self) -> None:
        """Compile a reset in a helper process, while this one does something else."""
        settings = self.settings, self.sensors, self.physics, self.period
        compile_beside(reset_chair, _stand_nowhere, *settings)

    def _bind(self) -> None:
        """Find the rows of the only chair."""
        chairs = self.chairs
        self.pointers, self._world = chairs.row_pointers(), chairs.worlds[0]
        self._make_workspace()
        self._store, self._used = np.empty(0, SENSED), 0

    def _make_workspace(self) -> None:
        size_workspace(self.pointers, 0 if self._episode is None else columns_of(self._episode))

    def __getstate__(self) -> dict[str, Any]:
        """Settings, episode, latest reading and the chair's row; all else follows from these."""
        names = "settings", "sensors", "physics", "period", "chairs", "_beams", "_episode", "_moves"
        return {name: getattr(self, name) for name in (*names, "_truth", "sensed", "_ranges")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the state of a copy."""
        self.__dict__.update(state)
        self._bind()

    def reset(self, episode: Episode, key: int) -> Reading:
        """Stand at the episode's start and sense; see `Chair.reset`."""
        self.enter(episode)
        ranges, sensed = self._blank_reading()
        reset_chair(0, self.pointers.record, episode.start, np.uint64(key), ranges, sensed)
        self.take_step(ranges, sensed)
        return self.reading()

    def enter(self, episode: Episode) -> None:
        """Take the world of an episode, which is begun next."""
        self.chairs.enter(0, episode)
        self._episode, self._moves = episode, len(episode.actors) > 0
        self._make_workspace()

    def drive(self, twist: Array, protective: bool = False) -> Reading:
        """See `Chair.drive`.

        Raises:
            ValueError: the twist is not two finite numbers, or the chair was never reset.
        """
        v, w = twist.tolist()
        if not math.isfinite(v + w):
            raise ValueError(f"twist is ({v}, {w}); expected two finite numbers")
        self.expect_drive()
        ranges, sensed = self._blank_reading()
        step_chair(0, self.pointers.record, v, w, protective, ranges, sensed)
        self.take_step(ranges, sensed)
        return self.reading()

    def expect_drive(self) -> None:
        """Make ready for one more drive.

        Raises:
            ValueError: the chair was never reset, or it was closed.
        """
        if self._episode is None:
            raise ValueError("the chair was never reset, or it was closed")
        self.chairs.expect_drive()

    def take_step(self, ranges: NDArray[np.float32], sensed: Rows) -> None:
        """Take the scan and the record (1,) of SENSED that a drive gave; nothing changes them."""
        self._ranges, self.sensed, self._truth = ranges, sensed, None

    def close(self) -> None:
        """Release the episode."""
        self._episode = self._truth = self.chairs.episodes[0] = None

    @property
    def truth(self) -> Truth:
        """The true state; see `Chair.truth`.

        Raises:
            ValueError: the chair was never reset, or it was closed.
        """
        if self._episode is None:
            raise ValueError("the chair was never reset, or it was closed")
        if self._truth is None:
            values = self._values(SENSED_TRUTH)
            actors = self._world.actor_poses() if self._moves else NO_POSES
            self._truth = Truth(**values, actor_poses=actors)
        return self._truth

    def reading(self) -> Reading:
        """The latest reading, also of a chair that was closed since.

        Raises:
            ValueError: the chair was never reset.
        """
        values, columns = self._values(SENSED_READING), self.sensors.ultrasonic.columns
        values |= {name: values[name][:columns] for name in ("ultrasonic", "age")}
        return Reading(**values, laser=self._ranges)

    def _values(self, signals: Sequence[Signal]) -> dict[str, Any]:
        """Return signals of `sensed` by their names."""
        if not self.sensed.size:
            raise ValueError("the chair was never reset")
        values = dict(zip(_COLUMNS, self.sensed.item(), strict=True))
        return {signal.name: values[signal.column] for signal in signals}

    @property
    def belief(self) -> Belief:
        """The dead-reckoned pose; with pose source 'truth', which has no drift, the true one."""
        exact = self.sensors.pose_source == "truth"
        return Belief(np.array(self.chairs.states["estimated_pose" if exact else "odometry"][0]))

    @property
    def wheels(self) -> NDArray[np.void]:
        """See `Chair.wheels`: one report, as of the latest reading."""
        state: Any = self.chairs.states[0]
        rows = np.zeros(1, WHEELS)
        rows["stamp"] = rows["board_stamp"] = state["tick"] * self.physics.step
        rows["counts"], rows["speeds"] = state["measured_counts"], state["speed"]
        rows["duties"], rows["voltage"] = state["duty"], state["voltage"]
        rows["duty_stamp"] = rows["stamp"] - 0.5 / self.settings.motor.control_rate
        rows["set_point"] = state["v"], state["w"]
        if state["step"]:
            rows["command"] = self.chairs.pointers.array("drives", 0)[state["step"] - 1, :2]
            delay = self.chairs.parameters[0]["delay"]
            rows["age"] = self.period - delay * self.physics.step
        rows["echo"] = -1
        return rows

    @property
    def scan_stamps(self) -> tuple[float, ...]:
        """See `Chair.scan_stamps`: of the latest reading."""
        now = float(self.chairs.states["tick"][0] * self.physics.step)
        return (now,) * len(self.sensors.lasers)

    @property
    def state(self) -> Rows:
        """The state (1,), a record; see `sim.state.STATE`."""
        return np.array(self.chairs.states)

    @property
    def parameters(self) -> Rows:
        """The parameters (1,) of this episode, a record; see `sim.state.PARAMETER`."""
        return np.array(self.chairs.parameters)

    def _blank_reading(self) -> tuple[NDArray[np.float32], Rows]:
        # Fresh memory for each reading: what was handed out is never written again. Small records
        # come from a common store, since numpy is slow to make them one by one.
        if self._used == len(self._store):
            self._store, self._used = np.empty(_STORE, SENSED), 0
        self._used += 1
        return np.empty(self._beams, np.float32), self._store[self._used - 1 : self._used]

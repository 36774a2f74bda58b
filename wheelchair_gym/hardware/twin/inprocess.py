"""The twin in this process, in simulated time, and hardware chairs that drive it repeatably."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.hardware.boards.senses import BoardSensors
from wheelchair_gym.hardware.chair import HardwareChair
from wheelchair_gym.hardware.registry import check_extras
from wheelchair_gym.hardware.settings import HardwareSettings
from wheelchair_gym.hardware.twin.board import TARGETS, SerialCable, build_target
from wheelchair_gym.hardware.twin.lockstep import Twin
from wheelchair_gym.hardware.twin.plant import TIME_STEP, Plant, PlantSettings
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings
from wheelchair_gym.types import Belief, Chair, Episode, NotCopyable, Reading, Truth

if TYPE_CHECKING:
    from wheelchair_gym.envs.settings import EnvSettings


@dataclass
class _Guard:
    call: Callable[[], object]
    every: int  # steps
    due: int


class TwinClock:
    """Simulated time, which passes while somebody waits; see `control_loop.Clock`.

    Attributes:
        guards: what is called beside those who wait; without them a host has crashed.
    """

    def __init__(self, twin: Twin) -> None:
        self._twin = twin
        self.guards: list[_Guard] = []

    def now(self) -> float:
        """See `Clock.now`."""
        return self._twin.steps * TIME_STEP

    def wait(self, deadline: float, cancelled: threading.Event | None = None) -> None:
        """See `Clock.wait`."""
        end = round(deadline / TIME_STEP)
        while self._twin.steps < end and not (cancelled is not None and cancelled.is_set()):
            due = min((guard.due for guard in self.guards), default=end)
            steps = max(1, min(end, due) - self._twin.steps)
            self._twin.run(steps * TIME_STEP)
            for guard in list(self.guards):
                if self._twin.steps >= guard.due:
                    guard.due = self._twin.steps + guard.every
                    guard.call()

    def call_every(
        self, callback: Callable[[], object], interval: float, name: str
    ) -> Callable[[], None]:
        """See `Clock.call_every`."""
        every = max(1, round(interval / TIME_STEP))
        guard = _Guard(callback, every, self._twin.steps + every)
        self.guards.append(guard)

        def end() -> None:
            if guard in self.guards:
                self.guards.remove(guard)

        return end


class TwinChair:
    """A twin, its cables, and the hardware chair that drives it.

    Args:
        twin: after its reset.
        period: the control period [s].
        settings: of the hardware chair; its ports are replaced.
        believed: chair and sensors as the host knows them; None: as the twin's plant is.

    Attributes:
        chair: the hardware chair.
        drive: cable of the drive board.
        range: cable of the range board.
    """

    def __init__(
        self,
        twin: Twin,
        period: float,
        settings: HardwareSettings | None = None,
        believed: tuple[ChairSettings, SensorSettings] | None = None,
    ) -> None:
        self.twin, self.clock, plant = twin, TwinClock(twin), twin.plant.chair
        self.drive = SerialCable(twin.drive, np.random.default_rng(0))
        self.range = SerialCable(twin.range, np.random.default_rng(1))
        boards = {"twin://drive": self.drive, "twin://range": self.range}
        lasers = {f"twin://laser_{k}": laser for k, laser in enumerate(twin.lasers)}
        config = dataclasses.replace(
            settings or HardwareSettings(),
            drive_port="twin://drive", range_port="twin://range", laser_port="twin://laser_0",
            more_laser_ports=tuple(lasers)[1:],
        )  # fmt: skip

        chair, sensors = believed or (plant.settings, plant.sensors)
        now = self.clock.now
        senses = BoardSensors(
            config, sensors, chair.drive, now, lambda url: boards[url].open(), lasers.__getitem__
        )
        self.chair = HardwareChair(config, sensors, chair, period, self.clock, senses)

    def close(self) -> None:
        """Close the chair; the twin stays."""
        self.chair.close()


_STANDS_BY = 0.05  # s between two looks whether the chair must be re-armed


class EpisodeTwin(NotCopyable, Chair):
    """A hardware chair over emulated boards; a reset carries it to an episode's start.

    A person stands by who re-arms the chair when a reset waits for it. Energy is not measured.

    Args:
        settings: of the environment that drives it.
        plant: file of the chair as it is, where it differs from these settings.

    Raises:
        InputError: the extra 'hardware', a compiler or the emulator is missing, or the file is
            wrong.
    """

    def __init__(self, settings: EnvSettings, plant: str | None = None) -> None:
        check_extras("hardware")
        for target in TARGETS:
            build_target(target)
        real = PlantSettings(settings.chair, settings.sensors, settings.physics)
        if plant is not None:
            real = PlantSettings.read(plant, real)
        self._twin = Twin(Plant(*real), believed=settings.chair)
        believed = settings.chair, settings.sensors
        self._hosted = TwinChair(self._twin, 1.0 / settings.rate, settings.hardware, believed)
        self._chair, self.real_time = self._hosted.chair, False
        self._chair.on_wait = lambda line: None
        self._hosted.clock.call_every(self._stand_by, _STANDS_BY, "person")

    def _stand_by(self) -> None:
        if self._chair.waiting_for:
            self._chair.rearm()

    def reset(self, episode: Episode, key: int) -> Reading:
        """See `Chair.reset`.

        Raises:
            InputError: something moves in the episode, which the twin's boards know nothing of.
        """
        if len(episode.actors):
            raise InputError(f"{episode.name}: somebody moves there; expected a still place")
        self._twin.reset(episode, key)
        return self._chair.reset(episode, key)

    def drive(self, twist: Array, protective: bool = False) -> Reading:
        """See `Chair.drive`."""
        return self._chair.drive(twist, protective)

    def set_localized_pose(self, pose: Array) -> None:
        """See `Chair.set_localized_pose`."""
        self._chair.set_localized_pose(pose)

    @property
    def truth(self) -> Truth:
        """True pose of the chair, and for the rest the best that its sensors know."""
        return self._chair.truth._replace(pose=self._twin.plant.pose)

    @property
    def belief(self) -> Belief:
        """See `HardwareChair.belief`."""
        return self._chair.belief

    @property
    def wheels(self) -> NDArray[np.void]:
        """See `HardwareChair.wheels`."""
        return self._chair.wheels

    @property
    def scan_stamps(self) -> Sequence[float]:
        """See `HardwareChair.scan_stamps`."""
        return self._chair.scan_stamps

    @property
    def board_parameters(self) -> dict[str, dict[str, float]] | None:
        """See `HardwareChair.board_parameters`."""
        return self._chair.board_parameters

    @property
    def report(self) -> dict[str, float | str]:
        """See `HardwareChair.report`."""
        return self._chair.report

    def close(self) -> None:
        """Stop the chair and free the boards; may be called again."""
        self._chair.close()
        self._twin.close()

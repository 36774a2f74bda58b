"""The twin in this process, in simulated time, and hardware chairs that drive it repeatably."""

from __future__ import annotations

import dataclasses
import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

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
from wheelchair_gym.types import Episode, Reading, Truth

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


class _Cables:
    """Cables from a twin to a host, which believes these settings, in the twin's time."""

    def __init__(
        self, twin: Twin, settings: HardwareSettings, chair: ChairSettings, sensors: SensorSettings
    ) -> None:
        self.clock = TwinClock(twin)
        self.drive = SerialCable(twin.drive, np.random.default_rng(0))
        self.range = SerialCable(twin.range, np.random.default_rng(1))
        boards = {"twin://drive": self.drive, "twin://range": self.range}
        lasers = {f"twin://laser_{k}": laser for k, laser in enumerate(twin.lasers)}
        self.settings = dataclasses.replace(
            settings,
            drive_port="twin://drive", range_port="twin://range", laser_port="twin://laser_0",
            more_laser_ports=tuple(lasers)[1:],
        )  # fmt: skip
        self.senses = BoardSensors(
            self.settings, sensors, chair.drive, self.clock.now,
            lambda url: boards[url].open(), lasers.__getitem__,
        )  # fmt: skip


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
        plant = twin.plant.chair
        chair, sensors = believed or (plant.settings, plant.sensors)
        cables = _Cables(twin, settings or HardwareSettings(), chair, sensors)
        self.twin, self.clock = twin, cables.clock
        self.drive, self.range = cables.drive, cables.range
        self.chair = HardwareChair(
            cables.settings, sensors, chair, period, cables.clock, cables.senses
        )

    def close(self) -> None:
        """Close the chair; the twin stays."""
        self.chair.close()


_STANDS_BY = 0.05  # s between two looks whether the chair must be re-armed


class EpisodeTwin(HardwareChair):
    """A hardware chair over emulated boards; a reset carries it to an episode's start.

    A person stands by who re-arms the chair when a reset waits for it. Energy is not measured.

    Args:
        settings: of the environment that drives it.
        plant: the chair as it is, where it differs from these settings: a file, or sections.

    Raises:
        InputError: the extra 'hardware', a compiler or the emulator is missing, or the file is
            wrong.
    """

    needs_rearm = False

    def __init__(self, settings: EnvSettings, plant: Any = None) -> None:
        check_extras("hardware")
        for target in TARGETS:
            build_target(target)
        chair, sensors = settings.chair, settings.sensors
        real = PlantSettings(chair, sensors, settings.physics)
        if plant is not None:
            real = PlantSettings.read(plant, real)
        self._twin = Twin(Plant(*real), believed=chair)
        cables = _Cables(self._twin, settings.hardware, chair, sensors)
        period = 1.0 / settings.rate
        super().__init__(cables.settings, sensors, chair, period, cables.clock, cables.senses)
        self.on_wait = lambda line: None
        cables.clock.call_every(self._stand_by, _STANDS_BY, "person")

    def _stand_by(self) -> None:
        if self.waiting_for:
            self.rearm()

    def reset(self, episode: Episode | None = None, key: int = 0) -> Reading:
        """See `Chair.reset`.

        Raises:
            InputError: something moves in the episode, which the twin's boards know nothing of.
        """
        assert episode is not None
        if len(episode.actors):
            raise InputError(f"{episode.name}: somebody moves there; expected a still place")
        if not math.isnan(self._begun):  # it comes to rest before it is carried away
            super().reset()
        self._twin.reset(episode, key)
        return super().reset(episode, key)

    @property
    def truth(self) -> Truth:
        """True pose of the chair, and for the rest the best that its sensors know."""
        return super().truth._replace(pose=self._twin.plant.pose)

    def close(self) -> None:
        """Stop the chair and free the boards; may be called again."""
        super().close()
        self._twin.close()

"""The twin in this process, in simulated time, and a hardware chair that drives it repeatably."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wheelchair_gym.hardware.boards.ports import Port
from wheelchair_gym.hardware.boards.senses import BoardSensors
from wheelchair_gym.hardware.chair import HardwareChair
from wheelchair_gym.hardware.settings import HardwareSettings
from wheelchair_gym.hardware.twin.cable import SerialCable
from wheelchair_gym.hardware.twin.lockstep import Twin
from wheelchair_gym.hardware.twin.plant import TIME_STEP


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

    Attributes:
        chair: the hardware chair.
        drive: cable of the drive board.
        range: cable of the range board.
    """

    def __init__(self, twin: Twin, period: float, settings: HardwareSettings | None = None) -> None:
        self.twin, self.clock, plant = twin, TwinClock(twin), twin.plant.chair
        self.drive = SerialCable(twin.drive, np.random.default_rng(0))
        self.range = SerialCable(twin.range, np.random.default_rng(1))
        ports: dict[str, Callable[[], Port]] = {
            "drive": self.drive.open, "range": self.range.open, "laser": lambda: twin.laser
        }  # fmt: skip
        config = dataclasses.replace(
            settings or HardwareSettings(),
            drive_port="twin://drive", range_port="twin://range", laser_port="twin://laser",
        )  # fmt: skip

        def open_twin(url: str) -> Port:
            return ports[url.removeprefix("twin://")]()

        sensors, chair, now = plant.sensors, plant.settings, self.clock.now
        senses = BoardSensors(config, sensors, chair.drive, now, open_twin, open_twin)
        self.chair = HardwareChair(config, sensors, chair, period, self.clock, senses)

    def close(self) -> None:
        """Close the chair; the twin stays."""
        self.chair.close()

"""The twin in this process, in simulated time: a hardware chair that drives it, repeatably."""

from __future__ import annotations

import dataclasses
import itertools
import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wheelchair_gym.hardware.boards.ports import Port
from wheelchair_gym.hardware.boards.senses import BoardSenses
from wheelchair_gym.hardware.chair import HardwareChair
from wheelchair_gym.hardware.settings import HardwareSettings
from wheelchair_gym.hardware.twin.lockstep import Twin
from wheelchair_gym.hardware.twin.plant import STEP
from wheelchair_gym.hardware.twin.wire import WIRES, Wire

_numbers = itertools.count()


@dataclass
class _Guard:
    look: Callable[[], object]
    every: int  # steps
    due: int


class TwinClock:
    """The time of a simulated world, which passes while somebody waits; see `pacing.Clock`."""

    def __init__(self, twin: Twin) -> None:
        self._twin = twin
        self._guards: list[_Guard] = []

    def now(self) -> float:
        """See `Clock.now`."""
        return self._twin.steps * STEP

    def wait(self, until: float, gone: threading.Event | None = None) -> None:
        """See `Clock.wait`."""
        end = round(until / STEP)
        while self._twin.steps < end and not (gone is not None and gone.is_set()):
            due = min((guard.due for guard in self._guards), default=end)
            steps = max(1, min(end, due) - self._twin.steps)
            self._twin.advance(steps * STEP)
            for guard in list(self._guards):
                if self._twin.steps >= guard.due:
                    guard.due = self._twin.steps + guard.every
                    guard.look()

    def guard(self, look: Callable[[], object], interval: float, name: str) -> Callable[[], None]:
        """See `Clock.guard`."""
        every = max(1, round(interval / STEP))
        guard = _Guard(look, every, self._twin.steps + every)
        self._guards.append(guard)

        def end() -> None:
            if guard in self._guards:
                self._guards.remove(guard)

        return end


class TwinChair:
    """A twin, its wires, and the hardware chair that drives it.

    Args:
        twin: stands at an episode's start.
        period: of control [s].
        settings: of the hardware chair; its lines are replaced.

    Attributes:
        chair: drives it.
        drive: wire of the drive board.
        range: wire of the range board.
    """

    def __init__(self, twin: Twin, period: float, settings: HardwareSettings | None = None) -> None:
        self.twin, name = twin, f"in-process-{next(_numbers)}"
        self._names = f"{name}-drive", f"{name}-range"
        self.drive = WIRES[self._names[0]] = Wire(twin.drive, np.random.default_rng(0))
        self.range = WIRES[self._names[1]] = Wire(twin.range, np.random.default_rng(1))
        own = dataclasses.replace(
            settings or HardwareSettings(),
            drive=f"twin://{self._names[0]}", range=f"twin://{self._names[1]}", laser="twin",
        )  # fmt: skip
        self.clock, plant = TwinClock(twin), twin.plant.chair

        def laser(_url: str) -> Port:
            return twin.laser

        sensors, chair = plant.sensors, plant.settings
        senses = BoardSenses(own, sensors, chair.drive, self.clock.now, laser_opener=laser)
        self.chair = HardwareChair(own, sensors, chair, period, self.clock, senses)

    def close(self) -> None:
        """Let chair and wires go; the twin stays."""
        self.chair.close()
        for name in self._names:
            WIRES.pop(name, None)

"""A living person with the hand, the interface or the sight of a simulated person.

Who drives decides for themselves. What is simulated lies between an intended deflection and the
chair: tremor, spasms, weakness, the dead zone of a stick, the delay of switches, or the scan that a
single switch stops (`wheelchair_gym.people.drivers.step`); and between the world and the
eyes: what is not shown, so that nobody can see it.
"""

from functools import partial
from typing import Any, Final

import numpy as np

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.compiled.random import DRIVERS as CHANNEL
from wheelchair_gym.compiled.random import uniform
from wheelchair_gym.people.drivers.intention import NOTICED
from wheelchair_gym.people.drivers.settings import Driver, Perception, Scanning
from wheelchair_gym.people.drivers.state import SECTORS, STICK, driver_row, signals_of
from wheelchair_gym.people.drivers.step import Drivers, begin_signal, give_signal
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings
from wheelchair_gym.types import Stick

# Simulated people whose hand or interface differs from an expert's.
IMPAIRMENTS: Final = (
    "essential_tremor", "ataxia", "spasticity", "weak_left", "biased", "isometric", "chin",
    "head_array", "sip_and_puff", "bci",
)  # fmt: skip
# Those who do not see, or do not notice, a side. What the others have is in their minds, which a
# living person has of their own.
SIGHTS: Final = ("hemianopia", "hemineglect")
COMMANDS: Final = ("stop", "forward", "left", "right", "back")  # in the order of a scan
_NONE = -1  # a signal that nothing stands for: a scan goes on, and a drive stops


@borrowing_kernel
def step_live(
    drivers: Any, signal: int, forward: float, left: float, yaw: float, near_goal: bool
) -> tuple[float, float, bool]:
    """One control period of the only row's hand and interface, after a signal.

    A stick takes the deflection in place of the signal; `_NONE` is no signal at all.
    """
    p, d = driver_row(drivers, 0)
    if p.kind == STICK:
        p.signals[0, 0], p.signals[0, 1] = forward * p.interface.gain, left * p.interface.gain
    d.intended = signal
    give_signal(p, d, yaw, near_goal)
    return d.stick[0], d.stick[1], d.latched


class LiveInput:
    """Input to a chair from a living person's deflections, through a simulated person's hand.

    Args:
        driver: the person whose hand and interface these are (`make_driver`).
        chair: settings of the chair.
        sensors: its sensors.
        period: of control [s].
    """

    def __init__(
        self, driver: Driver, chair: ChairSettings, sensors: SensorSettings, period: float
    ) -> None:
        self.driver, self._signals = driver, signals_of(driver)
        self._row = Drivers([driver], chair, sensors, period)
        self._state: Any = self._row.states
        self.begin(0)

    def begin(self, key: int) -> None:
        """Reset the hand to rest; key: seeds tremor, spasms and errors."""
        self._pressed = False
        begin_signal(self._state[0], np.uint64(key))

    def press(self) -> None:
        """Press the switch of a scanning interface: stop, or take the command that is lit."""
        self._pressed = True

    @property
    def lit(self) -> str:
        """The command that a scan shows now, one of COMMANDS; empty: there is no scan."""
        return COMMANDS[self._state["scan"][0]] if self._state["scan"][0] > 0 else ""

    def step(self, forward: float, left: float, yaw: float, near_goal: bool = False) -> Stick:
        """Return the interface's signal for the next control period.

        Args:
            forward: deflection that is meant, in [-1, 1].
            left: the same to the left.
            yaw: heading of the chair [rad], used by a brain-computer interface to turn.
            near_goal: the goal is within a metre, where some hands tremble more.
        """
        if self.driver.interface.kind == "scanning":
            signal = self._scanned()
        else:
            meant = np.array([forward, left])
            signal = _nearest(self._signals, meant) if self.driver.interface.kind != "stick" else 0
        pose, row = (float(yaw), bool(near_goal)), self._row.pointers.record
        return Stick(*step_live(row, signal, float(forward), float(left), *pose))

    def _scanned(self) -> int:
        """The signal that a press stands for; without one, the scan or the drive goes on."""
        state = self._state[0]
        pressed, self._pressed = self._pressed, False
        if state["active"] != 0:  # it drives: a press stops it, at the end of the press
            stops = pressed or state["switch_to"] >= 0
            return _NONE if stops else int(state["active"])
        if pressed and state["scan"] > 0:
            state["switch_at"] = 0.0  # the lit command's time ends with the press
            return int(state["scan"])
        return _NONE


class LiveSight:
    """Things to hide from a living person, so that they see what a simulated person sees.

    Args:
        perception: of the simulated person. `left`, `right`, `neglect` and `noticed` count; a
            reaction, lapses and a drift the living person has of their own.
        key: of the episode, which seeds what is noticed, as it does for a simulated person.
    """

    def __init__(self, perception: Perception, key: int) -> None:
        self.perception, self._key = perception, np.uint64(key)
        self._second = -1
        self._unnoticed: list[int] = []

    def unnoticed(self, clock: float) -> list[int]:
        """The sectors of the scan, of SECTORS, that go unnoticed on the neglected side.

        The clock is the time of the episode [s]; another second has other sectors.
        """
        if self.perception.neglect >= np.pi:
            return []
        if int(clock) != self._second:
            self._second = int(clock)
            draw = partial(uniform, self._key, self._second, CHANNEL)
            noticed = self.perception.noticed
            self._unnoticed = [k for k in range(SECTORS) if draw(NOTICED + k) >= noticed]
        return self._unnoticed


def scanning(scan_period: float = 1.25) -> Driver:
    """Somebody with one switch, who presses when they mean to; a command is lit for a time [s]."""
    return Driver(interface=Scanning(scan_period=scan_period, delay=0.0, error=0.0))


def _nearest(signals: Array, meant: Array) -> int:
    """The signal whose direction is nearest to what is meant; rest, where that is small."""
    size = float(np.hypot(*meant))
    if size < 0.3:
        return 0
    sizes = np.maximum(np.hypot(signals[:, 0], signals[:, 1]), 1e-9)
    directions = signals / sizes[:, None]
    return int(np.argmax((directions @ meant)[1:])) + 1

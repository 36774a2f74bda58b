"""A joystick at the host: a person's hand, above every policy, while a button is held.

Holding the dead-man button takes the chair; letting go brakes it, and it stands until the person
hands it back. One that is unplugged while it has the chair keeps it standing. A wireless one that
repeats its last values hides that its radio is lost: those belong to the drive board's receiver.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.hardware.reconnect import Reconnecting
from wheelchair_gym.kinematics import Limits

Array = NDArray[np.float64]

ANY = "any"
# Linux's input-event-codes.h
EV_SYN, EV_KEY, EV_ABS, SYN_DROPPED = 0, 1, 3, 3


@settings
class JoystickSettings:
    """Which joystick, and what its axes and buttons do; codes are Linux's input event codes."""

    device: str = setting(default="")
    """Path such as /dev/input/event3; any: the first one; empty: no joystick."""
    forward_axis: int = setting(default=1, low=0, high=63, source="ABS_Y")
    """Axis of the speed; forward is negative."""
    turn_axis: int = setting(default=0, low=0, high=63, source="ABS_X")
    """Axis of the turn; left is negative."""
    dead_man_button: int = setting(default=310, low=256, high=767, source="BTN_TL")
    """Button that is held to drive."""
    release_button: int = setting(default=315, low=256, high=767, source="BTN_START")
    """Button that returns control to the program."""
    rearm_button: int = setting(default=314, low=256, high=767, source="BTN_SELECT")
    """Button that re-arms the chair, with centred sticks."""
    dead_zone: float = setting(default=0.08, low=0.0, high=0.9, source="design choice")
    """Fraction of the stick's travel around its centre that counts as centred."""
    speed_fraction: float = setting(default=0.6, low=0.0, high=1.0, source="design choice")
    """Speed and turn at full deflection, as a fraction of the chair's limits."""

    def __post_init__(self) -> None:
        buttons = {self.dead_man_button, self.release_button, self.rearm_button}
        if len(buttons) < 3 or self.forward_axis == self.turn_axis:
            raise InputError("JoystickSettings: the three buttons and the two axes must differ")


class Event(NamedTuple):
    """What a device says."""

    type: int
    code: int
    value: int


class Device(Protocol):
    """An open input device."""

    @property
    def axes(self) -> dict[int, tuple[int, int]]:
        """Least and most value of each axis."""
        ...

    def read(self) -> Iterable[Event]:
        """What it has said since; never waits.

        Raises:
            OSError: it is gone.
        """
        ...

    def close(self) -> None:
        """Let it go."""
        ...


Opener = Callable[[JoystickSettings], Device]


class _Evdev:
    """A device of Linux's evdev."""

    def __init__(self, device: Any) -> None:
        self._device = device
        self.axes = {code: (info.min, info.max) for code, info in _axes(device)}

    def read(self) -> Iterable[Event]:
        """See `Device.read`."""
        try:
            return [Event(e.type, e.code, e.value) for e in self._device.read()]
        except BlockingIOError:
            return []

    def close(self) -> None:
        """See `Device.close`."""
        self._device.close()


def _axes(device: Any) -> list[tuple[int, Any]]:
    found: list[tuple[int, Any]] = device.capabilities(absinfo=True).get(EV_ABS, [])
    return found


def load_evdev() -> Any:
    """The package evdev.

    Raises:
        InputError: the extra 'hardware' is not installed.
    """
    try:
        import evdev
    except ImportError:
        raise InputError("a joystick needs: pip install 'wheelchair_gym[hardware]'") from None
    return evdev


def open_evdev(settings: JoystickSettings) -> Device:
    """Open the joystick that the settings name, or the first that has what they ask.

    Raises:
        InputError: see `load_evdev`.
        OSError: there is none.
    """
    evdev = load_evdev()
    for path in evdev.list_devices() if settings.device == ANY else [settings.device]:
        device = evdev.InputDevice(path)
        axes = {code for code, _ in _axes(device)}
        if {
            settings.forward_axis,
            settings.turn_axis,
        } <= axes and settings.dead_man_button in device.capabilities().get(EV_KEY, []):
            return _Evdev(device)
        device.close()
    where = "at any /dev/input/event*" if settings.device == ANY else f"at {settings.device}"
    raise OSError(
        f"no joystick {where} that this user may read and that has the axes and the button of "
        "hardware.joystick: plug it in, or sudo usermod -aG input $USER and log in again"
    )


class Joystick:
    """What a person's hand asks for; see `HardwareChair.hand`.

    Args:
        settings: which one, and its buttons.
        rearm: is called when the person re-arms with both sticks at rest.
        opener: makes the device.

    Attributes:
        taken: the person has the chair.
    """

    def __init__(
        self,
        settings: JoystickSettings,
        rearm: Callable[[], None] = lambda: None,
        opener: Opener = open_evdev,
    ) -> None:
        self.settings, self.in_control = settings, False
        self._rearm = rearm
        self._line = Reconnecting(lambda: opener(settings))
        self._let_go()

    @property
    def error(self) -> str:
        """Why there is none, as a line of text; empty while it is open."""
        return self._line.error

    def __call__(self, now: float, limits: Limits) -> Array | None:
        """The twist (2,) [m/s, rad/s] that is asked for; None while nobody has taken the chair."""
        self._listen(now)
        if not self.in_control:
            return None
        if not self._held:
            return np.zeros(2)
        own = self.settings
        ahead, aside = -self._stick(own.forward_axis), -self._stick(own.turn_axis)
        v = ahead * (limits.forward if ahead > 0.0 else limits.backward)
        return own.speed_fraction * np.array([v, aside * limits.turn])

    def close(self) -> None:
        """Let the device go; the chair stays with whom it is."""
        self._let_go()
        self._line.close()

    def _let_go(self) -> None:
        self._held, self._values = False, dict[int, int]()

    def _listen(self, now: float) -> None:
        device = self._line.get(now)
        if device is None:
            return
        try:
            for event in device.read():
                self._heed(event)
        except OSError as error:
            self._let_go()
            self._line.lose(error)

    def _heed(self, event: Event) -> None:
        own = self.settings
        if event.type == EV_SYN and event.code == SYN_DROPPED:
            self._let_go()  # something was missed: the button is to be pressed again
        elif event.type == EV_ABS:
            self._values[event.code] = event.value
        elif (
            event.type == EV_KEY and event.code == own.dead_man_button and event.value != 2
        ):  # 2: repeated
            self._held = event.value == 1
            self.in_control |= self._held
        elif event.type == EV_KEY and event.code == own.release_button and event.value == 1:
            self.in_control &= self._held
        elif (
            event.type == EV_KEY
            and event.code == own.rearm_button
            and event.value == 1
            and self._rests
        ):
            self._rearm()

    @property
    def _rests(self) -> bool:
        return (
            self._stick(self.settings.forward_axis) == self._stick(self.settings.turn_axis) == 0.0
        )

    def _stick(self, axis: int) -> float:
        """Where a stick is, -1 to 1; 0 before it has said."""
        if self._line.connection is None or axis not in self._values:
            return 0.0
        least, most = self._line.connection.axes[axis]
        if most <= least:
            return 0.0
        tilt = min(1.0, max(-1.0, 2.0 * (self._values[axis] - least) / (most - least) - 1.0))
        past = max(0.0, abs(tilt) - self.settings.dead_zone) / (1.0 - self.settings.dead_zone)
        return float(np.copysign(past, tilt)) if past else 0.0

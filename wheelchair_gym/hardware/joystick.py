"""A joystick at the host, with which a person overrides every policy while holding a button.

The dead-man button takes control; its release brakes the chair, which stands until the person
returns control. The chair moves only after the stick was at its centre while the button was held.
While another button is held, an assistant gets the stick (`wheelchair drive`).

A joystick that is unplugged while it has control keeps the chair standing. A wireless joystick that
repeats its last values hides the loss of its radio: use one at the drive board's receiver instead.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.errors import load_extra
from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.geometry.kinematics import Limits
from wheelchair_gym.hardware.connection import Reconnecting
from wheelchair_gym.safety.stops import BY_HAND, NO_STICK, NOT_HELD
from wheelchair_gym.types import Stick

ANY = "any"
# Linux's input-event-codes.h
EV_SYN, EV_KEY, EV_ABS, SYN_DROPPED = 0, 1, 3, 3


@settings
class JoystickSettings:
    """The joystick, its axes and its buttons; codes are Linux's input event codes."""

    device: str = setting(default="")
    """Path such as /dev/input/event3; any: the first one; empty: no joystick."""
    forward_axis: int = setting(default=1, low=0, high=63, source="ABS_Y")
    """Axis of the speed; forward is negative."""
    turn_axis: int = setting(default=0, low=0, high=63, source="ABS_X")
    """Axis of the turn; left is negative."""
    dead_man_button: int = setting(default=310, low=256, high=767, source="BTN_TL")
    """Button that is held to drive by hand, without help."""
    assist_button: int = setting(default=311, low=256, high=767, source="BTN_TR")
    """Button that is held to drive with an assistant (`wheelchair drive`)."""
    release_button: int = setting(default=315, low=256, high=767, source="BTN_START")
    """Button that returns control to the program."""
    rearm_button: int = setting(default=314, low=256, high=767, source="BTN_SELECT")
    """Button that re-arms the chair, with centred sticks."""
    dead_zone: float = setting(default=0.08, low=0.0, high=0.9)
    """Fraction of the stick's travel around its centre that counts as centred."""
    speed_fraction: float = setting(default=0.6, low=0.0, high=1.0)
    """Speed and turn at full deflection, as a fraction of the chair's limits."""

    def __post_init__(self) -> None:
        buttons = {self.dead_man_button, self.assist_button, self.release_button, self.rearm_button}
        if len(buttons) < 4 or self.forward_axis == self.turn_axis:
            raise InputError("JoystickSettings: the four buttons and the two axes must differ")


Opener = Callable[[JoystickSettings], Any]  # returns an `evdev.InputDevice`


def open_evdev(settings: JoystickSettings) -> Any:
    """Open the joystick of the settings, or the first that has its axes and its button.

    Raises:
        InputError: the extra 'hardware' is not installed.
        OSError: there is none.
    """
    evdev = load_extra("evdev")
    wanted = {settings.forward_axis, settings.turn_axis}
    for path in evdev.list_devices() if settings.device == ANY else [settings.device]:
        device = evdev.InputDevice(path)
        found = device.capabilities()
        axes, buttons = dict(found.get(EV_ABS, [])), found.get(EV_KEY, [])
        if wanted <= axes.keys() and settings.dead_man_button in buttons:
            return device
        device.close()
    where = "at any /dev/input/event*" if settings.device == ANY else f"at {settings.device}"
    raise OSError(
        f"no joystick {where} that this user may read and that has the axes and the button of "
        "hardware.joystick: plug it in, or sudo usermod -aG input $USER and log in again"
    )


class Joystick(Reconnecting[Any]):
    """A person's command by a joystick; see `HardwareChair.joystick`.

    Args:
        settings: device, axes and buttons.
        rearm: is called when the person re-arms with both sticks centred.
        opener: makes the device.

    Attributes:
        in_control: the person has control of the chair.
    """

    def __init__(
        self,
        settings: JoystickSettings,
        rearm: Callable[[], None] = lambda: None,
        opener: Opener = open_evdev,
    ) -> None:
        super().__init__(lambda: opener(settings))
        self.settings, self.in_control = settings, False
        self._rearm, self._asks = rearm, False
        self._release()

    def __call__(self, now: float, limits: Limits) -> Array | None:
        """The commanded twist (2,) [m/s, rad/s]; None while the person has no control."""
        self._read(now)
        if not self.in_control:
            return None
        if not self._free:
            return np.zeros(2)
        forward, turn = self._deflection
        v = forward * (limits.forward if forward > 0.0 else limits.backward)
        return self.settings.speed_fraction * np.array([v, turn * limits.turn])

    def stick(self, now: float) -> tuple[Stick, str]:
        """The stick for an assistant, and why it may not drive; empty: it may.

        `__call__` reads the device.
        """
        why = "" if self._assisted else NOT_HELD
        if self.error:
            why = f"{NO_STICK} ({self.error})"
        return Stick(*self._deflection, False), BY_HAND if self.in_control else why

    def close(self) -> None:
        """Close the device; who has control does not change."""
        self._release()
        super().close()

    def _begin(self, device: Any) -> None:
        axes = self.settings.forward_axis, self.settings.turn_axis
        self._axes = {axis: device.absinfo(axis) for axis in axes}
        self._values = {axis: info.value for axis, info in self._axes.items()}
        self.in_control |= self.settings.dead_man_button in device.active_keys()

    def _release(self) -> None:
        self._held = self._free = self._assisted = False
        self._axes, self._values = dict[int, Any](), dict[int, int]()

    def _read(self, now: float) -> None:
        device = self.get(now)
        if device is None:
            return
        try:
            for event in device.read():
                self._handle(event, device)
        except BlockingIOError:  # no events
            pass
        except OSError as error:
            self._release()
            self.lose(error)
        if self._asks:  # not in between: a re-arm may read events, too
            self._asks = False
            self._rearm()

    def _handle(self, event: Any, device: Any) -> None:
        settings = self.settings
        pressed = event.type == EV_KEY and event.value == 1
        if event.type == EV_SYN and event.code == SYN_DROPPED:
            self._release()  # events were missed: the button must be pressed again
            self._begin(device)
        elif event.type == EV_SYN:  # both axes are known only here; as `interlock` in joystick.h
            self._free = self._held and (self._free or not any(self._deflection))
        elif event.type == EV_ABS:
            self._values[event.code] = event.value
        elif event.type == EV_KEY and event.code == settings.dead_man_button:
            if event.value != 2:  # repeated
                self._held, self._free = pressed, False
                self.in_control |= pressed
        elif event.type == EV_KEY and event.code == settings.assist_button:
            if event.value != 2:
                self._assisted = pressed
        elif pressed and event.code == settings.release_button:
            self.in_control &= self._held
        elif pressed and event.code == settings.rearm_button and not any(self._deflection):
            self._free, self._asks = False, True

    @property
    def _deflection(self) -> tuple[float, float]:
        """Of the stick, forward and to the left, -1 to 1."""
        return -self._axis(self.settings.forward_axis), -self._axis(self.settings.turn_axis)

    def _axis(self, axis: int) -> float:
        """The deflection of an axis, -1 to 1; 0 while the device is closed."""
        info, value = self._axes.get(axis), self._values.get(axis)  # another thread may close it
        if info is None or value is None or info.max <= info.min:
            return 0.0
        tilt = 2.0 * (value - info.min) / (info.max - info.min) - 1.0
        tilt = min(1.0, max(-1.0, tilt))
        past = max(0.0, abs(tilt) - self.settings.dead_zone) / (1.0 - self.settings.dead_zone)
        return float(np.copysign(past, tilt)) if past else 0.0

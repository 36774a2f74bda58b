"""A joystick at the host, by which a person overrides every policy while holding a button.

The dead-man button takes control; its release brakes the chair, which stands until the person
returns control. While another button is held, an assistant gets the stick (`wheelchair drive`).

A joystick that is unplugged while it has control keeps the chair standing. A wireless joystick that
repeats its last values hides the loss of its radio: use one at the drive board's receiver instead.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from wheelchair_gym.arrays import Array
from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.hardware.connection import Reconnecting
from wheelchair_gym.kinematics import Limits
from wheelchair_gym.safety.stops import BY_HAND, NO_STICK, NOT_HELD
from wheelchair_gym.types import Stick

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
    """Button that is held to drive by hand, without help."""
    assist_button: int = setting(default=311, low=256, high=767, source="BTN_TR")
    """Button that is held to drive with an assistant (`wheelchair drive`)."""
    release_button: int = setting(default=315, low=256, high=767, source="BTN_START")
    """Button that returns control to the program."""
    rearm_button: int = setting(default=314, low=256, high=767, source="BTN_SELECT")
    """Button that re-arms the chair, with centred sticks."""
    dead_zone: float = setting(default=0.08, low=0.0, high=0.9, source="design choice")
    """Fraction of the stick's travel around its centre that counts as centred."""
    speed_fraction: float = setting(default=0.6, low=0.0, high=1.0, source="design choice")
    """Speed and turn at full deflection, as a fraction of the chair's limits."""

    def __post_init__(self) -> None:
        buttons = {
            self.dead_man_button, self.assist_button, self.release_button, self.rearm_button
        }  # fmt: skip
        if len(buttons) < 4 or self.forward_axis == self.turn_axis:
            raise InputError("JoystickSettings: the four buttons and the two axes must differ")


Opener = Callable[[JoystickSettings], Any]  # returns an `evdev.InputDevice`


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


def _axes(device: Any) -> dict[int, tuple[int, int]]:
    """Minimum and maximum of each axis of a device."""
    axes = device.capabilities(absinfo=True).get(EV_ABS, [])
    return {code: (info.min, info.max) for code, info in axes}


def open_evdev(settings: JoystickSettings) -> Any:
    """Open the joystick of the settings, or the first that has its axes and its button.

    Raises:
        InputError: see `load_evdev`.
        OSError: there is none.
    """
    evdev = load_evdev()
    wanted = {settings.forward_axis, settings.turn_axis}
    for path in evdev.list_devices() if settings.device == ANY else [settings.device]:
        device = evdev.InputDevice(path)
        buttons = device.capabilities().get(EV_KEY, [])
        if wanted <= _axes(device).keys() and settings.dead_man_button in buttons:
            return device
        device.close()
    where = "at any /dev/input/event*" if settings.device == ANY else f"at {settings.device}"
    raise OSError(
        f"no joystick {where} that this user may read and that has the axes and the button of "
        "hardware.joystick: plug it in, or sudo usermod -aG input $USER and log in again"
    )


class Joystick:
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
        self.settings, self.in_control = settings, False
        self._rearm = rearm
        self._axes: dict[int, tuple[int, int]] = {}
        self._line = Reconnecting(lambda: opener(settings), self._begin)
        self._release()

    @property
    def error(self) -> str:
        """Why the device is closed, as a line of text; empty while it is open."""
        return self._line.error

    def __call__(self, now: float, limits: Limits) -> Array | None:
        """The commanded twist (2,) [m/s, rad/s]; None while the person has no control."""
        self._read(now)
        if not self.in_control:
            return None
        if not self._held:
            return np.zeros(2)
        forward = -self._stick(self.settings.forward_axis)
        turn = -self._stick(self.settings.turn_axis)
        v = forward * (limits.forward if forward > 0.0 else limits.backward)
        return self.settings.speed_fraction * np.array([v, turn * limits.turn])

    def stick(self, now: float) -> tuple[Stick, str]:
        """The stick for an assistant, and why it may not drive; empty: it may.

        `__call__` reads the device.
        """
        axes = self.settings.forward_axis, self.settings.turn_axis
        forward, left = (-self._stick(axis) for axis in axes)
        why = "" if self._assisted else NOT_HELD
        if self.error:
            why = f"{NO_STICK} ({self.error})"
        return Stick(forward, left, False), BY_HAND if self.in_control else why

    def close(self) -> None:
        """Close the device; who has control does not change."""
        self._release()
        self._line.close()

    def _begin(self, device: Any) -> None:
        self._axes = _axes(device)

    def _release(self) -> None:
        self._held, self._assisted, self._values = False, False, dict[int, int]()

    def _read(self, now: float) -> None:
        device = self._line.get(now)
        if device is None:
            return
        try:
            for event in device.read():
                self._handle(event)
        except BlockingIOError:  # no events
            return
        except OSError as error:
            self._release()
            self._line.lose(error)

    def _handle(self, event: Any) -> None:
        settings = self.settings
        pressed = event.type == EV_KEY and event.value == 1
        if event.type == EV_SYN and event.code == SYN_DROPPED:
            self._release()  # events were missed: the button must be pressed again
        elif event.type == EV_ABS:
            self._values[event.code] = event.value
        elif event.type == EV_KEY and event.code == settings.dead_man_button:
            if event.value != 2:  # repeated
                self._held = pressed
                self.in_control |= pressed
        elif event.type == EV_KEY and event.code == settings.assist_button:
            if event.value != 2:
                self._assisted = pressed
        elif pressed and event.code == settings.release_button:
            self.in_control &= self._held
        elif pressed and event.code == settings.rearm_button and self._centred:
            self._rearm()

    @property
    def _centred(self) -> bool:
        axes = self.settings.forward_axis, self.settings.turn_axis
        return all(self._stick(axis) == 0.0 for axis in axes)

    def _stick(self, axis: int) -> float:
        """The deflection of a stick, -1 to 1; 0 before its first event."""
        if self._line.connection is None or axis not in self._values:
            return 0.0
        least, most = self._axes[axis]
        if most <= least:
            return 0.0
        tilt = min(1.0, max(-1.0, 2.0 * (self._values[axis] - least) / (most - least) - 1.0))
        past = max(0.0, abs(tilt) - self.settings.dead_zone) / (1.0 - self.settings.dead_zone)
        return float(np.copysign(past, tilt)) if past else 0.0

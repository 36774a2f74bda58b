"""Words that break the served twin, and mend it again."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from wheelchair_gym.hardware.boards.protocol import Switch
from wheelchair_gym.hardware.twin.lockstep import Faults, JoystickState
from wheelchair_gym.hardware.twin.plant import Slope
from wheelchair_gym.hardware.twin.protocol_twin import LineNoise
from wheelchair_gym.hardware.twin.serve import ServedTwin
from wheelchair_gym.sensors.settings import RANGERS

_SIDES = ("left", "right")
_SWITCHES = {
    "stop": Switch.STOP_PRESSED,
    "front": Switch.FRONT,
    "rear": Switch.REAR,
    "left": Switch.LEFT,
    "right": Switch.RIGHT,
    "lever": Switch.FREEWHEEL,
    "driver-left": Switch.DRIVER_LEFT,
    "driver-right": Switch.DRIVER_RIGHT,
}

_HANDS = {"free": JoystickState(manual=True), "back": JoystickState(), "silent": None}


def _number(word: str, low: float, high: float) -> float:
    value = float(word)
    if not low <= value <= high:
        raise ValueError(word)
    return value


def _press(served: ServedTwin, words: Sequence[str]) -> None:
    served.twin.faults.switches |= _SWITCHES[words[0]]


def _release(served: ServedTwin, words: Sequence[str]) -> None:
    served.twin.faults.switches &= ~_SWITCHES[words[0]]


def _encoder(served: ServedTwin, words: Sequence[str]) -> None:
    faults = served.twin.faults
    kinds = {"lost": faults.disconnected_encoders, "swapped": faults.swapped_encoders}
    kinds[words[1]][_SIDES.index(words[0])] = True


def _block(served: ServedTwin, words: Sequence[str]) -> None:
    held = list(served.twin.faults.blocked_wheels)
    held[_SIDES.index(words[0])] = True
    served.twin.faults.blocked_wheels = (held[0], held[1])


def _driver(served: ServedTwin, words: Sequence[str]) -> None:
    side = _SIDES.index(words[0])
    served.twin.faults.stuck_drivers[side] = _number(words[1], -1.0, 1.0)


def _motor(served: ServedTwin, words: Sequence[str]) -> None:
    if words[0] == "both" and words[1] == "swapped":
        served.twin.faults.swapped_motors = True
    elif words[1] == "inverted":
        served.twin.faults.inverted_motors[_SIDES.index(words[0])] = True
    else:
        raise ValueError(words[1])


def _brakes(served: ServedTwin, words: Sequence[str]) -> None:
    served.twin.faults.brake_fraction = _number(words[0], 0.0, 1.0)


def _slope(served: ServedTwin, words: Sequence[str]) -> None:
    angle = math.radians(_number(words[0], 0.0, 20.0))
    to = math.radians(_number(words[1], -360.0, 360.0)) if len(words) > 1 else 0.0
    served.twin.faults.slope = Slope(angle, to)


def _push(served: ServedTwin, words: Sequence[str]) -> None:
    served.twin.faults.push_force = _number(words[0], -1000.0, 1000.0)


def _reset_on_open(served: ServedTwin, words: Sequence[str]) -> None:
    {"drive": served.drive, "range": served.range}[words[0]].wire.resets_on_open = True


def _battery(served: ServedTwin, words: Sequence[str]) -> None:
    served.twin.faults.battery = _number(words[0], 0.0, 60.0)


def _sonar(served: ServedTwin, words: Sequence[str]) -> None:
    which, faults = int(_number(words[0], 0, RANGERS - 1)), served.twin.faults
    if words[1] == "silent":
        faults.silent_ultrasonics.add(which)
    else:
        faults.stuck_ultrasonics[which] = _number(words[1], 0.0, 6.0)


def _stick(served: ServedTwin, words: Sequence[str]) -> None:
    faults = served.twin.faults
    if words[0] in _HANDS:
        faults.joystick = _HANDS[words[0]]
    else:
        ahead, aside = (_number(word, -1.0, 1.0) for word in words)
        faults.joystick = JoystickState(ahead, aside, manual=True, dead_man=True)


def _unplug(served: ServedTwin, words: Sequence[str]) -> None:
    if words[0] == "laser":
        served.twin.laser.plugged = False
    else:
        {"drive": served.drive, "range": served.range}[words[0]].wire.plugged = False


def _silence(served: ServedTwin, words: Sequence[str]) -> None:
    if words[0] != "laser":
        raise ValueError(words[0])
    served.twin.laser.silent = True


def _noise(served: ServedTwin, words: Sequence[str]) -> None:
    share = _number(words[0], 0.0, 1.0)
    for end in (served.drive, served.range):
        end.wire.noise = LineNoise(corrupt=share)


def _hang(served: ServedTwin, words: Sequence[str]) -> None:
    {"drive": served.twin.drive, "range": served.twin.range}[words[0]].hang()


def _power(served: ServedTwin, words: Sequence[str]) -> None:
    {"drive": served.twin.drive, "range": served.twin.range}[words[0]].reset()


def _heal(served: ServedTwin, words: Sequence[str]) -> None:
    twin = served.twin
    twin.faults = Faults()
    twin.laser.plugged, twin.laser.silent = True, False
    for end in (served.drive, served.range):
        end.wire.plugged, end.wire.noise, end.wire.resets_on_open = True, LineNoise(), False


COMMANDS: dict[str, tuple[str, Callable[[ServedTwin, Sequence[str]], None]]] = {
    "press": (" | ".join(_SWITCHES), _press),
    "release": (" | ".join(_SWITCHES), _release),
    "encoder": ("left | right, lost | swapped", _encoder),
    "block": ("left | right", _block),
    "driver": ("left | right, DUTY (-1 to 1) at which it is stuck", _driver),
    "motor": ("left | right, inverted; or both swapped", _motor),
    "brakes": ("SHARE of their torque that is left", _brakes),
    "slope": ("DEGREES (0 to 20), and the DIRECTION in degrees in which the floor falls", _slope),
    "push": ("NEWTONS (-1000 to 1000) along its heading", _push),
    "reset-on-open": ("drive | range: opening its port resets the board", _reset_on_open),
    "battery": ("VOLTS", _battery),
    "sonar": ("0 to 7, silent | METRES", _sonar),
    "stick": ("AHEAD ASIDE (-1 to 1, held) | free | back | silent", _stick),
    "unplug": ("drive | range | laser", _unplug),
    "silence": ("laser", _silence),
    "noise": ("SHARE of bytes that are corrupted", _noise),
    "hang": ("drive | range", _hang),
    "power": ("drive | range: off and on", _power),
    "heal": ("", _heal),
}


def run_command(served: ServedTwin, line: str) -> str:
    """Do what a line of words says; what to tell the person."""
    words = line.split()
    if not words:
        return ""
    if words[0] not in COMMANDS:
        return "\n".join(f"{name} {what}".rstrip() for name, (what, _) in COMMANDS.items())
    what, act = COMMANDS[words[0]]
    try:
        act(served, words[1:])
    except (IndexError, KeyError, ValueError):
        return f"{line.strip()}: expected {words[0]} {what}"
    return f"{line.strip()}: done"

"""Commands that inject faults into the served twin: rows of `COMMANDS`, and cases of `_inject`."""

from __future__ import annotations

import math

from wheelchair_gym.hardware.boards.protocol import Switch
from wheelchair_gym.hardware.twin.cable import LineNoise
from wheelchair_gym.hardware.twin.lockstep import Faults, JoystickState
from wheelchair_gym.hardware.twin.plant import Slope
from wheelchair_gym.hardware.twin.serve import ServedTwin

_SIDES = {"left": 0, "right": 1}
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
_STICKS = {"free": JoystickState(manual=True), "back": JoystickState(), "silent": None}

COMMANDS = {  # name: its arguments
    "press": " | ".join(_SWITCHES),
    "release": " | ".join(_SWITCHES),
    "encoder": "left | right, lost | swapped",
    "block": "left | right",
    "driver": "left | right, DUTY (-1 to 1) at which it is stuck",
    "motor": "left | right, inverted; or both swapped",
    "brakes": "SHARE of their torque that is left",
    "slope": "DEGREES (0 to 20), and the DIRECTION in degrees in which the floor falls",
    "push": "NEWTONS (-1000 to 1000) along its heading",
    "push-switch": "held | free",
    "reset-on-open": "drive | range: opening its port resets the board",
    "battery": "VOLTS",
    "sonar": "0 to 7 (0 to 9 of ten), silent | METRES",
    "stick": "AHEAD ASIDE (-1 to 1, held) | free | back | silent",
    "assisted": "AHEAD ASIDE (-1 to 1, held): as stick, while the host helps",
    "unplug": "drive | range | laser | laser_1, which is the second one",
    "silence": "laser | laser_1",
    "noise": "SHARE of bytes that are corrupted",
    "hang": "drive | range",
    "power": "drive | range: off and on",
    "heal": "",
}


def _number(word: str, low: float, high: float) -> float:
    value = float(word)
    if not low <= value <= high:
        raise ValueError(word)
    return value


def _inject(served: ServedTwin, words: list[str]) -> None:
    """Carry out a command.

    Raises:
        KeyError, ValueError: it is malformed.
    """
    twin, faults = served.twin, served.twin.faults
    terminals = {"drive": served.drive, "range": served.range}
    boards = {"drive": twin.drive, "range": twin.range}
    lasers = {f"laser_{k}" if k else "laser": laser for k, laser in enumerate(twin.lasers)}
    rangers = {str(k): k for k in range(len(twin.plant.chair.sensors.ultrasonic.mounted))}
    match words:
        case ["press", switch]:
            faults.switches |= _SWITCHES[switch]
        case ["release", switch]:
            faults.switches &= ~_SWITCHES[switch]
        case ["encoder", side, "lost" | "swapped" as how]:
            broken = faults.disconnected_encoders if how == "lost" else faults.swapped_encoders
            broken[_SIDES[side]] = True
        case ["block", side]:
            k, (left, right) = _SIDES[side], faults.blocked_wheels
            faults.blocked_wheels = (left or k == 0, right or k == 1)
        case ["driver", side, duty]:
            faults.stuck_drivers[_SIDES[side]] = _number(duty, -1.0, 1.0)
        case ["motor", "both", "swapped"]:
            faults.swapped_motors = True
        case ["motor", side, "inverted"]:
            faults.inverted_motors[_SIDES[side]] = True
        case ["brakes", share]:
            faults.brake_fraction = _number(share, 0.0, 1.0)
        case ["slope", degrees, *direction] if len(direction) < 2:
            downhill = _number(direction[0], -360.0, 360.0) if direction else 0.0
            angle = math.radians(_number(degrees, 0.0, 20.0))
            faults.slope = Slope(angle, math.radians(downhill))
        case ["push", newtons]:
            faults.push_force = _number(newtons, -1000.0, 1000.0)
        case ["push-switch", "held" | "free" as state]:
            faults.push_switch = state == "held"
        case ["reset-on-open", board]:
            terminals[board].wire.resets_on_open = True
        case ["battery", volts]:
            faults.battery = _number(volts, 0.0, 60.0)
        case ["sonar", which, "silent"]:
            faults.silent_ultrasonics.add(rangers[which])
        case ["sonar", which, metres]:
            faults.stuck_ultrasonics[rangers[which]] = _number(metres, 0.0, 6.0)
        case ["stick", state]:
            faults.joystick = _STICKS[state]
        case ["stick" | "assisted" as who, ahead, aside]:
            forward, turn = _number(ahead, -1.0, 1.0), _number(aside, -1.0, 1.0)
            faults.joystick = JoystickState(forward, turn, manual=who == "stick", dead_man=True)
        case ["unplug", laser] if laser in lasers:
            lasers[laser].plugged = False
        case ["unplug", board]:
            terminals[board].wire.plugged = False
        case ["silence", laser]:
            lasers[laser].silent = True
        case ["noise", share]:
            for end in terminals.values():
                end.wire.noise = LineNoise(corrupt=_number(share, 0.0, 1.0))
        case ["hang", board]:
            boards[board].hang()
        case ["power", board]:
            boards[board].reset()
        case ["heal"]:
            twin.faults = Faults()
            for one in twin.lasers:
                one.plugged, one.silent = True, False
            for end in terminals.values():
                wire = end.wire
                wire.plugged, wire.noise, wire.resets_on_open = True, LineNoise(), False
        case _:
            raise ValueError(words)


def run_command(served: ServedTwin, line: str) -> str:
    """Carry out a line of words; return what to print."""
    words = line.split()
    if not words:
        return ""
    if words[0] not in COMMANDS:
        return "\n".join(f"{name} {arguments}".rstrip() for name, arguments in COMMANDS.items())
    try:
        _inject(served, words)
    except (KeyError, ValueError):
        return f"{line.strip()}: expected {words[0]} {COMMANDS[words[0]]}"
    return f"{line.strip()}: done"

"""A joystick's receiver at the twin's drive board: FlySky's iBUS frames."""

from __future__ import annotations

from dataclasses import dataclass

EVERY = 7  # ms between two frames
_CENTRE, _SPAN, _OFF, _ON = 1500, 500, 1000, 2000


@dataclass(frozen=True)
class Stick:
    """What a person does at the joystick; sticks in [-1, 1], left positive."""

    ahead: float = 0.0
    aside: float = 0.0
    manual: bool = False  # the switch that takes over
    held: bool = False  # the dead-man button


def ibus(stick: Stick) -> bytes:
    """A frame of the receiver."""
    values = [_CENTRE] * 14
    values[0] = round(_CENTRE - _SPAN * stick.aside)
    values[1] = round(_CENTRE + _SPAN * stick.ahead)
    values[4], values[5] = _ON if stick.manual else _OFF, _ON if stick.held else _OFF
    data = b"\x20\x40" + b"".join(v.to_bytes(2, "little") for v in values)
    return data + (0xFFFF - sum(data)).to_bytes(2, "little")

"""What is done once to a new chair: its boards get the parameters of its settings."""

from __future__ import annotations

from wheelchair_gym.config import InputError
from wheelchair_gym.hardware.messages import Answer, Message, Parameter, Save, Set, Status
from wheelchair_gym.hardware.parameters import DRIVE, RANGE, drive_parameters, range_parameters
from wheelchair_gym.hardware.protocol import Receiver, encode
from wheelchair_gym.hardware.twin.board import EmulatedBoard
from wheelchair_gym.hardware.twin.lockstep import Twin
from wheelchair_gym.sensing.settings import SensorSettings
from wheelchair_gym.simulation.settings import ChairSettings

_BOOT = 0.2  # s
_ANSWER = 0.01  # s
_SAVE = 1.0  # s: a byte of EEPROM each control run of 5 ms, 26 parameters of 4


def set_up(twin: Twin) -> None:
    """Give both boards what the plant's settings ask, where that is not what they hold by default.

    Raises:
        InputError: a board refuses a value.
    """
    plant, chair = twin.plant.chair, ChairSettings()
    tables = (
        (twin.drive, DRIVE, drive_parameters(plant.settings), drive_parameters(chair)),
        (
            twin.range, RANGE, range_parameters(plant.sensors.ultrasonic),
            range_parameters(SensorSettings().ultrasonic),
        ),
    )  # fmt: skip
    if any(wanted != default for _, _, wanted, default in tables):
        twin.advance(_BOOT)
    for board, names, wanted, default in tables:
        changed = {name: value for name, value in wanted.items() if value != default[name]}
        for name, value in changed.items():
            told = _asked(twin, board, Set(names.index(name), value), Parameter, _ANSWER)
            if not isinstance(told, Parameter) or told.status != Status.DONE:
                raise InputError(f"the board refuses {name} = {value:g}")
        if changed:
            kept = _asked(twin, board, Save(), Answer, _ANSWER)
            if kept is None or kept.status != Status.DONE:
                raise InputError("the board does not keep its parameters")
            twin.advance(_SAVE)


def _asked(
    twin: Twin, board: EmulatedBoard, message: Message, kind: type, seconds: float
) -> Parameter | Answer | None:
    """The answer to a message, within so many seconds."""
    receiver, end = Receiver(), twin.steps + round(seconds * 1000)
    board.write(b"\0" + encode(message, 0))
    while twin.steps < end:
        twin.advance(0.001)
        for frame in receiver.feed(board.read()):
            if isinstance(frame.message, kind):
                return frame.message  # type: ignore[return-value]
    return None

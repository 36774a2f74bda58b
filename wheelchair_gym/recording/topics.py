"""Topics with JSON content: each field is declared once, with its schema, its writer and reader.

Readers raise KeyError for a missing field, and ValueError for one that is malformed.
"""

import base64
import math
import sys
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from wheelchair_gym import signals, types
from wheelchair_gym.actors.records import ACTOR
from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.files import LIMITS, check_cells, is_coordinate
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.types import Stick, Truth

Content = dict[str, Any]

EPISODE: Final = "/episode"
READING: Final = "/reading"
COMMAND: Final = "/command"
SHIELD: Final = "/shield"  # what the shield made of the command
VERDICT: Final = "/verdict"
BATTERY: Final = "/battery"
BOARD: Final = "/board"  # of a real chair: wall time, and the drive board's report
WHEELS: Final = "/wheels"  # what identification needs: reports about the wheels, times of scans
# Settings of an environment that judging needs, or another drive with the same person.
SETTINGS: Final = (
    "rate", "chair", "sensors", "task", "shield", "physics", "localization", "driver",
    "assistant",
)  # fmt: skip


class Kind(NamedTuple):
    """A field's description, writer and reader."""

    schema: Mapping[str, Any]
    read: Callable[[Any], Any]
    write: Callable[[Any], Any] = lambda value: value


def _exactly(type_: type) -> Callable[[Any], Any]:
    """A reader of values of one type."""

    def read(value: Any) -> Any:
        if type(value) is not type_:
            raise ValueError(f"is {shorten(value)}")
        return value

    return read


def _number(value: Any) -> float:
    """A number as large as a coordinate may be."""
    if not is_coordinate(value):
        raise ValueError(f"is {shorten(value)}")
    return float(value)


def _finite(value: Any) -> float:
    """A number of any size."""
    if type(value) not in (int, float) or not math.isfinite(value):
        raise ValueError(f"is {shorten(value)}")
    return float(value)


_list, _text, _object = _exactly(list), _exactly(str), _exactly(dict)


def numbers(*shape: int, maximum: float = LIMITS["coordinate"].maximum) -> Kind:
    """An array (*shape) of numbers as lists, by default of coordinates; -1 is any length."""

    def read(value: Any) -> NDArray[np.float64]:
        values = np.array(_list(value), dtype=np.float64)
        if values.size == 0 and -1 in shape:
            values = np.empty([max(0, side) for side in shape])
        fits = values.ndim == len(shape) and all(
            wanted in (-1, side) for side, wanted in zip(values.shape, shape, strict=True)
        )
        if not fits or not (np.abs(values) <= maximum).all():
            raise ValueError(f"is {shorten(value)}")
        return values

    items = {"type": "number"} if len(shape) == 1 else {"type": "array"}
    return Kind({"type": "array", "items": items}, read, lambda value: np.asarray(value).tolist())


def _packed(dtype: DTypeLike, size: int = -1) -> Kind:
    """An array (size,) as text, to the bit, infinities and NaN included; -1: any size."""

    def read(value: Any) -> NDArray[Any]:
        # Of bytes that may be written to: for read-only arrays, kernels would be compiled again.
        values = np.frombuffer(bytearray(base64.b64decode(_text(value), validate=True)), dtype)
        if size not in (-1, len(values)):
            raise ValueError(f"has {len(values)} values; expected {size}")
        return values

    def write(values: ArrayLike) -> str:
        given = np.asarray(values, dtype)
        plain = np.zeros(given.shape, dtype)  # the padding of records is no value
        for name in given.dtype.names or (...,):
            plain[name] = given[name]
        return base64.b64encode(plain.tobytes()).decode()

    return Kind({"type": "string"}, read, write)


def _nullable(kind: Kind, missing: float | None = None) -> Kind:
    """A kind of numbers, or null for the missing value."""

    def write(value: Any) -> Any:
        return None if value is None or not np.isfinite(value).all() else kind.write(value)

    schema = {"type": [kind.schema["type"], "null"]}
    return Kind(schema, lambda value: missing if value is None else kind.read(value), write)


NUMBER: Final = Kind({"type": "number"}, _number)
TEXT: Final = Kind({"type": "string"}, _text)
FLAG: Final = Kind({"type": "boolean"}, _exactly(bool))
INTEGER: Final = Kind({"type": "integer"}, _exactly(int))
OBJECT: Final = Kind({"type": "object"}, _object)


def read_fields(fields: Mapping[str, Kind], content: Content, *optional: str) -> Content:
    """The fields of a message; an optional one may be missing."""
    values = {}
    for name, kind in fields.items():
        if name not in optional or name in content:
            try:
                values[name] = kind.read(content[name])
            except ValueError as error:
                raise ValueError(f"{name} {error}") from None
    return values


def write_fields(fields: Mapping[str, Kind], values: Mapping[str, Any]) -> Content:
    """The content of a message of these values; fields without a value are left out."""
    return {name: kind.write(values[name]) for name, kind in fields.items() if name in values}


def _poses(name: str) -> Kind:
    """Poses (n, 3) as packed numbers of a type."""
    kind = _packed(name)
    return kind._replace(read=lambda value: kind.read(value).reshape(-1, 3))


def _made(make: Callable[..., Any], fields: Mapping[str, Kind], *optional: str) -> Kind:
    """Describe an object that is made of these of its attributes."""
    return Kind(
        {"type": "object"},
        lambda value: make(**read_fields(fields, _object(value), *optional)),
        lambda value: write_fields(fields, {name: getattr(value, name) for name in fields}),
    )


def _grid(
    cells: NDArray[Any], shape: NDArray[Any], resolution: float, origin: NDArray[Any]
) -> OccupancyGrid:
    rows, columns = (int(side) for side in shape)
    check_cells(rows, columns, "map")
    if len(cells) != rows * columns:
        raise ValueError(f"has {len(cells)} cells; expected {rows * columns}")
    x, y, yaw = origin.tolist()
    grid = OccupancyGrid(cells.reshape(rows, columns), resolution, (x, y, yaw))
    if not all(map(is_coordinate, grid.bounds)):
        raise ValueError("reaches too far")
    return grid


MAP: Final = _made(
    _grid,
    {"cells": _packed("<i1"), "shape": numbers(2), "resolution": NUMBER, "origin": numbers(3)},
)
_SCALARS: Final = {"f8": NUMBER, "b1": FLAG, "i8": INTEGER}


def _kind(signal: signals.Signal) -> Kind:
    """A signal's record: ranges and the poses of actors are packed."""
    if signal.kind == "f4":
        return _packed("<f4")
    if not signal.is_fixed:
        return _poses("<f8")
    sides = [side for side in signal.shape if isinstance(side, int)]
    return numbers(*sides) if sides else _SCALARS[signal.kind]


_TRUTH_FIELDS: Final = {signal.name: _kind(signal) for signal in signals.TRUTH}

_STICK = _made(Stick, {"forward": NUMBER, "left": NUMBER, "latched": FLAG})


def reading_fields(sensors: SensorSettings | None = None) -> dict[str, Kind]:
    """Return the fields of a reading of sensors; None: of any."""
    beams, columns = (sensors.beams, sensors.ultrasonic.columns) if sensors else (-1, -1)
    return {
        **{signal.name: _kind(signal) for signal in signals.READING},
        "laser": _packed("<f4", beams),
        **dict.fromkeys(("ultrasonic", "age"), _packed("<f4", columns)),
        "battery": _nullable(NUMBER, math.nan),
        "halted": TEXT,
        "odometry": numbers(3),
        "truth": _made(Truth, _TRUTH_FIELDS),
        "particles": _poses("<f4"),
        "map": MAP,
        "stick": _STICK,
    }


FIELDS: Final[dict[str, dict[str, Kind]]] = {
    EPISODE: {
        "settings": OBJECT,
        "map": MAP,
        "start": numbers(3),
        "goal": numbers(3),
        "walls": numbers(-1, 4),
        "discs": numbers(-1, 3),
        "tolerance": _nullable(NUMBER),
        "time_limit": _nullable(NUMBER),
        "arrival": _nullable(numbers(4)),
        "name": TEXT,
        "actors": _packed(ACTOR),
        "actor_size": INTEGER,  # bytes of one of them
        "routes": numbers(-1, 2),
        "seed": INTEGER,
        "number": INTEGER,  # of the episode, of that seed
        "split": TEXT,
        "labels": OBJECT,  # `NavigationEnv.labels`
        "boards": OBJECT,  # `Chair.board_parameters` of a real chair
    },
    READING: reading_fields(),
    COMMAND: {
        "action": numbers(2, maximum=sys.float_info.max),  # what is beyond [-1, 1] is clipped
        "v": NUMBER,
        "w": NUMBER,
        "stick": _STICK,  # that it answers, where it came after the reading
        "labels": OBJECT,  # where they have changed in mid-drive
    },
    SHIELD: {"reason": TEXT, "asked": numbers(2), "given": numbers(2), "protective": FLAG},
    VERDICT: {
        "reward": Kind(NUMBER.schema, _finite),
        "terms": Kind(
            {"type": "object", "additionalProperties": NUMBER.schema},
            lambda value: {name: _finite(term) for name, term in _object(value).items()},
        ),
        "terminated": FLAG,
        "truncated": FLAG,
    },
    BATTERY: {"voltage": _nullable(NUMBER, math.nan)},
    WHEELS: {"reports": _packed(types.WHEELS), "scans": numbers(-1)},
    BOARD: {
        "wall": NUMBER,
        **dict.fromkeys(("mode", "faults", "switches"), TEXT),
        **dict.fromkeys(("left", "right", "duty_left", "duty_right", "v", "w"), NUMBER),
    },
}


def json_schema(topic: str) -> dict[str, Any]:
    """The JSON schema of a topic's messages."""
    fields = FIELDS[topic]
    optional = {
        READING: ("particles", "map", "stick"), COMMAND: ("stick", "labels"),
        BOARD: set(fields) - {"wall"}, EPISODE: ("boards",),
    }.get(topic, ())  # fmt: skip
    return {
        "type": "object",
        "title": topic.removeprefix("/"),
        "properties": {name: kind.schema for name, kind in fields.items()},
        "required": [name for name in fields if name not in optional],
    }

"""ROS 2 messages as CDR, the bytes of bags and of DDS, by the definitions of Jazzy.

Messages are dictionaries of their fields, as in `make_messages` and `messages`. Definitions of
standard messages are the same in every distribution from Humble on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import cache
from typing import Any, Final

import numpy as np

from wheelchair_gym.base.errors import InputError

EXTRA: Final = "messages of ROS 2 need: pip install 'wheelchair_gym[ros]'"


@cache
def typestore() -> Any:
    """The definitions of messages, as a typestore of rosbags.

    Raises:
        InputError: the extra 'ros' is not installed.
    """
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise InputError(EXTRA) from None
    return get_typestore(Stores.ROS2_JAZZY)


@cache
def _maker(kind: str) -> Callable[[Mapping[str, Any]], Any]:
    """A function that makes messages of a type of dictionaries; what they lack is zero or empty."""
    store = typestore()
    makers = {name: _field(*definition) for name, definition in store.fielddefs[kind][1]}
    cls = store.types[kind]
    return lambda values: cls(**{name: make(values.get(name)) for name, make in makers.items()})


def _field(node: Any, definition: Any) -> Callable[[Any], Any]:
    """A function that makes a field of a value, or of None."""
    from rosbags.interfaces import Nodetype

    if node == Nodetype.NAME:
        make = _maker(definition)
        return lambda value: make(value or {})
    if node == Nodetype.BASE:
        of: Any = {"string": str, "bool": bool}.get(definition[0])
        of = of or (float if definition[0].startswith("float") else int)
        return lambda value: of() if value is None else of(value)
    (inner, name), length = definition
    if inner == Nodetype.BASE and name[0] != "string":
        dtype = np.dtype("uint8" if name[0] in ("byte", "char") else name[0])
        return lambda value: (
            np.zeros(length, dtype) if value is None else np.ascontiguousarray(value, dtype)
        )
    each = _field(inner, name)
    return lambda value: [each(item) for item in value or ()]


def serialized(kind: str, message: Mapping[str, Any]) -> Any:
    """A message of a type as CDR."""
    return typestore().serialize_cdr(_maker(kind)(message), kind)


def deserialized(kind: str, data: bytes) -> dict[str, Any]:
    """A message of a type, of CDR; for damaged bytes, rosbags raises whatever it raises."""
    return asdict(typestore().deserialize_cdr(data, kind))

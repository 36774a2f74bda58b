"""Settings: frozen dataclasses whose fields have unit, bounds, source, doc; a strict JSON loader.

Nothing is merged and nothing is guessed: an unknown key, a wrong type or a value out of bounds is
an error that names the place, the value and what was expected.
"""

from __future__ import annotations

import ast
import dataclasses
import difflib
import inspect
import itertools
import math
import os
import textwrap
import types
import typing
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeVar, dataclass_transform

import numpy as np

from wheelchair_gym.base.errors import InputError as InputError
from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.files import LIMITS, parse_json
from wheelchair_gym.base.files import read_json as read_json

T = TypeVar("T")
Range = Annotated[tuple[T, T], "a least and a greatest value"]  # others are refused

FARTHEST: Final = float(LIMITS["coordinate"].maximum)  # m: northings of UTM end here

# Bounds of settings that state none: beyond them, kernels could overflow.
LARGEST: Final = 1e9
LARGEST_INTEGER: Final = 2**63 - 1


def suggest(name: object, known: Iterable[str]) -> str:
    """The end of a message about an unknown name: the nearest known one, if any is near."""
    near = difflib.get_close_matches(str(name)[:80], list(known), 1)
    return f"; did you mean {near[0]}?" if near else ""


def setting(
    *,
    default: Any,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    source: str = "design choice",
    holds: type | None = None,
) -> Any:
    """A field of a settings class; the string below the field says what the setting does.

    Args:
        default: the value when none is given.
        unit: SI unit; empty for a number without unit.
        low: the least value that is accepted.
        high: the greatest value that is accepted.
        source: where the default comes from: a publication, a data sheet, a measurement; by
            default, it is a choice of the design.
        holds: the class of the settings that a value of another type stands for, where a message
            about an unknown key should look for it.
    """
    metadata = {"unit": unit, "low": low, "high": high, "source": source, "holds": holds}
    return dataclasses.field(default=default, metadata=metadata)


def setting_docs(cls: type) -> dict[str, str]:
    """Return the description of each setting: the strings below fields, inherited ones too."""
    docs: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        if not dataclasses.is_dataclass(base):
            continue
        try:
            tree = ast.parse(textwrap.dedent(inspect.getsource(base)))
        except (OSError, TypeError):  # a class without source has no docs of its own
            continue
        body = typing.cast(ast.ClassDef, tree.body[0]).body
        for field, below in itertools.pairwise(body):
            match field, below:
                case (
                    ast.AnnAssign(target=ast.Name(id=name)),
                    ast.Expr(value=ast.Constant(value=str(doc))),
                ):
                    docs[name] = " ".join(doc.split())
    return docs


@dataclass_transform(frozen_default=True, field_specifiers=(setting, dataclasses.field))
def settings(cls: type[T]) -> type[T]:
    """Make a frozen dataclass whose values are checked whenever one is made."""
    rule = getattr(cls, "__post_init__", None)
    rule = getattr(rule, "rule", rule)  # of an inherited check only the rule between settings

    def check(self: Any) -> None:
        hints = typing.get_type_hints(type(self), include_extras=True)
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            where = f"{type(self).__name__}.{field.name}"
            value = _convert(value, hints[field.name], where)
            _bounded(value, field.metadata, where)
            object.__setattr__(self, field.name, value)
        if rule is not None:
            rule(self)

    check.rule = rule  # type: ignore[attr-defined]
    cls.__post_init__ = check  # type: ignore[attr-defined]
    cls.__deepcopy__ = lambda self, memo: self  # type: ignore[attr-defined]  # it never changes
    return dataclasses.dataclass(frozen=True)(cls)


def numbers_of(*classes: Any) -> np.dtype[Any]:
    """Return a record of all numbers in classes of settings, each name once, for kernels."""
    fields = [field for cls in classes for field in dataclasses.fields(cls)]
    names = [field.name for field in fields if field.type in (float, "float")]  # quoted or not
    return np.dtype([(name, np.float64) for name in dict.fromkeys(names)])


def copy_numbers(record: Any, values: object) -> None:
    """Copy the numbers of a settings object into the fields of their names in a record."""
    for name in numbers_of(type(values)).names or ():
        record[name] = getattr(values, name)


def record_of(values: object) -> Any:
    """Return the numbers of a settings object as a record."""
    record = np.zeros(1, numbers_of(type(values)))[0]
    copy_numbers(record, values)
    return record


def _bounded(value: Any, metadata: Mapping[str, Any], where: str) -> None:
    for number in value if isinstance(value, tuple) else (value,):
        if isinstance(number, bool) or not isinstance(number, int | float):
            continue
        low, high = metadata.get("low"), metadata.get("high")
        largest = LARGEST if isinstance(number, float) else LARGEST_INTEGER
        if not -largest <= number <= largest:
            low, high = -largest if low is None else low, largest if high is None else high
        if (low is not None and number < low) or (high is not None and number > high):
            pairs = ("at least", low), ("at most", high)
            bounds = " and ".join(f"{word} {bound}" for word, bound in pairs if bound is not None)
            raise InputError(f"{where} is {shorten(number)}; it must be {bounds}")


def _name(hint: Any) -> str:
    return "null" if hint is type(None) else getattr(hint, "__name__", str(hint))


def _convert(value: Any, hint: Any, where: str) -> Any:
    """The value as the type that the hint asks for, or an error that names the place."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, os.PathLike) and hint is str:
        value = os.fspath(value)
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin is Annotated:
        low, high = pair = _convert(value, hint.__origin__, where)
        if low > high:
            raise InputError(f"{where} is {low:g}, {high:g}; expected from, to")
        return pair
    if origin is Literal:
        if value not in args:
            raise InputError(
                f"{where} is {shorten(value)}; it must be one of {', '.join(map(str, args))}"
            )
        return value
    if origin in (types.UnionType, typing.Union):
        for option in args:
            try:
                return _convert(value, option, where)
            except InputError:
                if dataclasses.is_dataclass(option) and isinstance(value, Mapping):
                    raise
        expected = " or ".join(_name(option) for option in args)
        raise InputError(f"{where} is {shorten(value)}; expected {expected}")
    if origin is tuple:
        if not isinstance(value, Sequence) or isinstance(value, str):
            raise InputError(f"{where} is {shorten(value)}; expected a list")
        if args[-1] is Ellipsis:
            return tuple(_convert(v, args[0], f"{where}[{i}]") for i, v in enumerate(value))
        if len(value) != len(args):
            raise InputError(f"{where} has {len(value)} values; expected {len(args)}")
        pairs = zip(value, args, strict=True)
        return tuple(_convert(v, a, f"{where}[{i}]") for i, (v, a) in enumerate(pairs))
    if origin in (dict, Mapping) or (origin is not None and issubclass(origin, Mapping)):
        if not isinstance(value, Mapping):
            raise InputError(f"{where} is {shorten(value)}; expected an object")
        return {k: _convert(v, args[1], f"{where}.{k}") for k, v in value.items()}
    if dataclasses.is_dataclass(hint):
        if isinstance(value, Mapping):
            return load(typing.cast(type, hint), value, where)
        if isinstance(value, typing.cast(type, hint)):
            return value
        raise InputError(f"{where} is {shorten(value)}; expected an object ({_name(hint)})")
    if hint is Any:
        return value
    if hint is float and isinstance(value, int | float) and not isinstance(value, bool):
        if isinstance(value, int) and abs(value) > LARGEST_INTEGER:
            raise InputError(f"{where} is an integer of more than 64 bits; expected a number")
        if math.isnan(value):
            raise InputError(f"{where} is NaN; expected a number")
        return float(value)
    if hint is int and hasattr(value, "__index__") and not isinstance(value, bool):
        return int(value)
    if isinstance(value, hint) and not (isinstance(value, bool) and hint is not bool):
        return value
    raise InputError(f"{where} is {shorten(value)}; expected {_name(hint)}")


class UnknownKeyError(InputError):
    """A key that a class of settings does not have."""

    def __init__(self, text: str, key: object, near: str) -> None:
        super().__init__(text + near)
        self.text, self.key, self.near = text, key, near

    def seen_from(self, cls: type, prefix: str = "") -> UnknownKeyError:
        """The error as settings around it tell it: they may know where the key belongs."""
        here = any(field.name == self.key for field in dataclasses.fields(cls))
        homes = [f"{self.key} at the top level"] if here else list(_homes(cls, self.key))[:3]
        near = f"; did you mean {' or '.join(homes)}?" if homes else self.near
        return UnknownKeyError(prefix + self.text, self.key, near)


def _homes(cls: type, key: object) -> Iterator[str]:
    """Dotted names of the settings called so in the parts of a class."""
    hints = typing.get_type_hints(cls)
    for field in dataclasses.fields(cls):
        hint = field.metadata.get("holds") or hints[field.name]
        for part in typing.get_args(hint) if isinstance(hint, types.UnionType) else (hint,):
            if dataclasses.is_dataclass(part):
                names = {inner.name for inner in dataclasses.fields(part)}
                deeper = [key] if key in names else _homes(typing.cast(type, part), key)
                yield from (f"{field.name}.{name}" for name in deeper)


def load(cls: type[T], data: Mapping[str, Any], where: str, base: T | None = None) -> T:
    """Make settings from a mapping (JSON content).

    Args:
        cls: a settings class.
        data: its keys and values; missing keys keep their defaults.
        where: how errors call this mapping, such as a file's name.
        base: whose values missing keys keep, in place of the class's defaults.

    Raises:
        InputError: an unknown key, a wrong type or a value out of bounds.
    """
    if not isinstance(data, Mapping):
        raise InputError(f"{where}: expected an object with keys, got {type(data).__name__}")
    fields = {field.name: field for field in dataclasses.fields(cls)}  # type: ignore[arg-type]
    for key in data:
        if key not in fields:
            named = key if str(key).isidentifier() and len(key) < 80 else shorten(key)
            known = ", ".join(sorted(fields))
            text = f"{where}.{named} is not a setting; it has {known}"
            raise UnknownKeyError(text, key, suggest(key, fields)).seen_from(cls)
    hints = typing.get_type_hints(cls, include_extras=True)
    values = {}
    for key, value in data.items():
        default = fields[key].default if base is None else getattr(base, key)
        try:
            if isinstance(value, Mapping) and _is_settings(default):
                # A part keeps the defaults that it has here, which may not be those of its class.
                values[key] = load(type(default), value, f"{where}.{key}", default)
                continue
            values[key] = _convert(value, hints[key], f"{where}.{key}")
        except UnknownKeyError as error:
            raise error.seen_from(cls) from None
        _bounded(values[key], fields[key].metadata, f"{where}.{key}")
    missing = [
        name for name, field in fields.items()
        if base is None and name not in data and field.default is dataclasses.MISSING
        and field.default_factory is dataclasses.MISSING
    ]  # fmt: skip
    if missing:
        raise InputError(f"{where} lacks {', '.join(missing)}")
    try:
        if base is not None:
            return dataclasses.replace(base, **values)  # type: ignore[type-var]
        return cls(**values)
    except UnknownKeyError as error:
        raise error.seen_from(cls, f"{where}: ") from None
    except InputError as error:  # a rule between several settings
        raise InputError(f"{where}: {error}") from None


def _is_settings(value: Any) -> bool:
    return dataclasses.is_dataclass(value) and not isinstance(value, type)


def read(cls: type[T], path: str | Path) -> T:
    """Make settings from a JSON file.

    Raises:
        InputError: the file cannot be read, or its content is not what the class expects.
    """
    return load(cls, read_json(path), Path(path).name)


def dump(value: Any) -> Any:
    """Settings as plain JSON-able values; `load` reads them back to an equal object."""
    if _is_settings(value):
        return {f.name: dump(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {key: dump(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [dump(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return os.fspath(value) if isinstance(value, os.PathLike) else value


def value_of(word: str) -> Any:
    """Return a typed word's value: JSON, or else the word itself (also if beyond JSON's limits)."""
    try:
        return parse_json(word, "a value")
    except InputError:
        return word


def dotted(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return the values of nested mappings at dotted keys, as `with_values` takes them."""
    found: dict[str, Any] = {}
    for key, value in values.items():
        inner = isinstance(value, Mapping)
        found |= dotted(value, f"{prefix}{key}.") if inner else {f"{prefix}{key}": value}
    return found


def with_values(settings: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Plain settings with values at dotted keys, such as `tree.step`, in place of those there.

    Raises:
        InputError: a key leads into what has no keys.
    """
    changed = {**settings}
    for key, value in values.items():
        *above, last = key.split(".")
        place = changed
        for part in above:
            inner = place.get(part, {})
            if not isinstance(inner, Mapping):
                raise InputError(f"{key}: {part} is {shorten(inner)}; it has no keys")
            place[part] = {**inner}
            place = place[part]
        place[last] = value
    return changed

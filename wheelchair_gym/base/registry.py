"""Registries: names of classes, imported when first used, and a place for other people's code.

Three kinds of names are taken wherever a registry is asked: its own, the entry points that
installed packages declare in its group, and `module:Class` of anything that can be imported, also
from the working folder.
"""

from __future__ import annotations

import dataclasses
import inspect
import os
import re
import sys
from collections.abc import Iterator, Mapping
from functools import cache, cached_property
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec
from typing import Any

from wheelchair_gym.base.errors import InputError, shorten
from wheelchair_gym.base.settings import dump, load, suggest

_OURS = ("wheelchair_gym", "planners", "agents")
_PLACE = re.compile(r"[A-Za-z_]\w*(\.\w+)*:[A-Za-z_]\w*(\.\w+)*")


def in_module(module: str, classes: str) -> dict[str, str]:
    """Return the places of a module's classes by name in lower case: `a_star` for `AStar`."""
    names = {re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower(): name for name in classes.split()}
    return {key: f"{module}:{name}" for key, name in names.items()}


def is_place(name: object) -> bool:
    """Return whether a name has the form `module:Class`."""
    return isinstance(name, str) and _PLACE.fullmatch(name) is not None


@cache
def imported(place: str) -> Any:
    """Import what `module:attribute` names; modules are looked for in the working folder, too.

    Raises:
        InputError: the module cannot be imported, or has no such attribute.
    """
    module, _, attribute = place.partition(":")
    if module.partition(".")[0] not in _OURS:
        _look_in_working_folder()
    try:
        found: Any = import_module(module)
    except Exception as error:  # whatever another package's code raises
        why = f"{type(error).__name__}: {shorten(str(error))}"
        raise InputError(f"{place}: the module cannot be imported ({why})") from error
    names = dir(found)
    for part in attribute.split("."):
        if not hasattr(found, part):
            near = suggest(part, names)
            raise InputError(f"{place}: {module} has no {part}{near}")
        found = getattr(found, part)
    return found


def source_of(place: str) -> str | None:
    """Return the file of the module that `module:attribute` names; None where there is none."""
    _look_in_working_folder()
    try:
        found = find_spec(place.partition(":")[0])
    except (ImportError, ValueError):
        return None
    return found.origin if found is not None and found.has_location else None


def _look_in_working_folder() -> None:
    if os.getcwd() not in sys.path and "" not in sys.path:
        sys.path.append(os.getcwd())


def places_in(spec: Any) -> set[str]:
    """Return the places of other people's code that a name or nested settings name."""
    if isinstance(spec, Mapping):
        spec = list(spec.values())
    if isinstance(spec, list | tuple):
        return set().union(*map(places_in, spec))
    added = {k: v for each in _REGISTRIES for k, v in each.places.items() if k not in each.built_in}
    parts = spec.split("+") if isinstance(spec, str) else []
    return {added.get(part, part) for part in parts if is_place(part) or part in added}


_REGISTRIES: list[Registry] = []  # those that other packages add names to


@dataclasses.dataclass(frozen=True)
class Maker:
    """A class that is not settings, with the arguments of its objects; `make()` gives a new one."""

    place: str
    values: Mapping[str, Any]

    def make(self) -> Any:
        """Return a new object."""
        return imported(self.place)(**self.values)


class Registry(Mapping[str, Any]):
    """Objects by name; each is imported when it is first looked up.

    Attributes:
        built_in: `module:attribute` of each name that comes with the project.

    Args:
        kind: what the entries are, such as `planner`; error messages begin with it.
        places: `module:attribute` of each name.
        group: of entry points with which other packages add names.
        needs: the methods of which a class of other people has to have one.
    """

    def __init__(
        self, kind: str, places: Mapping[str, str], group: str = "", needs: tuple[str, ...] = ()
    ) -> None:
        self.kind, self.group, self.needs = kind, group, needs
        self.built_in = dict(sorted(places.items()))
        if group:
            _REGISTRIES.append(self)

    @cached_property
    def places(self) -> dict[str, str]:
        """`module:attribute` of each name; ours goes before the same name of another package."""
        added = entry_points(group=self.group) if self.group else ()
        return {**{point.name: point.value for point in added}, **self.built_in}

    def __getitem__(self, name: str) -> Any:
        if name not in self.places:
            if is_place(name):
                return self._of_others(name)
            raise KeyError(name)
        return imported(self.places[name]) if name in self.built_in else self._of_others(name)

    def _of_others(self, name: str) -> Any:
        place = self.places.get(name, name)
        found = imported(place)
        if self.needs and not any(hasattr(found, method) for method in self.needs):
            expected = " or ".join(self.needs)
            raise InputError(f"{self.kind} {name}: {shorten(found)} has no method {expected}")
        return found

    def __iter__(self) -> Iterator[str]:
        return iter(self.places)

    def __len__(self) -> int:
        return len(self.places)

    def __contains__(self, name: object) -> bool:
        """Return whether it is a name of the registry or, where those count, a class's place."""
        return name in self.places or (self.group != "" and is_place(name))

    def name_of(self, value: object) -> str | None:
        """Return the name of an object's class, or None if it has none here."""
        place = f"{type(value).__module__}:{type(value).__qualname__}"
        return next((name for name in self.places if self.places[name] == place), None)

    def spec(self, value: Any) -> dict[str, Any]:
        """Return a name, a mapping with a name, or a registered class's object as a mapping.

        Raises:
            InputError: the value is none of these, or the name is unknown.
        """
        known = self.name_of(value)
        if known is not None:
            return {"name": known, **dump(value)}
        if not isinstance(value, str | Mapping):
            expected = "expected a name or an object with a name"
            raise InputError(f"{self.kind} is {shorten(value)}; {expected}")
        values = {"name": value} if isinstance(value, str) else dict(value)
        name = values.get("name")
        if not isinstance(name, str) or name not in self:
            known = ", ".join(self.places)
            near = suggest(name, self.places)
            others = ", or module:Class" if self.group else ""
            unknown = f"{self.kind} {shorten(name)} is unknown"
            raise InputError(f"{unknown}; there are {known}{others}{near}")
        return values

    def make(self, value: Any) -> Any:
        """Return the settings of a name or a mapping; an object of a registered class is itself.

        Of somebody's class that is not settings it is an object, made with the other keys as
        arguments, or a `Maker` where such objects are to be made anew.

        Raises:
            InputError: the name is unknown, or a setting is wrong.
        """
        if self.name_of(value) is not None:
            return value
        values = self.spec(value)
        name = values.pop("name")
        found, where = self[name], f"{self.kind} {name}"
        if dataclasses.is_dataclass(found):
            return load(found, values, where)  # type: ignore[arg-type]
        if not callable(found):
            raise InputError(f"{where}: expected a class, not {shorten(found)}")
        signature = inspect.signature(found)
        try:
            signature.bind(**values)
        except TypeError as error:
            unknown = (key for key in values if key not in signature.parameters)
            near = "".join(suggest(key, signature.parameters) for key in unknown)
            raise InputError(f"{where}: {error}{near}") from None
        if "make" in self.needs and not hasattr(found, "make"):
            return Maker(self.places.get(name, name), values)
        return found(**values)

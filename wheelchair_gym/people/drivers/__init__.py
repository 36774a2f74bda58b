"""Simulated people who drive a chair: `make_driver` makes one from a name or from settings.

For each name in `named.yaml` there is a function here that gives a `Driver`. The settings of the
file are those in which a person differs from `Driver()`.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import yaml

from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.registry import Registry
from wheelchair_gym.base.settings import InputError, dump, load
from wheelchair_gym.people.drivers.settings import Driver, interface_of

__all__ = ["DRIVERS", "driver_spec", "make_driver", "make_drivers"]

_PEOPLE: Final = yaml.safe_load(Path(__file__).with_name("named.yaml").read_text("utf-8"))


def _define(name: str, text: str, settings: Mapping[str, Any]) -> None:
    """Define the function of a person, an attribute of this module, where the registry finds it."""

    def person() -> Driver:
        return load(Driver, settings, f"driver {name}")

    person.__name__ = person.__qualname__ = name
    person.__doc__ = text
    globals()[name] = person


for _name, _person in _PEOPLE.items():
    _define(_name, **_person)

# What each name gives when it is called, without arguments: a `Driver`.
DRIVERS: Final = Registry(
    "driver",
    {name: f"{__name__}:{name}" for name in _PEOPLE},
    group="wheelchair_gym.drivers",
)


def make_driver(spec: str | Mapping[str, Any] | Driver) -> Driver:
    """A simulated person.

    Args:
        spec: a name, `{"name": name, **settings}` whose settings override the named person's, or
            a `Driver`. `module:function` names somebody's function that gives a `Driver`.

    Raises:
        InputError: the name is unknown, or a setting is wrong.
    """
    if isinstance(spec, Driver):
        return spec
    values = DRIVERS.spec(spec)
    name = values.pop("name")
    made = DRIVERS[name]()
    if not isinstance(made, Driver):
        raise InputError(f"driver {name}: it gives {shorten(made)}; expected a Driver")
    interface = values.get("interface")
    kept = made.interface.kind
    if isinstance(interface, Mapping) and interface.get("kind", kept) != kept:
        values["interface"] = interface_of(interface)  # nothing of the person's is kept
    return load(Driver, values, f"driver {name}", made)


def make_drivers(spec: Any) -> tuple[Driver, ...]:
    """The simulated people, one of which each episode draws; none for None.

    Args:
        spec: what `make_driver` takes, or a list of that; None: nobody drives.

    Raises:
        InputError: the list is empty, a name is unknown, or a setting is wrong.
    """
    if spec is None:
        return ()
    if not isinstance(spec, list | tuple):
        return (make_driver(spec),)
    if not spec:
        raise InputError("driver is an empty list; expected people to draw from")
    return tuple(make_driver(one) for one in spec)


def drivers_spec(spec: Any) -> Any:
    """Return a spec for `make_drivers` as settings store it: names, mappings, or a list of them."""
    if isinstance(spec, list | tuple):
        return [drivers_spec(one) for one in spec]
    return spec if spec is None or isinstance(spec, str) else driver_spec(spec)


def driver_spec(driver: Mapping[str, Any] | Driver) -> dict[str, Any]:
    """A mapping that `make_driver` makes an equal driver from, as settings are stored."""
    if isinstance(driver, Driver):
        return {"name": "expert", **dump(driver)}
    return dict(dump(driver))

"""`wheelchair settings`: every setting with its default, unit, bounds, purpose and source."""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import typing
from typing import Any

from agents.cli.arguments import add_json, report

OWN = {
    "footprint": "wheelchair_gym.geometry:Footprint",
    "limits": "wheelchair_gym.kinematics:Limits",
    "drive": "wheelchair_gym.kinematics:DriveGeometry",
    "sensors": "wheelchair_gym.sensors.settings:SensorSettings",
    "chair": "wheelchair_gym.physics.settings:ChairSettings",
    "imitation": "agents.learning.settings:Imitation",
    "log": "wheelchair_gym.localization.logs:LogFormat",
    "recording": "wheelchair_gym.recording.record:Recording",
    "shield": "wheelchair_gym.safety.settings:ShieldSettings",
    "slam": "wheelchair_gym.localization.slam:SlamSettings",
    "physics": "wheelchair_gym.physics.settings:PhysicsSettings",
    "task": "wheelchair_gym.task.settings:TaskSettings",
    "training": "agents.learning.settings:Training",
    "ways": "wheelchair_gym.maps.cost_to_go:WaysSettings",
}


def add(parts: Any) -> None:
    """Add the subcommand's parser."""
    parser: argparse.ArgumentParser = parts.add_parser(
        "settings",
        help="print settings with default, unit, bounds, purpose and source",
        description="Print the settings of parts of the chair, planners, followers, policies and "
        "scenes; without a name, list the names.",
        epilog="example: wheelchair settings limits a_star",
    )
    parser.add_argument("names", nargs="*", help="which to print")
    add_json(parser)
    parser.set_defaults(run=run)


def known() -> dict[str, type]:
    """Every settings class by name."""
    from agents.control import FOLLOWERS
    from agents.policies import policy_settings
    from planners import PLANNERS
    from wheelchair_gym.hardware.registry import CHAIRS
    from wheelchair_gym.scenes import SCENES

    classes: dict[str, type] = {}
    for name, place in OWN.items():
        module, _, attribute = place.partition(":")
        classes[name] = getattr(importlib.import_module(module), attribute)
    for registry in (PLANNERS, FOLLOWERS, policy_settings(), SCENES, CHAIRS):
        classes.update(registry)
    return classes


def rows_of(cls: type, prefix: str = "") -> list[dict[str, Any]]:
    """One row for each setting of a class, those of nested settings under dotted names."""
    from wheelchair_gym.config import dump

    hints = typing.get_type_hints(cls)
    rows = []
    for field in dataclasses.fields(cls):
        default = field.default
        if default is dataclasses.MISSING:
            made = field.default_factory
            default = None if made is dataclasses.MISSING else made()
        if dataclasses.is_dataclass(default):
            rows += rows_of(type(default), f"{prefix}{field.name}.")
            continue
        hint = hints[field.name]
        rows.append(
            {
                "name": prefix + field.name,
                "type": getattr(hint, "__name__", str(hint))
                if isinstance(hint, type)
                else str(hint),
                "default": dump(default),
                **{
                    key: field.metadata.get(key) for key in ("unit", "low", "high", "doc", "source")
                },
            }
        )
    return rows


def run(given: argparse.Namespace) -> int:
    """Print the settings asked for, or the names."""
    from wheelchair_gym.config import InputError

    classes = known()
    for name in given.names:
        if name not in classes:
            raise InputError(f"settings {name!r} is unknown; known: {', '.join(sorted(classes))}")
    shown = {name: rows_of(classes[name]) for name in given.names or sorted(classes)}
    lines = []
    for name, rows in shown.items():
        if not given.names:
            lines.append(name)
            continue
        lines.append(f"{name}:")
        for row in rows:
            low, high = row["low"], row["high"]
            bounds = "" if low is None and high is None else f" [{_edge(low)}, {_edge(high)}]"
            unit = f" {row['unit']}" if row["unit"] else ""
            lines.append(f"  {row['name']} = {row['default']}{unit}{bounds}")
            if row["doc"]:
                lines.append(f"      {row['doc']}")
            if row["source"]:
                lines.append(f"      source: {row['source']}")
    report(given, shown, "\n".join(lines))
    return 0


def _edge(value: float | None) -> str:
    return "" if value is None else f"{value:g}"

"""`wheelchair scenes` and `wheelchair settings`: lists of scenes and of settings."""

import argparse
import contextlib
import dataclasses
import inspect
import typing
from typing import Any

import numpy as np

from agents import read_data
from agents.cli.arguments import refuse, report, spec
from agents.cli.options import ALGORITHMS
from agents.evaluation.provenance import write_text
from agents.evaluation.tables import markdown_table
from wheelchair_gym.base.registry import imported
from wheelchair_gym.base.settings import InputError, dump, setting_docs, suggest
from wheelchair_gym.scenes import SCENES, make_scene
from wheelchair_gym.scenes.statistics import scene_statistics

PARTS: dict[str, str] = read_data("settings.yaml")  # settings that are in no registry
QUANTILES = {"least": 0.0, "p5": 0.05, "p50": 0.5, "p95": 0.95, "most": 1.0}


def scenes(given: argparse.Namespace) -> int:
    """List the scenes, or measure one."""
    if given.name is not None:
        return _measure(given)
    refuse(given, ("samples",), "expected with the name of a scene")
    docs = {name: inspect.getdoc(scene) or "" for name, scene in sorted(SCENES.items())}
    found = [{"name": name, "what": doc.split("\n")[0]} for name, doc in docs.items()]
    report(given, found, "\n".join(f"{scene['name']:<16} {scene['what']}" for scene in found))
    return 0


def _measure(given: argparse.Namespace) -> int:
    rows: list[dict[str, Any]] = []
    drawn = scene_statistics(make_scene(spec(given.name)), range(given.samples))
    for name, values in drawn.items():
        found = np.quantile(values, tuple(QUANTILES.values())).tolist()
        rows.append({"figure": name, "n": len(values), **dict(zip(QUANTILES, found, strict=True))})
    columns = ("n", *QUANTILES)
    title = f"{given.name}, seeds 0 to {given.samples - 1}"
    lines = [title.ljust(32) + "".join(f"{column:>9}" for column in columns)]
    lines += [
        f"{row['figure']:<32}" + "".join(f"{row[column]:>9.4g}" for column in columns)
        for row in rows
    ]
    value = {"scene": given.name, "samples": given.samples, "figures": rows}
    report(given, value, "\n".join(lines))
    return 0


def all_settings() -> dict[str, type]:
    """Every class of settings by name."""
    from agents.control import FOLLOWERS
    from agents.people import ASSISTANTS
    from agents.policies import POLICIES
    from planners import PLANNERS
    from wheelchair_gym.hardware.registry import CHAIRS

    classes: dict[str, type] = {name: imported(place) for name, place in PARTS.items()}
    for registry in (PLANNERS, FOLLOWERS, POLICIES, SCENES, CHAIRS):
        classes.update((name, registry[name]) for name in registry.built_in)
    for name in ASSISTANTS.built_in:  # one is called as the shield, which it has behind it
        classes.setdefault(name, ASSISTANTS[name])
    return dict(sorted(classes.items()))


def settings_rows(cls: type, prefix: str = "", made: Any = None) -> list[dict[str, Any]]:
    """Return a row for each setting of a class; nested settings have dotted names.

    Defaults are those of the settings `made`: by default of the class without arguments, or of
    each field alone where the class has required settings.
    """
    hints, docs = typing.get_type_hints(cls), setting_docs(cls)
    fields = dataclasses.fields(cls)
    if made is None:
        with contextlib.suppress(TypeError):
            made = cls()
    rows = []
    for field in fields:
        default = getattr(made, field.name, field.default)
        if default is dataclasses.MISSING:
            default = "required"
        if dataclasses.is_dataclass(default):
            rows += settings_rows(type(default), f"{prefix}{field.name}.", default)
            continue
        hint = hints[field.name]
        rows.append({
            "name": prefix + field.name,
            "type": hint.__name__ if isinstance(hint, type) else str(hint),
            "default": dump(default),
            "doc": docs.get(field.name, ""),
            **{key: field.metadata.get(key) for key in ("unit", "low", "high", "source")},
        })  # fmt: skip
    return rows


def settings(given: argparse.Namespace) -> int:
    """Print settings or their names, or write all of them as a page."""
    classes = all_settings()
    for name in given.names:
        if name not in classes:
            raise InputError(f"no settings are called {name!r}{_near(name, classes)}")
    found = {name: settings_rows(classes[name]) for name in given.names or classes}
    if given.markdown is not None:
        page = markdown(found)
        if given.markdown == "-":
            print(page, end="")
        else:
            write_text(given.markdown, page)
        return 0
    lines = []
    for name, rows in found.items():
        lines.append(f"{name}:" if given.names else name)
        for row in rows if given.names else ():
            lines.append(f"  {row['name']} = {row['default']}{_unit(row)}{_bounds(row)}")
            lines += [f"      {row['doc']}"] if row["doc"] else []
            lines += [f"      source: {row['source']}"] if row["source"] else []
    report(given, found, "\n".join(lines))
    return 0


def _near(name: str, classes: dict[str, type]) -> str:
    """The end of a message: the nearest name, else the settings that have a part called so."""
    if name in ALGORITHMS:
        return f"; {'imitation' if name == 'bc' else 'training'} has those of `train {name}`"
    if near := suggest(name.lower(), classes):
        return near
    parts = {key: [f.name for f in dataclasses.fields(cls)] for key, cls in classes.items()}
    holders = [each for each, fields in parts.items() if name in fields]
    if holders:
        return f"; {name} is a setting of {', '.join(holders)}"
    return "; `wheelchair settings` lists all names"


def _unit(row: dict[str, Any]) -> str:
    return f" {row['unit']}" if row["unit"] else ""


def _bounds(row: dict[str, Any]) -> str:
    low, high = ("" if row[end] is None else f"{row[end]:g}" for end in ("low", "high"))
    return f" [{low}, {high}]" if low or high else ""


def markdown(settings: dict[str, list[dict[str, Any]]]) -> str:
    """Settings as a page of tables."""
    text = "# Settings\n\nWritten by `wheelchair settings --markdown docs/settings.md`.\n"
    heads = ("setting", "default", "bounds", "what it does", "source")
    for name, rows in settings.items():
        cells = [
            (f"`{row['name']}`", f"`{row['default']}`{_unit(row)}", _bounds(row).strip(),
             row["doc"].strip(), row["source"] or "")
            for row in rows
        ]  # fmt: skip
        text += f"\n## {name}\n\n{markdown_table(heads, cells) if cells else 'No settings.'}"
        text += "" if cells else "\n"
    return text

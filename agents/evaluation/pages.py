"""HTML pages by Jinja2: the environment of the templates in agents/templates, and its filters."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from agents.evaluation.tables import exists
from wheelchair_gym.files import atomic_write

Figures = Mapping[str, tuple[str, bytes]]  # name: caption and SVG
_TYPES = {
    ".gif": "image/gif", ".svg": "image/svg+xml", ".mp4": "video/mp4", ".webp": "image/webp",
}  # fmt: skip


@cache
def templates() -> jinja2.Environment:
    """The environment of the templates; values in HTML are escaped."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("agents", "templates"),
        autoescape=jinja2.select_autoescape(),
        undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {
        "flat": flat,
        "data_uri": data_uri,
        "count": count,
        "sort_key": lambda value: f"{value:.9g}" if exists(value) else "",
    }
    environment.tests |= {"figure": exists}
    return environment


def macro(name: str, *arguments: Any) -> Markup:
    """The HTML of a macro of macros.html."""
    return Markup(getattr(templates().get_template("macros.html").module, name)(*arguments))


def write_page(path: Path, template: str, **context: Any) -> Path:
    """Write a page that needs no other file; its path."""
    page = templates().get_template(template).render(context)
    with atomic_write(path) as part:
        part.write_text(page, encoding="utf-8")
    return path


def data_uri(data: bytes, suffix: str) -> str:
    """Data embedded in a page."""
    return f"data:{_TYPES[suffix]};base64,{base64.b64encode(data).decode()}"


def count(number: int, singular: str, plural: str | None = None) -> str:
    """A number with its noun."""
    return f"{number} {singular if number == 1 else plural or singular + 's'}"


def flat(value: Any, name: str = "") -> Iterator[tuple[str, str]]:
    """Nested values as (dotted name, text); a list of plain values is one line."""
    if isinstance(value, Mapping) and value:
        for key, item in value.items():
            yield from flat(item, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list | tuple) and any(isinstance(v, Mapping | list) for v in value):
        for k, item in enumerate(value):
            yield from flat(item, f"{name}[{k}]")
    elif isinstance(value, list | tuple):
        integers = all(isinstance(v, int) for v in value) and len(value) > 3
        run = integers and list(value) == list(range(value[0], value[0] + len(value)))
        yield name, f"{value[0]} to {value[-1]}" if run else ", ".join(map(str, value))
    else:
        yield name, "-" if value is None or value == {} else str(value)

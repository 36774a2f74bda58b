"""Tables of results, the same as Markdown, HTML and CSV, and the pages that hold them (Jinja2)."""

import base64
import csv
import io
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from agents import read_data
from agents.evaluation.provenance import write_text

if TYPE_CHECKING:
    import jinja2

Row = Mapping[str, Any]
Figures = Mapping[str, tuple[str, bytes]]  # name: caption and SVG
_TYPES = {
    ".gif": "image/gif", ".svg": "image/svg+xml", ".mp4": "video/mp4", ".webp": "image/webp",
}  # fmt: skip


class Column(NamedTuple):
    """A column: the key of its figure in a row, its heading, and how the figure is written."""

    key: str
    name: str
    unit: str | None = ""  # None: a column of text
    digits: int | str = 2  # after the point, or a format
    factor: float = 1.0
    interval: bool = False  # the row has an interval, under the keys KEY_low and KEY_high
    meaning: str = ""

    @property
    def heading(self) -> str:
        """The name with the unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    def text(self, value: float | None) -> str:
        """A figure as it is written; a dash where there is none."""
        form = self.digits if isinstance(self.digits, str) else f".{self.digits}f"
        return f"{value * self.factor:{form}}" if exists(value) else "-"  # type: ignore[operator]

    def bounds(self, row: Row) -> str:
        """The interval as 'low-high', or 'low to high' with a sign; empty where there is none."""
        if not self.interval or row.get(self.key) is None:
            return ""
        low, high = (self.text(row[f"{self.key}_{end}"]) for end in ("low", "high"))
        return f"{low}{' to ' if '-' in low + high else '-'}{high}"

    def cell(self, row: Row) -> "Cell":
        """The cell of a row; a dash where the row has no such figure."""
        value = row.get(self.key)
        if self.unit is None:
            return Cell(str(value))
        return Cell(self.text(value), self.bounds(row), value)


class Cell(NamedTuple):
    """A cell: its text, small print below it, and its sort key."""

    text: str
    small: str = ""
    key: float | None = None
    bold: bool = False
    link: str = ""


class Table(NamedTuple):
    """A table; each group of rows is a separate body in HTML."""

    caption: str
    columns: Sequence[Column]
    groups: Sequence[Sequence[Sequence[Cell]]]
    note: str = ""

    def html(self) -> str:
        """The table as HTML, sorted by the heading that is clicked; empty without rows."""
        page: Any = templates().get_template("macros.html").module
        return page.table(self) if any(self.groups) else ""

    def text(self) -> str:
        """The table as aligned columns for a terminal."""
        rows = [[column.heading for column in self.columns]]
        for cell_row in (row for group in self.groups for row in group):
            rows.append([f"{c.text} ({c.small})" if c.small else c.text for c in cell_row])
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        align = [str.ljust if column.unit is None else str.rjust for column in self.columns]
        lines = ([f(t, n) for f, t, n in zip(align, row, widths, strict=True)] for row in rows)
        return "\n".join("  ".join(line).rstrip() for line in lines)

    def markdown(self) -> str:
        """The table as Markdown, with its note below."""
        rows = []
        for cell_row in (row for group in self.groups for row in group):
            texts = [f"**{cell.text}**" if cell.bold else cell.text for cell in cell_row]
            small = [f" ({cell.small})" if cell.small else "" for cell in cell_row]
            rows.append([text + more for text, more in zip(texts, small, strict=True)])
        right = [column.unit is not None for column in self.columns]
        return markdown_table([column.heading for column in self.columns], rows, right) + (
            f"\n{self.note}\n" if self.note else ""
        )


def columns_of(table: str) -> list[Column]:
    """Return the columns of a table of agents/data/tables.yaml."""
    return [Column(**column) for column in read_data("tables.yaml")[table]]


def make_table(caption: str, columns: Sequence[Column], groups: Iterable[Sequence[Row]]) -> Table:
    """A table of groups of rows."""
    cells = [[[column.cell(row) for column in columns] for row in rows] for rows in groups]
    return Table(caption, columns, cells)


def exists(value: Any) -> bool:
    """Whether a figure exists: neither null nor NaN nor infinite."""
    return value is not None and math.isfinite(value)


def json_value(value: Any) -> Any:
    """Return a value for JSON, which knows neither infinity nor NaN: they become null."""
    if isinstance(value, Mapping):
        return {key: json_value(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [json_value(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def markdown_table(
    headings: Sequence[str], rows: Iterable[Sequence[Any]], right: Sequence[bool] = ()
) -> str:
    """Rows as a Markdown table; `right` says which columns are aligned to the right."""
    rule = ["---:" if aligned else "---" for aligned in right] or ["---"] * len(headings)
    lines = [headings, rule, *rows]
    texts = ([str(cell).replace("|", "\\|") for cell in line] for line in lines)
    return "".join(f"| {' | '.join(line)} |\n" for line in texts)


def _plain(value: Any) -> Any:
    """A cell of CSV that no spreadsheet takes for a formula; numbers are unchanged."""
    if not (isinstance(value, str) and value.startswith(("=", "+", "-", "@", "\t", "\r"))):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value


def csv_table(rows: Sequence[Row], columns: Iterable[str] = ()) -> str:
    """Rows as CSV under a header; without `columns`, those of all rows in their order.

    Text that a spreadsheet would take for a formula begins with an apostrophe.
    """
    names = list(columns) or list(dict.fromkeys(key for row in rows for key in row))
    cells: list[list[Any]] = [names, *([row.get(name) for name in names] for row in rows)]
    lines = [[_plain(cell) for cell in line] for line in cells]
    # Python's csv leaves a carriage return unquoted, which would begin a line.
    returns = any(isinstance(cell, str) and "\r" in cell for line in lines for cell in line)
    text = io.StringIO()
    csv.writer(
        text, lineterminator="\n",
        quoting=csv.QUOTE_NONNUMERIC if returns else csv.QUOTE_MINIMAL,
    ).writerows(lines)  # fmt: skip
    return text.getvalue()


@cache
def templates() -> "jinja2.Environment":
    """The environment of the templates in agents/templates; values in HTML are escaped."""
    import jinja2  # loaded only for pages

    from wheelchair_gym.rendering.palette import style_sheet

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("agents", "templates"),
        autoescape=jinja2.select_autoescape(),
        undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.globals["theme"] = style_sheet()
    environment.filters |= {
        "flat": flat,
        "data_uri": data_uri,
        "count": count,
        "sort_key": lambda value: f"{value:.9g}" if exists(value) else "",
    }
    environment.tests |= {"figure": exists}
    return environment


def write_page(path: Path, template: str, **context: Any) -> Path:
    """Write a page that needs no other file; its path."""
    write_text(path, templates().get_template(template).render(context))
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

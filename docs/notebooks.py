"""Notebooks of tutorials: `python docs/notebooks.py` writes them to examples/notebooks.

A block of Python becomes a cell, a block that is a file's content a cell that writes the file; text
and commands of a shell stay text.
"""

import json
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "examples" / "notebooks"
PAGES = ("rrt_star_woa", "train", "own_map", "own_policy", "own_planner", "own_robot")
_BLOCK = re.compile(r"((?:^<!-- [^\n]* -->\n+)*)^```python\n(.*?)^```\n", re.M | re.S)
_LINK = re.compile(r"\]\(((?!https?:)[^)#]+)(#[^)]*)?\)")


def notebook(page: Path) -> dict[str, Any]:
    """The content of a page's notebook."""
    text = page.read_text(encoding="utf-8")
    cells: list[dict[str, Any]] = []

    def add(kind: str, content: str) -> None:
        content = content.strip()
        if content:
            cell = {"cell_type": kind, "metadata": {}, "id": f"{page.stem}-{len(cells)}"}
            cell["source"] = content.splitlines(keepends=True)
            cells.append(
                cell | ({"outputs": [], "execution_count": None} if kind == "code" else {})
            )

    end = 0
    for block in _BLOCK.finditer(text):
        add("markdown", _links(text[end : block.start()], page))
        file = re.search(r"<!-- file (\S+) -->", block[1])
        add("code", f"%%writefile {file[1]}\n{block[2]}" if file else block[2])
        end = block.end()
    add("markdown", _links(text[end:], page))
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    return {"cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}


def _links(text: str, page: Path) -> str:
    """Text whose links lead to pages from where notebooks lie."""

    def moved(link: re.Match[str]) -> str:
        target = (page.parent / link[1]).resolve().relative_to(ROOT)
        return f"](../../{target.as_posix()}{link[2] or ''})"

    return _LINK.sub(moved, re.sub(r"^<!-- .* -->\n", "", text, flags=re.M))


def contents() -> dict[Path, str]:
    """The text of each notebook's file."""
    pages = {FOLDER / f"{name}.ipynb": ROOT / "docs" / "tutorials" / f"{name}.md" for name in PAGES}
    return {path: json.dumps(notebook(page), indent=1) + "\n" for path, page in pages.items()}


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    for path, text in contents().items():
        path.write_text(text, encoding="utf-8")

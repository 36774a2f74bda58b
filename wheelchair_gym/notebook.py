"""What notebooks show: settings as a table, pictures, and paths as drawings."""

from __future__ import annotations

import base64
import dataclasses
import html
import io
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.config import setting_docs

_WIDTH = 480  # pixels of a picture


def picture_html(image: NDArray[np.uint8]) -> str:
    """An RGB picture (h, w, 3), inline."""
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(image).save(out, "png")
    data = base64.b64encode(out.getvalue()).decode()
    return f'<br><img width="{_WIDTH}" alt="from above" src="data:image/png;base64,{data}">'


def settings_html(settings: Any) -> str:
    """The settings of a dataclass that differ from their defaults, as a table."""
    rows = []
    docs = setting_docs(type(settings))
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        if value == field.default:
            continue
        cells = field.name, repr(value), field.metadata.get("unit", ""), docs.get(field.name, "")
        rows.append("".join(f"<td>{html.escape(cell)}</td>" for cell in cells))
    if not rows:
        return "<p>default settings</p>"
    return f"<table>{''.join(f'<tr>{row}</tr>' for row in rows)}</table>"


def path_html(path: ArrayLike, caption: str) -> str:
    """A path (n, 2 or 3) [m] as a drawing with a caption, y upwards."""
    points = np.asarray(path, dtype=np.float64)[:, :2]
    text = f"<p>{html.escape(caption)}</p>"
    if not len(points):
        return text
    low, high = points.min(axis=0) - 0.5, points.max(axis=0) + 0.5
    width, height = (high - low).tolist()
    line = " ".join(
        f"{x:.3f},{y:.3f}"
        for x, y in np.column_stack([points[:, 0] - low[0], high[1] - points[:, 1]])
    )
    pen = 0.01 * max(width, height)
    return text + (
        f'<svg width="{_WIDTH}" viewBox="0 0 {width:.3f} {height:.3f}">'
        f'<polyline points="{line}" fill="none" stroke="#0072b2" stroke-width="{pen:.3f}"/></svg>'
    )

"""The curve of a training run: a row for each checkpoint, in CSV and for TensorBoard."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

from agents.evaluation.provenance import write_text
from wheelchair_gym.errors import InputError
from wheelchair_gym.files import read_text

NAME = "curve.csv"
Row = dict[str, Any]


class Tally:
    """What episodes came to since the last checkpoint, and the curriculum that follows from it."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Forget everything."""
        self.episodes = self.success = self.truncated = 0
        self.returns, self.lengths = 0.0, 0

    def add(self, infos: Any, dones: Any) -> None:
        """Take in the infos of a step."""
        for i in dones.nonzero()[0].tolist():
            info = infos[i]
            self.episodes += 1
            self.success += info["is_success"]
            self.truncated += info["TimeLimit.truncated"]
            self.returns += info["episode"]["r"]
            self.lengths += info["episode"]["l"]

    def row(self) -> Row:
        """Shares and means."""
        n = max(1, self.episodes)
        return {
            "episodes": self.episodes,
            "success": self.success / n,
            "timeout": self.truncated / n,
            "return": self.returns / n,
            "length": self.lengths / n,
        }


def read_curve(folder: Path) -> list[Row]:
    """The rows of a folder's curve, as they were written.

    Raises:
        InputError: it cannot be read.
    """
    path = folder / NAME
    if not path.exists():
        return []
    try:
        rows = list(csv.DictReader(io.StringIO(read_text(path))))
    except csv.Error as error:
        raise InputError(f"{path}: not a table in CSV ({error})") from None
    return [
        {key: _value(word) for key, word in row.items() if key is not None and word} for row in rows
    ]


def _value(word: Any) -> Any:
    """A number where a word is one, as `write_curve` was given it; else the word itself."""
    for kind in (int, float):
        try:
            return kind(word)
        except (ValueError, TypeError):
            continue
    return word


def write_curve(folder: Path, rows: list[Row]) -> None:
    """Write a curve whole; columns are those of all rows, in order."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_text(folder / NAME, text.getvalue())


class Board:
    """TensorBoard's log of the same rows; nothing where it is not installed."""

    def __init__(self, folder: Path) -> None:
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError:
            self._writer: Any = None
        else:
            self._writer = SummaryWriter(str(folder / "tensorboard"))

    def add(self, row: Row) -> None:
        """Log one row."""
        if self._writer is None:
            return
        for key, value in row.items():
            if key != "frames" and isinstance(value, int | float):
                self._writer.add_scalar(key, value, int(row["frames"]))
        self._writer.flush()

    def close(self) -> None:
        """Close the log."""
        if self._writer is not None:
            self._writer.close()

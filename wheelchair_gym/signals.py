"""The signals of a chair, as signals.toml declares them."""

import tomllib
from pathlib import Path
from typing import Any, NamedTuple

from wheelchair_gym.sensors.settings import RANGERS


class Signal(NamedTuple):
    """One signal. Where its shape has a word, the length varies."""

    name: str  # a field of `Reading` or `Truth`
    kind: str  # numpy's
    shape: tuple[int | str, ...]
    unit: str
    frame: str
    source: str
    meaning: str
    info: str  # its key in `info`; empty: none
    column: str  # its field in the record of a control period

    @property
    def is_fixed(self) -> bool:
        """Whether its size never varies."""
        return all(isinstance(side, int) for side in self.shape)


def _signal(row: dict[str, Any]) -> Signal:
    given = {"unit": "", "frame": "", "info": "", "column": row["name"], **row}
    sides = (RANGERS if side == "rangers" else side for side in row.get("shape", ()))
    return Signal(**given | {"shape": tuple(sides)})


_ROWS = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
READING = tuple(map(_signal, _ROWS["reading"]))
TRUTH = tuple(map(_signal, _ROWS["truth"]))
# Those whose size never varies: fields of the record of a control period.
SENSED_READING = tuple(signal for signal in READING if signal.is_fixed)
SENSED_TRUTH = tuple(signal for signal in TRUTH if signal.is_fixed)

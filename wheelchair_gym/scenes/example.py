"""The map that comes with the package: `python -m wheelchair_gym.scenes.example` draws it anew."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from wheelchair_gym.maps import OccupancyGrid, write_map
from wheelchair_gym.scenes.floor_plan import FloorPlan
from wheelchair_gym.scenes.map_file import example_map
from wheelchair_gym.scenes.raster import CELL

SEED: Final = 1
SIZE: Final = (15.0, 12.0)  # m


def example_clinic() -> OccupancyGrid:
    """A small clinic of 15 m x 12 m, always the same, its lower-left corner at (0, 0)."""
    storey = FloorPlan(kind="clinic").building(np.random.default_rng(SEED), False, *SIZE)
    return OccupancyGrid(storey.cells, CELL)


def main(path: Path | None = None) -> None:
    """Write the map where the package keeps it, or elsewhere."""
    write_map(example_clinic(), example_map() if path is None else path)


if __name__ == "__main__":
    main()

"""`wheelchair convert`: any map file as one of map_server."""

from __future__ import annotations

import argparse
from pathlib import Path

from agents.cli.arguments import report
from wheelchair_gym.config import InputError
from wheelchair_gym.maps import read_any_map, write_map


def run(given: argparse.Namespace) -> int:
    """Write the YAML file and its image."""
    out = Path(given.out or Path(given.file).with_suffix(".yaml").name)
    if out.suffix not in (".yaml", ".yml"):
        raise InputError(f"--out {out}: expected a name that ends with .yaml")
    for path in (out, out.with_suffix(".pgm")):
        if path.exists():
            raise InputError(f"{path} exists; expected a new name (--out)")
    grid = read_any_map(given.file, resolution=given.resolution).grid
    write_map(grid, out)
    rows, columns = grid.shape
    size = [columns * grid.resolution, rows * grid.resolution]
    value = {"file": str(out), "resolution": grid.resolution, "size": size, "origin": grid.origin}
    text = (
        f"{out}: {size[0]:g} m x {size[1]:g} m, {columns} x {rows} cells of {grid.resolution:g} m"
    )
    report(given, value, text)
    return 0

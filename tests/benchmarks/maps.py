"""How fast the exact optimum is on large raster maps: `python -m tests.benchmarks.maps [FILE ...]`.

Without files, a building of 2,000 x 2,000 cells by a seed. Preparation is what a map needs once for
each clearance: its boundary, growth, buckets, triangles, corners. Queries are between free cells
drawn at random from one connected region.
"""

from __future__ import annotations

import json
import statistics
import sys
import time

import cv2
import numpy as np

from planners import Problem, Space, make_planner
from planners.graphs.visibility import optima
from wheelchair_gym.maps import FREE, OCCUPIED, OccupancyGrid, read_any_map

SIDE, CELL, SEED, QUERIES, CLEARANCES = 2000, 0.05, 1, 30, (0.0, 0.35)


def noisy_building(seed: int, side: int = SIDE) -> OccupancyGrid:
    """Rooms with doors and furniture as a laser would map them: every outline is ragged."""
    rng = np.random.default_rng(seed)
    solid = np.zeros((side, side), dtype=np.bool_)
    walls = np.arange(0, side, 160)  # 8 m apart, 0.2 m thick
    for at in walls:
        solid[at : at + 4] = solid[:, at : at + 4] = True
    for at in walls[1:]:
        for begin in walls:
            door = begin + rng.integers(20, 110, 2)
            solid[at : at + 4, door[0] : door[0] + 24] = False  # 1.2 m wide
            solid[door[1] : door[1] + 24, at : at + 4] = False
    for _ in range(side * side // 4000):
        x, y = rng.integers(0, side, 2)
        w, h = rng.integers(2, 24, 2)
        solid[y : y + h, x : x + w] = True
    rim = solid ^ cv2.dilate(solid.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.bool_)
    solid |= rim & (rng.random(solid.shape) < 0.3)
    solid[[0, -1]] = solid[:, [0, -1]] = True
    return OccupancyGrid(np.where(solid, OCCUPIED, FREE).astype(np.int8), CELL)


def _places(grid: OccupancyGrid, clearance: float) -> np.ndarray:
    """Centres of cells of the largest region in which a disc of the clearance and more moves."""
    wide = grid.traversable(clearance * 1.03 + grid.resolution).astype(np.uint8)
    _, region = cv2.connectedComponents(wide, connectivity=4)
    sizes = np.bincount(region.ravel())
    sizes[0] = 0
    return grid.to_world(np.argwhere(region == np.argmax(sizes)))


def measure(grid: OccupancyGrid, clearance: float) -> dict[str, float]:
    """Times of preparing a map at a clearance and of queries in it."""
    begun = time.perf_counter()
    base = Space.from_grid(grid)
    base.arrays  # noqa: B018
    free = base.inflated(clearance)
    free.arrays, free.mesh, free.corners  # noqa: B018
    spent = time.perf_counter() - begun
    places = _places(grid, clearance)
    rng, planner = np.random.default_rng(SEED), make_planner("visibility")
    times, gaps, cones = [], [], []
    for k in range(QUERIES):
        start, goal = places[rng.integers(len(places), size=2)]
        problem = Problem(base, start, goal, clearance)
        begun = time.perf_counter()
        plan = planner.plan(problem, rng)
        times.append(1e3 * (time.perf_counter() - begun))
        cones.append(plan.counters.get("cones", 0))
        if clearance > 0.0 and k < 5:
            best = optima(problem)
            gaps.append(best.constrained / best.at_least)
    return {
        "clearance_m": clearance,
        "corners": len(free.corners.place),
        "preparation_ms": 1e3 * spent,
        "query_median_ms": statistics.median(times),
        "query_p90_ms": float(np.quantile(times, 0.9)),
        "query_max_ms": max(times),
        "cones_median": statistics.median(cones),
        "most_over_bound": max(gaps, default=1.0),
    }


def main() -> None:
    """Print a line for each map and clearance on standard error, JSON on standard output."""
    grids = {file: read_any_map(file).grid for file in sys.argv[1:]}
    grids = grids or {f"building, seed {SEED}": noisy_building(SEED)}
    measure(noisy_building(0, 200), 0.35)  # compiles
    rows = []
    for name, grid in grids.items():
        for clearance in CLEARANCES:
            row = {"map": name, "cells": list(grid.shape), **measure(grid, clearance)}
            rows.append(row)
            print(
                f"{name}, {grid.shape[1]} x {grid.shape[0]} cells, clearance {clearance} m:"
                f" {row['corners']} corners, preparation {row['preparation_ms']:.0f} ms, query"
                f" median {row['query_median_ms']:.2f} ms, p90 {row['query_p90_ms']:.1f},"
                f" most {row['query_max_ms']:.1f}; at most {row['most_over_bound']:.5f} x optimum",
                file=sys.stderr,
            )
    json.dump(rows, sys.stdout, indent=2)
    print()


if __name__ == "__main__":
    main()

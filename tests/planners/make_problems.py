"""Write problems.json: `python -m tests.planners.make_problems`.

Maps of rectangles drawn from seeds, and the length of the shortest path by the oracle, which shares
no code with the planners.
"""

import itertools
import json
from pathlib import Path

import numpy as np
import shapely

from tests.planners.oracle import shortest_line

FILE = Path(__file__).with_name("problems.json")


def clutter(rng, size=50.0, count=24):
    """Blocks of 2 m to 5 m that leave the two corners of start and goal open."""
    found = []
    while len(found) < count:
        low, extent = rng.integers(2, 2 * size - 10, 2) / 2, rng.integers(4, 11, 2) / 2
        x, y, top = *low, low + extent
        if min(top.max(), size - min(x, y)) > 6.0:
            found.append((x, y, *top))
    return found


def slabs(rng, size=30.0, count=4):
    """Walls across the map, each with a gap of 1.5 m."""
    found = []
    for x in np.linspace(5.0, size - 6.0, count).round(1):
        gap = rng.integers(4, 2 * size - 8) / 2
        found += [(x, 0.0, x + 1.0, gap), (x, gap + 1.5, x + 1.0, size)]
    return found


def rooms(rng, size=29.0, count=3, door=1.0):
    """A square of rooms; doors join them to a tree, as in a maze."""
    joined, doors, pitch = {(0, 0)}, set(), size / count
    cells = list(itertools.product(range(count), repeat=2))
    while len(joined) < count**2:
        i, j = cells[rng.integers(len(cells))]
        di, dj = ((0, 1), (1, 0), (0, -1), (-1, 0))[rng.integers(4)]
        other = i + di, j + dj
        if (i, j) in joined and other in set(cells) - joined:
            joined.add(other)
            doors.add(frozenset({(i, j), other}))
    found = []
    for i, j in cells:
        for across, other in ((0, (i + 1, j)), (1, (i, j + 1))):
            if other not in cells:
                continue
            at, low = pitch * ((i, j)[across] + 1), pitch * (i, j)[1 - across]
            gap = low + rng.uniform(1.5, pitch - 2.5)
            ends = [(low, gap), (gap + door, low + pitch)]
            for a, b in ends if frozenset({(i, j), other}) in doors else [(low, low + pitch)]:
                wall = (at - 0.5, a, at + 0.5, b)
                found.append(wall if across == 0 else (a, at - 0.5, b, at + 0.5))
    return found


def problems():
    drawn = {
        "open": (40.0, []),
        "clutter": (50.0, clutter(np.random.default_rng(4))),
        "slabs": (30.0, slabs(np.random.default_rng(1))),
        "rooms": (29.0, rooms(np.random.default_rng(4))),
    }
    for name, (size, rectangles) in drawn.items():
        rects = [[round(float(v), 3) for v in r] for r in rectangles]
        start, goal = [2.0, 2.0], [size - 2.0, size - 2.0]
        solid = shapely.union_all([shapely.box(*r) for r in rects])
        best = round(shortest_line(shapely.box(0, 0, size, size), solid, start, goal), 8)
        yield {"name": name, "size": size, "rects": rects, "start": start, "goal": goal,
               "optimum": best}  # fmt: skip


if __name__ == "__main__":
    lines = ",\n".join(json.dumps(problem) for problem in problems())
    FILE.write_text(f"[\n{lines}\n]\n")

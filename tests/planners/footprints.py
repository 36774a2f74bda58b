"""Problems for a chair's outline, each with the oracle's verdict.

`python -m tests.planners.footprints` judges them anew and prints the content of `footprint.json`.
Starts and goals lie on the oracle's grid, and so do the middles of doors and corridors.
"""

import dataclasses
import itertools
import json
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely

from planners import Problem, Space
from planners.collision.footprint import STRAIGHT, TESTED_LENGTH, free_gap, surroundings
from planners.collision.nearby import nearby
from planners.lattice.lattice import Lattice
from tests.planners.oracle import Oracle, Verdict
from tests.planners.pose_grid import LONGEST, STEP, WIDEST
from wheelchair_gym.base.settings import dump, load
from wheelchair_gym.geometry.kinematics import Limits
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import polygon_edges, wrap
from wheelchair_gym.maps.driving_cost import STILL, kind_of, stretch_cost

FILE = Path(__file__).with_name("footprint.json")
MARGINS = (0.02, 0.05, 0.10, 0.20)  # m beyond the chair's width
WIDTH = 2.0 * Footprint().half_width  # m
UP, DOWN, LEFT = math.pi / 2, -math.pi / 2, math.pi
MIDWHEEL = Footprint(front=0.45, rear=0.45, half_width=0.29)  # turns about its middle


class Case(NamedTuple):
    problem: Problem
    footprint: Footprint
    verdict: Verdict


def stretches_of(path):
    """The way [m] and the turn [rad] of each stretch between poses (n, 3)."""
    for (x, y, yaw), (to_x, to_y, to_yaw) in itertools.pairwise(path):
        half = 0.5 * wrap(to_yaw - yaw)
        chord = math.cos(yaw + half) * (to_x - x) + math.sin(yaw + half) * (to_y - y)
        yield (chord * half / math.sin(half) if abs(half) > STRAIGHT else chord), 2.0 * half


def path_gaps(path, space, footprint, enough=1.0):
    """The gaps (n - 1,) [m] along the stretches between poses (n, 3), at most `enough`."""
    motion = Lattice().motion_cost(footprint, Limits(), 0.0)._replace(desired_clearance=enough)
    around = surroundings(nearby(space, footprint.reach + TESTED_LENGTH + enough), motion)
    pairs = zip(path, stretches_of(path), strict=False)
    return np.array([free_gap(around, tuple(pose), *stretch) for pose, stretch in pairs])


def path_cost(path, motion, space=None, footprint=None):
    """Cost [s] of poses (n, 3): time, stops to change the direction, and clearance in a space."""
    spent, before, gaps = 0.0, 0, np.full(len(path), motion.desired_clearance)
    if space is not None:
        gaps = path_gaps(path, space, footprint, motion.desired_clearance)
    for (way, turn), gap in zip(stretches_of(path), gaps, strict=False):
        way = way if abs(way) > 1e-7 else 0.0
        kind = kind_of(way, turn)
        if max(abs(way), abs(turn)) < STILL:
            continue
        spent += stretch_cost(motion, way, turn, gap)
        spent += motion.switch_time if before not in (0, kind) else 0.0
        before = kind
    return spent


def _outside(rooms, size):
    """Everything but some rectangular rooms, as rectangles."""
    xs = sorted({0.0, size[0], *(v for room in rooms for v in room[::2])})
    rects = []
    for x0, x1 in itertools.pairwise(xs):
        y = 0.0
        over = sorted((r[1], r[3]) for r in rooms if r[0] <= x0 and r[2] >= x1)
        for low, high in [*over, (size[1], size[1])]:
            if low > y + 1e-9:
                rects.append((x0, round(y, 6), x1, low))
            y = max(y, high)
    return rects


def drawn():
    """(name, size, rectangles, start, goal, footprint) of every problem."""
    chair, cases = Footprint(), []
    for margin in MARGINS:
        cm, half = round(100 * margin), round((WIDTH + margin) / 2, 6)
        walls = [(0.0, 1.2, 3.0 - half, 1.32), (3.0 + half, 1.2, 6.0, 1.32)]
        ends = (0.6, 0.6, 0.0), (3.0, 3.6)
        cases.append((f"side_door_{cm}", (6.0, 4.8), walls, *ends, chair))
        walls = [(3.0, 0.0, 3.12, 1.8 - half), (3.0, 1.8 + half, 3.12, 3.6)]
        ends = (1.2, 0.9, UP), (4.8, 2.7)
        cases.append((f"door_ahead_{cm}", (6.0, 3.6), walls, *ends, chair))
        walls = [(2.0, 0.0, 5.0, 1.5 - half), (2.0, 1.5 + half, 5.0, 3.0)]
        ends = (0.9, 0.9, LEFT), (6.0, 1.8, 0.0)
        cases.append((f"corridor_{cm}", (7.0, 3.0), walls, *ends, chair))
    for width in (0.66, 0.84, 0.96, 1.2):
        size, half = (3.9, 3.9), width / 2
        rooms = [(0.0, 0.9 - half, 3.0 + half, 0.9 + half), (3.0 - half, 0.9, 3.0 + half, 3.9)]
        ends = (0.6, 0.9, 0.0), (3.0, 3.0)
        cases.append((f"l_turn_{round(100 * width)}", size, _outside(rooms, size), *ends, chair))
    for width in (0.78, 0.9):
        size, half = (6.0, 3.6), width / 2
        rooms = [(0.0, 0.0, 6.0, 1.2), (3.0 - half, 1.2, 3.0 + half, 3.6)]
        ends = (0.9, 0.6, 0.0), (3.0, 2.7)
        cases.append((f"t_turn_{round(100 * width)}", size, _outside(rooms, size), *ends, chair))
    size = (5.4, 3.0)
    rooms = [(0.0, 0.0, 2.4, 3.0), (2.4, 1.11, 5.4, 1.89)]
    inside, outside = (4.5, 1.5, 0.0), (0.9, 0.6)
    cases.append(("dead_end", size, _outside(rooms, size), inside, outside, chair))
    ends = (0.9, 0.6, 0.0), (4.5, 1.5, LEFT)
    cases.append(("dead_end_in_backwards", size, _outside(rooms, size), *ends, chair))
    desk = [(0.9, 2.7, 1.5, 3.6), (2.22, 2.7, 2.7, 3.6), (1.5, 3.2, 2.22, 3.6)]
    cases.append(("desk", (3.6, 3.6), desk, (0.9, 0.9, 0.0), (1.86, 2.4, UP), chair))
    bed = [(1.2, 1.5, 2.1, 3.6), (2.91, 2.4, 3.6, 3.6)]
    cases.append(("beside_bed", (3.6, 3.6), bed, (0.6, 0.9, 0.0), (2.49, 2.4, UP), chair))
    ends = (0.6, 0.9, 0.0), (2.49, 2.7, DOWN)
    cases.append(("beside_bed_backwards", (3.6, 3.6), bed, *ends, chair))
    size = (4.8, 2.1)
    rooms = [(0.0, 0.0, 4.8, 1.2), (1.5, 1.2, 3.3, 2.1)]
    ends = (0.6, 0.6, 0.0), (2.1, 1.62, 0.0)
    cases.append(("parallel", size, _outside(rooms, size), *ends, chair))
    size = (5.4, 2.4)
    rooms = [(0.0, 0.0, 5.4, 0.9), (2.1, 0.9, 3.0, 2.4)]
    ends = (0.6, 0.45, 0.0), (0.9, 0.45, LEFT)
    cases.append(("three_point_turn", size, _outside(rooms, size), *ends, chair))
    ends = (0.6, 0.6, 0.0), (3.0, 3.6)
    for name, half, footprint in (("midwheel_side_door", 0.3, MIDWHEEL), ("no_door", 0.25, chair)):
        walls = [(0.0, 1.2, 3.0 - half, 1.32), (3.0 + half, 1.2, 6.0, 1.32)]
        cases.append((name, (6.0, 4.8), walls, *ends, footprint))
    return cases


def judged(size, rects, start, goal, footprint):
    corners = [[(a, b), (c, b), (c, d), (a, d)] for a, b, c, d in rects]
    solid = shapely.union_all([shapely.polygons(c) for c in corners])
    edges = np.vstack([polygon_edges(c) for c in corners])
    return Oracle(edges, [], solid, (0.0, 0.0, *size), footprint, start).judge(start, goal)


def read():
    cases = []
    for item in json.loads(FILE.read_text())["problems"]:
        bounds = (0.0, 0.0, *item["size"])
        footprint = load(Footprint, item["footprint"], item["name"])
        space = Space.from_rectangles(item["rects"], bounds)
        problem = Problem(space, np.array(item["start"]), np.array(item["goal"]), name=item["name"])
        lower, upper = (math.inf if v is None else v for v in (item["lower"], item["upper"]))
        cases.append(Case(problem, footprint, Verdict(item["feasible"], lower, upper)))
    return cases


def main():
    problems = []
    for name, size, rects, start, goal, footprint in drawn():
        verdict = judged(size, rects, start, goal, footprint)
        bounds = {k: None if math.isinf(v) else round(v, 4)
                  for k, v in dataclasses.asdict(verdict).items() if k != "feasible"}  # fmt: skip
        problems.append(
            {"name": name, "size": size, "rects": rects, "start": start, "goal": goal,
             "footprint": dump(footprint), "feasible": verdict.feasible, **bounds}
        )  # fmt: skip
    provenance = {
        "command": "python -m tests.planners.footprints > tests/planners/footprint.json",
        "units": "m, rad; footprint: front, rear of and half width beside the drive axle's centre",
        "oracle": {"step_m": STEP, "headings_apart_deg": math.degrees(WIDEST),
                   "longest_step": LONGEST},
        "feasible": "true: a way is known; false: proven that there is none; null: neither",
        "lower": "m: no way of the axle's centre is shorter (disc within the outline)",
        "upper": "m: a way of this length is known: straight on the grid's headings, and pivots",
    }  # fmt: skip
    lines = ",\n".join("  " + json.dumps(p) for p in problems)
    print(f'{{"provenance": {json.dumps(provenance, indent=1)},\n "problems": [\n{lines}\n]}}')


if __name__ == "__main__":
    main()

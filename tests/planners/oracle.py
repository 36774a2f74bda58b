"""An exhaustive oracle for a rectangular chair, independent of the planners' code.

Every position of a 3 cm grid, every one of some 100 headings, at most 4 deg apart. Headings are
those of whole steps on the grid, so a chair that drives straight goes from grid point to grid point
exactly; between headings it pivots. Both are tested with the exact swept rectangle against
polygons' edges and discs: a straight way of less than the chair's length sweeps what the chair
covers at its two ends, and a pivot sweeps the corners' arcs.

What the answers mean:
- A way that is found can be driven: it proves that there is a way, and its length (translation of
  the axle's centre, pivots free) bounds the shortest way's length from above.
- Without one, the chair made smaller by how far any of its points lies from where it is at the
  nearest grid pose moves over the grid in any direction, sideways too. If even that has no way,
  there is none; else the grid is too coarse to tell.
- The shortest way of the disc round the axle that fits into the chair bounds the length from below.
"""

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra

from tests.planners.pose_grid import STEP, fill, grid_headings, moves
from wheelchair_gym.geometry.outline import Footprint

CHAIR = Footprint()


@dataclass(frozen=True)
class Verdict:
    feasible: bool | None  # None: the grid is too coarse to tell
    lower: float  # m: no way is shorter
    upper: float  # m: a way of this length is known


def shortest_line(box, solid, start, goal):
    """Length [m] of the shortest path of a point, which may touch what is solid.

    Among polygons it turns at corners only.
    """
    room = shapely.difference(box, solid).buffer(1e-9, join_style="mitre")
    nodes = np.vstack([start, goal, shapely.get_coordinates(room)])
    return float(lengths_from_first(room, nodes)[1])


def lengths_from_first(room, nodes):
    """Return the lengths (n,) of shortest ways from the first node, along lines of sight."""
    pairs = np.array(list(itertools.combinations(range(len(nodes)), 2)))
    shapely.prepare(room)
    pairs = pairs[shapely.covers(room, shapely.linestrings(nodes[pairs]))]
    ways = np.hypot(*(nodes[pairs[:, 0]] - nodes[pairs[:, 1]]).T)
    return shortest(pairs, ways, len(nodes), 0)


def shortest(pairs, ways, count, first):
    """Return the lengths (count,) of shortest ways from a node, along pairs (n, 2) of nodes."""
    graph = coo_array((ways, pairs.T), shape=(count, count))
    return dijkstra(graph.tocsr(), directed=False, indices=first)


class Oracle:
    """A map of edges (n, 4) and discs (m, 3) [m] for a footprint, on a grid through an anchor."""

    def __init__(self, edges, discs, solid, bounds, footprint=CHAIR, anchor=(0.0, 0.0)):
        """Take the map; `solid` is the geometry of all that is solid, for what lies inside it."""
        self.edges = np.asarray(edges, dtype=float).reshape(-1, 4)
        self.discs = np.asarray(discs, dtype=float).reshape(-1, 3)
        self.solid, self.bounds, self.footprint = solid, np.array(bounds, dtype=float), footprint
        self.steps, self.headings = grid_headings()
        lag = np.asarray(anchor[:2]) - self.bounds[:2]
        self.frame = np.array([*(self.bounds[:2] + lag % STEP), STEP])
        size = np.floor((self.bounds[2:] - self.frame[:2]) / STEP).astype(int) + 1
        self.shape = (len(self.headings), size[1], size[0])

    def _marked(self, outline, pivots):
        x = self.frame[0] + STEP * np.arange(self.shape[2])
        y = self.frame[1] + STEP * np.arange(self.shape[1])
        inside = shapely.contains_xy(self.solid, *np.meshgrid(x, y))
        poses = np.zeros(self.shape, bool)
        turns = np.zeros(self.shape if pivots else (0, 0, 0), bool)
        fill(self.edges, self.discs, inside, self.frame, self.headings, np.array(outline),
              self.bounds, poses, turns)  # fmt: skip
        return poses, turns

    @cached_property
    def free(self):
        """Free poses, and free pivots to the next heading, (headings, rows, columns) each."""
        return self._marked(self.footprint.array, True)

    @cached_property
    def relaxed(self):
        """Numbers of the regions for a smaller chair that moves in any direction."""
        gaps = np.diff(np.append(self.headings, self.headings[0] + 2 * math.pi))
        less = STEP / math.sqrt(2.0) + 2.0 * self.footprint.reach * math.sin(0.25 * gaps.max())
        poses, _ = self._marked(self.footprint.array - less, False)
        poses = np.concatenate([poses, poses[:1]])  # the first heading follows the last
        labels, count = ndimage.label(poses, np.ones((3, 3, 3)))
        same = labels[0].ravel(), labels[-1].ravel()
        joined = coo_array((np.ones(len(same[0])), same), shape=(count + 1, count + 1))
        return connected_components(joined, directed=False)[1][labels[:-1]]

    def cell(self, point):
        """(row, column) of the grid point nearest to a point."""
        return tuple(np.round((np.asarray(point)[1::-1] - self.frame[1::-1]) / STEP).astype(int))

    def heading(self, yaw):
        """Index of the heading nearest to a yaw [rad]."""
        return int(np.argmin(np.abs(np.sin(0.5 * (self.headings - yaw)))))

    def _at(self, field, pose):
        """A field's values at a pose (3,), or at all headings of a point (2,)."""
        every = field[(slice(None), *self.cell(pose))]
        return every if len(pose) == 2 else every[self.heading(pose[2])][None]

    def lower(self, start, goal):
        """The shortest way [m] of the disc round the axle within the chair."""
        radius = min(self.footprint.front, self.footprint.rear, self.footprint.half_width)
        # shapely's arcs lie inside true ones: what is solid is never too large.
        solid = shapely.buffer(self.solid, radius - 1e-6, quad_segs=8)
        low = self.bounds[:2] + radius - 1e-6
        high = self.bounds[2:] - radius + 1e-6
        return shortest_line(shapely.box(*low, *high), solid, start[:2], goal[:2])

    def judge(self, start, goal):
        """The verdict on grid poses (3,), the goal perhaps a point (2,)."""
        poses, pivots = self.free
        begin = (self.heading(start[2]), *self.cell(start))
        upper, feasible = math.inf, None
        if poses[begin]:
            first = np.ravel_multi_index(begin, self.shape)
            lengths = shortest(*moves(poses, pivots, self.steps), poses.size, first)
            upper = float(self._at(lengths.reshape(self.shape), goal).min())
        if upper < math.inf:
            feasible = True
        elif not set(self._at(self.relaxed, start)) & set(self._at(self.relaxed, goal)) - {0}:
            feasible = False
        return Verdict(feasible, self.lower(start, goal), upper)

"""An independent judge of paths: shapely's geometry, none of the planners' kernels."""

import itertools

import numpy as np
import shapely

TOLERANCE = 1e-6  # m
FINE_TURN = 0.002  # rad: pieces of a sweep; a corner's arc bulges 1 m x 0.002^2 / 8 = 5e-7 m


def faults(path, solid, bounds, clearance=0.0):
    """What is wrong with a path (n, 2), as text; empty if it is valid.

    Args:
        path: points [m].
        solid: shapely geometry of all obstacles.
        bounds: xmin, ymin, xmax, ymax [m].
        clearance: distance [m] to keep from obstacles and from the border.
    """
    found = []
    map_ = shapely.box(*bounds).buffer(-clearance, join_style="mitre")
    # What is solid and the outside of the map are one: nothing passes where they touch.
    xmin, ymin, xmax, ymax = map_.bounds
    outside = shapely.difference(shapely.box(xmin - 9, ymin - 9, xmax + 9, ymax + 9), map_)
    solid = shapely.union(solid, outside) if clearance == 0.0 else solid
    core = shapely.buffer(solid, -TOLERANCE, join_style="mitre")
    for k, (a, b) in enumerate(itertools.pairwise(path)):
        edge = shapely.LineString([a, b]) if np.any(a != b) else shapely.Point(a)
        if not map_.buffer(TOLERANCE).covers(edge):
            found.append(f"edge {k} leaves the map")
        if shapely.relate_pattern(edge, core, "T********"):
            found.append(f"edge {k} is inside an obstacle for {edge.intersection(core).length} m")
        if clearance > 0.0 and shapely.distance(edge, solid) < clearance - TOLERANCE:
            found.append(f"edge {k} is {shapely.distance(edge, solid)} m from an obstacle")
    return found


def _swept(footprint, start, turn, chord):
    """Polygons that cover what a rectangle sweeps on one stretch, to second order in `FINE_TURN`.

    The rectangle is cut where it turns about: of each part the hull of two poses is what it sweeps
    between them but for the bulge of its corners' arcs.
    """
    half = 0.5 * turn
    way = chord * half / np.sin(half) if abs(half) > 1e-9 else chord
    (x0, y0), (x1, y1) = footprint.min(axis=0), footprint.max(axis=0)
    xs, ys = [x0, x1], [y0, y1]
    if abs(turn) > 1e-9:
        centre = way / turn
        xs, ys = [x0, 0.0, x1], ([y0, centre, y1] if y0 < centre < y1 else ys)
    t = np.linspace(0.0, 1.0, int(np.ceil(abs(turn) / FINE_TURN)) + 2)
    share = np.sin(half * t) / np.sin(half) if abs(half) > 1e-9 else t
    yaw, along = start[2] + turn * t, start[2] + half * t
    place = start[:2] + chord * (share * np.stack([np.cos(along), np.sin(along)])).T
    c, s = np.cos(yaw), np.sin(yaw)
    frames = np.moveaxis(np.array([(c, s), (-s, c)]), -1, 0)  # (pieces, 2, 2)
    parts = []
    for a, b in itertools.pairwise(xs):
        for d, e in itertools.pairwise(ys):
            corners = np.array([(a, d), (b, d), (b, e), (a, e)]) @ frames + place[:, None]
            ends = np.concatenate([corners[:-1], corners[1:]], axis=1)
            parts.append(shapely.convex_hull(shapely.multipoints(ends)))
    return np.concatenate(parts)


def sweep_faults(path, footprint, solid, bounds, margin=0.0):
    """What is wrong with a path of poses (n, 3) that a rectangle drives; empty if it is valid.

    From pose to pose the chair drives and turns at constant rates.

    Args:
        path: poses [m, m, rad].
        footprint: corners (4, 2) [m] in the chair's frame.
        solid: shapely geometry of all obstacles.
        bounds: xmin, ymin, xmax, ymax [m].
        margin: distance [m] that the outline keeps from obstacles and from the border.
    """
    path = np.asarray(path, dtype=float)
    turns = np.remainder(np.diff(path[:, 2]) + np.pi, 2 * np.pi) - np.pi
    steps = np.diff(path[:, :2], axis=0)
    middle = path[:-1, 2] + 0.5 * turns
    ahead = np.cos(middle) * steps[:, 0] + np.sin(middle) * steps[:, 1]
    aside = np.cos(middle) * steps[:, 1] - np.sin(middle) * steps[:, 0]
    found = [
        f"step {k} slips {aside[k]} m sideways" for k in np.flatnonzero(abs(aside) > TOLERANCE)
    ]
    swept = [_swept(footprint, *stretch) for stretch in zip(path[:-1], turns, ahead, strict=True)]
    swept = np.concatenate(swept) if swept else _swept(footprint, path[0], 0.0, 0.0)
    if not shapely.covers(shapely.box(*bounds).buffer(TOLERANCE - margin), swept).all():
        found.append("the outline leaves the map")
    gap = shapely.distance(swept, solid).min() if not solid.is_empty else np.inf
    if margin > 0.0 and gap < margin - TOLERANCE:
        found.append(f"the outline is {gap} m from an obstacle")
    core = shapely.buffer(solid, -TOLERANCE, join_style="mitre")
    if shapely.relate_pattern(swept, core, "T********").any():
        found.append("the outline is inside an obstacle")
    return found

"""An independent judge of paths: shapely's geometry, none of the planners' kernels."""

import itertools

import numpy as np
import shapely

TOLERANCE = 1e-6  # m
FINE_TURN = 0.002  # rad: pieces of a sweep; their hulls err by 1 m x 0.002^2 / 8 = 5e-7 m


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


def sweep_faults(path, footprint, solid, bounds, margin=0.0):
    """What is wrong with a path of poses (n, 3) that a footprint drives; empty if it is valid.

    From pose to pose the chair drives and turns at constant rates. Each such stretch is cut into
    pieces whose turns are so small that the hull of the outline at both ends differs from what is
    swept by less than the tolerance.

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
    poses = [path[:1]]
    for start, turn, chord in zip(path[:-1], turns, ahead, strict=True):
        t = np.linspace(0.0, 1.0, int(np.ceil(abs(turn) / FINE_TURN)) + 1)[1:, None]
        share = np.sin(0.5 * turn * t) / np.sin(0.5 * turn) if abs(turn) > 1e-9 else t
        yaw = start[2] + turn * t
        along = start[2] + 0.5 * turn * t
        poses.append(
            np.hstack([start[:2] + chord * share * np.hstack([np.cos(along), np.sin(along)]), yaw])
            if len(t)
            else start[None] + [[chord * np.cos(start[2]), chord * np.sin(start[2]), 0]]
        )
    poses = np.vstack(poses)
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    corners = footprint @ np.moveaxis(np.array([(c, s), (-s, c)]), -1, 0) + poses[:, None, :2]
    swept = (
        shapely.convex_hull(
            shapely.multipoints(np.concatenate([corners[:-1], corners[1:]], axis=1))
        )
        if len(poses) > 1
        else shapely.polygons(corners)
    )
    if not shapely.covers(shapely.box(*bounds).buffer(TOLERANCE - margin), swept).all():
        found.append("the outline leaves the map")
    gaps = shapely.distance(swept, solid)
    core = shapely.buffer(solid, -TOLERANCE, join_style="mitre")
    if margin > 0.0 and not solid.is_empty and gaps.min() < margin - TOLERANCE:
        found.append(f"the outline is {gaps.min()} m from an obstacle")
    if shapely.relate_pattern(swept, core, "T********").any():
        found.append("the outline is inside an obstacle")
    return found

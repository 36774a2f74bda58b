"""An independent judge of paths: shapely's geometry, none of the planners' kernels."""

import itertools

import numpy as np
import shapely

TOLERANCE = 1e-6  # m


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

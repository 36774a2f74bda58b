"""Maps: occupancy grids, their files, and exact geometry and shortest ways from them."""

from wheelchair_gym.maps.geodesic import Geodesic, geodesic, interpolate
from wheelchair_gym.maps.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from wheelchair_gym.maps.map_server import read_map, write_map
from wheelchair_gym.maps.passage import bottleneck
from wheelchair_gym.maps.polygons import Outline, binarise, polygons

__all__ = [
    "FREE",
    "OCCUPIED",
    "UNKNOWN",
    "Geodesic",
    "OccupancyGrid",
    "Outline",
    "binarise",
    "bottleneck",
    "geodesic",
    "interpolate",
    "polygons",
    "read_map",
    "write_map",
]

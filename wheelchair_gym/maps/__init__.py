"""Maps: occupancy grids, their files, and exact geometry and shortest ways from them."""

from wheelchair_gym.maps.geodesic import Geodesic, geodesic, interpolate
from wheelchair_gym.maps.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

__all__ = [
    "FREE",
    "OCCUPIED",
    "UNKNOWN",
    "Geodesic",
    "OccupancyGrid",
    "geodesic",
    "interpolate",
]

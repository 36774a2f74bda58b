"""Maps: occupancy grids, their files, exact walls and shortest paths."""

from wheelchair_gym.maps.geodesic import Geodesic, geodesic, interpolate
from wheelchair_gym.maps.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, occupied_polygons
from wheelchair_gym.maps.io import MapWithWalls, read_any_map, read_grid
from wheelchair_gym.maps.io.floor_plan import read_house
from wheelchair_gym.maps.io.map_server import map_files, read_map, read_moving_ai_map, write_map
from wheelchair_gym.maps.passage import bottleneck, footprint_margin, open_floor

__all__ = [
    "FREE",
    "OCCUPIED",
    "UNKNOWN",
    "Geodesic",
    "MapWithWalls",
    "OccupancyGrid",
    "bottleneck",
    "footprint_margin",
    "geodesic",
    "interpolate",
    "map_files",
    "occupied_polygons",
    "open_floor",
    "read_any_map",
    "read_grid",
    "read_house",
    "read_map",
    "read_moving_ai_map",
    "write_map",
]

"""Maps: occupancy grids, their files, and exact geometry and shortest ways from them."""

from __future__ import annotations

from wheelchair_gym.maps.geodesic import Geodesic, geodesic, interpolate
from wheelchair_gym.maps.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from wheelchair_gym.maps.io.any_format import Ground, read_ground
from wheelchair_gym.maps.io.house_expo import House, read_house
from wheelchair_gym.maps.io.map_server import read_map, write_map
from wheelchair_gym.maps.io.moving_ai import Task, read_octile, read_scenario
from wheelchair_gym.maps.passage import bottleneck, outline_margin
from wheelchair_gym.maps.polygons import Outline, binarise, polygons

__all__ = [
    "FREE",
    "OCCUPIED",
    "UNKNOWN",
    "Geodesic",
    "Ground",
    "House",
    "OccupancyGrid",
    "Outline",
    "Task",
    "binarise",
    "bottleneck",
    "geodesic",
    "interpolate",
    "outline_margin",
    "polygons",
    "read_ground",
    "read_house",
    "read_map",
    "read_octile",
    "read_scenario",
    "write_map",
]

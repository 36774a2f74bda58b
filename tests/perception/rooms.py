"""A known room, and what a laser sees in it, by the oracle of the laser's own tests."""

import numpy as np

from tests.sensors.test_laser import brute_force
from tests.sim.worlds import wall_gaps
from wheelchair_gym.geometry.planar import polygon_edges, to_world
from wheelchair_gym.perception.occupancy import OccupancyMap, read_scan
from wheelchair_gym.sensors.settings import LaserSettings

LASER = LaserSettings(x=0.2, beams=361, reach=8.0, range_min=0.05)
# A room with a spur of wall and a pillar: nothing looks the same from elsewhere.
CORNERS = [(-2.0, -1.5), (5.0, -1.5), (5.0, 2.5), (1.7, 2.5), (1.7, 1.2), (1.5, 1.2), (1.5, 2.5),
           (-2.0, 2.5)]  # fmt: skip
PILLAR = [(3.0, 0.7), (3.3, 0.7), (3.3, 1.0), (3.0, 1.0)]


def walls():
    """Segments (n, 4) [m]."""
    return np.concatenate([polygon_edges(corners) for corners in (CORNERS, PILLAR)])


def ranges(pose, rng=None, sigma=0.015):
    """Return the laser's ranges (beams,) [m] at a pose."""
    x, y = to_world((LASER.x, 0.0), pose)
    far, _ = brute_force(x, y, pose[2] + LASER.yaw, LASER.angles, walls(), (), np.inf)
    if rng is not None:
        far = far + sigma * rng.standard_normal(len(far))
    return np.where(far > LASER.reach, np.inf, far)


def away(points):
    """Distance (n,) [m] from points (n, 2) to the nearest wall."""
    return wall_gaps(points, walls())


def mapped(seed):
    rng, made = np.random.default_rng(seed), OccupancyMap()
    for pose in tour():
        made.integrate(read_scan(LASER, ranges(pose, rng)), pose)
    return made


def tour(steps=60):
    """Poses (steps, 3) past the spur and the pillar."""
    x = np.linspace(-1.0, 4.2, steps)
    y = 0.8 * np.sin(1.1 * x)
    return np.stack([x, y, np.arctan2(np.gradient(y), np.gradient(x))], axis=-1)

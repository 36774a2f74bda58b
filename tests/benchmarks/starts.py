"""Fit of first scans to the map at true and wrong starts, and the refused starts.

Run: python -m tests.benchmarks.starts [--worlds 30]
"""

import argparse
import math

import numpy as np

from agents.deploy import start_fit
from wheelchair_gym.maps import OCCUPIED
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.chair import SimulatedChair

SCENES = (
    "floor_plan", "clutter", "crowd", "doorway", "lab_1", "lab_2", "empty", "temporary", "barn",
    "thesis_2",
)  # fmt: skip
OFF = {  # m, deg
    "true": (0.0, 0.0), "10 cm, 3 deg": (0.1, 3.0), "25 cm, 8 deg": (0.25, 8.0),
    "1.5 m": (1.5, 0.0), "90 deg": (0.0, 90.0), "1.5 m, 90 deg": (1.5, 90.0),
    "180 deg": (0.0, 180.0),
}  # fmt: skip


def beside(grid, start, way, turn, rng):
    """A start off by a way [m] and a turn [rad] in a free direction; None: there is none."""
    for _ in range(50):
        angle = rng.uniform(0.0, 2.0 * math.pi)
        place = start + np.array([way * math.cos(angle), way * math.sin(angle), turn])
        inside = grid.inside(place[:2])
        if inside and grid.cells[tuple(grid.to_cell(place[:2]))] != OCCUPIED:
            return place
    return None


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", type=int, default=30, help="of each scene")
    given = parser.parse_args()
    chair, laser, rng = SimulatedChair(), SensorSettings().laser, np.random.default_rng(1)
    found = {name: [] for name in OFF}
    for scene in SCENES:
        for seed in range(given.worlds):
            episode = make_scene(scene).sample(np.random.default_rng(1000 + seed))
            ranges = chair.reset(episode, seed).laser
            for name, (way, degrees) in OFF.items():
                turn = math.radians(degrees) * rng.choice([-1.0, 1.0])
                start = beside(episode.map, episode.start, way, turn, rng)
                if start is not None:
                    found[name].append(start_fit(episode.map, start, laser, ranges))
    print(f"{'off':14} starts refused ambiguous   fit: min   5 %   50 %   95 %    max")
    for name, fits in found.items():
        low, *middle, high = np.quantile([one.fit for one in fits], [0, 0.05, 0.5, 0.95, 1])
        told = "  ".join(f"{value:5.2f}" for value in (low, *middle, high))
        refused = sum(bool(one.wrong) for one in fits)
        twin = sum(one.ambiguous for one in fits)
        print(f"{name:14} {len(fits):6} {refused:7} {twin:9}      {told}")


if __name__ == "__main__":
    main()

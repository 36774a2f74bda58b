"""The picture of all courses of driving skills: `python docs/skills.py` draws it to docs/images."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT)]

import matplotlib  # noqa: E402

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

from wheelchair_gym.geometry import to_world  # noqa: E402
from wheelchair_gym.maps import FREE  # noqa: E402
from wheelchair_gym.scenes import make_scene  # noqa: E402
from wheelchair_gym.scenes.poses import FOOTPRINT  # noqa: E402
from wheelchair_gym.scenes.skill import COURSES  # noqa: E402

PICTURE = ROOT / "docs" / "images" / "skills.png"
COLUMNS = 7


def draw() -> Path:
    """Draw each course as seed 0 draws it: the chair at its start (filled) and its goal."""
    rows = -(-len(COURSES) // COLUMNS)
    with plt.style.context(ROOT / "agents" / "data" / "report.mplstyle"):
        figure, places = plt.subplots(rows, COLUMNS, figsize=(14.0, 2.1 * rows))
        for axes in places.flat:
            axes.axis("off")
        for axes, course in zip(places.flat, COURSES, strict=False):
            scene = make_scene({"name": "skill", "course": course})
            episode = scene.sample(np.random.default_rng(0))
            grid = episode.map
            x0, y0, x1, y1 = grid.bounds
            axes.imshow(
                grid.cells != FREE, cmap="Greys", vmax=1.6, origin="lower", extent=(x0, x1, y0, y1)
            )
            for pose, filled in ((episode.start, True), (episode.goal, False)):
                corners = to_world(FOOTPRINT.corners, pose)
                axes.fill(*corners.T, fill=filled, edgecolor="C0", facecolor="C0", linewidth=1.2)
                nose = to_world(np.array([(0.4, -0.2), (0.65, 0.0), (0.4, 0.2)]), pose)
                axes.plot(*nose.T, color="white" if filled else "C0", linewidth=1.2)
            for number, row in enumerate(episode.actors.rows):
                axes.add_patch(plt.Circle(row["pose"][:2], row["size"][0], color="C3"))
                way = episode.actors.route(number)
                axes.plot(*np.vstack([row["pose"][:2], way]).T, color="C3", linewidth=0.6)
            axes.set_title(course, fontsize=8)
        figure.tight_layout(pad=0.4)
        figure.savefig(PICTURE, dpi=110)
    return PICTURE


if __name__ == "__main__":
    print(draw().relative_to(ROOT))

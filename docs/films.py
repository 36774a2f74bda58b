"""Films and figures of the documentation: `python docs/films.py` draws them to docs/images."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT)]

import matplotlib as mpl  # noqa: E402
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402

from agents.evaluation.evaluate import drive_episode, env_settings, make_env  # noqa: E402
from agents.evaluation.figures import LOOK  # noqa: E402
from agents.policies import make_policy  # noqa: E402
from agents.studies.figures import gain_figure  # noqa: E402
from wheelchair_gym.config import read_json  # noqa: E402
from wheelchair_gym.geometry import to_world  # noqa: E402
from wheelchair_gym.maps import FREE  # noqa: E402
from wheelchair_gym.rendering.video import write_video  # noqa: E402
from wheelchair_gym.scenes import make_scene  # noqa: E402
from wheelchair_gym.scenes.poses import FOOTPRINT  # noqa: E402
from wheelchair_gym.scenes.skill import COURSES  # noqa: E402

FOLDER = ROOT / "docs" / "images"
COLUMNS = 7  # of the courses of driving skills
SIZE = {"render_width": 400, "render_height": 320}


class Film(NamedTuple):
    """An episode, and how many control periods lie between two pictures."""

    scene: str
    policy: str
    seed: int
    periods: int


FILMS = {
    "drive": Film("floor_plan", "lattice+window", 4, 1),
    "crowd": Film("crowd", "ppo_guided", 33, 2),
    "people": Film("people", "lattice+window", 9, 3),
}


def draw(name: str) -> Path:
    """Drive a film's episode behind the shield, and write it as NAME.gif."""
    film = FILMS[name]
    settings = env_settings(pose_source="modelled", shield=True, config=SIZE)
    env = make_env(film.scene, settings, "rgb_array")
    pictures: list[Any] = []
    drive_episode(env, make_policy(film.policy), film.seed, lambda e: pictures.append(e.render()))
    path = FOLDER / f"{name}.gif"
    write_video(path, pictures[:: film.periods], 1.0 / (film.periods * env.unwrapped.task.period))
    env.close()
    return path


def draw_skills() -> Path:
    """Draw each course as seed 0 draws it: the chair at its start (filled) and its goal."""
    rows = -(-len(COURSES) // COLUMNS)
    with mpl.rc_context(LOOK):
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
        figure.savefig(FOLDER / "skills.png", dpi=110)
    return FOLDER / "skills.png"


def draw_gain() -> Path:
    """Draw what more whales gain over RRT*, from the result file."""
    rows = read_json(ROOT / "docs" / "results" / "data" / "gain.json")["rows"]
    with mpl.rc_context(LOOK):
        gain_figure(rows).savefig(FOLDER / "gain.png", dpi=130)
    return FOLDER / "gain.png"


if __name__ == "__main__":
    for path in (draw_gain(), draw_skills()):
        print(path.relative_to(ROOT))
    for each in FILMS:
        print(f"{draw(each).relative_to(ROOT)}")

"""Films and figures of the documentation: `python docs/films.py [NAME ...]` draws docs/images."""

import contextlib
import re
import sys
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT)]

import matplotlib as mpl  # noqa: E402
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402

from agents.evaluation.compare import side_by_side  # noqa: E402
from agents.evaluation.evaluate import Spec, env_settings  # noqa: E402
from agents.evaluation.plots import LOOK  # noqa: E402
from agents.studies.figures import gain_figure  # noqa: E402
from wheelchair_gym.base.settings import read_json  # noqa: E402
from wheelchair_gym.geometry.planar import to_world  # noqa: E402
from wheelchair_gym.maps import FREE  # noqa: E402
from wheelchair_gym.rendering import palette  # noqa: E402
from wheelchair_gym.rendering.video import write_video  # noqa: E402
from wheelchair_gym.scenes import make_scene  # noqa: E402
from wheelchair_gym.scenes.arena import FOOTPRINT  # noqa: E402
from wheelchair_gym.scenes.skill import COURSES  # noqa: E402

FOLDER = ROOT / "docs" / "images"


class Film(NamedTuple):
    """An episode, and the number of control periods between two pictures."""

    scene: Any
    policies: tuple[Spec, ...]  # that drive it side by side
    seed: int
    periods: int
    speed: int = 1  # times real time
    size: tuple[int, int] = (320, 400)  # height and width of the pictures of a drive [pixels]


RRT_STAR_WOA = {"name": "rrt_star_woa_global+controls", "label": "RRT*-WOA"}
LEARNED = {"name": "ppo_guided", "label": "learned: ppo_guided"}
LEAF = {"name": "map_file", "path": str(FOLDER.parent / "leaf.json"), "start": (1.0, 1.5, 0.0)}
LEAF |= {"goal": (5.3, 1.5, 0.0)}
SHARED_DWA = {"name": "assisted", "assist": "shared_dwa"}
DOCK = {"name": "skill", "course": "dock", "env": {"driver": "expert"}}
TREMOR = {"name": "floor_plan", "env": {"driver": "essential_tremor"}}
GALLERY = {  # of README.md: scene, policy, seed
    "home": ("floor_plan", "lattice+window", 3),
    "barn": ("barn", "ppo_guided", 1),
    "crowd": ("crowd", "ppo_guided", 33),
    "door": ("doorway", "lattice+window", 0),
    "dock": (DOCK, SHARED_DWA, 0),
    "assisted": (TREMOR, SHARED_DWA, 4),
}
FILMS = {
    "drive": Film("floor_plan", (RRT_STAR_WOA, LEARNED), 1, 4, 2, (400, 400)),
    "crowd": Film("crowd", ("ppo_guided",), 33, 2),
    "people": Film("people", ("lattice+window",), 9, 3),
    "edge_on_leaf": Film(LEAF, ("lattice+window",), 0, 2, size=(320, 600)),
} | {
    f"gallery/{name}": Film(scene, (policy,), seed, 5, 2, (240, 300))
    for name, (scene, policy, seed) in GALLERY.items()
}


def draw(name: str) -> Path:
    """Drive a film's episode with each policy behind the shield, and write it as NAME.gif."""
    film = FILMS[name]
    size = dict(zip(("render_height", "render_width"), film.size, strict=True))
    settings = env_settings(pose_source="modelled", shield=True, config=size)
    pictures, time = side_by_side(film.policies, film.scene, film.seed, settings, film.periods)
    path = FOLDER / f"{name}.gif"
    write_video(path, pictures, film.speed / time)
    return path


def draw_tutorial() -> Path:
    """Run the code of the tutorial on RRT*-WOA, which draws the page's pictures."""
    page = ROOT / "docs" / "tutorials" / "rrt_star_woa.md"
    with contextlib.chdir(FOLDER), mpl.rc_context(LOOK):
        exec("\n".join(re.findall(r"^```python\n(.*?)^```", page.read_text(), re.M | re.S)), {})
    return page


def draw_skills() -> Path:
    """Draw each course as seed 0 draws it: the chair at its start (blue) and its goal."""
    rows, columns = -(-len(COURSES) // 7), 7
    chair, goal, person = map(palette.css, (palette.CHAIR, palette.GOAL, palette.PERSON))
    with mpl.rc_context(LOOK):
        figure, places = plt.subplots(rows, columns, figsize=(14, 2.1 * rows), layout="tight")
        for axes, course in zip(places.flat, COURSES, strict=True):
            axes.axis("off")
            scene = make_scene({"name": "skill", "course": course})
            episode = scene.sample(np.random.default_rng(0))
            x0, y0, x1, y1 = episode.map.bounds
            cells = np.array([palette.FREE, palette.SOLID])[1 * (episode.map.cells != FREE)]
            axes.imshow(cells, origin="lower", extent=(x0, x1, y0, y1))
            for pose, colour, alpha in ((episode.start, chair, 0.55), (episode.goal, goal, 0.22)):
                corners = to_world(FOOTPRINT.corners, pose)
                axes.fill(*corners.T, ec=(colour, 1.0), fc=(colour, alpha), linewidth=1.2)
                nose = to_world(np.array([(0.4, -0.2), (0.65, 0.0), (0.4, 0.2)]), pose)
                axes.plot(*nose.T, color=colour, linewidth=1.2)
            for number, row in enumerate(episode.actors.rows):
                axes.add_patch(plt.Circle(row["pose"][:2], row["size"][0], color=person))
                way = episode.actors.route(number)
                axes.plot(*np.vstack([row["pose"][:2], way]).T, color=person, linewidth=0.6)
            axes.set_title(course, fontsize=8)
        figure.savefig(FOLDER / "skills.png", dpi=110)
    return FOLDER / "skills.png"


def draw_gain() -> Path:
    """Draw what more whales gain over RRT*, from the result file."""
    rows = read_json(ROOT / "docs" / "results" / "data" / "gain.json")["rows"]
    with mpl.rc_context(LOOK):
        gain_figure(rows).savefig(FOLDER / "gain.png", dpi=130)
    return FOLDER / "gain.png"


def draw_studio() -> Path:
    """Drive among people and with hemianopia, and plan, in Chromium (`make browser`)."""
    from tests.agents.studio.served import browsing, serving, until

    walls = [[0, 3.3, 0.0, 3.3, 5.0], [0, 6.6, 2.5, 6.6, 8.0], [2, 4.4, 0.4, 5.4, 1.6]]
    among = {"place": "scene:people", "sight": "none"}, 0, "body", "studio"
    half = {"place": "scene:floor_plan", "sight": "hemianopia"}, 31, "#map", "studio_sight"
    with TemporaryDirectory() as folder, serving(Path(folder)) as served, browsing() as browser:
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.goto(f"{served.url}#drive")
        for chosen, seed, what, name in (among, half):
            until(page, "window.studio?.now?.waits", 600.0)
            for key, value in chosen.items():
                page.select_option(f"#{key}", value)
            page.fill("#seed", f"{seed}")
            page.click("#start")
            until(page, f"studio.world.order.place === '{chosen['place']}' && studio.now?.waits")
            page.keyboard.down("ArrowUp")
            until(page, "studio.now.t > 3.4")
            page.keyboard.press("p")
            page.locator(what).screenshot(path=FOLDER / f"{name}.png")
            page.keyboard.up("ArrowUp")
            page.reload()
        page.click("[data-page=plan]")
        until(page, "studio.kinds?.length && studio.world")
        page.evaluate("walls => { studio.shapes = walls; studio.redraw(); }", walls)
        page.fill("#deadline", "3")
        page.click("#plan")
        until(page, "studio.answers.length > 5 && !studio.on.plan.disabled", 600.0)
        page.locator("body").screenshot(path=FOLDER / "studio_plan.png")
    return FOLDER / "studio.png"


DRAWN = {"gain": draw_gain, "skills": draw_skills, "studio": draw_studio, "tutorial": draw_tutorial}
DRAWN |= {name: partial(draw, name) for name in FILMS}

if __name__ == "__main__":
    for each in sys.argv[1:] or DRAWN:
        print(DRAWN[each]().relative_to(ROOT))

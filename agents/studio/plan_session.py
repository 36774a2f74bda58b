"""The session of the page Plan: a map that is drawn, planners that answer, and files of both."""

from __future__ import annotations

import re
import threading
from itertools import takewhile
from pathlib import Path
from typing import Any, Final

from agents.studio import PageError, drawing, messages
from agents.studio.catalogue import Place
from agents.studio.messages import Fields, Message, Outbox, PageSession, entry
from agents.studio.planning import answer, frames_of, problem_of
from planners import Plan, Problem
from planners.registries import PLANNERS
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.maps import OccupancyGrid, write_map
from wheelchair_gym.rendering.floor import closed_loops

_MAX_SHAPES: Final = 500
_NAME: Final = re.compile(r"\w([\w -]{0,58}\w)?")
_LOADING: Final = threading.Lock()  # one map at a time, of all pages
_CLEARANCE: Final = messages.number(0.0, 2.0)
_SEED: Final = messages.number(0, 2**31, whole=True)
FIRST: Final = ("visibility", "a_star", "rrt_star", "rrt_star_woa_global", "swarm", "lattice")
_ENDS: Final = {"start": messages.POINT, "goal": messages.POINT}
FIELDS: Final[Fields] = {
    "blank": {"width": messages.number(1.0, 50.0), "height": messages.number(1.0, 50.0)},
    "place": {"place": messages.text(), "seed": _SEED},
    "load": {"name": messages.text(), "resolution": messages.number(0.001, 1.0)},
    "scale": {"factor": messages.number(0.001, 1000.0)},
    "cancel": {},
    "draw": {"shapes": messages.points(5, _MAX_SHAPES)},
    "plan": {
        "planners": messages.names(PLANNERS.built_in), **_ENDS, "clearance": _CLEARANCE,
        "deadline": messages.number(0.01, 10.0), "seed": _SEED,
    },
    "growth": {"planner": messages.one_of(PLANNERS.built_in)},
    "save": {"what": messages.one_of(("map", "problem")), "name": messages.text(60), **_ENDS},
}  # fmt: skip


class PlanSession(PageSession):
    """Serves the page Plan.

    Args:
        places: whose maps may be taken, by key; saved maps are added.
        folder: where files are written, and uploads lie.
        outbox: of the page.
    """

    fields = FIELDS

    def __init__(self, places: dict[str, Place], folder: Path, outbox: Outbox) -> None:
        super().__init__(outbox)
        self._places, self._folder = places, folder
        self._base: OccupancyGrid = drawing.blank(10.0, 8.0)
        self._grid = self._base
        self._problem: Problem | None = None
        self._plans: dict[str, Plan] = {}
        self._seed = 0
        self._cancelled = threading.Event()
        outbox.send("planners", names=sorted(PLANNERS.built_in), first=FIRST, shapes=drawing.SHAPES)
        self._show("", [1.5, 4.0], [8.5, 4.0])

    def receive(self, message: Message) -> None:
        """See `PageSession.receive`; a cancellation does not wait for its turn."""
        if message["type"] == "cancel":
            self._cancelled.set()
        else:
            super().receive(message)

    def _show(self, name: str, start: Any = None, goal: Any = None) -> None:
        """Send the map; with start and goal where another map begins."""
        self._problem, self._plans = None, {}
        grid = self._grid
        solids = closed_loops(grid.walls())
        self._out.send("map", name=name, bounds=grid.bounds, solids=solids, start=start, goal=goal)

    def on_blank(self, message: Message) -> None:
        """Begin with an empty room."""
        width, height = message["width"], message["height"]
        self._base = self._grid = drawing.blank(width, height)
        middle = 0.5 * height + 0.1
        self._show("", [0.15 * width, middle], [0.85 * width, middle])

    def on_place(self, message: Message) -> None:
        """Begin with the map of a place, which does not show who moves."""
        place = entry(self._places, message["place"], "place.place")
        env = NavigationEnv(place.scene, split="test", **place.env)
        env.reset(seed=message["seed"])
        episode = env.episode
        env.close()
        assert episode is not None
        self._base = self._grid = episode.map
        self._show(place.label, episode.start[:2].tolist(), episode.goal[:2].tolist())

    def on_load(self, message: Message) -> None:
        """Begin with an uploaded map."""
        name = message["name"]
        path = self._folder / drawing.UPLOADS / name
        if Path(name).name != name or path.is_symlink() or not path.is_file():
            raise InputError(f"load.name is {name!r}; expected the name of an uploaded file")
        self._cancelled.clear()
        with _LOADING:
            self._stage("read")
            grid = drawing.loaded(path, message["resolution"])
            self._stage("outline")
            self._take(grid, Path(name).stem)

    def on_scale(self, message: Message) -> None:
        """Enlarge the map without its shapes, so that a distance on it becomes true."""
        self._take(drawing.scaled(self._base, message["factor"]), "the map")

    def _take(self, grid: OccupancyGrid, name: str) -> None:
        """Begin with a map; start and goal are as far apart as its cells are."""
        ends = drawing.far_ends(grid, name)
        self._base = self._grid = grid
        self._show(name, *ends)

    def _stage(self, name: str) -> None:
        """Tell how far loading is, or end it by an `InputError` where it was cancelled."""
        if self._cancelled.is_set() or self._closing.is_set():
            raise PageError("load_cancelled")
        self._out.send("loading", stage=name)

    def on_draw(self, message: Message) -> None:
        """Draw all shapes over the map anew."""
        for row in message["shapes"]:
            if int(row[0]) != row[0] or not 0 <= row[0] < len(drawing.SHAPES):
                raise InputError(
                    f"draw.shapes: kind {row[0]:g}; expected 0 to {len(drawing.SHAPES) - 1}"
                )
        self._grid = drawing.drawn(self._base, message["shapes"])
        self._show("")

    def on_plan(self, message: Message) -> None:
        """Run planners, one after another."""
        ends = message["start"], message["goal"]
        self._problem = problem_of(self._grid, *ends, message["clearance"])
        self._plans, self._seed = {}, message["seed"]
        self._cancelled.clear()
        for name in message["planners"]:
            if self._closing.is_set() or self._cancelled.is_set():
                break
            self._out.send("planning", planner=name)
            self._plans[name], row = answer(name, self._problem, self._seed, message["deadline"])
            self._out.send("plan", **row)
        self._out.send("planned")

    def on_growth(self, message: Message) -> None:
        """Send how a planner came to its plan."""
        name = message["planner"]
        if self._problem is None or name not in self._plans:
            raise InputError(f"growth: {name} has not planned on this map yet")
        made = frames_of(name, self._problem, self._plans[name], self._seed)
        frames = list(takewhile(lambda _: not self._closing.is_set(), made))
        self._out.send("growth", planner=name, frames=frames)

    def on_save(self, message: Message) -> None:
        """Write the map, or the problem; a map may then be driven on."""
        name = message["name"]
        if not _NAME.fullmatch(name):
            raise InputError(
                f"save.name is {name!r}; expected at most 60 letters, digits, spaces, - and _"
            )
        self._folder.mkdir(parents=True, exist_ok=True)
        if message["what"] == "problem":
            path = self._folder / f"{name}.json"
            drawing.write_problem(path, self._grid, message["start"], message["goal"])
            self._out.send("saved", files=[path.name])
            return
        path = self._folder / f"{name}.yaml"
        write_map(self._grid, path, suffix=".png")
        scene = {"name": "map_file", "path": str(path)}
        self._places[f"map:{name}"] = Place("map", name, scene, {"pose_source": "modelled"})
        self._out.send("saved", files=[path.name, path.with_suffix(".png").name])

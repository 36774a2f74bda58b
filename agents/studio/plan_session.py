"""The session of the page Plan: a map that is drawn, planners that answer, and files of both.

A person draws shapes over the cells of a map. A plan has figures, and shows how its tree or its
swarm grew.
"""

import json
import re
import threading
import warnings
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from PIL import Image

from agents.evaluation.metrics import path_figures
from agents.evaluation.provenance import write_text
from agents.studies.plan_pictures import growth
from agents.studio import UPLOADS, PageError
from agents.studio.catalogue import Place
from agents.studio.messages import Message, Outbox, PageSession, entry, fields_of
from planners import Plan, Problem, Space, make_planner
from planners.judge import plan_faults
from planners.problem import checked_plan
from planners.registries import FIRST_PLANNERS, OBJECTIVES, PLANNERS, SWARM_OPTIMIZERS
from planners.swarm import search as swarms
from planners.swarm.peers import Mealpy
from planners.swarm.planner import SwarmPlanner
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.files import LIMITS, parse_yaml, read_text
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.compiled.random import stream
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.geometry.planar import path_length
from wheelchair_gym.maps import FREE, OCCUPIED, OccupancyGrid, read_grid, write_map
from wheelchair_gym.rendering.floor import closed_loops

# A wall, an opening in one, solid, rubbed out.
SHAPES: Final = ("wall", "door", "furniture", "free")
CELL: Final = 0.05  # m
_WIDTH: Final = 0.10  # m of a wall
_OPENING: Final = 0.30  # m: how deep a door cuts, so that walls a little thicker are open, too
_LONGEST_NAME: Final = 255  # bytes of a file's name, as file systems have it
_MAX_WALLS: Final = 50_000  # segments that a page can draw
_MAX_CELLS: Final = 25_000_000  # of a map, or pixels of its image: 0.5 GB of memory, some seconds


def blank(width: float, height: float) -> OccupancyGrid:
    """An empty room with walls round it; its inside is of that size [m]."""
    rim = round(_WIDTH / CELL)
    shape = round(height / CELL) + 2 * rim, round(width / CELL) + 2 * rim
    cells = np.full(shape, OCCUPIED, np.int8)
    cells[rim:-rim, rim:-rim] = FREE
    return OccupancyGrid(cells, CELL)


def drawn(grid: OccupancyGrid, shapes: list[list[float]]) -> OccupancyGrid:
    """A map with shapes over it, one after another.

    Args:
        grid: the map below.
        shapes: rows of a number in SHAPES and two points [m]: ends of a wall or a door, corners of
            what is furniture or free.
    """
    cells = grid.cells.copy()
    for kind, *ends in shapes:
        name = SHAPES[int(kind)]
        a, b = grid.to_lattice(np.reshape(ends, (2, 2)))
        width = {"wall": _WIDTH, "door": _OPENING}.get(name, 0.0) / grid.resolution
        low = np.floor(np.minimum(a, b) - width).astype(int).clip(0)
        high = np.ceil(np.maximum(a, b) + width).astype(int).clip(0)
        part = cells[low[1] : high[1], low[0] : high[0]]
        rows, cols = np.indices(part.shape)
        centres = np.stack([cols, rows], axis=-1) + low + 0.5
        if width:
            line = shapely.LineString([a, b])
            within = shapely.distance(shapely.points(centres), line) <= 0.5 * width + 1e-9
        else:
            within = (centres >= np.minimum(a, b)) & (centres <= np.maximum(a, b))
            within = within.all(axis=-1)
        part[within] = OCCUPIED if name in ("wall", "furniture") else FREE
    return OccupancyGrid(cells, grid.resolution, grid.origin)


def loaded(path: Path, resolution: float) -> OccupancyGrid:
    """The map of an uploaded file, which may not lead out of its folder.

    Args:
        path: of the file.
        resolution: edge of a pixel [m], of an image.

    Raises:
        InputError: the file cannot be read, names an image elsewhere, or is too intricate.
    """
    image, image_file = path.suffix.lower() not in (".yaml", ".yml"), path
    if not image:
        content = parse_yaml(read_text(path, "yaml", errors="replace"), path.name)
        name = content.get("image") if isinstance(content, dict) else None
        if (
            not isinstance(name, str)
            or Path(name).name != name
            or len(name.encode(errors="replace")) > _LONGEST_NAME
        ):
            shown = shorten(name)
            raise InputError(f"{path.name}: image is {shown}; expected the bare name of a file")
        image_file = path.parent / name
        if image_file.is_symlink() or not image_file.is_file():
            raise InputError(f"{path.name}: load its image, {name}, together with it")
    pixels = 0
    with suppress(Exception), warnings.catch_warnings():  # what is no image is refused below
        warnings.simplefilter("ignore")  # of its own limit
        with Image.open(image_file) as head:
            pixels = head.width * head.height
    _check_cells(pixels, path)  # before they are decoded
    try:
        grid = read_grid(path, True, resolution if image else None)
    except InputError as error:
        raise InputError(str(error).replace(f"{path.parent}/", "")) from None
    _check_cells(grid.cells.size, path)
    if grid.n_walls > _MAX_WALLS:
        raise InputError(f"{path.name}: more than {_MAX_WALLS:,} walls; expected a simpler map")
    return grid


def _check_cells(n: int, path: Path) -> None:
    if n > _MAX_CELLS:
        raise InputError(
            f"{path.name}: {n:,} pixels or cells; expected at most {_MAX_CELLS:,}: make the image "
            "smaller and its pixels larger, both by the same factor"
        )


def scaled(grid: OccupancyGrid, factor: float) -> OccupancyGrid:
    """The same cells, each larger by a factor."""
    x, y, yaw = grid.origin
    return OccupancyGrid(grid.cells, factor * grid.resolution, (factor * x, factor * y, yaw))


def far_ends(grid: OccupancyGrid, name: str) -> tuple[list[float], list[float]]:
    """The first and the last place [m] of a map where there is room for a chair.

    Raises:
        InputError: there is none; the message begins with the map's name.
    """
    free = grid.traversable(0.4)
    if not free.any():
        raise InputError(f"{name}: nowhere on it is room for a chair; check the resolution")
    flat = free.ravel()
    ends = [int(flat.argmax()), flat.size - 1 - int(flat[::-1].argmax())]
    first, last = grid.to_world(np.stack(np.unravel_index(ends, free.shape), axis=-1)).tolist()
    return first, last


def rectangles(grid: OccupancyGrid) -> Array:
    """Return solid cells as rectangles (n, 4) [m]: x0, y0, x1, y1 from the lower left corner.

    Runs of cells of one row are joined with equal runs of the rows above.
    """
    solid = grid.cells == OCCUPIED
    open_runs: dict[tuple[int, int], int] = {}
    found: list[tuple[int, int, int, int]] = []
    for row in range(len(solid) + 1):
        runs: list[tuple[int, int]] = []
        if row < len(solid):
            edges = np.flatnonzero(np.diff(np.concatenate([[0], solid[row].view(np.int8), [0]])))
            runs = [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
        for run in [run for run in open_runs if run not in runs]:
            found.append((run[0], open_runs.pop(run), run[1], row))
        for run in runs:
            open_runs.setdefault(run, row)
    return np.array(found, np.float64).reshape(-1, 4) * grid.resolution


def write_problem(path: Path, grid: OccupancyGrid, start: list[float], goal: list[float]) -> None:
    """Write a file of one problem (docs/how_to/files.md); its map begins at (0, 0).

    Args:
        path: of the file.
        grid: the map; what is beyond it in the square of the file is solid.
        start: (2,) [m] on the map.
        goal: likewise.

    Raises:
        InputError: the map is turned, or its obstacles are more than a file may have.
    """
    x, y, yaw = grid.origin
    if yaw != 0.0:
        raise InputError(f"{path.name}: the map is turned by {yaw:g} rad; expected an upright one")
    rows, cols = grid.shape
    width, height = cols * grid.resolution, rows * grid.resolution
    size = max(width, height)
    rects = rectangles(grid).tolist()
    if width < size:
        rects.append([width, 0.0, size, size])
    if height < size:
        rects.append([0.0, height, size, size])
    if len(rects) > LIMITS["outline"].maximum:
        expected = f"expected at most {LIMITS['outline'].maximum:,}"
        raise InputError(f"{path.name}: {len(rects):,} rectangles; {expected}")
    problem = {
        "name": path.stem, "size": round(size, 6),
        "rects": [[round(value, 6) for value in rect] for rect in rects],
        "start": [round(start[0] - x, 6), round(start[1] - y, 6)],
        "goal": [round(goal[0] - x, 6), round(goal[1] - y, 6)], "optimum": None,
    }  # fmt: skip
    write_text(path, json.dumps([problem]))


_NAME: Final = re.compile(r"\w([\w -]{0,58}\w)?")
_LOADING: Final = threading.Lock()  # one map at a time, of all pages
FIRST: Final = ("visibility", "a_star", "rrt_star", "rrt_star_woa_global", "swarm", "lattice")


class PlanSession(PageSession):
    """Serves the page Plan.

    Args:
        places: whose maps may be taken, by key; saved maps are added.
        folder: where files are written, and uploads lie.
        outbox: of the page.
    """

    fields = fields_of("plan", planner=PLANNERS.built_in)

    def __init__(self, places: dict[str, Place], folder: Path, outbox: Outbox) -> None:
        super().__init__(outbox)
        self._places, self._folder = places, folder
        self._base: OccupancyGrid = blank(10.0, 8.0)
        self._grid = self._base
        self._problem: Problem | None = None
        self._plans: dict[str, Plan] = {}
        self._seed = 0
        self._cancels = 0
        outbox.send("planners", names=sorted(PLANNERS.built_in), first=FIRST, shapes=SHAPES)
        self._show("", [1.5, 4.0], [8.5, 4.0])

    def receive(self, message: Message) -> None:
        """See `PageSession.receive`; a cancellation does not wait for its turn."""
        if message["type"] == "cancel":
            self._cancels += 1
        else:
            super().receive(message | {"cancels": self._cancels})

    def _ends(self, message: Message) -> bool:
        """Whether the page has gone, or has cancelled since it sent a message."""
        return self._closing.is_set() or self._cancels != message["cancels"]

    def _show(self, name: str, start: Any = None, goal: Any = None) -> None:
        """Send the map; with start and goal where another map begins."""
        self._problem, self._plans = None, {}
        grid = self._grid
        solids = closed_loops(grid.walls())
        self._out.send("map", name=name, bounds=grid.bounds, solids=solids, start=start, goal=goal)

    def on_blank(self, message: Message) -> None:
        """Begin with an empty room."""
        width, height = message["width"], message["height"]
        self._base = self._grid = blank(width, height)
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
        path = self._folder / UPLOADS / name
        if Path(name).name != name or path.is_symlink() or not path.is_file():
            raise InputError(f"load.name is {name!r}; expected the name of an uploaded file")
        with _LOADING:
            self._stage("read", message)
            grid = loaded(path, message["resolution"])
            self._stage("outline", message)
            self._take(grid, Path(name).stem)

    def on_scale(self, message: Message) -> None:
        """Enlarge the map without its shapes, so that a distance on it becomes true."""
        self._take(scaled(self._base, message["factor"]), "the map")

    def _take(self, grid: OccupancyGrid, name: str) -> None:
        """Begin with a map; start and goal are as far apart as its cells are."""
        ends = far_ends(grid, name)
        self._base = self._grid = grid
        self._show(name, *ends)

    def _stage(self, name: str, message: Message) -> None:
        """Tell how far loading is, or end it by an `InputError` where it was cancelled."""
        if self._ends(message):
            raise PageError("load_cancelled")
        self._out.send("loading", stage=name)

    def on_draw(self, message: Message) -> None:
        """Draw all shapes over the map anew."""
        for row in message["shapes"]:
            if int(row[0]) != row[0] or not 0 <= row[0] < len(SHAPES):
                raise InputError(f"draw.shapes: kind {row[0]:g}; expected 0 to {len(SHAPES) - 1}")
        self._grid = drawn(self._base, message["shapes"])
        self._show("")

    def on_plan(self, message: Message) -> None:
        """Run planners, one after another."""
        ends = message["start"], message["goal"]
        self._problem = problem_of(self._grid, *ends, message["clearance"])
        self._plans, self._seed = {}, message["seed"]
        for name in message["planners"]:
            if self._ends(message):
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
        if not _NAME.fullmatch(name) or re.match("protocol$|amendment_|deleted_", name):
            raise InputError(
                f"save.name is {name!r}; expected at most 60 letters, digits, spaces, - and _, and "
                "no name of an experiment's file"
            )
        self._folder.mkdir(parents=True, exist_ok=True)
        if message["what"] == "problem":
            path = self._folder / f"{name}.json"
            write_problem(path, self._grid, message["start"], message["goal"])
            self._out.send("saved", files=[path.name])
            return
        path = self._folder / f"{name}.yaml"
        write_map(self._grid, path, suffix=".png")
        scene = {"name": "map_file", "path": str(path)}
        env = self._places["scene:map_file"].env  # with the chair of this studio
        self._places[f"map:{name}"] = Place("map", name, scene, env)
        self._out.send("saved", files=[path.name, path.with_suffix(".png").name])


FRAMES: Final = 24  # of a growth
_MAX_EDGES: Final = 4000  # of a tree that are sent; of larger ones, every second, third ...
_INVALID: Final = "invalid"  # a status that only the independent judge gives


def problem_of(
    grid: OccupancyGrid, start: list[float], goal: list[float], clearance: float
) -> Problem:
    """The problem of a map."""
    return Problem(Space.from_grid(grid), np.array(start), np.array(goal), clearance, "drawn")


def answer(name: str, problem: Problem, seed: int, deadline: float) -> tuple[Plan, dict[str, Any]]:
    """A planner's plan, by its name and a seed, within a deadline [s]; and what the page shows."""
    planner = make_planner(name)
    plan = checked_plan(planner, planner.plan(problem, np.random.default_rng(seed), deadline))
    row: dict[str, Any] = {
        "planner": name, "status": str(plan.status), "note": plan.note, "path": plan.path[:, :2],
        "time_ms": 1e3 * plan.timings.get("time_s", 0.0), "nodes": plan.counters.get("nodes"),
        "length": None, "clearance_min": None, "clearance_mean": None,
        "grows": bool(len(plan.tree)) or _swarm_of(planner) is not None,
    }  # fmt: skip
    if len(plan.path):
        figures = path_figures(plan.path, problem)
        row |= {key: figures[f"{key}_m"] for key in ("length", "clearance_min", "clearance_mean")}
        faults = plan_faults(plan, problem, getattr(planner, "footprint", None))
        if faults:
            row["status"], row["note"] = _INVALID, faults[0]
    return plan, row


def frames_of(name: str, problem: Problem, plan: Plan, seed: int) -> Iterator[dict[str, Any]]:
    """A planner's way to its plan: iterations, edges of the tree, members of the swarm, path.

    Name, problem and seed are those with which the plan was made.
    """
    planner = make_planner(name)
    swarm = _swarm_of(planner)
    if swarm is not None:
        yield from _swarm_frames(swarm, problem, plan, seed)
        return
    for part in growth(problem, planner, plan, seed, FRAMES):
        step = max(1, -(-len(part.tree) // _MAX_EDGES))
        yield {
            "iterations": part.counters.get("iterations", 0), "tree": _short(part.tree[::step]),
            "swarm": [], "path": _short(part.path[:, :2]), "length": part.length,
        }  # fmt: skip


def _swarm_of(planner: Any) -> SwarmPlanner | None:
    """The planner whose swarm moves whole paths, where its members can be followed."""
    swarm = getattr(planner, "swarm", planner)
    if not isinstance(swarm, SwarmPlanner):
        return None
    return None if isinstance(SWARM_OPTIMIZERS.make(swarm.optimizer), Mealpy) else swarm


def _swarm_frames(
    planner: SwarmPlanner, problem: Problem, plan: Plan, seed: int
) -> Iterator[dict[str, Any]]:
    made = plan.counters.get("iterations", planner.iterations)
    for k in np.unique(np.linspace(0, made, FRAMES).round().astype(int)).tolist():
        rng, path, tree = np.random.default_rng(seed), None, np.empty((0, 4))
        if planner.first not in (None, "line"):
            maker: Any = FIRST_PLANNERS.make(planner.first)
            if "first_iterations" in plan.counters:
                maker = replace(maker, iterations=plan.counters["first_iterations"])
            first = maker.plan(problem, rng)
            if not len(first.path):
                return
            path, tree = first.path[:, :2], first.tree
        begun = planner.start(problem, path, rng)
        moves: Any = SWARM_OPTIMIZERS.make(planner.optimizer)
        cost: Any = OBJECTIVES.make(planner.objective)
        search = swarms.new_search(begun, cost.path_cost, moves.parameters)
        found = swarms.run(search, k, planner.cycle, stream(rng))
        positions = search.swarm.positions
        places = begun.path_problem.anchors + positions.reshape(len(positions), -1, 2)
        ends = np.array(problem.start[:2]), np.array(problem.goal[:2])
        line = found.line if len(found.line) else found.best
        yield {
            "iterations": k, "tree": _short(tree[:_MAX_EDGES]), "path": _short(line),
            "swarm": [_short(np.vstack([ends[0], each, ends[1]])) for each in places],
            "length": path_length(line),
        }  # fmt: skip


def _short(rows: Array) -> list[list[float]]:
    """Rows of numbers [m] to the centimetre."""
    shortened: list[list[float]] = np.round(rows, 2).tolist()
    return shortened

"""Arenas: closed grounds with obstacles.

The empty room, a corridor of random cylinders (as in BARN), and a door in the side of a corridor;
and for all scenes: tables of worlds, and what stands free and passes.
"""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import yaml
from numpy.typing import ArrayLike

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.files import check_cells
from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.geometry.outline import Footprint, footprint_clearance
from wheelchair_gym.geometry.planar import polygon_edges
from wheelchair_gym.maps import FREE, OCCUPIED, OccupancyGrid, bottleneck, geodesic
from wheelchair_gym.scenes.raster import CELL, paint_discs, paint_polygon, to_cells
from wheelchair_gym.types import Episode

FOOTPRINT: Final = Footprint()  # of the default chair
CLEARANCE: Final = 0.15  # m round the footprint at starts and goals that are drawn


Pose = tuple[float, float, float]  # m, m, rad


@settings
class Ends:
    """Start and goal of a scene."""

    start: Pose | None = setting(default=None, unit="m, m, rad")
    """Start pose; null draws it at random."""
    goal: Pose | None = setting(default=None, unit="m, m, rad")
    """Goal pose; null draws it at random."""


def passing_radius(footprint: Footprint) -> float:
    """Radius [m] of a disc that passes where the footprint does: half its width, and a cell."""
    return footprint.half_width + CELL


def is_free_pose(
    pose: Array, walls: Array, discs: Array, footprint: Footprint, clearance: float
) -> bool:
    """Whether a footprint at a pose (3,) is at least `clearance` [m] from everything."""
    x, y, yaw = pose
    gap = footprint_clearance(x, y, yaw, footprint.array, walls, discs, clearance + 0.01)
    return bool(gap >= clearance and gap > 0.0)


def check_start(episode: Episode, footprint: Footprint) -> None:
    """Check that a chair can stand at an episode's start.

    Raises:
        InputError: it cannot.
    """
    if not is_free_pose(episode.start, episode.walls, episode.discs, footprint, 0.0):
        x, y, yaw = episode.start
        raise InputError(
            f"scene {episode.name}: {footprint} does not fit at the start "
            f"({x:.2f}, {y:.2f}, {yaw:.2f})"
        )


def check_passable(episode: Episode, footprint: Footprint) -> float:
    """Return the largest radius [m] of which `geodesic` has a route from an episode's start.

    Raises:
        InputError: the widest disc that gets to the goal is narrower than the footprint by more
            than a cell.
    """
    ends = episode.map, episode.start[:2], episode.goal[:2]
    radius = bottleneck(*ends)
    if radius + 0.5 * episode.map.resolution < footprint.half_width:
        raise InputError(
            f"scene {episode.name}: {footprint} does not pass from start to goal; the widest way "
            f"is {max(0.0, 2.0 * radius):.2f} m wide at its narrowest spot"
        )
    routed = bottleneck(*ends, corners=False)
    return routed if routed > 0.0 else radius


WALL: Final = 0.10  # m: thickness of the wall round an arena


def _tuples(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _tuples(item) for key, item in value.items()}
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def read_table(name: str) -> dict[str, Any]:
    """Read a table of worlds of this folder, whose lists become tuples."""
    text = Path(__file__).with_name(f"{name}.yaml").read_text("utf-8")
    table: dict[str, Any] = _tuples(yaml.safe_load(text))
    return table


class Arena(NamedTuple):
    """A closed ground with obstacles."""

    map: OccupancyGrid
    walls: Array  # (n, 4) m
    discs: Array  # (m, 3) m

    def is_free(self, pose: Array, footprint: Footprint, clearance: float) -> bool:
        """Return True if a footprint at a pose (3,) is at least `clearance` [m] from everything."""
        return is_free_pose(pose, self.walls, self.discs, footprint, clearance)

    def episode(self, start: Array, goal: Array, name: str) -> Episode:
        """Return an episode here from a start pose (3,) to a goal pose (3,)."""
        return Episode(self.map, start, goal, self.walls, self.discs, name=name)


def make_arena(
    bounds: tuple[float, float, float, float],
    rects: Sequence[tuple[float, float, float, float]] = (),
    polygons: Sequence[ArrayLike] = (),
    discs: ArrayLike = (),
) -> Arena:
    """Make an arena, enclosed by a wall outside its bounds.

    Args:
        bounds: free ground [m]: xmin, ymin, xmax, ymax; sides are rounded to the raster.
        rects: upright obstacles [m], rounded to the raster; they may touch and overlap.
        polygons: convex, counter-clockwise, (k, 2) [m]; they touch nothing.
        discs: (m, 3) [m]: x, y, radius.
    """
    x0, y0 = bounds[0] - WALL, bounds[1] - WALL
    shape = to_cells(bounds[3] + WALL - y0), to_cells(bounds[2] + WALL - x0)
    check_cells(*shape, "scene")
    cells = np.full(shape, OCCUPIED, dtype=np.int8)
    rim = to_cells(WALL)
    cells[rim:-rim, rim:-rim] = FREE
    for left, low, right, high in rects:
        corners = left - x0, low - y0, right - x0, high - y0
        a, b, c, d = (max(0, to_cells(value)) for value in corners)
        cells[b:d, a:c] = OCCUPIED
    origin = (x0, y0, 0.0)
    outlines = [np.asarray(polygon, dtype=np.float64) for polygon in polygons]
    walls = OccupancyGrid(cells.copy(), CELL, origin).walls()
    walls = np.vstack([walls, *map(polygon_edges, outlines)])
    for outline in outlines:
        paint_polygon(cells, outline - (x0, y0), OCCUPIED)
    cylinders = np.asarray(discs, dtype=np.float64).reshape(-1, 3)
    paint_discs(cells, cylinders, x0, y0, OCCUPIED)
    return Arena(OccupancyGrid(cells, CELL, origin), walls, cylinders)


def poses_along(start: tuple[float, float], goal: tuple[float, float]) -> tuple[Array, Array]:
    """Return start and goal poses (3,) that both look from start to goal."""
    yaw = math.atan2(goal[1] - start[1], goal[0] - start[0])
    return np.array([*start, yaw]), np.array([*goal, yaw])


def draw_pose(rng: np.random.Generator, edge: float, width: float, height: float) -> Pose:
    """Draw a pose [m, m, rad] in a room, at least `edge` [m] from its sides."""
    return (*rng.uniform(edge, (width - edge, height - edge)), rng.uniform(-3, 3))


_TRIES = 10_000  # a room of 2 m x 2 m takes hundreds
_MIN_DISTANCE = 2.0  # m from a drawn start to the goal, where the room is large enough
_EDGE = 0.5  # m: no axle is drawn nearer to a wall


@settings
class EmptyRoom(Ends):
    """An empty rectangular room, its lower-left corner at (0, 0): for first steps and physics."""

    size: tuple[float, float] = setting(default=(8.0, 6.0), unit="m", low=2.0, high=200.0)
    """Length along x and y of the room."""

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw the poses that are not given.

        Raises:
            InputError: the given start or goal does not fit into the room, or nothing drawn does.
        """
        width, height = self.size
        arena = make_arena((0.0, 0.0, width, height))
        minimum = min(_MIN_DISTANCE, 0.4 * math.hypot(width, height))
        given = {"start": self.start, "goal": self.goal}
        for name, pose in given.items():
            if pose is not None and not (
                0 < pose[0] < width
                and 0 < pose[1] < height
                and arena.is_free(np.array(pose), footprint, 0.0)
            ):
                raise InputError(
                    f"EmptyRoom.{name} is {pose}; {footprint} must stand in a room of {self.size}"
                )
        for _ in range(_TRIES):
            poses = {
                name: np.array(pose or draw_pose(rng, _EDGE, width, height))
                for name, pose in given.items()
            }
            start, goal = poses.values()
            drawn = [poses[name] for name, pose in given.items() if pose is None]
            far = math.dist(start[:2], goal[:2]) >= minimum or not drawn
            if far and all(arena.is_free(pose, footprint, CLEARANCE) for pose in drawn):
                return arena.episode(start, goal, "empty")
        raise InputError(
            f"EmptyRoom: {_TRIES} draws found no start and goal for {footprint} in {self}"
        )


_BARN = "BARN benchmark (Perille et al. 2020)"
_CLUTTER_TRIES = 50  # corridors drawn before the settings are called impossible
_PLACES = 10  # drawn for one cylinder before it is left out
_RADIUS = 0.075, 0.25  # m: smallest and largest of a cylinder; BARN's cylinders upwards
_CLUSTERED = 0.4  # share of cylinders beside another: clusters block more than single ones
_OVERLAP = 0.9  # of the sum of radii: how far apart cylinders of a cluster stand
_RUN = 1.4  # m, without cylinders, ahead of the start and before the goal
_ENDS = 1.2  # m, from start and goal to the end walls


@settings
class Clutter:
    """Random cylinders between two walls; the goal lies straight ahead, as in BARN's worlds.

    The footprint is free at both ends; a disc of the chair's half width and a margin can pass.
    """

    length: float = setting(default=10.0, unit="m", low=4.0, high=50.0, source=_BARN)
    """Distance from start to goal."""
    width: float = setting(default=4.5, unit="m", low=1.5, high=30.0, source=_BARN)
    """Width of the corridor."""
    density: float = setting(default=0.4, unit="1/m2", low=0.0, high=5.0)
    """Cylinders per area."""
    min_gap: float = setting(default=0.9, unit="m", low=0.0, high=3.0)
    """Minimum gap between cylinders that do not overlap."""
    passage_margin: float = setting(default=0.10, unit="m", low=0.0, high=0.5)
    """Clearance on each side of the chair that a solvable corridor leaves."""

    def _draw_discs(self, rng: np.random.Generator) -> Array:
        """Cylinders (m, 3), each alone or overlapping others, with gaps as set."""
        low, high = _ENDS + _RUN, _ENDS + self.length - _RUN
        discs = np.empty((0, 3))
        for _ in range(round(self.density * (high - low) * self.width)):
            for _ in range(_PLACES):
                radius = rng.uniform(*_RADIUS)
                if len(discs) and rng.random() < _CLUSTERED:
                    x, y, r = discs[rng.integers(len(discs))]
                    angle = rng.uniform(-math.pi, math.pi)
                    x += _OVERLAP * (r + radius) * math.cos(angle)
                    y += _OVERLAP * (r + radius) * math.sin(angle)
                else:
                    x, y = rng.uniform(low, high), rng.uniform(0.0, self.width)
                gaps = np.hypot(discs[:, 0] - x, discs[:, 1] - y) - discs[:, 2] - radius
                gaps = np.append(gaps, [y - radius, self.width - y - radius])
                if low <= x <= high and ((gaps <= 0.0) | (gaps >= self.min_gap)).all():
                    discs = np.vstack([discs, (x, y, radius)])
                    break
        return discs

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw corridors until a chair of this footprint stands free in one and can pass.

        Raises:
            InputError: fifty could not.
        """
        start, goal = poses_along((_ENDS, self.width / 2), (_ENDS + self.length, self.width / 2))
        for _ in range(_CLUTTER_TRIES):
            bounds = (0.0, 0.0, self.length + 2 * _ENDS, self.width)
            arena = make_arena(bounds, discs=self._draw_discs(rng))
            paths = geodesic(arena.map, goal, footprint.half_width + self.passage_margin)
            stands = all(arena.is_free(pose, footprint, 0.0) for pose in (start, goal))
            if stands and np.isfinite(paths.at(start[:2])):
                return arena.episode(start, goal, "clutter")
        raise InputError(
            f"Clutter: none of {_CLUTTER_TRIES} corridors lets {footprint} pass with {self}"
        )


_DOORWAY_TRIES = 500
_CORRIDOR_LENGTH, _ROOM_DEPTH = 7.0, 3.5  # m
_TURN = np.linspace(0.0, 0.5 * math.pi, 4002)[1:-1]  # rad
_DOORWAY_CLEARANCE = 0.06  # m round the footprint: a corridor of 0.90 m leaves 0.14 m


@settings
class Doorway:
    """A corridor, and a room behind a door in its side: a turn of 90 degrees into the door.

    The start is in the corridor, along it; the goal in the room.
    """

    door_width: float = setting(default=0.90, unit="m", low=0.65, high=2.0)
    """Clear width of the door."""
    corridor_width: float = setting(default=1.20, unit="m", low=0.75, high=4.0)
    """Clear width of the corridor."""

    def __post_init__(self) -> None:
        for name, width in vars(self).items():
            if abs(width - CELL * to_cells(width)) > 1e-6:
                raise InputError(f"Doorway.{name} is {width} m; expected a multiple of {CELL} m")

    def margin(self, footprint: Footprint = FOOTPRINT) -> float:
        """Maximum growth [m] on every side with which a chair gets round the corner.

        No manoeuvre of a rigid outline has more; below 0 none exists, and -0.3 is -0.3 m or less.
        """
        half = 0.5 * min(self.door_width, self.corridor_width) - footprint.half_width
        if half <= -0.3:
            return half
        return _last(
            lambda grown: _turns(self.door_width, self.corridor_width, grown, footprint), -0.3, half
        )

    @staticmethod
    def narrowest_door(margin: float, corridor: float) -> float:
        """Return the narrowest door [m] of a corridor [m] with a margin [m] round the corner."""
        return -_last(lambda door: _turns(-door, corridor, margin, FOOTPRINT), -2.0, -0.5)

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw where the door is, which way round, and where the chair starts.

        Raises:
            InputError: a chair of this footprint does not get round the corner, or does not stand
                in the corridor.
        """
        margin = self.margin(footprint)
        if margin < 0.0:
            raise InputError(
                f"Doorway: {footprint} does not turn from a corridor of {self.corridor_width} m "
                f"into a door of {self.door_width} m: it is {-margin:.2f} m too large on every side"
            )
        corridor, length = self.corridor_width, _CORRIDOR_LENGTH
        low = corridor + WALL
        for _ in range(_DOORWAY_TRIES):
            middle = rng.uniform(0.35, 0.65) * length
            # On the raster, so that the door's width is exact.
            left = CELL * round((middle - 0.5 * self.door_width) / CELL)
            middle, right = left + 0.5 * self.door_width, left + self.door_width
            walls = [(0.0, corridor, left, low), (right, corridor, length, low)]
            arena = make_arena((0.0, 0.0, length, low + _ROOM_DEPTH), walls)
            side = rng.choice((-1.0, 1.0))
            x = middle - side * rng.uniform(1.2, 1.8)
            start = np.array([x, 0.5 * corridor, 0.0 if side > 0 else math.pi])
            x = middle + rng.uniform(-0.5, 0.5)
            goal = np.array([x, low + 0.6 * _ROOM_DEPTH, 0.5 * math.pi])
            if all(arena.is_free(pose, footprint, _DOORWAY_CLEARANCE) for pose in (start, goal)):
                return arena.episode(start, goal, "doorway")
        raise InputError(f"Doorway: {_DOORWAY_TRIES} draws left no start for {footprint} in {self}")


def _last(holds: Callable[[float], bool], low: float, high: float) -> float:
    """Return the largest number of an interval up to which a condition holds."""
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def _turns(door: float, corridor: float, grown: float, footprint: Footprint) -> bool:
    """Return True if the outline, grown on every side [m], turns from a corridor into a side door.

    At an angle t from the corridor, one long side rests on the door's near post and a rear corner
    slides along the far wall. Its front may reach to the other post's face, or beside it, until the
    slab between both posts is as wide as the outline: from there on it goes in at any length. The
    least over t is the limit: a ladder round a corner, with a width, over a wall with a thickness.
    """
    length = footprint.front + footprint.rear + 2.0 * grown
    width = 2.0 * (footprint.half_width + grown)
    if width > min(door, corridor):
        return False
    s, c = np.sin(_TURN), np.cos(_TURN)
    rests = corridor * c - width  # of its right side, from the near post's lower edge
    face = door * c + corridor * s + rests * c / s
    beside = door / c + rests / (s * c)
    held = door * s - WALL * c < width
    return bool(np.maximum(face, beside)[held].min(initial=math.inf) >= length)

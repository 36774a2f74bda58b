"""Top views: a chair in its world and all that moves there; maps side by side; plans; legends."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wheelchair_gym.actors import records
from wheelchair_gym.actors.records import PERSON, Actors, actor_outline
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.geometry.kinematics import DriveGeometry
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import polygon_edges, to_world, wrap_angle
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.rendering import floor, palette
from wheelchair_gym.rendering.canvas import Canvas, Frame, Image, text_width, write_text
from wheelchair_gym.rendering.palette import WORDS, Colour
from wheelchair_gym.sensors.settings import SensorSettings, UltrasonicSettings
from wheelchair_gym.types import Episode, Reading, no_discs, no_walls

# Words, and what draws their mark between two points (2, 2).
Entry = tuple[str, Callable[[Canvas, Array], None]]
# Words and colour of each kind of thing that moves, and of the rim that tells whom a person avoids.
THINGS = {
    records.DOOR: (WORDS["door"], palette.LEAF),
    records.OBSTACLE: (WORDS["sudden"], palette.SUDDEN),
    records.FURNITURE: (WORDS["furniture"], palette.LIGHT),
}
RIMS = {
    records.EVERYBODY: (WORDS["person"], palette.INK),
    records.PEOPLE: ("inattentive person", palette.BLIND),
    records.NOBODY: ("person who avoids nothing", palette.VERMILION),
}
_SWATCH = 2.2  # length of a line, in heights of the letters
_GAP, _SPACE = 1.4, 0.5  # between two entries, and two words, likewise


def line(words: str, colour: Colour, width: float = 3.0) -> Entry:
    """An entry with a line."""
    return words, lambda on, at: on.line(at, colour, width)


def disc(words: str, colour: Colour, rim: Colour | None = None) -> Entry:
    """An entry with a disc, with a rim."""

    def draw(on: Canvas, at: Array) -> None:
        middle = at.mean(axis=0)
        if rim is not None:
            on.dot(middle, 7.5, rim)
        on.dot(middle, 5.5, colour)

    return words, draw


def scene_entries(actors: Actors) -> list[Entry]:
    """Return the legend's entries for what pictures of an episode show."""
    entries = [
        ("start", lambda on, at: floor.draw_start(on, at.mean(axis=0))),
        disc(WORDS["goal"], palette.GOAL),
        line(WORDS["path"], palette.PATH),
        line(WORDS["trail"], palette.TRAIL),
        line(WORDS["laser"], palette.LASER),
        line(WORDS["ultrasonic"], palette.WIDE),
        line(WORDS["estimate"], palette.ESTIMATE),
    ]
    kinds = set(actors.rows["kind"].tolist())
    avoids = set(actors.rows["avoids"][actors.rows["kind"] == records.PERSON].tolist())
    entries += [disc(RIMS[k][0], palette.PERSON, RIMS[k][1]) for k in sorted(avoids, reverse=True)]
    return entries + [line(*THINGS[kind], 6.0) for kind in sorted(kinds & set(THINGS))]


MAP_ENTRIES: list[Entry] = [
    ("start", lambda on, at: floor.draw_start(on, at.mean(axis=0))),
    line("trail", palette.TRAIL),
    line("occupied", palette.SOLID, 8.0),
    line("unknown", palette.UNKNOWN, 8.0),
]


def with_legend(picture: Image, entries: Sequence[Entry], caption: str = "") -> Image:
    """A picture (h, w, 3) with rows of marks and words on top, as wide as it is.

    The words of a caption follow on rows of their own.
    """
    long_side = max(picture.shape[:2])
    width, row = floor.FINE * picture.shape[1], floor.FINE * floor.strip_height(long_side)
    if row == 0:
        return picture
    capital = 0.36 * row
    places, x, rows = [], capital, 1
    words = caption.split()
    for k, label in enumerate([*(label for label, _ in entries), *words]):
        swatch = (_SWATCH + 0.6) * capital if k < len(entries) else 0.0
        needed = swatch + text_width(label, capital)
        if (x + needed > width - capital or k == len(entries)) and x > capital:
            x, rows = capital, rows + 1
        places.append((x + swatch, (rows - 0.5) * row))
        x += needed + (_GAP if swatch else _SPACE) * capital
    # One metre is one pixel here, and y points up.
    image: Image = np.full((rows * row, width, 3), palette.PAPER, dtype=np.uint8)
    canvas = Canvas(image, Frame(1.0, 0.0, 0.0), floor.stroke_scale(long_side) * floor.FINE)
    for (_, mark), (right, middle) in zip(entries, places, strict=False):
        left = right - (_SWATCH + 0.6) * capital
        mark(canvas, np.array([(left, -middle), (left + _SWATCH * capital, -middle)]))
    for label, (left, middle) in zip([*(e[0] for e in entries), *words], places, strict=True):
        write_text(image, label, (left, middle + 0.5 * capital), capital, palette.INK)
    return np.vstack([canvas.resized(1 / floor.FINE).image, picture])


_MARGIN = 0.3  # m round what is known
_TRAIL = 1.5  # pixels


def draw_map(maps: Sequence[tuple[str, OccupancyGrid, ArrayLike]]) -> Image:
    """Draw maps (h, w, 3) RGB side by side at one scale, each with its trail and its start.

    Args:
        maps: for each its caption (ASCII), the grid and poses (n, 2 or 3) [m, m, rad].
    """
    corners = np.concatenate([floor.known_area(grid) for _, grid, _ in maps])
    bounds = floor.bounding_box(corners, _MARGIN)
    panels = []
    for caption, grid, trail in maps:
        fine = floor.new_canvas(bounds, 900).resized(floor.FINE)
        floor.draw_grid(fine, grid)
        poses = np.asarray(trail, dtype=np.float64)
        fine.line(poses, palette.TRAIL, _TRAIL)
        if len(poses):
            floor.draw_start(fine, poses[0])
        floor.draw_scale_bar(fine)
        panel = fine.resized(1 / floor.FINE)
        floor.write_caption(panel, caption)
        panels.append(panel.image)
    return np.hstack(panels)


def draw_actors(canvas: Canvas, actors: Actors, poses: Array) -> None:
    """Draw actors at their true shapes and poses (k, 3) [m, m, rad]; NaN: not there."""
    for row, (x, y, yaw) in zip(actors.rows, poses, strict=True):
        if not math.isfinite(x):
            continue
        kind = int(row["kind"])
        colour = palette.PERSON if kind == PERSON else THINGS[kind][1]
        outline = actor_outline(row, x, y, yaw)
        if len(outline) == 1:
            rim = RIMS[int(row["avoids"])][1] if kind == PERSON else palette.INK
            canvas.disc(outline[0], float(row["size"][0]), colour)
            canvas.ring(outline[0], float(row["size"][0]), rim, 2.0)
        else:
            canvas.fill([outline], colour)
            # A leaf is too thin for a line round it in another colour.
            edge = colour if kind == records.DOOR else palette.INK
            canvas.line(outline, edge, 1.5, closed=True)


CHAIR_ALPHA = 0.55  # how much of what lies under the chair it hides
_LASER_ALPHA = 0.10
_CONE_ALPHA = 0.40  # of a fresh echo
_FADE = 1.0  # s: an echo this old has faded; the age at which it counts as stale
_HEADING = np.array([(0.92, 0.0), (0.45, 0.42), (0.56, 0.0), (0.45, -0.42)])  # of front, half
_DIFFERS = (0.02, math.radians(1.0))  # m, rad: estimates nearer than this are not drawn apart


class TopView:
    """Draws an episode from above; what does not move is drawn once.

    Args:
        episode: the world, the map, the start and the goal.
        footprint: the chair's outline.
        drive: where the drive wheels are.
        sensors: where the sensors sit and what they can see.
        size: height and width of a picture, the world in its middle, or its long side alone
            [pixels].
        tolerance: how near the goal counts [m], where the episode does not say.
    """

    def __init__(
        self,
        episode: Episode,
        footprint: Footprint | None = None,
        drive: DriveGeometry | None = None,
        sensors: SensorSettings | None = None,
        size: int | tuple[int, int] = 640,
        tolerance: float = 0.30,
    ) -> None:
        self.footprint = footprint or Footprint()
        self.drive = drive or DriveGeometry()
        self.sensors = sensors or SensorSettings()
        centres, radii = episode.discs[:, :2], episode.discs[:, 2:]
        ends: list[Any] = [floor.known_area(episode.map), [episode.start[:2], episode.goal[:2]]]
        ends += [episode.walls.reshape(-1, 2), centres - radii, centres + radii]
        bounds = floor.bounding_box(np.concatenate(ends), 0.1)
        self.actors = episode.actors
        self._cones = _cones(self.sensors.ultrasonic)
        self._wheels = _wheels(self.footprint, self.drive)
        self._mark = _HEADING * (self.footprint.front, self.footprint.half_width)
        fine = floor.new_canvas(bounds, size).resized(floor.FINE)
        floor.draw_grid(fine, episode.map)
        floor.draw_obstacles(fine, episode.walls, episode.discs)
        near = tolerance if episode.tolerance is None else episode.tolerance
        floor.draw_goal(fine, episode.goal, near)
        floor.draw_start(fine, episode.start)
        floor.draw_scale_bar(fine)
        self.background = fine.resized(1 / floor.FINE)
        self.frame = self.background.frame

    def draw(
        self,
        pose: ArrayLike,
        reading: Reading | None = None,
        trail: ArrayLike | None = None,
        path: ArrayLike | None = None,
        rollout: ArrayLike | None = None,
        look_ahead: ArrayLike | None = None,
        caption: str = "",
        actors: Array | None = None,
    ) -> Image:
        """Draw one instant (h, w, 3) RGB.

        Args:
            pose: where the chair is (3,) [m, m, rad]; its readings are drawn from there.
            reading: laser, ultrasonics, and the pose where the chair believes it is.
            trail: where it has been (n, 2 or 3) [m].
            path: the guidance path (n, 2 or 3) [m].
            rollout: where generated commands lead (n, 2 or 3) [m].
            look_ahead: points (n, 2) [m] of the path that the chair steers by.
            caption: one line below the picture, ASCII.
            actors: where the episode's actors are (k, 3) [m, m, rad]; NaN: not there.
        """
        canvas = Canvas(self.background.image.copy(), self.frame, self.background.stroke_scale)
        at = np.asarray(pose, dtype=np.float64)
        if path is not None:
            canvas.line(path, palette.PATH, 2.5)
        for way in (trail, rollout):
            canvas.line([] if way is None else way, palette.TRAIL, 2.0)
        if reading is not None:
            self._lasers(canvas, at, np.asarray(reading.laser, dtype=np.float64))
            self._ultrasonics(canvas, at, reading)
            gap = np.asarray(reading.pose) - at
            if math.hypot(gap[0], gap[1]) > _DIFFERS[0] or abs(wrap_angle(gap[2])) > _DIFFERS[1]:
                outline = to_world(self.footprint.corners, reading.pose)
                heading = to_world([(0.0, 0.0), (self.footprint.front, 0.0)], reading.pose)
                canvas.line(outline, palette.ESTIMATE, 1.5, closed=True)
                canvas.line(heading, palette.ESTIMATE, 1.5)
        if actors is not None:
            draw_actors(canvas, self.actors, actors)
        body = to_world(self.footprint.corners, at)
        canvas.fill([body], palette.CHAIR, CHAIR_ALPHA)
        canvas.fill([to_world(wheel, at) for wheel in self._wheels], palette.WHEEL)
        canvas.fill([to_world(self._mark, at)], palette.FREE)
        canvas.line(body, palette.CHAIR, 2.0, closed=True)
        for point in np.asarray(look_ahead if look_ahead is not None else [], dtype=np.float64):
            canvas.dot(point, 4.5, palette.FREE)
            canvas.dot(point, 3.0, palette.PATH)
        # The strip is no part of the world: what reached into it is wiped off.
        h, w = canvas.image.shape[:2]
        world = h - floor.strip_height(max(h, w))
        canvas.image[world:] = self.background.image[world:]
        floor.write_caption(canvas, caption)
        return canvas.image

    def _lasers(self, canvas: Canvas, pose: Array, scan: Array) -> None:
        """Draw the scan of each scanner from its own place; of a lone one, any number of beams."""
        lasers = self.sensors.lasers if len(scan) else ()
        if len(lasers) == 1:
            lasers = (replace(lasers[0], beams=len(scan)),)
        for laser in lasers:
            ranges, scan = np.split(scan, [laser.beams])
            seen = np.clip(np.nan_to_num(ranges, nan=0.0, posinf=laser.reach), 0.0, laser.reach)
            mount = (laser.x, laser.y)
            echoes = to_world(mount + seen[:, None] * laser.directions, pose)[np.isfinite(ranges)]
            # A lone beam without echo would stand out of the fan as a spike.
            beside = np.pad(seen, 1)
            seen = np.minimum(seen, np.maximum(beside[:-2], beside[2:]))
            fan = to_world(np.vstack([[mount], mount + seen[:, None] * laser.directions]), pose)
            canvas.fill([fan], palette.LASER, _LASER_ALPHA)
            canvas.points(echoes, palette.LASER)

    def _ultrasonics(self, canvas: Canvas, pose: Array, reading: Reading) -> None:
        mounts, sectors, colours = self._cones
        echoes = np.asarray(reading.ultrasonic, dtype=np.float64)
        heard = np.flatnonzero(np.isfinite(echoes))
        reach = mounts[heard, None] + echoes[heard, None, None] * sectors[heard]
        fresh = np.clip(1.0 - np.asarray(reading.age)[heard] / _FADE, 0.25, 1.0)
        for k, wedge, strength in zip(heard, to_world(reach, pose), fresh, strict=True):
            canvas.fill([wedge], colours[k], _CONE_ALPHA * float(strength))
            canvas.line(wedge[1:], colours[k], 1.5)


def _cones(settings: UltrasonicSettings) -> tuple[Array, Array, list[palette.Colour]]:
    """Place of each ranger (n, 2) [m], its cone as a sector of radius one (n, 14, 2), its colour.

    A sector's first point is the ranger, the others its arc; turned as in the chair's frame.
    """
    sectors = []
    for mounted in settings.mounted:
        cone = (settings.narrow if mounted.model == "narrow" else settings.wide).field_of_view
        angles = mounted.yaw + np.linspace(-0.5 * cone, 0.5 * cone, 13)
        arc = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        sectors.append(np.vstack([np.zeros((1, 2)), arc]))
    mounts = np.array([(mounted.x, mounted.y) for mounted in settings.mounted]).reshape(-1, 2)
    by_model = {"narrow": palette.NARROW, "wide": palette.WIDE}
    colours = [by_model[mounted.model] for mounted in settings.mounted]
    return mounts, np.array(sectors).reshape(-1, 14, 2), colours


def _wheels(footprint: Footprint, drive: DriveGeometry) -> list[Array]:
    """Outlines of two drive wheels and two casters, in the chair's frame [m].

    The casters are only drawn: 0.48 m ahead of the axle on the default chair.
    """
    r, across = drive.wheel_radius, 0.045  # m: half a tyre's width and a little
    wheel = np.array([(-r, -across), (r, -across), (r, across), (-r, across)])
    around = np.linspace(0.0, 2.0 * math.pi, 25)[:-1]
    caster = 0.055 * np.stack([np.cos(around), np.sin(around)], axis=-1)
    ahead, aside = 0.68 * footprint.front, 0.72 * footprint.half_width
    return [
        *(np.add(wheel, (0.0, 0.5 * side * drive.track)) for side in (1, -1)),
        *(np.add(caster, (ahead, side * aside)) for side in (1, -1)),
    ]


# Widths [pixels]; the last is the radius of a swarm's point.
_TREE, _SWARM, _OUTLINE, _PATH, _ROLLOUT, _OPTIMUM = 0.8, 0.9, 1.0, 4.0, 2.4, 1.6
_RAW, _POINT = 3.0, 4.0
_GOAL = disc("goal", palette.GOAL, palette.FREE)


@dataclass(frozen=True)
class PlanPicture:
    """Content of a picture of a plan: solids, tree thin, path thick, optimum dashed.

    Attributes:
        bounds: xmin, ymin, xmax, ymax [m].
        start: (2,) or (3,) [m, m, rad].
        goal: (2,) or (3,).
        path: (n, 2 or 3) [m].
        tree: edges (k, 4) [m].
        polygons: closed loops (k, 2) [m], filled by the even-odd rule.
        inflated: closed loops (k, 2) [m] of what is solid and kept free, filled likewise, paler.
        rollout: poses (n, 2 or 3) [m] that commands lead through; the path is then red, they blue.
        optimum: the best path known (n, 2 or 3) [m].
        raw: the tree's own path (n, 2) [m].
        swarm: words, colour, and a path (n, 2) or a point (1, 2) [m] that a swarm has tried.
        outlines: closed loops (k, 2) [m] of what moves, at places along the path.
    """

    bounds: ArrayLike
    start: ArrayLike
    goal: ArrayLike
    path: ArrayLike | None = None
    tree: ArrayLike | None = None
    polygons: Sequence[ArrayLike] = ()
    inflated: Sequence[ArrayLike] = ()
    rollout: ArrayLike | None = None
    optimum: ArrayLike | None = None
    raw: ArrayLike | None = None
    swarm: Sequence[tuple[str, palette.Colour, ArrayLike]] = ()
    outlines: Sequence[ArrayLike] = ()

    def draw(
        self, size: int | tuple[int, int] = 640, caption: str = "", legend: bool = False
    ) -> Image:
        """Return the picture (h, w, 3) RGB.

        Args:
            size: height and width, or the long side alone [pixels]; a legend comes on top.
            caption: one line below it, or with a legend as many above it as it takes; ASCII.
            legend: say above the picture what is what.
        """
        x0, y0, x1, y1 = box = np.asarray(self.bounds, dtype=np.float64)
        margin = 0.01 * float((box[2:] - box[:2]).max())
        canvas = floor.new_canvas(box + np.array([-margin, -margin, margin, margin]), size)
        fine = canvas.resized(floor.FINE)
        fine.fill([[(x0, y0), (x1, y0), (x1, y1), (x0, y1)]], palette.FREE)
        fine.fill(self.inflated, palette.MAPPED)
        edges = [no_walls(), *(polygon_edges(polygon) for polygon in self.polygons)]
        floor.draw_obstacles(fine, np.concatenate(edges), no_discs())
        self._draw_ways(fine)
        _GOAL[1](fine, np.atleast_2d(self.goal))
        floor.draw_start(fine, self.start)
        floor.draw_scale_bar(fine)
        picture = fine.resized(1 / floor.FINE)
        if legend:
            return with_legend(picture.image, self._entries(), caption)
        floor.write_caption(picture, caption)
        return picture.image

    @property
    def _path_colour(self) -> palette.Colour:
        return palette.TRAIL if self.rollout is None else palette.VERMILION

    def _draw_ways(self, fine: Canvas) -> None:
        """Draw tree, swarm and paths."""
        if self.tree is not None:
            fine.segments(self.tree, palette.TREE, _TREE)
        for _, colour, member in self.swarm:
            fine.line(member, colour, _SWARM)
            if len(np.asarray(member)) == 1:
                fine.dot(np.asarray(member)[0], _POINT, colour)
        if self.raw is not None:
            fine.line(self.raw, palette.TREE, _RAW)
        for outline in self.outlines:
            fine.line(outline, palette.OUTLINE, _OUTLINE, closed=True)
        if self.path is not None:
            fine.line(self.path, self._path_colour, _PATH)
        if self.rollout is not None:
            fine.line(self.rollout, palette.TRAIL, _ROLLOUT)
        if self.optimum is not None:
            fine.dashes(self.optimum, palette.OPTIMUM, _OPTIMUM)

    def _entries(self) -> list[Entry]:
        """Return the legend's entries of what is drawn."""
        dashes: Entry = ("shortest", lambda on, at: on.dashes(at, palette.OPTIMUM, _OPTIMUM))
        entries: list[tuple[object, Entry]] = [
            (True, ("start", lambda on, at: floor.draw_start(on, at.mean(axis=0)))),
            (True, _GOAL),
            (_any(self.path), line("path", self._path_colour, _PATH)),
            (_any(self.rollout), line("roll-out", palette.TRAIL, _ROLLOUT)),
            (len(self.inflated), line("solid", palette.SOLID, 2 * _PATH)),
            (len(self.inflated), line("dilated", palette.MAPPED, 2 * _PATH)),
            (self.optimum is not None, dashes),
            (_any(self.tree), line("tree", palette.TREE, 2 * _TREE)),
            (self.raw is not None, line("path of the tree", palette.TREE, _RAW)),
            *((True, entry) for entry in {of[0]: _member(*of) for of in self.swarm}.values()),
            (len(self.outlines), line("footprint", palette.OUTLINE, 2 * _OUTLINE)),
        ]
        return [entry for drawn, entry in entries if drawn]


def _any(drawn: ArrayLike | None) -> bool:
    return drawn is not None and np.size(drawn) > 0


def _member(words: str, colour: palette.Colour, where: ArrayLike) -> Entry:
    is_point = len(np.asarray(where)) == 1
    return disc(words, colour) if is_point else line(words, colour, 2 * _SWARM)

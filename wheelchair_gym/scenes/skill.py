"""Courses of driving skills, in the manner of tests that therapists use for powered chairs.

One table, `COURSES`, has them all. A seed draws where the chair stands at first, some lengths, and
whether the course is mirrored; widths stay as stated. Lengths lie on the raster, so that gaps are
exact.

Sources: WST, Wheelchair Skills Test 4.2 and 5.x (powered); PIDA, Power-Mobility Indoor Driving
Assessment (Dawson et al. 1994); PCDA, Power-Mobility Community Driving Assessment (Letts et al.
2007); PMCDA, Powered Mobility Clinical Driving Assessment (Kamaraj et al. 2014). They name the
skills, and few dimensions: those are design choices, except the ones of a standard that is named.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wheelchair_gym.actors.records import combine, person
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import InputError, setting, settings, suggest
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import wrap
from wheelchair_gym.scenes.arena import make_arena
from wheelchair_gym.scenes.poses import FOOTPRINT
from wheelchair_gym.scenes.raster import CELL
from wheelchair_gym.types import Arrival, Episode

Pose = tuple[float, float, float]  # m, m, degrees
Rect = tuple[float, float, float, float]  # m: xmin, ymin, xmax, ymax

ANY_SPEED: Final = 2.0  # m/s: no chair drives faster indoors
AT_REST: Final = 0.1  # m/s
PACE: Final = (0.7, 1.2)  # m/s of people
_TRIES = 100


def _arrival(along: float, across: float, degrees: float, speed: float = ANY_SPEED) -> Arrival:
    return Arrival(along, across, math.radians(degrees), speed)


class Course(NamedTuple):
    """A course, as it is without a draw: all lengths [m], headings [degrees].

    Attributes:
        title: what is to be done.
        dimensions: in words.
        source: of the skill and of its dimensions.
        bounds: free ground, enclosed by walls.
        rects: upright obstacles: walls and furniture.
        start: where the axle's middle stands at first, and the heading.
        goal: where the point `at` of the outline is to be, and the heading.
        arrival: how near that counts.
        at: point of the outline, as shares of its front and its half width; (0, 0) is the axle.
        around: most that the start is moved along its heading, across it, and turned.
        stretches: axis (0: x, 1: y), coordinate, and maximum shift of all beyond it.
        walks: way points of people.
    """

    title: str
    dimensions: str
    source: str
    bounds: Rect
    start: Pose
    goal: Pose
    arrival: Arrival
    rects: tuple[Rect, ...] = ()
    at: tuple[float, float] = (0.0, 0.0)
    around: Pose = (0.10, 0.05, 3.0)
    stretches: tuple[tuple[int, float, float], ...] = ()
    walks: tuple[tuple[tuple[float, float], ...], ...] = ()

    @property
    def judged(self) -> str:
        """The goal's tolerance in words."""
        a = self.arrival
        text = f"{a.along:.2f} m along, {a.across:.2f} m across, {math.degrees(a.heading):.0f}°"
        return text if a.speed == ANY_SPEED else f"{text}, below {a.speed:g} m/s"


def _corner(width: float) -> Course:
    return Course(
        "a corner of 90° between two corridors",
        f"both corridors {width:.2f} m wide",
        "WST: turns 90° while moving; PIDA: corners of halls; widths: design choice",
        (0.0, 0.0, 4.5, 4.5), (1.0, 0.5 * width, 0.0), (4.5 - 0.5 * width, 3.2, 90.0),
        _arrival(0.30, 0.20, 15.0), ((0.0, width, 4.5 - width, 4.5),),
        around=(0.10, 0.05, 3.0), stretches=((0, 2.0, 0.25), (1, 2.5, 0.25)),
    )  # fmt: skip


def _door(width: float, oblique: bool) -> Course:
    half = 0.5 * width
    return Course(
        "a doorway, approached at 45°" if oblique else "a doorway, straight on",
        f"clear width {width:.2f} m in a wall of 0.10 m",
        "PIDA: doorways; ADA 404.2.3: 0.815 m; DIN 18040-1: 0.90 m; angle: design choice",
        (0.0, -2.5, 6.0, 2.5), (1.7, -1.35, 45.0) if oblique else (1.0, 0.0, 0.0), (4.7, 0.0, 0.0),
        _arrival(0.30, 0.30, 45.0), ((3.0, -2.5, 3.1, -half), (3.0, half, 3.1, 2.5)),
        around=(0.15, 0.15, 5.0), stretches=((0, 2.5, 0.25),),
    )  # fmt: skip


_DOCKED = _arrival(0.05, 0.10, 5.0, AT_REST)
_FORK: Final = ((3.6, -2.0, 3.7, 0.15), (3.6, 1.05, 3.7, 2.0), (2.9, -1.1, 3.6, -0.1))

COURSES: Final[dict[str, Course]] = {
    "forward": Course(
        "10 m forward", "a corridor of 1.20 m",
        "WST: rolls forward 10 m; width: design choice",
        (0.0, -0.6, 13.0, 0.6), (1.0, 0.0, 0.0), (11.0, 0.0, 0.0), _arrival(0.30, 0.20, 15.0),
        stretches=((0, 6.0, 0.5),),
    ),
    "backward": Course(
        "2 m backward", "a corridor of 1.20 m",
        "WST: rolls backward 2 m; width: design choice",
        (0.0, -0.6, 5.0, 0.6), (3.5, 0.0, 0.0), (1.5, 0.0, 0.0), _arrival(0.20, 0.20, 10.0),
        stretches=((0, 2.5, 0.2),),
    ),
    "corner_120": _corner(1.20), "corner_100": _corner(1.00), "corner_90": _corner(0.90),
    "turn": Course(
        "180° in place", "a room of 2.00 x 2.00 m; the front corners sweep 1.53 m",
        "WST: turns 180° in place; room: design choice",
        (-1.0, -1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 180.0),
        _arrival(0.15, 0.15, 10.0, AT_REST), around=(0.05, 0.05, 5.0),
    ),
    "sideways": Course(
        "0.50 m to the side", "a room of 2.00 x 2.00 m",
        "WST: manoeuvres sideways 0.5 m; room: design choice",
        (-1.0, -1.0, 1.0, 1.0), (-0.2, -0.25, 0.0), (-0.2, 0.25, 0.0),
        _arrival(0.15, 0.15, 10.0, AT_REST), around=(0.05, 0.05, 3.0),
    ),
    **{f"door_{100 * w:.0f}": _door(w, False) for w in (1.00, 0.90, 0.80)},
    **{f"door_{100 * w:.0f}_oblique": _door(w, True) for w in (1.00, 0.90, 0.80)},
    "wall": Course(
        "along a wall, the side 0.15 m from it", "a lane of 1.05 m beside the wall, 4 m long",
        "PIDA: drives along a wall; distances: design choice",
        (0.0, -1.5, 9.0, 1.5), (1.0, -0.3, 0.0), (7.5, -1.35, 0.0), _arrival(0.30, 0.10, 10.0),
        ((2.5, -0.45, 6.5, 1.5),), at=(0.0, -1.0), around=(0.15, 0.20, 5.0),
        stretches=((0, 4.5, 0.5),),
    ),
    "dock": Course(
        "up to a desk, the front 0.05 to 0.15 m from it", "a desk of 1.20 m",
        "WST, PIDA: approaches a table; distances: design choice",
        (0.0, -2.0, 4.5, 2.0), (1.0, 0.0, 0.0), (3.4, 0.0, 0.0), _DOCKED,
        ((3.5, -0.6, 4.3, 0.6),), at=(1.0, 0.0), around=(0.15, 0.30, 5.0),
        stretches=((0, 2.0, 0.25),),
    ),
    "bed": Course(
        "beside a bed, 0.06 to 0.30 m from it", "a bed of 0.90 x 2.00 m in a room of 3 m",
        "PMCDA: parks beside a bed; distances: design choice",
        (0.0, -1.5, 5.5, 1.5), (1.0, 0.8, 0.0), (3.3, -0.42, 0.0),
        _arrival(0.20, 0.12, 8.0, AT_REST), ((2.5, -1.5, 4.5, -0.6),), at=(0.0, -1.0),
        around=(0.15, 0.20, 5.0), stretches=((0, 2.0, 0.25),),
    ),
    "lift": Course(
        "out of a lift backward", "cabin 1.10 x 1.40 m, door 0.90 m",
        "PMCDA: lifts; EN 81-70, type 2: cabin 1.10 x 1.40 m, door 0.90 m",
        (0.0, -1.5, 5.0, 1.5), (0.9, 0.0, 180.0), (3.2, 0.0, 180.0), _arrival(0.30, 0.30, 30.0),
        (
            (0.0, -1.5, 1.4, -0.55), (0.0, 0.55, 1.4, 1.5), (1.4, -1.5, 1.5, -0.45),
            (1.4, 0.45, 1.5, 1.5),
        ), around=(0.03, 0.05, 3.0), stretches=((0, 2.5, 0.25),),
    ),
    "slalom": Course(
        "a slalom", "boards 2 m apart from either side, gaps of 1.15 m",
        "PIDA: manoeuvres round obstacles; dimensions: design choice",
        (0.0, -1.2, 11.0, 1.2), (1.0, 0.0, 0.0), (9.8, 0.0, 0.0), _arrival(0.30, 0.40, 30.0),
        (
            (2.5, -1.2, 2.6, 0.05), (4.5, -0.05, 4.6, 1.2), (6.5, -1.2, 6.6, 0.05),
            (8.5, -0.05, 8.6, 1.2),
        ), stretches=((0, 3.5, 0.2), (0, 5.5, 0.2), (0, 7.5, 0.2)),
    ),
    "people": Course(
        "past people in a corridor", "a corridor of 2.40 m, three people",
        "WST: avoids moving obstacles; PCDA: people; dimensions: design choice",
        (0.0, -1.2, 16.0, 1.2), (1.5, -0.3, 0.0), (13.5, -0.3, 0.0), _arrival(0.40, 0.80, 45.0),
        stretches=((0, 8.0, 0.5),),
        walks=(
            ((14.5, 0.6), (0.8, 0.6)), ((9.0, -0.6), (0.8, -0.6), (15.2, -0.6)),
            ((5.5, 0.1), (15.2, 0.1)),
        ),
    ),
    "fork_door": Course(
        "through the door, a table beside it", "door 0.90 m, table 1.00 m, 1.20 m apart",
        "ambiguous for an assistant: design choice",
        (0.0, -2.0, 6.5, 2.0), (0.9, 0.0, 0.0), (5.2, 0.6, 0.0), _arrival(0.30, 0.30, 45.0), _FORK,
        around=(0.15, 0.15, 5.0), stretches=((0, 2.0, 0.25),),
    ),
    "fork_table": Course(
        "up to the table, a door beside it", "door 0.90 m, table 1.00 m, 1.20 m apart",
        "ambiguous for an assistant: design choice",
        (0.0, -2.0, 6.5, 2.0), (0.9, 0.0, 0.0), (2.8, -0.6, 0.0), _DOCKED, _FORK, at=(1.0, 0.0),
        around=(0.15, 0.15, 5.0), stretches=((0, 2.0, 0.25),),
    ),
}  # fmt: skip


@settings
class Skill:
    """A course of one driving skill: a doorway, a corner, docking at a desk and others."""

    course: str = setting(default="forward")
    """Which course: a name in `wheelchair_gym.scenes.skill.COURSES`."""

    def __post_init__(self) -> None:
        if self.course not in COURSES:
            near = suggest(self.course, COURSES)
            raise InputError(
                f"Skill.course is {self.course!r}; expected one of {', '.join(COURSES)}{near}"
            )

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw lengths, the start, and whether the course is mirrored.

        Raises:
            InputError: a chair of this footprint does not stand free at the start or the goal.
        """
        course = COURSES[self.course]
        moves = [
            (axis, at, CELL * int(rng.integers(-round(maximum / CELL), round(maximum / CELL) + 1)))
            for axis, at, maximum in course.stretches
        ]
        side = float(rng.choice((-1.0, 1.0)))

        def placed(points: ArrayLike) -> Array:
            """Move and mirror points (n, 2), as the draw says."""
            found = np.array(points, dtype=np.float64).reshape(-1, 2)
            by = np.zeros_like(found)
            for axis, at, way in moves:
                by[:, axis] += way * (found[:, axis] > at)
            return (found + by) * (1.0, side)

        def rect(given: Rect) -> Rect:
            (x0, y0), (x1, y1) = placed(given).tolist()
            return x0, min(y0, y1), x1, max(y0, y1)

        arena = make_arena(rect(course.bounds), [rect(each) for each in course.rects])
        goal = np.array([*placed(course.goal[:2])[0], side * math.radians(course.goal[2])])
        c, s = math.cos(goal[2]), math.sin(goal[2])
        ahead, left = course.at[0] * footprint.front, side * course.at[1] * footprint.half_width
        goal[:2] -= c * ahead - s * left, s * ahead + c * left
        for _ in range(_TRIES):
            along, across, turn = rng.uniform(-1.0, 1.0, 3) * course.around
            yaw = side * math.radians(course.start[2])
            c, s = math.cos(yaw), math.sin(yaw)
            place = placed(course.start[:2])[0] + (c * along - s * across, s * along + c * across)
            start = np.array([*place, wrap(yaw + math.radians(turn))])
            if all(arena.is_free(pose, footprint, 0.0) for pose in (start, goal)):
                break
        else:
            raise InputError(f"Skill: {footprint} does not stand free on the course {self.course}")
        people = [person(placed(walk), rng.uniform(*PACE)) for walk in course.walks]
        return Episode(
            arena.map, start, goal, arena.walls, name="skill", arrival=course.arrival,
            actors=combine(people),
        )  # fmt: skip

"""Courses of driving skills, in the manner of tests that therapists use for powered chairs.

The table `skill.yaml` has them all. A seed draws where the chair stands at first, some lengths,
and whether the course is mirrored; widths stay as stated. Lengths lie on the raster, so that gaps
are exact.

Sources: WST, Wheelchair Skills Test 4.2 and 5.x (powered); PIDA, Power-Mobility Indoor Driving
Assessment (Dawson et al. 1994); PCDA, Power-Mobility Community Driving Assessment (Letts et al.
2007); PMCDA, Powered Mobility Clinical Driving Assessment (Kamaraj et al. 2014). They name the
skills, and few dimensions: those are design choices, except the ones of a standard that is named.
"""

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wheelchair_gym.actors.records import combine, person
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import InputError, setting, settings, suggest
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import wrap
from wheelchair_gym.scenes.arena import FOOTPRINT, make_arena, read_table
from wheelchair_gym.scenes.raster import CELL
from wheelchair_gym.types import Arrival, Episode

Pose = tuple[float, float, float]  # m, m, degrees
Rect = tuple[float, float, float, float]  # m: xmin, ymin, xmax, ymax

ANY_SPEED: Final = 2.0  # m/s: no chair drives faster indoors
PACE: Final = (0.7, 1.2)  # m/s of people
_TRIES = 100


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


def _course(arrival: Sequence[float], **values: Any) -> Course:
    """A course of the table; without a speed, an arrival has any."""
    along, across, degrees, speed = (*arrival, ANY_SPEED)[:4]
    return Course(arrival=Arrival(along, across, math.radians(degrees), speed), **values)


COURSES: Final = {name: _course(**values) for name, values in read_table("skill").items()}


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

"""Assistants in Python: the input of a method, and the parts that they share.

What they see of the obstacles, the margin they keep and their freedom are those of the compiled
assistants (`wheelchair_gym.people.assistance`). Among these obstacles they find places where a
person may want to go: doors, things such as desks, and free directions.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.people.assistance.methods import STEP, Shielded, free_share
from wheelchair_gym.people.assistance.state import AssistMission, Freedom, Twist
from wheelchair_gym.people.assistance.step import Assistants
from wheelchair_gym.types import Reading, Stick

__all__ = [
    "AssistInput", "AssistMission", "Assistant", "Freedom", "Method", "SharedAssistant", "Twist",
]  # fmt: skip


@dataclass(frozen=True)
class AssistInput:
    """Input of an assistant's decision.

    Attributes:
        asked: the stick's twist [m/s, rad/s], slowed backward as the freedom says.
        reading: the latest.
        points: obstacles around (n, 2) [m] in the chair's frame, those lately seen among them.
        margin: distance to them that is to be kept [m].
        turn: by how much the turn rate may differ from the stick's now [rad/s].
        map: of the world, if it is known.
    """

    asked: Twist
    reading: Reading
    points: Array
    margin: float
    turn: float
    map: OccupancyGrid | None

    def free_share(self, mission: AssistMission, twist: Twist, time: float) -> float:
        """Share of a time [s] for which the chair could follow a twist."""
        outline = mission.chair.footprint.array
        return float(free_share(self.points, outline, *twist, time, STEP, self.margin))


class Method(Protocol):
    """The decisions of an assistant; `SharedAssistant` does the rest."""

    def reset(self, mission: AssistMission) -> None:
        """Begin an episode."""
        ...

    def twist(self, now: AssistInput) -> Twist:
        """The twist [m/s, rad/s] for a stick that is not centred."""
        ...


class Assistant(Protocol):
    """Turns a person's stick into a twist."""

    def reset(self, mission: AssistMission) -> None:
        """Begin an episode: forget the last one."""
        ...

    def assist(self, stick: Stick, reading: Reading, map: OccupancyGrid | None) -> Array:
        """The twist (2,) [m/s, rad/s] for the next control period.

        Args:
            stick: what the person's interface gives.
            reading: what the chair senses.
            map: of the world; None: it is unknown.
        """
        ...


class SharedAssistant:
    """An assistant of a method: it sees, keeps the freedom, and lets go with the stick.

    Args:
        method: decides.
        freedom: how far it may go.
    """

    def __init__(self, method: Method, freedom: Freedom) -> None:
        self.method, self.freedom = method, freedom

    def reset(self, mission: AssistMission) -> None:
        """See `Assistant.reset`."""
        self._row = Assistants(
            Shielded(), mission.chair, mission.sensors, mission.period, freedom=self.freedom
        )
        self._row.begin()
        self.method.reset(mission)

    def assist(self, stick: Stick, reading: Reading, map: OccupancyGrid | None) -> Array:
        """See `Assistant.assist`."""
        row = self._row
        row.update(stick, reading)
        v, w = row.states["asked"][0].tolist()
        if v == 0.0 and w == 0.0:
            return np.zeros(2)
        points = row.states["points"][0, : row.states["n_points"][0]].copy()
        margin, turn = float(row.states["margin"][0]), float(row.states["turn"][0])
        now = AssistInput((v, w), reading, points, margin, turn, map)
        row.states["twist"][0] = self.method.twist(now)
        return row.twist()


DIRECTIONS = np.radians(np.arange(-90.0, 91.0, 22.5))  # that may be free
DOOR = (0.65, 1.60)  # m: widths of doors
BEYOND = 0.8  # m behind a door where its target lies
BEHIND = 0.3  # m: what is seen through an open door lies so far behind its posts
HALF_WIDTH = 0.4  # m: of the strip in a direction that has to be free
FREE = 1.2  # m: a direction with less room is not free
FARTHEST = 3.0  # m: how far ahead targets of free directions lie
IN_FRONT = 0.10  # m between the chair's front and a thing that it drives up to


@borrowing_kernel
def _targets(points: Array, angles: Array, front: float, out: Array) -> int:
    """Write rows (x, y) of targets among points (n, 2), sorted by angle; how many there are."""
    n, found = points.shape[0], 0
    for direction in DIRECTIONS:
        c, s = math.cos(direction), math.sin(direction)
        room = FARTHEST + front
        for k in range(n):
            along = c * points[k, 0] + s * points[k, 1]
            aside = abs(c * points[k, 1] - s * points[k, 0])
            if along > 0.0 and aside < HALF_WIDTH:
                room = min(room, along)
        room -= front
        if room > FREE or (room > 0.0 and abs(direction) < 1.2):
            away = min(FARTHEST, room) if room > FREE else max(0.0, room - IN_FRONT)
            out[found, 0], out[found, 1] = away * c, away * s
            found += 1
    # Doors: two neighbouring points, a door's width apart, with nothing nearer between them.
    for k in range(n - 1):
        ax, ay = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
        gap = math.hypot(ax, ay)
        if not (DOOR[0] < gap < DOOR[1] and angles[k + 1] - angles[k] < 2.0):
            continue
        x, y = 0.5 * (points[k, 0] + points[k + 1, 0]), 0.5 * (points[k, 1] + points[k + 1, 1])
        nx, ny = ay / gap, -ax / gap
        beyond = BEYOND if nx * x + ny * y >= 0.0 else -BEYOND
        out[found, 0], out[found, 1] = x + beyond * nx, y + beyond * ny
        found += 1
    if found == 0:
        out[0, 0], out[0, 1] = 1.0, 0.0
        found = 1
    return found


def find_targets(points: Array, front: float) -> Array:
    """Return places (k, 2) [m] in the chair's frame that a person may want to go to.

    Args:
        points: obstacles around (n, 2) [m] in the chair's frame.
        front: of the chair, ahead of its axle [m].
    """
    points, angles = _by_angle(points)
    out = np.empty((len(DIRECTIONS) + len(points), 2))
    return out[: _targets(points, angles, front, out)]


def _by_angle(points: Array) -> tuple[Array, Array]:
    angles = np.arctan2(points[:, 1], points[:, 0])
    order = np.argsort(angles, kind="stable")
    return points[order], angles[order]


@borrowing_kernel
def _doors(points: Array, angles: Array, narrowest: float, out: Array) -> int:
    """Write rows (x, y, yaw, gap) of doors among points (n, 2), sorted by angle; how many."""
    n, found = points.shape[0], 0
    for i in range(n):
        row, minimum = -1, DOOR[1]
        for j in range(i + 1, n):
            if angles[j] - angles[i] > 2.0:
                break
            ax, ay = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
            gap = math.hypot(ax, ay)
            if not narrowest < gap < minimum:
                continue
            nx, ny = ay / gap, -ax / gap  # away from the chair, as the points turn to the left
            is_open = nx * points[i, 0] + ny * points[i, 1] > 0.0
            for k in range(i + 1, j):
                deep = nx * (points[k, 0] - points[i, 0]) + ny * (points[k, 1] - points[i, 1])
                is_open = is_open and deep > BEHIND
            if is_open:
                row, minimum = j, gap
        if row >= 0:
            ax, ay = points[row, 0] - points[i, 0], points[row, 1] - points[i, 1]
            out[found, 0] = 0.5 * (points[i, 0] + points[row, 0])
            out[found, 1] = 0.5 * (points[i, 1] + points[row, 1])
            out[found, 2], out[found, 3] = math.atan2(-ax, ay), minimum
            found += 1
    return found


def find_doors(points: Array, half_width: float) -> Array:
    """Return doors (k, 4) in the chair's frame: middle x, y [m], heading through [rad], width [m].

    Two points are its posts if all that is seen between them lies well behind.

    Args:
        points: obstacles around (n, 2) [m] in the chair's frame.
        half_width: of the chair: narrower gaps are no doors [m].
    """
    points, angles = _by_angle(points)
    out = np.empty((len(points), 4))
    return out[: _doors(points, angles, max(DOOR[0], 2.0 * half_width), out)]


def find_front(points: Array, front: float, reach: float) -> tuple[float, float] | None:
    """Return the distance [m] of a flat thing straight ahead, and the heading up to it [rad].

    Args:
        points: obstacles around (n, 2) [m] in the chair's frame.
        front: of the chair, ahead of its axle [m].
        reach: distance of the front within which it counts [m].
    """
    near = points[(np.abs(points[:, 1]) < 0.45) & (points[:, 0] > front)]
    if len(near) < 4 or near[:, 0].min() > front + reach or np.ptp(near[:, 1]) == 0.0:
        return None
    line = np.polynomial.Polynomial.fit(near[:, 1], near[:, 0], 1).convert()
    far, slope = np.append(line.coef, 0.0)[:2]  # NumPy drops a slope of exactly 0
    if np.abs(near[:, 0] - far - slope * near[:, 1]).max() > 0.04 or abs(slope) > 0.7:
        return None
    return float(far), math.atan2(-slope, 1.0)

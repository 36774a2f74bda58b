"""Places where a person may want to go, found in a scan, and a belief over them.

Doors, things to drive up to such as desks, and free directions are found in the obstacles around.
The belief follows Bayes' rule: a person's stick is the likelier, the less it costs on the way to
its goal beside the best twist there is (maximum-entropy inverse control, Javdani 2015; Dragan and
Srinivasa 2013).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from agents.assistance.assistant import AssistInput, AssistMission
from wheelchair_gym.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.config import setting, settings
from wheelchair_gym.geometry import to_frame, to_world
from wheelchair_gym.kinematics import arc_step

SAME = 0.6  # m: a target so near one of before is the same
DIRECTIONS = np.radians(np.arange(-90.0, 91.0, 22.5))  # that may be free
DOOR = (0.65, 1.60)  # m: widths of doors
BEYOND = 0.8  # m behind a door where its target lies
BEHIND = 0.3  # m: what is seen through an open door lies so far behind its posts
HALF_WIDTH = 0.4  # m: of the strip in a direction that has to be free
FREE = 1.2  # m: a direction with less room is not free
FARTHEST = 3.0  # m: how far ahead targets of free directions lie
IN_FRONT = 0.10  # m between the chair's front and a thing that it drives up to
FORGET = 0.2  # 1/s, a choice: the belief returns to an even one, as people change their minds
AHEAD = 0.4  # m before the axle, where distances are measured, so that headings count
_CHOICE = "design choice"


@settings
class Belief:
    """How an assistant finds goals, and how fast it believes in one."""

    rate: float = setting(default=6.0, low=0.0, high=100.0, source=_CHOICE)
    """Evidence for each second of a stick that costs a second more than the best twist."""
    horizon: float = setting(default=1.0, unit="s", low=0.1, high=10.0, source=_CHOICE)
    """Time for which a twist is followed to see what it costs."""


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
    """Places (k, 2) [m] in the chair's frame that somebody may want to go to.

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
        row, least = -1, DOOR[1]
        for j in range(i + 1, n):
            if angles[j] - angles[i] > 2.0:
                break
            ax, ay = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
            gap = math.hypot(ax, ay)
            if not narrowest < gap < least:
                continue
            nx, ny = ay / gap, -ax / gap  # away from the chair, as the points turn to the left
            is_open = nx * points[i, 0] + ny * points[i, 1] > 0.0
            for k in range(i + 1, j):
                deep = nx * (points[k, 0] - points[i, 0]) + ny * (points[k, 1] - points[i, 1])
                is_open = is_open and deep > BEHIND
            if is_open:
                row, least = j, gap
        if row >= 0:
            ax, ay = points[row, 0] - points[i, 0], points[row, 1] - points[i, 1]
            out[found, 0] = 0.5 * (points[i, 0] + points[row, 0])
            out[found, 1] = 0.5 * (points[i, 1] + points[row, 1])
            out[found, 2], out[found, 3] = math.atan2(-ax, ay), least
            found += 1
    return found


def find_doors(points: Array, half_width: float) -> Array:
    """Doors (k, 4) in the chair's frame: the middle x, y [m], the way through [rad], width [m].

    Two points are its posts if all that is seen between them lies well behind.

    Args:
        points: obstacles around (n, 2) [m] in the chair's frame.
        half_width: of the chair: narrower gaps are no doors [m].
    """
    points, angles = _by_angle(points)
    out = np.empty((len(points), 4))
    return out[: _doors(points, angles, max(DOOR[0], 2.0 * half_width), out)]


def find_front(points: Array, front: float, reach: float) -> tuple[float, float] | None:
    """A flat thing straight ahead: where the way ahead meets it [m], and the way up to it [rad].

    Args:
        points: obstacles around (n, 2) [m] in the chair's frame.
        front: of the chair, ahead of its axle [m].
        reach: distance of the front within which it counts [m].
    """
    near = points[(np.abs(points[:, 1]) < 0.45) & (points[:, 0] > front)]
    if len(near) < 4 or near[:, 0].min() > front + reach:
        return None
    slope, far = np.polynomial.Polynomial.fit(near[:, 1], near[:, 0], 1).convert().coef[::-1]
    if np.abs(near[:, 0] - far - slope * near[:, 1]).max() > 0.04 or abs(slope) > 0.7:
        return None
    return float(far), math.atan2(-slope, 1.0)


@borrowing_kernel
def _ends(twists: Array, horizon: float, ahead: float, out: Array) -> None:
    """Where a point ahead of the axle is after twists (n, 2 or more)."""
    for k in range(twists.shape[0]):
        x, y, yaw = arc_step(0.0, 0.0, 0.0, twists[k, 0], twists[k, 1], horizon)
        out[k, 0], out[k, 1] = x + ahead * math.cos(yaw), y + ahead * math.sin(yaw)


def distances(places: Array, others: Array) -> Array:
    """Return the distance (n, k) of each place (n, 2) from each of the others (k, 2)."""
    dx, dy = (places[:, None] - others).transpose(2, 0, 1)
    return np.asarray(np.sqrt(dx * dx + dy * dy))


class Goals:
    """Goals that a person may have, and how far each is believed in: base of assistants' methods.

    Attributes:
        config: settings of the assistant.
        belief: (k,) of each goal; they sum to 1.
    """

    def __init__(self, config: Any) -> None:
        self.config = config

    def reset(self, mission: AssistMission) -> None:
        """Know no goal."""
        self._mission = mission
        self._targets: Array = np.empty((0, 2))
        self.belief: Array = np.empty(0)
        self._pose: Array | None = None

    def update(self, now: AssistInput, twists: Array) -> Array:
        """Update the belief by the stick; the costs (n, k) [s] of twists (n, 2) to each goal."""
        config, mission = self.config.belief, self._mission
        self._take_scan(now)
        asked = np.array([now.asked])
        every = self._costs(np.vstack([asked, np.zeros((1, 2)), twists[:, :2]]))
        over = np.minimum(every[0] - every.min(axis=0), 10.0)
        belief = self.belief * np.exp(-config.rate * mission.period * over)
        share = min(1.0, FORGET * mission.period)
        belief = (1.0 - share) * belief / belief.sum() + share / len(belief)
        self.belief = belief / belief.sum()
        return every[2:]

    def _take_scan(self, now: AssistInput) -> None:
        """Find goals anew; each inherits the belief in the one of before that it is."""
        found = find_targets(now.points, self._mission.chair.footprint.front)
        belief = np.full(len(found), 1.0)
        if len(self._targets) and self._pose is not None:
            before = to_frame(to_world(self._targets, self._pose), now.reading.pose)
            apart = distances(found, before)
            nearest = apart.argmin(axis=1)
            same = apart[np.arange(len(found)), nearest] < SAME
            belief = np.where(same, self.belief[nearest], self.belief.mean())
        self._targets, self.belief = found, belief / belief.sum()
        self._pose = now.reading.pose.copy()

    def _costs(self, twists: Array) -> Array:
        """Seconds (n, k) from where twists (n, 2) lead to each goal."""
        ends = np.empty((len(twists), 2))
        _ends(twists, self.config.belief.horizon, AHEAD, ends)
        return np.asarray(distances(ends, self._targets) / self._mission.limits.forward)

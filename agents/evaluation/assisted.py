"""Measures of an episode with people: one who drives, and those around the chair.

`docs/concepts/assisted_driving.md` defines agreement, intervention, movements and effort of a
person who drives. Twists are compared in full speeds: the speed by the limit forward, the turn rate
by the limit of turn rates.

`docs/concepts/social.md` defines the social measures, after Francis et al. 2023 (arXiv 2306.16740);
a new one is a key of `PeopleTrace.figures` and a name in `metrics.SOCIAL_MEANS`. All are computed
after an episode.
"""

import math
from itertools import product
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from wheelchair_gym.actors.records import PERSON, WALKS_BESIDE
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import kernel
from wheelchair_gym.geometry.kinematics import Limits
from wheelchair_gym.geometry.outline import Footprint, rectangle_point_gap
from wheelchair_gym.geometry.planar import wrap_angle
from wheelchair_gym.types import Episode, Stick, Truth

ACTIVE = 0.05  # full speeds: a smaller twist has no direction, a smaller change is none
CENTRE = 0.10  # deflection within which a stick is centred, for counting movements
DIRECTION = math.radians(30.0)  # a larger change of direction that is held is another movement
HELD = 0.1  # s
COASTING = 1.5  # s after the stick was let go in which the chair may still come to rest


def angles_between(twists: Array, others: Array) -> Array:
    """Return the angles (n,) [rad] between twists (n, 2), both in full speeds."""
    return np.abs(wrap_angle(np.arctan2(*others.T[::-1]) - np.arctan2(*twists.T[::-1])))


class StickTrace:
    """Deflections of the stick and twists after assistant and shield: one entry a step."""

    def __init__(self, limits: Limits, period: float) -> None:
        self._limits, self._period = limits, period
        self._full = np.array([limits.forward, limits.turn])
        self._sticks: list[Stick] = []
        self._given: list[Array] = []

    def add(self, stick: Stick, given: Array) -> None:
        """Add a step: the stick before it, and the twist (2,) after assistant and shield."""
        self._sticks.append(stick)
        self._given.append(given)

    def figures(self, twists: Array, length: float) -> dict[str, float]:
        """The measures; the chair's true twists (n + 1, 2) and the driven length [m] are known.

        What does not exist is infinite.
        """
        if not self._sticks:
            return {}
        sticks = np.array([stick[:2] for stick in self._sticks])
        asked = np.array([self._limits.twist_of(*stick[:2]) for stick in self._sticks]) / self._full
        given = np.array(self._given) / self._full
        size, off = np.hypot(*asked.T), np.hypot(*(given - asked).T)
        active = size > ACTIVE
        both = active & (np.hypot(*given.T) > ACTIVE)
        angles = angles_between(asked, given)
        driven = float(size.sum() + off.sum())
        travel = float(np.hypot(*np.diff(sticks, axis=0, prepend=np.zeros((1, 2))).T).sum())
        minutes = len(sticks) * self._period / 60.0
        return {
            "agreement_angle": float(angles[both].mean()) if both.any() else math.inf,
            "intervention_share": float((off > ACTIVE).mean()),
            "intervention_size": float(off[active].mean()) if active.any() else math.inf,
            "authority": float(off.sum()) / driven if driven > 0.0 else math.inf,
            "unwanted_motion": self._unwanted(np.asarray(twists)[1:] / self._full, size),
            "stick_movements": self._movements(sticks) / minutes,
            "stick_effort": float(np.hypot(*sticks.T).sum()) * self._period / max(length, 0.1),
            "stick_travel": travel / max(length, 0.1),
        }

    def _unwanted(self, twists: Array, size: Array) -> float:
        """Time [s] in motion while the stick is centred, not latched, and was let go before."""
        since, found = math.inf, 0.0
        for twist, deflection, stick in zip(twists, size, self._sticks, strict=False):
            since = 0.0 if deflection > 0.0 or stick.latched else since + self._period
            if COASTING < since < math.inf and math.hypot(*twist) > ACTIVE:
                found += self._period
        return found

    def _movements(self, sticks: Array) -> int:
        """Number of times that the stick left the centre, or changed its direction for good."""
        count, direction, held = 0, math.nan, 0.0
        for forward, left in sticks.tolist():
            if math.hypot(forward, left) <= CENTRE:
                direction, held = math.nan, 0.0
                continue
            now = math.atan2(left, forward)
            if math.isnan(direction):
                count, direction, held = count + 1, now, 0.0
            elif abs(math.remainder(now - direction, 2 * math.pi)) > DIRECTION:
                held += self._period
                if held >= HELD - 1e-9:
                    count, direction, held = count + 1, now, 0.0
            else:
                held = 0.0
        return count


MEASURES: Any = (
    "agreement_angle", "intervention_share", "intervention_size", "authority", "unwanted_motion",
    "stick_movements", "stick_effort", "stick_travel",
)  # fmt: skip


PERSONAL = 1.2  # m: nearer is somebody's personal space (Hall 1966)
INTIMATE = 0.45  # m: nearer is somebody's intimate space (Hall 1966)


class PeopleTrace:
    """Positions of people in one episode: one entry for reset and each step.

    A person who walks beside the chair is left out.
    """

    def __init__(self, world: Episode, footprint: Footprint) -> None:
        """Begin the trace of an episode that has people, with a chair of this footprint."""
        rows = world.actors.rows
        stays_away = rows["behaviour"] != WALKS_BESIDE
        self._which = np.flatnonzero((rows["kind"] == PERSON) & stays_away)
        self._people = rows[self._which]
        self._walls = shapely.multilinestrings(shapely.linestrings(world.walls.reshape(-1, 2, 2)))
        self._footprint = footprint
        self._places: list[Array] = []

    def add(self, truth: Truth) -> None:
        """Add the people's places; a real chair does not know them."""
        if len(truth.actor_poses):
            self._places.append(truth.actor_poses[self._which, :2])

    def figures(self, poses: Array, twists: Array, period: float) -> dict[str, float]:
        """Distance, shares of time, time to collision and delay; empty of a real chair.

        The chair's poses (n, 3) and twists (n, 2) are those at the same instants, one a `period`
        [s]. What does not exist is infinite.
        """
        if not self._places:
            return {}
        places = np.array(self._places)  # (n, people, 2)
        c, s = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])

        def in_frame(vectors: Array) -> Array:
            x, y = vectors[..., 0], vectors[..., 1]
            return np.stack([c * x + s * y, c * y - s * x], axis=-1)

        offsets = in_frame(places - poses[:, None, :2])
        radii = self._people["size"][:, 0].copy()
        gaps = _gaps(offsets, radii, self._footprint.array)
        met = ~self._behind_walls(poses, places)
        nearest = np.where(met, gaps, np.inf).min(axis=1, initial=np.inf)

        steps = np.diff(places, axis=0)  # (n - 1, people, 2)
        velocities = np.concatenate([np.zeros_like(places[:1]), steps / period])
        relative = in_frame(velocities) - twists[:, None, :1] * (1.0, 0.0)
        times = time_to_collision(offsets, relative, radii, self._footprint)

        seconds = period * len(steps)
        walked = np.hypot(steps[..., 0], steps[..., 1]).sum(axis=0)
        people = self._people
        walks = (people["points"] > 1) & (people["speed"] > 0.0) & (people["leader"] == 0)
        lost = seconds - walked[walks] / people["speed"][walks]
        return {
            "person_distance_min": float(nearest.min()),
            "personal_share": float(np.mean((nearest >= INTIMATE) & (nearest < PERSONAL))),
            "intimate_share": float(np.mean(nearest < INTIMATE)),
            "ttc_min": float(np.where(met, times, np.inf).min(initial=np.inf)),
            "people_delay": float(60.0 * np.maximum(lost, 0.0).sum() / seconds) if seconds else 0.0,
        }

    def _behind_walls(self, poses: Array, places: Array) -> NDArray[np.bool_]:
        """Return whether a wall is between the chair's axle and a person, at each instant."""
        ends = np.stack([np.broadcast_to(poses[:, None, :2], places.shape), places], axis=-2)
        shapely.prepare(self._walls)
        behind: NDArray[np.bool_] = shapely.intersects(self._walls, shapely.linestrings(ends))
        return behind


@kernel
def _gaps(offsets: Array, radii: Array, outline: Array) -> Array:
    """Return gaps (n, k) [m] of the outline to discs at offsets (n, k, 2) in the chair's frame."""
    gaps = np.empty(offsets.shape[:2])
    for i in range(offsets.shape[0]):
        for j in range(offsets.shape[1]):
            gap = rectangle_point_gap(offsets[i, j, 0], offsets[i, j, 1], outline)
            gaps[i, j] = max(0.0, gap - radii[j])
    return gaps


def time_to_collision(offsets: Array, velocities: Array, radii: Any, footprint: Footprint) -> Array:
    """Return times [s] after which discs touch a footprint at constant velocities; or infinity.

    Offsets (..., 2) and relative velocities (..., 2) are in the chair's frame. A disc touches when
    its centre enters the outline grown by its radius, which two boxes and four discs cover.
    """
    front, rear, half = footprint.front, footprint.rear, footprint.half_width
    r = np.broadcast_to(radii, offsets.shape[:-1])
    zero = np.zeros_like(r)
    first = np.full(r.shape, np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for along, across in ((r, zero), (zero, r)):
            low = np.stack([-rear - along, -half - across], axis=-1)
            high = np.stack([front + along, half + across], axis=-1)
            to_low, to_high = (low - offsets) / velocities, (high - offsets) / velocities
            begin = np.fmin(to_low, to_high).max(axis=-1)
            end = np.fmax(to_low, to_high).min(axis=-1)
            hits = (begin <= end) & (end >= 0.0)
            first = np.where(hits, np.minimum(first, np.maximum(begin, 0.0)), first)
        square = (velocities**2).sum(axis=-1)
        for corner in product((front, -rear), (half, -half)):
            away = offsets - corner
            closing = -(away * velocities).sum(axis=-1)
            outside = (away**2).sum(axis=-1) - r**2
            root = closing**2 - square * outside
            begin = np.where(outside <= 0.0, 0.0, (closing - np.sqrt(root)) / square)
            hits = (outside <= 0.0) | ((closing > 0.0) & (root >= 0.0))
            first = np.where(hits, np.minimum(first, begin), first)
    return first

"""The shield: what may really be driven of what a policy asks for.

    reading ──▶ watch: silent, frozen? ──▶ remember: points, cells, echoes ──▶ sweep ──▶ twist

It is between any policy and any chair, and knows Readings alone. It scales a twist and keeps its
curvature: the fastest share of it that, driven for a period and braked at the chair's own limits,
keeps clear of all that was seen in the last seconds, and enters nowhere that nobody has seen
faster than a walking stick; and that, ended by a protective stop, keeps clear of wherever those
who move may be by then. While nothing better is known it brakes along a way that was found clear
before. (After nav2's collision monitor: stop zone, slow zone, approach; silent sensors are
obstacles.)
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.address import address_of, rows_of
from wheelchair_gym.kernel import borrowing_kernel
from wheelchair_gym.kinematics import arc_step
from wheelchair_gym.safety.decide import decide, slow_for_unseen
from wheelchair_gym.safety.echoes import hear
from wheelchair_gym.safety.faults import watch
from wheelchair_gym.safety.memory import follow, look_round, remember
from wheelchair_gym.safety.settings import ShieldSettings
from wheelchair_gym.safety.state import (
    BINS,
    CLOSE,
    FAR,
    GUARD,
    NOTHING,
    REACH,
    REASONS,
    SHIELD,
    Guard,
)
from wheelchair_gym.safety.sweep import signed_gap
from wheelchair_gym.sensing.settings import RANGERS, SensorSettings
from wheelchair_gym.simulation.settings import ChairSettings
from wheelchair_gym.types import Reading

Array = NDArray[np.float64]
Floats = NDArray[np.float32]


_guards_at, _shields_at = rows_of(GUARD), rows_of(SHIELD)
# Where both records lie: a call takes a microsecond per array.
ALONE = np.dtype([("guard", "u8"), ("shield", "u8")])


@borrowing_kernel
def forget(s: Any) -> None:
    """Begin anew: nothing was seen, the chair stands."""
    s.begun, s.rearmed = False, False
    s.stamp, s.latched, s.reason = 0.0, 0, NOTHING
    s.laser_hash, s.sonar_hash = np.uint64(0), np.uint64(0)
    s.laser_silent, s.laser_frozen, s.sonar_frozen = 0.0, 0.0, 0.0
    s.odometry_silent, s.odometry_frozen, s.astray = 0.0, 0.0, 0.0
    for k in range(3):
        s.pose[k] = 0.0
    for k in range(5):
        s.told[k] = 0.0
    for k in range(4):
        s.set[k] = 0.0
    for k in range(s.sonar_silent.shape[0]):
        s.sonar_silent[k], s.fired[k] = 0.0, -math.inf
        s.doubtful[k], s.n_arc[k] = math.nan, 0
    s.corner[0], s.corner[1] = 1 << 40, 1 << 40  # far off: the whole grid comes in anew
    s.n_points, s.n_old, s.n_marks, s.n_near, s.n_moving, s.n_close = 0, 0, 0, 0, 0, 0
    s.gap, s.columns, s.hidden = FAR, 0, 0.0
    for k in range(2):
        s.asked[k], s.given[k] = 0.0, 0.0
    s.protective = False


@borrowing_kernel
def _near(s: Any, outline: Array, margin: float, px: float, py: float, n: int) -> int:
    """Note a point in the chair's frame among those inside the margin, or those near."""
    far = math.sqrt(px * px + py * py)
    if far >= REACH:
        return n
    gap = signed_gap(px, py, outline)
    s.gap = min(s.gap, max(0.0, gap))
    if gap < margin and s.n_close < CLOSE:
        s.close[s.n_close, 0], s.close[s.n_close, 1], s.close[s.n_close, 2] = px, py, gap
        s.n_close += 1
        return n
    s.local[n, 0], s.local[n, 1], s.local[n, 2] = px, py, far
    s.bins[int(far * BINS / REACH) + 1] += 1
    return n + 1


@borrowing_kernel
def gather(g: Any, s: Any) -> None:
    """Bring points and echoes into the chair's frame, in the order of bins of distance."""
    for b in range(BINS + 1):
        s.bins[b] = 0
    s.gap, s.n_close, n = FAR, 0, 0
    outline, margin = g.outline[:], g.margin
    c, sn = math.cos(s.pose[2]), math.sin(s.pose[2])
    x, y = s.pose[0], s.pose[1]
    for k in range(s.n_points):
        dx, dy = s.points[k, 0] - x, s.points[k, 1] - y
        n = _near(s, outline, margin, c * dx + sn * dy, c * dy - sn * dx, n)
    for k in range(s.n_arc.shape[0]):
        for i in range(s.n_arc[k]):
            dx, dy = s.arc[k, i, 0] - x, s.arc[k, i, 1] - y
            n = _near(s, outline, margin, c * dx + sn * dy, c * dy - sn * dx, n)
    for b in range(BINS):
        s.bins[b + 1] += s.bins[b]
    s.n_near = n
    for k in range(n):
        b = int(s.local[k, 2] * BINS / REACH)
        at = s.bins[b]
        s.bins[b] = at + 1
        s.near[at, 0], s.near[at, 1] = s.local[k, 0], s.local[k, 1]
        s.near[at, 2] = b * REACH / BINS
    s.hidden = 0.0
    for k in range(s.n_marks):
        dx, dy = s.marks[k, 0] - x, s.marks[k, 1] - y
        s.moving[k, 0], s.moving[k, 1] = c * dx + sn * dy, c * dy - sn * dx
        s.moving[k, 2], s.moving[k, 3] = 0.0, s.stamp - s.marks[k, 2]
        s.moving[k, 4] = s.stamp - s.marks[k, 3]
        s.hidden = max(s.hidden, s.moving[k, 4])
    s.n_moving = s.n_marks


@borrowing_kernel
def look(
    g: Any, s: Any, pose: Array, twist: Array, laser: Floats, ultrasonic: Floats, age: Floats,
    bumped: bool, halted: bool, stamp: float,
) -> None:  # fmt: skip
    """Take in a reading; the same one again only counts as time without any.

    Args:
        g: record of GUARD.
        s: record of SHIELD.
        pose: of the reading (3,); only whether it changes matters.
        twist: (2,) [m/s, rad/s].
        laser: (beams,) [m].
        ultrasonic: (rangers,) [m].
        age: (rangers,) [s].
        bumped: a bumper strip is pressed.
        halted: the chair stands whatever it is told.
        stamp: [s].
    """
    dt = stamp - s.stamp if s.begun else 0.0
    if s.begun and dt <= 0.0:
        dt = g.period
        stamp = s.stamp
    # What the wheels say is believed; where they say nothing, what they were told.
    v, w = twist[0], twist[1]
    if not math.isfinite(v + w):
        v, w = s.set[0], s.set[2]
    if s.begun and stamp > s.stamp:
        x, y, yaw = arc_step(s.pose[0], s.pose[1], s.pose[2], v, w, dt)
        s.pose[0], s.pose[1], s.pose[2] = x, y, yaw
    s.stamp = stamp
    fresh = watch(g, s, pose, twist, laser, ultrasonic, age, bumped, halted, dt)
    if halted:
        s.set[0], s.set[1], s.set[2], s.set[3] = v, 0.0, w, 0.0
    follow(s)
    if fresh:
        remember(g, s, laser, dt)
        look_round(g, s, laser)
        if not s.begun:  # the other half of the columns, too
            look_round(g, s, laser)
    hear(g, s, ultrasonic, age)
    gather(g, s)
    s.begun = True


@borrowing_kernel
def look_alone(
    alone: Any, pose: Array, twist: Array, laser: Floats, ultrasonic: Floats, age: Floats,
    bumped: bool, halted: bool, stamp: float,
) -> None:  # fmt: skip
    """`look` of a shield that is alone: alone (1,) of ALONE."""
    own = alone[0]
    g, s = _guards_at(own.guard, 1)[0], _shields_at(own.shield, 1)[0]
    look(g, s, pose, twist, laser, ultrasonic, age, bumped, halted, stamp)


@borrowing_kernel
def decide_alone(alone: Any, v: float, w: float) -> tuple[float, float, bool]:
    """`decide` of a shield that is alone: alone (1,) of ALONE."""
    own = alone[0]
    return decide(_guards_at(own.guard, 1)[0], _shields_at(own.shield, 1)[0], v, w)


@borrowing_kernel
def slow_alone(alone: Any, motion: Array, twists: Array) -> None:
    """`slow_for_unseen` of a shield that is alone."""
    own = alone[0]
    g, s = _guards_at(own.guard, 1)[0], _shields_at(own.shield, 1)[0]
    slow_for_unseen(g, s, motion, twists)


class Decision(NamedTuple):
    """What became of a twist."""

    reason: str  # one of REASONS; empty: nothing was changed
    asked: Array  # (2,) m/s, rad/s
    given: Array  # (2,) m/s, rad/s
    protective: bool  # the chair is to make a protective stop


class Shield:
    """Between a policy and a chair; state of one run.

    Args:
        own: settings.
        chair: outline and limits.
        sensors: where they sit.
        period: of control [s].
    """

    def __init__(
        self,
        own: ShieldSettings | None = None,
        chair: ChairSettings | None = None,
        sensors: SensorSettings | None = None,
        period: float = 0.1,
    ) -> None:
        self.settings = own or ShieldSettings()
        self._guard = Guard(
            self.settings, chair or ChairSettings(), sensors or SensorSettings(), period
        )
        self.state: NDArray[np.void] = np.zeros(1, SHIELD)
        self._beams = ((sensors or SensorSettings()).laser.beams,)
        self._alone = np.zeros(1, ALONE)
        self._alone["guard"] = address_of(self._guard.record)
        self._alone["shield"] = address_of(self.state)
        self._warm()
        self.reset()

    def _warm(self) -> None:
        """Compile all that a decision needs now, and not while a chair drives."""
        beams = int(self._guard.record["beams"][0])
        dark, deaf = np.full(beams, np.nan, np.float32), np.full(RANGERS, np.nan, np.float32)
        blank = Reading(np.zeros(3), np.zeros(2), dark, deaf, deaf, False, math.nan, 0.0)
        self.filter(np.zeros(2), blank)

    def reset(self) -> None:
        """Begin anew: nothing was seen, the chair stands, nothing is latched."""
        forget_alone(self._alone)

    def filter(self, twist: Array, reading: Reading) -> Array:
        """What may be driven (2,) [m/s, rad/s] of a twist (2,) until the next reading.

        Args:
            twist: what a policy asks for.
            reading: the latest; its stamps are the shield's only clock.
        """
        self.look(reading)
        v, w, _ = decide_alone(self._alone, float(twist[0]), float(twist[1]))
        return np.array([v, w])

    def look(self, reading: Reading) -> None:
        """Take in a reading.

        Raises:
            ValueError: its laser is not the one in the settings.
        """
        if reading.laser.shape != self._beams:
            raise ValueError(f"the reading has {reading.laser.shape} beams; expected {self._beams}")
        look_alone(
            self._alone, reading.pose, reading.twist, reading.laser, reading.ultrasonic,
            reading.age, bool(reading.bumped), reading.halted != "", reading.stamp,
        )  # fmt: skip

    def unhurried(self, twists: Array, motion: Array) -> Array:
        """Twists (n, 2) [m/s, rad/s], slowed to what may begin and last where nobody has seen.

        For who plans: nothing is decided, and no other rule is applied.

        Args:
            twists: that might be driven from now on.
            motion: speed, its slope, turn, its slope (4,) of the chair now.
        """
        slowed = np.array(twists, np.float64)
        slow_alone(self._alone, motion, slowed)
        return slowed

    def rearm(self) -> None:
        """A person has seen to a fault: drives on once the chair stands and is told to stand."""
        self.state["rearmed"] = True

    @property
    def latched(self) -> str:
        """The fault that it stands for until `rearm`; empty: none."""
        return REASONS[int(self.state["latched"][0])]

    @property
    def decision(self) -> Decision:
        """What became of the last twist."""
        s: Any = self.state[0]
        why = REASONS[int(s["reason"])]
        return Decision(why, s["asked"].copy(), s["given"].copy(), bool(s["protective"]))


@borrowing_kernel
def forget_alone(alone: Any) -> None:
    """`forget` of a shield that is alone: alone (1,) of ALONE."""
    forget(_shields_at(alone[0].shield, 1)[0])

"""ASSISTANT, the record of a compiled assistant: its freedom, and the obstacles that it remembers.

An assistant slows a chair or turns it, and no more: the speed lies between rest and that of the
stick, and the turn rate lies between rest and the stick's, or beyond either by at most a freedom
that shrinks with the stick's deflection. So a centred stick asks for rest, at once, whatever the
assistant. A stick that is pulled back asks for a slow speed at most, whatever its deflection.
"""

import math
from dataclasses import dataclass
from typing import Any

from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.address import on_stack, read_record, rows_of, table_at
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry.kinematics import Limits, arc_step
from wheelchair_gym.geometry.planar import world_to_body
from wheelchair_gym.sensors.laser import nearest_beam, shown_range
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings

Twist = tuple[float, float]

STEADY = 0.1  # maximum change of deflection of a steady stick
DOCKING_MARGIN = 0.01  # m, kept once the stick has been low and steady, to reach a desk: assumed
# Largest deflection forward of a low stick, and s for which it must be low and steady: assumed.
_DOCKING_STICK, _DOCKING_TIME = 0.35, 1.0


@settings
class Freedom:
    """An assistant's freedom, and its distance from obstacles."""

    turn: float = setting(default=0.5, unit="rad/s", low=0.0, high=4.0)
    """Largest turn rate beyond rest's and the stick's, at full deflection."""
    backward: float = setting(
        default=0.045, unit="m/s", low=0.0, high=2.0,
        source="nothing looks back, and a contact below 0.05 m/s does no harm: docs, decisions",
    )  # fmt: skip
    """Largest speed backward that a stick asks for. The shield alone lets people back into what
    nothing has seen at 0.1 m/s; with a scanner that looks back, set the chair's limit."""
    margin: float = setting(
        default=0.03, unit="m", low=0.0, high=1.0, source="more shuts doors of 0.80 m: derived"
    )
    """Distance to obstacles that it keeps."""


@settings
class Sharing:
    """Settings of an assistant that shares control with a person."""

    freedom: Freedom = Freedom()


@dataclass(frozen=True)
class AssistMission:
    """Information for an assistant before a person drives: the chair, and nothing of the person."""

    chair: ChairSettings
    sensors: SensorSettings
    period: float  # s, of control

    @property
    def limits(self) -> Limits:
        """The chair's limits of speed and acceleration."""
        return self.chair.limits


@borrowing_kernel
def margin_of(p: Any, a: Any, forward: float, left: float) -> float:
    """The margin [m] that a row keeps, which a low and steady stick lowers.

    A person who drives up to a thing turns to it, too: only the deflection forward counts.
    """
    f, moved = p.freedom, abs(forward - a.held[0]) > STEADY
    if moved:
        a.held[0], a.held[1] = forward, left
    low = 0.0 < forward <= _DOCKING_STICK
    a.steady = a.steady + p.period if low and not moved else 0.0
    docks = a.steady >= _DOCKING_TIME
    return float(min(f.margin, DOCKING_MARGIN) if docks else f.margin)


@borrowing_kernel
def within_freedom(twist: Twist, asked: Twist, turn: float, maximum: float) -> Twist:
    """A method's twist, clipped to what may be made of the stick's, `asked` [m/s, rad/s].

    The turn rate may lie by `turn` beyond those between rest and the stick's, up to the chair's
    limit, `maximum`. A stick at rest gives rest.
    """
    (v, w), (to_v, to_w) = twist, asked
    if to_v == 0.0 and to_w == 0.0:
        return 0.0, 0.0
    v = min(max(v, min(0.0, to_v)), max(0.0, to_v))
    w = min(max(w, min(0.0, to_w) - turn), max(0.0, to_w) + turn)
    return v, min(maximum, max(-maximum, w))


GROUPS = 128  # of beams of the first scanner: of each, the nearest is an obstacle
MORE_GROUPS = 64  # of beams of all further scanners
SECTORS = 64  # around the outline's middle: of each, the nearest out of sight is remembered
MAXIMUM = GROUPS + MORE_GROUPS + SECTORS  # obstacles

SCANNER = read_record("SCANNER", globals())[0]
scanners_at = rows_of(SCANNER)

ASSISTANT = read_record("ASSISTANT", globals())[0]


REACH = 4.0  # m from the outline's middle: farther is of no concern
MEMORY = 10.0  # s for which what nothing looks at any more is remembered


@borrowing_kernel
def _sector(x: float, y: float) -> int:
    """The sector of a direction: sectors follow each other around, and need not be equal."""
    size = abs(x) + abs(y)
    share = y / size if size > 0.0 else 0.0
    around = share if x >= 0.0 else (2.0 - share if y >= 0.0 else -2.0 - share)  # in [-2, 2]
    return min(SECTORS - 1, int((around + 2.0) * 0.25 * SECTORS))


@borrowing_kernel
def _is_shown(p: Any, x: float, y: float) -> bool:
    """Whether a scanner shows what is at a place [m] in the chair's frame."""
    for one in scanners_at(p.scanners, p.n_scanners):
        mount = one.mount
        sx, sy = world_to_body(mount[2], mount[3], x - mount[0], y - mount[1])
        if sx >= one.view_cosine * math.sqrt(sx * sx + sy * sy):
            return True
    return False


@borrowing_kernel
def _carry(p: Any, a: Any, twist: Array, stamp: float, kept: Array) -> None:
    """Carry obstacles along that no scanner can see from where the chair is now.

    Rows of kept (SECTORS, 4): x, y [m], stamp until which it is kept [s], squared distance [m2].
    """
    since = stamp - a.stamp
    x, y, yaw = arc_step(0.0, 0.0, 0.0, twist[0], twist[1], since)
    c, s = math.cos(yaw), math.sin(yaw)
    for k in range(a.n_points):
        px, py = world_to_body(c, s, a.points[k, 0] - x, a.points[k, 1] - y)
        if _is_shown(p, px, py):
            continue  # the scan shows what is there
        until = a.until[k - a.n_seen] if k >= a.n_seen else a.stamp + MEMORY
        if stamp >= until:
            continue
        dx = px - p.middle
        far = dx * dx + py * py
        i = _sector(dx, py)
        if far < min(kept[i, 3], REACH * REACH):
            kept[i, 0], kept[i, 1], kept[i, 2], kept[i, 3] = px, py, until, far


@borrowing_kernel
def look(p: Any, a: Any, scan: Floats, twist: Array, stamp: float) -> None:
    """Take a scan, and carry along what it cannot show; twist: by odometry."""
    kept = table_at(on_stack(8 * 4 * SECTORS), SECTORS, 4)
    for i in range(SECTORS):
        kept[i, 3] = math.inf
    if not math.isnan(a.stamp):
        _carry(p, a, twist, stamp, kept)
    a.stamp = stamp
    n = 0
    for one in scanners_at(p.scanners, p.n_scanners):
        directions = table_at(p.directions, one.first + one.beams, 2)
        for group in range(one.groups):
            low = one.first + group * one.beams // one.groups
            high = one.first + (group + 1) * one.beams // one.groups
            best = nearest_beam(scan, low, high)
            r = shown_range(scan[best])
            if r >= 2.0 * REACH:
                continue
            x = one.mount[0] + r * directions[best, 0]
            y = one.mount[1] + r * directions[best, 1]
            dx = x - p.middle
            if dx * dx + y * y < REACH * REACH:
                a.points[n, 0], a.points[n, 1] = x, y
                n += 1
    a.n_seen = n
    for i in range(SECTORS):
        if kept[i, 3] < math.inf:
            a.points[n, 0], a.points[n, 1] = kept[i, 0], kept[i, 1]
            a.until[n - a.n_seen] = kept[i, 2]
            n += 1
    a.n_points = n

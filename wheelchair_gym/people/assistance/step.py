"""One control period of a compiled assistant; the same functions for one chair and for many.

A method is a function (p, a) -> twist of the constants p, a record of CONSTANTS, and of a row a, a
record of ASSISTANT: its obstacles, the stick's twist, the margin to keep and the freedom to turn.
"""

import math
from typing import Any, Final

import numpy as np

from wheelchair_gym.base.arrays import Array, Floats, Rows
from wheelchair_gym.base.settings import copy_numbers, numbers_of
from wheelchair_gym.compiled.address import Pointers, prefetch, read_record, rows_of
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.geometry.kinematics import action_of_twist, twist_of_action
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.people.assistance.methods import (
    TIME,
    Direct,
    SharedDwa,
    Shielded,
    Slide,
    Teleop,
    Vfh,
    shared_dwa,
    slide,
    slowed,
    vfh,
)
from wheelchair_gym.people.assistance.state import (
    ASSISTANT,
    GROUPS,
    MORE_GROUPS,
    SCANNER,
    AssistMission,
    Freedom,
    Twist,
    look,
    margin_of,
    within_freedom,
)
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings
from wheelchair_gym.types import Reading, Stick

STICK, TELEOP, VFH, SLIDE, SHARED_DWA = range(5)  # kinds of methods
KINDS: Final = {
    Direct: STICK, Shielded: STICK, Teleop: TELEOP, Vfh: VFH, Slide: SLIDE, SharedDwa: SHARED_DWA,
}  # fmt: skip
METHOD, FREEDOM = numbers_of(*KINDS), numbers_of(Freedom)
CONSTANTS, _TARGETS = read_record("CONSTANTS", globals())
ASSISTANTS, ASSISTANTS_TARGETS = read_record("ASSISTANTS", globals())
_constants_at, _assistants_at, _SIZE = rows_of(CONSTANTS), rows_of(ASSISTANT), ASSISTANT.itemsize


@inlined
def _assistant_row(assistants: Any, i: int) -> Any:
    """The records of row i: constants and state; assistants: (1,) of ASSISTANTS."""
    rows = assistants[0]
    return _constants_at(rows.constants, 1)[0], _assistants_at(rows.assistants, rows.n)[i]


@borrowing_kernel
def begin_assistant(i: int, assistants: Any) -> None:
    """Reset row i for a new episode; assistants: (1,) of ASSISTANTS."""
    _, a = _assistant_row(assistants, i)
    a.stamp, a.steady, a.n_points, a.n_seen = math.nan, 0.0, 0, 0
    for k in range(2):
        a.held[k] = a.asked[k] = a.twist[k] = 0.0


@borrowing_kernel
def prefetch_assistant(i: int, assistants: Any) -> None:
    """Prefetch the state of row i while something else is computed."""
    rows = assistants[0]
    if rows.n > 0:
        prefetch(rows.assistants + np.uint64(i * _SIZE), _SIZE)


@borrowing_kernel
def pass_stick_on(
    i: int, assistants: Any, forward: float, left: float, scan: Floats, twist: Array, stamp: float
) -> None:
    """Take in a scan in row i, and set the stick's twist, backward at most as the freedom allows.

    The scan has the first scanner's ranges [m] first; the twist (2,) is by odometry [m/s, rad/s].
    """
    p, a = _assistant_row(assistants, i)
    look(p, a, scan, twist, stamp)
    a.margin = margin_of(p, a, forward, left)
    v, w = twist_of_action(forward, left, p.forward, p.backward, p.turn)
    v = max(v, -p.freedom.backward)
    a.asked[0], a.asked[1] = v, w
    a.turn = p.freedom.turn * min(1.0, math.hypot(forward, left))
    a.twist[0], a.twist[1] = v, w


@borrowing_kernel
def update_assistant(
    i: int, assistants: Any, forward: float, left: float, scan: Floats, twist: Array, stamp: float
) -> None:
    """Take in a scan in row i, and decide on a stick; arguments as for `pass_stick_on`."""
    pass_stick_on(i, assistants, forward, left, scan, twist, stamp)
    p, a = _assistant_row(assistants, i)
    v, w = a.asked[0], a.asked[1]
    if p.kind != STICK and (v != 0.0 or w != 0.0):
        if p.kind == SLIDE:
            v, w = slide(p, a)
        elif p.kind == TELEOP:
            v, w = slowed(p, a, v, w, TIME)
        elif p.kind == VFH:
            v, w = vfh(p, a)
        else:
            v, w = shared_dwa(p, a)
    a.twist[0], a.twist[1] = v, w


@borrowing_kernel
def assisted_twist(i: int, assistants: Any, more_v: float, more_w: float) -> Twist:
    """Row i's twist [m/s, rad/s] with more added to what its method gives, within its freedom."""
    p, a = _assistant_row(assistants, i)
    given, asked = (a.twist[0] + more_v, a.twist[1] + more_w), (a.asked[0], a.asked[1])
    return within_freedom(given, asked, a.turn, p.turn)


@borrowing_kernel
def assisted_action(i: int, assistants: Any, residual_v: float, residual_w: float) -> Twist:
    """The action that asks for row i's twist, with a residual action's twist added to it."""
    p = _constants_at(assistants[0].constants, 1)[0]
    more = twist_of_action(residual_v, residual_w, p.forward, p.backward, p.turn)
    v, w = assisted_twist(i, assistants, more[0], more[1])
    return action_of_twist(v, w, p.forward, p.backward, p.turn)


class Assistants:
    """Assistants of n chairs; without a method, no rows.

    A copy, by `copy.deepcopy` or `pickle`, goes on as the original does, to the bit.

    Args:
        method: settings of a compiled assistant; None: there is none.
        chair: its outline and limits.
        sensors: where its first scanner sits.
        period: of control [s].
        n: how many.
        freedom: how far they may go; None: as the method says.

    Attributes:
        states: (n,) of ASSISTANT.
        pointers: to them, a record (1,) of ASSISTANTS.
    """

    def __init__(
        self, method: Any, chair: ChairSettings, sensors: SensorSettings, period: float,
        n: int = 1, freedom: Freedom | None = None,
    ) -> None:  # fmt: skip
        self.states = np.zeros(0 if method is None else n, ASSISTANT)
        self.pointers = Pointers(np.zeros(1, ASSISTANTS), ASSISTANTS_TARGETS)
        self.pointers.fill(n=len(self.states), assistants=self.states)
        self._kind = STICK if method is None else KINDS[type(method)]
        self._limits = chair.limits
        if method is not None:
            free = freedom if freedom is not None else method.freedom
            self.pointers.point("constants", self._constants(method, free, chair, sensors, period))

    def _constants(
        self, method: Any, freedom: Freedom, chair: ChairSettings, sensors: SensorSettings,
        period: float,
    ) -> Pointers:  # fmt: skip
        pointers = Pointers(np.zeros(1, CONSTANTS), _TARGETS, constant=True)
        p: Any = pointers.record[0]
        copy_numbers(p["method"], method)
        copy_numbers(p["freedom"], freedom)
        for name in ("forward", "backward", "turn", "deceleration"):
            p[name] = getattr(chair.limits, name)
        outline = chair.footprint
        return pointers.fill(
            kind=self._kind, period=period, outline=outline.array,
            middle=0.5 * (outline.front - outline.rear), scanners=scanners_of(sensors),
            n_scanners=len(sensors.lasers), directions=sensors.directions,
        )  # fmt: skip

    def begin(self) -> None:
        """Reset the only row for a new episode."""
        if len(self.states):
            begin_assistant(0, self.pointers.record)

    def update(self, stick: Stick, reading: Reading) -> None:
        """Take in a reading in the only row, and decide on a stick."""
        update = pass_stick_on if self._kind == STICK else update_assistant  # compiles sooner
        update(
            0, self.pointers.record, float(stick.forward), float(stick.left), reading.laser,
            reading.twist, float(reading.stamp),
        )  # fmt: skip

    def twist(self, residual: tuple[float, float] = (0.0, 0.0)) -> Array:
        """The only row's twist (2,) [m/s, rad/s], with that of a residual action; clipped."""
        more = self._limits.twist_of(*residual)
        return np.array(assisted_twist(0, self.pointers.record, *more))

    def action(self, residual: tuple[float, float]) -> tuple[float, float]:
        """The action that asks for the only row's twist and for a residual action's; clipped."""
        return assisted_action(0, self.pointers.record, *residual)


def scanners_of(sensors: SensorSettings) -> Rows:
    """Records (n,) of SCANNER of a chair's lasers; further ones share `MORE_GROUPS`."""
    rows = np.zeros(len(sensors.lasers), SCANNER)
    for k, laser in enumerate(sensors.lasers):
        one: Any = rows[k]
        one["mount"] = laser.x, laser.y, np.cos(laser.yaw), np.sin(laser.yaw)
        one["view_cosine"] = np.cos(0.5 * laser.fov) if k == 0 or laser.shows_free else 2.0
        one["first"], one["beams"] = sensors.slices[k].start, laser.beams
        most = GROUPS if k == 0 else MORE_GROUPS // (len(rows) - 1)
        one["groups"] = min(most, laser.beams)
    return rows


class CompiledAssistant:
    """A compiled assistant that turns a person's stick into a twist; `config` is of `COMPILED`."""

    def __init__(self, config: Any) -> None:
        self.config = config
        self.freedom: Freedom = config.freedom

    def reset(self, mission: AssistMission) -> None:
        """Begin an episode: forget the last one."""
        self.row = Assistants(self.config, mission.chair, mission.sensors, mission.period)
        self.row.begin()

    def assist(self, stick: Stick, reading: Reading, map: OccupancyGrid | None) -> Array:
        """The twist (2,) [m/s, rad/s] for the next control period; the map is not looked at."""
        self.row.update(stick, reading)
        return self.row.twist()

"""The shield: limits the twist that a policy requests to what is safe to drive.

    reading ──▶ watch: silent, frozen? ──▶ remember: points, cells, echoes ──▶ sweep ──▶ twist

The shield stands between any policy and any chair and reads nothing but Readings. It scales a twist
and keeps its curvature. The share that it allows is the greatest one for which the chair, driven
for one period and braked at its own limits, stays clear of everything seen in the last seconds,
and enters unseen space at walking-stick speed at most; ended by a protective stop, it also stays
clear of every place that moving objects may reach by then. (After nav2's collision monitor: stop
zone, slow zone, approach; silent sensors count as obstacles.)
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.compiled.address import Pointers, read_record, rows_of
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.safety.decision import decide, limit_for_unseen_space
from wheelchair_gym.safety.memory import reset, update
from wheelchair_gym.safety.settings import ShieldSettings
from wheelchair_gym.safety.state import CONSTANTS, REASONS, SHIELD, ShieldConstants
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings
from wheelchair_gym.types import Reading, check_reading

_constants_at, _shields_at = rows_of(CONSTANTS), rows_of(SHIELD)
SHIELDS, SHIELDS_TARGETS = read_record("SHIELDS", globals())


@inlined
def _shield_row(shields: Any, i: int) -> Any:
    """The records of row i: what all shields share, and its own state."""
    rows = shields[0]
    return _constants_at(rows.constants, 1)[0], _shields_at(rows.shields, rows.n)[i]


@borrowing_kernel
def reset_shield(i: int, shields: Any) -> None:
    """Reset row i; shields: (1,) of SHIELDS."""
    reset(_shield_row(shields, i)[1])


@borrowing_kernel
def update_shield(i: int, shields: Any, seen: Any, laser: Floats) -> None:
    """Update row i with a reading, a record of SENSED and its scans."""
    constants, shield = _shield_row(shields, i)
    update(
        constants, shield, seen.pose[:], seen.twist[:], laser, seen.ultrasonic[:], seen.age[:],
        seen.bumped, False, seen.stamp,
    )  # fmt: skip


@borrowing_kernel
def _read_row(
    shields: Any, pose: Array, twist: Array, laser: Floats, ultrasonic: Floats, age: Floats,
    bumped: bool, halted: bool, stamp: float,
) -> None:  # fmt: skip
    """Update row 0 with the arrays of a reading."""
    constants, shield = _shield_row(shields, 0)
    update(constants, shield, pose, twist, laser, ultrasonic, age, bumped, halted, stamp)


@borrowing_kernel
def _slow_row(shields: Any, motion: Array, twists: Array) -> None:
    """Scale twists (n, 2) in place to what row 0 allows in unseen space."""
    constants, shield = _shield_row(shields, 0)
    limit_for_unseen_space(constants, shield, motion, twists)


@borrowing_kernel
def filter_twist(i: int, shields: Any, v: float, w: float) -> tuple[float, float, bool]:
    """Return the safe twist [m/s, rad/s] for row i and whether a protective stop is active."""
    constants, shield = _shield_row(shields, i)
    return decide(constants, shield, v, w)


@borrowing_kernel
def copy_decision(i: int, shields: Any, target: Any) -> None:
    """Copy row i's latest decision to a record of DECISION."""
    decision = _shield_row(shields, i)[1].decision
    target.reason, target.protective = decision.reason, decision.protective
    for k in range(2):
        target.asked[k], target.given[k] = decision.asked[k], decision.given[k]


def point_to_shields(constants: ShieldConstants, shields: NDArray[np.void]) -> Pointers:
    """Return pointers to shields (n,) of SHIELD and what they share, a record (1,) of SHIELDS."""
    rows = Pointers(np.zeros(1, SHIELDS), SHIELDS_TARGETS)
    return rows.fill(n=len(shields), constants=constants, shields=shields)


class Decision(NamedTuple):
    """The shield's change of a twist, and its reason."""

    reason: str  # one of REASONS; empty: nothing was changed
    asked: Array  # (2,) m/s, rad/s
    given: Array  # (2,) m/s, rad/s
    protective: bool  # the chair is to make a protective stop


class Shield:
    """Limits the twists of one run to what is safe.

    Attributes:
        decision: how the last twist was changed.
        pointers: to its row, a record (1,) of SHIELDS.

    Args:
        config: settings.
        chair: outline and limits.
        sensors: where they sit.
        period: of control [s].
    """

    def __init__(
        self,
        config: ShieldSettings | None = None,
        chair: ChairSettings | None = None,
        sensors: SensorSettings | None = None,
        period: float = 0.1,
    ) -> None:
        self.settings, self._sensors = config or ShieldSettings(), sensors or SensorSettings()
        self._constants = ShieldConstants(
            self.settings, chair or ChairSettings(), self._sensors, period
        )
        self.state: NDArray[np.void] = np.zeros(1, SHIELD)
        self.pointers = point_to_shields(self._constants, self.state)
        self._asked = False
        self.reset()

    def compile(self) -> None:
        """Compile everything that `filter` needs, before a chair drives; it begins anew."""
        dark = np.full(self._sensors.beams, np.nan, np.float32)
        deaf = np.full(self._sensors.ultrasonic.columns, np.nan, np.float32)
        blank = Reading(np.zeros(3), np.zeros(2), dark, deaf, deaf, False, math.nan, 0.0)
        self.filter(np.zeros(2), blank)
        self.reset()

    def reset(self) -> None:
        """Forget all readings and faults; the chair stands."""
        self._asked = False
        self.decision = Decision("", np.zeros(2), np.zeros(2), False)
        reset_shield(0, self.pointers.record)

    def filter(self, twist: Array, reading: Reading) -> Array:
        """The twist (2,) [m/s, rad/s] that may be driven until the next reading.

        Args:
            twist: what a policy asks for.
            reading: the latest; its stamps are the shield's only clock.

        Raises:
            ValueError: the twist is not two finite numbers; see `update`.
        """
        v, w = map(float, twist)
        if not math.isfinite(v + w):
            raise ValueError(f"twist is ({v}, {w}); expected two finite numbers")
        self.update(reading)
        v, w, protective = filter_twist(0, self.pointers.record, v, w)
        given, made = np.array([v, w]), self.state["decision"][0]
        self.decision = Decision(REASONS[made["reason"]], made["asked"].copy(), given, protective)
        return given

    def update(self, reading: Reading) -> None:
        """Update the state by a reading.

        Raises:
            ValueError: an array has another shape; its lasers are not those in the settings.
        """
        check_reading(reading, self._sensors)
        _read_row(
            self.pointers.record, reading.pose, reading.twist, reading.laser, reading.ultrasonic,
            reading.age, bool(reading.bumped), reading.halted != "", reading.stamp,
        )  # fmt: skip

    def limit_for_unseen_space(self, twists: Array, motion: Array) -> Array:
        """Twists (n, 2) [m/s, rad/s], scaled to what is allowed in unseen space.

        For planning: no decision is made, and no other rule applies.

        Args:
            twists: candidates from now on.
            motion: speed, its slope, turn, its slope (4,) of the chair now.
        """
        slowed = np.array(twists, np.float64)
        _slow_row(self.pointers.record, motion, slowed)
        return slowed

    def rearm(self) -> None:
        """Clear a fault once the chair has stood for one period; only a person may ask for this.

        It has no effect while the cause of the fault lasts. In simulation nobody calls it: such an
        episode stands until its time limit.
        """
        self.state["rearmed"] = True
        self._asked = True

    def refused(self) -> str:
        """The fault whose re-arm was refused because its cause lasts; empty: none."""
        if not self._asked or self.state["rearmed"][0]:
            return ""
        self._asked = False
        return self.latched

    @property
    def latched(self) -> str:
        """The fault that stops the chair until `rearm`; empty: none."""
        return REASONS[int(self.state["latched"][0])]

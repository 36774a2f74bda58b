"""Check where the laser and the ultrasonics look, by a person's hand and a flat wall.

No other check at rest finds a laser that is mounted upside down, turned or moved, or two
ultrasonics whose plugs are exchanged: they send good data of another place.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from wheelchair_gym.arrays import Array
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.hardware.boards.senses import BoardSensors
from wheelchair_gym.hardware.control_loop import Clock
from wheelchair_gym.hardware.tools.diagnostics import Finding
from wheelchair_gym.hardware.tools.distance_calibration import echoes_ahead, fit_wall
from wheelchair_gym.localization.occupancy import read_scan

HAND, WALL = 0.3, 0.5  # m: of a hand from a sensor or corner, and of a wall from the front edge
CLEAR = 1.0  # m around the laser in which nothing but the hand stands
_HEARD = 0.5  # m: nearer echoes of ultrasonics are of the hand
_BY_EYE = 0.15  # m: a hand is held so exactly
_WALL_OFF, _WALL_TURNED = 0.05, math.radians(6.0)  # a wall is placed so exactly, with a rule
_HELD, _STILL = 1.0, 0.05  # s, m: a hand is held for this time within this distance


class Orientation:
    """Asks a person for a hand before each sensor, then for a wall.

    Args:
        senses: the lines.
        clock: real or simulated time.
        footprint: of the chair.
        ask: shows the person a request.
        patience: time that the person has for each request [s].
    """

    def __init__(
        self,
        senses: BoardSensors,
        clock: Clock,
        footprint: Footprint,
        ask: Callable[[str], None],
        patience: float = 30.0,
    ) -> None:
        self.senses, self.clock, self.ask, self.patience = senses, clock, ask, patience
        self._front, _, self._half = footprint.array.tolist()

    def run(self) -> list[Finding]:
        """Return the findings of all sensors that have sent data."""
        found, ages = [], self.senses.ages(self.clock.now())
        if math.isfinite(ages["scan"]):
            found += [self._laser_sees("left", 1.0), self._laser_sees("right", -1.0)]
        if math.isfinite(ages.get("ultrasonic", math.inf)):
            rangers = self.senses.sensors.ultrasonic.mounted
            found += [self._ranger_hears(k) for k in range(len(rangers))]
        return found + ([self._wall()] if math.isfinite(ages["scan"]) else [])

    def _laser_sees(self, side: str, sign: float) -> Finding:
        x, y = self._front, sign * (self._half + HAND)
        seen = self._await(f"hold a hand {HAND:g} m {side} of the front {side} corner", self._near)
        if seen is None:
            return _finding("laser", f"hand on the {side}", "not seen", False)
        good = math.hypot(seen[0] - x, seen[1] - y) <= _BY_EYE
        where = f"seen {_place(*seen)}; expected {_place(x, y)}"
        return _finding("laser", f"hand on the {side}", where, good)

    def _ranger_hears(self, k: int) -> Finding:
        one = self.senses.sensors.ultrasonic.mounted[k]
        what = f"hold a hand {HAND:g} m before ultrasonic {k} ({_place(one.x, one.y)})"
        heard = self._await(what, self._loudest)
        text = "not heard" if heard is None else f"heard by {heard[0]:.0f} at {heard[1]:.2f} m"
        return _finding(f"ultrasonic {k}", "hand", text, heard is not None and bool(heard[0] == k))

    def _wall(self) -> Finding:
        what = f"stand a flat wall or board square to the chair, {WALL:g} m before its front edge"
        seen = self._await(what, self._flat)
        if seen is None:
            return _finding("laser", "wall ahead", "not seen", False)
        far, turned = seen[0] - self._front, seen[1]
        good = bool(abs(far - WALL) <= _WALL_OFF and abs(turned) <= _WALL_TURNED)
        text = f"{far:.2f} m before the front edge, turned by {math.degrees(turned):.0f} deg"
        return _finding("laser", "wall ahead", text, good)

    def _await(self, what: str, look: Callable[[], Array | None]) -> Array | None:
        """Ask for something; return what was seen in one place for a while, None: nothing was."""
        if look != self._flat and look() is not None:
            self.ask(f"clear {CLEAR:g} m around the chair")
            if not self._wait(lambda: look() is None):
                return None  # what stands there could be taken for the hand
        self.ask(what)
        place, since = None, math.inf

        def held() -> bool:
            nonlocal place, since
            now, seen = self.clock.now(), look()
            if seen is None or place is None or float(np.abs(seen - place).max()) > _STILL:
                place, since = seen, now
            return place is not None and now - since >= _HELD

        return place if self._wait(held) else None

    def _wait(self, condition: Callable[[], bool]) -> bool:
        return self.senses.wait_for(self.clock, condition, self.patience)

    def _near(self) -> Array | None:
        """Return the laser's nearest echo (2,) [m], in the chair's frame, if it is near."""
        scan = read_scan(self.senses.sensors.laser, self.senses.ranges(self.clock.now())[0])
        far = np.hypot(*(scan.echoes - scan.origin).T)
        return np.array(scan.echoes[far.argmin()]) if far.min(initial=math.inf) < CLEAR else None

    def _loudest(self) -> Array | None:
        """Return number and range [m] of the ultrasonic with the nearest echo, if it is near."""
        ranges = np.nan_to_num(self.senses.ranges(self.clock.now())[1], nan=math.inf)
        k = int(ranges.argmin())
        return np.array([k, ranges[k]]) if ranges[k] < _HEARD else None

    def _flat(self) -> Array | None:
        """Return distance [m] from the axle's centre and bearing [rad] of a near wall, if any."""
        try:
            wall = fit_wall(echoes_ahead(self.senses, self.senses.ranges(self.clock.now())[0]))
        except ValueError:
            return None
        return np.array(wall) if wall.distance < self._front + 2.0 * WALL else None


def _place(x: float, y: float) -> str:
    """Describe a place in the chair's frame."""
    aside = f"{abs(y):.2f} m to the {'left' if y > 0.0 else 'right'}"
    return f"{abs(x):.2f} m {'ahead' if x >= 0.0 else 'behind'}, {aside}"


def _finding(part: str, what: str, text: str, good: bool) -> Finding:
    laser = "its mount: upside down, turned, moved? sensors.laser"
    return Finding(part, what, text, good, laser if part == "laser" else "its plug, its place")

"""One control period of the person who drives a chair; the same function for one and for many."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.compiled.address import Pointers
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.compiled.random import DRIVERS as CHANNEL
from wheelchair_gym.compiled.random import uniform
from wheelchair_gym.people.drivers.intention import (
    NEAR_GOAL,
    begin_intention,
    decide,
    notice_motion,
)
from wheelchair_gym.people.drivers.interfaces import begin_signal, give_signal
from wheelchair_gym.people.drivers.settings import Driver
from wheelchair_gym.people.drivers.state import (
    CONSTANTS,
    DRIVER,
    DRIVERS,
    DRIVERS_TARGETS,
    constants_of,
    driver_row,
)
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings
from wheelchair_gym.task.prepared_episode import PreparedEpisode
from wheelchair_gym.types import Stick

WHO = 400  # index of the draw of who drives, in the channel of drivers; apart from all others


@borrowing_kernel
def begin_driver(i: int, drivers: Any, key: np.uint64) -> None:
    """Draw the person who drives row i, and who rests at first; drivers: (1,) of DRIVERS."""
    _, d = driver_row(drivers, i)
    people = drivers[0].people
    d.person = min(people - 1, int(people * uniform(key, 0, CHANNEL, WHO)))
    begin_signal(d, key)
    begin_intention(d)


@borrowing_kernel
def step_driver(
    i: int, drivers: Any, prepared: Any, pose: Array, twist: Array, scan: Floats
) -> tuple[float, float, bool]:
    """Advance row i's person by one control period: see where the chair came to, and drive on.

    Args:
        i: the row.
        drivers: (1,) of DRIVERS.
        prepared: of the episode, a record of PREPARED.
        pose: true (3,) [m, m, rad].
        twist: true (2,) [m/s, rad/s].
        scan: ranges [m], those of the first scanner first.

    Returns:
        Signal of the interface: deflections forward and to the left, and whether they last
        without the person's doing.
    """
    p, d = driver_row(drivers, i)
    notice_motion(p, d, twist)
    decide(p, d, prepared, pose, twist, scan)
    far = math.hypot(prepared.goal[0] - pose[0], prepared.goal[1] - pose[1])
    give_signal(p, d, pose[2], far < NEAR_GOAL)
    return d.stick[0], d.stick[1], d.latched


class Drivers:
    """The people who drive n chairs, one of them in each episode; of nobody, no rows.

    A copy, by `copy.deepcopy` or `pickle`, goes on as the original does, to the bit.

    Attributes:
        people: their settings, of which an episode draws one; empty: nobody drives.
        states: (n,) of DRIVER.
        pointers: to them, a record (1,) of DRIVERS.
    """

    def __init__(
        self,
        people: Sequence[Driver],
        chair: ChairSettings,
        sensors: SensorSettings,
        period: float,
        n: int = 1,
    ) -> None:
        self.people = tuple(people)
        self.states = np.zeros(n if people else 0, DRIVER)
        self.pointers = Pointers(np.zeros(1, DRIVERS), DRIVERS_TARGETS)
        self.pointers.record["n"], self.pointers.record["people"] = len(self.states), len(people)
        constants = [np.zeros(0, CONSTANTS)]
        constants += [constants_of(one, chair, sensors, period) for one in people]
        self.pointers.point("constants", np.concatenate(constants))
        self.pointers.point("drivers", self.states)

    @property
    def driver(self) -> Driver | None:
        """Driver of the only row in this episode; None: nobody drives."""
        return self.people[int(self.states["person"][0])] if self.people else None

    def begin(self, key: int) -> None:
        """Draw the person who drives the only row in an episode with a key, at rest at first."""
        if len(self.states):
            begin_driver(0, self.pointers.record, np.uint64(key))

    def step(self, prepared: PreparedEpisode, pose: Array, twist: Array, scan: Floats) -> Stick:
        """Return the next signal from the interface of the only row's person; see `step_driver`."""
        row = prepared.record[0]
        return Stick(*step_driver(0, self.pointers.record, row, pose, twist, scan))

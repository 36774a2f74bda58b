"""One control period of the person who drives a chair; the same function for one and for many.

Interfaces turn the intended signal into what the chair's joystick input gives, in ticks. A stick
follows a hand, which trembles; the sum is filtered and then sampled, so that what is faster than
the sampling aliases as in a real chair. Switches, scanning and a brain-computer interface give one
of a few signals, late and sometimes a wrong one.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.compiled.address import Pointers
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.compiled.random import DRIVERS as CHANNEL
from wheelchair_gym.compiled.random import normal, uniform
from wheelchair_gym.geometry.planar import body_to_world, wrap
from wheelchair_gym.people.drivers.intention import (
    NEAR_GOAL,
    begin_intention,
    decide,
    notice_motion,
)
from wheelchair_gym.people.drivers.settings import Driver
from wheelchair_gym.people.drivers.state import (
    BRAIN_COMPUTER,
    COMMAND_DELAY,
    CONSTANTS,
    DRIVER,
    DRIVERS,
    DRIVERS_TARGETS,
    SCANNING,
    STICK,
    SWITCHES,
    constants_of,
    driver_row,
)
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings
from wheelchair_gym.task.prepared_episode import PreparedEpisode
from wheelchair_gym.types import Stick

# Indices of draws in the channel DRIVERS; those of a tick and of a decision differ.
TREMOR, BURST, BURST_X, BURST_Y, ERROR, OTHER, LATE = 0, 2, 3, 4, 5, 6, 7
STOP, AHEAD = 0, 1  # the signal at rest, and that of imagery without any turn
BURST_TIME = 1.0  # s that a spasm lasts: 0.5 to 2 s, assumed
COMMAND_ANGLE = math.radians(30.0)  # rad that a command of imagery turns: Leeb 2015
COMMAND_INTERVAL = 10.0  # s from one command of imagery to the next: 3 to 6 a minute, assumed
LONGEST_TURN = 5.0  # s: a command that turns nothing ends then


@inlined
def push_through(x: float, y: float, zone: float) -> tuple[float, float]:
    """The deflection of a person who knows the dead zone, and pushes through it."""
    size = math.hypot(x, y)
    more = (zone + (1.0 - zone) * min(1.0, size)) / size if size > 0.0 else 1.0
    return x * more, y * more


@inlined
def weaken(x: float, y: float, hand: tuple[float, float, float, float]) -> tuple[float, float]:
    """A deflection by a hand's shares forward, backward, to the left and to the right."""
    return x * (hand[0] if x > 0.0 else hand[1]), y * (hand[2] if y > 0.0 else hand[3])


@inlined
def smoothing_share(smoothing: float, tick: float) -> float:
    """The share of a step that a stick's filter takes within a tick [s]."""
    return 1.0 if smoothing < 0.1 * tick else 1.0 - math.exp(-tick / smoothing)


@inlined
def beyond_dead_zone(x: float, y: float, zone: float, gain: float) -> tuple[float, float]:
    """Return a stick's output for a deflection."""
    size, share = math.hypot(x, y), 0.0
    if size > zone:
        share = gain * (size - zone) / (1.0 - zone) / size
    return min(1.0, max(-1.0, share * x)), min(1.0, max(-1.0, share * y))


@borrowing_kernel
def _draw(d: Any, index: int) -> float:
    return uniform(d.key, d.tick, CHANNEL, index)


@borrowing_kernel
def _hand_rates(p: Any, tick: float) -> tuple[float, float, float, float, float]:
    """Compute the constants of a hand that are the same in each tick.

    Returns:
        The shares of what is left of its way that the hand goes in a tick outwards and back, the
        filter's share, and cosine and sine of the stick's rotation.
    """
    h = p.hand
    return (
        1.0 - math.exp(-tick / h.lag),
        1.0 - math.exp(-tick / h.return_lag),
        smoothing_share(p.interface.smoothing, tick),
        math.cos(h.rotation),
        math.sin(h.rotation),
    )


@borrowing_kernel
def _move_hand(
    p: Any, d: Any, tick: float, near_goal: bool, rates: tuple[float, float, float, float, float]
) -> None:
    """One tick of hand, tremor and filter; rates as of `_hand_rates`."""
    h, device = p.hand, p.interface
    away, back, share, cosine, sine = rates
    x, y = p.signals[d.intended, 0] / device.gain, p.signals[d.intended, 1] / device.gain
    x, y = push_through(x, y, device.dead_zone)
    if h.bursts > 0.0:
        if d.clock >= d.burst_until and _draw(d, BURST) < h.bursts / 60.0 * tick:
            d.burst_until = d.clock + BURST_TIME
            d.burst[0] = 1.0 if _draw(d, BURST_X) < 0.5 else -1.0
            d.burst[1] = 1.0 if _draw(d, BURST_Y) < 0.5 else -1.0
        if d.clock < d.burst_until:
            x, y = d.burst[0], d.burst[1]
    for k in range(2):
        to = x if k == 0 else y
        d.hand[k] += (to - d.hand[k]) * (back if abs(to) < abs(d.hand[k]) else away)
        if p.tremor_gain > 0.0:
            noise = normal(d.key, d.tick, CHANNEL, TREMOR + k)
            value = p.tremor_a * d.tremor[k, 0] - p.tremor_b * d.tremor[k, 1]
            d.tremor[k, 1], d.tremor[k, 0] = d.tremor[k, 0], value + p.tremor_gain * noise
    rise = h.tremor_at_goal if near_goal else 1.0
    x, y = d.hand[0] + rise * d.tremor[0, 0], d.hand[1] + rise * d.tremor[1, 0]
    x, y = weaken(x, y, (h.forward, h.backward, h.leftward, h.rightward))
    x, y = body_to_world(cosine, sine, x, y)
    x, y = x + h.offset_forward, y + h.offset_left
    d.filtered[0] += (min(1.0, max(-1.0, x)) - d.filtered[0]) * share
    d.filtered[1] += (min(1.0, max(-1.0, y)) - d.filtered[1]) * share


@borrowing_kernel
def _step_switches(p: Any, d: Any) -> None:
    """Another signal comes about after a delay, and now and then it is another one still."""
    if d.switch_to < 0:
        if d.intended != d.active:
            d.switch_to, d.switch_at = d.intended, d.clock + p.interface.delay
        return
    if d.clock < d.switch_at:
        return
    to = d.switch_to
    if _draw(d, ERROR) < p.interface.error:
        to = min(p.n_signals - 1, int(_draw(d, OTHER) * p.n_signals))
    if to != d.active:
        d.presses += 1
    d.active, d.switch_to = to, -1


@borrowing_kernel
def _step_scanning(p: Any, d: Any) -> None:
    """A press stops the chair and begins the scan, or picks the command that is lit."""
    device = p.interface
    if d.active != STOP:
        if d.intended != d.active:
            if d.switch_to < 0:
                d.switch_to, d.switch_at = STOP, d.clock + device.delay
            elif d.clock >= d.switch_at:
                d.active, d.switch_to, d.scan = STOP, -1, 1
                d.switch_at = d.clock + device.scan_period
                d.presses += 1
        return
    if d.intended == STOP:
        d.scan = 0
        return
    if d.scan == 0:
        d.scan, d.switch_at = 1, d.clock + device.scan_period
        return
    if d.clock < d.switch_at:
        return
    lit = d.scan  # its time ends
    d.scan = 1 if lit == p.n_signals - 1 else lit + 1
    d.switch_at = d.clock + device.scan_period
    if lit == d.intended:
        d.active = d.scan if _draw(d, ERROR) < device.error else lit
        d.scan, d.switch_to = 0, -1
        d.presses += 1


@borrowing_kernel
def _step_brain_computer(p: Any, d: Any, yaw: float) -> None:
    """A switch starts and stops; imagery turns the chair by an angle, late and not always right."""
    device, turns = p.interface, d.active > AHEAD
    if turns and (
        abs(wrap(yaw - d.turn_from)) >= COMMAND_ANGLE or d.clock > d.commanded + LONGEST_TURN
    ):
        d.active = d.resumed
        return
    to = d.intended
    if to == d.active or (to > AHEAD and (turns or d.clock < d.commanded + COMMAND_INTERVAL)):
        d.switch_to = -1
    elif d.switch_to != to:
        late = device.delay
        if to > AHEAD:
            late = COMMAND_DELAY[0] + (COMMAND_DELAY[1] - COMMAND_DELAY[0]) * _draw(d, LATE)
        d.switch_to, d.switch_at = to, d.clock + late
    elif d.clock >= d.switch_at:
        if to > AHEAD:
            d.resumed, d.commanded, d.turn_from = d.active, d.clock, yaw
            if _draw(d, ERROR) >= device.accuracy:
                to = 5 - to  # left for right
        d.active, d.switch_to = to, -1
        d.presses += 1


@borrowing_kernel
def give_signal(p: Any, d: Any, yaw: float, near_goal: bool) -> None:
    """Move hand and interface towards the intended signal for one control period."""
    tick = p.period / p.ticks
    rates = _hand_rates(p, tick)
    for _ in range(p.ticks):
        d.tick += 1
        d.clock = d.tick * tick
        while d.pending > 0 and d.pending_at[0] <= d.clock + 1e-9:
            d.intended = d.pending_signal[0]
            d.pending -= 1
            for k in range(d.pending):
                d.pending_signal[k], d.pending_at[k] = d.pending_signal[k + 1], d.pending_at[k + 1]
        if p.kind == STICK:
            _move_hand(p, d, tick, near_goal, rates)
            if d.tick % p.sample_every == 0:
                levels = p.interface.levels
                x = math.floor(d.filtered[0] * levels + 0.5) / levels
                y = math.floor(d.filtered[1] * levels + 0.5) / levels
                dead_zone, gain = p.interface.dead_zone, p.interface.gain
                d.stick[0], d.stick[1] = beyond_dead_zone(x, y, dead_zone, gain)
        elif p.kind == SWITCHES:
            _step_switches(p, d)
        elif p.kind == SCANNING:
            _step_scanning(p, d)
        elif p.kind == BRAIN_COMPUTER:
            _step_brain_computer(p, d, yaw)
    if p.kind != STICK:
        d.stick[0], d.stick[1] = p.signals[d.active, 0], p.signals[d.active, 1]
        # Turns of switches are held.
        d.latched = p.latched and (
            d.active != STOP if p.kind != SWITCHES else p.signals[d.active, 0] != 0.0
        )


@borrowing_kernel
def begin_signal(d: Any, key: np.uint64) -> None:
    """Reset hand and interface: nothing is held, and the hand rests."""
    d.key, d.tick, d.clock = key, 0, 0.0
    d.pending = d.intended = d.active = d.scan = d.presses = d.resumed = 0
    d.switch_to, d.switch_at, d.burst_until, d.turn_from = -1, 0.0, 0.0, 0.0
    d.commanded = -1e9
    d.latched = False
    for k in range(2):
        d.hand[k] = d.filtered[k] = d.stick[k] = d.burst[k] = 0.0
        d.tremor[k, 0] = d.tremor[k, 1] = 0.0


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

    Pose (3,) and twist (2,) are the true ones; the scan has the first scanner's ranges [m] first.
    Return the interface's deflections forward and to the left, and whether they last without the
    person's doing.
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
        constants = [np.zeros(0, CONSTANTS)]
        constants += [constants_of(one, chair, sensors, period) for one in people]
        self.pointers = Pointers(np.zeros(1, DRIVERS), DRIVERS_TARGETS).fill(
            n=len(self.states), people=len(people), constants=np.concatenate(constants),
            drivers=self.states,
        )  # fmt: skip

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

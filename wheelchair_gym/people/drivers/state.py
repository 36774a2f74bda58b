"""Records of simulated people: CONSTANTS of one, and DRIVER, where each stands in time.

Both are pure numbers: they hold no address, and DRIVERS those of their rows. Batch and
single environment hold the same rows (`Drivers`), and step them by the same compiled function.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelchair_gym.base.arrays import Array, Rows
from wheelchair_gym.base.settings import InputError, copy_numbers, numbers_of
from wheelchair_gym.compiled.address import Target, pointer_record, prefetch, rows_of
from wheelchair_gym.compiled.kernel import inlined
from wheelchair_gym.people.drivers.settings import INTERFACES, Driver, Hand, Intention, Perception
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings

TICK_RATE = 100.0  # Hz: of hand and interface, at least the control rate
STICK_RATE = 100.0  # Hz at which a stick is sampled: a public R-net bridge, each 10 ms
SECTORS = 64  # of the scan: of each, the nearest beam is seen
SIGNALS = 80  # that a person chooses from, at most
PENDING = 32  # decisions that wait for the reaction time
STICK, SWITCHES, SCANNING, BRAIN_COMPUTER = range(4)  # kinds, in the order of INTERFACES
OUTLINE, ROUTE, OBSTACLE = range(3)  # ways of `Intention.way`
WAYS = ("outline", "route", "obstacle")
GO, LOOK, ELSEWHERE, RETREAT = range(4)  # what a person is about
COMMAND_DELAY = (1.0, 4.0)  # s from intention to a brain-computer interface's command: assumed


INTENTION, PERCEPTION, HAND = map(numbers_of, (Intention, Perception, Hand))
INTERFACE = numbers_of(*INTERFACES.values())

CONSTANTS = np.dtype(
    [
        ("intention", INTENTION),
        ("perception", PERCEPTION),
        ("hand", HAND),
        ("interface", INTERFACE),  # zero: the kind has no such number
        ("kind", "i8"),
        ("way", "i8"),
        ("latched", "b1"),  # signals of switches last
        ("n_signals", "i8"),
        ("signals", "f8", (SIGNALS, 2)),  # deflections forward and to the left; the first is rest
        ("late", "f8", (SIGNALS,)),  # s until a signal takes effect, while the last one goes on
        ("wait", "f8", (SIGNALS,)),  # s that the wait for it costs
        ("slowness", "f8"),  # times a time to go at full speed, with few signals; a stick: 1
        ("place", "i8", (SIGNALS, 2)),  # of a stick's signals, in their grid
        ("coarse", "i8", (SIGNALS,)),  # 1: always weighed; others are where it matters
        # the chair
        ("period", "f8"),  # s: of control
        ("ticks", "i8"),  # in a control period
        ("sample_every", "i8"),  # ticks between two samples of a stick
        ("forward", "f8"),  # m/s
        ("backward", "f8"),
        ("turn", "f8"),  # rad/s
        ("outline", "f8", (3,)),  # `Footprint.array`
        ("mount", "f8", (3,)),  # m, m, rad: of the first scanner
        ("beams", "i8"),  # of it
        ("first", "f8"),  # rad: of its first beam, in its frame
        ("per_beam", "f8"),  # rad between two beams
        # the tremor's filter: twice its pole's real part, its radius squared, and its gain
        ("tremor_a", "f8"),
        ("tremor_b", "f8"),
        ("tremor_gain", "f8"),
    ],
    align=True,
)

DRIVER = np.dtype(
    [
        ("key", "u8"),  # of the episode's randomness
        ("person", "i8"),  # who drives: place of the constants
        ("tick", "i8"),  # since reset
        ("clock", "f8"),  # s since reset
        # the decision
        ("decisions", "i8"),  # so far
        ("decide_at", "f8"),  # s
        ("mode", "i8"),  # GO, LOOK, ELSEWHERE or RETREAT
        ("mode_until", "f8"),  # s
        ("target", "f8", (2,)),  # m: of LOOK and ELSEWHERE
        ("stuck", "f8"),  # s for which it has pushed in vain
        ("expected", "f8"),  # rad/s: turn that it expects, as the chair follows what it asks for
        ("surplus", "f8"),  # rad/s: turn beside what it asks for, as it has learned
        ("lapse_until", "f8"),  # s
        ("daring", "f8"),  # halvings of the clearance, after it has hesitated
        ("clearance", "f8"),  # m: that it likes to keep now
        ("manoeuvres", "b1"),  # near a goal that is a pose
        ("horizon", "f8"),  # s: that it looks ahead now
        ("fastest", "f8"),  # m/s: that it drives now with a stick
        ("chosen", "i8"),  # the latest signal decided on
        ("pending", "i8"),  # decisions that wait
        ("pending_signal", "i8", (PENDING,)),
        ("pending_at", "f8", (PENDING,)),  # s
        ("intended", "i8"),  # the signal that the body is after
        # hand and interface
        ("hand", "f8", (2,)),
        ("tremor", "f8", (2, 2)),  # the last two values, forward and to the left
        ("burst_until", "f8"),  # s
        ("burst", "f8", (2,)),
        ("filtered", "f8", (2,)),
        ("active", "i8"),  # the signal that switches give
        ("switch_to", "i8"),  # the one that comes next; -1: none
        ("switch_at", "f8"),  # s
        ("scan", "i8"),  # the command that is lit; 0: none
        ("resumed", "i8"),  # the signal that a command to turn gives way to
        ("turn_from", "f8"),  # rad: heading at which a command to turn began
        ("commanded", "f8"),  # s: of the latest command to turn
        ("presses", "i8"),  # of switches, and commands, so far
        # what the interface gives
        ("stick", "f8", (2,)),  # forward and to the left, in [-1, 1]
        ("latched", "b1"),  # it lasts without the person's doing
        # of obstacles that are seen, in the chair's frame [m]
        ("n_points", "i8"),
        ("points", "f8", (SECTORS, 2)),
    ],
    align=True,
)

# People by address, as the shield's rows.
DRIVERS, DRIVERS_TARGETS = pointer_record(
    ("n", "i8"),  # 0: nobody drives
    ("people", "i8"),  # one of them drives in an episode
    ("constants", Target(CONSTANTS, None)),
    ("drivers", Target(DRIVER, None)),
)
_constants_at, _drivers_at, _SIZE = rows_of(CONSTANTS), rows_of(DRIVER), DRIVER.itemsize


@inlined
def driver_row(drivers: Any, i: int) -> Any:
    """The records of row i: who drives, and its state; drivers: (1,) of DRIVERS."""
    rows = drivers[0]
    d = _drivers_at(rows.drivers, rows.n)[i]
    return _constants_at(rows.constants, rows.people)[d.person], d


@inlined
def prefetch_driver(drivers: Any, i: int) -> None:
    """Prefetch the state of row i while something else is computed."""
    rows = drivers[0]
    if rows.n > 0:
        prefetch(rows.drivers + np.uint64(i * _SIZE), _SIZE)


# Deflections of a stick that a person chooses from, rest first.
_AHEAD = (0.0, 0.12, 0.3, 0.6, 1.0, -0.25, -0.6)
_ASIDE = (0.0, 0.08, 0.2, 0.4, 0.7, -0.08, -0.2, -0.4, -0.7)
_COARSE_AHEAD, _COARSE_ASIDE = (-0.6, 0.0, 0.3, 1.0), (-0.7, -0.2, 0.0, 0.2, 0.7)


def signals_of(driver: Driver) -> Array:
    """The signals (n, 2) that a person chooses from: deflections forward and to the left."""
    device, maximum = driver.interface, driver.intention.speed
    if device.kind == "stick":
        ahead, aside = np.array(_AHEAD) * maximum * device.gain, np.array(_ASIDE) * device.gain
        return np.array([(x, y) for x in ahead for y in aside])
    v, w = min(device.speed, maximum), device.turn
    if device.kind == "switches" and device.directions == 8:
        every = [(x, y) for x in (0.0, v, -v) for y in (0.0, w, -w)]
        return np.array(every)
    if device.kind == "switches" and device.latched:  # breaths turn a chair that drives on, too
        return np.array([(0.0, 0.0), (v, 0.0), (-v, 0.0), (0.0, w), (0.0, -w), (v, w), (v, -w)])
    if device.kind == "brain_computer":
        return np.array([(0.0, 0.0), (v, 0.0), (0.0, w), (0.0, -w)])
    # In the order in which commands are lit.
    return np.array([(0.0, 0.0), (v, 0.0), (0.0, w), (0.0, -w), (-v, 0.0)])


def constants_of(
    driver: Driver, chair: ChairSettings, sensors: SensorSettings, period: float
) -> Rows:
    """The record (1,) of CONSTANTS of somebody who drives a chair, with its control period [s].

    Raises:
        InputError: the stick is sampled more slowly than the chair is controlled.
    """
    rows = np.zeros(1, CONSTANTS)
    p: Any = rows[0]
    device = driver.interface
    for part, source in (
        ("intention", driver.intention), ("perception", driver.perception), ("hand", driver.hand),
        ("interface", device),
    ):  # fmt: skip
        copy_numbers(p[part], source)
    p["interface"]["delay"] = device.delay
    p["kind"], p["way"] = list(INTERFACES).index(device.kind), WAYS.index(driver.intention.way)
    p["latched"] = getattr(device, "latched", device.kind != "stick")
    signals = signals_of(driver)
    p["n_signals"] = len(signals)
    p["signals"][: len(signals)] = signals
    p["coarse"] = 1
    if device.kind == "stick":
        ahead, aside = sorted(_AHEAD), sorted(_ASIDE)
        grid = [(x, y) for x in _AHEAD for y in _ASIDE]
        p["place"][: len(grid)] = [(ahead.index(x), aside.index(y)) for x, y in grid]
        p["coarse"][: len(grid)] = [x in _COARSE_AHEAD and y in _COARSE_ASIDE for x, y in grid]
    late, wait = p["late"], p["wait"]
    late[:] = driver.perception.reaction + device.delay
    if device.kind == "scanning":  # while it waits for its command to be lit
        # A tenth: a myopic horizon would not think a drive worth its wait.
        wait[1 : len(signals)] = 0.1 * device.scan_period * np.arange(1, len(signals))
    elif device.kind == "brain_computer":
        late[2:] = driver.perception.reaction + 0.5 * sum(COMMAND_DELAY)
    p["period"], p["ticks"] = period, max(1, round(period * TICK_RATE))
    tick = period / p["ticks"]
    if device.kind == "stick":
        if STICK_RATE * period < 1.0 - 1e-9:
            raise InputError(
                f"the rate of control is {1.0 / period:g} Hz; expected at most {STICK_RATE:g} Hz, "
                "at which a driver's stick is sampled"
            )
        p["sample_every"] = max(1, round(1.0 / (STICK_RATE * tick)))
    limits, laser = chair.limits, sensors.laser
    p["forward"], p["backward"], p["turn"] = limits.forward, limits.backward, limits.turn
    # Times to go are at full speed. A person with few signals is slower, and weighs times to go
    # against the time for which a signal is held.
    p["slowness"] = 1.0 if device.kind == "stick" else 1.0 / max(signals[:, 0])
    p["outline"], p["mount"] = chair.footprint.array, (laser.x, laser.y, laser.yaw)
    p["beams"] = laser.beams
    if laser.beams:
        p["first"], p["per_beam"] = -0.5 * laser.fov, laser.fov / (laser.beams - 1)
    p["tremor_a"], p["tremor_b"], p["tremor_gain"] = tremor_filter(driver.hand, tick)
    return rows


def tremor_filter(hand: Hand, tick: float) -> tuple[float, float, float]:
    """Coefficients of y[k] = a y[k-1] - b y[k-2] + gain n[k], which gives a tremor from noise n.

    A resonator whose poles lie at the tremor's frequency, as far inside the unit circle as its band
    is wide; the gain follows from the stationary variance of an autoregressive process of order 2
    (Box and Jenkins 1976, (3.2.28)), so that the tremor has the power of a sine of its amplitude.
    """
    r = np.exp(-np.pi * hand.tremor_band * tick)
    angle = 2.0 * np.pi * hand.tremor_frequency * tick
    a, b = 2.0 * r * np.cos(angle), r * r
    variance = (1.0 + b) / ((1.0 - b) * ((1.0 + b) ** 2 - a * a))
    return float(a), float(b), float(hand.tremor / np.sqrt(2.0 * variance))

"""Records of simulated people: CONSTANTS of one, and DRIVER, where each stands in time.

Both are pure numbers: they hold no address, and DRIVERS those of their rows. Batch and
single environment hold the same rows (`Drivers`), and step them by the same compiled function.
"""

from typing import Any

import numpy as np

from wheelchair_gym.base.arrays import Array, Rows
from wheelchair_gym.base.settings import InputError, copy_numbers, numbers_of
from wheelchair_gym.compiled.address import prefetch, read_record, rows_of
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

CONSTANTS = read_record("CONSTANTS", globals())[0]
DRIVER = read_record("DRIVER", globals())[0]
DRIVERS, DRIVERS_TARGETS = read_record("DRIVERS", globals())
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

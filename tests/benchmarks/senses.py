"""Drive with a laser that deceives, towards things that it should show.

`python -m tests.benchmarks.senses` prints, for each kind of fault, the contacts at more than
0.05 m/s, the time until the chair says so, and the highest contact speed. The chair asks for full
speed towards a wall, an oblique wall, a post of 5 cm and a column as wide as a person, or drives
to and fro in a room for a minute. No policy plans: the shield alone is tested. With `--boards`, the
chair is the twin, at 10 Hz: its emulated boards and its laser's protocol are part of the drive.
"""

import argparse
import dataclasses
import itertools
import math
from collections import deque
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from tests.sim.worlds import box, step
from wheelchair_gym.base.arrays import Floats
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.safety import Shield
from wheelchair_gym.sensors.settings import LaserSettings, SensorSettings
from wheelchair_gym.sim.chair import SimulatedChair

Deceit = Callable[[Floats, float], Floats]  # of a scan at a time [s]
PERIOD = 0.02  # s: of control, and of the laser
ONSET = 1.5  # s: of faults that begin on the way
HARM = 0.05  # m/s
SPEEDS = (0.3, 0.8)  # m/s
THINGS = ("wall", "oblique", "post", "column")


class Fault(NamedTuple):
    """A fault of the laser: its mount differs from the settings, or its scans are changed."""

    name: str
    deceit: Callable[[np.random.Generator], Deceit]
    laser: LaserSettings = LaserSettings()
    delay: float = 0.0  # s: of scans that come late, on the boards
    growth: float = 0.0  # s/s


def plain(rng: np.random.Generator) -> Deceit:
    return lambda scan, t: scan


def late(delay: float, growth: float = 0.0) -> Callable[[np.random.Generator], Deceit]:
    """Scans that come a delay [s] later, which grows [s/s]."""

    def begin(rng: np.random.Generator) -> Deceit:
        past: deque[Floats] = deque()

        def deceive(scan: Floats, t: float) -> Floats:
            past.append(scan)
            while len(past) > 1 and (len(past) - 1) * PERIOD > delay + growth * t + 1e-9:
                past.popleft()
            return past[0]

        return deceive

    return begin


def repeated(scans: int, jitter: float = 0.0) -> Callable[[np.random.Generator], Deceit]:
    """The last scans before the onset again and again, with noise [m]."""

    def begin(rng: np.random.Generator) -> Deceit:
        kept: list[Floats] = []
        count = itertools.count()

        def deceive(scan: Floats, t: float) -> Floats:
            if t < ONSET:
                kept[:] = [*kept[1 - scans :], scan] if scans > 1 else [scan]
                return scan
            noise = rng.normal(0.0, jitter, len(scan)).astype(np.float32)
            return kept[next(count) % len(kept)] + noise

        return deceive

    return begin


def stuck(rng: np.random.Generator) -> Deceit:
    """A mirror that stands: all beams measure straight ahead."""
    kept: list[float] = []

    def deceive(scan: Floats, t: float) -> Floats:
        if t < ONSET:
            return scan
        ahead = scan[len(scan) // 2]
        kept.append(float(ahead) if math.isfinite(ahead) else 10.0)
        return (kept[0] + rng.normal(0.0, 0.015, len(scan))).astype(np.float32)

    return deceive


def blind(width: float, bearing: float, onset: float) -> Callable[[np.random.Generator], Deceit]:
    """A sector [deg] without echoes from a time on [s]."""
    angles = np.degrees(LaserSettings().angles)
    covered = np.abs(angles - bearing) <= 0.5 * width

    def deceive(scan: Floats, t: float) -> Floats:
        return np.where(covered & (t >= onset), np.float32(np.inf), scan)

    return lambda rng: deceive


def mirrored(rng: np.random.Generator) -> Deceit:
    """Left and right exchanged."""
    return lambda scan, t: np.ascontiguousarray(scan[::-1])


def faults() -> Iterator[Fault]:
    yield Fault("none", plain)
    for delay in (0.05, 0.1, 0.15, 0.19, 0.25, 0.3, 0.4, 0.5, 0.75, 1.0):
        yield Fault(f"late {delay:g} s", late(delay), delay=delay)
    for growth in (1, 2, 5, 10, 20):
        yield Fault(f"late, growing {growth} ms/s", late(0.0, growth * 1e-3), growth=growth * 1e-3)
    for scans in (2, 3, 4, 5):
        yield Fault(f"ring of {scans}", repeated(scans))
    for jitter in (1, 3, 5, 10):
        yield Fault(f"repeated, jitter {jitter} mm", repeated(1, jitter * 1e-3))
    yield Fault("stuck mirror", stuck)
    for width, bearing in itertools.product((5, 10, 20, 40, 60), range(-120, 121, 30)):
        if abs(bearing) <= 105:
            yield Fault(f"blind {width} at {bearing}", blind(width, bearing, ONSET))
    for width in (5, 20, 60):
        yield Fault(f"blind {width} at 0 from the start", blind(width, 0, 0.0))
    yield Fault("mirrored", mirrored)
    nominal = LaserSettings()
    for turned in (2, 5, 10, 20, 45, 90, 180, -10):
        moved = dataclasses.replace(nominal, yaw=math.radians(turned))
        yield Fault(f"turned {turned} deg", plain, moved)
    for shift in (0.05, 0.1, 0.2, 0.3, 0.5):
        yield Fault(f"moved {shift:g} m back", plain, dataclasses.replace(nominal, x=0.66 - shift))
        yield Fault(f"moved {shift:g} m left", plain, dataclasses.replace(nominal, y=shift))


class Outcome(NamedTuple):
    contact: float  # m/s: highest speed of a contact that the chair caused
    detected: float  # s after the onset, NaN: never
    reason: str
    way: float  # m from the onset to the end


def world(thing: str):
    """A room with something 4 m ahead."""
    oblique = [(0.0, -2.0, 2.0, 2.5), (0.1, -2.0, 2.1, 2.5)]
    things = {
        "wall": ([(1.0, -2.0, 1.0, 2.5), (1.1, -2.0, 1.1, 2.5)], []),
        "oblique": (oblique, []),
        "post": ([], [(1.0, 0.35, 0.025)]),
        "column": ([], [(1.0, 0.3, 0.25)]),
        "passage": ([(-20.0, -1.5, 20.0, -1.5), (-20.0, 1.5, 20.0, 1.5)], [(1.0, 0.3, 0.05)]),
        "room": (oblique, [(-1.5, 2.5, 0.25), (3.0, -3.0, 0.025), (-2.0, -2.5, 0.025)]),
    }
    walls, discs = things[thing]
    episode = box(5.0, (-3.5, 0.3, 0.0), walls, discs)
    if thing == "passage":  # without the room; its ends are out of reach
        episode = dataclasses.replace(episode, walls=np.array(walls))
    return episode


def drive(
    fault: Fault, thing: str, speed: float, key: int, seconds: float, beams: int = 1081
) -> Outcome:
    """Ask for a speed ahead, and turn where it goes no further if the thing is `room`."""
    sensors = SensorSettings(laser=LaserSettings(beams=beams))
    laser = dataclasses.replace(fault.laser, beams=beams)
    chair = SimulatedChair(sensors=dataclasses.replace(sensors, laser=laser), period=PERIOD)
    shield, rng = Shield(sensors=sensors, period=PERIOD), np.random.default_rng(key)
    deceit = fault.deceit(rng)
    reading = chair.reset(world(thing), key)
    contact, detected, reason, stood, turning, twist = 0.0, math.nan, "", 0, 0, (speed, 0.0)
    for k in range(round(seconds / PERIOD)):
        if thing == "room":
            stood = stood + 1 if abs(chair.truth.twist).max() < 0.06 else 0
            turning = max(0, turning - 1)
            if stood > 20:
                turning, stood = int(rng.integers(180, 330)), 0
                side = rng.choice((-0.6, 0.6))
            twist = (-0.3, 0.0) if turning > 130 else (0.0, side) if turning else (speed, 0.0)
        told = reading._replace(laser=deceit(reading.laser, k * PERIOD))
        reading = step(chair, shield, twist, told)
        contact = max(contact, chair.truth.approach_speed * chair.truth.at_fault)
        if shield.latched and not reason:
            reason, detected = shield.latched, k * PERIOD
    return Outcome(contact, detected, reason, float(chair.truth.distance))


def drive_boards(fault: Fault, thing: str, speed: float, key: int, seconds: float) -> Outcome:
    """The same on the emulated boards; a message of the chair counts as a fault that was found."""
    from tests.hardware.hosted import Hosted

    sensors, limits = SensorSettings(), SensorSettings(laser=fault.laser)
    hosted = Hosted(world(thing), sensors=limits)
    chair, laser, deceit = hosted.chair, hosted.twin.laser, fault.deceit(np.random.default_rng(key))
    chair.senses.sensors, scan, begun = sensors, laser._scan, hosted.clock.now()
    late_only, said, speeds = fault.delay + fault.growth > 0.0, "", deque([0.0], 10)

    def look(turn: int) -> Floats:
        t = hosted.clock.now() - begun
        laser.delay = round(1e3 * (fault.delay + fault.growth * max(0.0, t)))
        return scan(turn) if late_only else deceit(scan(turn), t)

    def watch() -> None:
        if not hosted.twin.bumper_steps:
            speeds.append(abs(hosted.twin.motion.speed))

    hosted.clock.call_every(watch, 2e-3, "watch")
    laser._scan, shield, detected = look, Shield(sensors=sensors), math.nan
    try:
        reading = chair.reset(None, 0)  # type: ignore[arg-type]
        begun = hosted.clock.now()
        while not said and hosted.clock.now() < begun + seconds:
            reading = step(chair, shield, (speed, 0.0), reading)
            said = shield.latched or reading.halted
        detected = hosted.clock.now() - begun if said else math.nan
        for _ in range(10):
            chair.drive(np.zeros(2), bool(said))
    except InputError as error:
        said, detected = str(error), 0.0
    contact = max(speeds) if hosted.twin.bumper_steps else 0.0
    hosted.close()
    return Outcome(contact, detected, said, float(chair.truth.distance))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3, metavar="N")
    parser.add_argument("--only", default="", metavar="TEXT", help="faults whose name holds it")
    parser.add_argument("--seconds", type=float, default=60.0, help="of a drive in a room")
    parser.add_argument("--boards", action="store_true", help="drive the twin")
    given = parser.parse_args()
    run = drive_boards if given.boards else drive
    print(f"{'fault':32} drives contacts  worst m/s  found  after s (median, most)  reasons")
    for fault in faults():
        if given.only not in fault.name:
            continue
        found = [
            run(fault, thing, speed, key, 12.0 if speed < 0.5 else 8.0)
            for thing, speed, key in itertools.product(THINGS, SPEEDS, range(given.seeds))
        ]
        found += [
            drive(fault, "room", speed, key, given.seconds)
            for speed, key in itertools.product(SPEEDS, range(0 if given.boards else given.seeds))
        ]
        times = [one.detected for one in found if one.reason] or [math.nan]
        reasons = sorted({one.reason for one in found if one.reason})
        print(
            f"{fault.name:32} {len(found):6d} {sum(one.contact > HARM for one in found):8d}"
            f"  {max(one.contact for one in found):9.3f} {sum(bool(o.reason) for o in found):6d}"
            f"  {np.median(times):7.2f} {max(times):7.2f}  {', '.join(reasons)}", flush=True,
        )  # fmt: skip


if __name__ == "__main__":
    main()

"""Reactions of the drive board to failed motors, brakes, strips and EEPROM.

`python -m tests.benchmarks.drive_faults [trials] [case ...]`: a table on stdout, then the same as
JSON; 100 trials of each case. The firmware runs on its emulated chip in lock step with the
simulated chair, so that figures are the same on any machine. Trial n of a case draws its mass (100
to 180 kg), side and strength from the seed (number of the case, n). Exit code 1: a bound was
passed.
"""

import dataclasses
import math
import sys
from collections.abc import Callable

import numpy as np

from tests.benchmarks.bounds import measure
from tests.hardware.pilot import Pilot
from wheelchair_gym.geometry.kinematics import DriveGeometry
from wheelchair_gym.hardware.boards import protocol
from wheelchair_gym.hardware.boards.protocol import Fault, Mode, Status, Switch
from wheelchair_gym.hardware.twin.lockstep import JoystickState
from wheelchair_gym.hardware.twin.plant import Slope
from wheelchair_gym.sim.settings import BatterySettings, BodySettings, ChairSettings, MotorSettings

MASSES = (100.0, 180.0)  # kg: ISO 7176-11 dummies
MARGIN = 0.25  # m/s: `runaway`
RADIUS, TRACK, COUNT = 0.165, 0.54, 1.0 / 4346.0  # m
STEEP = math.radians(8.0)
FRONT, REAR, HALF = 0.70, 0.30, 0.31  # m: the outline about the axle
DETECTED = 0.2  # s from the margin being passed to the cut
# Least deceleration of brakes that are whole [m/s2]: on level ground, and down 8 degrees at 180 kg.
BRAKES = {0.0: 1.5, STEEP: 0.8}
RISE = 0.03  # s in which the brakes close
QUICK = 6.0  # m/s2: what two stuck motors do to 100 kg down 8 degrees
# m/s: `over_speed` of 1.3, and what both drivers at full duty add to 100 kg down 8 degrees: 5.2
# m/s2 on the mean of a delay of 28.5 ms (low-pass 20, a run's counts 2.5, next run 5, output 1).
TOP = 1.45
PUSH = 250.0  # N, of a person, either way
STRIPS = (Switch.FRONT, Switch.REAR, Switch.LEFT, Switch.RIGHT)


class Ride(Pilot):
    """A pilot of a chair of its own mass, and what is looked at in each millisecond."""

    def __init__(self, rng: np.random.Generator, chair: ChairSettings) -> None:
        body = BodySettings(mass=float(rng.uniform(*MASSES)))
        super().__init__(chair=dataclasses.replace(chair, body=body))
        self.twin.range.run = lambda _cycle: None  # it has no part in this, and takes half the time

    def each(self, seconds: float):
        """Advance time; yield the speeds of both rims [m/s] after each millisecond."""
        for k in range(round(seconds * 1000)):
            if k % 20 == 0 and self.target is not None:
                self.send(protocol.Command(*self.target))
            before = self.twin.motion
            self.twin.run(0.001)
            now = self.twin.motion
            if k % 20 == 19:
                self.listen()
            yield (now.left - before.left) * COUNT * 1e3, (now.right - before.right) * COUNT * 1e3

    def by_hand(self, seconds: float, **stick) -> None:
        self.twin.faults.joystick = JoystickState(manual=True, **stick)
        self.run(seconds)

    def manual(self, ahead: float, seconds: float) -> None:
        """A person drives by the joystick at the board."""
        self.by_hand(0.2)
        self.by_hand(0.2, dead_man=True)
        self.by_hand(seconds, dead_man=True, forward=ahead)
        assert self.now.mode == Mode.MANUAL


def runaway(pilot, twin, rng, v, angle, mode):
    """Left, right or both drivers stick while somebody drives, lets go, or stands.

    They give a duty of 0.6 to 1 for good; on a slope, down it.
    """
    if mode == "manual":
        pilot.manual(v / 0.4, 2.0)
    else:
        pilot.start(v, 0.0, 2.4 if v else 0.1)
    twin.faults.slope = Slope(angle) if angle else None
    pilot.run(0.3)
    sides = ((0,), (1,), (0, 1))[int(rng.integers(3))]
    duty = float(rng.uniform(0.6, 1.0)) * (1.0 if angle > 0.0 or rng.random() < 0.5 else -1.0)
    for side in sides:
        twin.faults.stuck_drivers[side] = duty
    if mode == "manual":  # and lets go
        twin.faults.joystick = JoystickState(forward=1.0, manual=True)
    elif mode == "stopping":
        pilot.target = None
    steps, passed, cut, way, way_cut, speed_cut = twin.steps, None, None, 0.0, 0.0, 0.0
    rest = None
    aim = 0.0 if mode in ("manual", "stopping") else v
    for rims in pilot.each(4.0):
        now, motion = (twin.steps - steps) * 1e-3, twin.motion
        way += 0.001 * abs(motion.speed)
        if cut is None:
            # While a set point falls the aim is what it can be at 1.5 m/s2.
            bound = aim if mode == "host" else max(0.0, v - 1.5 * now)
            beyond = max(*rims, 0.0) - bound, -min(*rims, 0.0)
            if passed is None and max(beyond) > MARGIN:
                passed = now
            if not twin.enabled:
                cut, way_cut, speed_cut = now, way, max(map(abs, rims))
        elif max(map(abs, rims)) < 1e-3:
            rest = now
            break
    if cut is None or rest is None:
        raise RuntimeError(f"{v} m/s, {angle} rad, {mode}: {twin.faults}, {twin.motion}")
    pilot.run(0.1)
    minimum = BRAKES[angle]
    fastest = min(TOP, v + MARGIN + QUICK * DETECTED)
    return {
        "noticed_ms": (1e3 * max(0.0, cut - (cut if passed is None else passed)), 1e3 * DETECTED),
        "way_after_cut_m": (way - way_cut, fastest * RISE + fastest**2 / (2 * minimum)),
        "rest_after_cut_ms": (1e3 * (rest - cut), 1e3 * (RISE + fastest / minimum)),
        "speed_at_cut": (speed_cut, fastest),
        "way_in_all_m": (way, None),
        "missed": (not pilot.now.faults & (Fault.RUNAWAY | Fault.IMPLAUSIBLE | Fault.DIRECTION
                   | Fault.STALL | Fault.OVER_SPEED) or not twin.braked, 0),
    }  # fmt: skip


def wired_wrong(pilot, twin, rng, _v, _angle, what):
    """Motors that were exchanged, or one whose two wires were: the first drive after it."""
    if what == "swapped":
        twin.faults.swapped_motors = True
    else:
        twin.faults.inverted_motors[int(rng.integers(2))] = True
    pilot.start(0.0, 0.0, 0.1)
    pilot.target = (float(rng.uniform(0.1, 0.8)), float(rng.choice((-1, 1)) * rng.uniform(0.2, 1)))
    start, steps, passed, cut, far = pilot.pose, twin.steps, None, None, 0.0
    for rims in pilot.each(4.0):
        now = (twin.steps - steps) * 1e-3
        far = max(far, float(np.hypot(*(pilot.pose - start)[:2])))
        half = 0.5 * TRACK * pilot.now.w
        for rim, aim in zip(rims, (pilot.now.v - half, pilot.now.v + half), strict=True):
            beyond = max(rim - max(aim, 0.0), min(aim, 0.0) - rim)
            if passed is None and beyond > MARGIN:
                passed = now
        if cut is None and not twin.enabled and now > 0.02:
            cut = now
        if cut is not None and max(map(abs, rims)) < 1e-3:
            break
    turned = abs(float(pilot.pose[2] - start[2]))
    late = 0.0 if passed is None else max(0.0, (cut or 9.0) - passed)
    return {
        "noticed_ms": (1e3 * late, 1e3 * DETECTED),
        "cut_after_ms": (1e3 * (cut or 9.0), 1500.0),
        "moved_m": (far, 0.3),
        "turned_deg": (math.degrees(turned), 45.0),
        "missed": (not twin.braked, 0),
    }


def creep(pilot, twin, rng, _v, _angle, _mode):
    """Asked for zero on 2 to 8 degrees in any direction, after it was driven there."""
    angle, to = math.radians(rng.uniform(2.0, 8.0)), rng.uniform(-math.pi, math.pi)
    pilot.start(0.0, 0.0, 0.1)
    twin.faults.slope = Slope(float(angle), float(to))
    pilot.follow((0.3, 0.0), 1.5)
    pilot.target = (0.0, 0.0)
    while pilot.now.v != 0.0 or max(abs(pilot.now.speed_left), abs(pilot.now.speed_right)) > 0.03:
        pilot.run(0.02)
    home, steps, far, closed = pilot.pose, twin.steps, 0.0, None
    for _ in pilot.each(4.0):
        far = max(far, float(np.hypot(*(pilot.pose - home)[:2])))
        if closed is None and twin.braked:
            closed = (twin.steps - steps) * 1e-3
    pilot.target = (0.3, 0.0)  # and it starts without rolling back
    along = np.array([math.cos(home[2]), math.sin(home[2])])
    start, back = pilot.pose, 0.0
    for _ in pilot.each(1.0):
        back = max(back, -float((pilot.pose - start)[:2] @ along))
    return {
        "crept_mm": (1e3 * far, 20.0),
        "brakes_after_ms": (1e3 * (closed or 9.0), 1100.0),
        "rolled_back_mm": (1e3 * back, 20.0),
        "missed": (pilot.now.faults != 0, 0),
    }


def weak_brakes(pilot, twin, rng, _v, _angle, mode):
    """Parked down 8 degrees on brakes that cannot hold it."""
    pilot.start(0.0, 0.0, 0.1)
    twin.faults.brake_fraction = float(rng.uniform(0.0, 0.3))
    twin.faults.slope = Slope(STEEP)
    pilot.target = (0.0, 0.0, protocol.CommandFlag.PROTECTIVE) if mode == "parked" else None
    start, steps, closed, changes, fault = pilot.pose, twin.steps, twin.braked, 0, None
    for _ in pilot.each(8.0):
        changes += twin.braked != closed
        closed = twin.braked
        if fault is None and pilot.now.faults & Fault.BRAKE:
            fault = (twin.steps - steps) * 1e-3
    return {
        "fault_after_ms": (1e3 * (fault or 9.0), 5000.0),
        "rolled_m": (float(np.hypot(*(pilot.pose - start)[:2])), 0.25),
        "brake_changes": (changes, 8),
        "missed": (abs(twin.motion.speed) > 1e-2, 0),
    }


def take_over(pilot, twin, rng, _v, _angle, mode):
    """A person takes the joystick off its centre, or lets the dead-man button go."""
    stick = {"forward": float(rng.uniform(-1, 1)), "turn": float(rng.uniform(-1, 1))}
    if mode == "takes over":
        pilot.start(0.8, 0.0, 2.4)
        twin.faults.joystick = JoystickState(**stick, manual=True, dead_man=bool(rng.integers(2)))
        v = 0.8
    else:
        pilot.manual(1.0, 2.0)
        twin.faults.joystick = JoystickState(forward=1.0, manual=True)
        v = 0.4
    way, rest, steps = 0.0, None, twin.steps
    for _ in pilot.each(2.0):
        way += 0.001 * abs(twin.motion.speed)
        if rest is None and abs(twin.motion.speed) < 1e-3:
            rest = (twin.steps - steps) * 1e-3
    # A frame of the receiver (8 ms), a run (5 ms), and 1.5 m/s2.
    wait = 0.015 + RISE
    return {
        "rest_ms": (1e3 * (rest or 9.0), 1e3 * (wait + v / 1.5)),
        "way_m": (way, v * wait + v**2 / 3.0),
        "missed": (rest is None, 0),
    }


def outward(pressed, v, w):
    """Return the maximum outward speed of the pressed sides [m/s]; at most 0: all move away."""
    corners = [(FRONT, HALF), (FRONT, -HALF), (-REAR, HALF), (-REAR, -HALF)]
    speeds = []
    for x, y in corners:
        vx, vy = v - w * y, w * x
        speeds += [vx] if pressed & Switch.FRONT and x > 0 else []
        speeds += [-vx] if pressed & Switch.REAR and x < 0 else []
        speeds += [vy] if pressed & Switch.LEFT and y > 0 else []
        speeds += [-vy] if pressed & Switch.RIGHT and y < 0 else []
    return max(speeds)


def strips(pilot, twin, rng, _v, _angle, _mode):
    """Any strips pressed at any motion; then any commands: what is pressed moves away only."""
    v, w = float(rng.uniform(-0.3, 0.8)), float(rng.uniform(-1.0, 1.0))
    pilot.start(v, w, 2.0)
    pressed = Switch(0)
    for strip in rng.permutation(4)[: int(rng.integers(1, 3))]:
        pressed |= STRIPS[strip]
    twin.faults.switches = pressed
    for _ in pilot.each((abs(v) + abs(w) * TRACK) / 1.5 + 0.1):
        pass
    worst, fastest = 0.0, 0.0
    for _ in range(6):
        pilot.target = (float(rng.uniform(-0.8, 0.8)), float(rng.uniform(-1.0, 1.0)))
        for _ in pilot.each(0.5):
            motion = twin.motion
            worst = max(worst, outward(pressed, motion.speed, motion.turn))
            fastest = max(fastest, abs(motion.speed))
    told = pilot.now.faults
    return {"outward_m_s": (worst, 0.02), "fastest_m_s": (fastest, 0.13), "missed": (told != 0, 0)}


def store(pilot, twin, rng, _v, _angle, _mode):
    """EEPROM damaged; a person tries to re-arm by joystick and host; then it is set up."""
    kept = bytearray(twin.drive.eeprom(135))
    kept[int(rng.integers(len(kept)))] ^= 1 << int(rng.integers(8))
    twin.drive.set_eeprom(bytes(kept))
    twin.drive.reset()
    pilot.run(0.1)
    asked = pilot.now.faults & Fault.STORE
    pilot.by_hand(0.2)
    pilot.by_hand(0.2, dead_man=True)
    pilot.by_hand(0.5, dead_man=True, forward=1.0)
    moved = abs(twin.motion.speed)
    twin.faults.joystick = None
    pilot.run(0.3)
    pilot.follow((0.0, 0.0), 0.1)
    refused = pilot.ask(protocol.Rearm(0xFFFF), protocol.Answer).status == Status.CAUSE_STANDS
    pilot.target = None
    saved = pilot.ask(protocol.Save(), protocol.Answer).status == Status.DONE
    pilot.run(1.0)
    pilot.start(0.3, 0.0, 0.5)
    good = asked and refused and saved and pilot.now.faults == 0
    return {"moved_m_s": (moved, 0.001), "missed": (not good, 0)}


def edges(pilot, twin, rng, _v, _angle, mode):
    """Run the conditions that a chair in order may meet; none of them is a fault."""
    pilot.start(0.0, 0.0, 0.1)
    if mode == "slopes":
        twin.faults.slope = Slope(float(rng.uniform(0.0, STEEP)), float(rng.uniform(-3.2, 3.2)))
    wrong = stuck = 0
    for _ in range(10):
        kind = rng.integers(6)
        pilot.target = (float(rng.uniform(-0.4, 0.9)), float(rng.uniform(-1.1, 1.1)))
        if kind == 0:
            pilot.target = (0.8, 0.0)
        elif kind == 1:
            pilot.target = (0.0, 0.0, protocol.CommandFlag.PROTECTIVE)
        elif kind == 2:
            pilot.target = (0.0, 0.0)
        elif kind == 3:
            pilot.target = None
        if mode == "pushed":
            twin.faults.push_force = float(rng.choice((-1, 0, 1))) * PUSH
        pilot.run(float(rng.uniform(0.2, 2.0)) if kind != 3 else 0.6)
        if kind == 4:
            twin.faults.switches = Switch.STOP_PRESSED
            pilot.run(2.0)
            twin.faults.switches = Switch(0)
            wrong |= pilot.now.faults & ~Fault.EMERGENCY_STOP
            pilot.start(0.0, 0.0, 0.02)
        pilot.follow(pilot.target or (0.0, 0.0), 0.1)
        if mode == "pushed" and pilot.now.faults & (Fault.STALL | Fault.DIRECTION):
            # Held back, a slow wheel is stuck: true, and no runaway.
            twin.faults.push_force, pilot.target = 0.0, None
            stuck += 1
            pilot.run(1.0)
            wrong |= pilot.now.faults & ~Fault.LINK
            pilot.start(0.0, 0.0, 0.02)
        wrong |= pilot.now.faults
    if mode == "pushed":
        wrong &= ~(Fault.STALL | Fault.DIRECTION)
    return {"faults": (wrong, 0), "held_back_times": (stuck, None)}


# 90 counts a turn: 11.5 mm each; smoother and softer, as one tunes it for them.
COARSE = ChairSettings(
    drive=DriveGeometry(counts_per_metre=90 / (2 * math.pi * RADIUS)),
    motor=MotorSettings(filter_time=0.1, kp=20.0, ki=120.0),
)
LOW = ChairSettings(battery=BatterySettings(initial_charge=0.15))
CHAIRS = {"no fault: 90 counts a turn": COARSE, "no fault: battery at 15 %": LOW}

Case = tuple[Callable, float, float, str]
CASES: dict[str, Case] = {
    "runaway, host, 0.5 m/s, level": (runaway, 0.5, 0.0, "host"),
    "runaway, host, 0.5 m/s, 8 deg down": (runaway, 0.5, STEEP, "host"),
    "runaway, host, 0.8 m/s, level": (runaway, 0.8, 0.0, "host"),
    "runaway, host, 0.8 m/s, 8 deg down": (runaway, 0.8, STEEP, "host"),
    "runaway, host at rest, 8 deg": (runaway, 0.0, STEEP, "host"),
    "runaway, dead-man let go, 0.4 m/s, 8 deg down": (runaway, 0.4, STEEP, "manual"),
    "runaway, host killed, 0.8 m/s, 8 deg down": (runaway, 0.8, STEEP, "stopping"),
    "motors swapped": (wired_wrong, 0.0, 0.0, "swapped"),
    "a motor inverted": (wired_wrong, 0.0, 0.0, "inverted"),
    "zero asked on 2 to 8 deg": (creep, 0.0, 0.0, ""),
    "weak brakes, parked, 8 deg": (weak_brakes, 0.0, STEEP, "parked"),
    "weak brakes, host gone, 8 deg": (weak_brakes, 0.0, STEEP, "gone"),
    "joystick takes over, 0.8 m/s": (take_over, 0.8, 0.0, "takes over"),
    "dead-man let go off centre, 0.4 m/s": (take_over, 0.4, 0.0, "lets go"),
    "strips": (strips, 0.0, 0.0, ""),
    "EEPROM damaged": (store, 0.0, 0.0, ""),
    "no fault: slopes to 8 deg": (edges, 0.0, 0.0, "slopes"),
    "no fault: pushed by 250 N": (edges, 0.0, 0.0, "pushed"),
    "no fault: 90 counts a turn": (edges, 0.0, 0.0, ""),
    "no fault: battery at 15 %": (edges, 0.0, 0.0, "slopes"),
}


def trial(name, number):
    rng = np.random.default_rng([list(CASES).index(name), number])
    pilot = Ride(rng, CHAIRS.get(name, ChairSettings()))
    act, *given = CASES[name]
    try:
        return act(pilot, pilot.twin, rng, *given)
    finally:
        pilot.twin.close()


if __name__ == "__main__":
    sys.exit(measure(CASES, trial, __doc__))

"""Stops from full speed after each fault: time to notice, time to rest, distance.

`python -m tests.benchmarks.stops [trials] [cause ...]`: a table on stdout, then the same as JSON;
100 trials of each cause. The hardware chair drives the emulated boards in simulated time, so that
times and ways are the same on any machine. Each trial has a mass and a moment of its own. Exit code
1: a bound was passed.
"""

import sys
from dataclasses import dataclass

import numpy as np

from tests.benchmarks.bounds import measure
from tests.hardware.hosted import Hosted
from tests.sim.worlds import box
from wheelchair_gym.hardware.boards.protocol import Switch
from wheelchair_gym.hardware.settings import HardwareSettings
from wheelchair_gym.sim.settings import BodySettings, ChairSettings

TOP = 0.8  # m/s
MASSES = (100.0, 180.0)  # kg: ISO 7176-11 dummies
PERIOD = 0.1  # s
DECELERATION = 1.5  # m/s2, at least, once it is noticed
RISE = 0.06  # s that motors and brakes take to bring it about: 40 V at 180 kg
SHED = 0.9  # of the duty before: less is a stop
GIVEN_UP = 5.0  # s
RUN = 0.005  # s, of the board's control
# s from a set point that falls to a duty that is seen to: a run takes up to 3 ms, a step 1 ms.
SEEN = 0.004
LIMITS = HardwareSettings().limits


def kill(hosted):
    """SIGKILL: nothing more is said."""
    hosted.clock.guards[:] = [g for g in hosted.clock.guards if g.call.__name__ == "look_on"]


def blind(hosted):
    hosted.twin.faults.disconnected_encoders[hosted.twin.steps % 2] = True


# What happens, and within how long [s] it must be noticed.
CAUSES = {
    "host killed": (kill, 0.205 + SEEN),
    "USB unplugged": (lambda h: setattr(h.drive, "plugged", False), 0.205 + SEEN),
    "laser silent": (lambda h: setattr(h.twin.laser, "silent", True), LIMITS.scan + PERIOD),
    "range board silent": (
        lambda h: setattr(h.range, "plugged", False), LIMITS.ultrasonic + PERIOD
    ),
    # `missing`: 10 mm behind half of the aim, then the next run
    "encoder lost": (blind, 0.010 / (0.5 * TOP) + 3 * RUN),
    "emergency stop": (lambda h: setattr(h.twin.faults, "switches", Switch.STOP_PRESSED), 2 * RUN),
    "drive board hung": (lambda h: h.twin.drive.hang(), 0.08),  # watchdog: 60 ms, its own clock
}  # fmt: skip


@dataclass
class Trial:
    noticed_s: float = GIVEN_UP
    rest_s: float = GIVEN_UP
    way_m: float = 0.0
    deceleration: float = 0.0


class Onlooker:
    """Strikes at a moment of its own and looks on every millisecond."""

    def __init__(self, hosted, cause, at):
        self.hosted, self.cause, self.at = hosted, cause, at
        self.trial, self.struck, self.done = Trial(), None, False
        self._duty, self._speed = 0.0, 0.0

    def look_on(self):
        twin = self.hosted.twin
        now, duty = twin.steps * 0.001, sum(map(abs, twin.duty))
        if self.struck is None:
            if now >= self.at - 1e-9:
                self.struck, self._duty, self._speed = now, duty, abs(twin.motion.speed)
                self.cause(self.hosted)
            return
        elapsed, speed = now - self.struck, abs(twin.motion.speed)
        trial = self.trial
        if trial.rest_s < GIVEN_UP:
            return
        trial.way_m += 0.001 * speed
        stopping = not twin.enabled or twin.braked or duty < SHED * self._duty
        if trial.noticed_s == GIVEN_UP and stopping:
            trial.noticed_s = elapsed
        if speed < 1e-3:
            trial.rest_s = elapsed
            trial.deceleration = self._speed / max(1e-3, elapsed - trial.noticed_s)


def stop(name, number):
    cause, noticed = CAUSES[name]
    rng = np.random.default_rng([list(CAUSES).index(name), number])
    chair = ChairSettings(body=BodySettings(mass=float(rng.uniform(*MASSES))))
    hosted = Hosted(box(50.0), chair=chair, period=PERIOD)
    hosted.chair.reset(None, 0)
    target = np.array([TOP, 0.0])
    hosted.drive_for(30, target)
    at = hosted.clock.now() + 0.2 + round(float(rng.uniform(0.0, PERIOD)), 3)
    onlooker = Onlooker(hosted, cause, at)
    hosted.clock.call_every(onlooker.look_on, 0.001, "onlooker")
    trial, end = onlooker.trial, at + GIVEN_UP
    while trial.rest_s == GIVEN_UP and hosted.clock.now() < end:
        if onlooker.struck is not None and cause is kill:
            hosted.clock.wait(hosted.clock.now() + PERIOD)
        else:
            hosted.chair.drive(target)
    hosted.clock.wait(hosted.clock.now() + 0.3)
    braked = hosted.twin.braked
    hosted.close()
    return {
        "noticed_ms": (1e3 * trial.noticed_s, 1e3 * noticed),
        "rest_ms": (1e3 * trial.rest_s, 1e3 * (noticed + RISE + TOP / DECELERATION)),
        "way_m": (trial.way_m, TOP * (noticed + RISE) + TOP**2 / (2 * DECELERATION)),
        "min_deceleration": (trial.deceleration, DECELERATION),
        "missed": (not braked, 0),
    }


if __name__ == "__main__":
    sys.exit(measure(CAUSES, stop, __doc__))

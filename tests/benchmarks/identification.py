"""Hidden chairs that `wheelchair fit` must identify: a Latin hypercube, drawn before the fit was.

Only this program reads what is hidden; the fit sees logs alone. `python -m
tests.benchmarks.identification [--boards] [FIRST LAST]` prints, of each of these chairs (simulated,
or the emulated boards), which quantities were found within their limits, and then the errors.
"""

import dataclasses
import math
import sys
import time
from typing import Any, Final

import numpy as np
from scipy.stats import qmc

from tests.identification import drives
from wheelchair_gym.envs import EnvSettings
from wheelchair_gym.hardware.settings import HardwareSettings
from wheelchair_gym.hardware.twin.inprocess import TwinChair
from wheelchair_gym.hardware.twin.lockstep import Twin
from wheelchair_gym.hardware.twin.plant import Plant
from wheelchair_gym.identification.excite import excite, free_floor_env
from wheelchair_gym.identification.fit import Fit, fit
from wheelchair_gym.identification.logs import Drive, DriveLog
from wheelchair_gym.identification.predict import predict
from wheelchair_gym.sim.randomization import exactly
from wheelchair_gym.sim.settings import BatterySettings, ChairSettings
from wheelchair_gym.sim.settings import PhysicsSettings as Physics

SEED: Final = 66_2411  # of the hypercube
CHAIRS: Final = 24
# Hidden quantities and their bounds; rows of `chair.randomization`, except the first.
HIDDEN: Final[dict[str, tuple[float, float]]] = {
    "delay": (0.0, 0.09),  # s: of the scans' stamps
    "laser.sigma": (0.008, 0.025),
    "laser.x_error": (-0.05, 0.05),
    "laser.y_error": (-0.05, 0.05),
    "laser.yaw_error": (-math.radians(3.0), math.radians(3.0)),
    "laser.offset_error": (-0.04, 0.04),
    "odometry.scale_error": (-0.01, 0.01),
    "odometry.diameter_error": (-0.02, 0.02),
    "odometry.track_error": (-0.03, 0.03),
    "body.mass": (90.0, 220.0),
    "motor.gain": (0.8, 1.2),
}
SLOPES: Final = {2: 1.0, 7: 1.5, 13: 2.0, 19: 3.0}  # deg, of these chairs' floors
WEAK_BATTERIES: Final = {4: 0.1, 9: 0.15, 15: 0.2, 22: 0.25}  # charge of these chairs


def hidden_chair(number: int) -> dict[str, float]:
    """Hidden values of one of the chairs: those of HIDDEN, `slope` [rad] and `charge`."""
    draws = qmc.LatinHypercube(len(HIDDEN), seed=SEED).random(CHAIRS)[number]
    found: dict[str, Any] = {
        name: float(low + share * (high - low))
        for share, (name, (low, high)) in zip(draws, HIDDEN.items(), strict=True)
    }
    found["slope"] = math.radians(SLOPES.get(number, 0.0))
    found["downhill"] = float(np.random.default_rng(SEED + number).uniform(-math.pi, math.pi))
    found["charge"] = WEAK_BATTERIES.get(number, 0.9)
    return found


# Greatest errors, absolute or relative, of a quantity that counts as found.
LIMITS: Final = {
    "scale": 1e-3, "wheel_ratio": 5e-4, "track": 1e-3, "x": 3e-3, "y": 3e-3,
    "yaw": math.radians(0.1), "offset": 6e-3, "delay": 0.01,
}  # fmt: skip
RELATIVE: Final = {"sigma": 0.1, "gain/(R m)": 0.03}


def drive_boards(hidden: dict[str, float]) -> DriveLog:
    """Drive the emulated boards of a hidden chair by the program of `wheelchair hardware`."""
    battery = BatterySettings(initial_charge=hidden["charge"])
    chair = ChairSettings(randomization=exactly(hidden), battery=battery)
    odometry = dataclasses.replace(drives.SENSORS.odometry, diameter_error=0.0, track_error=0.0)
    sensors = dataclasses.replace(drives.SENSORS, odometry=odometry)
    floor = Physics(slope=hidden["slope"], downhill=hidden["downhill"])
    twin = Twin(Plant(chair, sensors, floor), believed=drives.CHAIR)
    twin.reset(drives.room(), 5)
    twin.laser.delay = round(1e3 * hidden["delay"])
    hosted = TwinChair(twin, 0.1, HardwareSettings(), (drives.CHAIR, drives.SENSORS))
    host = hosted.chair
    hosted.clock.call_every(lambda: host.waiting_for and host.rearm(), 0.05, "person")
    host.on_wait = lambda line: None
    try:
        config = EnvSettings(rate=10.0, chair=drives.CHAIR, sensors=drives.SENSORS)
        return excite(free_floor_env(config, host))
    finally:
        hosted.close()
        twin.close()


def score(found: Fit, hidden: dict[str, float]) -> dict[str, tuple[float, bool, bool]]:
    """Error, whether it is within its limit, and whether the interval covers the truth."""
    true, told = drives.truth(hidden), {one.name: one for one in found.findings}
    scores = {}
    for name, limit in {**LIMITS, **RELATIVE}.items():
        one = told[name]
        if one.value is None or one.low is None or one.high is None:
            scores[name] = math.inf, False, False
            continue
        error = one.value - true[name]
        error = error / true[name] if name in RELATIVE else error
        good = abs(error) <= limit and one.status == "measured"
        scores[name] = error, good, one.low <= true[name] <= one.high
    return scores


def main(words: list[str]) -> None:
    boards = "--boards" in words
    numbers = [int(word) for word in words if word.isdigit()] or [0, CHAIRS - 1]
    scores, held = [], []
    for number in range(numbers[0], numbers[-1] + 1):
        hidden = hidden_chair(number)
        begun = time.process_time()
        log = drive_boards(hidden) if boards else drives.drive(hidden).log
        driven = time.process_time()
        found = fit([("drive", log)], drives.CHAIR, drives.SENSORS)
        scores.append(score(found, hidden))
        held.append([] if boards else held_out(found, hidden))
        missed = [name for name, (_, good, _) in scores[-1].items() if not good]
        print(
            f"{number:2}  missed: {', '.join(missed) or 'none'}  notes: {len(found.notes)}  "
            f"drive {driven - begun:.1f} s, fit {time.process_time() - driven:.1f} s of processor",
            flush=True,
        )
    print(f"{'quantity':12} {'median':>10} {'worst':>10} {'found':>8} {'covered':>8}")
    for name in scores[0]:
        errors = np.abs([each[name][0] for each in scores])
        good, covered = (np.mean([each[name][k] for each in scores]) for k in (1, 2))
        print(
            f"{name:12} {np.median(errors):10.5f} {errors.max():10.5f} {good:8.0%} {covered:8.0%}"
        )
    if not boards:
        print("held out, 95th percentile of the position after 5 s [mm]: median, worst")
        fitted, true, before = 1e3 * np.transpose(held)
        for name, values in (("fitted", fitted), ("true", true), ("before", before)):
            print(f"{name:14} {np.median(values):8.1f} {values.max():8.1f}")
        print(f"fitted / true  {np.median(fitted / true):8.2f} {(fitted / true).max():8.2f}")


def true_settings(hidden: dict[str, float]) -> ChairSettings:
    true, believed = drives.truth(hidden), drives.CHAIR
    drive = dataclasses.replace(
        believed.drive,
        counts_per_metre=believed.drive.counts_per_metre / true["scale"],
        wheel_radius=believed.drive.wheel_radius * true["scale"],
        wheel_ratio=true["wheel_ratio"],
        track=true["track"],
    )
    return dataclasses.replace(
        believed,
        drive=drive,
        body=dataclasses.replace(believed.body, mass=hidden["body.mass"]),
        motor=dataclasses.replace(believed.motor, gain=hidden["motor.gain"]),
        battery=BatterySettings(initial_charge=hidden["charge"]),
    )


def held_out(found: Fit, hidden: dict[str, float]) -> list[float]:
    """Errors of the position [m] after 5 s in another drive: fitted, true, believed settings."""
    believed, true = drives.CHAIR, true_settings(hidden)
    level = hidden | {"slope": 0.0}
    log = drives.drive(level, drives.room((0.6, -0.7, 1.57)), 7).log
    held = Drive("held out", log, believed, drives.SENSORS)
    of = (found.chair, found.sensors), (true, found.sensors), (believed, drives.SENSORS)
    return [each[-1].position[1] for each in predict(held, of)]


if __name__ == "__main__":
    main(sys.argv[1:])

"""Encoder counts per metre: a straight run, measured by the wheels' counts and by laser or tape.

The laser needs a flat wall ahead, whose distance from the axle's centre changes with the run. The
ratio of both distances corrects the counts per metre of the chair's odometry.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.geometry.planar import relative_pose, wrap_angle
from wheelchair_gym.hardware.boards.senses import BoardSensors
from wheelchair_gym.hardware.chair import HardwareChair
from wheelchair_gym.hardware.control_loop import Clock
from wheelchair_gym.perception.occupancy import read_scan

SPEED = 0.15  # m/s by odometry: 1.5 with a tenth of the true counts per metre, 0.5 at SLOW
SLOW = 0.05  # m/s for the first FEEL metres, after which the laser shows the true speed
FEEL = 0.05  # m
ROOM = 0.6  # m that stay free ahead of the footprint,
HALF = 0.1  # m and beside it
NEAR = 0.4  # m: the laser's noise matters in shorter runs
TIMES = 10.0  # greatest ratio of counted and measured distance
ASKEW = 0.02  # greatest relative difference of the wheels' travel
SPREAD = 0.02  # greatest relative difference between runs
_SCANS, _PATIENCE = 10, 3.0  # scans of a wall, and s for them
_FAN = math.radians(12.0)  # to each side of ahead
_FLAT = 0.02  # m: root mean square distance of echoes from a wall; the laser's noise is 15 mm
_SHARE = 0.7  # least share of echoes on the wall
_TURNED = math.radians(25.0)  # greatest angle between heading and wall normal
_SECONDS = 60.0  # s for a run


class Wall(NamedTuple):
    """A wall ahead, in the chair's frame."""

    distance: float  # m, of the axle's centre from it
    bearing: float  # rad, of its foot


class Run(NamedTuple):
    """A straight run."""

    odometry: float  # m
    measured: float  # m


class Distance(NamedTuple):
    """The result of runs."""

    counts_per_metre: float  # mean
    deviation: float  # standard deviation of one run; 0 of a single one
    before: float  # of the present odometry
    runs: tuple[Run, ...]


def calibrate_distance(runs: Sequence[Run], believed: float) -> Distance:
    """Counts per metre.

    Args:
        runs: at least one.
        believed: counts per metre of the runs' odometry.

    Raises:
        ValueError: a run is implausible, or they differ by more than `SPREAD`.
    """
    for run in runs:
        if not (math.isfinite(run.measured) and run.measured > 0.0):
            raise ValueError(f"a distance of {run.measured:g} m was measured; expected more than 0")
        if run.odometry < NEAR / TIMES or not 1.0 / TIMES <= run.odometry / run.measured <= TIMES:
            raise ValueError(
                f"{run.measured:.3f} m were measured and {run.odometry:.3f} m counted: more than "
                f"{TIMES:g} times apart; look at the encoders and their wires, then measure again"
            )
    each = np.array([believed * run.odometry / run.measured for run in runs])
    mean, spread = float(each.mean()), float((each.max() - each.min()) / each.mean())
    if spread > SPREAD:
        raise ValueError(
            f"the runs differ by {spread:.1%} ({each.min():.0f} to {each.max():.0f} counts/m); "
            f"expected {SPREAD:.0%}: does a wheel slip, is the wall flat, the tape straight?"
        )
    deviation = float(each.std(ddof=1)) if len(each) > 1 else 0.0
    return Distance(mean, deviation, believed, tuple(runs))


def fit_wall(echoes: Array) -> Wall:
    """The wall that echoes (n, 2) [m] ahead lie on.

    Raises:
        ValueError: they do not lie on one.
    """
    if len(echoes) < 20:
        raise ValueError("the laser sees no wall ahead: face a flat one, or use a tape (--tape)")
    x, y = echoes.T
    near = np.abs(x - np.median(x)) < 1.0
    for _ in range(8):
        slope, start = np.polyfit(y[near], x[near], 1)
        off = np.abs(x - start - slope * y) / math.hypot(1.0, slope)
        near = off < max(3.0 * _FLAT, 2.0 * float(np.median(off)))
        near = near & (off < 3.0 * _FLAT) if (off < 3.0 * _FLAT).sum() >= 20 else near
    rms = float(np.sqrt(np.mean(off[near] ** 2)))
    if near.mean() < _SHARE or rms > _FLAT:
        raise ValueError("the laser finds no flat wall ahead: face one, or use a tape (--tape)")
    bearing = -math.atan(slope)
    if abs(bearing) > _TURNED:
        raise ValueError(
            f"the wall ahead is turned by {math.degrees(bearing):.0f} deg; expected to face it "
            f"within {math.degrees(_TURNED):.0f} deg"
        )
    return Wall(float(start) * math.cos(bearing), bearing)


def measure_wall(senses: BoardSensors, clock: Clock, poll: Callable[[], object]) -> Wall:
    """The wall ahead of a chair at rest.

    Args:
        senses: its lines.
        clock: real or simulated time.
        poll: reads the lines, if no chair does.

    Raises:
        ValueError: there is none, or too few scans come.
    """
    echoes: list[Array] = []
    seen, end = senses.stamp_of("scan"), clock.now() + _PATIENCE
    while len(echoes) < _SCANS:
        if clock.now() > end:
            raise ValueError("the laser is silent")
        clock.wait(clock.now() + 0.005)
        poll()
        if (stamp := senses.stamp_of("scan")) > seen:
            seen = stamp
            echoes.append(echoes_ahead(senses, senses.ranges(clock.now())[0]))
    return fit_wall(np.concatenate(echoes))


def echoes_ahead(senses: BoardSensors, ranges: NDArray[np.float32]) -> Array:
    """Echoes (n, 2) within a fan ahead, in the chair's frame."""
    laser = senses.sensors.laser
    echoes = read_scan(laser, ranges[: laser.beams]).echoes
    aside = np.arctan2(echoes[:, 1] - laser.y, echoes[:, 0] - laser.x)
    ahead: Array = echoes[np.abs(aside) <= _FAN]
    return ahead


def distance_moved(before: Wall, after: Wall, pose: Array) -> float:
    """Distance [m] that a chair moved to a pose (3,) by odometry, by the wall before and after."""
    counted = math.hypot(pose[0], pose[1])
    if counted < 1e-6:
        raise ValueError("the wheels did not turn, or nothing was counted")
    if abs(float(wrap_angle(before.bearing - after.bearing))) > _TURNED:
        raise ValueError("it turned during the run; expected a straight one")
    along = (pose[0] * math.cos(before.bearing) + pose[1] * math.sin(before.bearing)) / counted
    return abs(float((before.distance - after.distance) / along))


def check_straight(travel: Array) -> None:
    """Check that wheels that travel (2,) [m] left and right made a straight run.

    Raises:
        ValueError: they did not.
    """
    left, right = travel.tolist()
    if abs(left - right) > ASKEW * max(abs(left), abs(right)) + 0.01:
        raise ValueError(
            f"the left wheel counted {left:.3f} m and the right {right:.3f} m; expected a straight "
            "run: is an encoder loose, do tyres differ?"
        )


def drive_run(
    chair: HardwareChair, distance: float, back: bool, measured: Callable[[float], float] | None
) -> Run:
    """Drive a straight run, once a person has re-armed the chair.

    The run ends after the distance, by the laser or by the counts, or `ROOM` before an obstacle.

    Args:
        chair: faces a wall, with free space ahead.
        distance: [m].
        back: backwards, over the ground of the run before.
        measured: asks a person for the distance [m] by tape, given that by the counts; None: the
            laser measures it.

    Raises:
        InputError: the chair does not get ready.
        ValueError: the chair stopped before the end, there is no wall or too little free space, or
            the run was not straight.
    """
    reading = chair.reset()
    senses, clock = chair.senses, chair.clock
    start, (_, travel) = reading.pose, senses.odometer.at(clock.now())
    wall = measure_wall(senses, clock, lambda: None) if measured is None else None
    gap = _gap(chair, reading.laser) - ROOM
    if not back and gap < min(distance, NEAR):
        raise ValueError(
            f"{max(0.0, gap + ROOM):.2f} m are free ahead; expected at least "
            f"{min(distance, NEAR) + ROOM:.2f} m"
        )
    begun, sign, done = clock.now(), -1.0 if back else 1.0, 0.0
    while True:
        pose = relative_pose(start, reading.pose)
        counted = abs(float(pose[0]))
        if wall is not None:
            done = sign * (wall.distance - _nearest(senses, reading.laser, wall))
        moved = counted if wall is None else done
        if moved >= distance or counted >= TIMES * distance:
            break
        if not back and _gap(chair, reading.laser) < ROOM:
            break
        if clock.now() - begun > _SECONDS:
            raise ValueError(f"{distance:g} m were not done within {_SECONDS:g} s")
        fast = SPEED if moved > FEEL else SLOW
        if wall is not None and counted > 1e-3 and done > FEEL:
            fast *= min(2.0, counted / done)  # to the true speed
        turn = -2.0 * float(wrap_angle(pose[2])) - sign * 1.0 * float(pose[1])
        reading = chair.drive(np.array([sign * fast, max(-0.1, min(0.1, turn))]))
        if reading.halted:
            raise ValueError(f"the run was not driven to its end: {reading.halted}")
    for _ in range(10):
        reading = chair.drive(np.zeros(2))
    check_straight(senses.odometer.at(clock.now())[1] - travel)
    pose = relative_pose(start, reading.pose)
    counted = math.hypot(pose[0], pose[1])
    if wall is None:
        assert measured is not None
        return Run(counted, measured(counted))
    return Run(counted, distance_moved(wall, measure_wall(senses, clock, lambda: None), pose))


def _gap(chair: HardwareChair, ranges: NDArray[np.float32]) -> float:
    """Free space [m] ahead of the footprint; 0 without valid ranges."""
    if not np.isfinite(ranges).any():
        return 0.0
    (front, _, half), laser = chair.chair.footprint.array, chair.sensors.laser
    echoes = read_scan(laser, ranges[: laser.beams]).echoes
    ahead = echoes[(np.abs(echoes[:, 1]) < half + HALF) & (echoes[:, 0] > front)]
    return float(ahead[:, 0].min(initial=laser.reach) - front)


def _nearest(senses: BoardSensors, ranges: NDArray[np.float32], wall: Wall) -> float:
    """The distance [m] of a wall from the axle's centre, roughly, by one scan."""
    x, y = echoes_ahead(senses, ranges).T
    if len(x) == 0:
        return wall.distance
    return float(np.median(x * math.cos(wall.bearing) + y * math.sin(wall.bearing)))

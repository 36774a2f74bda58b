"""Counts of a metre: a straight way, by the counts of the wheels and by laser or tape.

The laser needs a flat wall ahead: how far the axle's centre came is what the wall came nearer. The
way by the counts is reckoned with the counts per metre that the chair believes, which the ratio of
the two corrects.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.geometry import relative_pose, wrap_angle
from wheelchair_gym.hardware.boards.senses import BoardSensors
from wheelchair_gym.hardware.chair import HardwareChair
from wheelchair_gym.hardware.control_loop import Clock
from wheelchair_gym.localization.occupancy import read_scan

Array = NDArray[np.float64]

SPEED = 0.15  # m/s as the chair believes: with a tenth of its counts it would be 1.5, at SLOW 0.5
SLOW = 0.05  # m/s for the first FEEL metres, which tell by the laser how fast it really is
FEEL = 0.05  # m
ROOM = 0.6  # m that stay free ahead of the footprint, and at its sides HALF
HALF = 0.1  # m
LEAST = 0.4  # m of way, below which the laser's noise would count
TIMES = 10.0  # most that counted and measured may differ: beyond, something else is wrong
ASKEW = 0.02  # share that one wheel may roll further than the other
SPREAD = 0.02  # share that runs may differ
_SCANS, _PATIENCE = 10, 3.0  # scans of a wall, and s for them
_FAN = math.radians(12.0)  # to each side of ahead
_FLAT = 0.02  # m: root mean square of echoes about a wall; the laser's noise is 15 mm
_SHARE = 0.7  # of echoes that must lie on it
_TURNED = math.radians(25.0)  # most that it may be turned from facing the chair
_SECONDS = 60.0  # for a run


class Wall(NamedTuple):
    """A wall ahead, in the chair's frame."""

    distance: float  # m, of the axle's centre from it
    bearing: float  # rad, of its foot


class Run(NamedTuple):
    """A straight way."""

    odometry: float  # m, as the chair believes
    measured: float  # m


class Distance(NamedTuple):
    """What runs told."""

    counts_per_metre: float  # mean
    deviation: float  # standard deviation of one run; 0 of a single one
    before: float  # what was believed
    runs: tuple[Run, ...]


def calibrate_distance(runs: Sequence[Run], believed: float) -> Distance:
    """Counts of a metre.

    Args:
        runs: at least one.
        believed: counts of a metre by which ways were counted.

    Raises:
        ValueError: a run is implausible, or they differ by more than `SPREAD`.
    """
    for run in runs:
        if not (math.isfinite(run.measured) and run.measured > 0.0):
            raise ValueError(f"a way of {run.measured:g} m was measured; expected more than 0")
        if run.odometry < LEAST / TIMES or not 1.0 / TIMES <= run.odometry / run.measured <= TIMES:
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
        raise ValueError(
            "what the laser sees ahead is no flat wall: face one, or use a tape (--tape)"
        )
    bearing = -math.atan(slope)
    if abs(bearing) > _TURNED:
        raise ValueError(
            f"the wall ahead is turned by {math.degrees(bearing):.0f} deg; expected to face it "
            f"within {math.degrees(_TURNED):.0f} deg"
        )
    return Wall(float(start) * math.cos(bearing), bearing)


def measure_wall(senses: BoardSensors, clock: Clock, poll: Callable[[], object]) -> Wall:
    """The wall ahead of a chair that stands.

    Args:
        senses: its lines.
        clock: whose time it is.
        poll: takes in what has come, where nobody else does.

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
            echoes.append(_ahead(senses, senses.ranges(clock.now())[0]))
    return fit_wall(np.concatenate(echoes))


def _ahead(senses: BoardSensors, ranges: NDArray[np.float32]) -> Array:
    """Echoes (n, 2) within a fan ahead, in the chair's frame."""
    laser = senses.sensors.laser
    echoes = read_scan(laser, ranges, 0.0).echoes
    aside = np.arctan2(echoes[:, 1] - laser.y, echoes[:, 0] - laser.x)
    ahead: Array = echoes[np.abs(aside) <= _FAN]
    return ahead


def distance_moved(before: Wall, after: Wall, pose: Array) -> float:
    """How far [m] a chair came whose wheels say (3,) that it came to a pose, by a wall."""
    way = math.hypot(pose[0], pose[1])
    if way < 1e-6:
        raise ValueError("the wheels did not turn, or nothing was counted")
    if abs(float(wrap_angle(before.bearing - after.bearing))) > _TURNED:
        raise ValueError("it turned on its way; expected a straight one")
    along = (pose[0] * math.cos(before.bearing) + pose[1] * math.sin(before.bearing)) / way
    return abs(float((before.distance - after.distance) / along))


def check_straight(ways: Array) -> None:
    """Refuse ways (2,) [m] of left and right wheel that are not those of a straight run.

    Raises:
        ValueError: they are not.
    """
    left, right = ways.tolist()
    if abs(left - right) > ASKEW * max(abs(left), abs(right)) + 0.01:
        raise ValueError(
            f"the left wheel counted {left:.3f} m and the right {right:.3f} m; expected a straight "
            "way: is an encoder loose, do tyres differ?"
        )


def drive_run(
    chair: HardwareChair, way: float, back: bool, measured: Callable[[float], float] | None
) -> Run:
    """Drive a straight way; a person re-arms first, where it is not armed.

    It ends after the way, by the laser as well as by the counts, or `ROOM` before what is ahead.

    Args:
        chair: faces a wall; what is ahead of it is free.
        way: [m].
        back: backwards: over a way that it has just come.
        measured: asks for the way [m] by tape, told what was counted; None: the laser tells.

    Raises:
        InputError: the chair does not get ready.
        ValueError: it was stopped under way, there is no wall or no room, or it was not straight.
    """
    reading = chair.reset(None, 0)  # type: ignore[arg-type]
    senses, clock = chair.senses, chair.clock
    start, (_, ways) = reading.pose, senses.odometer.at(clock.now())
    wall = measure_wall(senses, clock, lambda: None) if measured is None else None
    gap = _gap(chair, reading.laser) - ROOM
    if not back and gap < min(way, LEAST):
        raise ValueError(
            f"{max(0.0, gap + ROOM):.2f} m are free ahead; expected at least "
            f"{min(way, LEAST) + ROOM:.2f} m"
        )
    begun, sign, done = clock.now(), -1.0 if back else 1.0, 0.0
    while True:
        pose = relative_pose(start, reading.pose)
        counted = abs(float(pose[0]))
        if wall is not None:
            done = sign * (wall.distance - _nearest(senses, reading.laser, wall))
        if done >= way or (wall is None and counted >= way) or counted >= TIMES * way:
            break
        if not back and _gap(chair, reading.laser) < ROOM:
            break
        if clock.now() - begun > _SECONDS:
            raise ValueError(f"{way:g} m were not done within {_SECONDS:g} s")
        fast = SPEED if max(done, 0.0 if wall is not None else counted) > FEEL else SLOW
        if wall is not None and counted > 1e-3 and done > FEEL:
            fast *= min(2.0, counted / done)  # it is faster or slower than it believes
        turn = -2.0 * float(wrap_angle(pose[2])) - sign * 1.0 * float(pose[1])
        reading = chair.drive(np.array([sign * fast, max(-0.1, min(0.1, turn))]))
        if reading.halted:
            raise ValueError(f"the way was not driven to its end: {reading.halted}")
    for _ in range(10):
        reading = chair.drive(np.zeros(2))
    check_straight(senses.odometer.at(clock.now())[1] - ways)
    pose = relative_pose(start, reading.pose)
    counted = math.hypot(pose[0], pose[1])
    if wall is None:
        assert measured is not None
        return Run(counted, measured(counted))
    return Run(counted, distance_moved(wall, measure_wall(senses, clock, lambda: None), pose))


def _gap(chair: HardwareChair, ranges: NDArray[np.float32]) -> float:
    """How much [m] is free ahead of the footprint; 0 where the laser tells nothing."""
    if not np.isfinite(ranges).any():
        return 0.0
    front, _, half = chair.chair.footprint.array
    echoes = read_scan(chair.sensors.laser, ranges, 0.0).echoes
    ahead = echoes[(np.abs(echoes[:, 1]) < half + HALF) & (echoes[:, 0] > front)]
    return float(ahead[:, 0].min(initial=chair.sensors.laser.reach) - front)


def _nearest(senses: BoardSensors, ranges: NDArray[np.float32], wall: Wall) -> float:
    """About how far [m] a wall is from the axle's centre, by one scan."""
    x, y = _ahead(senses, ranges).T
    if len(x) == 0:
        return wall.distance
    return float(np.median(x * math.cos(wall.bearing) + y * math.sin(wall.bearing)))

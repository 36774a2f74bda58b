"""Particles that may be where a chair is: moved, weighed, counted, drawn anew; as kernels.

Every draw is by counter (`sensing.noise`): what a chair believes depends on its key and on what it
was told, on nothing else.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.geometry import wrap
from wheelchair_gym.kernel import borrowing_kernel, whole
from wheelchair_gym.kinematics import odometric_step
from wheelchair_gym.mapping.field import Field, log_likelihood
from wheelchair_gym.sensing.noise import normal, uniform

Array = NDArray[np.float64]

MOVES, DRAWS, PLACES = range(3)  # channels of a localiser's own key


class Particles(NamedTuple):
    """Room for as many particles as there may be, and for counting them."""

    poses: Array  # (most, 3) m, m, rad
    logs: Array  # (most,) logarithm of each one's weight
    weights: Array  # (most,) their sum is 1
    spare: Array  # (most, 3) where the next ones are drawn to
    names: NDArray[np.int64]  # (2 ** k,) bins by hash, with 0 for none
    loads: Array  # (2 ** k,) weight in each


class Drift(NamedTuple):
    """How odometry errs: standard deviations over a step."""

    way_by_way: float  # m/m
    way_by_turn: float  # m/rad
    turn_by_way: float  # rad/m
    turn_by_turn: float  # rad/rad
    aside: float  # m/m, of a slide sideways


def new_particles(most: int) -> Particles:
    """Room for so many."""
    bins = 2 ** math.ceil(math.log2(4 * most))
    return Particles(
        np.zeros((most, 3)),
        np.zeros(most),
        np.zeros(most),
        np.zeros((most, 3)),
        np.zeros(bins, np.int64),
        np.zeros(bins),
    )


@borrowing_kernel
def advance(
    poses: Array, n: int, way: float, turn: float, drift: Drift, key: np.uint64, step: int
) -> None:
    """Move n particles by what the odometry says, each with errors of its own."""
    way_sigma = math.hypot(drift.way_by_way * way, drift.way_by_turn * turn)
    turn_sigma = math.hypot(drift.turn_by_way * way, drift.turn_by_turn * turn)
    for i in range(n):
        there = way + way_sigma * normal(key, step, MOVES, 3 * i)
        round_ = turn + turn_sigma * normal(key, step, MOVES, 3 * i + 1)
        aside = drift.aside * abs(way) * normal(key, step, MOVES, 3 * i + 2)
        x, y, yaw = odometric_step(poses[i, 0], poses[i, 1], poses[i, 2], there, round_)
        poses[i, 0] = x - aside * math.sin(yaw)
        poses[i, 1] = y + aside * math.cos(yaw)
        poses[i, 2] = wrap(yaw)


@borrowing_kernel
def weigh(
    own: Particles, n: int, field: Field, ends: Array, sigma: float, astray: float, trust: float
) -> float:
    """Multiply weights by the scan's likelihood; the effective number of particles, 1 / sum w^2.

    Args:
        own: particles; weights change.
        n: how many.
        field: of the map.
        ends: of beams (k, 2) [m] in the chair's frame.
        sigma: see `log_likelihood`.
        astray: see `log_likelihood`.
        trust: for how many beams that err independently the scan counts.
    """
    most = -np.inf
    for i in range(n):
        pose = own.poses[i]
        value = log_likelihood(field, pose[0], pose[1], pose[2], ends, sigma, astray)
        own.logs[i] += trust * value
        most = max(most, own.logs[i])
    total, squares = 0.0, 0.0
    for i in range(n):
        own.logs[i] -= most
        own.weights[i] = math.exp(own.logs[i])
        total += own.weights[i]
    for i in range(n):
        own.weights[i] /= total
        squares += own.weights[i] ** 2
    return 1.0 / squares


@borrowing_kernel
def count_bins(own: Particles, n: int, side: float, sector: float) -> tuple[int, int]:
    """How many bins of place and heading hold particles, and a particle of the heaviest bin.

    Args:
        own: particles.
        n: how many.
        side: of a bin [m].
        sector: of headings [rad].
    """
    names, loads = own.names, own.loads
    for place in range(names.shape[0]):
        names[place], loads[place] = 0, 0.0
    mask, bins, best, heaviest = names.shape[0] - 1, 0, 0, -1.0
    for i in range(n):
        row, col = math.floor(own.poses[i, 0] / side), math.floor(own.poses[i, 1] / side)
        turn = math.floor(own.poses[i, 2] / sector)
        name = whole(((row * 65536 + col) * 512 + turn) * 2 + 1)  # odd: never 0
        place = whole((name * 0x9E3779B97F4A7C1 >> 20) & mask)
        while names[place] != 0 and names[place] != name:
            place = (place + 1) & mask
        if names[place] == 0:
            names[place] = name
            bins += 1
        loads[place] += own.weights[i]
        if loads[place] > heaviest:
            heaviest, best = loads[place], i
    return bins, best


@borrowing_kernel
def redraw(own: Particles, n: int, count: int, key: np.uint64, step: int) -> None:
    """Draw so many anew in proportion to their weights, with one random number (systematic)."""
    offset, total, i = uniform(key, step, DRAWS, 0), own.weights[0], 0
    for k in range(count):
        while total < (k + offset) / count and i < n - 1:
            i += 1
            total += own.weights[i]
        for j in range(3):
            own.spare[k, j] = own.poses[i, j]
    for k in range(count):
        for j in range(3):
            own.poses[k, j] = own.spare[k, j]


@borrowing_kernel
def scatter(
    poses: Array,
    begin: int,
    end: int,
    pose: Array,
    position: float,
    heading: float,
    key: np.uint64,
    step: int,
) -> None:
    """Place particles begin to end - 1 about a pose (3,), with standard deviations [m, rad]."""
    for i in range(begin, end):
        for k in range(3):
            spread = heading if k == 2 else position
            poses[i, k] = pose[k] + spread * normal(key, step, PLACES, 3 * i + k)


@borrowing_kernel
def level(own: Particles, n: int) -> None:
    """Give n particles the same weight."""
    for i in range(n):
        own.logs[i], own.weights[i] = 0.0, 1.0 / n


@borrowing_kernel
def centre(own: Particles, n: int, about: int, reach: float, sector: float, out: Array) -> None:
    """The mean pose (3,) of the particles within a reach [m] and sector [rad] of one of them."""
    x, y, yaw = own.poses[about, 0], own.poses[about, 1], own.poses[about, 2]
    for _ in range(2):
        total, dx, dy, turn = 0.0, 0.0, 0.0, 0.0
        for i in range(n):
            off_x, off_y, off = (
                own.poses[i, 0] - x,
                own.poses[i, 1] - y,
                wrap(own.poses[i, 2] - yaw),
            )
            if off_x * off_x + off_y * off_y <= reach * reach and abs(off) <= sector:
                w = own.weights[i]
                total, dx, dy, turn = total + w, dx + w * off_x, dy + w * off_y, turn + w * off
        if total > 0.0:
            x, y, yaw = x + dx / total, y + dy / total, yaw + turn / total
    out[0], out[1], out[2] = x, y, wrap(yaw)

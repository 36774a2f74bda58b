"""The search for the commands that bridge one segment of a path: whales whose particles drive.

A particle is a list of at most `TRIPLES` commands (v, w, t) and how many of them count (thesis,
section 2.9.3 and algorithm 6). It is rolled out under the chair's limits, and its cost says how
well it serves. Good manoeuvres that can be written down are in the swarm from the beginning.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.draws import Stream, uniform
from planners.rollout import MOTION, Motion, World, brake, drive, time_to_cover
from planners.swarm.woa import Whales, move
from wheelchair_gym.geometry import wrap
from wheelchair_gym.kernel import borrowing_kernel, kernel

Array = NDArray[np.float64]

TRIPLES = 6  # commands in a particle, at most
_SIZE = 3 * TRIPLES + 1  # (v, w, t) of each, then how many count
_SEEDS = 5
# Cost of touching something: above all else that can be wrong with a segment.
_COLLISION = 1e3


class Aims(NamedTuple):
    """What a segment's commands are worth: each term counts in seconds."""

    end: float  # s/m from the segment's end
    heading: float  # s/rad from the direction of the next segment, at rest; more in motion
    time: float  # of the time it takes
    clearance: float  # s where the outline touches, falling to 0 at the comfortable clearance
    comfortable: float  # m


class Leg(NamedTuple):
    """One segment: its end, and where the path goes from there."""

    x: float  # m
    y: float
    onward: float  # rad: direction of the next segment
    last: bool  # the chair comes to rest here


@borrowing_kernel
def perform(motion: Any, particle: Array, world: World) -> None:
    """Drive the commands of a particle that count."""
    for k in range(int(particle[_SIZE - 1])):
        drive(motion, particle[3 * k], particle[3 * k + 1], particle[3 * k + 2], world)


@borrowing_kernel
def cost_of(
    particle: Array, now: Motion, leg: Leg, world: World, aims: Aims, trial: Motion
) -> float:
    """The cost [s] of a particle that begins with the motion `now`; `trial` is room to drive in."""
    trial[:] = now
    motion = trial[0]
    perform(motion, particle, world)
    if leg.last:
        brake(motion, world)
    gap = math.hypot(leg.x - motion.x, leg.y - motion.y)
    cost: float = aims.end * gap + aims.time * (motion.time - now[0].time)
    if not leg.last:
        error = abs(wrap(leg.onward - motion.yaw))
        cost += aims.heading * error * (1.0 + 2.0 * abs(motion.v))
        brake(motion, world)  # whatever follows, the chair can come to rest without touching
    if not motion.free:
        return _COLLISION + cost
    near: float = max(0.0, 1.0 - motion.least / aims.comfortable)
    return cost + aims.clearance * near


@borrowing_kernel
def turn_command(angle: float, limits: Array) -> tuple[float, float]:
    """The command (w, t) that, from rest to rest, turns by an angle [rad]."""
    if abs(angle) < 2e-3:
        return 0.0, 0.0
    # Small angles are turned slowly, so that the speed asked for is reached.
    speed = min(limits[2], math.sqrt(0.5 * abs(angle) * limits[6]))
    t = time_to_cover(abs(angle), speed, limits[6], limits[6], limits[8], True)
    return math.copysign(speed, angle), t


@borrowing_kernel
def seed(kind: int, now: Motion, leg: Leg, world: World, particle: Array, trial: Motion) -> None:
    """Write a manoeuvre that is known to be good where there is room.

    0: come to rest, turn to the segment, drive it straight, come to rest.
    1: the same without the last rest.
    2: one arc to the segment's end, from the present motion.
    3: come to rest, turn the back to the end, drive backward, come to rest.
    4: as 0, and then turn to the next segment.
    """
    limits = world.limits
    particle[:] = 0.0
    trial[:] = now
    motion = trial[0]
    if kind == 2:
        angle = wrap(math.atan2(leg.y - motion.y, leg.x - motion.x) - motion.yaw)
        gap = math.hypot(leg.x - motion.x, leg.y - motion.y)
        speed = limits[0]
        bend = 2.0 * math.sin(angle) / max(gap, 1e-6)
        if abs(bend) * speed > limits[2]:
            speed = limits[2] / abs(bend)
        half = max(1e-3, abs(math.sin(angle)))
        way = gap * (abs(angle) / half if half > 1e-3 else 1.0)
        particle[0], particle[1] = speed, speed * bend
        particle[2] = way / speed + 0.5 * max(0.0, speed - motion.v) / limits[3]
        particle[_SIZE - 1] = 1.0
        return
    k = 0
    if motion.v != 0.0 or motion.w != 0.0:
        particle[2] = brake(motion, world)
        k = 1
    dx, dy = leg.x - motion.x, leg.y - motion.y
    way = math.hypot(dx, dy)
    facing = math.atan2(dy, dx) + (math.pi if kind == 3 else 0.0)
    w, t = turn_command(wrap(facing - motion.yaw), limits)
    if t > 0.0:
        particle[3 * k + 1], particle[3 * k + 2] = w, t
        drive(motion, 0.0, w, t, world)
        particle[3 * k + 5] = brake(motion, world)
        k += 2
    limit = limits[1] if kind == 3 else limits[0]
    if way > 5e-3 and limit > 0.0:
        speed = min(limit, math.sqrt(0.5 * way * limits[3]))
        t = time_to_cover(way, speed, limits[3], limits[4], limits[7], kind != 1)
        particle[3 * k] = -speed if kind == 3 else speed
        particle[3 * k + 2] = t
        drive(motion, particle[3 * k], 0.0, t, world)
        k += 1
        if kind != 1:
            particle[3 * k + 2] = brake(motion, world)
            k += 1
    if kind == 4 and k < TRIPLES:
        w, t = turn_command(wrap(leg.onward - motion.yaw), limits)
        particle[3 * k + 1], particle[3 * k + 2] = w, t
        k += 1
    particle[_SIZE - 1] = max(1, k)


@kernel
def bridge(
    now: Motion, leg: Leg, world: World, aims: Aims, swarm: Whales, state: Stream
) -> tuple[Array, bool]:
    """The commands (k, 3) for one segment, and whether they touch nothing.

    Args:
        now: the motion in which the segment begins.
        leg: the segment.
        world: the chair and its surroundings.
        aims: what the commands are worth.
        swarm: how many whales, how long, how they move.
        state: stream of random numbers.
    """
    limits = world.limits
    gap = math.hypot(leg.x - now[0].x, leg.y - now[0].y)
    lower, upper, span = np.empty(_SIZE), np.empty(_SIZE), np.full(_SIZE, 2.0)
    lower[0::3], upper[0::3] = -limits[1], limits[0]
    lower[1::3], upper[1::3] = -limits[2], limits[2]
    lower[2::3], upper[2::3] = 0.0, 3.0 + 2.0 * gap / limits[0] + math.pi / limits[2]
    lower[_SIZE - 1], upper[_SIZE - 1] = 1.0, TRIPLES + 0.999
    trial = np.zeros(1, MOTION)
    population = np.zeros((max(swarm.population, _SEEDS), _SIZE))
    for i in range(population.shape[0]):
        X = population[i]
        if i < _SEEDS:
            seed(i, now, leg, world, X, trial)
            continue
        X[:] = population[i % _SEEDS]
        for j in range(_SIZE):
            # The duration of a command varies with itself, a speed with its whole range.
            room = X[j] if j % 3 == 2 else upper[j] - lower[j]
            X[j] += 0.3 * room * (2.0 * uniform(state) - 1.0)
            X[j] = min(max(X[j], lower[j]), upper[j])
    best, least = population[0].copy(), np.inf
    for t in range(swarm.iterations + 1):
        for i in range(population.shape[0]):
            cost = cost_of(population[i], now, leg, world, aims, trial)
            if cost < least:
                least = cost
                best[:] = population[i]
        if t < swarm.iterations:
            a = swarm.a * (1.0 - t / swarm.iterations)
            move(population, best, a, swarm.b, swarm.mu, swarm.lam, span, lower, upper, state)
    count = int(best[_SIZE - 1])
    return best[: 3 * count].copy().reshape(count, 3), least < _COLLISION

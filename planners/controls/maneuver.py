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

from planners.controls.rollout import MOTION, STEP, Motion, World, brake, drive, time_to_cover
from planners.swarm.woa import WhaleParameters, move_whales
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.geometry import wrap
from wheelchair_gym.random import Stream, next_uniform

Array = NDArray[np.float64]

TRIPLES = 6  # commands in a particle, at most
_SIZE = 3 * TRIPLES + 1  # (v, w, t) of each, then how many count
_SEEDS = 5
# Cost of touching something: above all else that can be wrong with a segment.
_COLLISION = 1e3


class Aims(NamedTuple):
    """What a segment's commands are worth: each term counts in seconds."""

    end: float  # s/m from the segment's end
    arrival: float  # s/m from the path's end
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
    trial[0] = now[0]
    motion = trial[0]
    perform(motion, particle, world)
    if leg.last:
        brake(motion, world)
    gap = math.hypot(leg.x - motion.x, leg.y - motion.y)
    end = aims.arrival if leg.last else aims.end
    cost: float = end * gap + aims.time * (motion.time - now[0].time)
    if not leg.last:
        error = abs(wrap(leg.onward - motion.yaw))
        cost += aims.heading * error * (1.0 + 2.0 * abs(motion.v))
        brake(motion, world)  # whatever follows, the chair can come to rest without touching
    if not motion.free:
        return _COLLISION + cost
    near: float = max(0.0, 1.0 - motion.least / aims.comfortable)
    return cost + aims.clearance * near


@borrowing_kernel
def stopping_time(speed: float, rate: float, jerk: float) -> float:
    """Time [s] to come to rest from a speed, within a deceleration and a jerk."""
    speed = abs(speed)
    if speed == 0.0:
        return 0.0
    if speed > rate * rate / jerk:
        return speed / rate + rate / jerk + STEP
    return 2.0 * math.sqrt(speed / jerk) + STEP


@borrowing_kernel
def arc(now: Any, leg: Leg, limits: Any, rest: bool, particle: Array) -> None:
    """Write commands that drive an arc to the segment's end, from the present motion."""
    dx, dy = leg.x - now.x, leg.y - now.y
    gap = max(1e-6, math.hypot(dx, dy))
    angle = wrap(math.atan2(dy, dx) - now.yaw)
    sine = math.sin(angle)
    bend = 2.0 * sine / gap
    speed = min(limits.forward, limits.turn / max(abs(bend), 1e-6))
    way = gap * angle / sine if abs(sine) > 1e-3 else gap
    particle[0], particle[1] = speed, speed * bend
    gain = max(0.0, speed - now.v)
    # m, lost while speeding up
    slow = 0.5 * gain * stopping_time(gain, limits.acceleration, limits.jerk)
    particle[_SIZE - 1] = 1.0
    if rest:
        halt = stopping_time(speed, limits.deceleration, limits.jerk)
        slow -= 0.5 * speed * (halt - STEP)
        particle[5] = halt
        particle[_SIZE - 1] = 2.0
    particle[2] = max(0.0, (way + slow) / speed)


@borrowing_kernel
def straight(now: Any, leg: Leg, limits: Any, backward: bool, rest: bool, particle: Array) -> None:
    """Write commands that come to rest, turn towards the segment's end, and drive straight there.

    Args:
        now: the present motion.
        leg: the segment.
        limits: the chair's limits.
        backward: drive with the back first.
        rest: come to rest at the end, too.
        particle: where the commands are written.
    """
    halt_v = stopping_time(now.v, limits.deceleration, limits.jerk)
    halt_w = stopping_time(now.w, limits.turn_acceleration, limits.turn_jerk)
    halt = max(halt_v, halt_w)
    # Where the chair will rest: speeds fall in curves that are symmetric in time.
    run = 0.5 * now.v * max(0.0, halt_v - STEP)
    yaw = now.yaw + 0.5 * now.w * max(0.0, halt_w - STEP)
    x, y = now.x + run * math.cos(now.yaw), now.y + run * math.sin(now.yaw)
    k = 0
    if halt > 0.0:
        particle[2] = halt
        k = 1
    way = math.hypot(leg.x - x, leg.y - y)
    facing = math.atan2(leg.y - y, leg.x - x) + (math.pi if backward else 0.0)
    angle = wrap(facing - yaw)
    if abs(angle) > 2e-3:
        # Small angles are turned slowly, so that the speed asked for is reached.
        speed = min(limits.turn, math.sqrt(0.5 * abs(angle) * limits.turn_acceleration))
        particle[3 * k + 1] = math.copysign(speed, angle)
        rate = limits.turn_acceleration
        duration = time_to_cover(abs(angle), speed, rate, rate, limits.turn_jerk, True)
        particle[3 * k + 2] = duration
        particle[3 * k + 5] = stopping_time(speed, limits.turn_acceleration, limits.turn_jerk)
        k += 2
    limit = limits.backward if backward else limits.forward
    if way > 5e-3 and limit > 0.0:
        speed = min(limit, math.sqrt(0.5 * way * limits.acceleration)) if rest else limit
        particle[3 * k] = -speed if backward else speed
        particle[3 * k + 2] = time_to_cover(
            way, speed, limits.acceleration, limits.deceleration, limits.jerk, rest
        )
        k += 1
        if rest:
            particle[3 * k + 2] = stopping_time(speed, limits.deceleration, limits.jerk)
            k += 1
    particle[_SIZE - 1] = max(1, k)


@borrowing_kernel
def seed(kind: int, now: Any, leg: Leg, limits: Any, particle: Array) -> None:
    """Write one of the manoeuvres that serve well where there is room."""
    particle[:] = 0.0
    if kind <= 1:
        arc(now, leg, limits, kind == 1, particle)
    else:
        straight(now, leg, limits, kind == 4, kind != 2, particle)


@kernel
def bridge(
    now: Motion, leg: Leg, world: World, aims: Aims, swarm: WhaleParameters, state: Stream
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
    lower[0::3], upper[0::3] = -limits.backward, limits.forward
    lower[1::3], upper[1::3] = -limits.turn, limits.turn
    lower[2::3], upper[2::3] = 0.0, 3.0 + 2.0 * gap / limits.forward + math.pi / limits.turn
    lower[_SIZE - 1], upper[_SIZE - 1] = 1.0, TRIPLES + 0.999
    trial = np.zeros(1, MOTION)
    population = np.zeros((max(swarm.population, _SEEDS), _SIZE))
    for i in range(population.shape[0]):
        X = population[i]
        if i < _SEEDS:
            seed(i, now[0], leg, limits, X)
            continue
        X[:] = population[i % _SEEDS]
        for j in range(_SIZE):
            # The duration of a command varies with itself, a speed with its whole range.
            room = X[j] if j % 3 == 2 else upper[j] - lower[j]
            X[j] += 0.3 * room * (2.0 * next_uniform(state) - 1.0)
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
            move_whales(
                population, best, a, swarm.b, swarm.mu, swarm.lam, span, lower, upper, state
            )
    count = int(best[_SIZE - 1])
    return best[: 3 * count].copy().reshape(count, 3), least < _COLLISION

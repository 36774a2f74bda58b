"""The follower `whales`, whose commands (v, w, t) a swarm of whales searches, period by period.

A particle is a list of commands and how many of them count (thesis, section 2.9.3 and algorithm
6), as in `control_generator`; it costs what all followers' roll-outs cost. The first particles are
the whole fan of `window`, the plan's own commands and the best ones of the period before.
"""

import math
from typing import Any

import numpy as np

from agents.control import followers
from agents.control.rollout import HOLD, Body, LocalView, S, cheapest, rollout_cost, start_row
from agents.control.tight_places import ManoeuvreTracker
from planners.rrt_star_woa.woa import WhaleParameters, WhaleSettings, move, new_whales, tell
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import record_of, setting, settings
from wheelchair_gym.compiled.kernel import kernel
from wheelchair_gym.compiled.random import Stream, stream
from wheelchair_gym.geometry.kinematics import Limits

COMMANDS = 3  # in a particle, at most
SIZE = 3 * COMMANDS + 1  # (v, w, t) of each, then how many count


def _bounds(config: "RefinedWindow", now: followers.Situation, slow: bool) -> tuple[Array, Array]:
    """Bounds (SIZE,) of a particle's values."""
    limits, horizon = now.chair.limits, config.objective.horizon
    back = 0.0 if now.local_map.blind else min(followers.BACKWARD, limits.backward)
    ahead = limits.forward
    if slow:
        back, ahead = min(back, followers.CREEP), min(ahead, followers.CREEP)
    low = [-back, -limits.turn, 2.0 * now.chair.period] * COMMANDS + [1.0]
    high = [ahead, limits.turn, horizon] * COMMANDS + [COMMANDS + 0.999]
    return np.array(low), np.array(high)


def _one_period_later(best: Array, period: float) -> Array:
    """Return the rest of a particle (SIZE,) after one control period [s]."""
    left = best.copy()
    left[2] -= period
    if left[2] < period and left[-1] >= 2.0:
        left[:-4] = left[3:-1]
        left[-1] -= 1.0
    return left


@kernel
def search(
    first: Array, lower: Array, upper: Array, body: Body, view: LocalView, margin: float,
    objective: Any, swarm: WhaleParameters, state: Stream,
) -> tuple[Array, Array]:  # fmt: skip
    """All particles (n, SIZE) that were tried and their costs (n,): the given ones, then whales.

    The whales begin as the cheapest of the given particles, with all commands: whales may change a
    twist after a while.
    """
    n, start = first.shape[0], start_row(view)
    k = min(swarm.population, n)
    tried, costs = np.empty((n + k * swarm.iterations, SIZE)), np.empty(n + k * swarm.iterations)
    whales, m = new_whales(first.copy(), swarm, lower, upper), 0
    for t in range(swarm.iterations + 1):
        for i in range(whales.population.shape[0]):
            particle = whales.population[i]
            count = int(particle[SIZE - 1])
            commands = particle[: 3 * count].copy().reshape(count, 3)
            costs[m] = rollout_cost(commands, body, view, start, margin, objective)
            tried[m] = particle
            tell(whales, i, costs[m])
            m += 1
        if t == 0:
            order = np.argsort(costs[:n])
            whales = new_whales(first[order[:k]], swarm, lower, upper)
            tell(whales, 0, costs[order[0]])
            whales.population[:, SIZE - 1] = COMMANDS
        if t < swarm.iterations:
            move(whales, t / swarm.iterations, state)
    return tried, costs


class WhaleCommands:
    """Carries the best commands from one period to the next."""

    def __init__(self, config: "RefinedWindow") -> None:
        self.config, self._objective = config, record_of(config.objective)
        self._state = stream(np.random.default_rng(0))  # anew for every path
        self._best: Array | None = None  # (SIZE,)

    def twist(self, now: followers.Situation) -> Array | None:
        """See `Follower.twist`."""
        config, view, body = self.config, now.view, now.chair.body
        first = _fan_and_plan(config, now, self._best)

        def pick(margin: float, slow: bool) -> Array | None:
            lower, upper = _bounds(config, now, slow)
            low, high = lower[:2] - 1e-9, upper[:2] + 1e-9  # of the first command's twist
            some = first[((first[:, :2] >= low) & (first[:, :2] <= high)).all(axis=1)]
            if len(some) == 0:
                return None
            tried, costs = search(
                some, lower, upper, body, view, margin, self._objective,
                config.whales.parameters, self._state,
            )  # fmt: skip
            best = cheapest(tried, costs, body, view, HOLD, margin)
            if best < 0:
                return None
            self._best = tried[best]
            return np.array(tried[best, :2])

        twist = followers.relax_clearance(now, config.margin, pick)
        if twist is None:
            self._best = None
        return twist


@settings
class RefinedWindow(followers.Window):
    """Whales refine the best of a fan, of the plan's commands and of the last best ones.

    With no iterations of the whales it is `window` with the plan's commands among its candidates.
    """

    whales: WhaleSettings = setting(
        default=WhaleSettings(population=16, iterations=4, a=1.0), source="10 ms on one core"
    )
    """The swarm, the best candidates at first."""

    def make(self) -> followers.Follower:
        """A follower at rest."""
        return ManoeuvreTracker(WhaleCommands(self), self.margin)


SHARES = (0.3, 0.6, 1.0)  # of the limits, at which the plan's commands are driven


def plan_commands(rows: Array, limits: Limits, horizon: float) -> Array:
    """Commands (k, COMMANDS, 3) that drive the next reference poses (n, 4), at several speeds.

    The rows begin where the chair is, in its own frame.
    """
    found = np.zeros((len(SHARES), COMMANDS, 3))
    for commands, share in zip(found, SHARES, strict=True):
        x, y, yaw = 0.0, 0.0, 0.0
        for k in range(COMMANDS):
            reach = rows[0, S] + share * limits.forward * horizon * (k + 1) / COMMANDS
            row = rows[min(int(np.searchsorted(rows[:, S], reach)), len(rows) - 1)]
            dx, dy = row[0] - x, row[1] - y
            ahead = math.cos(yaw) * dx + math.sin(yaw) * dy
            aside = math.cos(yaw) * dy - math.sin(yaw) * dx
            way = math.copysign(math.hypot(ahead, aside), ahead)
            turn = 2.0 * math.atan2(aside, ahead) if way > 0.0 else 2.0 * math.atan2(-aside, -ahead)
            if abs(way) < 0.05:
                way, turn = 0.0, math.remainder(row[2] - yaw, 2.0 * math.pi)
            fastest = limits.forward if way >= 0.0 else min(followers.BACKWARD, limits.backward)
            need = max(abs(way) / max(fastest, 1e-6), abs(turn) / limits.turn) / share
            time = max(need, 0.1)
            commands[k] = way / time, turn / time, time
            x, y, yaw = row[0], row[1], row[2]
    return found


def _fan_and_plan(config: "RefinedWindow", now: followers.Situation, best: Array | None) -> Array:
    """Particles (n, SIZE): the fan, the plan's commands, and what was best or is driven."""
    view, chair, horizon = now.view, now.chair, config.objective.horizon
    fan = now.local_map.limit_for_unseen_space(config.fan(chair), chair.body.state)
    plan = plan_commands(view.reference[start_row(view) :], chair.limits, horizon)
    particles = np.zeros((len(fan) + len(plan) + 1, SIZE))
    particles[:, 2:-1:3], particles[:, -1] = 0.5 * horizon, 1.0
    for k in range(COMMANDS):
        particles[: len(fan), 3 * k : 3 * k + 2] = fan
    particles[len(fan) : -1, :-1] = plan.reshape(len(plan), -1)
    particles[len(fan) : -1, -1] = COMMANDS
    particles[-1, :2] = chair.body.last
    if best is not None:
        particles[-1] = _one_period_later(best, chair.period)
    return particles

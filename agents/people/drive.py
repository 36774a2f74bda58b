"""Drives in which a person at the stick is helped by an assistant, on a real chair."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from agents.deploy import Log, late_steps
from agents.evaluation.assisted import StickTrace
from agents.people.stick import PersonsStick, TimedAssistant
from agents.policies import GymPolicy
from wheelchair_gym.maps import FREE, OccupancyGrid
from wheelchair_gym.perception.localized_chair import unwrapped
from wheelchair_gym.safety.stops import StopMonitor, active_stops
from wheelchair_gym.types import Episode

_EXTENT, _CELL = 60.0, 0.1  # m: of the empty map of a chair that has none, and of its cells
_FOR_EVER = 1e6  # s


def open_space() -> Episode:
    """An episode without walls and without a goal that is ever reached, around the start."""
    n = round(_EXTENT / _CELL)
    corner = (-0.5 * _EXTENT, -0.5 * _EXTENT, 0.0)
    grid = OccupancyGrid(np.full((n, n), FREE, np.int8), _CELL, corner)
    return without_goal(grid, np.zeros(3), np.empty((0, 4)))


def without_goal(grid: OccupancyGrid, start: Any, walls: Any) -> Episode:
    """An episode on a map that goes on for ever, since nobody knows where the person wants to go.

    Args:
        grid: the map.
        start: pose (3,) [m, m, rad].
        walls: of the map (n, 4) [m].
    """
    beside = np.add(start, (1e-3, 0.0, 0.0))
    return Episode(grid, start, beside, walls, tolerance=0.0, time_limit=_FOR_EVER, name="person")


def drive_with_help(
    env: Any,
    assistant: TimedAssistant,
    stick: PersonsStick,
    episode: Episode,
    log: Log,
    each: Callable[[Any], bool],
) -> dict[str, Any]:
    """Run a person's drive with an assistant, until `each` returns true or the chair has stopped.

    Ctrl-C ends the drive, too.

    After a touch the shield holds the chair until the person has driven it free by hand, or has
    re-armed it.

    Args:
        env: an environment whose `person` is the stick.
        assistant: answers in time.
        stick: the person's.
        episode: a map without a goal.
        log: takes lines of text.
        each: called with the environment after each reset and step.

    Returns:
        Figures: `time` [s], `length` [m], how often it stood (`stops`), why the chair has `ended`
        the drive, the measures of `agents.evaluation.assisted`, and late control periods.
    """
    world, chair = env.unwrapped, unwrapped(env.unwrapped.chair)
    limits, period = world.task.limits, world.task.period
    trace, twists = StickTrace(limits, period), [np.zeros(2)]
    length, monitor, stops, ended = 0.0, StopMonitor(), 0, ""
    observation, _ = env.reset(seed=0, options={"episode": episode})
    driver = GymPolicy(assistant, env)
    driver.reset()
    with suppress(KeyboardInterrupt):  # the end of a person's drive
        while not each(env):
            reading, stood = world.task.reading, bool(monitor.messages)
            if reading.halted:
                stick.must_centre()
            causes = [*active_stops(reading.halted, world.shield), stick.why()]
            for line in monitor.update(reading.stamp, causes):
                log(f"{reading.stamp:7.1f} s  {line}")
            stops += bool(monitor.messages) and not stood
            if chair.latched:
                ended = monitor.why
                break
            action, now = driver.act(observation), world.task.stick
            observation, *_ = env.step(action)
            trace.add(now, limits.twist(action) - np.array(world.task.shield_intervention))
            twists.append(world.task.reading.twist)
            length += abs(float(twists[-1][0])) * period
    driven = (len(twists) - 1) * period
    figures = {"time": driven, "length": length, "stops": stops, "ended": ended}
    return figures | trace.figures(np.array(twists), length) | late_steps(env)

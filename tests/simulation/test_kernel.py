"""The step kernel and plain pymunk agree exactly: the same forces, through the API."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.simulation.worlds import cluttered, exact_chair
from wheelchair_gym.simulation import motion
from wheelchair_gym.simulation.engine import (
    ANGLE,
    BODY_DOUBLES,
    FX,
    FY,
    OFFSETS,
    STEP,
    TORQUE,
    VX,
    VY,
    W,
    X,
    Y,
)


class Oracle:
    """A cpBody seen through pymunk's API, written as the array that the kernel's source expects."""

    def __init__(self, world):
        self.world = world

    def view(self):
        body, fields = self.world.body, np.zeros(BODY_DOUBLES)
        fields[[X, Y]], fields[[VX, VY]] = body.position, body.velocity
        fields[ANGLE], fields[W] = body.angle, body.angular_velocity
        return fields


def oracle_step(monkeypatch, oracle):
    """`motion.step_once` as plain Python, its engine calls replaced by pymunk's API."""
    fields = oracle.view()

    def step_space(engine, space, dt):
        body = oracle.world.body
        body.force, body.torque = (fields[FX], fields[FY]), fields[TORQUE]
        oracle.world.space.step(dt)
        fields[[VX, VY]], fields[W] = body.velocity, body.angular_velocity

    monkeypatch.setattr(motion, "body_view", lambda address: fields)
    monkeypatch.setattr(motion, "step_space", step_space)
    return motion.step_once.py_func


@pytest.mark.parametrize("seed", range(6))
def test_kernel_equals_the_plain_api_exactly(seed, monkeypatch):
    """Pose, twist and wheels, bit for bit, with many steps in contact."""
    kernel, plain = exact_chair(), exact_chair()
    rng = np.random.default_rng(seed)
    episode = cluttered(seed, (0.0, 0.0, rng.uniform(-math.pi, math.pi)))
    kernel.reset(episode, 0)
    plain.reset(episode, 0)
    oracle = Oracle(plain._world)
    contacts = steps = 0
    p = kernel._parameters[0]
    k = motion.work_out(p)
    for _ in range(100):
        duty = rng.uniform(0.3, 0.9) + rng.uniform(-0.1, 0.1, 2)
        for chair in (kernel, plain):
            chair._state["duty"][0] = duty
        for _ in range(10):
            hit = motion.step_once(kernel._state[0], p, k, *kernel._world.addresses, STEP)
            with monkeypatch.context() as patch:
                other = oracle_step(patch, oracle)(
                    Record(plain._state), Record(plain._parameters), k, 0, 0, 0
                )
            assert hit == pytest.approx(other, rel=1e-12, abs=1e-12)
            contacts += hit > 1e-6
            steps += 1
            a, b = kernel._world.body, plain._world.body
            assert (a.position, a.angle) == (b.position, b.angle)
            assert (a.velocity, a.angular_velocity) == (b.velocity, b.angular_velocity)
            assert kernel._state.tobytes() == plain._state.tobytes()
    assert contacts >= 0.3 * steps


class Record:
    """A record array's only row, its fields as attributes, as kernels see it."""

    def __init__(self, rows):
        object.__setattr__(self, "_row", rows[0])

    def __getattr__(self, name):
        return self._row[name]

    def __setattr__(self, name, value):
        self._row[name] = value


def test_offsets_are_all_different():
    assert len(set(OFFSETS)) == len(OFFSETS)

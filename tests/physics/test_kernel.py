"""The step kernel and plain pymunk agree exactly: the same forces, through the API."""

from __future__ import annotations

import math

import numpy as np
import pymunk
import pytest

from tests.physics.worlds import cluttered, exact_chair
from wheelchair_gym.physics import drive_train
from wheelchair_gym.physics.engine import (
    ANGLE,
    BODY_DOUBLES,
    FX,
    FY,
    OFFSETS,
    SHAPE,
    TORQUE,
    VX,
    VY,
    W,
    X,
    Y,
    engine_record,
)


class Oracle:
    """A chair in a Space of its own, made and entered by pymunk's plain API alone.

    Its motors and tyres are the kernel's source, run as plain Python on what the API tells.
    """

    def __init__(self, chair, episode, fixed=None):
        p = chair.parameters[0]
        centre, friction = p["centre_of_mass"], chair.settings.body.wall_friction
        self.space = pymunk.Space()
        self.space.collision_slop = self.space.collision_bias = 1e-4
        static = self.space.static_body
        self.body = pymunk.Body(p["mass"], p["moment"])
        corners = [(x - centre, y) for x, y in chair.settings.footprint.corners.tolist()]
        solid = [pymunk.Segment(static, w[:2], w[2:], 0.0) for w in episode.walls.tolist()]
        solid += [pymunk.Circle(static, r, (x, y)) for x, y, r in episode.discs.tolist()]
        for shape in solid if fixed else ():
            shape.filter = fixed
        shapes = [pymunk.Poly(self.body, corners), *solid]
        for shape in shapes:
            shape.friction = friction
        self.space.add(self.body, *shapes)
        self.place(1e4, 1e4, 0.0)
        self.space.step(p["dt"])
        x, y, yaw = episode.start.tolist()
        self.place(x + centre * math.cos(yaw), y + centre * math.sin(yaw), yaw)
        self.state, self.parameters = chair.state, chair.parameters

    def place(self, x, y, angle):
        self.body.position, self.body.angle = (x, y), angle
        self.body.velocity, self.body.angular_velocity = (0.0, 0.0), 0.0
        self.space.reindex_shapes_for_body(self.body)

    def step_once(self, monkeypatch, k):
        body, fields = self.body, np.zeros(BODY_DOUBLES)
        fields[[X, Y]], fields[[VX, VY]] = body.position, body.velocity
        fields[ANGLE], fields[W] = body.angle, body.angular_velocity

        def step_space(engine, space, dt):
            body.force, body.torque = (fields[FX], fields[FY]), fields[TORQUE]
            self.space.step(dt)
            fields[[VX, VY]], fields[W] = body.velocity, body.angular_velocity

        with monkeypatch.context() as patch:
            patch.setattr(drive_train, "body_view", lambda address: fields)
            patch.setattr(drive_train, "step_space", step_space)
            state, parameters = Record(self.state), Record(self.parameters)
            return drive_train.physics_step.py_func(state, parameters, k, 0, 0, 0)


LONG = (pytest.param(seed, marks=pytest.mark.long) for seed in range(3, 6))


@pytest.mark.parametrize("seed", [*range(3), *LONG])
def test_kernel_equals_the_plain_api_exactly(seed, monkeypatch):
    """Pose, twist and wheels, bit for bit, in a used and refurnished Space, mostly in contact."""
    chair = exact_chair()
    for used in range(3):  # other worlds, other contacts, more and fewer shapes
        chair.reset(cluttered(100 + used, (2.0 + used, 1.0, 0.3)), used)
        for _ in range(50):
            chair.drive(np.array([0.8, 0.2]))
    rng = np.random.default_rng(seed)
    episode = cluttered(seed, (0.0, 0.0, rng.uniform(-math.pi, math.pi)))
    chair.reset(episode, seed)
    oracle = Oracle(chair, episode)
    body, place, p = (
        chair.chairs.worlds[0].body,
        chair.chairs.world_rows[0],
        chair.chairs.parameters[0],
    )
    own = place["space"], place["body"], engine_record()["step"][0]
    k = drive_train.drive_constants(p)
    contacts = steps = 0
    duty = np.zeros(2)
    for period in range(150):
        if period % 25 == 0:
            duty = rng.uniform(0.5, 0.9) + rng.uniform(-0.1, 0.1, 2)
        chair.chairs.states["duty"][0] = oracle.state["duty"][0] = duty
        for _ in range(10):
            hit = drive_train.physics_step(chair.chairs.states[0], p, k, *own)
            other = oracle.step_once(monkeypatch, k)
            assert hit == pytest.approx(other, rel=1e-12, abs=1e-12)
            contacts += hit > 1e-6
            steps += 1
            assert (body.position, body.angle) == (oracle.body.position, oracle.body.angle)
            assert body.velocity == oracle.body.velocity
            assert body.angular_velocity == oracle.body.angular_velocity
            for name in chair.chairs.states.dtype.names:
                assert np.array_equal(chair.chairs.states[name], oracle.state[name]), name
    assert contacts >= 0.5 * steps


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
    assert len(set(SHAPE[:6])) == 6
    assert len(set(SHAPE[6:9])) == 3
    assert len(set(SHAPE[9:])) == 3

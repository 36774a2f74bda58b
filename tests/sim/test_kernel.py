"""The step kernel and plain pymunk agree exactly: the same forces, through the API."""

from __future__ import annotations

import ctypes
import math

import numpy as np
import pymunk
import pytest

from tests.conftest import long_but
from tests.sim.worlds import cluttered, exact_chair
from wheelchair_gym.engine import (
    ANGLE,
    BODY_DOUBLES,
    FX,
    FY,
    TORQUE,
    VX,
    VY,
    W,
    X,
    Y,
    engine_record,
)
from wheelchair_gym.sim import drive_train
from wheelchair_gym.sim.world import WALL_FRICTION, measure_clearance, touchable_space


def run_as_python(patch):
    """Run the parts of a physics step as plain Python."""
    for name in ("_drag_of_casters", "_turn_wheel", "_slide", "_drain_battery"):
        patch.setattr(drive_train, name, getattr(drive_train, name).py_func)


class Oracle:
    """A chair in a Space of its own, made and entered by pymunk's plain API alone.

    Its motors and tyres are the kernel's source, run as plain Python on what the API tells.
    """

    def __init__(self, chair, episode, fixed=None):
        p = chair.parameters[0]
        centre, friction = p["body"]["centre_of_mass"], WALL_FRICTION
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
            run_as_python(patch)
            state, parameters = Record(self.state), Record(self.parameters)
            return drive_train.physics_step.py_func(state, parameters, k, 1, 0, 0)


@pytest.mark.parametrize("seed", long_but(range(6), range(3)))
def test_kernel_equals_the_plain_api(seed, monkeypatch):
    """Pose, twist and wheels, in a used Space that is furnished on the way.

    The other Space holds all walls and discs, and makes every step. Both agree to the bit until
    the chair touches two things at once, which Munk2D then solves in another order.
    """
    chair = exact_chair()
    for used in range(3):  # other worlds, other contacts, more and fewer shapes
        chair.reset(cluttered(100 + used, (2.0 + used, 1.0, 0.3)), used)
        for _ in range(50):
            chair.drive(np.array([0.8, 0.2]))
    rng = np.random.default_rng(seed)
    episode = cluttered(seed, (0.0, 0.0, rng.uniform(-math.pi, math.pi)))
    chair.reset(episode, seed)
    oracle = Oracle(chair, episode)
    place, p = chair.chairs.world_rows[0], chair.chairs.parameters[0]
    fields = np.ctypeslib.as_array(
        ctypes.cast(int(place["body"]), ctypes.POINTER(ctypes.c_double)), (BODY_DOUBLES,)
    )
    engine, workspace = engine_record()[0], chair.pointers.array("workspace")
    k = drive_train.drive_constants(p)
    contacts = steps = free = 0
    duty = np.zeros(2)
    for period in range(150):
        if period % 25 == 0:
            duty = rng.uniform(0.5, 0.9) + rng.uniform(-0.1, 0.1, 2)
        chair.chairs.states["duty"][0] = oracle.state["duty"][0] = duty
        yaw = fields[ANGLE]
        centre = p["body"]["centre_of_mass"] * np.array([math.cos(yaw), math.sin(yaw)])
        chair.chairs.states["pose"][0] = *(fields[[X, Y]] - centre), yaw
        oracle.state["pose"][0] = chair.chairs.states["pose"][0]
        measure_clearance(chair.chairs.states[0], p, place, workspace)
        for _ in range(10):
            space = touchable_space(engine, place, p, workspace)
            free += space == 0
            hit = drive_train.physics_step(
                chair.chairs.states[0], p, k, space, place["body"], engine["step"]
            )
            other = oracle.step_once(monkeypatch, k)
            contacts += hit > 1e-6
            steps += 1
            now = [*fields[[X, Y, ANGLE, VX, VY, W]]]
            then = [*oracle.body.position, oracle.body.angle, *oracle.body.velocity]
            then.append(oracle.body.angular_velocity)
            if now != then:  # two things at once, solved in another order
                assert hit > 1e-6
                assert now == pytest.approx(then, abs=1e-6)
                assert steps > 100
                assert contacts > 3
                return
            assert hit == other
            for name in chair.chairs.states.dtype.names:
                assert np.array_equal(chair.chairs.states[name], oracle.state[name]), name
    assert contacts >= 0.5 * steps
    assert 0 < free < steps


class Record:
    """A record array's only row, its fields as attributes, as kernels see it."""

    def __init__(self, rows):
        object.__setattr__(self, "_row", rows[0])

    def __getattr__(self, name):
        value = self._row[name]
        return Record([value]) if value.dtype.names else value

    def __setattr__(self, name, value):
        self._row[name] = value

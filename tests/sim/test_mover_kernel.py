"""Actors by address and by plain pymunk agree exactly: bodies, entries, forces, contacts."""

from __future__ import annotations

import math

import numpy as np
import pymunk
import pytest

from tests.conftest import long_but
from tests.sim.test_kernel import Oracle, Record, run_as_python
from tests.sim.worlds import busy, exact_chair
from wheelchair_gym.actors.bodies import PARKING, read_actor_poses
from wheelchair_gym.actors.records import DOOR, FURNITURE, NOBODY, OBSTACLE, PERSON
from wheelchair_gym.compiled.address import address_of
from wheelchair_gym.engine import ANGLE, BODY_DOUBLES, FX, FY, TORQUE, VX, VY, W, X, Y
from wheelchair_gym.sim import drive_train
from wheelchair_gym.sim import step as period
from wheelchair_gym.sim.world import FIXED, LEAF, WALL_FRICTION

STEP_ONCE = drive_train.physics_step.py_func
MOVE_ON, BODY_VIEW = period.decide_actors, period.body_view


def made_of(row, friction):
    """A actor's body and shape, made by the API."""
    length, width = row["size"].tolist()
    mass = float(row["mass"])
    box = [(-length / 2, -width / 2), (length / 2, -width / 2)]
    box += [(length / 2, width / 2), (-length / 2, width / 2)]
    if row["kind"] in (DOOR, OBSTACLE):
        body = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
    elif row["kind"] == PERSON:
        body = pymunk.Body(mass, math.inf)
    elif width:
        body = pymunk.Body(mass, mass * (length**2 + width**2) / 12)
    else:
        body = pymunk.Body(mass, 0.5 * mass * length**2)
    if row["kind"] == DOOR:
        shape = pymunk.Poly(body, [(x + length / 2, y) for x, y in box])
        shape.filter = LEAF  # no contact with what is FIXED: neither would move
    else:
        shape = pymunk.Poly(body, box) if width else pymunk.Circle(body, length)
    shape.friction = 0.0 if row["kind"] == PERSON else friction
    if row["kind"] == PERSON and row["avoids"] == NOBODY:
        shape.filter = pymunk.ShapeFilter(group=1)
    return body, shape


class BusyOracle(Oracle):
    """The same with actors: what they want is the kernels' own; all of Munk2D goes by the API.

    A second chair lends its records; its bodies are arrays beside those of the API.
    """

    def __init__(self, lent, episode, key):
        lent.reset(episode, key)
        self.lent, self.rows = lent, episode.actors.rows
        self.friction = WALL_FRICTION
        self.actors = []
        self.max_touched = 0  # of things that one body has touched at once so far
        super().__init__(lent, episode, FIXED)
        self.fields = np.zeros((1 + len(self.actors), BODY_DOUBLES))
        lent.chairs.world_rows["body"] = address_of(self.fields[0])
        actor_states = lent.chairs.pointers.array("actor_states")
        for k, fields in enumerate(self.fields[1:]):
            actor_states["body"][k] = address_of(fields)
        self.read()

    def place(self, x, y, angle):
        """Actors are far away while the chair is, and come when it does."""
        super().place(x, y, angle)
        if not self.actors:
            for k, row in enumerate(self.rows):
                body, shape = made_of(row, self.friction)
                body.position = (-PARKING, PARKING + 20.0 * k)
                self.actors.append(body)
                self.space.add(body, shape)
        else:
            for body, row in zip(self.actors, self.rows, strict=True):
                if row["kind"] != OBSTACLE:
                    self.put(body, *row["pose"].tolist())

    def put(self, body, x, y, angle):
        body.position, body.angle = (x, y), angle
        body.velocity, body.angular_velocity = (0.0, 0.0), 0.0
        self.space.reindex_shapes_for_body(body)

    def read(self):
        for body, fields in zip([self.body, *self.actors], self.fields, strict=True):
            fields[[X, Y]], fields[[VX, VY]] = body.position, body.velocity
            fields[ANGLE], fields[W] = body.angle, body.angular_velocity
            fields[[FX, FY, TORQUE]] = 0.0

    def carry(self, engine, world):
        actor_states = self.lent.chairs.pointers.array("actor_states")
        for k, (body, row) in enumerate(zip(self.actors, self.rows, strict=True)):
            if actor_states["relocate"][k] == 1:
                self.put(body, *row["pose"].tolist())
            elif actor_states["relocate"][k] == 2:
                self.put(body, -PARKING, PARKING + 20.0 * k, 0.0)
            actor_states["relocate"][k] = 0
            fields = self.fields[1 + k]
            if row["kind"] != OBSTACLE:
                body.velocity, body.angular_velocity = fields[[VX, VY]].tolist(), fields[W]
            if row["kind"] in (PERSON, FURNITURE):
                body.force, body.torque = fields[[FX, FY]].tolist(), fields[TORQUE]

    def step(self, state, p, k, space, body, engine):
        def step_space(engine, space, dt):
            own = self.fields[0]
            self.body.force, self.body.torque = own[[FX, FY]].tolist(), own[TORQUE]
            self.space.step(dt)
            self.read()
            for body in (self.body, *self.actors):
                touched = []
                body.each_arbiter(touched.append)
                self.max_touched = max(self.max_touched, len(touched))

        with self.monkeypatch.context() as patch:
            patch.setattr(drive_train, "body_view", lambda address: self.fields[0])
            patch.setattr(drive_train, "step_space", step_space)
            run_as_python(patch)
            return STEP_ONCE(
                Record(self.lent.chairs.states), Record(self.lent.chairs.parameters), k, 1, 0, 0
            )

    def move_on(self, *records):
        """The kernel itself, which is compiled for Python here with what it calls unpatched."""
        with self.monkeypatch.context() as patch:
            patch.setattr(period, "body_view", BODY_VIEW)
            return MOVE_ON(*records)

    def prepare(self, engine, world, state, p, before, workspace):
        bump = self.move_on(state, p, world, before)
        self.carry(engine, world)
        return bump, 1  # a Space: every step is made

    def drive(self, monkeypatch, v, w):
        """`period.drive` as plain Python, over the API."""
        self.monkeypatch = monkeypatch
        lent = self.lent
        with monkeypatch.context() as patch:
            patch.setattr(period, "body_view", lambda address: self.fields[0])
            patch.setattr(period, "prepare_step", self.prepare)
            patch.setattr(period, "physics_step", self.step)
            patch.setattr(period, "move_the_others", lambda world, dt: read_actor_poses(world))
            own = [
                a.view(np.recarray)[0]
                for a in (lent.chairs.states, lent.chairs.parameters, lent.chairs.world_rows)
            ]
            engine = lent.chairs.suite.record.view(np.recarray)[0]
            period.drive_period.py_func(*own, engine, v, w, False, lent.chairs.suite.order, None)


# What says who is in the Space, in which the oracle has all.
BOOKKEEPING = ("body", "shape", "in_space", "moved", "clear", "free", "measured_at", "touchable_at")


@pytest.mark.parametrize("seed", long_but(range(12), (0, 3)))
def test_movers_equal_the_plain_api(seed, monkeypatch):
    """Chair and actors, in a used Space that holds who can touch something.

    The other Space holds all, and makes every step. Both agree to the bit until somebody touches
    two things at once, which Munk2D then solves in another order.
    """
    rng = np.random.default_rng(seed)
    chair = exact_chair()
    for used in range(2):
        chair.reset(busy(100 + used), used)
        for _ in range(40):
            chair.drive(np.array([0.8, 0.2]))
    episode = busy(seed, (0.0, 0.0, rng.uniform(-math.pi, math.pi)))
    chair.reset(episode, seed)
    oracle = BusyOracle(exact_chair(), episode, seed)
    met, inside = set(), []
    for k in range(150):
        if k % 30 == 0:
            twist = rng.uniform((0.2, -0.8), (0.8, 0.8))
        chair.drive(twist)
        oracle.drive(monkeypatch, *twist.tolist())
        n = len(oracle.actors)
        actor_states = chair.chairs.pointers.array("actor_states")[:n]
        others = oracle.lent.chairs.pointers.array("actor_states")[:n]
        inside.append(actor_states["in_space"].mean())
        own = [[*body.position, body.angle] for body in oracle.actors]
        names = set(actor_states.dtype.names) - set(BOOKKEEPING)
        equal = np.array_equal(actor_states["pose"], own)
        equal &= all(np.array_equal(actor_states[name], others[name]) for name in names)
        if not equal and oracle.max_touched > 1:
            assert actor_states["pose"] == pytest.approx(np.array(own), abs=0.05), k
            break
        assert equal, k
        pose = oracle.lent.chairs.states["pose"].tolist()
        assert chair.state["pose"].tolist() == pose, k
        fields = ("tick", "spin", "contact", "at_fault", "contact_with", "approach_speed", "bumped")
        for name in fields:
            assert chair.state[name].tolist() == oracle.lent.chairs.states[name].tolist(), name
        if chair.truth.contact:
            met.add(chair.truth.contact_with)
    assert k > 10
    assert met or oracle.max_touched > 1
    assert 0.0 < np.mean(inside) < 0.5

"""The kernels and plain pymunk agree exactly: chair and actors, entries, forces, contacts."""

import math

import numpy as np
import pymunk
import pytest

from tests.conftest import long_but
from tests.sim.worlds import busy, cluttered, drive_for, exact_chair
from wheelchair_gym.actors.bodies import PARKING, read_actor_poses
from wheelchair_gym.actors.records import DOOR, FURNITURE, NOBODY, OBSTACLE, PERSON
from wheelchair_gym.compiled.address import address_of
from wheelchair_gym.engine import BODY
from wheelchair_gym.geometry.kinematics import Limits
from wheelchair_gym.sim import drive_train
from wheelchair_gym.sim import step as period
from wheelchair_gym.sim.settings import BodySettings
from wheelchair_gym.sim.world import FIXED, LEAF, WALL_FRICTION

STEP_ONCE = drive_train.physics_step.py_func
MOVE_ON, BODY_VIEW = period.decide_actors, period.body_view


def record(rows):
    """A record array's only row, its fields as attributes, as kernels see it."""
    return rows.view(np.recarray)[0]


def made_of(row):
    """An actor's body and shape, made by the API."""
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
    shape.friction = 0.0 if row["kind"] == PERSON else WALL_FRICTION
    if row["kind"] == PERSON and row["avoids"] == NOBODY:
        shape.filter = pymunk.ShapeFilter(group=1)
    return body, shape


class Oracle:
    """Chair and actors in a Space of its own, made and entered by pymunk's plain API alone.

    What actors want, motors and tyres are the kernels' source, run as plain Python on what the API
    tells. A second chair lends its records; its bodies are arrays beside those of the API.
    """

    def __init__(self, lent, episode, key):
        lent.reset(episode, key)
        self.lent, self.rows = lent, episode.actors.rows
        self.max_touched = 0  # of things that one body has touched at once so far
        p = lent.parameters[0]
        centre = p["body"]["centre_of_mass"]
        self.space = pymunk.Space()
        self.space.collision_slop = self.space.collision_bias = 1e-4
        static = self.space.static_body
        self.body = pymunk.Body(p["mass"], p["moment"])
        corners = [(x - centre, y) for x, y in lent.settings.footprint.corners.tolist()]
        solid = [pymunk.Segment(static, w[:2], w[2:], 0.0) for w in episode.walls.tolist()]
        solid += [pymunk.Circle(static, r, (x, y)) for x, y, r in episode.discs.tolist()]
        for shape in solid:
            shape.filter = FIXED
        shapes = [pymunk.Poly(self.body, corners), *solid]
        for shape in shapes:
            shape.friction = WALL_FRICTION
        self.space.add(self.body, *shapes)
        self.put(self.body, 1e4, 1e4, 0.0)
        self.actors = []
        for k, row in enumerate(self.rows):  # far away while the chair is
            body, shape = made_of(row)
            body.position = (-PARKING, PARKING + 20.0 * k)
            self.actors.append(body)
            self.space.add(body, shape)
        self.space.step(p["dt"])
        x, y, yaw = episode.start.tolist()
        self.put(self.body, x + centre * math.cos(yaw), y + centre * math.sin(yaw), yaw)
        for body, row in zip(self.actors, self.rows, strict=True):
            if row["kind"] != OBSTACLE:
                self.put(body, *row["pose"].tolist())
        self.fields = np.zeros(1 + len(self.actors), BODY).view(np.recarray)
        lent.chairs.world_rows["body"] = address_of(self.fields[:1])
        actor_states = lent.chairs.pointers.array("actor_states")
        for k in range(len(self.actors)):
            actor_states["body"][k] = address_of(self.fields[1 + k : 2 + k])
        self.read()

    def put(self, body, x, y, angle):
        body.position, body.angle = (x, y), angle
        body.velocity, body.angular_velocity = (0.0, 0.0), 0.0
        self.space.reindex_shapes_for_body(body)

    def read(self):
        for body, fields in zip([self.body, *self.actors], self.fields, strict=True):
            (fields.x, fields.y), (fields.vx, fields.vy) = body.position, body.velocity
            fields.angle, fields.w = body.angle, body.angular_velocity
            fields.fx = fields.fy = fields.torque = 0.0

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
                body.velocity, body.angular_velocity = (fields.vx, fields.vy), fields.w
            if row["kind"] in (PERSON, FURNITURE):
                body.force, body.torque = (fields.fx, fields.fy), fields.torque

    def step(self, state, p, k, space, body, engine):
        def step_space(engine, space, dt):
            own = self.fields[0]
            self.body.force, self.body.torque = (own.fx, own.fy), own.torque
            self.space.step(dt)
            self.read()
            for body in (self.body, *self.actors):
                touched = []
                body.each_arbiter(touched.append)
                self.max_touched = max(self.max_touched, len(touched))

        with self.monkeypatch.context() as patch:
            patch.setattr(drive_train, "body_view", lambda address: self.fields[0])
            patch.setattr(drive_train, "step_space", step_space)
            for name in ("_drag_of_casters", "_turn_wheel", "_slide", "_drain_battery"):
                patch.setattr(drive_train, name, getattr(drive_train, name).py_func)
            return STEP_ONCE(
                record(self.lent.chairs.states), record(self.lent.chairs.parameters), k, 1, 0, 0
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
            period.drive_period.py_func(
                *map(record, (lent.chairs.states, lent.chairs.parameters, lent.chairs.world_rows)),
                record(lent.chairs.suite.record), v, w, False, lent.chairs.suite.order, None,
            )  # fmt: skip


# What says who is in the Space, in which the oracle has all.
BOOKKEEPING = ("body", "shape", "in_space", "moved", "clear", "free", "measured_at", "touchable_at")
# What is sensed between two periods, which the oracle does not do.
SENSED = "estimated_pose", "measured_counts", "measured_twist", "odometry", "ranges", "touched"
WORLDS = [*((cluttered, seed) for seed in range(8)), *((busy, seed) for seed in range(12))]
FEW = [*WORLDS[:8], (busy, 0), (busy, 3)]


@pytest.mark.parametrize(("world", "seed"), long_but(WORLDS, FEW))
def test_kernels_equal_the_plain_api(world, seed, monkeypatch):
    """Chair and actors, in a used Space that holds who can touch something.

    Without actors it is furnished on the way, and walls are pushed at: no strip stops the chair.
    The other Space holds all, and makes every step. Both agree to the bit until somebody touches
    two things at once, which Munk2D then solves in another order.
    """
    rng = np.random.default_rng(seed)
    fast = Limits(forward=1.8, backward=1.0, acceleration=2.0, deceleration=2.0, jerk=8.0)
    more = {"body": BodySettings(bumper_force=1e6), "limits": fast} if world is cluttered else {}
    chair = exact_chair(**more)
    for used in range(3):  # other worlds, other contacts, more and fewer shapes
        chair.reset(world(100 + used, (0.5 * used, 0.2, 0.3)), used)
        drive_for(chair, np.array([0.8, 0.2]), 40)
    episode = world(seed, (0.0, 0.0, rng.uniform(-math.pi, math.pi)))
    chair.reset(episode, seed)
    oracle = Oracle(exact_chair(**more), episode, seed)
    n, lent = len(oracle.actors), oracle.lent.chairs
    actor_states, others = (one.pointers.array("actor_states")[:n] for one in (chair.chairs, lent))
    met, inside, free = set(), [], []
    low, high = ((0.2, -0.8), (0.8, 0.8)) if n else ((1.2, -0.2), (1.8, 0.2))
    for k in range(150):
        if k % 30 == 0:
            twist = rng.uniform(low, high)
        elif k % 30 == 20 and not n:  # off the wall, and at another one
            twist = np.array([-0.8, 1.0])
        chair.drive(twist)
        oracle.drive(monkeypatch, *twist.tolist())
        inside.append(actor_states["in_space"].mean() if n else 0.25)
        free.append(bool(chair.chairs.world_rows["free"][0] > 0.0))
        own = np.array([[*body.position, body.angle] for body in oracle.actors]).reshape(-1, 3)
        equal = np.array_equal(actor_states["pose"], own)
        for one, other, but in (
            (actor_states, others, BOOKKEEPING), (chair.state, lent.states, SENSED),
        ):  # fmt: skip
            names = set(one.dtype.names) - set(but)
            equal &= all(np.array_equal(one[name], other[name]) for name in names)
        if not equal and oracle.max_touched > 1:
            assert actor_states["pose"] == pytest.approx(own, abs=0.05), k
            assert chair.state["pose"] == pytest.approx(lent.states["pose"], abs=0.05), k
            break
        assert equal, k
        if chair.truth.contact:
            met.add(chair.truth.contact_with)
    assert k > 10
    assert met or oracle.max_touched > 1
    assert 0.0 < np.mean(inside) < 0.5
    assert n or 0.0 < np.mean(free) < 1.0

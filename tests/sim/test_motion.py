"""Laws of motion: speeds, ways to stop, turning, energy, contact; in the manner of ISO 7176."""

import math

import numpy as np
import pytest

from tests.copies import same_fields
from tests.sim.worlds import box, cluttered, drives, exact_chair, placed
from wheelchair_gym.engine import GRAVITY
from wheelchair_gym.geometry.kinematics import approach
from wheelchair_gym.geometry.planar import to_world
from wheelchair_gym.sim.settings import BatterySettings, BodySettings

FORWARD, BACKWARD = np.array([0.8, 0.0]), np.array([-0.3, 0.0])
STILL, PIVOT = np.zeros(2), np.array([0.0, 1.0])


def run(chair, twist, steps):
    """Drive; returns true poses (steps + 1, 3) and twists (steps + 1, 2)."""
    poses, twists = [chair.truth.pose], [chair.truth.twist]
    for _ in drives(chair, twist, steps):
        poses.append(chair.truth.pose)
        twists.append(chair.truth.twist)
    return np.array(poses), np.array(twists)


def test_an_approach_ends_on_its_target_and_stays():
    """From any start to any target, exactly, since all callers take zero for rest."""
    rng = np.random.default_rng(0)
    for _ in range(500):
        speed, slope, target = rng.uniform(-1, 1), 0.0, rng.choice([0.0, rng.uniform(-1, 1)])
        for _ in range(3000):
            speed, slope = approach(speed, slope, target, 0.5, 0.8, 1.0, 0.01)
        assert (speed, slope) == (target, 0.0)


def test_a_straight_drive_and_its_stop_keep_the_limits():
    """ISO 7176-6: top speed, held and never beaten by more than 2 %; ISO 7176-3: the way to stop.

    From top speed, jerk 1.0 m/s3 up to 0.8 m/s2, and down again.
    """
    for twist, speed in ((BACKWARD, -0.3), (FORWARD, 0.8)):
        chair = placed(exact_chair(step=0.01), box(50))
        _, twists = run(chair, 2 * twist, 80)
        assert twists[-20:, 0] == pytest.approx(speed, rel=0.005)
        assert np.abs(twists[:, 0]).max() <= abs(speed) * 1.02
    rate = np.diff(twists[:, 0]) / 0.1
    assert rate[7:13].mean() == pytest.approx(0.5, rel=0.02)
    assert rate.max() < 0.5 * 1.05  # while the control learns how hard the casters drag
    poses, twists = run(chair, STILL, 60)
    v, a, j = 0.8, 0.8, 1.0
    # Ramps of deceleration take a/j each and a^2/2j of speed each; here they just meet (v = a^2/j
    # would leave no plateau), and a symmetric fall takes v/a + a/j seconds at half the speed.
    expected = 0.5 * v * (v / a + a / j)
    assert poses[30, 0] - poses[0, 0] == pytest.approx(expected, rel=0.02)
    assert abs(poses[30, 0] - poses[26, 0]) < 1e-3
    assert np.abs(twists[-1]).max() < 1e-4
    assert (np.diff(np.abs(twists[10:, 0])) < 1e-3).all()


def test_a_pivot_turns_about_the_axle_within_the_footprint_circle():
    """ISO 7176-5: pivot width is twice the farthest corner's distance from the axle."""
    chair = placed(exact_chair(), box(50))
    poses, twists = run(chair, PIVOT, 80)
    assert twists[-20:, 1] == pytest.approx(1.0, rel=0.02)
    outlines = np.vstack([to_world(chair.settings.footprint.corners, pose) for pose in poses])
    width = 2 * np.hypot(*outlines.T).max()
    assert width == pytest.approx(2 * chair.settings.footprint.reach, rel=0.02)


def test_a_curve_has_the_radius_that_was_asked_for():
    """ISO 7176-5: turning diameter."""
    chair = placed(exact_chair(), box(50))
    poses, _ = run(chair, np.array([0.5, 0.4]), 300)
    poses = poses[100:]
    centre = np.linalg.lstsq(
        np.column_stack([2 * poses[:, :2], np.ones(len(poses))]),
        (poses[:, :2] ** 2).sum(1),
        rcond=None,
    )[0]
    radius = math.sqrt(centre[2] + centre[0] ** 2 + centre[1] ** 2)
    assert radius == pytest.approx(0.5 / 0.4, rel=0.02)


def test_halving_the_physics_step_hardly_moves_the_end():
    ends, ways = [], []
    commands = np.random.default_rng(3).uniform((0.2, -0.8), (0.8, 0.8), (10, 2))
    for step in (0.01, 0.005):
        chair = placed(exact_chair(step=step), box(50))
        for command in commands:
            run(chair, command, 10)
        ends.append(chair.truth.pose)
        ways.append(chair.truth.distance)
    assert ways[0] > 3.0
    assert np.hypot(*(ends[0] - ends[1])[:2]) < 0.01 * ways[0]


def test_wheels_do_not_slide_sideways_below_the_friction_limit():
    """The axle moves along its mean heading, to rounding, at every physics step."""
    chair = exact_chair()
    chair = type(chair)(chair.settings, chair.sensors, chair.physics, period=0.01)
    chair.reset(box(50), 0)
    rng = np.random.default_rng(0)
    worst = 0.0
    for _ in range(40):
        twist = rng.uniform((-0.3, -1), (0.8, 1))
        for _ in range(10):
            before = chair.state["pose"][0].copy()
            chair.drive(twist)
            move = chair.state["pose"][0] - before
            middle = before[2] + 0.5 * move[2]
            worst = max(worst, abs(move[1] * math.cos(middle) - move[0] * math.sin(middle)))
    assert worst < 2e-6  # m in 10 ms; the axle's arc and its chord differ by as much


def test_a_push_beyond_friction_slides_and_a_weaker_one_does_not():
    """Sideways at the axle, tyres hold up to friction times their load."""
    slid = {}
    for share in (0.8, 1.3):
        chair = placed(exact_chair(), box(50))
        run(chair, STILL, 3)
        body = chair.settings.body
        load = body.mass * GRAVITY * (1 - body.centre_of_mass / body.wheelbase)
        world = chair.chairs.worlds[0]
        assert world is not None
        for _ in range(20):
            # pymunk adds what stands in body.force; the kernel writes it, so push by an impulse.
            impulse = share * body.friction * load * 0.1
            axle = world.body.local_to_world((-body.centre_of_mass, 0.0))
            normal = world.body.rotation_vector.perpendicular()
            world.body.apply_impulse_at_world_point(0.1 * impulse * normal, axle)
            chair.drive(STILL)
        slid[share] = abs(chair.truth.pose[1])
    assert slid[1.3] > 0.0
    assert slid[0.8] < slid[1.3]


def test_no_energy_from_nothing():
    """The battery gives at least the energy of motion, and never gains over a whole drive."""
    free = BatterySettings(idle_power=0.0, regeneration=0.95)
    chair = placed(exact_chair(battery=free), box(50))
    p = chair.parameters[0]
    rng = np.random.default_rng(1)
    for _ in range(60):
        twist = rng.uniform((-0.3, -1), (0.8, 1))
        for _ in drives(chair, twist, 5):
            v, w = chair.truth.twist
            aside = p["body"]["centre_of_mass"] * w
            kinetic = 0.5 * p["mass"] * (v**2 + aside**2) + 0.5 * p["moment"] * w**2
            assert chair.state["energy"][0] >= kinetic
    charge = chair.state["charge"][0]
    assert charge < 0.9 * free.capacity * 3600


def test_a_protective_stop_is_hard_and_keeps_the_curve():
    chair = placed(exact_chair(), box(50))
    run(chair, np.array([0.8, 0.6]), 60)
    before = chair.truth.pose
    chair.drive(FORWARD, True)  # any command
    assert 0.8 - chair.truth.twist[0] > 1.5 * 0.1
    assert chair.state["w"][0] / chair.state["v"][0] == pytest.approx(0.6 / 0.8)
    for _ in range(5):
        chair.drive(STILL, True)
    assert np.abs(chair.truth.twist).max() < 0.01
    x, y, turned = chair.truth.pose - before
    assert turned == pytest.approx(0.6 / 0.8 * math.hypot(x, y), abs=0.04)  # the turn lags


@pytest.mark.parametrize("angle", [0.0, 0.3, 0.8, 1.2, math.pi])
def test_a_wall_stops_the_chair_and_the_bumper_tells(angle):
    """At full speed, at any angle: it stays out of the wall, and reports the bump."""
    chair = placed(exact_chair(), box(3, (0.0, 0.0, angle)))
    command = BACKWARD if angle == math.pi else FORWARD
    bumped = False
    for _ in range(200):
        bumped |= chair.drive(command).bumped
        outline = to_world(chair.settings.footprint.corners, chair.state["pose"][0])
        assert np.abs(outline).max() < 3.0 + 0.02
    assert bumped


def test_a_stalled_chair_does_not_turn_its_wheels():
    chair = placed(exact_chair(), box(2, (0.5, 0.0, 0.0)))
    run(chair, FORWARD, 60)
    before = chair.state["turned"][0].copy()
    run(chair, FORWARD, 20)
    slip = np.abs(chair.state["turned"][0] - before).max() * chair.settings.drive.wheel_radius
    assert slip < 0.02  # m in 2 s at full command


def test_weak_friction_spins_the_wheels():
    slippery = BodySettings(friction=0.05)
    chair = placed(exact_chair(body=slippery), box(50))
    _, twists = run(chair, FORWARD, 20)
    maximum = 0.05 * GRAVITY * (1 - slippery.centre_of_mass / slippery.wheelbase)
    assert (np.diff(twists[:, 0]) / 0.1).max() <= maximum * 1.02


def test_misuse_is_named():
    chair = exact_chair()
    with pytest.raises(ValueError, match="never reset"):
        chair.drive(STILL)
    chair.reset(box(), 0)
    with pytest.raises(ValueError, match="finite"):
        chair.drive(np.array([np.nan, 0.0]))


def test_used_worlds_repeat_fresh_ones():
    """A reset in a used Space gives the same run, bit for bit, contacts included."""
    episode = cluttered(4, (0.0, 0.0, 1.0))
    rng = np.random.default_rng(2)
    commands = rng.uniform((0.5, -0.3), (0.8, 0.3), (120, 2))

    def drive(chair):
        chair.reset(episode, 5)
        hits = 0
        for command in commands:
            chair.drive(command)
            hits += chair.truth.contact
        return chair.state.copy(), hits

    fresh, hits = drive(exact_chair())
    used = placed(exact_chair(), episode, 1)
    run(used, np.array([0.8, -0.6]), 80)
    assert same_fields(drive(used)[0], fresh)
    assert hits >= 5

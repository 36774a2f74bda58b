"""Laws of what moves: walls hold it, sensors see it, the chair is blamed for what it caused."""

import math

import numpy as np
import pytest

from tests.sensors.test_laser import brute_force, nearest_in_cone
from tests.sim.worlds import box, busy, drive_for, drives, exact_chair, placed, wall_gaps
from wheelchair_gym.actors import records
from wheelchair_gym.actors.orca import HALF_PLANES, avoid_wall, best_velocity
from wheelchair_gym.geometry.outline import footprint_clearance
from wheelchair_gym.geometry.planar import to_world
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.sensors.settings import LaserSettings, SensorSettings
from wheelchair_gym.sim.chair import SimulatedChair
from wheelchair_gym.sim.contact import AT_FAULT_SPEED
from wheelchair_gym.sim.settings import BodySettings

STILL, FORWARD = np.zeros(2), np.array([0.8, 0.0])
QUIET = SensorSettings(noise=False, laser=LaserSettings(beams=32))


def actor_states(chair):
    return chair.chairs.pointers.array("actor_states")


def crowds(seeds, **settings):
    """Chairs that stand in crowds, and their episodes."""
    scene = make_scene({"name": "crowd", **settings})
    for seed in seeds:
        episode = scene.sample(np.random.default_rng(seed))
        chair = placed(SimulatedChair(sensors=QUIET), episode, seed)
        yield chair, episode


# --- what sensors see


def test_the_laser_sees_movers_where_they_are():
    """Against brute force in float64 over the shapes at their true poses, all kinds among them."""
    sensors = SensorSettings(noise=False, laser=LaserSettings(beams=181))
    laser = sensors.laser
    seen = 0
    for seed in range(4):
        episode = busy(seed)
        chair = placed(SimulatedChair(sensors=sensors), episode, seed)
        for reading in drives(chair, np.array([0.3, 0.4]), 25):
            truth = chair.truth
            discs, segments = records.actor_shapes(episode.actors, truth.actor_poses)
            x, y = to_world((laser.x, laser.y), truth.pose)
            if any(math.hypot(dx - x, dy - y) < r for dx, dy, r in discs):
                continue  # the sensor is inside a person whom the chair runs down
            walls = np.vstack([episode.walls, segments])
            others = np.vstack([episode.discs, discs])
            own = x, y, truth.pose[2], laser.angles
            expected, coin = brute_force(*own, walls, others, laser.reach)
            fixed, _ = brute_force(*own, episode.walls, episode.discs, laser.reach)
            told = np.where(np.isfinite(reading.laser), reading.laser, laser.reach)
            told = np.where(reading.laser == -np.inf, expected, told)
            assert (np.abs(told - expected) / expected**2)[~coin].max() < 5e-5
            seen += (expected < fixed - 1e-3).sum()
    assert seen > 500


def test_cones_hear_movers_where_they_were_when_fired():
    """Each echo is the nearest of densely cast rays at its own instant, within a period, too.

    In a world where nothing presses a strip, which stops the chair for the rest of a period.
    """
    episode = busy(5)
    at_once, late = (
        placed(SimulatedChair(sensors=QUIET, period=period), episode, 5) for period in (0.06, 0.24)
    )
    rangers = QUIET.ultrasonic
    models = [rangers.narrow if m.model == "narrow" else rangers.wide for m in rangers.mounted]
    twist, heard, near = np.array([0.25, 0.5]), 0, 0
    for k in range(96):
        reading = at_once.drive(twist)
        which = rangers.firing_order[k % 8]
        assert reading.age[which] == 0.0
        truth, mount, model = at_once.truth, rangers.mounted[which], models[which]
        discs, segments = records.actor_shapes(episode.actors, truth.actor_poses)
        x, y = to_world((mount.x, mount.y), truth.pose)
        walls, others = np.vstack([episode.walls, segments]), np.vstack([episode.discs, discs])
        cone = x, y, truth.pose[2] + mount.yaw, model.field_of_view / 2
        nearest = nearest_in_cone(*cone, walls, others, model.reach)
        fixed = nearest_in_cone(*cone, episode.walls, episode.discs, model.reach)
        if nearest < model.reach:
            told = reading.ultrasonic[which]
            assert (
                max(nearest, model.range_min) - 2e-3 <= told <= max(nearest, model.range_min) + 1e-6
            )
            heard += 1
            near += nearest < fixed - 1e-3
        if k % 4 == 3:
            np.testing.assert_array_equal(late.drive(twist).ultrasonic, reading.ultrasonic)
    assert heard > 60
    assert near > 15


# --- what walls hold


def test_nobody_walks_through_a_wall_and_the_way_stays_open():
    """Crowded buildings with powered doors, a minute each: nobody crosses a wall; no lasting jam.

    At most one person in twenty may stand about within a metre for half of the time.
    """
    people, stuck, ways = 0, 0, 0
    for chair, episode in crowds(range(4), place="building", leaf_share=0.8):
        rows = episode.actors.rows
        who = np.flatnonzero(rows["kind"] == records.PERSON)
        track = [actor_states(chair)["pose"][who, :2].copy()]
        for _ in drives(chair, STILL, 600):
            track.append(actor_states(chair)["pose"][who, :2].copy())
            if len(track) % 5 == 0:
                gaps = wall_gaps(track[-1], episode.walls)
                assert (gaps > rows["size"][who, 0] - 0.02).all()
        steps = np.array(track)  # (601, people, 2)
        assert np.hypot(*np.diff(steps, axis=0).T).max() < 0.3  # m in 0.1 s: none is hurled through
        for k, row in enumerate(who):
            own = steps[:, k]
            spans = [np.ptp(own[at : at + 300], axis=0).max() for at in range(0, 300, 20)]
            stuck += min(spans) < 1.0
            ends = episode.actors.route(int(row))[[0, -1]]
            reached = [np.hypot(*(own - end).T).min() < 0.8 for end in ends]
            ways += all(reached)
            people += 1
    assert people >= 20
    assert stuck <= 0.05 * people
    assert ways >= 0.7 * people  # the others have long ways


def test_a_person_who_ignores_the_chair_is_stopped_and_does_not_move_it():
    """From all sides at once, chair against the wall: it stays, and its strips are pressed."""
    sides = [(x, y) for x in (-3.0, 0.2, 3.0) for y in (-2.0, 0.0, 2.5) if abs(x) > 1 or abs(y) > 1]
    crowd = [records.person([side, (0.2, 0.0)], 1.8, avoids=records.NOBODY) for side in sides]
    start = (0.2, -2.66, 0.0)
    chair = placed(exact_chair(), box(3.0, start, actors=crowd))
    touched = set()
    for reading in drives(chair, STILL, 300):
        truth = chair.truth
        assert not truth.at_fault
        if truth.contact and truth.other_approach_speed > 0.1:
            assert reading.bumped
            touched.add(truth.contact_with)
        assert np.hypot(*(truth.pose - start)[:2]) < 1e-3
    assert touched


def test_people_never_press_the_chair_through_a_wall_while_it_drives():
    """It pushes through a crowd that ignores it, along a wall: outline and people stay inside."""
    crowd = [
        records.person(
            [(x, -2.6), (-x, -2.5)], 1.6, avoids=records.PEOPLE if k % 2 else records.NOBODY
        )
        for k, x in enumerate((-2.5, -1.9, 2.5, 1.9, 1.2))
    ]
    crowd.append(records.furniture((0.9, -1.5, 0.0), (0.5, 0.4), 8.0))
    episode = box(3.0, (-0.8, -2.55, 0.1), actors=crowd)
    chair = placed(exact_chair(), episode, 1)
    rng, contacts = np.random.default_rng(0), 0
    for k in range(400):
        if k % 20 == 0:
            twist = rng.uniform((-0.3, -1), (0.8, 1))
        chair.drive(twist)
        contacts += chair.truth.contact
        outline = to_world(chair.settings.footprint.corners, chair.truth.pose)
        assert np.abs(outline).max() < 3.0 + 0.02
        assert np.abs(actor_states(chair)["pose"][:5, :2]).max() < 3.0 - 0.25 + 0.02
        assert np.isfinite(actor_states(chair)["pose"]).all()
    assert contacts > 20


def test_light_furniture_is_pushed_and_stays_where_it_is_left():
    for size in ((0.5, 0.4), (0.2, 0.0)):
        chair = placed(exact_chair(), box(actors=[records.furniture((1.3, 0.0, 0.0), size, 8.0)]))
        assert any([reading.bumped for reading in drives(chair, FORWARD, 30)])
        assert chair.truth.contact_with in (0, -1)
        drive_for(chair, STILL, 30)
        before = chair.truth.actor_poses[0].copy()
        assert before[0] > 1.3 + 0.05  # the bumper makes the chair stop, again and again
        drive_for(chair, np.array([-0.3, 0.0]), 20)
        np.testing.assert_allclose(chair.truth.actor_poses[0], before, atol=1e-6)


# --- who caused it


@pytest.mark.parametrize(
    ("thing", "at_fault", "contact_with"),
    [
        (records.person([(1.5, 0.0)]), True, 0),  # someone who stands there
        (
            records.person([(1.5, 0.1), (3.5, 0.1)], 1.5, avoids=records.PEOPLE),
            None,
            0,
        ),  # comes back at last
        (records.obstacle((2.2, 0.1), 0.2, minimum=0.9), True, 0),
        (records.door((2.0, -0.5), math.pi / 2, 1.0, 1.0), True, 0),
        (records.furniture((1.5, 0.0, 0.3), (0.4, 0.4), 6.0), True, 0),
        (records.person([(-4.0, -4.0)]), True, -1),  # far off: the wall it is
    ],
)
def test_a_chair_that_drives_into_something_is_at_fault(thing, at_fault, contact_with):
    chair = placed(exact_chair(), box(3.0, actors=[thing]))
    reading = next(one for one in drives(chair, FORWARD, 120) if chair.truth.contact)
    truth = chair.truth
    assert reading.bumped
    assert truth.contact_with == contact_with
    own, other = truth.approach_speed, truth.other_approach_speed
    assert truth.at_fault == (own > AT_FAULT_SPEED and own > other)
    assert at_fault is None or truth.at_fault == at_fault
    if contact_with == -1 or at_fault:
        assert own == pytest.approx(0.8, abs=0.35)


@pytest.mark.parametrize("twist", [(0.0, 0.0), (0.0, 0.06), (0.0, -0.06), (0.03, 0.0)])
def test_a_chair_that_is_shoved_into_a_wall_has_not_caused_it(twist):
    """Somebody pushes a trolley into its back; the wall is 20 cm ahead."""
    trolley = records.furniture((3.4, 0.1, 0.0), (0.6, 0.6), 120.0, 0.02)
    runner = records.person([(1.5, 0.1), (6.0, 0.1)], 2.0, avoids=records.NOBODY, mass=200.0)
    chair = placed(exact_chair(), box(5.0, (4.1, 0.0, 0.0), actors=[trolley, runner]))
    hardest = 0.0
    for _ in drives(chair, np.array(twist), 60):
        truth = chair.truth
        assert not truth.at_fault
        hardest = max(hardest, truth.approach_speed * (truth.contact_with == -1))
    assert hardest > 0.3


@pytest.mark.parametrize("friction", [0.05, 0.2, 0.7])
def test_a_chair_that_slides_into_a_wall_has_caused_it(friction):
    """It is told to stand when it is too late: what it still does is its own doing."""
    chair = placed(exact_chair(body=BodySettings(friction=friction)), box(5.0))
    stop_at = 5.0 - 0.7 - 0.15
    for _ in range(120):
        chair.drive(FORWARD if chair.truth.pose[0] < stop_at else STILL)
        if chair.truth.contact:
            break
    assert chair.truth.at_fault
    assert chair.truth.approach_speed > 0.3


def test_a_standing_chair_never_causes_a_collision():
    """Most are cylinders that avoid nobody; many drive into it, and none is its fault."""
    blind = {"density": (0.08, 0.12), "inattentive_share": 0.5, "crossing_share": 0.7}
    contacts = bumps = 0
    for chair, _ in crowds(
        range(12), place="hall", hall_size=(6.0, 8.0), people=blind, furniture_density=0.03
    ):
        for reading in drives(chair, STILL, 300):
            assert not chair.truth.at_fault
            contacts += chair.truth.contact
            bumps += reading.bumped
            assert chair.truth.contact or not reading.bumped
    assert bumps > 20
    assert contacts >= bumps


@pytest.mark.parametrize("blind", [0.0, 1.0])
def test_people_walk_round_a_chair_that_stands(blind):
    """In dense halls; those who pay no attention see it late, but see it."""
    contacts = steps = 0
    seeing = {"density": (0.08, 0.1), "inattentive_share": blind}
    for chair, _ in crowds(range(6), place="hall", people=seeing, furniture_density=0.0):
        for _ in drives(chair, STILL, 300):
            contacts += chair.truth.contact
            steps += 1
    assert contacts <= 0.002 * steps


# --- doors and obstacles


def test_a_door_opens_for_the_chair_and_never_closes_on_it():
    leaf = records.door((1.0, -0.5), math.pi / 2, 1.0, -1.0, swings=False, near=1.2)
    swing = records.door((-1.5, -0.5), math.pi / 2, 1.0, math.pi / 2, stay=2.0, every=6.0)
    episode = box(4.0, (-0.6, 0.0, 0.0), actors=[leaf, swing])
    chair = placed(exact_chair(), episode)
    shares = []
    for k in range(200):
        # Through the sliding door and back again, standing in it for a while.
        chair.drive(np.array([0.3 if k < 60 else (0.0 if k < 110 else -0.2), 0.0]))
        assert not chair.truth.contact
        shares.append(actor_states(chair)["opening"][:2].copy())
        discs, segments = records.actor_shapes(episode.actors, chair.truth.actor_poses)
        outline = chair.settings.footprint.array
        assert footprint_clearance(*chair.truth.pose, outline, segments, discs, 1.0) > 0.0
    shares = np.array(shares)
    assert shares[60:110, 0].min() == 1.0
    assert shares[0, 0] < 1.0
    assert 0.25 < (shares[:, 1] > 0.5).mean() < 0.5  # 2 s of 6, and the time it takes to move


def test_a_leaf_seen_end_on_is_as_wide_as_it_is_thick():
    """40 mm of it, 1 m ahead of the laser."""
    chair = exact_chair()
    reading = chair.reset(box(actors=[records.door((1.66, 0.0), 0.0, 1.0, 1.0)]), 0)
    on = np.flatnonzero(reading.laser < 1.5)
    angles = chair.sensors.laser.angles[on]
    assert np.ptp(angles) == pytest.approx(2 * math.atan(0.02), abs=math.radians(0.5))
    np.testing.assert_allclose(reading.laser[on] * np.cos(angles), 1.0, atol=1e-5)


def test_a_leaf_that_is_held_waits_at_a_distance():
    """It closes on a timetable while the chair stands in its way."""
    leaf = records.door((0.0, 1.0), 0.0, 1.2, -math.pi / 2, since=0.0, stay=3.0, minimum=0.15)
    chair = placed(exact_chair(), box(actors=[leaf]))
    for _ in drives(chair, STILL, 80):
        _, segments = records.actor_shapes(chair._episode.actors, chair.truth.actor_poses)
        gap = footprint_clearance(*chair.truth.pose, chair.settings.footprint.array, segments,
                                  np.empty((0, 3)), 1.0)  # fmt: skip
        assert gap >= 0.15 - 0.02
    assert not chair.truth.touched


def test_a_leaf_closes_on_nobody_while_it_leaves_another():
    """Somebody stands close behind it, the chair before it: either holds it by itself."""
    leaf = records.door((0.0, 1.0), 0.0, 1.2, -math.pi / 2, stay=20.0, since=0.0)
    behind = records.person([(0.6, 1.28)])
    chair = placed(exact_chair(), box(start=(0.1, 0.35, 0.0), actors=[leaf, behind]))
    for _ in drives(chair, STILL, 60):
        assert not chair.truth.contact
    assert 0.0 < actor_states(chair)["opening"][0] < 1.0


def test_obstacles_appear_at_their_distance_and_go_again():
    things = [records.obstacle((2.5, 0.0), 0.25, near=1.4, minimum=1.2, stay=3.0),
              records.obstacle((0.9, 0.2), 0.25, since=1.0, minimum=1.2, stay=1.0)]  # fmt: skip
    chair = placed(exact_chair(), box(actors=things))
    there, first = [], math.nan
    for k in range(80):
        chair.drive(np.array([0.2 if k < 30 else 0.0, 0.0]))
        there.append(np.isfinite(chair.truth.actor_poses[:, 0]))
        if there[-1][0] and math.isnan(first):
            corners = to_world(chair.settings.footprint.corners, chair.truth.pose)
            first = np.hypot(*(corners - (2.5, 0.0)).T).min() - 0.25
    there = np.array(there)
    assert 29 <= there[:, 0].sum() <= 31
    assert 1.2 <= first <= 1.5
    assert not there[0, 0]
    assert not there[:, 1].any()  # the chair is too near all along


def test_what_is_absent_is_sensed_nowhere():
    waits = records.obstacle((0.0, 0.0), since=1e6)
    for x, y in ((-1e4, 1e4), (1e4, 1e4), (-9e6, 9e6)):
        reading = exact_chair().reset(box(start=(x - 2.0, y, 0.0), actors=[waits]), 0)
        assert np.isposinf(reading.laser).all()


# --- velocities


def test_a_chosen_velocity_is_the_best_that_is_allowed():
    """Against dense sampling of all velocities, walls only."""
    rng = np.random.default_rng(5)
    grid = np.stack(np.meshgrid(*[np.linspace(-1.5, 1.5, 121)] * 2), axis=-1).reshape(-1, 2)
    grid = grid[np.hypot(*grid.T) <= 1.5]
    for _ in range(200):
        lines = np.zeros((2 * HALF_PLANES, 4))
        count = 0
        for _ in range(rng.integers(0, 6)):
            turn = rng.uniform(-math.pi, math.pi)
            own = math.cos(turn), math.sin(turn)
            count = avoid_wall(lines, count, *own, rng.uniform(0.0, 0.6), 0.5)
        want = rng.uniform(-1.5, 1.5, 2)
        found = np.array(best_velocity(lines, count, count, 1.5, *want))
        assert np.hypot(*found) <= 1.5 + 1e-9

        def room(points, lines=lines[:count]):
            across = lines[:, 2] * (points[:, None, 1] - lines[:, 1])
            across -= lines[:, 3] * (points[:, None, 0] - lines[:, 0])
            return across.min(axis=1, initial=1.0)

        assert room(found[None])[0] >= -1e-6  # standing still is always allowed
        best = np.hypot(*(grid[room(grid) >= 0.0] - want).T).min(initial=math.inf)
        assert np.hypot(*(found - want)) <= best + 1e-9

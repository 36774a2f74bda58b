"""Laws of the shield: it stops in time, leaves a way out, and trusts no dead sensor."""

import math

import numpy as np
import pytest

from tests.copies import same_fields
from tests.sim.worlds import box, step
from wheelchair_gym.actors.records import NOBODY, door, person
from wheelchair_gym.geometry.kinematics import Limits
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import to_frame
from wheelchair_gym.safety import Shield, ShieldSettings
from wheelchair_gym.safety.decision import _BLOCK
from wheelchair_gym.safety.grid import place_of_cell
from wheelchair_gym.safety.memory import last_rows
from wheelchair_gym.safety.shield import filter_twist
from wheelchair_gym.safety.state import CELLS, KEPT, NEARBY, POINT, POINTS, REASONS, SAMPLES
from wheelchair_gym.sensors.settings import FaultSettings, LaserSettings, SensorSettings
from wheelchair_gym.sim.chair import SimulatedChair
from wheelchair_gym.sim.settings import BodySettings, ChairSettings
from wheelchair_gym.sim.state import DECEITS
from wheelchair_gym.sim.state import FAULTS as KINDS
from wheelchair_gym.types import Reading

AHEAD, BACK, LEFT = np.array([0.8, 0.0]), np.array([-0.3, 0.0]), np.array([0.0, 1.0])
STILL = np.zeros(2)
UNSEEN = ShieldSettings().unseen_speed
LEVER = math.hypot(Footprint().rear, Footprint().half_width)  # of a rear corner


def begin(world, key, sensors=None):
    """A chair in a world, its shield, and the first reading."""
    chair = SimulatedChair(sensors=sensors)
    return chair, Shield(sensors=sensors), chair.reset(world, key)


def drive(
    start, twist, seconds, *, half=5.0, key=3, own=None, sensors=None, period=0.1, shield=None,
    told=lambda k, reading: reading, **things
):  # fmt: skip
    """Ask for one twist, or for that of each period k, in a square room of things.

    Returns:
        Decision and truth of each period, the chair and the shield, which sees what is `told`.
    """
    chair = SimulatedChair(own, sensors, period=period)
    shield = shield or Shield(chair=own, sensors=sensors, period=period)
    shield.reset()
    reading, trace = chair.reset(box(half, start, **things), key), []
    for k in range(round(seconds / period)):
        asked = twist(k) if callable(twist) else twist
        reading = step(chair, shield, asked, told(k, reading))
        trace.append((shield.decision, chair.truth))
    return trace, chair, shield


def hits(trace):
    """Return True if the chair caused a contact."""
    return any(truth.at_fault for _, truth in trace)


@pytest.mark.parametrize(
    ("start", "twist"),
    [
        ((0.0, 0.0, 0.0), (0.8, 0.0)),
        ((0.0, 0.0, 0.7), (0.8, 0.1)),
        ((2.5, 2.5, 0.8), (0.8, 0.3)),
        ((0.0, 4.5, 0.1), (0.8, 0.05)),
        ((0.0, 0.0, 2.0), (0.8, -0.05)),
    ],
)
def test_it_stops_before_a_wall_and_near_it(start, twist):
    trace, chair, _ = drive(start, twist, 14.0)
    assert not chair.truth.touched
    assert abs(trace[-1][1].twist).max() < 0.01
    assert 0.0 < trace[-1][1].clearance < 0.10
    assert trace[-1][0].reason == "obstacle"


@pytest.mark.parametrize(
    ("key", "offset"), [(3, 0.0095), (44, 0.0084), (153, 0.0085), (198, 0.0013), (330, 0.0027)]
)
def test_the_end_of_a_door_leaf_stops_it(key, offset):
    """Hinged straight ahead, open: 40 mm are all that the laser sees of it."""
    leaf = door((1.0, offset), 0.0, 1.0, math.pi / 2)
    _, chair, _ = drive((-3.5, 0.0, 0.0), AHEAD, 8.0, key=key, actors=[leaf])
    assert not chair.truth.touched


@pytest.mark.parametrize("radius", [0.0005, 0.001, 0.0045])
def test_what_one_beam_meets_again_stops_it(radius):
    rng = np.random.default_rng(0)
    for key in range(15):
        post = (1.0, rng.uniform(0.0, 0.010), radius)
        trace, _, _ = drive((-3.5, 0.0, 0.0), AHEAD, 8.0, key=key, discs=post)
        assert max(truth.approach_speed * truth.at_fault for _, truth in trace) <= 0.05


def test_ghosts_that_one_beam_meets_do_not_stop_it():
    """Three false near echoes in each scan, anywhere; now and then two are by chance alike."""
    rng = np.random.default_rng(0)

    def haunted(_, reading):
        laser = reading.laser.copy()
        for beam in rng.integers(1, len(laser) - 1, 3):
            laser[beam] = rng.uniform(0.3, laser[beam] if laser[beam] < 10.0 else 10.0)
        return reading._replace(laser=laser)

    trace, chair, _ = drive((-8.0, 0.0, 0.0), AHEAD, 15.0, half=9.0, key=1, told=haunted)
    assert sum(decision.reason != "" for decision, _ in trace) <= 10
    assert chair.truth.pose[0] > 3.0


def rib(depth, place):
    """9 mm wide, before the wall at x = 5 m."""
    x, low, high = 5.0 - depth, place - 0.0045, place + 0.0045
    return [(5.0, low, x, low), (x, low, x, high), (x, high, 5.0, high)]


@pytest.mark.parametrize("depth", [0.03, 0.045, 0.055, 0.07, 0.09])
def test_a_rib_before_a_wall_is_not_averaged_away(depth):
    """No arc of beams that meets both is so near the wall that the margin does not cover it."""
    for key in range(12):
        start = (5.0 - depth - 0.70 - 0.05, 0.0, 0.0)
        beams = rib(depth, 0.02 * key - 0.11)
        _, _, shield = drive(start, STILL, 0.3, key=key, walls=beams)
        margin = shield._constants.record["stop_margin"][0]
        assert shield.state["gap"][0] < 0.05 + margin - 0.005


@pytest.mark.parametrize(("depth", "key", "place"), [(0.055, 71, -0.065), (0.065, 59, -0.044)])
def test_at_50_hertz_it_creeps_onto_no_rib(depth, key, place):
    walls = rib(depth, place)
    assert not hits(drive((1.0, 0.0, 0.0), AHEAD, 9.0, key=key, period=0.02, walls=walls)[0])


@pytest.mark.parametrize("mass", [20.0, 60.0, 270.0])
@pytest.mark.parametrize("friction", [0.31, 0.9])
def test_the_lightest_and_the_heaviest_that_is_taken_stops_in_time(mass, friction):
    settings = ChairSettings(body=BodySettings(mass=mass, friction=friction))
    for key, twist in enumerate(((0.8, 0.0), (0.8, 0.1), (0.8, 0.4))):
        trace, _, _ = drive((0.0, 0.0, 0.3), twist, 7.0, half=3.0, key=key, own=settings)
        assert not hits(trace)


def test_with_less_to_brake_with_a_chair_of_lower_limits_is_taken():
    limits = Limits(
        forward=0.3, turn=0.5, acceleration=0.2, deceleration=0.3, protective=0.5,
        turn_acceleration=0.8,
    )  # fmt: skip
    settings = ChairSettings(body=BodySettings(friction=0.1), limits=limits)
    trace, chair, _ = drive((0.0, 0.0, 0.3), AHEAD, 12.0, half=3.0, key=1, own=settings)
    assert not hits(trace)
    assert chair.truth.clearance < 0.2


def test_in_the_open_nothing_is_changed():
    trace, _, _ = drive((-4.0, 0.0, 0.0), AHEAD, 3.0)
    assert all(decision.reason == "" for decision, _ in trace)
    assert all(np.array_equal(decision.given, AHEAD) for decision, _ in trace)


def test_a_twist_is_scaled_and_keeps_its_curvature():
    trace, _, _ = drive((2.0, 2.0, 0.8), (0.8, 0.3), 8.0)
    changed = [decision for decision, _ in trace if decision.reason]
    assert changed
    for decision in changed:
        share = decision.given[0] / 0.8
        assert 0.0 <= share < 1.0
        assert decision.given[1] == pytest.approx(0.3 * share)


@pytest.mark.parametrize("twist", [BACK, (-0.3, 0.4), LEFT, (0.0, -1.0)])
def test_nowhere_unseen_faster_than_a_walking_stick(twist):
    """Standing since ever, nothing behind the laser was seen: in reverse, and in a pivot."""
    trace, _, _ = drive((0.0, 0.0, 0.0), twist, 1.5)
    for _, truth in trace:
        v, w = truth.twist
        corner = max(math.hypot(v - side * w * 0.31, -0.3 * w) for side in (-1, 1))
        assert corner <= UNSEEN
    assert corner > 0.6 * UNSEEN  # it creeps, and does not stand


def test_back_along_the_way_it_came_it_may_go_faster_where_that_is_trusted_for_longer():
    """Doors fall to behind a chair: for who stops within a second it is not."""
    fastest = []
    for vacated in (1.0, 3.0):
        shield = Shield(ShieldSettings(vacated_time=vacated))
        to_and_fro = lambda k: (0.5, 0.0) if k < 20 else BACK  # noqa: E731
        trace, _, _ = drive((-2.0, 0.0, 0.0), to_and_fro, 5.0, key=1, shield=shield)
        fastest.append(max(-truth.twist[0] for _, truth in trace))
    assert 0.6 * UNSEEN < fastest[0] <= UNSEEN
    assert fastest[1] > 1.5 * UNSEEN


@pytest.mark.parametrize(
    ("start", "way_out"),
    [
        ((4.26, 0.0, 0.0), BACK),  # a wall ahead, 4 cm off
        ((4.29, 0.0, 0.0), BACK),  # 1 cm
        ((0.0, 4.66, 0.0), (0.3, 0.0)),  # beside it, 3 cm
        ((0.0, 4.68, 0.0), BACK),
    ],
)
def test_a_way_out_is_left(start, way_out):
    trace, chair, _ = drive(start, way_out, 8.0)
    assert not chair.truth.touched
    moved = np.abs(trace[-1][1].pose - start)
    assert max(moved[0], moved[2]) > 0.2


@pytest.mark.parametrize("turn", [(0.3, -1.0), (0.0, -0.3), (-0.1, -0.3)])
def test_what_slipped_out_of_view_is_remembered(turn):
    """A post that the laser saw stands beside the rear when the chair turns, for long, too."""
    post = [(0.9, 0.55, 0.9, 0.60), (0.9, 0.60, 0.95, 0.60), (0.95, 0.60, 0.9, 0.55)]
    asked = lambda k: AHEAD if k < 22 else turn  # noqa: E731
    trace, _, _ = drive((0.0, 0.0, 0.0), asked, 90.0, key=1, walls=post)
    assert not any(truth.touched for _, truth in trace)


def test_of_more_than_it_remembers_the_last_is_kept():
    rows = np.zeros(KEPT + 40, POINT)
    rows["x"] = np.arange(len(rows))
    assert last_rows(rows, len(rows), KEPT) == KEPT
    assert rows["x"][0] == 40
    assert rows["x"][KEPT - 1] == KEPT + 39
    assert last_rows(rows, 7, KEPT) == 7
    assert rows["x"][0] == 40


@pytest.mark.parametrize("beams", [1081, 2161, 4321, 20000])
def test_of_a_scan_with_more_edges_than_fit_nothing_ahead_is_lost(beams):
    """Rods everywhere beside a wall that loses its echo in the middle, and a post before it."""
    sensors, rng = SensorSettings(laser=LaserSettings(beams=beams)), np.random.default_rng(0)
    shield, at = Shield(sensors=sensors), sensors.laser.angles
    post = np.argmin(np.abs(at - 0.3))  # of a single beam
    unheard = np.full(sensors.ultrasonic.columns, np.nan, np.float32)
    for k in range(24):
        ranges = 2.0 / np.cos(at) + rng.normal(0.0, 0.01, beams)
        ranges[post] = 1.2
        rods = rng.uniform(0.8, 3.4, beams)
        ranges = np.where(np.abs(at) > 0.8, rods, ranges)
        ranges[(np.abs(at) < 0.05) & (k > 20)] = np.inf
        scan = ranges.astype(np.float32)
        told = Reading(STILL, STILL, scan, unheard, unheard + np.inf, False, 24.0, 0.1 * k)
        shield.filter(STILL, told._replace(pose=np.zeros(3)))
    state, laser = shield.state[0], sensors.laser
    x, y = (state["points"][name][: state["n_points"]] - start
            for name, start in (("x", laser.x), ("y", laser.y)))  # fmt: skip
    for angle in np.linspace(-0.75, 0.75, 31):
        far = 1.2 if abs(angle - 0.3) < 1e-9 else 2.0 / math.cos(angle)
        off = np.hypot(x - far * math.cos(angle), y - far * math.sin(angle)).min()
        assert off < (0.05 if far == 1.2 else 0.10), angle


def test_after_a_reset_nothing_of_an_earlier_run_is_left():
    """In an empty hall, where no later scan replaces it."""
    chair, shield, reading = begin(box(60.0), 1)
    shield.state.view(np.uint8)[:] = 1
    shield.reset()
    fresh = Shield()
    for _ in range(20):
        np.testing.assert_array_equal(shield.filter(AHEAD, reading), fresh.filter(AHEAD, reading))
        reading = chair.drive(shield.decision.given)
    assert chair.truth.twist[0] > 0.3


def test_a_twist_that_is_not_finite_is_refused_and_never_driven():
    _, shield, reading = begin(box(5.0), 1)
    for twist in ((np.nan, 0.0), (0.5, np.nan), (np.inf, 0.0)):
        with pytest.raises(ValueError, match="expected two finite numbers"):
            shield.filter(np.array(twist), reading)
        assert filter_twist(0, shield.pointers.record, *twist)[:2] == (0.0, 0.0)


FAULTS = [name for name in REASONS if name.endswith(("silent", "frozen"))]


@pytest.mark.parametrize("name", FAULTS)
def test_dead_sensors_stop_it_until_a_person_re_arms(name):
    which, how = name.split()
    chair, shield, reading = begin(box(9.0, (-8.0, 0.0, 0.0)), 5)
    kept: Reading | None = None
    stopped = math.nan
    limits = {"laser": 0.2, "ultrasonic": 1.0, "odometry": 0.1}
    twist = np.array([0.5, 0.1])
    for k in range(60):
        told = reading
        if k >= 20:
            told = fail(reading, kept, which, how, 0.1 * (k - 19))
        else:
            kept = reading
        given = shield.filter(twist, told)
        if k < 20:
            assert given.any()
        if not given.any() and math.isnan(stopped):
            stopped = 0.1 * (k - 19)
        reading = chair.drive(given, shield.decision.protective)
    assert stopped <= limits[which] + 0.2 + 1e-9
    assert shield.latched == name
    assert shield.decision.reason == name
    assert abs(chair.truth.twist).max() < 0.01
    for asked, goes in ((twist, False), (np.zeros(2), False), (twist, False)):
        reading = step(chair, shield, asked, reading)  # well again: still latched
        assert shield.decision.given.any() == goes
    shield.rearm()
    reading = step(chair, shield, twist, reading)
    assert not shield.decision.given.any()  # it must be told to stand first
    reading = step(chair, shield, np.zeros(2), reading)
    assert shield.latched == ""
    for _ in range(5):
        reading = step(chair, shield, twist, reading)
    assert shield.decision.given.any()


def fail(reading, kept, which, how, since):
    """Return the reading of a chair while a sensor fails."""
    if which == "laser":
        nothing = np.full_like(reading.laser, np.nan)
        return reading._replace(laser=kept.laser if how == "frozen" else nothing)
    if which == "ultrasonic":
        age = kept.age if how == "frozen" else kept.age + np.float32(since)
        return reading._replace(ultrasonic=kept.ultrasonic, age=age)
    if how == "silent":
        return reading._replace(twist=np.full(2, np.nan))
    return reading._replace(twist=kept.twist, pose=kept.pose)


def test_a_chair_that_stands_in_a_world_without_noise_is_not_frozen():
    quiet, asked = SensorSettings(noise=False), lambda k: AHEAD if k > 50 else STILL
    _, chair, shield = drive((0.0, 0.0, 0.0), asked, 8.0, key=1, sensors=quiet)
    assert shield.latched == ""
    assert chair.truth.twist[0] > 0.5


def test_a_scan_without_any_echo_is_not_frozen():
    trace, chair, shield = drive((0.0, 0.0, 0.0), AHEAD, 4.0, half=40.0)
    assert np.isposinf(chair.reset(box(40.0), 1).laser).all()
    assert shield.latched == ""
    assert trace[-1][1].twist[0] > 0.75


def test_the_end_of_a_leaf_seen_aslant_is_where_it_is():
    """The laser at (0.66, 0) looks along it: neighbouring beams differ by centimetres."""
    leaf = [(0.48, -0.34, 0.44, -1.36)]
    gaps = [
        drive((0.0, 0.0, 0.0), STILL, 0.4, key=key, walls=leaf)[2].state["gap"][0]
        for key in range(20)
    ]
    assert abs(np.mean(gaps) - 0.03) < 0.01


def glassy(reading, distance, ranger=0):
    """A reading in which one ultrasonic hears something that the laser sees through."""
    ranges = np.full_like(reading.ultrasonic, np.inf)
    ranges[ranger] = distance
    return reading._replace(ultrasonic=ranges)


def test_an_echo_that_no_laser_explains_stops_it_once_it_is_heard_again():
    chair, shield, reading = begin(box(6.0, (-4.0, 0.0, 0.0)), 1)
    pane = -1.0  # of glass, x [m]
    for _ in range(90):
        ahead = pane - chair.truth.pose[0] - 0.70
        reading = step(chair, shield, AHEAD, glassy(reading, max(ahead, 0.02)))
    assert -0.02 < pane - chair.truth.pose[0] - 0.70 < 0.3
    assert abs(chair.truth.twist[0]) < 0.01


def test_a_lone_ghost_and_an_echo_that_a_laser_explains_change_nothing():
    ghost = lambda k, reading: glassy(reading, 0.6) if k == 20 else reading  # noqa: E731
    trace, _, _ = drive((-4.0, 0.0, 0.0), AHEAD, 4.0, half=6.0, key=1, told=ghost)
    assert {decision.reason for decision, _ in trace} == {""}
    # Beside a wall a wide cone hears it all the time.
    trace, _, _ = drive((-4.0, 4.45, 0.0), (0.5, 0.0), 6.0)
    assert {decision.reason for decision, _ in trace} == {""}


def test_glass_beside_it_is_no_frozen_ultrasonic():
    """Oblique rangers hear it at one range all along; the laser sees through it."""
    chair, shield, reading = begin(box(6.0, (-5.0, 4.8, 0.0)), 1)
    for _ in range(160):
        _, y, yaw = chair.truth.pose
        left = np.maximum(np.sin(LaserSettings().angles + yaw), 1e-9)
        behind = y + 0.66 * math.sin(yaw) + reading.laser * left > 5.8
        laser = np.where(behind, np.float32(np.inf), reading.laser)
        reading = step(chair, shield, np.array([0.5, 0.0]), reading._replace(laser=laser))
        assert shield.latched == ""
    assert np.nanmin(reading.ultrasonic[[4, 6]]) < 1.3
    assert chair.truth.pose[0] > 0.0


def test_a_failed_sensor_of_the_simulation_is_what_the_shield_latches():
    """Sensors that repeat or say nothing are named; a laser that deceives does no harm."""
    faults = FaultSettings(share=1.0, onset=(0.5, 1.0))
    sensors = SensorSettings(faults=faults, pose_source="odometry")
    found: dict[str, set[str]] = {}
    for key in range(80):  # six of a kind
        trace, chair, shield = drive((-3.0, 0.5, 0.2), (0.4, 0.15), 5.0, key=key, sensors=sensors)
        kind = KINDS[int(chair.chairs.states["fault"][0])]
        found.setdefault(kind, set()).add(shield.latched)
        assert max(truth.approach_speed * truth.at_fault for _, truth in trace) <= 0.05
    assert set(found) == set(KINDS[1:])
    for kind, latched in found.items():
        why = "laser frozen" if kind == "laser stuck" else "laser disagrees"
        assert (why if kind in DECEITS and kind != "laser blind" else kind) in latched
        assert len(latched) == 1 or kind not in FAULTS


def test_a_person_who_walks_up_from_behind_does_not_stop_it():
    follower = person([(-3.2, 0.9), (7.0, 0.9)], 0.6, avoids=NOBODY)
    trace, chair, _ = drive((-2.0, 0.0, 0.0), AHEAD, 6.0, half=8.0, actors=[follower])
    assert not any(decision.reason == "moving" for decision, _ in trace)
    assert chair.truth.twist[0] > 0.75


def test_a_person_who_steps_before_it_stops_it():
    crosses = person([(2.6, 4.0), (2.6, -4.0)], 1.2, avoids=NOBODY)
    trace, _, _ = drive((0.0, 0.0, 0.0), AHEAD, 5.0, half=8.0, actors=[crosses])
    assert any(decision.reason == "moving" for decision, _ in trace)
    assert not hits(trace)
    speeds = np.array([truth.twist[0] for _, truth in trace])
    hard = np.array([decision.protective for decision, _ in trace])[1:]
    assert np.diff(speeds)[hard].min() < -0.15  # a period of a protective stop


@pytest.mark.parametrize("speed", [0.02, 0.04, 0.06, 0.08, 0.10, 0.12, 0.14])
def test_on_its_way_through_rest_it_is_not_at_rest(speed):
    """Its slope carries it on, at up to v - a^2 / 2j, faster than it may behind."""
    _, _, shield = drive((0.0, 0.0, 0.0), (0.0, 0.0), 0.5)
    given = shield.limit_for_unseen_space(BACK[None], np.array([speed, -0.75, 0.0, 0.0]))[0]
    assert given[0] == 0.0


def test_a_person_who_has_left_its_view_may_stand_behind_it():
    """Somebody walks past a chair that turns, and on behind it, where the laser sees nothing."""
    passer = person([(3.0, -1.2), (-4.0, -1.2)], 1.2, avoids=NOBODY)
    trace, _, _ = drive((0.0, 0.0, 0.0), LEFT, 4.5, half=8.0, actors=[passer])
    ahead = [to_frame(truth.actor_poses[:1, :2], truth.pose)[0, 0] for _, truth in trace]
    turns = np.array([LEVER * truth.twist[1] for _, truth in trace])
    seen, hidden = np.array(ahead) > 0.0, np.array(ahead) < -1.4
    assert turns[seen].max() > 0.07  # as fast as it may where nobody has seen
    assert hidden.sum() > 5
    assert turns[hidden].max() < 0.05


@pytest.mark.parametrize("corner", [(-75, 12), (0, 0), (31, -640)])
def test_each_cell_of_the_grid_has_a_place_of_its_own(corner):
    i, j = np.ogrid[:CELLS, :CELLS]
    places = place_of_cell.py_func(i + corner[0], j + corner[1])
    assert sorted(places.ravel()) == list(range(CELLS * CELLS))


def test_for_a_planner_only_the_unseen_slows_and_nothing_is_decided():
    _, _, shield = drive((0.0, 0.0, 0.0), (0.0, 0.0), 0.5, half=1.5)
    before = shield.state.copy()
    ahead, left, back = shield.limit_for_unseen_space(np.array([AHEAD, LEFT, BACK]), np.zeros(4))
    np.testing.assert_array_equal(ahead, AHEAD)  # though a wall is near
    assert 0.05 < left[1] * LEVER < UNSEEN * 1.05
    assert -UNSEEN * 1.05 < back[0] < -0.05
    assert same_fields(shield.state, before)


def blinded(_, reading):
    """A reading whose laser has no echo in any direction."""
    return reading._replace(laser=np.full_like(reading.laser, np.inf))


@pytest.mark.parametrize("still", [False, True])
def test_a_laser_that_goes_blind_among_walls_stops_it(still):
    """Within the stale limit and two periods; a re-arm while it is blind changes nothing."""
    chair, shield, reading = begin(box(5.0, (-4.0, 0.0, 0.0)), 5)
    twist = STILL if still else np.array([0.5, 0.0])
    for _ in range(20):
        reading = step(chair, shield, twist, reading)
    place = chair.truth.pose
    for k in range(40):
        if k == 20:
            shield.rearm()
        reading = step(chair, shield, twist, blinded(k, reading))
        assert (shield.latched == "laser blind") == (k >= 3)
    assert abs(chair.truth.twist).max() < 0.01
    assert np.hypot(*(chair.truth.pose - place)[:2]) < 0.5 * 0.4 + 0.15
    for _ in range(3):
        reading = step(chair, shield, twist, reading)
    assert shield.latched == "laser blind"
    shield.rearm()
    for _ in range(3):
        reading = step(chair, shield, np.array([0.5, 0.0]), reading)
    assert shield.latched == ""
    assert shield.decision.given.any()


def test_a_laser_that_is_blind_from_the_start_is_told_by_what_ultrasonics_hear():
    _, chair, shield = drive((0.0, 0.0, 0.0), (0.5, 0.0), 8.0, half=4.0, key=5, told=blinded)
    assert shield.latched == "laser blind"
    assert not chair.truth.touched


def test_an_empty_scan_is_believed_where_the_last_thing_in_view_was_passed():
    """A lone post is left behind; then nothing is within reach, and the chair drives on."""
    post = [(0.0, 1.0, 0.1, 1.0), (0.1, 1.0, 0.0, 1.1), (0.0, 1.1, 0.0, 1.0)]
    trace, _, shield = drive((-4.0, 0.0, 0.0), AHEAD, 25.0, half=60.0, walls=post)
    assert shield.latched == ""
    assert trace[-1][1].pose[0] > 10.0
    assert trace[-1][1].twist[0] > 0.75


def test_workspaces_hold_whole_blocks_of_points():
    """Points are padded to blocks, which would else be written behind the arrays."""
    near = (NEARBY[name] for name in ("x", "y", "moving_x", "moving_y"))
    for points in (*near, POINTS["x"]):
        assert points.shape[0] % _BLOCK == 0
    assert NEARBY["out_x"].shape[0] >= SAMPLES

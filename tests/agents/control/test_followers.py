"""Laws of the scripted policies and of exact tracking in tight places, with a chair on paper."""

from types import SimpleNamespace

import numpy as np
import pytest

from agents.control import FOLLOWERS, make_follower, rollout
from agents.control.followers import Objective, Situation
from agents.control.local_map import LocalMap, sampled_walls, voxel_means
from agents.control.rollout import ChairState, ReferencePath
from agents.policies import make_policy
from agents.policies.recoveries import Spin
from agents.policies.search import Search
from planners.problem import Plan, Status
from tests.agents.fakes import PaperWorld, corridor
from wheelchair_gym.base.settings import record_of
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.geometry.kinematics import Limits, arc_step
from wheelchair_gym.geometry.outline import Footprint, clearance_to_points, footprint_clearance
from wheelchair_gym.maps import FREE, OCCUPIED, OccupancyGrid
from wheelchair_gym.safety import Shield

PLANNER = "a_star"
SOUND = sorted(set(FOLLOWERS) - {"thesis"})  # random commands, as printed, need not arrive
PROGRESS = 0.4  # share of a pure pursuit's: `controls` ends a turn in place before it drives on
NOBODY = np.empty((0, 8))
SURE = (1e-3, 0.0, 1e-4)  # variances of an actor that is known well


def body(v, **limits):
    """A chair that drives straight on at a speed."""
    state, record = np.array([v, 0.0, 0.0, 0.0]), Limits(**limits).record
    return rollout.Body(state, state[[0, 2]], np.array([record]), Footprint().array)


@pytest.mark.parametrize("follower", SOUND)
def test_followers_keep_to_the_middle_of_a_corridor(follower):
    grid = corridor()
    world = PaperWorld(grid, (1.0, 0.0, 0.2), (6.5, 0.0, 0.0))
    poses, actions = world.run(make_policy(f"{PLANNER}+{follower}"), 40.0)
    assert np.hypot(*(poses[-1][:2] - world.mission.goal[:2])) <= 0.2
    assert np.abs(poses[:, 1]).max() < 0.15
    assert np.abs(actions).max() <= 1.0
    gaps = [
        footprint_clearance(*pose, Footprint().array, world.walls, np.empty((0, 3)), 1.0)
        for pose in poses
    ]
    assert min(gaps) > 0.05


@pytest.mark.parametrize("follower", SOUND)
def test_followers_turn_round_where_there_is_room(follower):
    world = PaperWorld(corridor(width=3.0), (4.0, 0.0, 3.0), (6.8, 0.0, 0.0))
    poses, _ = world.run(make_policy(f"{PLANNER}+{follower}"), 50.0)
    assert np.hypot(*(poses[-1][:2] - world.mission.goal[:2])) <= 0.2


def progress(policy, width, start):
    """Ways (n,) [m] that a policy has come along a hall, each 0.1 s; 1 rad of turning is 0.4 m."""
    world = PaperWorld(corridor(10.0, width), start, (8.8, 0.0, 0.0))
    poses, _ = world.run(make_policy(policy), 60.0)
    turned = abs(start[2]) - np.abs(poses[:, 2])
    return np.maximum.accumulate(poses[:, 0] - start[0] + rollout.TURN_LENGTH * turned)


@pytest.mark.parametrize(("width", "yaw"), [(8.0, 2.5), (2.2, 1.2)])
@pytest.mark.parametrize(
    "planner", ["a_star", "rrt_star_woa_local", "rrt_star_woa_global", "lattice"]
)
@pytest.mark.parametrize("follower", SOUND)
def test_progress_keeps_up_with_a_pure_pursuit(planner, follower, width, yaw):
    """From each place on, over 10 s: a follower that brakes each turn that it begins fails."""
    start = (1.2, 0.0, yaw)
    way = progress(f"{planner}+{follower}", width, start)
    best = progress(f"{planner}+pure_pursuit", width, start)
    assert way[-1] > 7.2
    for k in range(len(way) - 1):
        later = min(k + 100, len(way) - 1)
        there = int(np.searchsorted(best, way[k]))
        expected = best[min(there + later - k, len(best) - 1)] - way[k]
        assert way[later] - way[k] >= PROGRESS * expected - 0.1, k


def test_random_policies_of_other_seeds_differ():
    actions = [
        PaperWorld(corridor(), (1.0, 0.0, 0.0), (6.5, 0.0, 0.0)).run(
            make_policy({"name": "random", "seed": seed}), 2.0
        )[1]
        for seed in (0, 1)
    ]
    assert np.abs(actions[0] - actions[1]).max() > 0.1


@pytest.mark.parametrize("follower", sorted(FOLLOWERS))
def test_a_wall_across_the_path_is_not_touched(follower):
    grid = corridor()
    world = PaperWorld(grid, (1.0, 0.0, 0.0), (7.0, 0.0, 0.0))
    blocked = np.array([[4.0, -0.8, 4.0, 0.8], [4.0, 0.8, 4.1, 0.8]])
    world.walls = np.concatenate([world.walls, blocked])  # the map does not know it
    poses, _ = world.run(make_policy(f"{PLANNER}+{follower}"), 15.0)
    fronts = poses[:, 0] + 0.7 * np.cos(poses[:, 2])
    assert 3.4 < fronts.max() < 4.0


def test_the_gap_of_points_is_the_exact_clearance():
    rng = np.random.default_rng(3)
    footprint = Footprint().array
    for _ in range(50):
        points = rng.uniform(-2.5, 2.5, (40, 2))
        far = np.hypot(*points.T)
        order = np.argsort(far)
        pose = rng.uniform((-1, -1, -3), (1, 1, 3))
        gap = clearance_to_points(*pose, footprint, np.column_stack([points, far])[order], 0.5)
        discs = np.column_stack([points, np.zeros(40)])
        exact = footprint_clearance(*pose, footprint, np.empty((0, 4)), discs, 0.5)
        assert gap == pytest.approx(exact, abs=1e-12)


def test_a_twist_that_could_not_stop_is_refused():
    fast = body(0.8)
    for distance, clear in ((0.5, False), (3.0, True)):
        x = 0.70 + distance
        near = rollout.LocalView(np.array([[x, 0.0, x]]), NOBODY, np.zeros((2, 4)))
        assert rollout.stops_clear(0.8, 0.0, fast, near, 0.4, 0.05) is clear
    slow = body(0.8, deceleration=0.1)  # from the end of the roll-out on it would drive 1 m more
    assert not rollout.stops_clear(0.8, 0.0, slow, near, 0.4, 0.05)
    assert rollout.stops_clear(0.2, 0.0, body(0.2, deceleration=0.1), near, 0.4, 0.05)


def test_a_twist_is_tested_as_the_chair_drives_it():
    """Beyond the limits it is slowed on its arc, and in reverse to the limit."""
    world = PaperWorld(corridor(), (1.0, 0.0, 0.0), (7.0, 0.0, 0.0), turn=0.05, backward=0.02)
    mission = world.mission
    reference = ReferencePath(np.array([world.pose[:2], mission.goal[:2]]), world.pose)
    chair = ChairState(mission.limits, mission.footprint, mission.period)
    now = Situation(LocalMap(mission), reference, chair)
    asked = {(0.4, 0.5): (0.04, 0.05), (1.6, 0.0): (0.8, 0.0), (-0.05, -0.5): (-0.005, -0.05),
             (-0.05, 0.0): (-0.02, 0.0), (0.2, 0.01): (0.2, 0.01)}  # fmt: skip
    for twist, driven_twist in asked.items():
        np.testing.assert_allclose(now.first_clear([twist], 0.05), driven_twist)
    spin = Spin()
    spin.begin(world.pose, mission.goal)
    assert abs(spin.twist(now)[1]) == 0.05
    assert spin.turned == pytest.approx(0.05 * mission.period)


def test_a_faster_chair_sees_as_far_as_it_needs_to_stop():
    for limits, seen in (({}, False), ({"forward": 2.0}, True)):
        world = PaperWorld(corridor(), (1.0, 0.0, 0.0), (7.0, 0.0, 0.0), **limits)
        world.walls = np.concatenate([world.walls, [[5.2, -0.8, 5.2, 0.8]]])  # 3.5 m off its front
        world.drive(np.zeros(2))
        local_map = LocalMap(world.mission)
        local_map.update(world.seen)
        x, y = local_map.points[:, 0], local_map.points[:, 1]
        assert (np.abs(x - 4.2) + np.abs(y) < 0.2).any() == seen
        assert rollout.stopping_distance(world.mission.limits) > 3.5 or not seen


def test_room_beside_a_wall_is_slow_room():
    x = np.arange(-1.0, 3.0, 0.04)
    y = np.full(x.size, Footprint().array[2] + 0.05 + 0.02)  # 2 cm more than the margin
    wall = np.column_stack([x, y, np.hypot(x, y)])
    near = rollout.LocalView(wall[np.argsort(wall[:, 2])], NOBODY, np.zeros((2, 4)))
    for v, clear in ((0.2, True), (0.8, False)):
        assert rollout.stops_clear(v, 0.0, body(v), near, 0.4, 0.05) is clear


@pytest.mark.parametrize(
    ("mover", "v", "clear"),
    [
        ((6.0, 0.0, -1.3, 0.0, 0.25), 0.8, True),  # far off as yet
        ((2.5, 0.0, -1.3, 0.0, 0.25), 0.8, False),  # it comes: no speed is kept up
        ((2.5, 0.0, -1.3, 0.0, 0.25), 0.0, True),  # at rest before it is there
        ((1.6, -1.5, 0.0, 1.3, 0.25), 0.8, False),  # it crosses
        ((1.6, 3.0, 0.0, 1.3, 0.25), 0.8, True),  # it goes away
        ((0.2, 0.80, 0.0, -0.5, 0.25), 0.8, True),  # drawing away is allowed however near it is
    ],
)
def test_movers_are_not_met_in_motion(mover, v, clear):
    speed = 0.8 if mover[0] > 1.0 and v > 0.0 else 0.3 * (v == 0.0)
    near = rollout.LocalView(np.empty((0, 3)), np.array([(*mover, *SURE)]), np.zeros((2, 4)))
    assert rollout.stops_clear(v, 0.0, body(speed), near, 0.4, 0.05) is clear
    exact = footprint_clearance(
        0.0, 0.0, 0.0, Footprint().array, np.empty((0, 4)), np.array([[*mover[:2], mover[4]]]), 9.0
    )
    assert rollout.actor_distance(
        0, 0, 0, Footprint().array, near.actors, 0.0, 9.0
    ) == pytest.approx(exact)


def cost_among(actors, v, w, speed=0.4):
    """The cost of a twist that a chair at a speed keeps, along a straight path among actors."""
    s = np.arange(0.0, 3.0, 0.05)
    reference = np.column_stack([s, np.zeros((len(s), 2)), s])
    view = rollout.LocalView(np.empty((0, 3)), np.array(actors).reshape(-1, 8), reference)
    twist = np.array([[[v, w, 1.5]]])
    return rollout.rollout_costs(twist, body(speed), view, 0.05, record_of(Objective()))[0]


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_people_who_cross_are_passed_behind(side):
    """Somebody walks across, from one side to the other: there they will be, here they were."""
    crosses = (1.9, -0.7 * side, 0.0, 0.8 * side, 0.25, *SURE)
    behind, before = (cost_among([crosses], 0.6, turn * side) for turn in (-0.3, 0.3))
    assert behind < before - 0.1
    assert cost_among([], 0.6, -0.3 * side) == pytest.approx(cost_among([], 0.6, 0.3 * side))


def test_people_near_a_chair_at_rest_cost_nothing_and_a_slow_approach_little():
    comes = (1.6, 0.0, -0.6, 0.0, 0.25, *SURE)
    assert cost_among([comes], 0.0, 0.0, 0.0) == cost_among([], 0.0, 0.0, 0.0)
    slow, fast = (cost_among([comes], v, 0.0, v) - cost_among([], v, 0.0, v) for v in (0.1, 0.8))
    assert 0.0 < slow < 0.5 * fast


def test_a_person_who_walks_into_its_side_is_no_reason_to_stand():
    beside = (-0.1, 0.9, 0.0, -0.5, 0.25, *SURE)
    assert cost_among([beside], 0.5, 0.0, 0.5) < cost_among([beside], 0.0, 0.0, 0.0)


def test_a_place_that_may_err_is_kept_clear_of_from_farther_away():
    there = (2.0, 0.0, -0.5, 0.0, 0.25)
    gaps = [
        rollout.actor_distance(0, 0, 0, Footprint().array, np.array([(*there, *spread)]), 1.0, 9.0)
        for spread in (SURE, (1e-3, 0.01, 0.1))
    ]
    assert 0.05 < gaps[0] - gaps[1] <= 0.1


def test_a_reference_begins_where_the_chair_looks_and_ends_at_the_goal():
    path = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0)])
    poses = rollout.poses_of(path, 1.5)
    assert poses[0] == pytest.approx((0.0, 0.0, 1.5), abs=1e-9)
    assert poses[-1] == pytest.approx((2.0, 2.0, np.pi / 2), abs=1e-6)
    assert np.hypot(*np.diff(poses[:, :2], axis=0).T).max() < 0.06
    reference = rollout.ReferencePath(path, np.array([0.0, 0.0, 1.5]))
    assert (np.diff(reference.rows[:, 3]) >= 0).all()
    ways = [reference.advance(pose) and reference.way for pose in poses]
    assert (np.diff(ways) >= -1e-9).all()
    assert reference.ended


def test_voxels_hold_means_and_walls_hold_their_ends():
    points = np.array([(0.01, 0.01), (0.03, 0.01), (1.0, 1.0)])
    means = voxel_means(points, 0.04)
    assert sorted(map(tuple, np.round(means, 6))) == [(0.02, 0.01), (1.0, 1.0)]
    assert sampled_walls(np.empty((0, 4))).shape == (0, 2)
    walls = sampled_walls(np.array([[0.0, 0.0, 0.12, 0.0]]))
    assert walls[0] == pytest.approx((0, 0))
    assert walls[-1] == pytest.approx((0.12, 0))
    assert np.diff(walls[:, 0]).max() <= 0.05


def test_what_slips_out_of_sight_is_remembered():
    world = PaperWorld(corridor(width=2.0), (1.0, 0.0, 0.0), (7.0, 0.0, 0.0))
    post = np.array([[2.6, 0.5, 2.7, 0.5], [2.7, 0.5, 2.7, 0.6]])
    world.walls = np.concatenate([world.walls, post])
    local_map = LocalMap(world.mission)
    while world.pose[0] < 2.9:
        world.drive(np.array([0.8, 0.0]))
        local_map.update(world.seen)
    behind = local_map.points[:, :2] + world.pose[:2]
    assert np.hypot(*(behind - (2.65, 0.5)).T).min() < 0.06


def test_what_is_too_near_to_be_measured_stays_an_obstacle():
    world = PaperWorld(corridor(width=2.0), (1.0, 0.0, 0.0), (7.0, 0.0, 0.0))
    local_map, laser = LocalMap(world.mission), world.mission.sensors.laser
    world.drive(np.zeros(2))
    scan = np.where(np.abs(laser.angles) < 0.2, -np.inf, world.seen.laser)
    local_map.update(world.seen._replace(laser=scan))
    off = local_map.points[:, :2] - (laser.x + laser.range_min, 0.0)
    assert np.hypot(*off.T).min() < 0.02


@pytest.mark.filterwarnings("ignore:ultrasonics more than")
@pytest.mark.parametrize("shield", [None, {"unseen_speed": 0.3, "stop_margin": 0.1}])
@pytest.mark.parametrize(
    "chair",
    [
        {},
        {"footprint": {"rear": 0.5, "half_width": 0.4}},
        {"limits": {"deceleration": 0.4, "protective": 1.0}},
        {"drive": {"track": 0.4}},
    ],
)
def test_a_policy_is_slowed_as_the_shield_of_its_own_chair_would(chair, shield):
    """In unseen space: backwards, and turning, at the start."""
    env = NavigationEnv("empty", {"chair": chair}, shield=shield, split="test")
    env.reset(seed=0)
    config, local_map = env.settings, LocalMap(env.mission)
    same = Shield(config.shield, config.chair, config.sensors, 1.0 / config.rate)
    same.update(env.task.reading)
    twists = np.array([(v, w) for v in (-0.3, -0.1, 0.0, 0.6) for w in (-0.9, 0.0, 0.4)])
    for v in (0.0, -0.2):
        motion = np.array([v, 0.0, 0.0, 0.0])
        slowed = local_map.limit_for_unseen_space(twists, motion)
        np.testing.assert_array_equal(slowed, same.limit_for_unseen_space(twists, motion))
        assert (slowed != twists).any()


def box(length, width):
    rows, cols = round(width / 0.05) + 8, round(length / 0.05) + 8
    cells = np.full((rows, cols), OCCUPIED, np.int8)
    cells[4:-4, 4:-4] = FREE
    return OccupancyGrid(cells, 0.05, (-0.025 * cols, -0.025 * rows, 0.0))


def manoeuvre(begin, stretches):
    """Poses (n, 3) of stretches (way [m], turn [rad]) from a pose on, some 4 cm apart."""
    poses = [np.array(begin)]
    for way, turn in stretches:
        steps = max(1, round(max(abs(way), 0.4 * abs(turn)) / 0.04))
        for _ in range(steps):
            poses.append(np.array(arc_step(*poses[-1], way / steps, turn / steps, 1.0)))
    return np.array(poses)


def driven(path, room, seconds, follower, actors=None):
    """Poses (n, 3) of a chair that follows a path from its first pose on, among actors."""
    world = PaperWorld(room, path[0], path[-1])
    local_map = LocalMap(world.mission)
    chair = ChairState(world.mission.limits, world.mission.footprint, world.mission.period)
    reference, follower = ReferencePath(path, path[0]), make_follower(follower).make()
    poses = [world.pose]
    while world.time < seconds and not reference.ended:
        local_map.update(world.seen)
        if actors is not None:
            local_map.actors = actors
        reference.advance(local_map.pose)
        twist = follower.twist(Situation(local_map, reference, chair))
        twist = np.zeros(2) if twist is None else twist
        chair.command(twist)
        world.drive(twist / (world.mission.limits.forward, world.mission.limits.turn))
        poses.append(world.pose)
    return np.array(poses)


# Ahead, a quarter turn in place, back, and ahead round a bend.
ROOM = box(3.4, 1.5)
PATH = manoeuvre((-0.8, 0.0, 0.0), [(0.4, 0.0), (0.0, -0.7), (-0.2, 0.3), (0.0, 0.4), (0.7, 0.0)])


TRACKING = pytest.mark.parametrize("name", ["window", "whales"])


@TRACKING
def test_a_manoeuvre_close_to_walls_is_driven_as_planned(name):
    poses = driven(PATH, ROOM, 20.0, {"name": name})
    turned = int(poses[:, 2].argmin())
    back = turned + int(poses[turned:, 0].argmin())  # from there on it has room
    off = np.hypot(*(poses[:back, None, :2] - PATH[None, :, :2]).T).min(axis=0)
    assert off.max() < 0.025  # 2 cm of which lie between two poses
    # Each stretch is driven to its end before the next one begins.
    assert poses[turned, 2] == pytest.approx(PATH[:, 2].min(), abs=0.06)
    place = PATH[PATH[:, 2].argmin()]
    assert poses[turned, :2] == pytest.approx(place[:2], abs=0.03)
    assert poses[back, 0] == pytest.approx(PATH[PATH[:, 2].argmin() :, 0].min(), abs=0.05)


@TRACKING
def test_what_has_room_is_left_to_the_follower(name, monkeypatch):
    def begun(room, tight):
        monkeypatch.setattr("agents.control.tight_places.TIGHT", tight)
        return driven(PATH, room, 3.0, {"name": name})

    wide = box(8.0, 6.0)
    assert np.array_equal(begun(wide, 0.1), begun(wide, 0.0))
    assert not np.array_equal(begun(ROOM, 0.1), begun(ROOM, 0.0))


@pytest.mark.parametrize(("widest", "got"), [(0.5, 0.4), (0.37, 0.36), (0.345, 0.34), (0.33, 0.32)])
def test_the_widest_plan_is_sought_by_half_steps_where_little_is_left(widest, got):
    def plan(problem, rng, **_):
        found = problem.clearance <= widest
        path = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]) if found else np.empty((0, 3))
        return Plan(Status.SOLVED if found else Status.EXHAUSTED, path)

    planner, rng = SimpleNamespace(plan=plan), np.random.default_rng(0)
    search = Search(planner, 0.40, 0.28, rng, np.zeros(3), [])
    _, clearance = search.widest(box(4.0, 2.0), np.array([1.0, 0.0]), np.inf)
    assert clearance == pytest.approx(got)

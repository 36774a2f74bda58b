"""Laws of what is observed: ranges, gaps, tracks, the trail, and ways that are hidden."""

import itertools

import numpy as np
import pytest

from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import to_frame
from wheelchair_gym.perception.tracker import Tracker
from wheelchair_gym.sensors.settings import LaserSettings
from wheelchair_gym.task import observations
from wheelchair_gym.task import side_clearance as gaps
from wheelchair_gym.task.assessment import PROGRESS, TRAIL_POINTS
from wheelchair_gym.task.side_clearance import fan_poses, side_clearance


@pytest.mark.parametrize(
    ("beams", "groups"), [(1081, 1081), (1081, 181), (1081, 64), (64, 64), (64, 63), (7, 2), (3, 1)]
)
def test_pooling_is_the_nearest_of_equal_groups(beams, groups):
    """Group j holds beams floor(j n / m) to floor((j + 1) n / m); each is seen as `see` sees it."""
    rng = np.random.default_rng(beams + groups)
    for _ in range(20):
        scan = rng.uniform(0, 12, beams).astype(np.float32)
        for odd in (np.inf, -np.inf, np.nan, 0.0):
            scan[rng.random(beams) < 0.05] = odd
        out = np.empty(groups, np.float32)
        assert observations.pool_beams(scan, 10.0, out) == np.isfinite(scan).sum()
        edges = np.arange(groups + 1) * beams // groups
        expected = [
            min(observations.observed_range(float(r), 10.0) for r in scan[a:b])
            for a, b in itertools.pairwise(edges)
        ]
        assert out.tolist() == np.float32(expected).tolist()


OUTLINE, LASER = Footprint(), LaserSettings(yaw=0.02)
DIRECTIONS = LASER.directions
RIG = DIRECTIONS, np.array([LASER.x, LASER.y]), OUTLINE.array
AHEAD = [(0.4, 0.1, 0.3), (0.9, -0.2, -0.6), (2.0, 0.5, 1.9)]


def corridor(left, right):
    """Return a scan between two endless walls along the chair, at y = left and -right."""
    with np.errstate(divide="ignore"):
        sine = DIRECTIONS[:, 1]
        return np.where(sine > 0, left / sine, right / -sine).astype(np.float32)


def told(scan, poses=()):
    """Gaps where the chair stands and at poses (x, y, yaw), a row each."""
    flat = np.array([(x, y, np.cos(a), np.sin(a)) for x, y, a in poses], np.float32).ravel()
    out = np.empty(2 + 2 * len(poses), np.float32)
    gaps.side_clearance(scan, *RIG, flat, out)
    return out.reshape(-1, 2)


@pytest.mark.parametrize("poses", [[], AHEAD, [(-0.9, 0.2, 0.1), (-1.5, -0.4, 2.9)]])
def test_gaps_are_those_of_the_points_beside_each_pose(poses):
    rng = np.random.default_rng(3)
    for _ in range(20):
        scan = rng.uniform(0.1, 4.0, LASER.beams).astype(np.float32)
        scan[rng.random(LASER.beams) < 0.05] = np.inf
        scan[rng.random(LASER.beams) < 0.05] = -np.inf
        middle = np.median(np.stack([scan[:-2], scan[1:-1], scan[2:]]), axis=0)[::2]
        middle, kept = np.maximum(middle, 0.0), middle < np.inf
        points = middle[kept, None] * DIRECTIONS[1:-1:2][kept] + (LASER.x, LASER.y)
        for row, pose in zip(told(scan, poses), [(0.0, 0.0, 0.0), *poses], strict=True):
            along, aside = to_frame(points, pose).T
            beside = (along > -OUTLINE.rear - gaps.BEYOND) & (along < OUTLINE.front + gaps.BEYOND)
            for gap, side in zip(row, (aside >= 0, aside < 0), strict=True):
                near = np.abs(aside[beside & side]).min(initial=np.inf) - OUTLINE.half_width
                assert gap == pytest.approx(min(near, gaps.CLEARANCE_MAX), abs=1e-5)


@pytest.mark.parametrize("odd", [np.inf, -np.inf, 0.0, 0.2, 9.0])
def test_one_odd_beam_in_three_makes_no_gap(odd):
    scan = corridor(0.7, 0.7)
    before = told(scan, AHEAD[:2])
    scan[40::3] = odd
    assert told(scan, AHEAD[:2]) == pytest.approx(before, abs=0.02)


def test_where_nothing_is_seen_gaps_are_wide():
    for nothing in (np.inf, np.nan):
        assert (told(np.full(LASER.beams, nothing, np.float32), AHEAD) == gaps.CLEARANCE_MAX).all()


def test_what_is_too_near_to_be_measured_is_at_the_laser():
    scan = np.full(LASER.beams, -np.inf, np.float32)
    assert told(scan, [])[0][0] == pytest.approx(-OUTLINE.half_width)
    assert gaps.proximity_speed(scan, *RIG, np.array([0.5, 0.0])) == pytest.approx(0.25)


@pytest.mark.parametrize(("v", "w"), [(0.5, 0.0), (-0.2, 0.0), (0.0, 0.4), (0.3, -0.9)])
def test_haste_is_the_fastest_corner_squared_and_more_the_nearer(v, w):
    corners = OUTLINE.corners
    squared = ((v - w * corners[:, 1]) ** 2 + (w * corners[:, 0]) ** 2).max()
    for gap in (0.05, 0.1, 0.3):
        expected = max(0.0, 1.0 - gap / gaps.NEAR) * squared
        scan = corridor(0.31 + gap, 2.0)
        assert gaps.proximity_speed(scan, *RIG, np.array([v, w])) == pytest.approx(
            expected, abs=0.01 * squared
        )


def test_haste_counts_what_stands_ahead_and_beside_a_corner():
    scan = np.full(LASER.beams, np.inf, np.float32)
    for x, y in ((0.8, 0.0), (0.78, -0.37), (0.3, 0.41)):
        off = np.array([x, y]) - (LASER.x, LASER.y)
        ahead = np.argmax(DIRECTIONS @ (off / np.hypot(*off)))
        seen = scan.copy()
        seen[ahead - 2 : ahead + 3] = np.hypot(*off)
        assert gaps.proximity_speed(seen, *RIG, np.array([0.5, 0.0])) == pytest.approx(
            0.5 * 0.25, rel=0.05
        )


@pytest.mark.parametrize("beams", [0, 1, 2])
def test_where_beams_are_too_few_nothing_is_near(beams):
    """Also without a laser."""
    scan, directions = np.full(beams, 0.5, np.float32), np.ones((beams, 2))
    rig = directions, np.zeros(2), OUTLINE.array
    out = np.zeros(2, np.float32)
    gaps.side_clearance(scan, *rig, np.empty(0, np.float32), out)
    assert (out == np.float32(gaps.CLEARANCE_MAX)).all()
    assert gaps.proximity_speed(scan, *rig, np.array([0.5, 0.4])) == 0.0


MAXIMUM = 4  # tracks that are observed
HALL = {
    "name": "crowd", "place": "hall", "hall_size": [8.0, 10.0], "furniture_density": 0.0,
    "people": {"density": [0.3, 0.3]},
}  # fmt: skip
CONFIG = {"scene": HALL, "rate": 5.0, "task": {"tracks": MAXIMUM, "beams": 64}}


def expected(tracks, pose):
    """The nearest confirmed tracks (4, 5), zeros after the last."""
    out = np.zeros((MAXIMUM, 5), np.float32)
    place = to_frame(tracks.place, pose)
    velocity = to_frame(tracks.velocity, np.array([0.0, 0.0, pose[2]]))
    far = np.hypot(*place.T)
    chosen = np.flatnonzero(tracks.confirmed & (far <= observations.TRACK_REACH))
    chosen = chosen[np.argsort(far[chosen])][:MAXIMUM]
    rows = np.column_stack([np.ones(len(chosen)), place[chosen], velocity[chosen]])
    out[: len(chosen)] = rows
    out[:, 3:] = out[:, 3:].clip(-observations.TRACK_SPEED, observations.TRACK_SPEED)
    return out


def test_they_are_those_of_a_tracker_without_a_map():
    env = NavigationEnv(config=CONFIG)
    maximum = 0
    actions = np.random.default_rng(1).uniform(-0.3, 0.6, (40, 2)).astype(np.float32)
    for seed in range(3):
        observation, _ = env.reset(seed=seed)
        tracker = Tracker(laser=env.settings.sensors.laser)
        for action in actions:
            reading = env.task.reading
            twist, laser = np.array(reading.twist), reading.laser
            tracks = tracker.update(laser, np.array(reading.pose), twist, reading.stamp)
            wanted = expected(tracks, np.array(reading.pose))
            assert observation["tracks"].reshape(MAXIMUM, 5) == pytest.approx(wanted, abs=1e-4)
            maximum = max(maximum, int(wanted[:, 0].sum()))
            assert env.observation_space.contains(observation)
            observation, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                break
    assert maximum == MAXIMUM


OPEN = {"name": "empty", "size": (12.0, 12.0), "start": (6.0, 6.0, 0.0), "goal": (1.0, 1.0, 0.0)}


def seen(own, pose, ways):
    out = np.empty(2 * len(ways), np.float32)
    observations.write_trail(own, np.array(pose), np.array(ways), out)
    return out.reshape(-1, 2)


def test_a_trail_follows_the_way_and_its_last_16_m():
    own = np.zeros(1, PROGRESS)[0]
    along = np.arange(0.0, 30.0, 0.16)
    poses = np.stack([4.0 * np.cos(along / 4.0), 4.0 * np.sin(along / 4.0), along / 4.0], axis=-1)
    observations.reset_trail(own, poses[0])
    for k, pose in enumerate(poses):
        observations.extend_trail(own, pose)
        ways = [0.0, 1.0, 5.0, 15.0]
        for way, place in zip(ways, seen(own, pose, ways), strict=True):
            ago = max(0.0, along[k] - way)
            was = [np.interp(ago, along, poses[:, i]) for i in range(2)]
            assert place == pytest.approx(to_frame(was, pose), abs=1.1 * observations.TRAIL_SPACING)
    assert own["n_trail"] > TRAIL_POINTS


def test_a_pose_that_trembles_leaves_no_trail():
    own, rng = np.zeros(1, PROGRESS)[0], np.random.default_rng(0)
    observations.reset_trail(own, np.zeros(3))
    for _ in range(1000):
        observations.extend_trail(own, rng.normal(0.0, 0.03, 3))
    assert own["n_trail"] == 1


@pytest.mark.parametrize("jump", [np.nan, np.inf, 1e300, 100.0])
def test_a_pose_that_jumps_or_is_lost_ends_nothing(jump):
    own = np.zeros(1, PROGRESS)[0]
    observations.reset_trail(own, np.zeros(3))
    observations.extend_trail(own, np.array([jump, 0.0, 0.0]))
    assert own["n_trail"] <= TRAIL_POINTS + 1


def test_it_is_observed_and_begins_anew_with_each_episode():
    task = {"beams": 16, "trail": [1.0, 15.0]}
    env = NavigationEnv(scene=OPEN, config={"task": task})
    for seed in range(2):
        observation, _ = env.reset(seed=seed)
        assert observation["trail"] == pytest.approx(np.zeros(4))
        for _ in range(60):
            observation, *_, info = env.step(np.array([0.6, 0.6]))
        assert env.observation_space.contains(observation)
        near, far = observation["trail"].reshape(2, 2)
        assert np.hypot(*near) == pytest.approx(1.0, abs=0.3)
        start = to_frame(env.task.start[:2], info["pose"])
        assert far == pytest.approx(start, abs=0.3)


TASK = {"beams": 32, "side_clearance": True, "privileged": True}


def make(**task):
    return NavigationEnv("floor_plan", guidance="poses", config={"task": {**TASK, **task}})


def test_what_is_hidden_is_what_a_guided_policy_is_shown():
    guided, hide_guidance = make(), make(hide_guidance=True)
    rng = np.random.default_rng(0)
    shown, hidden = guided.reset(seed=3)[0], hide_guidance.reset(seed=3)[0]
    assert list(hide_guidance.task.spaces)[-3:] == list(observations.PRIVILEGED)
    for _ in range(6):
        assert "path" not in hidden
        assert hide_guidance.observation_space.contains(hidden)
        assert np.array_equal(hidden["privileged_path"], shown["path"])
        assert np.array_equal(hidden["privileged_side_clearance"], shown["side_clearance"])
        for key in set(shown) - {"path", "side_clearance"}:
            assert np.array_equal(hidden[key], shown[key])
        action = rng.uniform(-1.0, 1.0, 2)
        shown, hidden = guided.step(action)[0], hide_guidance.step(action)[0]
    assert hide_guidance.points_ahead is None


def test_nothing_is_hidden_where_no_critic_looks():
    env = make(hide_guidance=True, privileged=False)
    assert not {"path", *observations.PRIVILEGED} & set(env.reset(seed=0)[0])
    seen = make(hide_guidance=True, side_clearance=False).reset(seed=0)[0]
    assert "privileged_side_clearance" not in seen


@pytest.mark.parametrize("guidance", [None, "geodesic", "poses"])
def test_a_policy_without_poses_ahead_sees_gaps_at_a_fan_of_poses(guidance):
    task = {**TASK, "privileged": False, "hide_guidance": guidance == "poses"}
    env = NavigationEnv("floor_plan", guidance=guidance, config={"task": task})
    seen = env.reset(seed=1)[0]["side_clearance"]
    expected, laser = np.empty_like(seen), env.settings.sensors.laser
    mount, outline = np.array([laser.x, laser.y]), env.task.footprint.array
    side_clearance(env.task.reading.laser, laser.directions, mount, outline, fan_poses(), expected)
    assert np.array_equal(seen, expected)


def test_the_fan_lies_on_arcs_to_both_sides_and_on_the_spot():
    x, y, c, s = fan_poses().reshape(-1, 4).T
    assert np.hypot(c, s) == pytest.approx(1.0)
    turn = np.arctan2(s, c)
    assert np.arctan2(y, x) == pytest.approx(np.where(np.hypot(x, y) > 0.0, 0.5 * turn, 0.0))
    assert sorted(turn) == pytest.approx(sorted(-turn))
    assert (np.hypot(x, y) < 1e-6).sum() == 4


@pytest.mark.parametrize("scene", ["empty", "skill"])
def test_a_pose_that_is_no_number_has_not_arrived(scene):
    env = NavigationEnv(scene)
    env.reset(seed=0)
    goal, still = np.array(env.episode.goal, float), np.zeros(2)
    assert env.task.at_goal(goal, still)
    for k in range(2):
        assert not env.task.at_goal(np.where(np.arange(3) == k, np.nan, goal), still)

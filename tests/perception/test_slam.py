"""Scan matching and SLAM: poses that are known, loops that close, and misuse that is named."""

from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pytest

from agents.evaluation.evaluate import env_settings, make_env
from tests.agents.fakes import infos_of
from tests.perception.rooms import LASER, away, mapped, ranges, tour
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.geometry.planar import compose, relative_pose
from wheelchair_gym.maps import OCCUPIED, UNKNOWN
from wheelchair_gym.perception import slam
from wheelchair_gym.perception.occupancy import OccupancyMap, read_scan
from wheelchair_gym.perception.slam import Slam, SlamSettings
from wheelchair_gym.sensors.settings import LaserSettings

# Odometry that drifts in the room: 5 % too far, and to the left.
MAPPING = {}  # settings of its map
DRIFT = np.array([1.05, 1.0, 1.0]), np.array([0.0, 0.0, 0.006])


def driven(particles, seed=0, learn=True):
    """A SLAM's poses, a drifting odometry's and the truth."""
    rng = np.random.default_rng(5)
    truth = np.concatenate([tour(90), np.add(tour(90)[::-1], (0, 0, np.pi))])
    settings = SlamSettings(particles=particles, **MAPPING)
    slam = Slam(LASER, settings, seed, truth[0])
    wheels, poses = [truth[0]], []
    for k in range(len(truth)):
        moved = relative_pose(truth[k - 1], truth[k]) * DRIFT[0] + DRIFT[1] if k else np.zeros(3)
        if k == 90:
            moved = np.array([0.0, 0.0, np.pi])  # it turns on the spot
        if k:
            wheels.append(compose(wheels[-1], moved))
        poses.append(slam.update(moved, ranges(truth[k], rng), learn or k < 90))
    return slam, np.array(poses), np.array(wheels), truth


@pytest.mark.parametrize("particles", [1, 8])
def test_a_drifting_chair_finds_itself_and_the_room(particles):
    slam, poses, wheels, truth = driven(particles)
    error = np.hypot(*(poses - truth)[:, :2].T)
    assert np.hypot(*(wheels - truth)[-1, :2]) > 0.4
    assert error.max() < 0.12
    assert np.sqrt((error**2).mean()) < 0.05
    assert np.degrees(np.abs(relative_pose(truth, poses)[:, 2])).mean() < 1.5
    grid = slam.built_map()
    solid = grid.to_world(np.argwhere(grid.cells == OCCUPIED))
    assert np.percentile(away(solid), 95) < 0.10
    assert slam.trajectory.shape == truth.shape
    np.testing.assert_allclose(slam.trajectory[-1], poses[-1], atol=1e-12)


def test_the_same_seed_is_the_same_run_and_another_seed_is_not():
    one, two, other = driven(6), driven(6), driven(6, seed=1)
    np.testing.assert_array_equal(one[1], two[1])
    np.testing.assert_array_equal(one[0].built_map().cells, two[0].built_map().cells)
    assert (one[1] != other[1]).any()


def test_memory_in_reserve_spares_the_map_to_grow_and_changes_nothing_else(monkeypatch):
    _, poses, _, _ = driven(8)
    monkeypatch.setitem(MAPPING, "reserve", 25.0)
    replace = OccupancyMap._replace
    with patch.object(OccupancyMap, "_replace", autospec=True, side_effect=replace) as grown:
        slam, others, _, _ = driven(8)
    assert grown.call_count == 2  # nothing, and all that it has in reserve
    np.testing.assert_allclose(poses, others, atol=0.02)
    assert min(slam.built_map().cells.shape) * slam.maps.settings.resolution < 40.0


def test_scans_that_are_not_to_be_learned_leave_the_map():
    short, long = driven(1, learn=False)[0], driven(1)[0]
    first = Slam(LASER, SlamSettings(particles=1), 0, tour(90)[0])
    assert (short.built_map().cells == OCCUPIED).sum() < (long.built_map().cells == OCCUPIED).sum()
    assert (first.built_map().cells == UNKNOWN).all()


def test_slam_beats_odometry_in_a_floor_plan_with_all_noise():
    env = make_env("floor_plan", env_settings(pose_source="odometry", config=None))
    _, info = env.reset(seed=5)
    task, reading = env.unwrapped.task, env.unwrapped.task.reading
    slam = Slam(LaserSettings(), SlamSettings(particles=4), 0, reading.pose)
    poses = [slam.update(np.zeros(3), reading.laser)]
    wheels, truth = [reading.pose.copy()], [np.array(info["pose"])]
    for info in infos_of(env, "a_star+window"):
        reading = task.reading
        poses.append(slam.update(relative_pose(wheels[-1], reading.pose), reading.laser))
        wheels.append(reading.pose.copy())
        truth.append(np.array(info["pose"]))
    env.close()

    def rms(estimate):
        gap = relative_pose(np.array(truth), np.array(estimate))
        return np.sqrt((gap[:, :2] ** 2).sum(1).mean()), np.sqrt((gap[:, 2] ** 2).mean())

    (way, turn), (drift, twist) = rms(poses), rms(wheels)
    assert way < 0.5 * drift
    assert turn < 0.5 * twist
    assert way < 0.05
    assert np.degrees(turn) < 1.5


def test_a_trajectory_begins_at_the_pose_given_without_a_scan():
    slam = Slam(LASER, SlamSettings(particles=2), pose=(1.0, 2.0, 0.0))
    for scan in (None, np.full(LASER.beams, np.nan), ranges(tour()[0])):
        slam.update((0.1, 0.0, 0.0), scan)
    np.testing.assert_allclose(slam.trajectory[:2], [(1.1, 2.0, 0.0), (1.2, 2.0, 0.0)])
    assert abs(slam.trajectory[2, 0] - 1.3) < 0.05


@pytest.mark.parametrize(
    "wrong",
    [
        lambda slam: slam.update((0, np.nan, 0), None),
        lambda slam: slam.update((0, 0), None),
        lambda slam: slam.update(np.zeros(3), np.ones(3)),
    ],
)
def test_misuse_is_named(wrong):
    slam = Slam(LASER, SlamSettings(particles=1))
    slam.update(np.zeros(3), ranges(tour()[0]))
    with pytest.raises(InputError):
        wrong(slam)


@pytest.fixture(scope="module")
def known():
    return mapped(2)


def match(maps, scan, guess, prior=None):
    """Lay a scan onto a map near a guess (3,), as SLAM does where its own guess is poor."""
    unit, best, end = maps.settings.resolution, np.empty(3), np.empty(3)
    maps.grow_to(guess, scan.radius + slam.SEARCH_WINDOW)
    points = slam.thin_scan(scan, slam.POINT_SPACING, slam.MAX_POINTS) / unit
    scale = np.outer((unit, unit, 1.0), (unit, unit, 1.0))
    told = np.zeros((3, 3)) if prior is None else np.linalg.inv(prior) * scale
    told = tuple(told[np.triu_indices(3)])
    begin, how = maps.to_lattice(guess), slam.matcher(unit)
    field = maps.layers.field[0]
    slam.search(field, points, begin, told, how, maps.workspace.pooled, best)
    _, (xx, xy, xt, yy, yt, tt) = slam.refine(field, points, best, begin, told, how, end)
    covariance = np.linalg.inv([(xx, xy, xt), (xy, yy, yt), (xt, yt, tt)]) * scale
    off = [slam.misfit(field, points[k : k + 1], *end) ** 0.5 for k in range(len(points))]
    score = 1.0 - np.mean(off) if off else 0.0
    return SimpleNamespace(pose=maps.from_lattice(end), covariance=covariance, score=score)


@pytest.mark.parametrize("offset", [(0.15, -0.1, 0.08), (-0.18, 0.18, -0.1), (0.02, 0.0, 0.0)])
def test_a_known_offset_is_found(known, offset):
    rng = np.random.default_rng(3)
    for truth in ((0.3, 0.2, 0.4), (2.6, 0.1, -1.2), (4.1, -0.7, 2.5)):
        found = match(known, read_scan(LASER, ranges(truth, rng)), np.add(truth, offset))
        error = found.pose - truth
        assert np.hypot(*error[:2]) < 0.02
        assert abs(error[2]) < np.radians(0.5)
        assert found.score > 0.5
        assert np.linalg.eigvalsh(found.covariance).min() > 0


def test_a_trusted_prior_holds_the_pose(known):
    truth = np.array([0.3, 0.2, 0.4])
    guess = np.add(truth, (0.1, 0.0, 0.0))
    scan = read_scan(LASER, ranges(truth))
    held = match(known, scan, guess, prior=np.diag([1e-10, 1e-10, 1e-10]))
    np.testing.assert_allclose(held.pose, guess, atol=1e-3)


def test_along_a_corridor_the_covariance_is_long():
    laser, made = LASER, OccupancyMap()
    with np.errstate(divide="ignore"):
        walls = 1.0 / np.abs(np.sin(laser.angles))
    scan = read_scan(laser, np.where(walls > 3.0, np.inf, walls))
    for x in np.arange(-6.0, 6.0, 0.5):
        made.integrate(scan, (x, 0.0, 0.0))
    found = match(made, scan, (0.0, 0.05, 0.02))
    assert abs(found.pose[1]) < 0.02
    assert found.covariance[0, 0] > 50 * found.covariance[1, 1]


def test_which_echoes_are_kept_is_not_for_noise_to_choose():
    """Echoes off a flat wall to the right and to the left err by nothing in the mean."""
    laser = LaserSettings(x=0.0, range_min=0.05)
    angle = laser.yaw + laser.angles
    wall = np.abs(angle) < 1.2
    rng = np.random.default_rng(0)
    off = []
    for _ in range(100):
        seen = 1.5 / np.cos(np.where(wall, angle, 0.0)) + 0.015 * rng.standard_normal(len(angle))
        kept = slam.thin_scan(read_scan(laser, np.where(wall, seen, np.inf)), 0.03, 10_000)
        at = np.arctan2(kept[:, 1], kept[:, 0])
        error = np.hypot(*kept.T) - 1.5 / np.cos(at)
        off.append([error[at < -0.2].mean(), error[at > 0.2].mean()])
    assert len(kept) < 0.5 * wall.sum()
    assert np.abs(np.mean(off, axis=0)).max() < 0.001  # 3.5 mm each way if their gaps choose


def test_the_search_finds_the_best_of_its_whole_lattice(known):
    """Blocks are ruled out by a bound: nothing they hold may be better."""
    rng = np.random.default_rng(4)
    field, wide = known.layers.field[0], known.workspace.pooled
    window, turns, step, spread = 3, 2, 0.05, 0.5
    how = slam.Matcher(spread, 0, window, turns, step, 0.0)
    told = (0.02, 0.0, 0.0, 0.02, 0.0, 30.0)
    for _ in range(5):
        truth = np.array([rng.uniform(-1, 1), rng.uniform(-0.5, 0.5), rng.uniform(-3, 3)])
        scan = read_scan(LASER, ranges(truth, rng))
        points = scan.echoes[::9] / known.settings.resolution
        guess = known.to_lattice(truth + rng.uniform(-0.1, 0.1, 3))
        out = np.empty(3)
        minimum = slam.search(field, points, guess, told, how, wide, out)
        best = np.inf
        span = -(-(2 * window + 1) // 3) * 3
        for t in np.arange(-turns, turns + 1) * step:
            c, s = np.cos(guess[2] + t), np.sin(guess[2] + t)
            seen = np.floor(points @ [[c, s], [-s, c]] + guess[:2]).astype(int)
            for dx in range(-window, span - window):
                for dy in range(-window, span - window):
                    value = field[seen[:, 1] + dy, seen[:, 0] + dx].astype(float)
                    cost = 0.5 * ((1 - value) ** 2).sum() / spread**2
                    cost += 0.5 * (told[0] * dx**2 + told[3] * dy**2 + told[5] * t**2)
                    best = min(best, cost)
        assert minimum == pytest.approx(best, rel=1e-6)


def test_a_scan_without_echo_leaves_the_guess(known):
    scan = read_scan(LASER, np.full(LASER.beams, np.inf))
    found = match(known, scan, (0.3, 0.2, 0.4), prior=np.eye(3))
    np.testing.assert_allclose(found.pose, (0.3, 0.2, 0.4), atol=1e-9)
    assert found.score == 0.0

"""Scan matching: a known offset is found, and its covariance tells what the walls do not."""

from types import SimpleNamespace

import numpy as np
import pytest

from tests.perception.rooms import LASER, mapped, ranges
from wheelchair_gym.perception import slam
from wheelchair_gym.perception.occupancy import OccupancyMap, read_scan
from wheelchair_gym.sensors.settings import LaserSettings


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
    angle = np.linspace(-0.5 * laser.fov, 0.5 * laser.fov, laser.beams)
    with np.errstate(divide="ignore"):
        walls = 1.0 / np.abs(np.sin(angle))
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

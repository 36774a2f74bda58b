"""Laws of the laser: exact geometry, then stated errors."""

import math

import numpy as np
import pytest

from wheelchair_gym.geometry.planar import to_world
from wheelchair_gym.sensors import laser as lasers
from wheelchair_gym.sensors.settings import LaserSettings

NO_DISCS = np.empty((0, 3))
ROOM = np.empty((lasers.WORKSPACE_ROWS, 64), np.float32)


def brute_force(x, y, yaw, angles, walls, discs, reach):
    """First hit of each beam, in float64, and whether it passed near a segment's end."""
    c, s = np.cos(yaw + angles), np.sin(yaw + angles)
    best = np.full(len(angles), reach)
    coin = np.zeros(len(angles), bool)
    if len(walls):
        x0, y0, x1, y1 = walls.T[:, :, None]
        ex, ey = x1 - x0, y1 - y0
        with np.errstate(divide="ignore", invalid="ignore"):
            cross = c * ey - s * ex
            t = ((x0 - x) * ey - (y0 - y) * ex) / cross
            u = ((x0 - x) * s - (y0 - y) * c) / cross
        t = np.where((u >= 0) & (u <= 1) & (t > 0), t, np.inf)
        best = np.minimum(best, t.min(0))
        for px, py in ((x0, y0), (x1, y1)):
            off = np.arctan2(py - y, px - x) - yaw - angles
            off = (off + math.pi) % (2 * math.pi) - math.pi
            coin |= (np.abs(off) < 1e-5).any(0)
    for dx, dy, radius in discs:
        along = c * (dx - x) + s * (dy - y)
        inside = along**2 - ((dx - x) ** 2 + (dy - y) ** 2 - radius**2)
        t = along - np.sqrt(np.maximum(inside, 0))
        best = np.where((inside >= 0) & (t > 0), np.minimum(best, t), best)
        coin |= np.abs(inside) < 1e-4 * radius
    return best, coin


def nearest_in_cone(x, y, yaw, half, walls, discs, reach):
    """The nearest hit of dense rays in a cone of half an angle, some beside the ends of walls."""
    ends = np.arctan2(walls[:, 1::2] - y, walls[:, ::2] - x).ravel() - yaw
    ends = (ends + math.pi) % (2 * math.pi) - math.pi  # a wall may be seen edge-on
    ends = np.concatenate([ends - 1e-9, ends + 1e-9])
    rays = np.concatenate([np.linspace(-half, half, 10001), ends[np.abs(ends) <= half]])
    return brute_force(x, y, yaw, rays, walls, discs, reach)[0].min()


def random_world(rng):
    n, m = rng.integers(0, 40), rng.integers(0, 8)
    middle, half = rng.uniform(-9, 9, (n, 2)), rng.uniform(0.05, 3, n)[:, None] / 2
    turn = rng.uniform(0, math.pi, n)
    ends = half * np.column_stack([np.cos(turn), np.sin(turn)])
    walls = np.hstack([middle - ends, middle + ends])
    discs = np.column_stack([rng.uniform(-9, 9, (m, 2)), rng.uniform(0.02, 0.6, m)])
    far = np.hypot(*discs[:, :2].T) > discs[:, 2] + 0.05
    return walls, discs[far]


@pytest.mark.parametrize("fov", [math.radians(270), 2 * math.pi])
def test_equals_brute_force_on_random_worlds(fov):
    """1,000 worlds in all; beams that graze an end or a rim are a coin toss and exempt."""
    rng = np.random.default_rng(7)
    laser = LaserSettings(beams=181, fov=fov)
    arrays = lasers.LaserArrays.of(laser, False)
    angles = np.linspace(-fov / 2, fov / 2, laser.beams)
    out = np.empty(laser.beams, np.float32)
    exempt = hits = 0
    for _ in range(500):
        walls, discs = random_world(rng)
        x, y = rng.uniform(-0.02, 0.02, 2)
        yaw = rng.uniform(-10, 10)
        lasers.exact_scan(arrays, x, y, yaw, walls, discs, ROOM, out)
        expected, coin = brute_force(x, y, yaw, angles, walls, discs, laser.reach)
        # float32: the inverse range errs by a few units in its last place of its largest summand,
        # and where a wall stands by those of its ends.
        error = np.abs(out - expected) - 2e-7
        assert (error / expected**2)[~coin].max() < 2e-5
        exempt += coin.sum()
        hits += (expected < laser.reach).sum()
    assert exempt < 0.005 * 500 * laser.beams
    assert hits > 0.3 * 500 * laser.beams


def test_joints_of_a_polygon_have_no_gap():
    """Round a 40-gon, every beam hits, wherever the sensor stands."""
    t = np.linspace(0, 2 * math.pi, 41)
    points = 4 * np.column_stack([np.cos(t), np.sin(t)])
    walls = np.hstack([points[:-1], points[1:]])
    laser = lasers.LaserArrays.of(LaserSettings(), False)
    out = np.empty(1081, np.float32)
    rng = np.random.default_rng(0)
    for _ in range(50):
        x, y, yaw = rng.uniform(-2, 2, 3)
        lasers.exact_scan(laser, x, y, yaw, walls, NO_DISCS, ROOM, out)
        assert out.max() < 6.9


def test_noise_has_its_stated_sigma_bias_and_lost_share():
    laser = LaserSettings(sigma=0.02, dropout=0.03, bias=0.01)
    arrays = lasers.LaserArrays.of(laser, True)
    scans = np.full((400, laser.beams), 3.0, np.float32)
    for step, out in enumerate(scans):
        lasers.add_laser_noise(arrays, np.uint64(11), step, out)
    heard = np.isfinite(scans)
    n = scans.size
    assert 1 - heard.mean() == pytest.approx(0.03, abs=5 * math.sqrt(0.03 / n) + 2e-5)
    assert np.isposinf(scans[~heard]).all()
    assert scans[heard].std() == pytest.approx(0.02, rel=0.01)
    # Beams and steps are independent: means of either scatter as those of independent draws do.
    for axis, count in ((0, 400), (1, laser.beams)):
        means = np.nanmean(np.where(heard, scans, np.nan), axis=axis)
        assert means.std() == pytest.approx(0.02 / math.sqrt(count), rel=0.15)
    biases = []
    for key in range(2000):
        out = np.full(1, 3.0, np.float32)
        lasers.add_laser_noise(arrays._replace(sigma=0.0, no_echo=0.0), np.uint64(key), 0, out)
        biases.append(out[0] - 3.0)
    assert np.std(biases) == pytest.approx(0.01, rel=0.1)
    assert abs(np.mean(biases)) < 0.001


def test_reports_follow_rep_117():
    """No echo within reach is +inf, too near is -inf."""
    laser = LaserSettings(beams=4)
    arrays = lasers.LaserArrays.of(laser, False)
    out = np.array([10.0, 0.01, 9.9, 0.06], np.float32)
    lasers.add_laser_noise(arrays, np.uint64(0), 0, out)
    assert out.tolist() == pytest.approx([math.inf, -math.inf, 9.9, 0.06])


@pytest.mark.parametrize("noise", [False, True])
def test_where_nothing_is_no_beam_has_an_echo_at_any_reach(noise):
    """1 / (1 / reach) is below the reach for 74 of these: each was a ring of echoes."""
    out = np.empty(8, np.float32)
    for reach in np.arange(5, 1000) / 10.0:
        arrays = lasers.LaserArrays.of(LaserSettings(beams=8, reach=reach), noise)
        lasers.exact_scan(arrays, 0.0, 0.0, 0.0, np.empty((0, 4)), NO_DISCS, ROOM, out)
        lasers.add_laser_noise(arrays, np.uint64(1), 0, out)
        assert np.isposinf(out).all(), reach


@pytest.mark.parametrize("depth", [-5e-5, 0.0, 1e-7, 1e-4, 4e-3])
@pytest.mark.parametrize("round_", [False, True])
@pytest.mark.parametrize("mount", [(0.7, 0.0), (0.7, 0.31), (0.2, -0.31), (-0.3, 0.0)])
def test_a_laser_at_the_edge_does_not_look_through_what_the_chair_touches(mount, round_, depth):
    """Towards a wall of 0.1 m it reads too near, and elsewhere what it reads a little before."""
    yaw = math.atan2(mount[1], mount[0])
    laser = LaserSettings(x=mount[0], y=mount[1], yaw=yaw, beams=271)
    distance, half, behind = math.hypot(*mount), 0.3, -2.0
    for turn in np.linspace(0.1, 6.0, 7):

        def scan_at(depth, turn=turn, frame=(3.0, 3.0, turn)):
            near, far = distance - depth, distance - depth + 0.1
            walls = [(near, -half, near, half), (far, -half, far, half)]
            walls = np.reshape([*(() if round_ else walls), (behind, -9, behind, 9)], (-1, 2))
            walls = to_world(walls, frame).reshape(-1, 4)
            disc = np.array([[*to_world((near + half, 0.0), frame), half]])
            out, pose = np.empty(271, np.float32), np.array([3.0, 3.0, turn - yaw])
            arrays, discs = lasers.LaserArrays.of(laser, False), disc if round_ else NO_DISCS
            lasers.sense_laser(arrays, pose, walls, discs, np.uint64(0), 0, ROOM, out)
            return out

        scan, before = scan_at(depth), scan_at(-1e-3)
        ahead = np.abs(laser.angles) < math.radians(75.0)
        assert np.isneginf(scan[ahead]).all()
        behind_it = np.abs(laser.angles) > math.radians(100.0)
        assert scan[behind_it] == pytest.approx(before[behind_it], abs=0.02)

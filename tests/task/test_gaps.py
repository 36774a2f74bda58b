"""Laws of the gaps beside the outline."""

import numpy as np
import pytest

from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.sensors.settings import LaserSettings
from wheelchair_gym.task import side_clearance as gaps

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


def test_gaps_of_a_corridor_are_what_is_left_of_its_width():
    scan = corridor(0.45, 0.6)
    here, moved, wide = told(scan, [(0.8, 0.1, 0.0), (0.5, -0.9, 0.0)])
    assert here == pytest.approx([0.45 - 0.31, 0.6 - 0.31], abs=1e-3)
    assert moved == pytest.approx([0.35 - 0.31, 0.7 - 0.31], abs=1e-3)
    assert wide[0] == pytest.approx(0.3 - 0.31, abs=1e-3)  # the wall at -0.6 is on its left


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
        for row, (x, y, yaw) in zip(told(scan, poses), [(0.0, 0.0, 0.0), *poses], strict=True):
            c, s = np.cos(yaw), np.sin(yaw)
            along, aside = np.array([(c, s), (-s, c)]) @ (points - (x, y)).T
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

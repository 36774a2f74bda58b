"""The shortest path of an episode: closed forms, invariance, and drives, none of which beats it."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from agents.evaluation.evaluate import drive_episode, make_env
from agents.evaluation.metrics import OVERSPEED, shortest_path
from agents.policies import make_policy
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import to_world
from wheelchair_gym.maps import FREE, OccupancyGrid
from wheelchair_gym.types import Arrival, Episode

GRID = OccupancyGrid(np.full((4, 4), FREE, np.uint8), 1.0)  # far too small: its border is open


def task(tolerance=0.3, period=1e-6, **outline):
    limits = SimpleNamespace(forward=0.8, backward=0.3)
    return SimpleNamespace(
        footprint=Footprint(**outline), tolerance=tolerance, limits=limits, period=period
    )


def rotated(episode, yaw):
    """Turn a world about the origin by an angle [rad]."""
    frame = (0.0, 0.0, yaw)
    x, y, heading = episode.map.origin
    discs = episode.discs.copy()
    discs[:, :2] = to_world(discs[:, :2], frame)
    start, goal = (
        np.append(to_world(end[:2], frame), end[2] + yaw) for end in (episode.start, episode.goal)
    )
    return replace(
        episode,
        map=replace(episode.map, origin=(*to_world(np.array([x, y]), frame), heading + yaw)),
        walls=to_world(episode.walls.reshape(-1, 2), frame).reshape(-1, 4),
        discs=discs, start=start, goal=goal,
    )  # fmt: skip


def world(start, goal, walls=(), discs=(), **more):
    ends = (np.array([*end, 0.0]) for end in (start, goal))
    shapes = np.reshape(walls, (-1, 4)).astype(float), np.reshape(discs, (-1, 3)).astype(float)
    return Episode(GRID, *ends, *shapes, **more)


def box(xmin, ymin, xmax, ymax):
    corners = np.array([(xmin, ymin), (xmax, ymin), (xmax, ymax), (xmin, ymax)])
    return np.hstack([corners, np.roll(corners, -1, axis=0)])


def length(episode, **settings):
    return shortest_path(task(**settings), episode, episode.start)


def test_closed_forms():
    """The taut string around a disc or a wall's end, with each footprint's smallest distance."""
    for outline, r in (({}, 0.3), ({"half_width": 0.25}, 0.25), ({"front": 0.2}, 0.2)):
        around = world((-4.0, 0.0), (4.0, 0.0), discs=[(0.0, 0.0, 1.0)])
        reach = 1.0 + r
        taut = 2.0 * math.sqrt(16.0 - reach**2) + reach * (math.pi - 2.0 * math.acos(reach / 4.0))
        found = length(around, **outline)
        assert found.is_exact
        assert taut - 0.305 < found.length <= taut - 0.3
    through = world((-2.0, 0.0), (0.35, 0.0), box(0.0, -5.0, 0.1, 5.0))
    assert length(through, tolerance=1.0).length == pytest.approx(1.35, abs=0.002)
    assert length(through, tolerance=0.5).length > 10.0  # behind the wall, and round its end
    assert length(world((0.0, 0.0), (0.1, 0.1))) == (0.0, True)
    ring = np.vstack([box(1.0, -1.0, 3.0, 1.0), box(1.5, -0.5, 2.5, 0.5)])
    assert length(world((-2.0, 0.0), (2.0, 0.0), ring)) == (pytest.approx(3.7), False)
    pose = world((0.0, 0.0), (5.0, 0.0), arrival=Arrival(0.3, 0.4, 0.1, 0.1))
    assert length(pose).length == pytest.approx(4.5, abs=0.002)


def test_a_turned_world_has_the_same_shortest_path():
    """Within what the polygons for arcs differ by."""
    walls = np.vstack([box(3.0, -2.0, 3.2, 4.0), box(6.0, 3.0, 6.3, 12.0)])
    for seed in range(20):
        rng = np.random.default_rng(seed)
        discs = np.column_stack([rng.uniform(1.0, 9.0, (12, 2)), rng.uniform(0.1, 0.8, 12)])
        plain = world((-0.5, 0.0), (10.0, 9.0), walls, discs)
        first, second = length(plain), length(rotated(plain, rng.uniform(-3.0, 3.0)))
        assert first.is_exact
        assert second.is_exact
        assert second.length == pytest.approx(first.length, abs=0.005)


DOCK = {"name": "skill", "course": "dock"}


@pytest.mark.parametrize("scene", ["clutter", "barn", "floor_plan", DOCK])
def test_no_drive_beats_it(scene):
    env = make_env(scene, {"pose_source": "modelled"}, None)
    arrived, trail = 0, []

    def follow(env):
        trail.append(env.unwrapped.chair.truth.pose)

    for seed, name in enumerate(("lattice+window", "a_star+pure_pursuit", "lattice+window")):
        env.reset(seed=seed)
        trail.clear()
        episode = rotated(env.unwrapped.episode, 0.7 * seed)
        record = drive_episode(env, make_policy(name), seed, follow, episode)
        steps = np.hypot(*np.diff(trail, axis=0)[:, :2].T)
        assert steps.max() <= OVERSPEED * 0.8 * env.unwrapped.task.period
        assert record["length"] == pytest.approx(steps.sum())
        assert record["shortest_is_exact"]
        if record["success"]:
            arrived += 1
            assert record["length"] >= record["shortest"] - 1e-6
            assert record["spl"] == record["shortest"] / record["length"]
    env.close()
    assert arrived >= 2

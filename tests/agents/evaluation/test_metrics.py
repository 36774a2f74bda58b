"""Figures of an episode, by hand, and its shortest path, which no drive beats."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from agents.evaluation import metrics
from agents.evaluation.evaluate import drive_episode, make_env
from agents.evaluation.metrics import OVERSPEED, shortest_path
from agents.policies import make_policy
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import polygon_edges, to_world
from wheelchair_gym.maps import FREE, OccupancyGrid
from wheelchair_gym.types import Arrival, Episode


def test_jerk_of_a_cubic_is_its_third_derivative_and_acceleration_of_a_ramp_its_slope():
    t = np.arange(0.0, 3.0, 0.1)
    assert metrics.derivative_rms(0.5 * 0.6 * t**2, 0.1, 2) == pytest.approx(0.6)  # v = j t^2 / 2
    assert metrics.derivative_rms(0.3 + 0.2 * t, 0.1, 2) == pytest.approx(0.0, abs=1e-9)
    assert metrics.derivative_rms(0.4 * t, 0.1, 1) == pytest.approx(0.4)


def test_rough_share_counts_sideways_and_ahead():
    steady = np.column_stack([np.full(11, 0.8), np.full(11, 1.0)])  # 0.8 m/s2 sideways
    assert metrics.rough_share(steady, 0.1) == 0.0
    assert metrics.rough_share(steady * (1.2, 1.0), 0.1) == 1.0
    v = np.concatenate([np.zeros(5), np.arange(6) * 0.1])  # 1 m/s2 in half of the time
    assert metrics.rough_share(np.column_stack([v, np.zeros(11)]), 0.1) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("success", "seconds", "score"),
    [(True, 5.0, 0.5), (True, 20.0, 0.25), (True, 90.0, 0.125), (False, 20.0, 0.0)],
)
def test_scores_are_those_of_barn(success, seconds, score):
    assert metrics.barn_score(success, seconds, 10.0, 2.0) == pytest.approx(score)


def test_halts_are_rests_on_the_way():
    go, rest, turn = (0.5, 0.0), (0.0, 0.0), (0.0, 0.3)
    way = [rest] * 9 + [go] * 3 + [rest] * 5 + [turn] * 2 + [rest] * 4 + [go] + [rest] * 9
    # Not before it set out, not the short one, not the end.
    assert metrics.halts(np.array(way), 0.1) == 1
    assert metrics.halts(np.zeros((20, 2)), 0.1) == 0


def info(x, **other):
    base = {
        "pose": np.array([x, 0.0, 0.0]), "twist": np.array([0.5, 0.0]), "clearance": 0.3,
        "contact": False, "bumped": False, "is_success": False, "arrived": False,
        "geodesic": 1.0, "time": x / 0.5, "energy": 0.02 * x, "at_fault": False, "contact_with": -1,
    }  # fmt: skip
    return base | other


def episode(last, truncated=False, given_map=None, **middle):
    trace = metrics.Trace(0.5, shortest=metrics.Shortest(0.8, True), given_map=given_map)
    steps = [info(0.0), info(0.25, **middle), info(0.5), info(1.25, **last)]
    for step in steps:
        trace.add(step)
    trace.acts_s = [0.001, 0.003]
    return metrics.measure(trace, steps[-1], truncated)


def test_a_success_is_measured():
    record = episode({"is_success": True, "arrived": True})
    assert record["outcome"] == "success"
    assert record["length"] == pytest.approx(1.25)
    assert record["spl"] == pytest.approx(0.8 / 1.25)
    assert record["spl_grid"] == pytest.approx(1.0 / 1.25)
    assert record["energy_per_m"] == pytest.approx(0.02)
    assert record["time"] == pytest.approx(2.5)
    assert record["act_ms_p50"] == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("yaw", "outcome"), [(0.0, "success"), (0.3, "left_map"), (-0.3, "left_map")]
)
def test_a_drive_that_leaves_the_cells_of_its_map_is_no_success(yaw, outcome):
    """The map ends where its cells end, not at the rectangle that holds a turned map."""
    x, y = to_world((-0.1, -0.1), (0.0, 0.0, yaw))
    strip = OccupancyGrid(np.zeros((4, 30)), 0.05, (x, y, yaw))
    x0, y0, x1, y1 = strip.bounds
    assert yaw == 0.0 or (x0 < 0.0 < 1.25 < x1 and y0 < 0.0 < y1)
    record = episode({"is_success": True, "arrived": True}, given_map=strip)
    assert record["outcome"] == outcome
    assert (record["spl"] > 0.0) == record["success"] == (outcome == "success")


@pytest.mark.parametrize(
    ("last", "middle", "truncated", "outcome"),
    [
        ({"is_success": True, "arrived": True}, {"contact": True}, False, "collision"),
        ({"bumped": True}, {}, False, "collision"),
        ({}, {}, True, "timeout"),
        ({"arrived": True}, {}, False, "missed"),
    ],
)
def test_what_is_no_success_has_a_name(last, middle, truncated, outcome):
    record = episode(last, truncated, **middle)
    assert (record["outcome"], record["success"], record["spl"]) == (outcome, False, 0.0)


def test_a_summary_adds_up():
    good, bad = episode({"is_success": True, "arrived": True}), episode({}, truncated=True)
    records = [
        {"policy": "p", "scene": scene, "seed": k, **record, "margin": margin}
        for scene in ("a", "b")
        for k, (record, margin) in enumerate([(good, 0.2), (good, 0.04), (bad, 0.05)])
    ]
    rows = {row["scene"]: row for row in metrics.summarise(records)}
    assert list(rows) == ["a", "b", "all"]
    assert rows["all"]["episodes"] == 6
    for row in rows.values():
        assert row["success"] + row["collision"] + row["timeout"] + row["missed"] == 1.0
        assert row["success"] == pytest.approx(2 / 3)
        assert (row["wide"], row["margin"]) == (0.5, 0.04)
        assert row["success_low"] < row["success"] < row["success_high"]
        assert row["time"] == good["time"]  # of successes only
        assert all(math.isfinite(value) for value in row.values() if isinstance(value, float))


def test_at_fault_contacts_and_touched_actors_are_counted():
    """One step in the middle of an episode is enough."""
    harmed = episode({}, at_fault=True, contact_with=2, contact=True)
    assert harmed["at_fault"]
    assert harmed["touched_actor"]
    assert not episode({})["at_fault"]
    assert not episode({})["touched_actor"]


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
    return polygon_edges([(xmin, ymin), (xmax, ymin), (xmax, ymax), (xmin, ymax)])


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

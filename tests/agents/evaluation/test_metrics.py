"""Figures of an episode, against values worked out by hand."""

import math

import numpy as np
import pytest

from agents.evaluation import metrics
from wheelchair_gym.maps import OccupancyGrid


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
    assert (
        metrics.halts(np.array(way), 0.1) == 1
    )  # not before it set out, not the short one, not the end
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
    x, y = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]) @ (
        -0.1,
        -0.1,
    )
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

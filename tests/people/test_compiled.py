"""Compiled assistants: what they see and remember, and that shortcuts leave out nothing."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.agents.fakes import reading
from wheelchair_gym.envs import NavigationVectorEnv
from wheelchair_gym.geometry.kinematics import arc_step
from wheelchair_gym.geometry.outline import Footprint, signed_gap
from wheelchair_gym.people.assistance import COMPILED, make_compiled, methods
from wheelchair_gym.people.assistance.state import DOCKING_MARGIN, Freedom
from wheelchair_gym.people.assistance.step import KINDS, Assistants
from wheelchair_gym.sensors.settings import LaserSettings, SensorSettings
from wheelchair_gym.sim.settings import ChairSettings
from wheelchair_gym.types import Stick

CHAIR, SENSORS = ChairSettings(), SensorSettings()
LIMITS, OUTLINE = CHAIR.limits, Footprint().array
deflections = st.floats(-1.0, 1.0, allow_nan=False)


def row_of(name, sensors=SENSORS):
    row = Assistants(make_compiled(name), CHAIR, sensors, 0.1)
    row.begin()
    return row


def points_of(row):
    return row.states["points"][0, : row.states["n_points"][0]]


def scan_of(seed, nearest=0.06):
    """A scan of blocks of random ranges, some without echo and some too near."""
    rng = np.random.default_rng(seed)
    ranges = np.repeat(rng.uniform(nearest, 6.0, 47), 23)[:1081]
    ranges[rng.random(1081) < 0.02] = np.inf
    ranges[rng.random(1081) < 0.01] = np.nan
    return ranges


REST = Stick(0.0, 0.0, False)


@pytest.mark.parametrize("shows_free", [True, False])
def test_further_scanners_show_obstacles_and_what_is_gone(shows_free):
    """A post behind; a scanner that may look over things does not say that it has gone."""
    behind = LaserSettings(x=-0.25, yaw=math.pi, beams=91, shows_free=shows_free)
    row = row_of("slide", replace(SENSORS, more_lasers=(behind,)))
    blank = np.full(1081 + 91, np.inf)
    seen = blank.copy()
    seen[1081 + 45] = 0.07
    row.update(REST, reading(seen))
    place = [behind.x, behind.y] + 0.07 * behind.directions[45]
    assert np.allclose(points_of(row), [place], atol=1e-5)
    row.update(REST, reading(blank, stamp=0.1))
    assert len(points_of(row)) == (0 if shows_free else 1)
    row.update(REST, reading(seen, stamp=0.2))
    twist = Stick(-1.0, 0.0, False)
    row.update(twist, reading(seen, stamp=0.3))
    free = row_of("slide")
    free.update(twist, reading(blank[:1081], stamp=0.3))
    assert free.twist()[0] < row.twist()[0] <= 0.0


def test_what_slips_out_of_sight_is_remembered_for_a_while():
    """A post beside the rear, which the scanner in front saw before."""
    angles, directions = SENSORS.laser.angles, SENSORS.laser.directions
    blank = np.full(1081, np.inf)
    seen = blank.copy()
    beam = int(np.argmin(np.abs(angles - np.radians(120))))
    seen[beam] = 0.6
    place = np.array([SENSORS.laser.x, 0.0]) + 0.6 * directions[beam]
    row = row_of("slide")
    row.update(REST, reading(seen))
    assert np.allclose(points_of(row), [place], atol=1e-5)
    row.update(REST, reading(blank, (0.0, 0.0), 0.1))
    assert len(points_of(row)) == 0  # now it is not there
    blank[500:520] = -np.inf  # too near to be measured: between the laser and its least range
    row.update(REST, reading(blank, (0.0, 0.0), 0.15))
    assert np.allclose(points_of(row), (SENSORS.laser.x, 0.0), atol=SENSORS.laser.range_min)
    assert len(points_of(row))
    blank[500:520] = np.inf
    row.update(REST, reading(seen, stamp=0.2))
    row.update(REST, reading(blank, (5.0, 0.0), 0.3))  # at once behind the view
    assert np.allclose(points_of(row), [place - (0.5, 0.0)], atol=1e-5)
    for k in range(1, 99):
        row.update(REST, reading(blank, (0.0, 0.0), 0.3 + 0.1 * k))
        assert len(points_of(row)) == 1
    row.update(REST, reading(blank, (0.0, 0.0), 10.25))
    assert len(points_of(row)) == 0


def test_each_obstacle_that_is_seen_has_a_beam_and_none_nearer_is_left_out():
    directions = SENSORS.laser.directions
    for seed in range(5):
        scan = scan_of(seed, 0.3)
        row = row_of("shield")
        row.update(REST, reading(scan))
        found = points_of(row)
        near = np.isfinite(scan)
        places = np.array([SENSORS.laser.x, 0.0]) + scan[near, None] * directions[near]
        apart = np.hypot(*(found[:, None] - places).transpose(2, 0, 1))
        assert apart.min(axis=1).max() < 1e-5
        gaps = [signed_gap(each, len(each), OUTLINE, 0.0, 0.0, 0.0) for each in (found, places)]
        assert gaps[0] <= gaps[1] + 0.02


def test_a_steady_low_stick_lowers_the_margin():
    config, row, blank = Freedom(), row_of("slide"), reading(np.full(1081, np.inf))

    def margin(stick):
        row.update(stick, blank)
        return float(row.states["margin"][0])

    low, high = Stick(0.25, 0.0, False), Stick(0.8, 0.0, False)
    margins = [margin(low) for _ in range(15)]
    assert margins[0] == margins[5] == config.margin
    assert margins[-1] == DOCKING_MARGIN < config.margin
    assert margin(high) == config.margin
    assert {margin(Stick(0.3 * (k % 2), 0.0, False)) for k in range(30)} == {config.margin}


def followed(points, v, w, margin, maximum):
    """`follow_arc`, pose by pose."""
    n = len(points)
    minimum, clear = signed_gap(points, n, OUTLINE, 0.0, 0.0, 0.0), maximum
    for k in range(methods.STEPS):
        gap = signed_gap(points, n, OUTLINE, *arc_step(0.0, 0.0, 0.0, v, w, methods.STEP * (k + 1)))
        if gap < margin and gap < minimum:
            return k, clear
        minimum, clear = min(margin, gap), min(clear, gap)
    return methods.STEPS, clear


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), deflections, deflections, st.sampled_from([0.0, 0.03, 0.2]))
def test_poses_that_are_left_out_do_not_matter(seed, v, w, margin):
    points = np.random.default_rng(seed).uniform(-3.0, 3.0, (30, 2))
    given_, free = (
        methods.follow_arc(at, OUTLINE, v, w, methods.STEP, methods.STEPS, margin, 0.1, -math.inf)
        for at in (points, np.empty((0, 2)))
    )
    assert given_ == followed(points, v, w, margin, 0.1)
    assert free == (methods.STEPS, 0.1)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), deflections, deflections)
def test_the_shared_dynamic_window_finds_the_least_cost(seed, forward, left):
    row, config = row_of("shared_dwa"), make_compiled("shared_dwa")
    row.update(Stick(forward, left, False), reading(scan_of(seed, 0.2)))
    state = row.states[0]
    (to_v, to_w), turn, points = state["asked"], state["turn"], points_of(row)

    def cost(v, w):
        free, clear = followed(points, v, w, state["margin"], config.enough)
        needed = methods.time_to_stop(v, w, LIMITS.deceleration, 0.1)
        if free < methods.STEPS and free * methods.STEP < needed:
            return math.inf
        off = methods.HEADING_WEIGHT * abs(w - to_w) * methods.STEP * methods.STEPS / math.pi
        off += methods.SPEED_WEIGHT * abs(v - to_v) / max(abs(to_v), 1e-9)
        share = max(0.0, clear) / config.enough
        return 1.0 - share + share * off

    every = [
        cost(to_v * i / (methods.SPEEDS - 1), to_w + turn * (2.0 * j / (methods.TURNS - 1) - 1.0))
        for i in range(methods.SPEEDS)
        for j in range(methods.TURNS)
    ]
    minimum = min(every)
    if math.isinf(minimum):
        assert not state["twist"].any()
    elif to_v or to_w:
        assert cost(*state["twist"]) == pytest.approx(minimum, abs=1e-9)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), deflections, deflections)
def test_no_constraint_of_slide_is_violated(seed, forward, left):
    row, config = row_of("slide"), make_compiled("slide")
    row.update(Stick(forward, left, False), reading(scan_of(seed, 0.2)))
    state, rows = row.states[0], np.empty((200, 3))
    n = methods.write_constraints(points_of(row), OUTLINE, state["margin"], config.latency, rows)
    assert (rows[:n, :2] @ state["twist"] <= rows[:n, 2] + 1e-8).all()


def test_it_backs_slowly_where_nothing_looks():
    blank = reading(np.full(1081, np.inf))
    for name in COMPILED:
        row = row_of(name)
        row.update(Stick(-1.0, 0.4, False), blank)
        backward = -LIMITS.backward if name in ("direct", "shield") else -Freedom().backward
        asked = [backward, 0.4 * LIMITS.turn]  # the arc that the method checks
        assert row.states["asked"][0].tolist() == row.twist().tolist() == asked


def test_each_has_a_kind():
    assert {COMPILED[name] for name in COMPILED} == set(KINDS)


@pytest.mark.parametrize("name", ["shield", "shared_dwa"])
def test_help_does_not_shut_a_door_of_eighty_centimetres(name):
    n, arrived = 4, 0
    env = NavigationVectorEnv(
        n, scene={"name": "skill", "course": "door_80"}, driver="expert", assistant=name,
        shield=True, num_threads=1, split="test"
    )  # fmt: skip
    env.reset(seed=0)
    over = np.zeros(n, bool)
    for _ in range(300):
        _, _, terminated, truncated, info = env.step(np.zeros((n, 2)))
        arrived += int((info["is_success"] & ~over).sum())
        over |= terminated | truncated
        if over.all():
            break
    env.close()
    assert arrived == n


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.tuples(deflections, deflections, st.floats(0.0, 1.0)), min_size=1, max_size=8),
    st.tuples(deflections, deflections),
    st.floats(0.1, 3.0),
)
def test_no_point_that_fits_is_nearer(rows, asked, weight):
    rows = np.array(rows)
    v, w = methods.nearest_twist(rows, len(rows), asked, (1.0, weight))
    assert (rows[:, :2] @ (v, w) <= rows[:, 2] + 1e-6).all()
    cost = (v - asked[0]) ** 2 + weight * (w - asked[1]) ** 2
    grid = np.stack(np.meshgrid(*2 * [np.linspace(-1.2, 1.2, 61)]), -1).reshape(-1, 2)
    fits = (grid @ rows[:, :2].T <= rows[:, 2]).all(axis=1)
    costs = ((grid - asked) ** 2 @ (1.0, weight))[fits]
    assert cost <= costs.min(initial=math.inf) + 1e-9


@pytest.mark.parametrize("point", [(1.2, 0.1), (1.0, 0.9), (0.2, 0.7), (-0.6, -0.5), (0.5, -0.5)])
@pytest.mark.parametrize("twist", [(0.5, 0.0), (0.0, 0.8), (-0.2, 0.4), (0.4, -0.7)])
def test_a_constraint_is_the_rate_at_which_the_distance_shrinks(point, twist):
    points, rows = np.array([point]), np.empty((1, 3))
    assert methods.write_constraints(points, OUTLINE, 0.0, 0.2, rows) == 1
    step = 1e-6
    before = signed_gap(points, len(points), OUTLINE, 0.0, 0.0, 0.0)
    after = signed_gap(points, len(points), OUTLINE, *arc_step(0.0, 0.0, 0.0, *twist, step))
    assert rows[0, :2] @ twist == pytest.approx((before - after) / step, abs=1e-4)


@given(st.floats(0.0, 1.4), st.floats(0.0, 0.1))
def test_the_chair_stops_within_the_distance(distance, margin):
    rows = np.empty((1, 3))
    points = np.array([[OUTLINE[0] + distance, 0.0]])
    methods.write_constraints(points, OUTLINE, margin, 0.2, rows)
    speed = rows[0, 2]
    assert speed >= 0.0
    room = max(0.0, distance - margin)
    assert speed * 0.2 + speed**2 / (2 * 0.6) == pytest.approx(room, abs=1e-9)

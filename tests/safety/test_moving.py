"""The shield among people who are tracked: faster, and never nearer than they may come."""

import numpy as np
import pytest

from tests.safety.test_shield import AHEAD, STILL, begin, drive, hits
from tests.sim.worlds import box
from wheelchair_gym.actors.records import NOBODY, person
from wheelchair_gym.safety import Shield, ShieldSettings
from wheelchair_gym.safety.moving import _owner, may_reach_point, spread_tracked
from wheelchair_gym.safety.state import NEARBY, ShieldConstants
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings

TRACKS, NONE = ShieldSettings(), ShieldSettings(tracks=False)
FASTEST, CHANGE = TRACKS.person_speed, TRACKS.person_acceleration
CONSTANTS = ShieldConstants(TRACKS, ChairSettings(), SensorSettings(), 0.1).record.view(np.recarray)


def near_one(place, velocity, unseen=0.0, radius=0.0):
    """A moving point at a place (2,) of one who was tracked there without an error, a record."""
    near = np.zeros(1, NEARBY).view(np.recarray)
    row = near[0]
    row["n_moving"] = row["n_tracked"] = 1
    row["moving_x"][0], row["moving_y"][0] = place
    row["hidden_for"][0] = row["hidden"] = unseen
    one = row["tracked"][0]
    one["x"], one["y"], one["vx"], one["vy"] = *place, *velocity
    one["unseen"], one["radius"] = unseen, radius
    return near


def reaches(near, point, t, ahead=-0.3):
    """Return True if a moving object may reach a point (2,) at a time [s]."""
    spread_tracked.py_func(CONSTANTS[0], near[0], t)
    return may_reach_point.py_func(CONSTANTS[0], near[0], ahead, *point, t)


@pytest.mark.parametrize("unseen", [0.0, 0.6])
def test_nobody_outruns_what_is_expected_of_them(unseen):
    """A person who changes velocity as much as people can stays where the shield expects them."""
    rng, dt = np.random.default_rng(0), 0.02
    for _ in range(60):
        velocity = rng.uniform(-1.0, 1.0, 2)
        near, place, at = near_one((0.0, 0.0), velocity, unseen), np.zeros(2), 0.0
        side = rng.uniform(-np.pi, np.pi)
        while at < unseen + 1.0:
            change = CHANGE * np.array([np.cos(side), np.sin(side)])
            faster = velocity + dt * change
            faster *= min(1.0, FASTEST / np.hypot(*faster))
            place, velocity = place + 0.5 * dt * (velocity + faster), faster
            at += dt
            if at >= unseen:
                assert reaches(near, place, at - unseen)


def test_a_person_who_walks_away_is_not_expected_back_at_once():
    walks_away = near_one((0.6, 0.0), (1.3, 0.0))
    comes = near_one((0.6, 0.0), (-1.3, 0.0))
    for t in (0.2, 0.4, 0.6):
        point = 0.6 - FASTEST * t, 0.0
        assert reaches(comes, point, t)
        assert not reaches(walks_away, point, t)
    for unseen, expected in ((0.5, False), (2.5, True)):  # they may have turned round meanwhile
        hidden = near_one((0.6, 0.0), (1.3, 0.0), unseen=unseen)
        assert reaches(hidden, (-0.6, 0.0), 0.4) is expected


def test_untracked_people_may_come_from_anywhere_at_once():
    near = near_one((0.6, 0.0), (1.3, 0.0))
    near[0]["owner"][0] = -1
    assert reaches(near, (0.6 - FASTEST * 0.4, 0.0), 0.4)


def owner_of(x, *tracked, ago=0.0):
    """Return the owner of a point at (x, 0); tracks: x, speed along x, unseen for, is a person."""
    near = np.zeros(1, NEARBY).view(np.recarray)
    near[0]["n_tracked"] = len(tracked)
    for one, (at, speed, unseen, is_person) in zip(near[0]["tracked"], tracked, strict=False):
        one["x"], one["vx"], one["unseen"], one["is_person"] = at, speed, unseen, is_person
        one["radius"] = 0.25
    return _owner.py_func(near[0], x, 0.0, ago)


def test_a_point_is_of_a_person_only_where_nothing_else_may_be_there():
    one, beside, far = (1.0, 0.0, 0.0, True), (1.5, 0.0, 0.0, True), (3.0, 0.0, 0.0, True)
    assert owner_of(0.8, one, far) == 0
    assert owner_of(2.8, one, far) == 1
    assert owner_of(2.0, one, far) == -1
    assert owner_of(1.25, one, beside) == -1
    assert owner_of(1.25, one, (1.5, 0.0, 0.0, False)) == -1  # a trolley, a door, who knows
    assert owner_of(1.25, one, (1.9, -1.0, 0.4, True)) == -1  # somebody out of view
    assert owner_of(0.2, (1.0, 1.0, 0.0, True), ago=0.8) == 0  # it was theirs when it was seen
    assert owner_of(0.2, (1.0, 1.0, 0.0, True), ago=1.4) == -1  # too long ago


def test_where_somebody_has_walked_it_backs_slowly_and_only_for_a_while():
    """They pass ahead of it; behind it, it has never seen anything."""
    passer = person([(2.5, -1.0), (2.5, 9.0)], 1.2, avoids=NOBODY)
    speeds = {}
    for wary in (0.0, 4.0):
        shield = Shield(ShieldSettings(wary_time=wary, moving_memory_time=0.5))
        trace, _, _ = drive(
            (0.0, 0.0, 0.0), (-0.3, 0.0), 9.0, half=8.0, shield=shield, actors=[passer]
        )
        speeds[wary] = np.array([-truth.twist[0] for _, truth in trace])
    assert speeds[0.0][10:30].max() > 0.07
    assert speeds[4.0][10:30].max() < 0.052
    assert speeds[4.0][70:].max() > 0.07


def speeds_among(settings, way, speed, seconds=6.0):
    """Speeds [m/s] of a chair that is to drive ahead, with somebody on a way of theirs."""
    walker = person(way, speed, avoids=NOBODY)
    trace, _, _ = drive(
        (-4.0, 0.0, 0.0), AHEAD, seconds, half=8.0, shield=Shield(settings), actors=[walker]
    )
    assert not hits(trace)
    return np.array([truth.twist[0] for _, truth in trace])


@pytest.mark.parametrize(
    ("way", "speed"),
    [
        ([(0.0, -2.5), (0.0, 4.0)], 1.0),  # across
        ([(4.0, 1.2), (-9.0, 1.2)], 0.6),  # past it
    ],
)
def test_it_drives_faster_where_it_knows_the_way_of_who_walks(way, speed):
    tracked, plain = (speeds_among(one, way, speed, 9.0) for one in (TRACKS, NONE))
    assert tracked.mean() > 1.03 * plain.mean()
    assert tracked[20:].min() > plain[20:].min() + 0.05


def test_it_stops_before_a_person_who_comes_towards_it():
    towards = [(4.0, 0.0), (-6.0, 0.0)]
    for one in (TRACKS, NONE):
        assert speeds_among(one, towards, 1.0).min() < 0.05


def test_where_nothing_moves_nobody_is_tracked_and_nothing_changes():
    tracked, _, shield = drive((0.0, 0.0, 0.7), AHEAD, 5.0)
    plain, _, _ = drive((0.0, 0.0, 0.7), AHEAD, 5.0, shield=Shield(NONE))
    assert not shield.state["tracker"]["begun"][0]
    for (decision, truth), (as_decided, as_driven) in zip(tracked, plain, strict=True):
        np.testing.assert_array_equal(decision.given, as_decided.given)
        np.testing.assert_array_equal(truth.pose, as_driven.pose)


def test_a_clock_that_stands_still_leaves_nobody_tracked():
    """Scans that come with one stamp show no velocity."""
    walker = person([(1.5, -2.0), (1.5, 2.0)], 1.0, avoids=NOBODY)
    chair, shield, reading = begin(box(8.0, actors=[walker]), 3)
    for _ in range(20):
        shield.filter(STILL, reading)
        reading = chair.drive(STILL)
    tracker = shield.state["tracker"][0]
    assert tracker["tracks"]["confirmed"][: tracker["n_tracks"]].any()
    shield.filter(STILL, reading._replace(stamp=float(shield.state["stamp"][0])))
    assert not tracker["tracks"]["confirmed"][: tracker["n_tracks"]].any()

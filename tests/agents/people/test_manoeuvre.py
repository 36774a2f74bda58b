"""Laws of manoeuvres: what asks for one, what ends it, and that help allows closeness."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agents.evaluation.evaluate import drive_episode, env_settings, make_env
from agents.people import is_shielded
from agents.people.assistant import AssistInput, AssistMission, find_doors, find_front
from agents.people.goals import Manoeuvre
from agents.policies import make_policy
from tests.agents.people.test_assistants import CHAIR, SENSORS, reading

FRONT, HALF = CHAIR.footprint.front, CHAIR.footprint.half_width
TIME = {"task": {"time_base": 60.0, "time_factor": 10.0}}


def wall(far, door=None, turn=0.0, behind=4.0):
    """Points of a wall ahead [m], with a door 0.9 m wide about y = `door`, and of one behind it."""
    y = np.linspace(-2.0, 2.0, 81)
    beside = np.full(81, True) if door is None else np.abs(y - door) >= 0.45
    points = np.column_stack([np.full(beside.sum(), far), y[beside]])
    if door is not None:
        back = np.column_stack([np.full(9, behind), door + np.linspace(-0.5, 0.5, 9)])
        points = np.vstack([points, back])
    c, s = math.cos(turn), math.sin(turn)
    return points @ np.array([(c, s), (-s, c)])


@pytest.mark.parametrize("turn", [-0.5, 0.0, 0.4])
def test_a_door_is_found_where_it_is_with_the_way_through(turn):
    found = find_doors(wall(2.0, 0.3, turn), HALF)
    c, s = math.cos(turn), math.sin(turn)
    middle = np.array([c * 2.0 - s * 0.3, s * 2.0 + c * 0.3])
    off = np.hypot(*(found[:, :2] - middle).T)
    best = found[off.argmin()]
    assert off.min() < 0.06
    assert best[2] == pytest.approx(turn, abs=0.06)
    assert best[3] == pytest.approx(0.9, abs=0.11)


@pytest.mark.parametrize("points", [np.empty((0, 2)), wall(2.0), np.array([(1.0, 0.0)])])
def test_there_is_no_door_where_there_is_none(points):
    assert len(find_doors(points, HALF)) == 0


def test_what_is_behind_a_door_must_lie_well_behind():
    assert len(find_doors(wall(2.0, 0.0, behind=2.2), HALF)) == 0


@pytest.mark.parametrize("turn", [-0.3, 0.0, 0.2])
def test_the_way_up_to_a_thing_is_square_to_it(turn):
    far, yaw = find_front(wall(1.4, turn=turn), FRONT, 1.0)
    assert yaw == pytest.approx(turn, abs=1e-6)
    assert far == pytest.approx(1.4 / math.cos(turn), abs=1e-6)
    assert find_front(wall(1.8), FRONT, 1.0) is None  # too far
    assert find_front(np.full((4, 2), (1.0, 0.0)), FRONT, 1.0) is None  # one point
    uneven = np.array([-0.33, -0.35, 0.39, -0.19, 0.2, 0.24, -0.17, -0.31])  # its slope is 0.0
    assert find_front(np.column_stack([np.ones(8), uneven]), FRONT, 1.0)[1] == 0.0
    assert find_front(np.empty((0, 2)), FRONT, 1.0) is None
    rough = wall(1.2) + np.where(np.arange(81) % 2, 0.1, 0.0)[:, None] * (1.0, 0.0)
    assert find_front(rough, FRONT, 1.0) is None


def method(sticks, points):
    """The twists and plans of a chair that stands before points while sticks ask."""
    made, found = Manoeuvre().make().method, []
    made.reset(AssistMission(CHAIR, SENSORS, 0.1))
    for k, asked in enumerate(sticks):
        now = AssistInput(asked, reading([1.0], stamp=0.1 * k), points, 0.03, 1.0, None)
        found.append((made.twist(now), made._plan))
    return found


def test_a_stick_towards_a_door_asks_and_one_that_points_elsewhere_ends_it():
    ahead, back, aside = (0.5, 0.0), (-0.2, 0.0), (0.1, 0.9)
    door = wall(2.0, 0.3)
    for other in (back, aside):
        (v, _), plan = (found := method([ahead, other, ahead], door))[0]
        assert plan is not None
        assert not plan.docks
        assert 0.0 <= v <= 0.5
        assert found[1] == (other, None)
        assert found[2][1] is not None


def test_only_a_low_stick_asks_to_drive_up_to_a_thing():
    desk = wall(1.5)
    assert method([(0.3, 0.0)], desk)[0][1].docks
    assert method([(0.8, 0.0)], desk)[0] == ((0.8, 0.0), None)
    end = method([(0.3, 0.0)], desk)[0][1].path[-1]
    assert end == pytest.approx([1.5 - FRONT - 0.1, 0.0, 0.0], abs=1e-3)


@pytest.mark.parametrize("name", ["shield", "manoeuvre"])
def test_help_does_not_forbid_closeness(name):
    """Somebody who drives well gets as near a desk as it wants: 0.05 to 0.15 m."""
    settings = env_settings(driver="expert", shield=is_shielded(name), config=TIME)
    env = make_env({"name": "skill", "course": "dock"}, settings, None)
    policy = make_policy({"name": "assisted", "assist": name})
    drives = [drive_episode(env, policy, seed) for seed in range(4)]
    assert all(drive["success"] and not drive["at_fault"] for drive in drives)

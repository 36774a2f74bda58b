"""Laws of assistants: how far they go, when they let go, what they do not know; manoeuvres."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.evaluation.evaluate import drive_episode, env_settings, make_env
from agents.people import ASSISTANTS, is_shielded, make_assistant
from agents.people.assistant import AssistInput, AssistMission, find_doors, find_front, find_targets
from agents.people.goals import Manoeuvre
from agents.policies import make_policy
from tests.agents.fakes import reading
from tests.conftest import at_start
from tests.laws.test_policies import plain
from tests.people.test_compiled import scan_of
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.geometry.planar import to_world
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings
from wheelchair_gym.types import Stick

CHAIR, SENSORS = ChairSettings(), SensorSettings()
MISSION = AssistMission(CHAIR, SENSORS, 0.1)
LIMITS = CHAIR.limits


def assisted(name, sticks, scans, assistant=None):
    """Return twists of an assistant, a new one if none is given, for sticks and scans at 10 Hz."""
    assistant, found = assistant or make_assistant(name), []
    assistant.reset(MISSION)
    for k, (stick, scan) in enumerate(zip(sticks, scans, strict=True)):
        found.append(assistant.assist(stick, reading(scan, (0.2, 0.1), 0.1 * k), None))
    return np.array(found)


deflections = st.floats(-1.0, 1.0, allow_nan=False)
stick = st.builds(Stick, deflections, deflections, st.booleans())


@pytest.mark.parametrize("name", ASSISTANTS)
def test_it_never_goes_beyond_its_freedom(name):
    """No speed beyond the stick's, none against it, and no more turn than its freedom."""
    freedom = make_assistant(name).freedom

    @settings(max_examples=25, deadline=None)
    @given(st.lists(stick, min_size=1, max_size=4), st.integers(0, 10_000))
    def law(sticks, seed):
        scans = [scan_of(seed + k) for k in range(len(sticks))]
        for asked, (v, w) in zip(sticks, assisted(name, sticks, scans), strict=True):
            to_v, to_w = LIMITS.twist_of(asked.forward, asked.left)
            assert min(0.0, to_v) <= v <= max(0.0, to_v)
            more = freedom.turn * min(1.0, np.hypot(asked.forward, asked.left)) + 1e-12
            assert min(0.0, to_w) - more <= w <= max(0.0, to_w) + more
            assert abs(w) <= LIMITS.turn

    law()


@pytest.mark.parametrize("name", ASSISTANTS)
def test_the_same_drive_gives_the_same_twists(name):
    sticks = [Stick(0.8, 0.1 * k, False) for k in range(6)]
    scans = [scan_of(k) for k in range(6)]
    one, other = assisted(name, sticks, scans), assisted(name, sticks, scans)
    assert one.tobytes() == other.tobytes()
    assistant = make_assistant(name)
    for _ in range(2):  # a second episode is as the first
        assert assisted(name, sticks, scans, assistant).tobytes() == one.tobytes()


@pytest.mark.parametrize("name", ASSISTANTS)
def test_in_the_open_the_stick_is_the_twist_or_nearly(name):
    nothing = np.full(1081, np.inf)
    sticks = [Stick(0.7, 0.0, False)] * 12
    v, w = assisted(name, sticks, [nothing] * 12)[-1]
    assert v == pytest.approx(0.56, abs=0.15)
    assert abs(w) < 0.2


@pytest.mark.parametrize(
    "name", sorted(set(ASSISTANTS) - {"direct", "shield", "blend", "manoeuvre", "ppo_assist"})
)
def test_it_slows_before_a_wall(name):
    """0.35 m before the front, 0.56 m/s would need 0.2 m of braking after 0.1 s."""
    angles = SENSORS.laser.angles
    wall = np.where(np.abs(angles) < 1.2, 0.12 / np.maximum(np.cos(angles), 0.1), np.inf)
    v, _ = assisted(name, [Stick(1.0, 0.0, False)] * 3, [wall] * 3)[-1]
    assert v < 0.5


@pytest.mark.parametrize("name", ASSISTANTS)
def test_the_goal_never_reaches_it(name):
    """Twists are those of any other goal, by a policy that knows the mission."""
    env = at_start(NavigationEnv("clutter", driver="expert", beams=64, split="test"), 1)
    mission, readings = env.mission, []
    for _ in range(15):
        readings.append(env.reading)
        env.step(np.array(env.task.stick[:2]))
    assert any(each.stick.forward for each in readings)
    found = []
    for goal in (mission.goal, mission.goal + 7.0, np.full(2, np.nan)):
        policy = make_policy({"name": "assisted", "assist": name})
        other = replace(mission, goal=goal, tolerance=0.1, time_limit=1.0, key=9)
        policy.reset(other)
        found.append([plain(policy.act(each)) for each in readings])
    assert found[0] == found[1] == found[2]
    assert "goal" not in {field.name for field in fields(AssistMission)}


def test_nothing_but_the_bare_stick_goes_without_the_shield():
    assert [name for name in ASSISTANTS if not is_shielded(name)] == ["direct"]


def test_without_a_person_the_chair_stands():
    policy = make_policy("assisted")
    env = at_start(NavigationEnv("clutter", beams=64, split="test"))
    policy.reset(env.mission)
    assert not policy.act(env.reading).twist.any()


@pytest.mark.parametrize("name", sorted(set(ASSISTANTS) - {"residual", "ppo_assist"}))
def test_nobody_is_kept_from_backing_out(name):
    """A stick pulled back moves the chair back at its maximum speed if nothing stands behind."""
    freedom = make_assistant(name).freedom
    backing, wall = [Stick(-1.0, 0.0, False)] * 10, [np.full(1081, 1.0)] * 10
    twists = assisted(name, backing, wall)
    slowest = -min(freedom.backward, LIMITS.backward)
    assert twists[-1] == pytest.approx((slowest, 0.0), abs=0.005)


def test_doors_desks_and_free_directions_are_targets():
    wall = np.array([(2.0, y) for y in np.linspace(-3, 3, 121) if abs(y - 0.5) > 0.45])
    found = find_targets(wall, 0.7)
    beyond = np.hypot(*(found - (2.0 + 0.8, 0.5)).T)
    assert beyond.min() < 0.1  # the door
    assert np.hypot(*(found - (1.2, 0.0)).T).min() < 0.4  # in front of the wall
    assert len(find_targets(np.empty((0, 2)), 0.7)) == 9


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
    return to_world(points, (0.0, 0.0, turn))


@pytest.mark.parametrize("turn", [-0.5, 0.0, 0.4])
def test_a_door_is_found_where_it_is_with_the_way_through(turn):
    found = find_doors(wall(2.0, 0.3, turn), HALF)
    off = np.hypot(*(found[:, :2] - to_world((2.0, 0.3), (0.0, 0.0, turn))).T)
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

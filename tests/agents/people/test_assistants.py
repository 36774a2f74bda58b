"""Laws of assistants: how far they go, when they let go, and what they do not know."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.people import ASSISTANTS, is_shielded, make_assistant
from agents.people.assistant import AssistMission, find_targets
from agents.policies import make_policy
from tests.laws.test_policies import plain
from tests.people.test_compiled import reading, scan_of
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings
from wheelchair_gym.types import Stick

CHAIR, SENSORS = ChairSettings(), SensorSettings()
MISSION = AssistMission(CHAIR, SENSORS, 0.1)
LIMITS = CHAIR.limits


def assisted(name, sticks, scans):
    """Return an assistant's twists for sticks and scans, 0.1 s apart."""
    assistant, found = make_assistant(name), []
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
        assistant.reset(MISSION)
        again = [
            assistant.assist(s, reading(scan, (0.2, 0.1), 0.1 * k), None)
            for k, (s, scan) in enumerate(zip(sticks, scans, strict=True))
        ]
        assert np.array(again).tobytes() == one.tobytes()


@pytest.mark.parametrize("name", ASSISTANTS)
def test_in_the_open_the_stick_is_the_twist_or_nearly(name):
    """With nothing near, full autonomy is unwanted: the stick decides."""
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
    env = NavigationEnv("clutter", driver="expert", beams=64, split="test")
    env.reset(seed=1)
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
    env = NavigationEnv("clutter", beams=64, split="test")
    env.reset(seed=0)
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
